//! A session as it grows.

use super::append::{Appender, MOST_LINES};
use super::event::{Event, Mark, Target, What};
use super::frames::{FRAME_NUMBER, PART, place};
use super::manifest::{DeviceKind, FORMAT, FileSum, Manifest};
use super::reader::Session;
use super::storage::{Growing, Storage};
use super::{COUNTS, EVENTS, FRAMES, MANIFEST, SEAL, TAGS, counts, seal};
use crate::counts::CountRecord;
use crate::error::{EncodeError, FileError, ParseError};
use crate::fits;
use crate::frame::Frame;
use crate::table::Meta;
use hifitime::Epoch;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// How old unsynced data are, on the caller's clock, when [`SessionWriter::tick`] writes them through: a quarter of a second, so that
/// with calls ten times a second and a disk that takes half a second at most all but the last second is safe.
pub const SYNC_EVERY: Duration = Duration::from_millis(250);

/// Bytes of frames that wait for a sync at most: beyond, it comes early.
const MOST_WAITING: u64 = 64 << 20;
/// The same of a counter's rows.
const MOST_ROWS: usize = 256 << 10;
/// The same of its tags.
const MOST_TAGS: usize = 8 << 20;
/// Bytes of tags that wait while the disk takes none.
const MOST_TAGS_WAITING: usize = 32 << 20;
/// Bytes of a tag.
const TAG: usize = 16;

/// A failure to write a file.
#[derive(Debug)]
pub struct Trouble {
    /// The file, within the session's folder.
    pub file: String,
    /// Error that the system reported.
    pub error: io::Error,
    /// Whether the same file failed just before, too.
    pub again: bool,
}

/// Writes a session's folder.
///
/// The system's refusals (a full disk, a bad one) end nothing: what was written before stays whole, later rows wait for
/// room, frames that find none are lost and counted, and each call gives what went wrong ([`Trouble`]); the event log has it
/// too, as far as there is room.
#[derive(Debug)]
pub struct SessionWriter {
    storage: Arc<dyn Storage>,
    root: PathBuf,
    events: Appender,
    counters: BTreeMap<String, Counter>,
    cameras: BTreeMap<String, Camera>,
    waiting: Vec<Waiting>,
    waiting_bytes: u64,
    synced_at: Option<Duration>,
    /// Files that cannot be written just now, with the frames lost since.
    failing: BTreeMap<String, u64>,
    lost_frames: u64,
    marked_events: u64,
    /// Failures of a sync that came early, which the next tick reports.
    early: Vec<Trouble>,
    /// Keeps every other process from going on with this session.
    _lock: Option<File>,
}

/// State of a session that goes on.
#[derive(Debug, Clone, PartialEq)]
pub struct Resumed {
    /// When its last mark was set, or when it began.
    pub safe_until: Epoch,
    /// The target that was told last.
    pub target: Option<(Epoch, Target)>,
    /// The step that was told last, and when.
    pub step: Option<(Epoch, u32)>,
    /// The last frame's number, by camera.
    pub numbers: BTreeMap<String, u64>,
    /// Counters with rows.
    pub counted: BTreeSet<String>,
}

#[derive(Debug)]
struct Counter {
    channels: Vec<String>,
    table: Appender,
    tags: Option<Appender>,
}

impl Counter {
    fn files(&self) -> impl Iterator<Item = &Appender> {
        [&self.table].into_iter().chain(&self.tags)
    }

    fn files_mut(&mut self) -> impl Iterator<Item = &mut Appender> {
        [&mut self.table].into_iter().chain(&mut self.tags)
    }
}

#[derive(Debug, Default)]
struct Camera {
    hours: BTreeSet<String>,
    /// Number of the last frame that was taken.
    taken: u64,
}

/// A frame that is whole but not synced, and has not got its name.
#[derive(Debug)]
struct Waiting {
    camera: String,
    file: Box<dyn Growing>,
    part: PathBuf,
    path: PathBuf,
    mark: Mark,
}

impl SessionWriter {
    /// Makes the folder `root`, which must not be there, with the manifest and the files of the configuration (their paths
    /// within the folder, and bytes).
    ///
    /// # Errors
    /// [`FileError::Exists`]; the system's.
    pub fn create(
        storage: Arc<dyn Storage>,
        root: impl AsRef<Path>,
        manifest: &Manifest,
        files: &[(String, Vec<u8>)],
    ) -> Result<Self, FileError> {
        Self::create_at(storage, root.as_ref(), manifest, files)
    }

    fn create_at(
        storage: Arc<dyn Storage>,
        root: &Path,
        manifest: &Manifest,
        files: &[(String, Vec<u8>)],
    ) -> Result<Self, FileError> {
        if root.symlink_metadata().is_ok() {
            return Err(FileError::Exists { path: root.to_path_buf() });
        }
        let text = manifest.to_text().map_err(|error| FileError::encode(root, error))?;
        let io = |path: &Path| {
            let path = path.to_path_buf();
            move |error| FileError::io("write", path, error)
        };
        storage.create_folder(root).map_err(io(root))?;
        for (name, bytes) in files.iter().map(|(n, b)| (n.as_str(), b.as_slice())) {
            whole(storage.as_ref(), root, name, bytes).map_err(io(&root.join(name)))?;
        }
        let tags = manifest.devices.iter().any(|device| device.raw_tags);
        for folder in [COUNTS, FRAMES].into_iter().chain(tags.then_some(TAGS)) {
            storage.create_folder(&root.join(folder)).map_err(io(&root.join(folder)))?;
        }
        let events = Appender::create(storage.as_ref(), root, EVENTS, &[], MOST_LINES)
            .map_err(io(&root.join(EVENTS)))?;
        let lock = storage.clone();
        let mut writer = Self {
            storage,
            root: root.to_path_buf(),
            events,
            counters: BTreeMap::new(),
            cameras: BTreeMap::new(),
            waiting: Vec::new(),
            waiting_bytes: 0,
            synced_at: None,
            failing: BTreeMap::new(),
            lost_frames: 0,
            marked_events: 0,
            early: Vec::new(),
            _lock: storage_lock(&lock, root)?,
        };
        for device in &manifest.devices {
            match device.kind {
                DeviceKind::Counter => {
                    let tags = device.raw_tags.then(|| writer.add_tags(&device.name));
                    writer.add_counter(&device.name, &device.channels, tags.transpose()?)?;
                }
                DeviceKind::Camera => writer.add_camera(&device.name).map_err(io(root))?,
                DeviceKind::Wheel | DeviceKind::Rotator | DeviceKind::Mount => {}
            }
        }
        // Last: a folder with a manifest has all that it names.
        let disk = writer.storage.clone();
        whole(disk.as_ref(), root, MANIFEST, text.as_bytes()).map_err(io(root))?;
        if let Some(above) = root.parent().filter(|above| !above.as_os_str().is_empty()) {
            disk.sync_folder(above).map_err(io(above))?;
        }
        let sum = FileSum::of(MANIFEST, text.as_bytes()).sha256;
        let what = What::Start { program: manifest.program.clone(), manifest_sha256: Some(sum) };
        writer.event(manifest.start_utc, what);
        writer.event(manifest.start_utc, What::Clock(manifest.clock.clone()));
        match writer.sync(manifest.start_utc).into_iter().next() {
            None => Ok(writer),
            Some(trouble) => Err(FileError::io("write", root.join(trouble.file), trouble.error)),
        }
    }

    /// Goes on with a session that ended or was cut off: half lines at the ends of its files are cut off, and what comes is written behind the rest.
    ///
    /// # Errors
    /// A folder that is no session of this format, or that another process writes; rows that are none; the system's.
    pub fn resume(
        storage: Arc<dyn Storage>,
        root: impl AsRef<Path>,
        program: &str,
        utc: Epoch,
    ) -> Result<(Self, Resumed), FileError> {
        Self::resume_at(storage, root.as_ref(), program, utc)
    }

    fn resume_at(
        storage: Arc<dyn Storage>,
        root: &Path,
        program: &str,
        utc: Epoch,
    ) -> Result<(Self, Resumed), FileError> {
        let session = Session::open(root)?;
        let root = session.root().to_path_buf();
        let io = |path: &Path| {
            let path = path.to_path_buf();
            move |error| FileError::io("go on with", path, error)
        };
        let manifest = session.manifest().clone();
        if !manifest.is_sealed() {
            let found = manifest.format.clone();
            let error = ParseError::new(root.join(MANIFEST), found, format!("`{FORMAT}`"));
            return Err(error.in_field("format").into());
        }
        let _lock = storage_lock(&storage, &root)?;
        let mut resumed = Resumed {
            safe_until: manifest.start_utc,
            target: None,
            step: None,
            numbers: BTreeMap::new(),
            counted: BTreeSet::new(),
        };
        let mut lines = 0;
        let mut events = session.events()?;
        for event in events.by_ref() {
            let Event { utc, what } = event?;
            lines += 1;
            match what {
                What::Sync { .. } => resumed.safe_until = utc,
                What::Target(target) => resumed.target = Some((utc, target)),
                What::Step { number } => resumed.step = Some((utc, number)),
                _ => {}
            }
        }
        let mut cut_bytes = events.torn_bytes();
        let length = |name: &str, torn: u64| -> Result<u64, FileError> {
            let path = root.join(name);
            let length = path.metadata().map_err(io(&path))?.len();
            Ok(length.saturating_sub(torn))
        };
        let again = |name: &str, keep, rows, most| {
            Appender::reopen(storage.as_ref(), &root, name, (keep, rows), most)
                .map_err(io(&root.join(name)))
        };
        let events = again(EVENTS, length(EVENTS, cut_bytes)?, lines, MOST_LINES)?;
        let mut counters = BTreeMap::new();
        for name in session.counters() {
            let mut table = session.counts(name)?;
            let mut rows = 0;
            for row in table.by_ref() {
                row?;
                rows += 1;
            }
            let torn = table.torn_bytes();
            cut_bytes += torn;
            let file = format!("{COUNTS}/{name}.ecsv");
            let channels = table.channels().to_vec();
            drop(table);
            let table = again(&file, length(&file, torn)?, rows, MOST_LINES)?;
            if rows > 0 {
                resumed.counted.insert(name.to_owned());
            }
            let raw = manifest.devices.iter().any(|device| device.name == name && device.raw_tags);
            let tags = match raw {
                false => None,
                true => {
                    let file = format!("{TAGS}/{name}.tags");
                    let torn = length(&file, 0)? % TAG as u64;
                    cut_bytes += torn;
                    let keep = length(&file, torn)?;
                    Some(again(&file, keep, keep / TAG as u64, MOST_TAGS_WAITING)?)
                }
            };
            counters.insert(name.to_owned(), Counter { channels, table, tags });
        }
        let mut cameras = BTreeMap::new();
        for name in session.cameras() {
            let frames = session.frames(name)?.files;
            let last = frames.iter().map(|frame| frame.sequence).max().unwrap_or(0);
            resumed.numbers.insert(name.to_owned(), last);
            cameras.insert(name.to_owned(), Camera::default());
        }
        // The mark of an end that is none any more.
        match storage.remove(&root.join(SEAL)) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                return Err(io(&root.join(SEAL))(error));
            }
            _ => {}
        }
        let mut writer = Self {
            storage,
            marked_events: events.mark().bytes,
            root,
            events,
            counters,
            cameras,
            waiting: Vec::new(),
            waiting_bytes: 0,
            synced_at: None,
            failing: BTreeMap::new(),
            lost_frames: 0,
            early: Vec::new(),
            _lock,
        };
        let gap_s = (utc - resumed.safe_until).to_seconds();
        writer.event(utc, What::Resume { program: program.to_owned(), gap_s, cut_bytes });
        match writer.sync(utc).into_iter().next() {
            None => Ok((writer, resumed)),
            Some(trouble) => {
                Err(FileError::io("write", writer.root.join(trouble.file), trouble.error))
            }
        }
    }

    fn add_tags(&self, name: &str) -> Result<Appender, FileError> {
        let file = format!("{TAGS}/{name}.tags");
        let storage = self.storage.as_ref();
        let made = Appender::create(storage, &self.root, &file, &[], MOST_TAGS_WAITING);
        let made = made.and_then(|tags| storage.sync_folder(&self.root.join(TAGS)).map(|()| tags));
        made.map_err(|error| FileError::io("write", self.root.join(&file), error))
    }

    fn add_counter(
        &mut self,
        name: &str,
        channels: &[String],
        tags: Option<Appender>,
    ) -> Result<(), FileError> {
        let file = format!("{COUNTS}/{name}.ecsv");
        let path = self.root.join(&file);
        let mut meta = Meta::default();
        meta.insert("device".into(), name.into());
        let header =
            counts::header(channels, &meta).map_err(|error| FileError::encode(&path, error))?;
        let storage = self.storage.as_ref();
        let made = Appender::create(storage, &self.root, &file, header.as_bytes(), MOST_LINES);
        let table = made.map_err(|error| FileError::io("write", &path, error))?;
        let synced = self.storage.sync_folder(&self.root.join(COUNTS));
        synced.map_err(|error| FileError::io("write", &path, error))?;
        let counter = Counter { channels: channels.to_vec(), table, tags };
        self.counters.insert(name.to_owned(), counter);
        Ok(())
    }

    fn add_camera(&mut self, name: &str) -> io::Result<()> {
        let frames = self.root.join(FRAMES);
        self.storage.create_folder(&frames.join(name))?;
        self.storage.sync_folder(&frames)?;
        self.cameras.insert(name.to_owned(), Camera::default());
        Ok(())
    }

    /// The session's folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Rows, tags and frames that are lost.
    pub fn lost(&self) -> u64 {
        let rows = self.counters.values().flat_map(Counter::files).map(Appender::lost);
        self.lost_frames + rows.sum::<u64>()
    }

    /// Whether the disk refuses some file just now.
    pub fn is_failing(&self) -> bool {
        !self.failing.is_empty()
    }

    /// Rows, tags and frames that are lost, or rows and tags that are not safe yet.
    pub fn missing(&self) -> u64 {
        let rows = self.counters.values().flat_map(Counter::files).map(Appender::missing);
        self.lost_frames + rows.sum::<u64>()
    }

    /// Writes a bin of a counter.
    ///
    /// # Errors
    /// A counter that the manifest has not, or with another number of channels; a count beyond 63 bits.
    pub fn count(&mut self, counter: &str, record: &CountRecord) -> Result<(), EncodeError> {
        let Some(known) = self.counters.get_mut(counter) else {
            return Err(EncodeError::new("counter", counter, "a counter of the manifest"));
        };
        let row = counts::row(record, &known.channels)?;
        known.table.push(row.as_bytes());
        // Faster than any tick: rows are kept in memory until they are safe. Where the disk refuses, they wait.
        if known.table.waiting_bytes() > MOST_ROWS && !self.failing.contains_key(&known.table.name)
        {
            let troubles = self.sync(record.start);
            self.early.extend(troubles);
        }
        Ok(())
    }

    /// Writes raw tags of a counter: whole records of 16 bytes. Whether there was room for them; if not they are lost, all of them, and
    /// counted.
    ///
    /// # Errors
    /// A counter that the manifest has not, or whose tags are not recorded; bytes that are no whole records.
    pub fn tags(&mut self, utc: Epoch, counter: &str, records: &[u8]) -> Result<bool, EncodeError> {
        let tags = self.tags_of(counter)?;
        if !records.len().is_multiple_of(TAG) {
            let found = format!("{} bytes of tags", records.len());
            return Err(EncodeError::new(counter, found, "whole records of 16 bytes"));
        }
        let room = tags.push_rows(records, (records.len() / TAG) as u64);
        let (waiting, name) = (tags.waiting_bytes(), tags.name.clone());
        if waiting > MOST_TAGS && !self.failing.contains_key(&name) {
            let troubles = self.sync(utc);
            self.early.extend(troubles);
        }
        Ok(room)
    }

    /// Counts tags that were lost before they came here, and notes it.
    ///
    /// # Errors
    /// The errors of [`tags`](Self::tags).
    pub fn lose_tags(&mut self, utc: Epoch, counter: &str, lost: u64) -> Result<(), EncodeError> {
        let tags = self.tags_of(counter)?;
        tags.lose(lost);
        let about = tags.name.clone();
        let error = format!("{lost} tags lost: the disk is too slow for them");
        self.event(utc, What::Error { about, error });
        Ok(())
    }

    /// Counts tags that are left out, without a word in the log.
    ///
    /// # Errors
    /// The errors of [`tags`](Self::tags).
    pub fn lose_counted_tags(&mut self, counter: &str, lost: u64) -> Result<(), EncodeError> {
        self.tags_of(counter)?.lose(lost);
        Ok(())
    }

    /// Counts a frame of a camera that is left out, without a word in the log.
    pub fn lose_frame(&mut self, camera: &str, sequence: u64) {
        self.lost_frames += 1;
        self.took(camera, sequence);
    }

    /// A camera took the frame of this number.
    fn took(&mut self, camera: &str, sequence: u64) {
        if let Some(camera) = self.cameras.get_mut(camera) {
            camera.taken = camera.taken.max(sequence);
        }
    }

    fn tags_of(&mut self, counter: &str) -> Result<&mut Appender, EncodeError> {
        let tags = self.counters.get_mut(counter).and_then(|counter| counter.tags.as_mut());
        let expected = "a counter of the manifest with `raw_tags`";
        tags.ok_or_else(|| EncodeError::new("counter", counter, expected))
    }

    /// Writes a frame; it has its name from the next sync on. The sequence number goes into its header ([`FRAME_NUMBER`]).
    ///
    /// # Errors
    /// A camera that the manifest has not; a header that FITS cannot hold.
    pub fn frame(
        &mut self,
        camera: &str,
        sequence: u64,
        frame: &Frame,
    ) -> Result<Option<Trouble>, EncodeError> {
        if !self.cameras.contains_key(camera) {
            return Err(EncodeError::new("camera", camera, "a camera of the manifest"));
        }
        self.took(camera, sequence);
        let mut image = frame.to_image()?;
        let number = i64::try_from(sequence).unwrap_or(i64::MAX);
        image.header.set(FRAME_NUMBER, number, "counts this camera's frames");
        let mut fits = fits::Writer::new();
        fits.image(&image)?;
        let (hour, name) = place(frame.start, sequence);
        let file = format!("{FRAMES}/{camera}/{hour}/{name}");
        let bytes = fits.into_bytes();
        let written = self.write_frame(camera, &hour, &file, sequence, &bytes);
        let about = format!("{FRAMES}/{camera}");
        Ok(match written {
            Ok(()) => None,
            Err(error) => {
                self.lost_frames += 1;
                Some(self.failed(frame.start, about, error, 1))
            }
        })
    }

    fn write_frame(
        &mut self,
        camera: &str,
        hour: &str,
        file: &str,
        sequence: u64,
        bytes: &[u8],
    ) -> io::Result<()> {
        let folder = self.root.join(FRAMES).join(camera);
        if let Some(known) = self.cameras.get_mut(camera)
            && !known.hours.contains(hour)
        {
            self.storage.create_folder(&folder.join(hour))?;
            self.storage.sync_folder(&folder)?;
            known.hours.insert(hour.to_owned());
        }
        let path = self.root.join(file);
        let part = self.root.join(format!("{file}{PART}"));
        let mut growing = self.storage.create(&part)?;
        if let Err(error) = growing.append(bytes) {
            let _ = self.storage.remove(&part);
            return Err(error);
        }
        let mut hasher = flate2::Crc::new();
        hasher.update(bytes);
        let length = bytes.len() as u64;
        let mark =
            Mark { file: file.to_owned(), bytes: length, rows: sequence, crc32: hasher.sum() };
        self.waiting_bytes += length;
        self.waiting.push(Waiting { camera: camera.into(), file: growing, part, path, mark });
        Ok(())
    }

    /// Notes an event; [`tick`](Self::tick) writes it.
    pub fn event(&mut self, utc: Epoch, what: What) {
        self.events.push(Event { utc, what }.to_line().as_bytes());
    }

    /// To be called ten times a second: hands to the system what has come, and writes it through to the disk where that was
    /// last done [`SYNC_EVERY`] ago. `now` is any clock of the caller that does not run backwards.
    pub fn tick(&mut self, now: Duration, utc: Epoch) -> Vec<Trouble> {
        let synced_at = *self.synced_at.get_or_insert(now);
        let mut given = std::mem::take(&mut self.early);
        if now.saturating_sub(synced_at) >= SYNC_EVERY || self.waiting_bytes > MOST_WAITING {
            self.synced_at = Some(now);
            given.extend(self.sync(utc));
            return given;
        }
        let mut troubles = Vec::new();
        let tables = self.counters.values_mut().flat_map(Counter::files_mut);
        for file in tables.chain([&mut self.events]) {
            if let Err(error) = file.flush() {
                troubles.push((file.name.clone(), error));
            }
        }
        given.extend(troubles.into_iter().map(|(file, error)| self.failed(utc, file, error, 0)));
        given
    }

    /// Writes all through to the disk, and notes how far each file is safe.
    pub fn sync(&mut self, utc: Epoch) -> Vec<Trouble> {
        let (mut marks, mut troubles) = (Vec::new(), Vec::new());
        for file in self.counters.values_mut().flat_map(Counter::files_mut) {
            match file.sync() {
                Ok(mark) => marks.extend(mark),
                Err(error) => troubles.push((file.name.clone(), error, 0)),
            }
        }
        self.sync_frames(&mut marks, &mut troubles);
        let recovered: Vec<String> = self
            .failing
            .keys()
            .filter(|file| marks.iter().any(|mark| mark.file.starts_with(file.as_str())))
            .cloned()
            .collect();
        for about in recovered {
            let lost = self.failing.remove(&about).unwrap_or(0);
            self.event(utc, What::Recovered { about, lost });
        }
        let mut given: Vec<Trouble> =
            troubles.into_iter().map(|(f, error, lost)| self.failed(utc, f, error, lost)).collect();
        // The log's own mark is the one of the line before: it says how far the log was safe then.
        let events = self.events.mark();
        if events.bytes > self.marked_events && !marks.is_empty() {
            self.marked_events = events.bytes;
            marks.push(events.clone());
        }
        if !marks.is_empty() {
            self.event(utc, What::Sync { files: marks });
        }
        match self.events.sync() {
            Ok(_) => {
                self.failing.remove(EVENTS);
            }
            Err(error) => given.push(self.failed(utc, EVENTS.into(), error, 0)),
        }
        given
    }

    /// Syncs the frames that wait, gives them their names, and syncs those.
    fn sync_frames(&mut self, marks: &mut Vec<Mark>, troubles: &mut Vec<(String, io::Error, u64)>) {
        let mut folders = BTreeMap::<PathBuf, Vec<Mark>>::new();
        self.waiting_bytes = 0;
        for mut frame in std::mem::take(&mut self.waiting) {
            let named =
                frame.file.sync().and_then(|()| self.storage.rename(&frame.part, &frame.path));
            match named {
                Ok(()) => {
                    let folder = frame.path.parent().unwrap_or(&self.root).to_path_buf();
                    folders.entry(folder).or_default().push(frame.mark);
                }
                Err(error) => {
                    let _ = self.storage.remove(&frame.part);
                    self.lost_frames += 1;
                    troubles.push((format!("{FRAMES}/{}", frame.camera), error, 1));
                }
            }
        }
        for (folder, frames) in folders {
            match self.storage.sync_folder(&folder) {
                Ok(()) => marks.extend(frames),
                // They are there, as far as anybody can see; nothing promises that they stay.
                Err(error) => {
                    let name = folder.strip_prefix(&self.root).unwrap_or(&folder);
                    troubles.push((name.to_string_lossy().into_owned(), error, 0));
                }
            }
        }
    }

    /// Ends the session: notes why, and writes all through. What is lost is then in [`Ended::lost`].
    pub fn finish(mut self, utc: Epoch, reason: &str) -> Ended {
        let mut troubles = std::mem::take(&mut self.early);
        troubles.extend(self.sync(utc));
        let lost = self.missing();
        let taken = self.cameras.iter().filter(|(_, camera)| camera.taken > 0);
        let frames = taken.map(|(name, camera)| (name.clone(), camera.taken)).collect();
        self.event(utc, What::End { reason: reason.into(), lost, frames });
        troubles.extend(self.sync(utc));
        // The last mark does not cover its own line.
        let sealed =
            whole(self.storage.as_ref(), &self.root, SEAL, seal(self.events.mark()).as_bytes());
        troubles.extend(sealed.err().map(|error| Trouble {
            file: SEAL.into(),
            error,
            again: false,
        }));
        Ended { lost: self.missing() + self.events.missing(), troubles }
    }

    /// Remembers that a file cannot be written; the log hears of it once.
    fn failed(&mut self, utc: Epoch, about: String, error: io::Error, lost: u64) -> Trouble {
        let again = self.failing.contains_key(&about);
        *self.failing.entry(about.clone()).or_insert(0) += lost;
        if !again && about != EVENTS {
            let text = error.to_string();
            self.event(utc, What::Error { about: about.clone(), error: text });
        }
        Trouble { file: about, error, again }
    }
}

/// Keeps a session for this process alone.
fn storage_lock(storage: &Arc<dyn Storage>, root: &Path) -> Result<Option<File>, FileError> {
    storage.lock(&root.join(EVENTS)).map_err(|error| match error.kind() {
        io::ErrorKind::WouldBlock => {
            let found = "another process writes it".to_owned();
            let error = ParseError::new(root, found, "a session that nobody records just now");
            error.with_hint("end that one first").into()
        }
        _ => FileError::io("lock", root.join(EVENTS), error),
    })
}

/// How a session ended.
#[derive(Debug)]
pub struct Ended {
    /// Rows, tags, frames and events that are not on the disk.
    pub lost: u64,
    /// Failures to write at the end.
    pub troubles: Vec<Trouble>,
}

/// Writes a file whole and through to the disk, in folders that are made as needed. It has its name only once all of it is safe: whoever finds it,
/// after a kill or a full disk too, finds it whole.
fn whole(storage: &dyn Storage, root: &Path, name: &str, bytes: &[u8]) -> io::Result<()> {
    let mut folder = root.to_path_buf();
    let (folders, _) = name.rsplit_once('/').unwrap_or(("", name));
    for step in folders.split('/').filter(|step| !step.is_empty()) {
        let above = folder.clone();
        folder.push(step);
        storage.create_folder(&folder)?;
        storage.sync_folder(&above)?;
    }
    let (part, path) = (root.join(format!("{name}{PART}")), root.join(name));
    let mut file = storage.create(&part)?;
    let written = file.append(bytes).and_then(|()| file.sync());
    if let Err(error) = written.and_then(|()| storage.rename(&part, &path)) {
        let _ = storage.remove(&part);
        return Err(error);
    }
    storage.sync_folder(&folder)
}
