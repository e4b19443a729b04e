//! Photon events of PicoQuant's instruments: `.ptu` files, all documented T2 and T3 record types.
//!
//! A PTU file is a header of named entries and a row of 32-bit records whose clock rolls over every few milliseconds. The
//! records were laid out here after PicoQuant's published demos and format page
//! ([PicoQuant-Time-Tagged-File-Format-Demos](https://github.com/PicoQuant/PicoQuant-Time-Tagged-File-Format-Demos),
//! `doc/apx_tttrrecords.html`, `PTU/C/ptudemo.cc`, `PTU/Python/Read_PTU.py`) and checked against libtcspc
//! (`picoquant_t2.hpp`, MIT) and ptufile 2026.2.6 (BSD), which the tests also run:
//!
//! | device | T2 | T3 | clock of T2 rolls over after | of T3 after |
//! |---|---|---|---|---|
//! | PicoHarp 300 | 0x00010203 | 0x00010303 | 210,698,240 ticks | 65,536 syncs |
//! | HydraHarp, version 1 | 0x00010204 | 0x00010304 | 33,552,000 ticks | 1,024 syncs |
//! | HydraHarp, version 2 | 0x01010204 | 0x01010304 | 33,554,432 ticks | 1,024 syncs |
//! | TimeHarp 260 N | 0x00010205 | 0x00010305 | 33,554,432 ticks | 1,024 syncs |
//! | TimeHarp 260 P | 0x00010206 | 0x00010306 | 33,554,432 ticks | 1,024 syncs |
//! | Generic (MultiHarp, PicoHarp 330) | 0x00010207 | 0x00010307 | 33,554,432 ticks | 1,024 syncs |
//!
//! The format page also spells some T2 types with a leading 01 (0x01010205 …); its demos, libtcspc and ptufile know none of
//! them, and neither do we.
//!
//! [`PtuFile::records`] gives what the instrument wrote, with the clock unrolled; [`PtuFile::tags`] the same events as
//! [`Tag`](crate::tags::Tag)s, so that all of [`tags`](crate::tags) works on them:
//!
//! - channel 0 is the sync input (T2), channels from 1 the inputs as they are numbered on the housing. HydraHarp and its
//!   successors count inputs from 0 in their records, PicoHarp from 1; both become the same here;
//! - the markers 1, 2, … are the channels [`MARKER_CHANNEL`] + 1, + 2, …; one record may hold several. They are coarser than
//!   photons and may stand slightly out of time;
//! - T2 times are ticks × `MeasDesc_GlobalResolution`; T3 times are syncs × `MeasDesc_GlobalResolution` (the sync period) +
//!   `dtime` × `MeasDesc_Resolution`, both rounded to the nearest ps once, from the decimal numbers that the header means;
//! - a rollover of the clock is no loss of events. PTU records do not say where events were lost;
//! - a record that no document defines becomes a tag of type [`Error`](crate::tags::TagKind::Error), which flags its bin.
//!
//! ```no_run
//! use sunglint_drivers::ptu::PtuFile;
//! use sunglint_drivers::tags::TagWriter;
//! use std::time::Duration;
//!
//! let file = PtuFile::open("flare.ptu")?;
//! println!("{:?}, {} records", file.record_type(), file.len());
//! let mut writer = TagWriter::create("flare.tags")?;
//! for tag in file.tags() {
//!     writer.write(&[tag?], Duration::ZERO)?;
//! }
//! writer.finish()?;
//! # Ok::<(), sunglint_formats::FileError>(())
//! ```

mod file;
mod header;
mod record;
mod scale;

pub use file::{PtuFile, Records, TagsOf};
pub use header::{Entry, Header, MOST_ENTRIES, MOST_VALUE_BYTES, Value};
pub use record::{Decoder, MARKER_CHANNEL, Record, RecordType, RolledTooFar};
pub use scale::Resolution;
