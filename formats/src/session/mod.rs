//! A night as it was recorded: one folder that only grows.
//!
//! ```text
//! NAME/
//!   session.toml                what it is: station, devices, how the clock stood       [`Manifest`]
//!   night.toml, station/ …      the configuration as used; session.toml has their SHA-256
//!   events.jsonl                one JSON object a line: targets, devices, sync marks …  [`Event`]
//!   events.end                  how long that log is at the session's end, and its CRC-32
//!   counts/COUNTER.ecsv         a counter's bins, row by row                            [`Counts`]
//!   tags/COUNTER.tags           its raw tags, if asked: rows of 16 bytes
//!   frames/CAMERA/HH/START_NUMBER.fits   a camera's frames, HH the hour (UTC)           [`Frames`]
//! ```
//!
//! [`SessionWriter`] writes it on a [`Storage`]; [`Session`] reads it lazily: frames one by one, counts a thousand rows at a
//! time; [`check`](Session::check) says what is missing.
//!
//! # What is safe
//! At most a second apart, all files are written through to the disk, then a `sync` event says how far each of them is safe,
//! with its CRC-32, and is written through itself. A frame gets its name once it is on the disk, whole. So after `kill -9`, a power
//! failure or a full disk everything older than the last second is there; behind it may be more, down to half a line, which
//! readers leave out.
//!
//! # On a desk
//!
//! ```
//! use std::sync::Arc;
//! use sunglint_formats::session::{
//!     ClockState, Device, DeviceKind, Disk, FORMAT, Manifest, Session, SessionWriter, Target, TargetKind, What,
//! };
//! use sunglint_formats::{CountFlags, CountRecord, time::parse_utc};
//!
//! let start = parse_utc("2020-11-18T17:05:00Z")?;
//! let clock = ClockState { method: "none".into(), synchronised: None, offset_s: None, error_s: None };
//! let tagger = Device {
//!     name: "tagger".into(),
//!     kind: DeviceKind::Counter,
//!     address: "sim-timetagger".into(),
//!     options: vec![],
//!     channels: vec!["g".into()],
//!     inputs: vec![1],
//!     raw_tags: false,
//!     exposure_s: 0.1,
//!     interval_s: None,
//!     filter: None,
//! };
//! let manifest = Manifest {
//!     format: FORMAT.into(),
//!     program: "an example".into(),
//!     station: "ufo".into(),
//!     start_utc: start,
//!     clock,
//!     devices: vec![tagger],
//!     files: vec![],
//! };
//! let folder = tempfile::tempdir()?;
//! let root = folder.path().join("night");
//! let mut writer = SessionWriter::create(Arc::new(Disk), &root, &manifest, &[])?;
//! writer.event(start, What::Target(Target::off(TargetKind::Sky)));
//! let bin = CountRecord {
//!     start,
//!     start_ps: 0,
//!     length_ps: 100_000_000_000,
//!     counts: vec![17],
//!     missed: vec![0],
//!     flags: CountFlags::empty(),
//! };
//! writer.count("tagger", &bin)?;
//! assert_eq!(writer.finish(start, "done").lost, 0);
//!
//! let session = Session::open(&root)?;
//! let bins: Vec<CountRecord> = session.counts("tagger")?.collect::<Result<_, _>>()?;
//! assert_eq!(bins, [bin]);
//! assert_eq!(session.visits()?[0].target.name, "sky");
//! assert!(session.check()?.is_whole());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod append;
mod check;
mod counts;
mod event;
mod fragile;
mod frames;
mod index;
mod manifest;
mod reader;
mod storage;
mod writer;

pub use check::{CameraReport, CounterReport, Finding, Report, Severity};
pub use counts::Counts;
pub use event::{ClockState, Event, Mark, Target, TargetKind, What};
pub use fragile::Fragile;
pub use frames::{
    FILTER_DOUBTED, FLAT_LEVEL, FRAME_NUMBER, FrameFile, Frames, SHARED, is_near_level,
};
pub use index::{CountBlock, CountIndex};
pub use manifest::{Device, DeviceKind, FORMAT, FileSum, Manifest, is_name};
pub use reader::{Events, Session, Visit};
pub use storage::{Disk, Growing, Storage};
pub use writer::{Ended, Resumed, SYNC_EVERY, SessionWriter, Trouble};

/// The manifest.
const MANIFEST: &str = "session.toml";
/// The mark of the event log's end.
const SEAL: &str = "events.end";
/// The event log.
const EVENTS: &str = "events.jsonl";
/// The folder of the counters' tables.
const COUNTS: &str = "counts";
/// The folder of raw tags.
const TAGS: &str = "tags";
/// The folder of the cameras' folders.
const FRAMES: &str = "frames";

/// Text of the mark of the event log's end.
fn seal(end: &Mark) -> String {
    format!("{} bytes, CRC-32 {:08x}\n", end.bytes, end.crc32)
}
