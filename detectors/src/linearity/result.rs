//! From the lines of a run to a station's keys, or its table.

use super::line::Line;
use super::plan::{LinearityPlan, places};
use std::fmt::Write as _;
use sunglint_calibration::detector::fit::{Choice, Exposure, Fitted};
use sunglint_radiometry::station::DeadTime;

/// The station's keys, in the run's folder.
pub const LAW: &str = "dead_time.toml";
/// The station's table, in the run's folder.
pub const LINEARITY: &str = "linearity.csv";
/// Points of the table.
const POINTS: u32 = 60;

/// Exposures of a run, as the fit has them; lines of no place of the plan are left out.
#[must_use]
pub fn exposures(plan: &LinearityPlan, lines: &[Line]) -> Vec<Exposure> {
    let places = places(plan);
    let of = |line: &Line| {
        let place = places.get(line.number as usize)?;
        let lights = place.lights.clone();
        Some(Exposure { lights, counts: line.counts, exposure_s: line.exposure_s })
    };
    lines.iter().filter_map(of).collect()
}

/// The station's table of measured and true rates by a law, over what was measured, from a hundredth of the least light on.
#[must_use]
pub fn table_csv(name: &str, choice: &Choice, fitted: &Fitted) -> String {
    let (least, most) = choice.measured_hz;
    let least = least.max(1e-3).min(most) * 0.01;
    // The light at which the law counts the most that was measured: its rising side only.
    let counted = |n: f64| fitted.law.counted_hz(n).unwrap_or(n);
    let (mut low, mut high) = (least, least);
    while counted(high) < most && counted(high * 1.05) > counted(high) && high < 1e15 {
        (low, high) = (high, high * 1.05);
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if counted(middle) < most { low = middle } else { high = middle }
    }
    let mut text = format!(
        "# Linearity of {name}: the law {} over the rates that were measured.\nmeasured_hz,true_hz\n0,0\n",
        fitted.name
    );
    let mut last = 0.0;
    for k in 0..=POINTS {
        let true_hz = least * (high / least).powf(f64::from(k) / f64::from(POINTS));
        let measured_hz = counted(true_hz);
        if measured_hz > last {
            let _ = writeln!(text, "{measured_hz},{true_hz}");
            last = measured_hz;
        }
    }
    text
}

/// The station's keys of the law that the data tell, or of the table where they cannot tell; none where no law fits.
#[must_use]
pub fn law_toml(choice: &Choice) -> Option<String> {
    let mut text =
        String::from("# For [channel.counter] of a station; values with their 95 % intervals.\n");
    let table = format!("dead_time_model = \"table\"\nlinearity = \"{LINEARITY}\"\n");
    match choice.told() {
        Some(Fitted { law: DeadTime::Table { .. }, name, found, .. }) => {
            let values: Vec<String> = (found.iter())
                .map(|f| format!("{} {:.4} ({:.4} to {:.4})", f.name, f.value, f.low, f.high))
                .collect();
            let _ = writeln!(
                text,
                "# The law is {name}, which a station has as a table: {}.",
                values.join(", ")
            );
            text += &table;
        }
        Some(fitted) => {
            let _ = writeln!(text, "dead_time_model = \"{}\"", fitted.name);
            if let DeadTime::MultiPixel { pixels, .. } = fitted.law {
                let _ = writeln!(text, "pixels = {pixels}");
            }
            for found in &fitted.found {
                let (name, value) = (found.name, found.value);
                let _ =
                    writeln!(text, "{name} = {value:.4}   # {:.4} to {:.4}", found.low, found.high);
            }
        }
        None => {
            let first = choice.left.first()?;
            let names: Vec<&str> = choice.left.iter().map(|k| choice.fitted[*k].name).collect();
            let _ = writeln!(
                text,
                "# The data cannot tell {} apart; the table is that of {}, which they differ from by less than their noise.",
                names.join(" and "),
                choice.fitted[*first].name
            );
            text += &table;
        }
    }
    Some(text)
}
