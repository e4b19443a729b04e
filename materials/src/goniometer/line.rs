//! The lines of a goniometer's run in its folder.

use super::bench::Bench;
use super::channels::Reads;
use super::pose::Angles;
use super::tasks::Part;
use crate::log::{LogLine, number, quoted};
use crate::reading::{Seen, State};
use serde_json::json;
use std::path::Path;
use sunglint_formats::{Column, ParseError, Table};

/// The plan that a run was begun with, in its folder.
pub const PLAN: &str = "plan.ecsv";
/// The bench that a run was begun with, in its folder.
pub const BENCH: &str = "bench.toml";
/// The virtual goniometer that a run was begun with, in its folder.
pub const VIRTUAL: &str = "goniometer.toml";
/// The files that a run is begun with.
pub const FILES: [&str; 3] = [PLAN, BENCH, VIRTUAL];

/// A run's folder that is written.
pub type Log = crate::log::Log<Line>;
/// A run that was begun.
pub type Begun = crate::log::Begun<Line>;

/// A line of what was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Seconds since the run's first line.
    pub time_s: f64,
    /// Which part.
    pub part: Part,
    /// Number within the part; of a direction the plan's step.
    pub number: u32,
    /// Where the stages stood, degrees: sample, detector, azimuth, turn.
    pub stages: Angles,
    /// The power, W; not a number where there is none.
    pub power_w: f64,
    /// State of the reading.
    pub state: State,
    /// The meter's range, as it names it; of a spectrometer its integration.
    pub range: String,
    /// Wavelength of the reading where a monochromator chooses it, nm.
    pub wavelength_nm: Option<f64>,
    /// Values of all channels that were read at once, in their unit: infinite over range, not a number where there is none. Empty of a power meter.
    pub channels: Vec<f64>,
    /// Standard deviations of these, as a file tells them: empty of all but files.
    pub noise: Vec<f64>,
    /// The file that was taken.
    pub file: Option<Taken>,
}

/// A file that was taken for a reading.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Taken {
    /// Name of the file.
    pub name: String,
    /// SHA-256 of its content, as hexadecimal digits.
    pub sha256: String,
}

impl Line {
    /// A line without channels.
    pub(super) fn blank(channels: usize, is_file: bool) -> (Vec<f64>, Vec<f64>) {
        (vec![f64::NAN; channels], vec![f64::NAN; if is_file { channels } else { 0 }])
    }

    /// The lines of one channel, as those of a power meter are: `k` is the channel's place, `nm` its wavelength.
    pub(super) fn of_channel(lines: &[Self], reads: &Reads, k: usize, nm: f64) -> Vec<Self> {
        let mut found = Vec::new();
        for line in lines {
            let mut one = Self {
                range: line.range.clone(),
                channels: Vec::new(),
                noise: Vec::new(),
                file: None,
                ..*line
            };
            if reads.is_at_once() {
                one.noise = line.noise.get(k).copied().into_iter().collect();
                one.power_w = line.channels.get(k).copied().unwrap_or(f64::NAN);
                if line.state.is_reading() && !one.power_w.is_finite() {
                    (one.power_w, one.state) = (f64::NAN, State::Over);
                } else if line.state.is_reading() {
                    one.state = State::Read;
                }
            } else if line.wavelength_nm.is_some_and(|at| at != nm) {
                continue;
            }
            found.push(one);
        }
        found
    }

    /// The table without rows of a bench's run.
    #[must_use]
    pub fn header_of(bench: &Bench) -> Table {
        let mut table = Self::header();
        let unit = bench.reads.unit();
        match &bench.reads {
            Reads::Meter => {}
            Reads::Monochromator(_) => table.columns.push(
                Column::f64("wavelength_nm", Some("nm"), vec![])
                    .described("that the monochromator lets through"),
            ),
            Reads::Spectrometer(_) | Reads::Files(_) => {
                let about = "mean over the channel's pixels, nothing subtracted; inf is over range";
                let column = |prefix: &str, about: &str, nm: f64| {
                    Column::f64(format!("{prefix}{nm}nm"), unit, vec![]).described(about)
                };
                let nm = || bench.bands.iter().map(|band| band.nm);
                table.columns.extend(nm().map(|nm| column(SIGNAL, about, nm)));
                if matches!(bench.reads, Reads::Files(_)) {
                    let about = "standard deviation of that by the spectrum's own scatter";
                    table.columns.extend(nm().map(|nm| column(NOISE, about, nm)));
                    let text =
                        |name: &str, about: &str| Column::text(name, vec![]).described(about);
                    table.columns.push(text("file", "name of the file that was taken"));
                    table.columns.push(text("sha256", "of its content; spectra/ holds a copy"));
                }
            }
        }
        table
    }
}

const SIGNAL: &str = "signal_";
const NOISE: &str = "noise_";

/// Lines by part, number and wavelength of the monochromator.
pub(super) fn seen_each(lines: &[Line]) -> impl Iterator<Item = Seen<'_, (Part, u32, u64)>> {
    lines.iter().map(|line| Seen {
        key: (line.part, line.number, line.wavelength_nm.map_or(0, f64::to_bits)),
        angle_deg: line.stages[1].unwrap_or(f64::NAN),
        time_s: line.time_s,
        power_w: line.power_w,
        state: line.state,
        range: &line.range,
    })
}

/// Lines by part and number.
pub(super) fn seen(lines: &[Line]) -> impl Iterator<Item = Seen<'_, (Part, u32)>> {
    lines.iter().map(|line| Seen {
        key: (line.part, line.number),
        angle_deg: line.stages[1].unwrap_or(f64::NAN),
        time_s: line.time_s,
        power_w: line.power_w,
        state: line.state,
        range: &line.range,
    })
}

const COLUMNS: [&str; 4] = ["sample_deg", "detector_deg", "azimuth_deg", "turn_deg"];

impl LogLine for Line {
    const KIND: &'static str = "goniometer_readings";
    const GO_ON: &'static str = "go on with it (--resume), or name another folder";

    fn header() -> Table {
        let text = |name: &str, about: &str| Column::text(name, vec![]).described(about);
        let value = |name: &str, unit: &str, about: &str| {
            Column::f64(name, Some(unit), vec![]).described(about)
        };
        let note = "readings count once a line `kept` of their part and number follows them";
        let mut columns = vec![
            text("time_utc", "when the line was written"),
            value("time_s", "s", "since the run's begin"),
            text(
                "part",
                "dark, beam, signature_in, signature_out, floor, zero_plus, zero_minus, reference, direction",
            ),
            Column::i64("number", None, vec![])
                .described("within the part; of a direction the plan's step"),
        ];
        columns.extend(COLUMNS.map(|name| value(name, "deg", "where the stage stood")));
        columns.extend([
            value("power_w", "W", "the meter's reading"),
            text("state", "read, over (the range), kept, again (the range changed)"),
            text("range", "the meter's range"),
        ]);
        Table { meta: [("note".to_owned(), json!(note))].into_iter().collect(), columns }
    }

    fn cells(&self, utc: &str) -> String {
        let [a, b, c, d] = self.stages.map(|deg| number(deg.unwrap_or(f64::NAN)));
        let mut text = format!(
            "{utc},{:.6},{},{},{a},{b},{c},{d},{},{},{}",
            self.time_s,
            self.part.name(),
            self.number,
            number(self.power_w),
            self.state.name(),
            quoted(&self.range),
        );
        for value in self.wavelength_nm.iter().chain(&self.channels).chain(&self.noise) {
            text += ",";
            text += &number(*value);
        }
        if !self.noise.is_empty() {
            let (name, sha256) = match &self.file {
                Some(Taken { name, sha256 }) => (name.as_str(), sha256.as_str()),
                None => ("", ""),
            };
            text += &format!(",{},{}", quoted(name), quoted(sha256));
        }
        text
    }

    fn lines(path: &Path, table: &Table) -> Result<Vec<Self>, ParseError> {
        let bad = |e: sunglint_formats::TableError| e.in_file(path);
        let time_s = table.quantity("time_s", "s").map_err(bad)?;
        let part = table.text("part").map_err(bad)?;
        let count = table.f64("number").map_err(bad)?;
        let mut stages = Vec::new();
        for name in COLUMNS {
            stages.push(table.quantity(name, "deg").map_err(bad)?);
        }
        let power = table.quantity("power_w", "W").map_err(bad)?;
        let state = table.text("state").map_err(bad)?;
        let range = table.text("range").map_err(bad)?;
        let has = |name: &str| table.columns.iter().any(|column| column.name == name);
        let columns = |prefix: &str| -> Result<Vec<_>, ParseError> {
            let named = table.columns.iter().filter(|column| column.name.starts_with(prefix));
            named.map(|column| table.f64(&column.name).map_err(bad)).collect()
        };
        let (signals, noises) = (columns(SIGNAL)?, columns(NOISE)?);
        let wavelength = has("wavelength_nm").then(|| table.quantity("wavelength_nm", "nm"));
        let wavelength = wavelength.transpose().map_err(bad)?;
        let file = has("file").then(|| table.text("file")).transpose().map_err(bad)?;
        let sha256 = has("sha256").then(|| table.text("sha256")).transpose().map_err(bad)?;
        let mut lines = Vec::with_capacity(table.rows());
        for row in 0..table.rows() {
            let wrong = |field: &str, found: &str, expected: &str| {
                let found = format!("`{found}` in row {}", row + 1);
                ParseError::new(path, found, expected).in_field(field)
            };
            let text = |column: &[Option<String>]| column[row].clone().unwrap_or_default();
            let (part, state) = (text(part), text(state));
            let line = Line {
                time_s: time_s[row],
                part: Part::named(&part)
                    .ok_or_else(|| wrong("part", &part, "a part of a run, such as direction"))?,
                number: if (0.0..=f64::from(u32::MAX)).contains(&count[row]) {
                    count[row] as u32
                } else {
                    return Err(wrong("number", &count[row].to_string(), "a number from 0"));
                },
                stages: [0, 1, 2, 3].map(|k| Some(stages[k][row]).filter(|deg| !deg.is_nan())),
                power_w: power[row],
                state: State::named(&state)
                    .ok_or_else(|| wrong("state", &state, "read, over, kept or again"))?,
                range: text(range),
                wavelength_nm: wavelength.as_ref().map(|nm| nm[row]),
                channels: signals.iter().map(|values| values[row]).collect(),
                noise: noises.iter().map(|values| values[row]).collect(),
                file: file.zip(sha256).and_then(|(name, sha256)| {
                    let (name, sha256) = (text(name), text(sha256));
                    (!sha256.is_empty()).then_some(Taken { name, sha256 })
                }),
            };
            let angles = line.stages.iter().flatten().all(|deg| deg.is_finite());
            if !(line.time_s.is_finite() && angles && line.stages[0].is_some()) {
                return Err(wrong("time_s", "", "numbers for the time and the stages"));
            }
            if line.channels.is_empty() && line.state == State::Read && !line.power_w.is_finite() {
                return Err(wrong("power_w", "", "a number where the state is `read`"));
            }
            if line.wavelength_nm.is_some_and(|nm| !nm.is_finite()) {
                return Err(wrong("wavelength_nm", "", "a wavelength in nm"));
            }
            if line.state == State::Read && line.channels.iter().any(|value| value.is_nan()) {
                return Err(wrong("signal", "", "a number or inf in each channel of a reading"));
            }
            lines.push(line);
        }
        Ok(lines)
    }

    fn time_s(&self) -> f64 {
        self.time_s
    }
}
