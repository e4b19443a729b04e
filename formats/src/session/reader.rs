//! A session as it lies on the disk.

use super::counts::Counts;
use super::event::{Event, Target, TargetKind, What};
use super::frames::Frames;
use super::index::CountIndex;
use super::manifest::{DeviceKind, Manifest};
use super::{COUNTS, EVENTS, FRAMES, MANIFEST, TAGS};
use crate::error::FileError;
use hifitime::Epoch;
use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};

/// A session's folder, read lazily.
#[derive(Debug, Clone, PartialEq)]
pub struct Session {
    root: PathBuf,
    manifest: Manifest,
}

/// A stay at a target.
#[derive(Debug, Clone, PartialEq)]
pub struct Visit {
    /// The target.
    pub target: Target,
    /// Which stay at a target of this name it is, from 1.
    pub number: u32,
    /// When it began.
    pub from: Epoch,
    /// When it ended; `None` if the log ends before.
    pub to: Option<Epoch>,
}

impl Session {
    /// Opens a session's folder: reads its manifest alone.
    ///
    /// # Errors
    /// No such folder, or a manifest that is none: see [`Manifest::read`].
    pub fn open(folder: impl AsRef<Path>) -> Result<Self, FileError> {
        let root = folder.as_ref().to_path_buf();
        let manifest = Manifest::read(root.join(MANIFEST))?;
        Ok(Self { root, manifest })
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Returns the session's manifest.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// A file of the configuration as used (`night.toml`, `station/station.toml` …).
    pub fn file(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    /// Names of the counters.
    pub fn counters(&self) -> impl Iterator<Item = &str> {
        self.manifest.devices_of(DeviceKind::Counter).map(|device| device.name.as_str())
    }

    /// Names of the cameras.
    pub fn cameras(&self) -> impl Iterator<Item = &str> {
        self.manifest.devices_of(DeviceKind::Camera).map(|device| device.name.as_str())
    }

    /// The bins of a counter, from the first on.
    ///
    /// # Errors
    /// No such counter; as [`Counts::open`].
    pub fn counts(&self, counter: &str) -> Result<Counts, FileError> {
        let device = self.manifest.device(&self.root, DeviceKind::Counter, counter)?;
        Counts::open(self.root.join(COUNTS).join(format!("{}.ecsv", device.name)))
    }

    /// Where the bins of a counter lie in its table, for any stretch of the night at once.
    ///
    /// # Errors
    /// No such counter; the errors of [`CountIndex::open`].
    pub fn count_index(&self, counter: &str) -> Result<CountIndex, FileError> {
        let device = self.manifest.device(&self.root, DeviceKind::Counter, counter)?;
        CountIndex::open(self.root.join(COUNTS).join(format!("{}.ecsv", device.name)))
    }

    /// The file of a counter's raw tags, where there is one.
    ///
    /// # Errors
    /// No such counter.
    pub fn tags(&self, counter: &str) -> Result<Option<PathBuf>, FileError> {
        let device = self.manifest.device(&self.root, DeviceKind::Counter, counter)?;
        let path = self.root.join(TAGS).join(format!("{}.tags", device.name));
        Ok(path.is_file().then_some(path))
    }

    /// The frames of a camera: their names; none is read.
    ///
    /// # Errors
    /// No such camera; the system's.
    pub fn frames(&self, camera: &str) -> Result<Frames, FileError> {
        let device = self.manifest.device(&self.root, DeviceKind::Camera, camera)?;
        Frames::list(&self.root.join(FRAMES).join(&device.name))
    }

    /// The events, one by one.
    ///
    /// # Errors
    /// The system's.
    pub fn events(&self) -> Result<Events, FileError> {
        Events::open(self.root.join(EVENTS))
    }

    /// The stays at targets, in time; the time between two planned ones is none ([`TargetKind::None`] is left out).
    ///
    /// # Errors
    /// The errors of [`Events`].
    pub fn visits(&self) -> Result<Vec<Visit>, FileError> {
        let mut visits: Vec<Visit> = Vec::new();
        for event in self.events()? {
            let event = event?;
            let ends = matches!(event.what, What::Target(_) | What::End { .. });
            if let Some(last) = visits.last_mut().filter(|last| ends && last.to.is_none()) {
                last.to = Some(event.utc);
            }
            if let What::Target(target) = event.what {
                let number = 1 + visits.iter().filter(|v| v.target.name == target.name).count();
                let number = u32::try_from(number).unwrap_or(u32::MAX);
                visits.push(Visit { target, number, from: event.utc, to: None });
            }
        }
        visits.retain(|visit| visit.target.target_kind != TargetKind::None);
        Ok(visits)
    }
}

/// No line of ours is longer, bytes.
const LONGEST: u64 = 1 << 24;

/// The events of a log, one by one; a last line without its end is left out.
#[derive(Debug)]
pub struct Events {
    path: PathBuf,
    file: BufReader<File>,
    line: u64,
    torn_bytes: u64,
    marks: bool,
}

/// Beginning of a `sync` event behind its time: four of them are written every second.
const SYNC: &[u8] = br#"","kind":"sync","#;
/// Bytes in which it stands.
const HEAD: usize = 64;

impl Events {
    /// Opens a log.
    ///
    /// # Errors
    /// The system's.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, FileError> {
        Self::open_at(path.as_ref())
    }

    fn open_at(path: &Path) -> Result<Self, FileError> {
        let path = path.to_path_buf();
        let file = File::open(&path).map_err(|error| FileError::io("read", &path, error))?;
        Ok(Self { path, file: BufReader::new(file), line: 0, torn_bytes: 0, marks: true })
    }

    /// Leaves out the marks of what is safe (`sync`), which are nearly all of a log, and are skipped ten times as fast as they are read.
    #[must_use]
    pub fn without_marks(mut self) -> Self {
        self.marks = false;
        self
    }

    /// Bytes of a last line without its end; known once all were read.
    pub fn torn_bytes(&self) -> u64 {
        self.torn_bytes
    }

    fn read(&mut self) -> Result<Option<Event>, FileError> {
        let mut line = Vec::new();
        loop {
            line.clear();
            let read = self.file.by_ref().take(LONGEST).read_until(b'\n', &mut line);
            read.map_err(|error| FileError::io("read", &self.path, error))?;
            if line.last() != Some(&b'\n') {
                self.torn_bytes = self.torn_bytes.max(line.len() as u64);
                return Ok(None);
            }
            line.pop();
            self.line += 1;
            let head = &line[..line.len().min(HEAD)];
            if self.marks || !head.windows(SYNC.len()).any(|part| part == SYNC) {
                break;
            }
        }
        let text = crate::read::decode(&self.path, line).map_err(|e| e.at_line(self.line))?;
        Ok(Some(Event::from_line(&self.path, &text).map_err(|e| e.at_line(self.line))?))
    }
}

impl Iterator for Events {
    type Item = Result<Event, FileError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.read().transpose()
    }
}
