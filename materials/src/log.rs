//! The folder of a run: lines as they were read, what happened, and the files that it was begun with. Its files only grow.
//!
//! A line is a [`LogLine`]: the runs of [`crate::retro`] and [`crate::goniometer`] have one each, and so have those of other rigs. A reading is on the disk when [`Record::sync`] returns; a last
//! line that was cut off by a crash is found and removed when the run goes on.

use hifitime::Epoch;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::Path;
use sunglint_drivers::clock::DeviceClock;
use sunglint_formats::time::{format_utc, parse_utc};
use sunglint_formats::{EncodeError, FileError, ParseError, Table, ecsv};

/// Why a line is not kept.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// A file of the run cannot be written.
    #[error("cannot write {file}")]
    Write {
        /// The file.
        file: &'static str,
        /// Why.
        source: std::io::Error,
    },
    /// A file of the run cannot be made safe on the disk.
    #[error("cannot write {file} through")]
    Sync {
        /// The file.
        file: &'static str,
        /// Why.
        source: std::io::Error,
    },
}

/// Keeper of a run's lines.
pub trait Record<L> {
    /// Takes a line.
    ///
    /// # Errors
    /// It cannot be written.
    fn line(&mut self, line: &L) -> Result<(), RecordError>;

    /// All lines so far are safe when it returns.
    ///
    /// # Errors
    /// The disk refuses.
    fn sync(&mut self) -> Result<(), RecordError>;

    /// Something happened that is worth a line of its own.
    ///
    /// # Errors
    /// It cannot be written.
    fn event(&mut self, text: &str) -> Result<(), RecordError>;
}

/// Ends a run: what was read is safe when it returns, and the error that ended the run is an event. The first error is the one that counts.
///
/// # Errors
/// The run's, else that of the disk.
pub fn end<L, E>(record: &mut dyn Record<L>, result: Result<(), E>) -> Result<(), E>
where
    E: std::fmt::Display + From<RecordError>,
{
    let synced = record.sync();
    if let Err(error) = &result {
        let _ = record.event(&error.to_string());
    }
    result.and(synced.map_err(E::from))
}

/// Lines in memory: for runs on a virtual rig that nobody wants to keep.
#[derive(Debug, Clone)]
pub struct InMemory<L>(pub Vec<L>);

impl<L> Default for InMemory<L> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<L: Clone> Record<L> for InMemory<L> {
    fn line(&mut self, line: &L) -> Result<(), RecordError> {
        self.0.push(line.clone());
        Ok(())
    }

    fn sync(&mut self) -> Result<(), RecordError> {
        Ok(())
    }

    fn event(&mut self, _: &str) -> Result<(), RecordError> {
        Ok(())
    }
}

/// A line of a run's table of readings.
pub trait LogLine: Clone + std::fmt::Debug {
    /// The kind of the table, in its metadata.
    const KIND: &'static str;
    /// Advice for whoever would begin a run where there is one.
    const GO_ON: &'static str;

    /// The table without rows.
    fn header() -> Table;

    /// The cells of a line, separated by commas; `utc` is when it is written.
    fn cells(&self, utc: &str) -> String;

    /// Reads the lines of a table. `path` names it in errors.
    ///
    /// # Errors
    /// Cells that are not those of a line.
    fn lines(path: &Path, table: &Table) -> Result<Vec<Self>, ParseError>;

    /// Seconds since the run's begin.
    fn time_s(&self) -> f64;
}

/// Why a run's folder cannot be begun, gone on with, or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// A file that cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file that is not that of a run.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// A table that cannot be written.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// An event that cannot be written.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// The folder holds readings.
    #[error("{folder} holds a run already: {go_on}; readings are never overwritten")]
    Begun {
        /// The folder.
        folder: String,
        /// Advice.
        go_on: &'static str,
    },
    /// The folder holds no run.
    #[error("{folder}: there is no run ({READINGS}); begin one without --resume")]
    NoRun {
        /// The folder.
        folder: String,
    },
}

/// Sees the lines of a run as they come.
pub trait Watch<L>: std::fmt::Debug {
    /// A line was kept.
    fn line(&mut self, line: &L);

    /// Something happened.
    fn say(&self, text: &str);
}

/// The name of the readings in a run's folder.
pub const READINGS: &str = "readings.ecsv";
const EVENTS: &str = "events.jsonl";

/// A run's folder that is written.
#[derive(Debug)]
pub struct Log<L> {
    readings: File,
    events: File,
    /// The clock of the run.
    pub clock: DeviceClock,
    /// Lines, as they are shown while it goes on.
    watch: Option<Box<dyn Watch<L>>>,
    /// Lines that were there before, and those that came since.
    pub lines: Vec<L>,
}

/// A run that was begun.
#[derive(Debug, Clone)]
pub struct Begun<L> {
    /// Files that it was begun with, by their names.
    pub files: BTreeMap<&'static str, String>,
    /// Lines that were read so far.
    pub lines: Vec<L>,
    /// When its first line was written.
    pub first_utc: Option<Epoch>,
    /// Bytes of a last line that was cut off.
    pub torn_bytes: u64,
    /// Who its devices said they were, the last time.
    pub devices: Value,
}

/// Refuses a folder that holds readings: they are never overwritten.
///
/// # Errors
/// It holds some, or what cannot be read.
pub fn refuse_begun<L: LogLine>(folder: &Path) -> Result<(), LogError> {
    if folder.join(READINGS).exists() {
        let begun = Begun::<L>::read(folder, &[])?;
        if !begun.lines.is_empty() || begun.torn_bytes > 0 {
            let folder = folder.display().to_string();
            return Err(LogError::Begun { folder, go_on: L::GO_ON });
        }
    }
    Ok(())
}

/// Cells of text that came from a device, as a table of commas holds them.
#[must_use]
pub fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}

/// A number as a table of commas holds it: nothing where there is none.
#[must_use]
pub fn number(value: f64) -> String {
    if value.is_nan() { String::new() } else { format!("{value:e}") }
}

impl<L: LogLine> Log<L> {
    /// A new run in a folder that has none, begun with some files.
    ///
    /// # Errors
    /// There is one already; the disk refuses.
    pub fn create(
        folder: &Path,
        files: &[(&str, &str)],
        clock: DeviceClock,
    ) -> Result<Self, LogError> {
        Self::create_with(folder, files, L::header(), clock)
    }

    /// A new run whose table has the columns of `table`, those of [`LogLine::header`] and perhaps more.
    ///
    /// # Errors
    /// There is one already; the disk refuses.
    pub fn create_with(
        folder: &Path,
        files: &[(&str, &str)],
        mut table: Table,
        clock: DeviceClock,
    ) -> Result<Self, LogError> {
        refuse_begun::<L>(folder)?;
        let io = |path: &Path| {
            let path = path.to_path_buf();
            move |error| FileError::io("write", path, error)
        };
        std::fs::create_dir_all(folder).map_err(|e| FileError::io("create", folder, e))?;
        let write = |name: &str, text: &str| -> Result<(), LogError> {
            let path = folder.join(name);
            let mut file = File::create(&path).map_err(io(&path))?;
            file.write_all(text.as_bytes()).and_then(|()| file.sync_all()).map_err(io(&path))?;
            Ok(())
        };
        for (name, text) in files {
            write(name, text)?;
        }
        write(EVENTS, "")?;
        // Last: a folder with readings has all the rest.
        table.meta.insert("kind".into(), json!(L::KIND));
        let program = format!("sunglint {}", env!("CARGO_PKG_VERSION"));
        table.meta.insert("program".into(), json!(program));
        write(READINGS, &ecsv::to_string(&table)?)?;
        Self::append(folder, vec![], clock)
    }

    /// Goes on with a run.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn resume(folder: &Path, begun: &Begun<L>, clock: DeviceClock) -> Result<Self, LogError> {
        if begun.torn_bytes > 0 {
            let path = folder.join(READINGS);
            let cut = || -> std::io::Result<()> {
                let file = OpenOptions::new().write(true).open(&path)?;
                let length = file.metadata()?.len();
                file.set_len(length.saturating_sub(begun.torn_bytes))?;
                file.sync_all()
            };
            cut().map_err(|error| FileError::io("mend", &path, error))?;
        }
        Self::append(folder, begun.lines.clone(), clock)
    }

    fn append(folder: &Path, lines: Vec<L>, clock: DeviceClock) -> Result<Self, LogError> {
        let open = |name: &str| {
            let path = folder.join(name);
            let file = OpenOptions::new().append(true).create(true).open(&path);
            file.map_err(|error| FileError::io("write", path, error))
        };
        Ok(Self { readings: open(READINGS)?, events: open(EVENTS)?, clock, watch: None, lines })
    }

    /// Shows lines as they come.
    pub fn watch(&mut self, watch: Box<dyn Watch<L>>) {
        self.watch = Some(watch);
    }

    /// An event with fields of its own.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn write_event(&mut self, what: &str, of: Value) -> Result<(), RecordError> {
        let utc = format_utc(self.clock.utc(), 3);
        let line = json!({ "utc": utc, "what": what, "of": of }).to_string() + "\n";
        self.events
            .write_all(line.as_bytes())
            .and_then(|()| self.events.sync_data())
            .map_err(|source| RecordError::Write { file: EVENTS, source })
    }
}

impl<L: LogLine> Record<L> for Log<L> {
    fn line(&mut self, line: &L) -> Result<(), RecordError> {
        let text = line.cells(&format_utc(self.clock.utc(), 3)) + "\n";
        self.readings
            .write_all(text.as_bytes())
            .map_err(|source| RecordError::Write { file: READINGS, source })?;
        self.lines.push(line.clone());
        if let Some(live) = &mut self.watch {
            live.line(line);
        }
        Ok(())
    }

    fn sync(&mut self) -> Result<(), RecordError> {
        self.readings.sync_data().map_err(|source| RecordError::Sync { file: READINGS, source })
    }

    fn event(&mut self, text: &str) -> Result<(), RecordError> {
        if let Some(live) = &self.watch {
            live.say(text);
        }
        self.write_event("note", json!(text))
    }
}

impl<L: LogLine> Begun<L> {
    /// Reads a run's folder, with those of the files named that it holds.
    ///
    /// # Errors
    /// There is none, or its files are not those of a run.
    pub fn read(folder: &Path, names: &[&'static str]) -> Result<Self, LogError> {
        let path = folder.join(READINGS);
        if !path.exists() {
            return Err(LogError::NoRun { folder: folder.display().to_string() });
        }
        let text = |name: &str| sunglint_formats::read::text(folder.join(name));
        let mut files = BTreeMap::new();
        for name in names.iter().filter(|name| folder.join(name).exists()) {
            files.insert(*name, text(name)?);
        }
        let bytes = sunglint_formats::read::bytes(&path)?;
        let whole = bytes.iter().rposition(|b| *b == b'\n').map_or(0, |end| end + 1);
        let torn_bytes = (bytes.len() - whole) as u64;
        let readings = sunglint_formats::read::decode(&path, bytes[..whole].to_vec())?;
        let table = ecsv::read_str(&path, &readings)?;
        if let Some(kind) = table.meta_text("kind").filter(|kind| *kind != L::KIND) {
            let error = ParseError::new(&path, format!("`{kind}`"), format!("`{}`", L::KIND));
            return Err(error.in_field("kind").into());
        }
        let lines = L::lines(&path, &table)?;
        let utc = table.text("time_utc").map_err(|e| e.in_file(&path))?;
        let first = utc.first().and_then(Option::as_deref);
        let first = first.map(parse_utc).transpose().map_err(|e| e.in_file(&path))?;
        // The first line was not written at zero.
        let first_utc = first.map(|utc| {
            let since = lines.first().map_or(0.0, LogLine::time_s);
            utc - hifitime::Duration::from_seconds(since)
        });
        let mut devices = Value::Null;
        for line in text(EVENTS).unwrap_or_default().lines() {
            // A last line may have been cut off.
            if let Ok(event) = serde_json::from_str::<Value>(line)
                && event["what"] == "devices"
            {
                devices = event["of"].clone();
            }
        }
        Ok(Self { files, lines, first_utc, torn_bytes, devices })
    }

    /// The text of a file that the run was begun with.
    pub fn file(&self, name: &str) -> Option<&str> {
        self.files.get(name).map(String::as_str)
    }
}
