//! Check of a session: the data that are there, and those that are missing.

use super::counts::Counts;
use super::event::{Event, Mark, What};
use super::frames::Frames;
use super::manifest::FileSum;
use super::reader::{Events, Session};
use super::{COUNTS, EVENTS, FRAMES, MANIFEST, SEAL, TAGS};
use crate::counts::CountFlags;
use crate::error::FileError;
use crate::time::format_utc;
use hifitime::Epoch;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// Worth knowing; nothing that was promised is missing.
    Note,
    /// Data are missing, or not what was written.
    Missing,
}

/// Something that was found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// The file, within the session's folder.
    pub file: String,
    /// Description of the finding, with the numbers.
    pub text: String,
}

/// Report on the data of a counter.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CounterReport {
    /// Name of the device.
    pub name: String,
    /// Whole rows.
    pub rows: u64,
    /// Rows of the last mark: those that were promised.
    pub marked_rows: u64,
    /// Gaps that the counter itself flags.
    pub flagged_gaps: u64,
    /// Gaps and overlaps in its own time that carry no flag.
    pub unflagged_gaps: u64,
    /// Whole raw tags, where they were asked for.
    pub tags: Option<u64>,
    /// Tags of the last mark: those that were promised.
    pub marked_tags: u64,
    /// Start of the first and of the last bin.
    pub from_to: Option<[Epoch; 2]>,
}

/// Report on the data of a camera.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CameraReport {
    /// Name of the device.
    pub name: String,
    /// Frames.
    pub frames: u64,
    /// Frames that were promised.
    pub marked_frames: u64,
    /// Numbers up to the last frame that was taken that no frame has.
    pub missing_frames: u64,
    /// Frames that were being written at the end.
    pub unfinished: u64,
}

/// Report on the data of a session.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Report {
    /// The counters.
    pub counters: Vec<CounterReport>,
    /// The cameras.
    pub cameras: Vec<CameraReport>,
    /// Events of the log.
    pub events: u64,
    /// The last mark's time: all older than this was promised.
    pub safe_until: Option<Epoch>,
    /// Whether the session ended as it should.
    pub ended: bool,
    /// Findings of the check.
    pub findings: Vec<Finding>,
}

impl Report {
    /// Whether all that was captured is there, as it was written, up to an end in good order.
    pub fn is_whole(&self) -> bool {
        self.findings.iter().all(|finding| finding.severity == Severity::Note)
    }

    fn note(&mut self, file: &str, text: impl Into<String>) {
        self.find(Severity::Note, file, text);
    }

    fn missing(&mut self, file: &str, text: impl Into<String>) {
        self.find(Severity::Missing, file, text);
    }

    fn find(&mut self, severity: Severity, file: &str, text: impl Into<String>) {
        self.findings.push(Finding { severity, file: file.to_owned(), text: text.into() });
    }
}

/// The marks of a file, and when each was set.
type Marks = BTreeMap<String, Vec<(Epoch, Mark)>>;

impl Session {
    /// Reads all of the session once and says what is missing.
    ///
    /// # Errors
    /// Only what keeps it from looking at all: the system's refusals. What is wrong in the files is in the report.
    pub fn check(&self) -> Result<Report, FileError> {
        let mut report = Report::default();
        self.check_configuration(&mut report);
        let (marks, taken) = self.check_events(&mut report)?;
        self.check_end(&mut report)?;
        for name in self.counters() {
            self.check_counter(name, &marks, &mut report)?;
        }
        for name in self.cameras() {
            self.check_camera(name, &marks, taken.get(name).copied(), &mut report)?;
        }
        for (file, marks) in &marks {
            let known =
                file == EVENTS || [COUNTS, FRAMES, TAGS].iter().any(|f| file.starts_with(f));
            if !known {
                self.check_marks(file, marks, &mut report)?;
            }
        }
        Ok(report)
    }

    fn check_configuration(&self, report: &mut Report) {
        for FileSum { path, sha256 } in &self.manifest().files {
            match crate::read::bytes(self.file(path)) {
                Err(error) => report.missing(path, error.to_string()),
                Ok(bytes) if FileSum::of(path, &bytes).sha256 != *sha256 => {
                    report.missing(path, "its SHA-256 is not the one in session.toml");
                }
                Ok(_) => {}
            }
        }
    }

    /// The marks, and the number of the last frame that each camera took.
    fn check_events(
        &self,
        report: &mut Report,
    ) -> Result<(Marks, BTreeMap<String, u64>), FileError> {
        let (mut marks, mut taken, mut begun) = (Marks::new(), BTreeMap::new(), None);
        let mut said = BTreeMap::<(String, String), (String, u64)>::new();
        let mut events: Events = self.events()?;
        for event in events.by_ref() {
            let Event { utc, what } = match event {
                Ok(event) => event,
                Err(FileError::Parse(error)) => {
                    report.missing(EVENTS, error.to_string());
                    continue;
                }
                Err(error) => return Err(error),
            };
            report.events += 1;
            match what {
                What::Start { manifest_sha256, .. } => begun = Some(manifest_sha256),
                What::Resume { gap_s, cut_bytes, .. } => {
                    report.ended = false;
                    let at = format_utc(utc, 3);
                    let cut = match cut_bytes {
                        0 => String::new(),
                        n => format!(", {n} bytes of half lines were cut off"),
                    };
                    report.note(
                        EVENTS,
                        format!("it was resumed at {at}, {gap_s:.1} s after its last mark{cut}"),
                    );
                }
                What::Sync { files } => {
                    report.safe_until = Some(utc);
                    for mark in files {
                        marks.entry(mark.file.clone()).or_default().push((utc, mark));
                    }
                }
                What::End { lost, frames, .. } => {
                    report.ended = true;
                    taken.extend(frames);
                    if lost > 0 {
                        let text = format!("{lost} rows, tags or frames could not be written");
                        report.missing(EVENTS, text);
                    }
                }
                What::Error { about, error } => {
                    // The same again and again, with other numbers in it, is told once, and how often.
                    let words: String =
                        error.chars().filter(|c| !c.is_ascii_digit() && *c != '.').collect();
                    let (_, times) = said.entry((about, words)).or_insert((error, 0_u64));
                    *times += 1;
                }
                What::ClockStep { step_s, computer_utc } => {
                    let at = format_utc(utc, 3);
                    let then = computer_utc.map_or(String::new(), |then| {
                        format!(" of the night's time, to {then}; the night's time did not step")
                    });
                    report
                        .note(EVENTS, format!("the clock stepped by {step_s:+.6} s at {at}{then}"));
                }
                What::ClockAdopted { step_s } => {
                    let at = format_utc(utc, 3);
                    let text = format!("the night's time was corrected by {step_s:+.6} s, to {at}");
                    report.note(EVENTS, text);
                }
                What::Stall { stall_s } => {
                    let at = format_utc(utc, 3);
                    let text = format!("the program stood still for {stall_s:.3} s until {at}");
                    report.note(EVENTS, text);
                }
                What::DeviceFailed { device, error } => {
                    report.missing(EVENTS, format!("{device} was given up: {error}"));
                }
                What::FramesRefused { device, frames, error } => {
                    let text = format!("{frames} frames of {device} were refused so far: {error}");
                    report.note(EVENTS, text);
                }
                _ => {}
            }
        }
        for ((about, _), (first, times)) in said {
            match times {
                1 => report.note(&about, format!("said: {first}")),
                times => report.note(&about, format!("said {times} times, at first: {first}")),
            }
        }
        self.check_manifest(begun.flatten(), report)?;
        if events.torn_bytes() > 0 {
            let text = format!("its last line was cut off: {} bytes", events.torn_bytes());
            report.missing(EVENTS, text);
        }
        if !report.ended {
            let until = report.safe_until.map_or("any mark".into(), |utc| format_utc(utc, 3));
            let text = "the session did not end in good order, or is still being written";
            report.missing(EVENTS, format!("{text}: data after {until} may be missing"));
        }
        if let Some(own) = marks.get(EVENTS) {
            self.check_marks(EVENTS, own, report)?;
        }
        Ok((marks, taken))
    }

    /// Holds the manifest against its sum in the log.
    fn check_manifest(&self, sum: Option<String>, report: &mut Report) -> Result<(), FileError> {
        let Some(sum) = sum else {
            if self.manifest().is_sealed() {
                report.missing(MANIFEST, "the log has no sum of it (event `start`)");
            } else {
                let text = "a session of format 1: a change of this file, or of the log's last lines, cannot be found";
                report.note(MANIFEST, text);
            }
            return Ok(());
        };
        let bytes = crate::read::bytes(self.file(MANIFEST))?;
        if FileSum::of(MANIFEST, &bytes).sha256 != sum {
            report.missing(MANIFEST, "its SHA-256 is not the one in events.jsonl");
        }
        Ok(())
    }

    /// Holds the log's end against its mark.
    fn check_end(&self, report: &mut Report) -> Result<(), FileError> {
        let (path, log) = (self.file(SEAL), self.file(EVENTS));
        if !path.is_file() {
            if report.ended && self.manifest().is_sealed() {
                report.missing(SEAL, "it is not there");
            }
            return Ok(());
        }
        let said = crate::read::bytes(&path)?;
        let mut crc = flate2::Crc::new();
        let mut file = File::open(&log).map_err(|error| FileError::io("read", &log, error))?;
        let mut room = vec![0; 1 << 16];
        let mut bytes = 0;
        loop {
            let n = file.read(&mut room).map_err(|error| FileError::io("read", &log, error))?;
            if n == 0 {
                break;
            }
            crc.update(&room[..n]);
            bytes += n as u64;
        }
        let found = Mark { file: EVENTS.into(), bytes, rows: 0, crc32: crc.sum() };
        if said != super::seal(&found).as_bytes() {
            report.missing(EVENTS, format!("{bytes} bytes are not those of {SEAL}"));
        }
        Ok(())
    }

    /// Holds a file against its marks.
    fn check_marks(
        &self,
        file: &str,
        marks: &[(Epoch, Mark)],
        report: &mut Report,
    ) -> Result<(), FileError> {
        let path = self.file(file);
        let found = match first_wrong(&path, marks) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                report.missing(file, "it is not there");
                return Ok(());
            }
            found => found.map_err(|error| FileError::io("read", &path, error))?,
        };
        match found {
            None => {}
            Some(Wrong::Short { length }) => {
                let (utc, last) = &marks[marks.len() - 1];
                let text = format!(
                    "{length} bytes, of {} with {} rows that were safe at {}",
                    last.bytes,
                    last.rows,
                    format_utc(*utc, 3)
                );
                report.missing(file, text);
            }
            Some(Wrong::Changed { from, to, at }) => {
                let at = format_utc(at, 3);
                let text = format!(
                    "bytes {from} to {to} are not what was written (CRC-32 of the mark at {at})"
                );
                report.missing(file, text);
            }
        }
        Ok(())
    }

    fn check_counter(
        &self,
        name: &str,
        marks: &Marks,
        report: &mut Report,
    ) -> Result<(), FileError> {
        let file = format!("{COUNTS}/{name}.ecsv");
        let own = marks.get(&file).map_or(&[][..], Vec::as_slice);
        self.check_marks(&file, own, report)?;
        let marked_rows = own.last().map_or(0, |(_, mark)| mark.rows);
        let mut counter = CounterReport { name: name.into(), marked_rows, ..Default::default() };
        if self.file(&file).is_file() {
            match self.counts(name) {
                Ok(counts) => check_rows(counts, &file, &mut counter, report)?,
                Err(FileError::Parse(error)) => report.missing(&file, error.to_string()),
                Err(error) => return Err(error),
            }
        } else if own.is_empty() {
            report.missing(&file, "it is not there");
        }
        if counter.rows == 0 && report.ended {
            report.missing(&file, "the counter was planned and recorded no bin");
        }
        self.check_tags(name, marks, &mut counter, report)?;
        report.counters.push(counter);
        Ok(())
    }

    /// Holds a counter's raw tags against their marks, where there are any or should be.
    fn check_tags(
        &self,
        name: &str,
        marks: &Marks,
        counter: &mut CounterReport,
        report: &mut Report,
    ) -> Result<(), FileError> {
        let file = format!("{TAGS}/{name}.tags");
        let asked = self.manifest().devices.iter().any(|d| d.name == name && d.raw_tags);
        let own = marks.get(&file).map_or(&[][..], Vec::as_slice);
        let path = self.file(&file);
        if asked || !own.is_empty() {
            self.check_marks(&file, own, report)?;
        }
        counter.marked_tags = own.last().map_or(0, |(_, mark)| mark.rows);
        if let Ok(about) = path.metadata() {
            counter.tags = Some(about.len() / 16);
            match about.len() % 16 {
                0 => {}
                torn => {
                    report.missing(&file, format!("its last record was cut off: {torn} bytes"));
                }
            }
        }
        Ok(())
    }

    fn check_camera(
        &self,
        name: &str,
        marks: &Marks,
        taken: Option<u64>,
        report: &mut Report,
    ) -> Result<(), FileError> {
        let folder = format!("{FRAMES}/{name}");
        let within = format!("{folder}/");
        let mut camera = CameraReport { name: name.into(), ..Default::default() };
        for (file, own) in marks.range(within.clone()..).take_while(|(f, _)| f.starts_with(&within))
        {
            camera.marked_frames += 1;
            self.check_marks(file, &own[own.len() - 1..], report)?;
        }
        let Frames { files, unfinished, foreign } = self.frames(name)?;
        camera.frames = files.len() as u64;
        camera.unfinished = unfinished.len() as u64;
        // Numbers count from 1, so that a lack before the first shows, too.
        let mut before = 0;
        for frame in &files {
            if frame.sequence <= before {
                report.missing(&folder, format!("frame {} is there twice", frame.sequence));
            } else if frame.sequence > before + 1 {
                let missing = frame.sequence - before - 1;
                camera.missing_frames += missing;
                let text = match missing {
                    1 => format!("frame {} is missing", before + 1),
                    n => format!("{n} frames are missing: {} to {}", before + 1, before + n),
                };
                report.missing(&folder, text);
            }
            before = frame.sequence.max(before);
        }
        // Those after the last that was written.
        if let Some(missing) = taken.and_then(|last| last.checked_sub(before)).filter(|n| *n > 0) {
            camera.missing_frames += missing;
            let last = before + missing;
            let text = match missing {
                1 => format!("frame {last}, the last that was taken, is missing"),
                n => format!("the last {n} frames are missing: {} to {last}", before + 1),
            };
            report.missing(&folder, text);
        }
        if files.is_empty() && report.ended {
            report.missing(&folder, "the camera was planned and recorded no frame");
        }
        if camera.unfinished > 0 {
            let text = format!("{} frames were being written at the end", camera.unfinished);
            report.note(&folder, text);
        }
        for path in foreign {
            report.note(&folder, format!("{} is none of ours", path.display()));
        }
        report.cameras.push(camera);
        Ok(())
    }
}

/// Reads all rows of a counter.
fn check_rows(
    mut counts: Counts,
    file: &str,
    counter: &mut CounterReport,
    report: &mut Report,
) -> Result<(), FileError> {
    let mut next_ps: Option<i64> = None;
    for record in counts.by_ref() {
        let record = match record {
            Ok(record) => record,
            Err(FileError::Parse(error)) => {
                report.missing(file, error.to_string());
                break;
            }
            Err(error) => return Err(error),
        };
        counter.rows += 1;
        counter.from_to =
            Some([counter.from_to.map_or(record.start, |[from, _]| from), record.start]);
        if let Some(next_ps) = next_ps.filter(|&next| next != record.start_ps) {
            let lack_s = (i128::from(record.start_ps) - i128::from(next_ps)) as f64 * 1e-12;
            if record.flags.contains(CountFlags::GAP) {
                counter.flagged_gaps += 1;
            } else {
                counter.unflagged_gaps += 1;
                let at = format_utc(record.start, 3);
                let what = if lack_s > 0.0 { "lacks before" } else { "is there twice from" };
                let text = format!(
                    "{:.6} s {what} the bin at {at}, which says nothing of it",
                    lack_s.abs()
                );
                report.missing(file, text);
            }
        }
        next_ps = Some(record.start_ps.saturating_add(record.length_ps));
    }
    if counter.flagged_gaps > 0 {
        let text = format!("{} gaps that the counter itself flags", counter.flagged_gaps);
        report.note(file, text);
    }
    if counts.torn_bytes() > 0 {
        let text = format!("its last row was cut off: {} bytes", counts.torn_bytes());
        report.missing(file, text);
    }
    Ok(())
}

/// Difference between a file and its marks.
enum Wrong {
    Short { length: u64 },
    Changed { from: u64, to: u64, at: Epoch },
}

/// Reads a file once, up to its last mark.
fn first_wrong(path: &Path, marks: &[(Epoch, Mark)]) -> io::Result<Option<Wrong>> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    let mut hasher = flate2::Crc::new();
    let mut from = 0;
    let mut buffer = vec![0; 1 << 16];
    for (utc, mark) in marks {
        if mark.bytes > length {
            return Ok(Some(Wrong::Short { length }));
        }
        let mut left = mark.bytes.saturating_sub(from);
        while left > 0 {
            let most = usize::try_from(left).unwrap_or(usize::MAX).min(buffer.len());
            let read = file.read(&mut buffer[..most])?;
            if read == 0 {
                return Ok(Some(Wrong::Short { length }));
            }
            hasher.update(&buffer[..read]);
            left -= read as u64;
        }
        if hasher.sum() != mark.crc32 {
            return Ok(Some(Wrong::Changed { from, to: mark.bytes, at: *utc }));
        }
        from = mark.bytes;
    }
    Ok(None)
}
