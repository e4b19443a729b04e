//! Raw photon time tags: files of 16-byte records, in, out, checked and binned.
//!
//! The record is the `Tag` of Swabian's Time Tagger (the vendor's C++ header `TimeTagger.h`; read independently in
//! libtcspc, `swabian_tag.hpp`, MIT), little-endian, without any header, so that a file is a plain row of them:
//!
//! | bytes | field | meaning |
//! |---|---|---|
//! | 0 | type | 0 time tag, 1 error, 2 overflow begins, 3 overflow ends, 4 missed events |
//! | 1 | reserved | 0 |
//! | 2–3 | missed, u16 | how many events were missed (type 4 only) |
//! | 4–7 | channel, i32 | rising edges count up from 1, falling edges are negative |
//! | 8–15 | time, i64 | ps on the counter's own clock |
//!
//! # What the flags of a bin mean
//!
//! A time tagger that gets more events than it can hand over stops timing them for a while, and only counts. It says so
//! (the vendor's `TimeTagger.h`, at `struct Tag`), and a bin keeps it as [`CountFlags`](crate::CountFlags):
//!
//! - `OVERFLOW`: the bin has a moment in common with such an interval. Light was there that was not timed: **the counts are
//!   lower bounds**. Leave the bin out of a fit, or use it as a limit. The cure lies before the counter: less light, fewer
//!   channels, a longer dead time, a filter on the clock channel.
//! - `MISSED`: the counter reported how many events of a channel it did not time; their number stands in `missed`, in the
//!   bin in which the report came. When they came nobody knows: **the counts are lower bounds**, and `counts + missed` is
//!   a total only over all the bins that one overflow touches.
//! - `ERROR`: the counter reported an error, typically because its reference clock came or went. **The times before and
//!   after it do not belong to one clock**, and the counts of the bin itself mean nothing. Only the bin of the report is
//!   flagged; a series that goes on after it needs a new time zero.
//! - `PARTIAL`: the last bin, where the span asked for is no multiple of the width; its length is the true one.
//!
//! A bin without a flag is exact: each tag in it is counted once. It does not mean that the counter ran: a file does
//! not know when a recording started or ended, so bins before the first and after the last tag are zeros that mean
//! nothing. [`Report`] tells both times, and the longest silence between.
//!
//! # From a file to counts
//!
//! ```
//! use sunglint_formats::tags::{Binning, CheckOptions, Tag, TagFile, TagWriter};
//! use std::time::Duration;
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("night.tags");
//! let mut writer = TagWriter::create(&path)?;
//! writer.write(&[Tag::photon(1, 100), Tag::photon(-2, 250), Tag::photon(1, 1_000)], Duration::ZERO)?;
//! writer.finish()?;
//!
//! let file = TagFile::open(&path)?;
//! let report = file.check(&CheckOptions::default())?;
//! assert!(report.is_clean());
//! assert_eq!((report.first_ps, report.last_ps), (Some(100), Some(1_000)));
//!
//! // Channels 1 and -2 (its falling edge) in bins of 500 ps from 0 to 1,500 ps.
//! let binned = file.bin(&Binning::new(&[1, -2], 500, 0, 1_500)?)?;
//! assert_eq!(binned.counts(0), [1, 1]);
//! assert_eq!(binned.counts(1), [0, 0]);
//! assert_eq!(binned.counts(2), [1, 0]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Why files are read, not mapped
//!
//! A mapped file that another program cuts short kills the process that maps it (SIGBUS), and a mapped file that changes
//! breaks what Rust promises about slices. So files are read in pieces that fit a core's cache. It costs one copy
//! at memory speed, and a file that shrinks is an error with a name.
//!
//! Cost of this reading, by `benches/tags.rs` on one core of a machine whose memory reads 28 GB/s (1,730 million tags/s): reading
//! in pieces alone 28 GB/s, as fast as the memory; counting in 0.1 s bins 450 million tags/s (7.2 GB/s), in 100 µs bins
//! 465, in 1 µs bins with three tags each 94 to 100; checking 265. A map could save a quarter of the time of 0.1 s bins
//! at most, and none of it where the disk is the limit.

mod bin;
mod binned;
pub mod bytes_at;
mod check;
mod error;
mod file;
mod stream;
mod tag;
mod write;

pub use bin::{Binning, MOST_CELLS};
pub use binned::Binned;
pub use check::{ChannelReport, CheckOptions, Gap, MOST_LISTED, Overflow, Report};
pub use error::TagError;
pub use file::{Recovered, TagFile};
pub use stream::{BinStream, FinishedBin};
pub use tag::{RECORD_BYTES, Tag, TagKind, Tags};
pub use write::{SYNC_EVERY, TagWriter};
