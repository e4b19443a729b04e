//! Raw tags: from a Time Tagger as they come, or out of the maker's files, into files of 16-byte records.

use super::bridge::{Bridge, protocol};
use super::frame::Frame;
use super::tagger::{Activity, TimeTagger};
use super::{DEVICE, bridge};
use crate::clock::Deadline;
use crate::device::{DeviceError, Interrupted};
use crate::tags::{RECORD_BYTES, Tag, TagKind, TagWriter, Tags};
use crate::transport::Bytes;
use serde_json::{Value, json};
use std::path::Path;
use std::time::Duration;
use sunglint_formats::FileError;

/// Summary of the tags written. Everything that came is in the file as it came; [`TagFile::check`](crate::tags::TagFile::check) says
/// where what is odd lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TagSummary {
    /// Records of any type.
    pub records: u64,
    /// Time tags among them.
    pub photons: u64,
    /// Overflows that began.
    pub overflows: u64,
    /// Events that the counter says it missed.
    pub missed: u64,
    /// Errors that the counter reported.
    pub errors: u64,
    /// Records that are earlier than the one before.
    pub unsorted: u64,
    /// Time of the latest record, ps.
    pub last_ps: Option<i64>,
    /// Time of the record before, ps.
    before_ps: Option<i64>,
}

impl TagSummary {
    fn add(&mut self, records: &[[u8; RECORD_BYTES]]) {
        for tag in Tags::of_records(records).iter() {
            self.records += 1;
            self.unsorted += u64::from(self.before_ps.is_some_and(|before| tag.time_ps < before));
            self.before_ps = Some(tag.time_ps);
            self.last_ps = self.last_ps.max(Some(tag.time_ps));
            match tag.kind() {
                Some(TagKind::TimeTag) => self.photons += 1,
                Some(TagKind::Error) => self.errors += 1,
                Some(TagKind::OverflowBegin) => self.overflows += 1,
                Some(TagKind::MissedEvents) => self.missed += u64::from(tag.missed),
                Some(TagKind::OverflowEnd) | None => {}
            }
        }
    }
}

/// A file that was converted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Converted {
    /// Summary of what was written.
    pub summary: TagSummary,
}

fn of_file(error: FileError) -> DeviceError {
    DeviceError::transport(DEVICE, error.into())
}

fn write(
    writer: &mut TagWriter,
    records: &[[u8; RECORD_BYTES]],
    now: Duration,
) -> Result<(), DeviceError> {
    let tags: Vec<Tag> = records.iter().map(Tag::from_bytes).collect();
    writer.write(&tags, now).map_err(of_file)
}

impl<T: Bytes> TimeTagger<T> {
    /// Starts the stream of raw tags of all channels.
    ///
    /// # Errors
    /// It is counting or streaming already, or see [`DeviceError`].
    pub fn start_tags(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.begin("stream", json!({}), Activity::Tags, deadline).map(|_| ())
    }

    /// Writes tags for `time` by the deadline's clock. What comes is written as it is: overflows, missed events and errors
    /// are records among the tags. May be called again and again; nothing is lost in between while the computer keeps up.
    ///
    /// # Errors
    /// The summary so far, with the error: the stream was not started, the file cannot be written, or see [`DeviceError`].
    pub fn record(
        &mut self,
        writer: &mut TagWriter,
        time: Duration,
        deadline: &Deadline,
    ) -> Result<TagSummary, Interrupted<TagSummary>> {
        let mut summary = TagSummary::default();
        match self.write_tags(writer, time, &mut summary, deadline) {
            Ok(()) => Ok(summary),
            Err(error) => Err(Interrupted::new(summary, error)),
        }
    }

    fn write_tags(
        &mut self,
        writer: &mut TagWriter,
        time: Duration,
        summary: &mut TagSummary,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        /// How long a silence may be until the writer looks at its clock.
        const LOOK: Duration = Duration::from_millis(100);
        if self.activity != Activity::Tags {
            let reason = "it does not stream tags: start them first";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        let end = deadline.now().saturating_add(time);
        loop {
            let now = deadline.now();
            let left = end.saturating_sub(now);
            if left.is_zero() {
                return writer.tick(now).map_err(of_file);
            }
            // Whether the whole has expired is asked before each step, so that a silent step is no error.
            if let Err(expired) = deadline.remaining() {
                return Err(DeviceError::expired(DEVICE, "recording tags", expired));
            }
            match self.bridge.measured(&deadline.at_most(left.min(LOOK))) {
                Ok(Frame::Tags(records)) => {
                    write(writer, &records, deadline.now())?;
                    summary.add(&records);
                }
                Ok(_) => return Err(protocol("a bin came, expected tags".into())),
                Err(DeviceError::Transport { source, .. }) if source.is_timeout() => {
                    writer.tick(deadline.now()).map_err(of_file)?;
                }
                Err(error) => return Err(error),
            }
        }
    }
}

/// Reads a `.ttbin` file of the maker's through the bridge and writes it as 16-byte records; no Time Tagger is needed. The
/// bridge counts what it sends, and the counts have to agree. The maker's library opens a damaged file and says that it holds
/// data (2.22.6); what it logs meanwhile is an error here.
///
/// # Errors
/// The summary so far, with the error: no package, no such file or a damaged one ([`DeviceError::Declined`]), or see
/// [`DeviceError`]. If it was stopped early the bridge ends with `line`.
pub fn convert<T: Bytes>(
    line: T,
    file: impl AsRef<Path>,
    writer: &mut TagWriter,
    deadline: &Deadline,
) -> Result<Converted, Interrupted<TagSummary>> {
    let mut summary = TagSummary::default();
    match converted(line, file.as_ref(), writer, &mut summary, deadline) {
        Ok(()) => Ok(Converted { summary }),
        Err(error) => Err(Interrupted::new(summary, error)),
    }
}

fn converted<T: Bytes>(
    line: T,
    file: &Path,
    writer: &mut TagWriter,
    summary: &mut TagSummary,
    deadline: &Deadline,
) -> Result<(), DeviceError> {
    let Some(path) = file.to_str() else {
        return Err(DeviceError::Unknown {
            name: "file",
            asked: file.display().to_string(),
            known: "names in UTF-8".into(),
        });
    };
    let (mut bridge, _) = Bridge::open(line, deadline)?;
    let answer =
        bridge.ask("convert", json!({"file": path}), deadline, &mut |frame| match frame {
            Frame::Tags(records) => {
                write(writer, &records, deadline.now())?;
                summary.add(&records);
                Ok(())
            }
            _ => Err(bridge::protocol("a bin came, expected tags".into())),
        })?;
    let of = |key: &str| answer.get(key).and_then(Value::as_u64);
    let (sent, came) = ((of("records"), of("photons")), (summary.records, summary.photons));
    if sent != (Some(came.0), Some(came.1)) {
        return Err(protocol(format!(
            "it sent {sent:?} records and time tags by its own count, {came:?} came"
        )));
    }
    Ok(())
}
