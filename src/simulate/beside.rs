//! A measured curve of magnitudes beside the simulated one: drawn, subtracted, not fitted.

use anyhow::bail;
use clap::ValueEnum;
use hifitime::Epoch;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use sunglint_formats::time::{parse_utc, tai_nanoseconds};
use sunglint_formats::{ParseError, Values, nearest_names};
use sunglint_simulator::pass::table;
use sunglint_simulator::pass::{Simulation, StandardMagnitude};

/// A simulated sample stands for a measured one that is no further away than so many steps.
const STEPS: f64 = 2.0;
/// The place of V among the bands.
const V: usize = 2;

/// What measured magnitudes are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum ComparedAs {
    /// Apparent, above the air: what a catalogue's stars give
    #[default]
    Apparent,
    /// Apparent at the ground, the air's extinction in it
    Ground,
    /// Brought to 1000 km, at its own phase angle
    #[value(name = "1000km")]
    Range,
    /// Brought to 1000 km and by the illuminated fraction to a phase angle of 90°
    Standard,
}

impl ComparedAs {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Apparent => "V above the air",
            Self::Ground => "V after the air",
            Self::Range => "V above the air at 1,000 km",
            Self::Standard => "V above the air at 1,000 km, by the illuminated fraction to 90°",
        }
    }

    /// The simulated magnitudes of that kind.
    pub fn of(self, simulation: &Simulation) -> Vec<f64> {
        match self {
            Self::Apparent => simulation.magnitudes.column(V).to_vec(),
            Self::Ground => simulation.ground_magnitudes.column(V).to_vec(),
            Self::Range => simulation.standard_magnitudes(StandardMagnitude::Range),
            Self::Standard => {
                simulation.standard_magnitudes(StandardMagnitude::IlluminatedFraction)
            }
        }
    }
}

/// A measured curve.
pub struct Beside {
    path: PathBuf,
    column: String,
    compared_as: ComparedAs,
    times: Vec<Epoch>,
    magnitudes: Vec<f64>,
}

/// A measured curve and what it differs by.
pub struct Comparison {
    path: PathBuf,
    column: String,
    /// What was compared.
    pub compared_as: ComparedAs,
    /// Time, measured, measured less simulated (NaN without a simulated sample).
    pub points: Vec<(Epoch, f64, f64)>,
    /// One for each track, then for all where there are several.
    pub residuals: Vec<Residuals>,
}

/// How much measured magnitudes differ from simulated ones.
pub struct Residuals {
    /// The track, from 1; `None` for all.
    pub track: Option<usize>,
    /// Number of pairs.
    pub pairs: usize,
    /// Mean of measured less simulated, mag.
    pub mean_mag: f64,
    /// Root of the mean square, mag.
    pub rms_mag: f64,
    /// Standard deviation about the mean, mag.
    pub scatter_mag: f64,
}

impl Beside {
    /// Reads the measured curve.
    pub fn read(path: &Path, column: &str, compared_as: ComparedAs) -> anyhow::Result<Self> {
        let table = table::any(path, &sunglint_formats::read::text(path)?)?;
        let names = || table.columns.iter().map(|c| c.name.as_str());
        let missing = |name: &str, what: &str| {
            let found = format!("the columns {}", names().collect::<Vec<_>>().join(", "));
            let error = ParseError::new(path, found, format!("a column `{name}` of {what}"));
            let near = nearest_names(name, names(), 1).first().map(|n| format!("is it `{n}`?"));
            let hint = near.unwrap_or_else(|| "--beside-column NAME".into());
            error.in_field(name).with_hint(hint)
        };
        let Ok(Values::Text(texts)) = table.column("time_utc").map(|c| &c.values) else {
            return Err(missing("time_utc", "times, ISO 8601").into());
        };
        let read = |(i, text): (usize, &Option<String>)| {
            parse_utc(text.as_deref().unwrap_or(""))
                .map_err(|error| error.in_file(path).in_field(format!("time_utc, row {}", i + 1)))
        };
        let times = texts.iter().enumerate().map(read).collect::<Result<Vec<_>, _>>()?;
        let magnitudes = table.f64(column).map_err(|_| missing(column, "magnitudes"))?.into_owned();
        if !magnitudes.iter().any(|m| m.is_finite()) {
            bail!("{}: the column {column} has no number", path.display());
        }
        Ok(Self { path: path.to_path_buf(), column: column.into(), compared_as, times, magnitudes })
    }

    /// Sets the measured magnitudes beside the simulated ones, which are interpolated in time.
    pub fn compare(self, simulation: &Simulation) -> anyhow::Result<Comparison> {
        let simulated = self.compared_as.of(simulation);
        let seconds = |epoch: Epoch| tai_nanoseconds(epoch) as f64 * 1e-9;
        let mut curve: Vec<(f64, f64)> = (simulation.pass.times.iter())
            .zip(&simulated)
            .map(|(t, m)| (seconds(*t), *m))
            .collect();
        curve.sort_by(|a, b| a.0.total_cmp(&b.0));
        let step_s = super::figure::usual_step_s(&curve.iter().map(|p| p.0).collect::<Vec<_>>());
        let mut points: Vec<(Epoch, f64, f64)> = Vec::with_capacity(self.times.len());
        for (time, magnitude) in self.times.iter().zip(&self.magnitudes) {
            let model = interpolated(&curve, seconds(*time), STEPS * step_s);
            points.push((*time, *magnitude, magnitude - model));
        }
        points.sort_by_key(|a| tai_nanoseconds(a.0));
        let tracks = super::figure::tracks(&simulation.pass.times);
        let mut residuals = Vec::new();
        for (number, track) in tracks.iter().enumerate() {
            let (from, to) = (seconds(track.from) - step_s, seconds(track.to) + step_s);
            let within = points.iter().filter(|p| (from..=to).contains(&seconds(p.0)));
            residuals.extend(Residuals::of(Some(number + 1), within.map(|p| p.2)));
        }
        if residuals.is_empty() {
            bail!(
                "{}: none of its {} magnitudes falls on a simulated sample with light: are the times the same? \
                 ([times] file = \"{}\" takes them from it)",
                self.path.display(),
                points.len(),
                self.path.display()
            );
        }
        if tracks.len() > 1 {
            residuals.extend(Residuals::of(None, points.iter().map(|p| p.2)));
        }
        let Self { path, column, compared_as, .. } = self;
        Ok(Comparison { path, column, compared_as, points, residuals })
    }
}

/// The curve at a time: between the two samples around it, if they are near enough, else NaN.
fn interpolated(curve: &[(f64, f64)], time_s: f64, most_s: f64) -> f64 {
    let after = curve.partition_point(|p| p.0 < time_s);
    match (after.checked_sub(1).and_then(|i| curve.get(i)), curve.get(after)) {
        // Within a microsecond, which is what seconds since 1900 resolve.
        (_, Some(b)) if b.0 - time_s < 1e-6 => b.1,
        (Some(a), _) if time_s - a.0 < 1e-6 => a.1,
        (Some(a), Some(b)) if b.0 - a.0 <= most_s => {
            let f = (time_s - a.0) / (b.0 - a.0);
            a.1 + f * (b.1 - a.1)
        }
        _ => f64::NAN,
    }
}

impl Residuals {
    fn of(track: Option<usize>, differences: impl Iterator<Item = f64>) -> Option<Self> {
        let good: Vec<f64> = differences.filter(|d| d.is_finite()).collect();
        if good.is_empty() {
            return None;
        }
        let n = good.len() as f64;
        let mean_mag = good.iter().sum::<f64>() / n;
        let square = good.iter().map(|d| d * d).sum::<f64>() / n;
        let about = good.iter().map(|d| (d - mean_mag).powi(2)).sum::<f64>() / n;
        let (rms_mag, scatter_mag) = (square.sqrt(), about.sqrt());
        Some(Self { track, pairs: good.len(), mean_mag, rms_mag, scatter_mag })
    }
}

impl Comparison {
    /// What it is, in a line.
    pub fn title(&self) -> String {
        format!("{} ({}), as {}", self.path.display(), self.column, self.compared_as.name())
    }

    /// The name of the file, for a legend.
    pub fn label(&self) -> String {
        "measured".to_owned()
    }

    /// The lines of the summary.
    pub fn text(&self) -> String {
        let mut text = format!("\nmeasured less simulated, {}\n", self.title());
        for r in &self.residuals {
            let what = r.track.map_or("all".to_owned(), |n| format!("track {n}"));
            text.push_str(&format!(
                "  {what:<9} {:>6} pairs   mean {:+.3} mag   rms {:.3} mag   scatter about the mean {:.3} mag\n",
                r.pairs, r.mean_mag, r.rms_mag, r.scatter_mag
            ));
        }
        text.push_str("  nothing was fitted: the model's size, materials and attitude are as the file gives them\n");
        text
    }

    /// As the JSON document holds it.
    pub fn json(&self) -> Value {
        let residuals: Vec<Value> = self
            .residuals
            .iter()
            .map(|r| {
                json!({ "track": r.track, "pairs": r.pairs, "mean_mag": r.mean_mag, "rms_mag": r.rms_mag, "scatter_mag": r.scatter_mag })
            })
            .collect();
        json!({ "measured": self.path.display().to_string(), "column": self.column, "compared_as": self.compared_as.name(), "residuals": residuals })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: by hand.
    #[test]
    fn a_curve_is_interpolated_and_never_across_a_gap() {
        let curve = [(0.0, 8.0), (1.0, 9.0), (100.0, 3.0)];
        assert_eq!(interpolated(&curve, 0.0, 2.0), 8.0);
        assert_eq!(interpolated(&curve, 0.25, 2.0), 8.25);
        assert_eq!(interpolated(&curve, 100.0, 2.0), 3.0);
        for outside in [-1.0, 50.0, 101.0] {
            assert!(interpolated(&curve, outside, 2.0).is_nan(), "{outside}");
        }
        let r = Residuals::of(None, [1.0, f64::NAN, 3.0].into_iter()).unwrap();
        assert_eq!((r.pairs, r.mean_mag, r.scatter_mag), (2, 2.0, 1.0));
        assert!((r.rms_mag - 5_f64.sqrt()).abs() < 1e-15);
    }
}
