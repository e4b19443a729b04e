//! The lines of a goniometer's run in its folder.

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
    /// The meter's range, as it names it.
    pub range: String,
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
        format!(
            "{utc},{:.6},{},{},{a},{b},{c},{d},{},{},{}",
            self.time_s,
            self.part.name(),
            self.number,
            number(self.power_w),
            self.state.name(),
            quoted(&self.range),
        )
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
            };
            let angles = line.stages.iter().flatten().all(|deg| deg.is_finite());
            if !(line.time_s.is_finite() && angles && line.stages[0].is_some()) {
                return Err(wrong("time_s", "", "numbers for the time and the stages"));
            }
            if line.state == State::Read && !line.power_w.is_finite() {
                return Err(wrong("power_w", "", "a number where the state is `read`"));
            }
            lines.push(line);
        }
        Ok(lines)
    }

    fn time_s(&self) -> f64 {
        self.time_s
    }
}
