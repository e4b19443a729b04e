//! The lines of an efficiency run in its folder.

use serde_json::json;
use std::path::Path;
use sunglint_formats::{Column, ParseError, Table, TableError};
use sunglint_materials::log::{LogLine, number};
use sunglint_materials::reading::State;

/// The plan that a run was begun with, in its folder.
pub const PLAN: &str = "plan.toml";
/// The virtual rig that a run was begun with, in its folder.
pub const VIRTUAL_RIG: &str = "rig.toml";
/// The files that a run is begun with.
pub const FILES: [&str; 2] = [PLAN, VIRTUAL_RIG];

/// A run's folder that is written.
pub type Log = sunglint_materials::log::Log<Line>;
/// A run that was begun.
pub type Begun = sunglint_materials::log::Begun<Line>;

/// A part of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Part {
    /// No light on either detector.
    Dark,
    /// The wavelength that tells drift.
    Reference,
    /// A wavelength of the scan.
    Step,
}

impl Part {
    const ALL: [(Self, &'static str); 3] =
        [(Self::Dark, "dark"), (Self::Reference, "reference"), (Self::Step, "step")];

    /// Name of the part.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(part, _)| *part == self).map_or("", |(_, name)| name)
    }

    fn named(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(_, known)| *known == name).map(|(part, _)| *part)
    }
}

/// Quantity of a reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What {
    /// The photodiode's meter, in its unit.
    Photodiode,
    /// The sensor's counts.
    Counts,
    /// None: a word about the readings before.
    Word,
}

impl What {
    const ALL: [(Self, &'static str); 3] =
        [(Self::Photodiode, "photodiode"), (Self::Counts, "counts"), (Self::Word, "word")];

    fn name(self) -> &'static str {
        Self::ALL.iter().find(|(what, _)| *what == self).map_or("", |(_, name)| name)
    }

    fn named(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(_, known)| *known == name).map(|(what, _)| *what)
    }
}

/// A line of what was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Seconds since the run's first line; of an exposure those of its middle.
    pub time_s: f64,
    /// Which part.
    pub part: Part,
    /// Number within the part.
    pub number: u32,
    /// Where the monochromator stood, nm.
    pub wavelength_nm: f64,
    /// Slot of the filter wheel.
    pub slot: Option<u32>,
    /// Quantity.
    pub what: What,
    /// Place within the visit: readings with the same number belong together.
    pub place: u32,
    /// The reading; not a number where there is none.
    pub value: f64,
    /// Length of an exposure, s; not a number for a meter.
    pub exposure_s: f64,
    /// State of the reading.
    pub state: State,
}

impl LogLine for Line {
    const KIND: &'static str = "efficiency_readings";
    const GO_ON: &'static str =
        "go on with it (--resume), make its curve anew (--reduce), or name another folder";

    fn header() -> Table {
        let text = |name: &str, about: &str| Column::text(name, vec![]).described(about);
        let value = |name: &str, unit: &str, about: &str| {
            Column::f64(name, Some(unit), vec![]).described(about)
        };
        let whole = |name: &str, about: &str| Column::i64(name, None, vec![]).described(about);
        let note = "readings count once a line `kept` of their part and number follows them";
        Table {
            meta: [("note".to_owned(), json!(note))].into_iter().collect(),
            columns: vec![
                text("time_utc", "when the line was written"),
                value("time_s", "s", "since the run's begin"),
                text("part", "dark, reference, step"),
                whole("number", "within the part"),
                value("wavelength_nm", "nm", "where the monochromator stood"),
                whole("slot", "of the filter wheel; 0 without"),
                text("what", "photodiode, counts, word"),
                whole("place", "within the visit: readings with one number belong together"),
                Column::f64("value", None, vec![])
                    .described("the meter's reading in its unit, or counts"),
                value("exposure_s", "s", "of counts"),
                text("state", "read, over (the range), kept, again (broken off)"),
            ],
        }
    }

    fn cells(&self, utc: &str) -> String {
        format!(
            "{utc},{:.6},{},{},{},{},{},{},{},{},{}",
            self.time_s,
            self.part.name(),
            self.number,
            self.wavelength_nm,
            self.slot.unwrap_or(0),
            self.what.name(),
            self.place,
            number(self.value),
            number(self.exposure_s),
            self.state.name(),
        )
    }

    fn lines(path: &Path, table: &Table) -> Result<Vec<Self>, ParseError> {
        let bad = |e: TableError| e.in_file(path);
        let time_s = table.quantity("time_s", "s").map_err(bad)?;
        let part = table.text("part").map_err(bad)?;
        let count = table.f64("number").map_err(bad)?;
        let wavelength = table.quantity("wavelength_nm", "nm").map_err(bad)?;
        let slot = table.f64("slot").map_err(bad)?;
        let what = table.text("what").map_err(bad)?;
        let place = table.f64("place").map_err(bad)?;
        let value = table.f64("value").map_err(bad)?;
        let exposure = table.quantity("exposure_s", "s").map_err(bad)?;
        let state = table.text("state").map_err(bad)?;
        let mut lines = Vec::with_capacity(table.rows());
        for row in 0..table.rows() {
            let wrong = |field: &str, found: &str, expected: &str| {
                let found = format!("`{found}` in row {}", row + 1);
                ParseError::new(path, found, expected).in_field(field)
            };
            let text = |column: &[Option<String>]| column[row].clone().unwrap_or_default();
            let whole = |field: &str, x: f64| {
                if (0.0..=f64::from(u32::MAX)).contains(&x) && x.fract() == 0.0 {
                    Ok(x as u32)
                } else {
                    Err(wrong(field, &x.to_string(), "a whole number from 0"))
                }
            };
            let (part, what, state) = (text(part), text(what), text(state));
            let line = Line {
                time_s: time_s[row],
                part: Part::named(&part)
                    .ok_or_else(|| wrong("part", &part, "dark, reference or step"))?,
                number: whole("number", count[row])?,
                wavelength_nm: wavelength[row],
                slot: Some(whole("slot", slot[row])?).filter(|slot| *slot > 0),
                what: What::named(&what)
                    .ok_or_else(|| wrong("what", &what, "photodiode, counts or word"))?,
                place: whole("place", place[row])?,
                value: value[row],
                exposure_s: exposure[row],
                state: State::named(&state)
                    .ok_or_else(|| wrong("state", &state, "read, over, kept or again"))?,
            };
            if !(line.time_s.is_finite() && line.wavelength_nm.is_finite()) {
                return Err(wrong("time_s", "", "numbers for time and wavelength"));
            }
            let counts = line.what == What::Counts;
            let exposed = line.exposure_s.is_finite() && line.exposure_s > 0.0;
            if line.state == State::Read && (!line.value.is_finite() || (counts && !exposed)) {
                return Err(wrong("value", "", "a number where the state is `read`"));
            }
            lines.push(line);
        }
        Ok(lines)
    }

    fn time_s(&self) -> f64 {
        self.time_s
    }
}
