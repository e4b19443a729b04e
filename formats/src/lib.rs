//! The files of the `sunglint` toolkit, in and out: bytes and text only, no physics.
//!
//! In the order in which data meets it:
//!
//! - [`error`]: what a reader says when a file is not what it should be;
//! - [`table`]: columns with units and metadata, in memory;
//! - [`ecsv`]: tables as text that a person can open and astropy reads.

pub mod atomic;
pub mod bsdf;
pub mod counts;
pub mod curve;
pub mod ecsv;
pub mod error;
pub mod fits;
pub mod frame;
pub mod read;
pub mod table;
pub mod time;
pub mod toml;

pub use error::{FileError, ParseError, nearest_names};
pub use table::{Column, Meta, Table, TableError, Values};
