//! The files of a run: what was read, line by line as it came, what happened, and the files that it was begun with. They only grow.

use super::measure::{Line, Phase, Record, RecordError, State};
use hifitime::Epoch;
use serde_json::{Value, json};
use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use sunglint_drivers::clock::DeviceClock;
use sunglint_formats::time::{format_utc, parse_utc};
use sunglint_formats::{Column, EncodeError, FileError, ParseError, Table, ecsv};

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
    #[error(
        "{folder} holds a run already: go on with it (--resume), make its table anew (--reduce), or name another folder; readings are never overwritten"
    )]
    Begun {
        /// The folder.
        folder: String,
    },
    /// The folder holds no run.
    #[error("{folder}: there is no run ({READINGS}); begin one without --resume")]
    NoRun {
        /// The folder.
        folder: String,
    },
}

/// Sees the lines of a run as they come.
pub trait Watch: std::fmt::Debug {
    /// A line was kept.
    fn line(&mut self, line: &Line);

    /// Something happened.
    fn say(&self, text: &str);
}

/// The names of the files in a run's folder.
pub const READINGS: &str = "readings.ecsv";
const EVENTS: &str = "events.jsonl";
const PLAN: &str = "run.toml";
const RIG: &str = "rig.toml";

/// A run's folder.
#[derive(Debug)]
pub struct Log {
    readings: File,
    events: File,
    /// The clock of the run.
    pub clock: DeviceClock,
    /// Lines, as they are shown while it goes on.
    watch: Option<Box<dyn Watch>>,
    /// Lines that were there before, and those that came since.
    pub lines: Vec<Line>,
}

/// A run that was begun.
#[derive(Debug, Clone)]
pub struct Begun {
    /// RUN.toml as it was then.
    pub plan: String,
    /// The virtual rig's file as it was then.
    pub rig: Option<String>,
    /// Lines that were read so far.
    pub lines: Vec<Line>,
    /// When its first line was written.
    pub first_utc: Option<Epoch>,
    /// Bytes of a last line that was cut off.
    pub torn_bytes: u64,
    /// Who its devices said they were, the last time.
    pub devices: Value,
}

fn phase_text(phase: Phase) -> String {
    match phase {
        Phase::Incident(number) => format!("incident_{number}"),
        Phase::Signature => "signature".to_owned(),
        Phase::Sample => "sample".to_owned(),
    }
}

fn phase_of(text: &str) -> Option<Phase> {
    match text {
        "signature" => Some(Phase::Signature),
        "sample" => Some(Phase::Sample),
        _ => text.strip_prefix("incident_")?.parse().ok().map(Phase::Incident),
    }
}

const STATES: [(State, &str); 4] =
    [(State::Read, "read"), (State::Over, "over"), (State::Kept, "kept"), (State::Again, "again")];

/// The table without rows.
fn header() -> Result<String, EncodeError> {
    let text = |name: &str, about: &str| Column::text(name, vec![]).described(about);
    let number = |name: &str, unit: &str, about: &str| {
        Column::f64(name, Some(unit), vec![]).described(about)
    };
    let meta = [
        ("kind", json!("retro_readings")),
        ("program", json!(format!("sunglint {}", env!("CARGO_PKG_VERSION")))),
        ("note", json!("readings count once a line `kept` of their phase and angle follows them")),
    ];
    let table = Table {
        meta: meta.into_iter().map(|(key, value)| (key.to_owned(), value)).collect(),
        columns: vec![
            text("time_utc", "when the line was written"),
            number("time_s", "s", "since the run's begin"),
            text("phase", "incident_0, signature, sample, incident_1 ..."),
            number("angle_asked_deg", "deg", "where the stage was sent"),
            number("angle_deg", "deg", "where it said that it stood"),
            number("power_w", "W", "the meter's reading"),
            text("state", "read, over (the range), kept, again (the range changed)"),
            text("range", "the meter's range"),
        ],
    };
    ecsv::to_string(&table)
}

/// Refuses a folder that holds readings: they are never overwritten.
///
/// # Errors
/// It holds some, or what cannot be read.
pub fn refuse_begun(folder: &Path) -> Result<(), LogError> {
    if folder.join(READINGS).exists() {
        let begun = Begun::read(folder)?;
        if !begun.lines.is_empty() || begun.torn_bytes > 0 {
            return Err(LogError::Begun { folder: folder.display().to_string() });
        }
    }
    Ok(())
}

impl Log {
    /// A new run in a folder that has none.
    ///
    /// # Errors
    /// There is one already; the disk refuses.
    pub fn create(
        folder: &Path,
        plan: &str,
        rig: Option<&str>,
        clock: DeviceClock,
    ) -> Result<Self, LogError> {
        refuse_begun(folder)?;
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
        write(PLAN, plan)?;
        if let Some(rig) = rig {
            write(RIG, rig)?;
        }
        write(EVENTS, "")?;
        // Last: a folder with readings has all the rest.
        write(READINGS, &header()?)?;
        Self::append(folder, vec![], clock)
    }

    /// Goes on with a run.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn resume(folder: &Path, begun: &Begun, clock: DeviceClock) -> Result<Self, LogError> {
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

    fn append(folder: &Path, lines: Vec<Line>, clock: DeviceClock) -> Result<Self, LogError> {
        let open = |name: &str| {
            let path = folder.join(name);
            let file = OpenOptions::new().append(true).create(true).open(&path);
            file.map_err(|error| FileError::io("write", path, error))
        };
        Ok(Self { readings: open(READINGS)?, events: open(EVENTS)?, clock, watch: None, lines })
    }

    /// Shows lines as they come.
    pub fn watch(&mut self, watch: Box<dyn Watch>) {
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

impl Record for Log {
    fn line(&mut self, line: &Line) -> Result<(), RecordError> {
        let state = STATES.iter().find(|(state, _)| *state == line.state).map_or("", |s| s.1);
        let power =
            if line.power_w.is_nan() { String::new() } else { format!("{:e}", line.power_w) };
        // A range's name comes from a device.
        let range = line.range.replace('"', "\"\"");
        let text = format!(
            "{},{:.6},{},{},{},{power},{state},\"{range}\"\n",
            format_utc(self.clock.utc(), 3),
            line.time_s,
            phase_text(line.phase),
            line.asked_deg,
            line.angle_deg,
        );
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

impl Begun {
    /// Reads a run's folder.
    ///
    /// # Errors
    /// There is none, or its files are not those of a run.
    pub fn read(folder: &Path) -> Result<Self, LogError> {
        let path = folder.join(READINGS);
        if !path.exists() {
            return Err(LogError::NoRun { folder: folder.display().to_string() });
        }
        let text = |name: &str| sunglint_formats::read::text(folder.join(name));
        let bytes = sunglint_formats::read::bytes(&path)?;
        let whole = bytes.iter().rposition(|b| *b == b'\n').map_or(0, |end| end + 1);
        let torn_bytes = (bytes.len() - whole) as u64;
        let readings = sunglint_formats::read::decode(&path, bytes[..whole].to_vec())?;
        let (lines, first_utc) = lines(&path, &readings)?;
        let rig = folder.join(RIG).exists().then(|| text(RIG)).transpose()?;
        let mut devices = Value::Null;
        for line in text(EVENTS).unwrap_or_default().lines() {
            // A last line may have been cut off.
            if let Ok(event) = serde_json::from_str::<Value>(line)
                && event["what"] == "devices"
            {
                devices = event["of"].clone();
            }
        }
        Ok(Self { plan: text(PLAN)?, rig, lines, first_utc, torn_bytes, devices })
    }
}

fn lines(path: &PathBuf, text: &str) -> Result<(Vec<Line>, Option<Epoch>), ParseError> {
    let table = ecsv::read_str(path, text)?;
    let bad = |e: sunglint_formats::TableError| e.in_file(path);
    let utc = table.text("time_utc").map_err(bad)?;
    let time_s = table.quantity("time_s", "s").map_err(bad)?;
    let phase = table.text("phase").map_err(bad)?;
    let asked = table.quantity("angle_asked_deg", "deg").map_err(bad)?;
    let angle = table.quantity("angle_deg", "deg").map_err(bad)?;
    let power = table.quantity("power_w", "W").map_err(bad)?;
    let state = table.text("state").map_err(bad)?;
    let range = table.text("range").map_err(bad)?;
    let mut lines = Vec::with_capacity(table.rows());
    for row in 0..table.rows() {
        let wrong = |field: &str, found: &Option<String>, expected: &str| {
            let found = format!("`{}` in row {}", found.as_deref().unwrap_or(""), row + 1);
            ParseError::new(path, found, expected).in_field(field)
        };
        let known = |text: &str| STATES.iter().find(|(_, name)| *name == text).map(|s| s.0);
        let line = Line {
            time_s: time_s[row],
            phase: (phase[row].as_deref().and_then(phase_of))
                .ok_or_else(|| wrong("phase", &phase[row], "incident_N, signature or sample"))?,
            asked_deg: asked[row],
            angle_deg: angle[row],
            power_w: power[row],
            state: (state[row].as_deref().and_then(known))
                .ok_or_else(|| wrong("state", &state[row], "read, over, kept or again"))?,
            range: range[row].clone().unwrap_or_default(),
        };
        if !(line.time_s.is_finite() && line.asked_deg.is_finite() && line.angle_deg.is_finite()) {
            return Err(wrong("time_s", &None, "numbers for times and angles"));
        }
        if line.state == State::Read && !line.power_w.is_finite() {
            return Err(wrong("power_w", &None, "a number where the state is `read`"));
        }
        lines.push(line);
    }
    let first = utc.first().and_then(Option::as_deref);
    let first = first.map(parse_utc).transpose().map_err(|e| e.in_file(path))?;
    // The first line was not written at zero.
    let begun = first.map(|utc| {
        let since = lines.first().map_or(0.0, |line| line.time_s);
        utc - hifitime::Duration::from_seconds(since)
    });
    Ok((lines, begun))
}
