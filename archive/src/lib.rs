//! Archives of many nights.
//!
//! ```text
//! FOLDER ─► scan (what changed) ─► Index (Parquet) ─► Query ─► passes ─► one curve of several nights
//! ```
//!
//! An [`Index`] has a row for each channel of each pass: whose light, when, through which channel, at which phase angles, in which file. It is brought up to date
//! by reading only files that are new or changed. A file that is damaged is named, and left out; it does not end the work. A curve that was itself joined out of an
//! archive is passed over: its samples would count twice.
//!
//! | module | what it holds |
//! |---|---|
//! | [`mod@file`] | what one file has: passes, or why it has none |
//! | [`index`] | the index of a folder, its two tables |
//! | [`query`] | passes that meet conditions |
//! | [`join`] | passes of several files as one curve |

mod error;
pub mod file;
pub mod index;
pub mod join;
pub mod query;

pub use error::ArchiveError;
pub use index::Index;
pub use query::{Found, Query};
