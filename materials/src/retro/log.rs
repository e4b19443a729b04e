//! The lines of a retro-reflection run in its folder.

use super::measure::{Line, Phase};
use crate::log::{LogLine, number, quoted};
use crate::reading::State;
use serde_json::json;
use std::path::Path;
use sunglint_formats::{Column, ParseError, Table};

/// The configuration that a run was begun with, in its folder.
pub const PLAN: &str = "run.toml";
/// The virtual rig that a run was begun with, in its folder.
pub const RIG: &str = "rig.toml";

/// A run's folder that is written.
pub type Log = crate::log::Log<Line>;
/// A run that was begun.
pub type Begun = crate::log::Begun<Line>;

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

impl LogLine for Line {
    const KIND: &'static str = "retro_readings";
    const GO_ON: &'static str =
        "go on with it (--resume), make its table anew (--reduce), or name another folder";

    fn header() -> Table {
        let text = |name: &str, about: &str| Column::text(name, vec![]).described(about);
        let number = |name: &str, unit: &str, about: &str| {
            Column::f64(name, Some(unit), vec![]).described(about)
        };
        let note = "readings count once a line `kept` of their phase and angle follows them";
        Table {
            meta: [("note".to_owned(), json!(note))].into_iter().collect(),
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
        }
    }

    fn cells(&self, utc: &str) -> String {
        format!(
            "{utc},{:.6},{},{},{},{},{},{}",
            self.time_s,
            phase_text(self.phase),
            self.asked_deg,
            self.angle_deg,
            number(self.power_w),
            self.state.name(),
            quoted(&self.range),
        )
    }

    fn lines(path: &Path, table: &Table) -> Result<Vec<Self>, ParseError> {
        let bad = |e: sunglint_formats::TableError| e.in_file(path);
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
            let line = Line {
                time_s: time_s[row],
                phase: (phase[row].as_deref().and_then(phase_of)).ok_or_else(|| {
                    wrong("phase", &phase[row], "incident_N, signature or sample")
                })?,
                asked_deg: asked[row],
                angle_deg: angle[row],
                power_w: power[row],
                state: (state[row].as_deref().and_then(State::named))
                    .ok_or_else(|| wrong("state", &state[row], "read, over, kept or again"))?,
                range: range[row].clone().unwrap_or_default(),
            };
            if !(line.time_s.is_finite()
                && line.asked_deg.is_finite()
                && line.angle_deg.is_finite())
            {
                return Err(wrong("time_s", &None, "numbers for times and angles"));
            }
            if line.state == State::Read && !line.power_w.is_finite() {
                return Err(wrong("power_w", &None, "a number where the state is `read`"));
            }
            lines.push(line);
        }
        Ok(lines)
    }

    fn time_s(&self) -> f64 {
        self.time_s
    }
}
