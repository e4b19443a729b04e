//! The files of the `sunglint` toolkit, in and out: bytes and text only, no physics.
//!
//! In the order in which data meets it:
//!
//! - [`mod@read`] and [`atomic`]: a file whole from the disk, and whole or not at all onto it;
//! - [`error`]: what a reader says when a file is not what it should be: path, line, field, found, expected, hint;
//! - [`kind`]: which kind of file this is, by its content;
//! - [`time`]: UTC as text, leap seconds included;
//! - [`toml`]: what people write (stations, instruments, plans) into plain serde structs;
//! - [`curve`]: what vendors publish (passbands, efficiencies) as CSV;
//! - [`jcamp`]: spectra as spectrometers export them;
//! - [`opus`]: spectra in files of Bruker's OPUS;
//! - [`fred`], [`zemax`], [`astm`]: scattered light as optical design programs and laboratories tabulate it;
//! - [`merl`], [`utia`]: reflection as databases of measured materials hold it;
//! - [`photometry`]: magnitudes as catalogues, observers and tracking stations publish them;
//! - [`crd`]: laser ranges as stations deliver them to the ILRS;
//! - [`counts`] and [`frame`]: what instruments deliver, a bin of a photon counter and a frame of a camera;
//! - [`image_frame`]: a frame of any other program, its header in one form;
//! - [`tags`]: photon time tags on disk, binned into counts;
//! - [`flag_bits`]: flags as bits of a number, which files name;
//! - [`table`]: columns with units and metadata, in memory;
//! - [`ecsv`]: tables as text that a person can open and astropy reads;
//! - [`fits`]: images, cubes and binary tables;
//! - [`bsdf`]: the tensor file of measured materials;
//! - [`session`]: a recorded night, a folder that grows and that a crash does not spoil.
//!
//! Readers refuse what they do not understand. They never panic on bytes from outside, and use no more memory than a
//! small multiple of the bytes that are there.
//!
//! # A night in three files
//!
//! ```
//! use serde::Deserialize;
//! use sunglint_formats::atomic::Overwrite;
//! use sunglint_formats::toml::{Document, NonNegative};
//! use sunglint_formats::{Column, Table, curve, ecsv, time};
//!
//! // What a person wrote, with units in the keys.
//! #[derive(Deserialize)]
//! #[serde(deny_unknown_fields)]
//! struct Channel {
//!     dead_time_ns: NonNegative,
//! }
//! let document = Document::new("channel.toml", "dead_time_ns = 22\n")?;
//! let channel: Channel = document.parse()?;
//! assert_eq!(channel.dead_time_ns.get(), 22.0);
//! let wrong = Document::new("channel.toml", "dead_time_ns = -22\n")?;
//! assert_eq!(
//!     wrong.parse::<Channel>().err().expect("it is negative").to_string(),
//!     "channel.toml:1: dead_time_ns: found -22, expected a number of 0 or above"
//! );
//!
//! // What a vendor published.
//! let filter = curve::read_str("g.csv", "wavelength_um,transmission_percent\n0.5,40\n0.6,90\n", None)?;
//! assert_eq!((filter.x[0], filter.y[0]), (500.0, 0.4));
//!
//! // What was measured, as a table that astropy reads.
//! let epoch = time::parse_utc("2016-12-31T23:59:60.5Z")?;
//! let table = Table {
//!     meta: [("quantity".to_owned(), "raw".into())].into_iter().collect(),
//!     columns: vec![
//!         Column::text("time_utc", vec![time::format_utc(epoch, 3)]),
//!         Column::f64("g_rate_hz", Some("Hz"), vec![1234.5]),
//!     ],
//! };
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("night.ecsv");
//! ecsv::write_file(&path, &table, Overwrite::Refuse)?;
//! assert_eq!(ecsv::read(&path)?, table);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod astm;
pub mod atomic;
pub mod bsdf;
pub mod counts;
pub mod crd;
pub mod curve;
mod digest;
pub mod ecsv;
pub mod error;
pub mod fits;
pub mod flag_bits;
pub mod frame;
pub mod fred;
pub mod image_frame;
pub mod jcamp;
pub mod kind;
pub mod merl;
pub mod opus;
pub mod photometry;
pub mod read;
pub mod session;
pub mod table;
pub mod tags;
pub mod text;
pub mod text_table;
pub mod time;
pub mod toml;
pub mod utia;
pub mod wcs;
pub mod zemax;

pub use counts::{CountFlags, CountRecord, CountSeries};
pub use curve::Curve;
pub use digest::sha256;
pub use error::{EncodeError, FileError, ParseError, ParseErrorParts, nearest_names};
pub use frame::{Bayer, Frame};
pub use table::{Column, Meta, Table, TableError, Values};
