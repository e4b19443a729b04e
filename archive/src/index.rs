//! The index of a folder: which files it holds, and whose light is in them.
//!
//! Two Parquet tables lie in the folder `sunglint-archive` of the archive (or where the caller wants them): `files` with a row for each file that was looked into,
//! `passes` with a row for each channel of each pass. Each is written whole, and `manifest.json` with their SHA-256 last: an index that is damaged, or that has a
//! table of one run and a table of another, is made anew.

use crate::ArchiveError;
use crate::file::{self, Contents, ENDINGS, Kind, Light, SESSION};
use hifitime::{Duration, Epoch};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;
use sunglint_formats::atomic::{Overwrite, write_file};
use sunglint_formats::{EncodeError, FileError, read, sha256};
use sunglint_numerics::progress::{Cancelled, Progress};
use sunglint_study::caught;
use sunglint_study::table::{self, Cell, Columns, Kind as Column, Rows};

/// Folder of the index within its archive.
pub const FOLDER: &str = "sunglint-archive";

/// Version of the tables and of how files are understood: an index of another one is made anew.
const VERSION: u32 = 2;

const FILES: &str = "files.parquet";
const PASSES: &str = "passes.parquet";
const MANIFEST: &str = "manifest.json";

/// Files that are looked into at once, between two looks for Ctrl-C.
const TOGETHER: usize = 64;

/// Size and time of a file: as long as they stay, it is not read again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Stamp {
    bytes: i64,
    modified_ns: i64,
}

impl Stamp {
    /// A stamp that no file has: it is read again by the next run.
    const NEVER: Self = Self { bytes: -1, modified_ns: 0 };
}

/// Contents of a file, with the stamp that it had.
#[derive(Debug, Clone, PartialEq)]
struct Entry {
    stamp: Stamp,
    contents: Contents,
}

/// Origin of a pass's number in the catalogue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Known {
    /// The file says it: elements, or a name that is the number.
    File,
    /// A recorded session has a visit to a target of this name at that time, with elements.
    Session,
    /// It is not known.
    Unknown,
}

/// One channel of one pass, with its file.
#[derive(Debug, Clone, PartialEq)]
pub struct Row<'a> {
    /// The file, relative to the archive.
    pub path: &'a str,
    /// Light in it.
    pub light: &'a Light,
    /// Number in the catalogue.
    pub norad_id: Option<u32>,
    /// Where that is from.
    pub known: Known,
}

/// A file that is damaged.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Damaged {
    /// The file, relative to the archive.
    pub file: String,
    /// Fault.
    pub why: String,
}

/// Work that bringing an index up to date was.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Updated {
    /// Files in the index.
    pub files: usize,
    /// Files among them that were read now, as they were new or changed.
    pub read: usize,
    /// Files that are gone.
    pub gone: usize,
}

/// An index of an archive.
#[derive(Debug)]
pub struct Index {
    root: PathBuf,
    place: PathBuf,
    entries: BTreeMap<String, Entry>,
    /// Whether there are tables to go on from.
    is_there: bool,
    /// Changes since it was read.
    pub updated: Updated,
    /// Words for a person: an index that was made anew, names that are left out.
    pub warnings: Vec<String>,
}

#[derive(Serialize, Deserialize)]
struct Manifest {
    program: String,
    version: u32,
    files: BTreeMap<String, String>,
}

fn columns(of: &[(&str, Column)]) -> Columns {
    of.iter().map(|(name, kind)| ((*name).to_owned(), *kind)).collect()
}

fn file_columns() -> Columns {
    use Column::{Integer, Text};
    columns(&[
        ("file", Text),
        ("bytes", Integer),
        ("modified_ns", Integer),
        ("status", Text),
        ("message", Text),
    ])
}

fn pass_columns() -> Columns {
    use Column::{Integer, Number, Text, Time};
    columns(&[
        ("file", Text),
        ("pass", Integer),
        ("kind", Text),
        ("target", Text),
        ("norad_id", Integer),
        ("norad_id_of_file", Integer),
        ("station", Text),
        ("channel", Text),
        ("from_utc", Time),
        ("to_utc", Time),
        ("from_tai_ns", Integer),
        ("to_tai_ns", Integer),
        ("samples", Integer),
        ("phase_min_deg", Number),
        ("phase_max_deg", Number),
        ("range_min_m", Number),
        ("range_max_m", Number),
        ("brightest", Number),
    ])
}

/// Nanoseconds of TAI after 1970-01-01 of TAI: every moment of this and the last century fits.
fn tai_ns(epoch: Epoch) -> Cell {
    let ns = sunglint_formats::time::tai_nanoseconds(epoch) - TO_1970_NS;
    i64::try_from(ns).map_or(Cell::None, Cell::Integer)
}

fn of_tai_ns(ns: i64) -> Epoch {
    Epoch::from_tai_duration(Duration::from_total_nanoseconds(i128::from(ns) + TO_1970_NS))
}

/// From 1900-01-01 to 1970-01-01: 25,567 days.
const TO_1970_NS: i128 = 25_567 * 86_400 * 1_000_000_000;

fn unix_ns(epoch: Epoch) -> Cell {
    i64::try_from(epoch.to_unix_duration().total_nanoseconds()).map_or(Cell::None, Cell::Integer)
}

fn number(n: impl TryInto<i64>) -> Cell {
    n.try_into().map_or(Cell::None, Cell::Integer)
}

impl Index {
    /// Reads the index of an archive; an empty one where there is none, or where that is damaged or of another version. `place` is the index's own folder,
    /// [`FOLDER`] within the archive unless given.
    ///
    /// # Errors
    /// [`ArchiveError::NoFolder`]: there is no such archive.
    pub fn open(root: &Path, place: Option<&Path>) -> Result<Self, ArchiveError> {
        if !root.is_dir() {
            return Err(ArchiveError::NoFolder { path: root.to_path_buf() });
        }
        let place = place.map_or_else(|| root.join(FOLDER), Path::to_path_buf);
        let mut index = Self {
            root: root.to_path_buf(),
            place,
            entries: BTreeMap::new(),
            is_there: false,
            updated: Updated::default(),
            warnings: Vec::new(),
        };
        match index.load() {
            Ok(entries) => {
                index.is_there = entries.is_some();
                index.entries = entries.unwrap_or_default();
            }
            Err(why) => {
                let place = index.place.display();
                index.warnings.push(format!("the index in {place} is made anew: {why}"));
            }
        }
        Ok(index)
    }

    /// The archive's folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    fn load(&self) -> Result<Option<BTreeMap<String, Entry>>, String> {
        let path = self.place.join(MANIFEST);
        if !path.exists() {
            return Ok(None);
        }
        let text = read::text(&path).map_err(|e| e.to_string())?;
        let manifest: Manifest =
            serde_json::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))?;
        if manifest.version != VERSION {
            return Err(format!(
                "it is of version {}, this program's is {VERSION}",
                manifest.version
            ));
        }
        // The reader of Parquet is not tried with damaged bytes, and reads those that were looked at: another run may replace the file.
        let bytes = |name: &str| {
            let path = self.place.join(name);
            let bytes = read::bytes(&path).map_err(|e| e.to_string())?;
            match manifest.files.get(name) == Some(&sha256(&bytes)) {
                true => Ok((path, bytes)),
                false => Err(format!("{} is not the file that the manifest names", path.display())),
            }
        };
        let (files, passes) = (bytes(FILES)?, bytes(PASSES)?);
        let read = |(path, bytes): (PathBuf, Vec<u8>), columns: &Columns| {
            table::decode(&path, bytes, columns).map_err(|e| e.to_string())
        };
        let wrong = || "a row makes no sense".to_owned();
        let mut entries = BTreeMap::new();
        for row in read(files, &file_columns())? {
            let (name, entry) = entry_of(&row).ok_or_else(wrong)?;
            entries.insert(name, entry);
        }
        for row in read(passes, &pass_columns())? {
            let (name, light) = light_of(&row).ok_or_else(wrong)?;
            match entries.get_mut(&name).map(|e: &mut Entry| &mut e.contents) {
                Some(Contents::Light(all)) => all.push(light),
                _ => return Err(wrong()),
            }
        }
        Ok(Some(entries))
    }

    /// Brings the index up to date: reads the files that are new or changed since, forgets those that are gone, and writes it if anything changed. A file that
    /// the system refuses to read is tried again each time. Where the index cannot be written, a warning says so, and the answers are right all the same. Work
    /// that is stopped keeps what it has read.
    ///
    /// # Errors
    /// The archive cannot be read; [`ArchiveError::Cancelled`].
    pub fn update(
        &mut self,
        fresh: bool,
        progress: &dyn Progress,
    ) -> Result<Updated, ArchiveError> {
        let (found, left_out) = walk(&self.root, &self.place)?;
        self.warnings.extend(left_out);
        let is_known = |name: &String, stamp: &Stamp| {
            !fresh && self.entries.get(name).is_some_and(|e| e.stamp == *stamp)
        };
        let new: Vec<(&String, &Stamp)> = found.iter().filter(|(n, s)| !is_known(n, s)).collect();
        progress.begin("files", Some(new.len() as u64));
        let mut looked: Vec<(String, Entry)> = Vec::with_capacity(new.len());
        let mut is_stopped = false;
        for part in new.chunks(TOGETHER) {
            is_stopped = progress.is_cancelled();
            if is_stopped {
                break;
            }
            let root = &self.root;
            let one = |(name, stamp): &(&String, &Stamp)| {
                let entry = match caught(|| file::look(&root.join(name))) {
                    Ok(Ok(contents)) => Entry { stamp: **stamp, contents },
                    Ok(Err(error)) => Entry {
                        stamp: Stamp::NEVER,
                        contents: Contents::Damaged(error.to_string()),
                    },
                    Err(why) => Entry { stamp: **stamp, contents: Contents::Damaged(why) },
                };
                ((*name).clone(), entry)
            };
            looked.par_extend(part.par_iter().map(one));
            progress.advance(part.len() as u64);
        }
        let gone: Vec<String> =
            self.entries.keys().filter(|n| !found.contains_key(*n)).cloned().collect();
        self.updated = Updated { files: found.len(), read: looked.len(), gone: gone.len() };
        let is_same = |(name, entry): &(String, Entry)| self.entries.get(name) == Some(entry);
        let is_changed = !gone.is_empty() || !looked.iter().all(is_same);
        for name in &gone {
            self.entries.remove(name);
        }
        self.entries.extend(looked);
        if is_changed || !self.is_there {
            match self.write() {
                Ok(()) => self.is_there = true,
                Err(error) => {
                    let warning = format!(
                        "{error}: the next run reads these files again; another place for the index may help"
                    );
                    if is_stopped {
                        progress.warn(&warning);
                    }
                    self.warnings.push(warning);
                }
            }
        }
        match is_stopped {
            true => Err(Cancelled.into()),
            false => Ok(self.updated),
        }
    }

    /// All passes, by file.
    pub fn rows(&self) -> Vec<Row<'_>> {
        // Visits with a number, by the target's name.
        let mut visits: HashMap<&str, Vec<(&Light, u32)>> = HashMap::new();
        let light = || {
            self.entries.iter().filter_map(|(path, entry)| match &entry.contents {
                Contents::Light(light) => Some((path.as_str(), light)),
                _ => None,
            })
        };
        for (_, rows) in light() {
            for row in rows.iter().filter(|row| row.kind == Kind::Recorded) {
                if let Some(number) = row.norad_id {
                    visits.entry(row.target.as_str()).or_default().push((row, number));
                }
            }
        }
        let of_visit = |of: &Light| {
            let mut all = visits.get(of.target.as_str()).into_iter().flatten();
            all.find(|(visit, _)| visit.from <= of.to && visit.to >= of.from).map(|(_, n)| *n)
        };
        let mut found = Vec::new();
        for (path, rows) in light() {
            for light in rows {
                let (norad_id, known) = match light.norad_id {
                    Some(number) => (Some(number), Known::File),
                    None => match of_visit(light) {
                        Some(number) => (Some(number), Known::Session),
                        None => (None, Known::Unknown),
                    },
                };
                found.push(Row { path, light, norad_id, known });
            }
        }
        found
    }

    /// Files that are damaged, and why.
    pub fn damaged(&self) -> Vec<Damaged> {
        let all = self.entries.iter().filter_map(|(file, entry)| match &entry.contents {
            Contents::Damaged(why) => Some(Damaged { file: file.clone(), why: why.clone() }),
            _ => None,
        });
        all.collect()
    }

    /// Files that hold light.
    pub fn with_light(&self) -> usize {
        let holds = |e: &&Entry| matches!(&e.contents, Contents::Light(rows) if !rows.is_empty());
        self.entries.values().filter(holds).count()
    }

    fn write(&self) -> Result<(), ArchiveError> {
        let text = |t: &str| Cell::Text(t.to_owned());
        let files: Rows = self
            .entries
            .iter()
            .map(|(name, entry)| {
                let (status, message) = match &entry.contents {
                    Contents::Light(_) => ("light", Cell::None),
                    Contents::Other => ("other", Cell::None),
                    Contents::Damaged(why) => ("damaged", text(why)),
                };
                let Stamp { bytes, modified_ns } = entry.stamp;
                vec![
                    text(name),
                    Cell::Integer(bytes),
                    Cell::Integer(modified_ns),
                    text(status),
                    message,
                ]
            })
            .collect();
        let passes: Rows = self.rows().iter().map(cells).collect();
        std::fs::create_dir_all(&self.place)
            .map_err(|e| FileError::io("create", &self.place, e))?;
        let mut manifest = Manifest {
            program: concat!("sunglint ", env!("CARGO_PKG_VERSION")).into(),
            version: VERSION,
            files: BTreeMap::new(),
        };
        let notes = [("sunglint.archive", "1")];
        let mut tables = Vec::new();
        for (name, columns, rows) in
            [(FILES, file_columns(), files), (PASSES, pass_columns(), passes)]
        {
            let path = self.place.join(name);
            let bytes = table::encode(&path, &columns, &rows, &notes)?;
            // Of what is written, not of what is there afterwards: that may be another run's.
            manifest.files.insert(name.into(), sha256(&bytes));
            tables.push((path, bytes));
        }
        let path = self.place.join(MANIFEST);
        let json = serde_json::to_vec_pretty(&manifest).map_err(|e| {
            FileError::encode(&path, EncodeError::new("manifest", e.to_string(), "JSON"))
        })?;
        for (path, bytes) in &tables {
            write_file(path, bytes, Overwrite::Allow)?;
        }
        // Last: tables that it does not name are not read.
        write_file(&path, &json, Overwrite::Allow)?;
        Ok(())
    }
}

fn cells(row: &Row<'_>) -> Vec<Cell> {
    let light = row.light;
    let text = |t: &str| Cell::Text(t.to_owned());
    let maybe = |n: Option<u32>| n.map_or(Cell::None, |n| Cell::Integer(n.into()));
    let real = |v: Option<f64>| v.map_or(Cell::None, Cell::Number);
    vec![
        text(row.path),
        number(light.pass),
        text(light.kind.name()),
        text(&light.target),
        maybe(row.norad_id),
        maybe(light.norad_id),
        text(&light.station),
        text(&light.channel),
        unix_ns(light.from),
        unix_ns(light.to),
        tai_ns(light.from),
        tai_ns(light.to),
        number(light.samples),
        real(light.phase_deg.map(|p| p.0)),
        real(light.phase_deg.map(|p| p.1)),
        real(light.range_m.map(|r| r.0)),
        real(light.range_m.map(|r| r.1)),
        real(light.brightest),
    ]
}

fn entry_of(row: &[Cell]) -> Option<(String, Entry)> {
    let [
        Cell::Text(name),
        Cell::Integer(bytes),
        Cell::Integer(modified_ns),
        Cell::Text(status),
        message,
    ] = row
    else {
        return None;
    };
    let contents = match (status.as_str(), message) {
        ("light", _) => Contents::Light(Vec::new()),
        ("other", _) => Contents::Other,
        ("damaged", Cell::Text(why)) => Contents::Damaged(why.clone()),
        _ => return None,
    };
    let stamp = Stamp { bytes: *bytes, modified_ns: *modified_ns };
    Some((name.clone(), Entry { stamp, contents }))
}

fn light_of(row: &[Cell]) -> Option<(String, Light)> {
    let text = |i: usize| match row.get(i) {
        Some(Cell::Text(text)) => Some(text.clone()),
        _ => None,
    };
    let whole = |i: usize| match row.get(i) {
        Some(Cell::Integer(n)) => Some(*n),
        _ => None,
    };
    let real = |i: usize| match row.get(i) {
        Some(Cell::Number(v)) => Some(*v),
        _ => None,
    };
    let light = Light {
        pass: u32::try_from(whole(1)?).ok()?,
        kind: Kind::of(&text(2)?)?,
        target: text(3)?,
        norad_id: whole(5).and_then(|n| u32::try_from(n).ok()),
        station: text(6)?,
        channel: text(7)?,
        from: of_tai_ns(whole(10)?),
        to: of_tai_ns(whole(11)?),
        samples: u32::try_from(whole(12)?).ok()?,
        phase_deg: real(13).zip(real(14)),
        range_m: real(15).zip(real(16)),
        brightest: real(17),
    };
    Some((text(0)?, light))
}

/// The files of a folder and its folders, by their names, and what is left out. A session stands as its `session.toml`: nothing else in its folder is looked at.
/// Names that begin with a dot, links to folders and the index itself are passed over.
fn walk(root: &Path, index: &Path) -> Result<(BTreeMap<String, Stamp>, Vec<String>), ArchiveError> {
    let index = index.canonicalize().ok();
    let (mut found, mut left_out) = (BTreeMap::new(), Vec::new());
    let mut open = vec![PathBuf::new()];
    while let Some(folder) = open.pop() {
        let path = root.join(&folder);
        if index.is_some() && path.canonicalize().ok() == index {
            continue;
        }
        let manifest = path.join(SESSION);
        if manifest.is_file() {
            let log = [&manifest, &path.join("events.jsonl")].map(|p| stamp(p).ok().flatten());
            let both = match log {
                [Some(a), Some(b)] => Some(Stamp {
                    bytes: a.bytes.saturating_add(b.bytes),
                    modified_ns: a.modified_ns.max(b.modified_ns),
                }),
                [a, _] => a,
            };
            match (folder.join(SESSION).into_os_string().into_string(), both) {
                (Ok(name), Some(stamp)) => _ = found.insert(name, stamp),
                _ => left_out.push(format!("{} is left out: no UTF-8", manifest.display())),
            }
            continue;
        }
        let entries = match std::fs::read_dir(&path) {
            Ok(entries) => entries,
            Err(error) if folder.as_os_str().is_empty() => {
                return Err(FileError::io("read", &path, error).into());
            }
            Err(error) => {
                left_out.push(format!("{} is left out: {error}", path.display()));
                continue;
            }
        };
        let mut refused = |what: &Path, error: std::io::Error| {
            left_out.push(format!("{} is left out: {error}", what.display()));
        };
        for entry in entries {
            let entry = match entry {
                Ok(entry) => entry,
                Err(error) => {
                    refused(&path.join("…"), error);
                    continue;
                }
            };
            let name = entry.file_name();
            if name.as_encoded_bytes().starts_with(b".") {
                continue;
            }
            let own = folder.join(&name);
            let kind = match entry.file_type() {
                Ok(kind) => kind,
                Err(error) => {
                    refused(&entry.path(), error);
                    continue;
                }
            };
            if kind.is_dir() {
                open.push(own);
                continue;
            }
            let ending = own.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
            let is_known = ending.is_some_and(|e| ENDINGS.contains(&e.as_str()));
            if !is_known {
                continue;
            }
            match (own.into_os_string().into_string(), stamp(&entry.path())) {
                (Ok(name), Ok(Some(stamp))) => _ = found.insert(name, stamp),
                (Err(_), Ok(Some(_))) => {
                    let why = std::io::Error::other("its name is not UTF-8");
                    refused(&entry.path(), why);
                }
                // A link to nothing, or to a folder; a file that somebody has just removed.
                (_, Ok(None)) => {}
                (_, Err(error)) => refused(&entry.path(), error),
            }
        }
    }
    Ok((found, left_out))
}

/// Size and time of a file; `None` where it is none, or not there.
fn stamp(path: &Path) -> std::io::Result<Option<Stamp>> {
    let metadata = match path.metadata() {
        Ok(metadata) if metadata.is_file() => metadata,
        Ok(_) => return Ok(None),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error),
    };
    let modified = metadata.modified()?;
    // A time that 64 bits do not hold is none to go by.
    let ns = match modified.duration_since(UNIX_EPOCH) {
        Ok(after) => i64::try_from(after.as_nanos()).ok(),
        Err(before) => i64::try_from(before.duration().as_nanos()).ok().map(|ns| -ns),
    };
    let stamp = ns.zip(i64::try_from(metadata.len()).ok());
    Ok(Some(stamp.map_or(Stamp::NEVER, |(modified_ns, bytes)| Stamp { bytes, modified_ns })))
}
