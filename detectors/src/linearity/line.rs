//! The lines of a linearity run in its folder.

use serde_json::json;
use std::path::Path;
use sunglint_formats::{Column, ParseError, Table, TableError};
use sunglint_materials::log::LogLine;

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

/// An exposure.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Seconds from the run's begin to the exposure's end.
    pub time_s: f64,
    /// Number of the place in the plan.
    pub number: u32,
    /// Counts.
    pub counts: u64,
    /// Length, s.
    pub exposure_s: f64,
}

impl LogLine for Line {
    const KIND: &'static str = "linearity_readings";
    const GO_ON: &'static str =
        "go on with it (--resume), fit it anew (--reduce), or name another folder";

    fn header() -> Table {
        let value = |name: &str, about: &str| Column::f64(name, Some("s"), vec![]).described(about);
        let whole = |name: &str, about: &str| Column::i64(name, None, vec![]).described(about);
        let note = "each line is an exposure, whole";
        Table {
            meta: [("note".to_owned(), json!(note))].into_iter().collect(),
            columns: vec![
                Column::text("time_utc", vec![]).described("when the line was written"),
                value("time_s", "since the run's begin"),
                whole("number", "of the place in the plan"),
                whole("counts", "of the detector"),
                value("exposure_s", "length of the exposure"),
            ],
        }
    }

    fn cells(&self, utc: &str) -> String {
        let Self { time_s, number, counts, exposure_s } = self;
        format!("{utc},{time_s:.6},{number},{counts},{exposure_s}")
    }

    fn lines(path: &Path, table: &Table) -> Result<Vec<Self>, ParseError> {
        let bad = |e: TableError| e.in_file(path);
        let time_s = table.quantity("time_s", "s").map_err(bad)?;
        let number = table.f64("number").map_err(bad)?;
        let counts = table.f64("counts").map_err(bad)?;
        let exposure_s = table.quantity("exposure_s", "s").map_err(bad)?;
        let whole = |field: &str, x: f64, most: f64| {
            let good = (0.0..=most).contains(&x) && x.fract() == 0.0;
            let wrong = || ParseError::new(path, format!("{x}"), "a whole number from 0");
            if good { Ok(x) } else { Err(wrong().in_field(field)) }
        };
        (0..table.rows())
            .map(|row| {
                if !(time_s[row].is_finite() && exposure_s[row] > 0.0) {
                    let found = format!("row {}", row + 1);
                    let error = ParseError::new(path, found, "a time and a length above 0 s");
                    return Err(error.in_field("exposure_s"));
                }
                Ok(Line {
                    time_s: time_s[row],
                    number: whole("number", number[row], f64::from(u32::MAX))? as u32,
                    counts: whole("counts", counts[row], 1e15)? as u64,
                    exposure_s: exposure_s[row],
                })
            })
            .collect()
    }

    fn time_s(&self) -> f64 {
        self.time_s
    }
}
