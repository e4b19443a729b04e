//! From the lines of a run to the tables and the file that `sunglint efficiency RUN.toml` reads.
//!
//! Each wavelength becomes one row: the sum of its counts, and the mean of the photodiode's readings about them, each exposure between two. The photodiode's noise is that of all readings of the
//! run, additive and relative: a few readings at one wavelength do not tell it. What exposures scatter more than photons and noise is the light's own unrest, and widens the row.

use super::drift::{Change, Drift, Point, SEEN};
use super::line::{Line, Part, What};
use super::plan::RunPlan;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use sunglint_calibration::efficiency::{
    EfficiencyError, EfficiencyRunError, Set, read_run, reduce,
};
use sunglint_formats::text::counted;
use sunglint_formats::toml::Document;
use sunglint_formats::{FileError, ParseError};
use sunglint_materials::reading::State;
use sunglint_numerics::order::{SIGMA_PER_MAD, median};

/// The file for the reduction, in the run's folder.
pub const RUN: &str = "efficiency.toml";
/// Readings of the scan, in the run's folder.
pub(super) const STEPS: &str = "steps.csv";
/// Readings of the reference, in the run's folder.
const REFERENCE: &str = "reference.csv";
/// Standard deviations by which the light changes suddenly from a reading of the photodiode to the next.
const SUDDEN: f64 = 5.0;

/// Why there are no tables.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TableError {
    /// Nothing was measured yet.
    #[error("no {0} reading is complete yet: go on with --resume")]
    None(&'static str),
    /// A file of the folder.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file of the folder that is not what it should be.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// The reduction of the reference.
    #[error(transparent)]
    Run(#[from] EfficiencyRunError),
    /// Numbers that the reduction does not take.
    #[error(transparent)]
    Number(#[from] EfficiencyError),
}

/// Tables of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Made {
    /// Wavelengths of the scan that are complete.
    pub steps: usize,
    /// Text of the scan's table.
    pub scan: String,
    /// Text of the reference's table, where there is one.
    pub reference: Option<String>,
    /// Drift, with two readings of the reference or more.
    pub drift: Option<Drift>,
    /// Largest less least light of the photodiode at the reference, over the mean: that of the lamp, which is in no efficiency.
    pub lamp_range: f64,
    /// Standard deviation of one reading of the photodiode in the dark, in its unit.
    pub noise: f64,
    /// Relative standard deviation of the light from exposure to exposure, beyond photons and noise; 0 where none is seen.
    pub unrest: f64,
    /// Warnings.
    pub warnings: Vec<String>,
}

/// A complete place.
struct Place {
    part: Part,
    number: u32,
    wavelength_nm: f64,
    time_s: f64,
    /// Means of the photodiode's points, in their order; empty where one is missing.
    points: Vec<f64>,
    /// Readings of each point.
    readings: Vec<Vec<f64>>,
    /// Counts and lengths, s, of the exposures.
    exposures: Vec<(f64, f64)>,
    is_over: bool,
    /// Largest sudden change of the light from a point to the next, relative; 0 without.
    jump: f64,
}

impl Place {
    fn of(lines: &[&Line]) -> Option<Self> {
        let first = lines.first()?;
        let mut points: BTreeMap<u32, Vec<f64>> = BTreeMap::new();
        let mut exposures: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
        let mut is_over = false;
        for line in lines {
            match (line.what, line.state) {
                (What::Photodiode, State::Read) => {
                    points.entry(line.place).or_default().push(line.value);
                }
                (What::Photodiode, State::Over) => is_over = true,
                (What::Counts, State::Read) => {
                    exposures.insert(line.place, (line.value, line.exposure_s));
                }
                _ => {}
            }
        }
        let time_s = lines.iter().map(|l| l.time_s).sum::<f64>() / lines.len() as f64;
        let whole = !is_over && points.len() == exposures.len() + 1;
        let mean = |v: &Vec<f64>| v.iter().sum::<f64>() / v.len() as f64;
        Some(Self {
            part: first.part,
            number: first.number,
            wavelength_nm: first.wavelength_nm,
            time_s,
            points: if whole { points.values().map(mean).collect() } else { vec![] },
            readings: points.into_values().collect(),
            exposures: exposures.into_values().collect(),
            is_over,
            jump: 0.0,
        })
    }

    /// Relative change of the light from each point to the next, and its variance by noise.
    fn changes(&self, noise: Noise) -> Vec<(f64, f64)> {
        let light = self.light();
        let pairs = self.points.windows(2).zip(self.readings.windows(2));
        let of = |(points, readings): (&[f64], &[Vec<f64>])| {
            let share = 1.0 / readings[0].len() as f64 + 1.0 / readings[1].len() as f64;
            ((points[1] - points[0]) / light, noise.variance(light) * share / (light * light))
        };
        pairs.map(of).collect()
    }

    /// Weight of each point in the mean light of the exposures.
    fn weights(&self) -> Vec<f64> {
        let n = self.points.len();
        let inner = 1.0 / n.saturating_sub(1).max(1) as f64;
        (0..n).map(|k| if k == 0 || k + 1 == n { 0.5 * inner } else { inner }).collect()
    }

    /// Mean of the photodiode about the exposures; not a number where a point is missing.
    fn light(&self) -> f64 {
        if self.points.is_empty() {
            return f64::NAN;
        }
        self.points.iter().zip(self.weights()).map(|(p, w)| p * w).sum()
    }

    fn counts(&self) -> (f64, f64) {
        self.exposures.iter().fold((0.0, 0.0), |(c, t), (counts, s)| (c + counts, t + s))
    }
}

/// The last complete readings of each place.
fn places(lines: &[Line]) -> Vec<Place> {
    let mut kept: BTreeMap<(Part, u32), Place> = BTreeMap::new();
    let mut now: Vec<&Line> = Vec::new();
    for line in lines {
        if now.first().is_some_and(|l| (l.part, l.number) != (line.part, line.number)) {
            now.clear();
        }
        match line.state {
            State::Read | State::Over => now.push(line),
            State::Again => now.clear(),
            State::Kept => {
                if let Some(place) = Place::of(&now) {
                    kept.insert((place.part, place.number), place);
                }
                now.clear();
            }
        }
    }
    kept.into_values().collect()
}

/// Noise of a reading: additive, in the meter's unit, and relative, both as variances.
#[derive(Debug, Clone, Copy)]
struct Noise {
    additive: f64,
    relative: f64,
}

impl Noise {
    /// From differences of readings that follow one another: a slow drift is no noise.
    fn of(places: &[Place]) -> Self {
        let halves = |place: &Place| -> Vec<f64> {
            let pairs = place.readings.iter().flat_map(|r| r.windows(2));
            pairs.map(|w| 0.5 * (w[1] - w[0]).powi(2)).collect()
        };
        let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len().max(1) as f64;
        let dark: Vec<f64> =
            places.iter().filter(|p| p.part == Part::Dark).flat_map(halves).collect();
        let additive = mean(&dark);
        // Where the light is strong the relative part tells: each pair weighted by that.
        let (mut above, mut weight) = (0.0, 0.0);
        for place in places.iter().filter(|p| p.part != Part::Dark && !p.points.is_empty()) {
            let square = place.light().powi(2);
            let w = 1.0 / (additive + 1e-6 * square).powi(2);
            for half in halves(place) {
                above += w * square * (half - additive);
                weight += w * square * square;
            }
        }
        let relative = if weight > 0.0 { (above / weight).max(0.0) } else { 0.0 };
        Self { additive, relative }
    }

    fn variance(self, light: f64) -> f64 {
        self.additive + self.relative * light * light
    }
}

/// The dark of both detectors over time.
struct Darks {
    /// Time s, photodiode, variance of that, counts, exposure s.
    at: Vec<(f64, f64, f64, f64, f64)>,
    /// Variance by which the photodiode's dark may bend between two readings.
    bend: f64,
    /// Whether the sensor's dark rate is one.
    is_steady: bool,
}

impl Darks {
    fn of(places: &[Place], noise: Noise) -> Self {
        let mut at: Vec<(f64, f64, f64, f64, f64)> = (places.iter())
            .filter(|p| p.part == Part::Dark && !p.points.is_empty())
            .map(|p| {
                let n = p.readings.iter().map(Vec::len).sum::<usize>().max(1) as f64;
                let all = p.readings.iter().flatten().sum::<f64>() / n;
                let (counts, exposure_s) = p.counts();
                (p.time_s, all, noise.additive / n, counts, exposure_s)
            })
            .collect();
        at.sort_by(|a, b| a.0.total_cmp(&b.0));
        // How far the middle of three lies off the line of the others, beyond noise. Half as far apart it bends a quarter as much.
        let off: Vec<f64> = (at.windows(3))
            .map(|w| {
                let part = (w[1].0 - w[0].0) / (w[2].0 - w[0].0).max(f64::MIN_POSITIVE);
                let line = (1.0 - part) * w[0].1 + part * w[2].1;
                let own = w[1].2 + (1.0 - part).powi(2) * w[0].2 + part * part * w[2].2;
                (w[1].1 - line).powi(2) - own
            })
            .collect();
        let bend = (off.iter().sum::<f64>() / off.len().max(1) as f64).max(0.0) / 16.0;
        let (counts, time) = at.iter().fold((0.0, 0.0), |(c, t), d| (c + d.3, t + d.4));
        let chi2: f64 = (at.iter())
            .map(|d| {
                let expected: f64 = counts / time * d.4;
                (d.3 - expected).powi(2) / expected.max(1.0)
            })
            .sum();
        let freedom = at.len().saturating_sub(1) as f64;
        let is_steady = chi2 <= freedom + SEEN * (2.0 * freedom).sqrt();
        Self { at, bend, is_steady }
    }

    /// Places before and after a time, and how far it is between them.
    fn about(&self, time_s: f64) -> (usize, usize, f64) {
        let last = self.at.len() - 1;
        let after = self.at.partition_point(|d| d.0 < time_s);
        if after == 0 || after > last {
            let end = after.min(last);
            return (end, end, 0.0);
        }
        let (low, high) = (&self.at[after - 1], &self.at[after]);
        let part = (time_s - low.0) / (high.0 - low.0).max(f64::MIN_POSITIVE);
        (after - 1, after, part)
    }

    /// The photodiode's dark at a time, and its variance.
    fn photodiode(&self, time_s: f64) -> (f64, f64) {
        let (low, high, part) = self.about(time_s);
        let (a, b) = (&self.at[low], &self.at[high]);
        let value = (1.0 - part) * a.1 + part * b.1;
        let own = if low == high { a.2 } else { (1.0 - part).powi(2) * a.2 + part * part * b.2 };
        (value, own + self.bend)
    }

    /// The sensor's dark counts and their exposure, s: of all, or of those next to a time where the rate changes.
    fn counts(&self, time_s: f64) -> (f64, f64) {
        if self.is_steady {
            return self.at.iter().fold((0.0, 0.0), |(c, t), d| (c + d.3, t + d.4));
        }
        let (low, high, _) = self.about(time_s);
        let (a, b) = (&self.at[low], &self.at[high]);
        if low == high { (a.3, a.4) } else { (a.3 + b.3, a.4 + b.4) }
    }
}

/// Sees where the light changed suddenly between two points of a place: the exposure between them had some of both.
fn sudden_light(places: &mut [Place], noise: Noise) {
    let lit = |p: &&mut Place| p.part != Part::Dark && !p.points.is_empty();
    let all: Vec<f64> = (places.iter_mut().filter(lit))
        .flat_map(|p| p.changes(noise))
        .map(|(change, _)| change.abs())
        .collect();
    let usual = SIGMA_PER_MAD * median(all).unwrap_or(0.0);
    for place in places.iter_mut().filter(lit) {
        let largest = (place.changes(noise).into_iter())
            .filter(|(change, variance)| change.abs() > SUDDEN * variance.sqrt().hypot(usual))
            .map(|(change, _)| change);
        place.jump = largest.fold(0.0, |most: f64, c| if c.abs() > most.abs() { c } else { most });
    }
}

/// Relative variance of the light from exposure to exposure beyond photons and noise; 0 where none is seen.
fn unrest(places: &[Place], noise: Noise, darks: &Darks) -> f64 {
    let (mut chi2, mut freedom, mut beyond, mut number) = (0.0, 0.0, 0.0, 0.0);
    let calm = |p: &&Place| p.part != Part::Dark && p.points.len() > 2 && p.jump == 0.0;
    for place in places.iter().filter(calm) {
        let dark = darks.photodiode(place.time_s).0;
        let light = place.light() - dark;
        let sigma2 = noise.variance(place.light());
        let mean_readings =
            place.readings.iter().map(Vec::len).sum::<usize>() as f64 / place.readings.len() as f64;
        // Below ten standard deviations the light is noise more than anything.
        let is_bright = light > 10.0 * (sigma2 / mean_readings).sqrt();
        if !is_bright {
            continue;
        }
        let ratio: Vec<f64> = (place.exposures.iter().zip(place.points.windows(2)))
            .map(|((counts, s), p)| counts / s / (0.5 * (p[0] + p[1]) - dark))
            .collect();
        let n = ratio.len() as f64;
        let mean = ratio.iter().sum::<f64>() / n;
        let (counts, _) = place.counts();
        if counts < 20.0 * n {
            continue;
        }
        let own = n / counts + 0.5 * sigma2 / mean_readings / (light * light);
        let square: f64 = ratio.iter().map(|r| (r / mean - 1.0).powi(2)).sum();
        chi2 += square / own;
        freedom += n - 1.0;
        beyond += square / (n - 1.0) - own;
        number += 1.0;
    }
    let seen = chi2 > freedom + SEEN * (2.0 * freedom).sqrt();
    if seen && number > 0.0 { (beyond / number).max(0.0) } else { 0.0 }
}

const HEADER: &str = "wavelength_nm,photodiode_v,photodiode_dark_v,sigma_photodiode_v,counts,exposure_s,dark_counts,dark_exposure_s,drift_relative,sigma_drift_relative,drift_step,second_order\n";

/// Tables of a run's lines; `folder` holds the curves that the reduction names, as [`write()`] puts them there.
///
/// # Errors
/// No complete wavelength or dark reading; files of the folder.
pub fn make(plan: &RunPlan, lines: &[Line], folder: &Path) -> Result<Made, TableError> {
    let mut places = places(lines);
    let noise = Noise::of(&places);
    sudden_light(&mut places, noise);
    let of = |part: Part| places.iter().filter(move |p| p.part == part);
    let darks = Darks::of(&places, noise);
    if darks.at.is_empty() {
        return Err(TableError::None("dark"));
    }
    if of(Part::Step).next().is_none() {
        return Err(TableError::None("wavelength's"));
    }
    let unrest = unrest(&places, noise, &darks);
    let measuring = &plan.measuring;
    let row = |place: &Place, drift: Change| -> String {
        let at = match place.part {
            Part::Step => measuring.wavelengths.get(place.number as usize).copied(),
            _ => measuring.reference,
        };
        let (dark, dark_variance) = darks.photodiode(place.time_s);
        let (dark_counts, dark_s) = darks.counts(place.time_s);
        let light = place.light();
        let points: f64 = (place.weights().iter().zip(&place.readings))
            .map(|(w, r)| w * w / r.len().max(1) as f64)
            .sum();
        let own = noise.variance(light) * points;
        let unrest = unrest * (light - dark).powi(2) / place.exposures.len().max(1) as f64;
        let sigma = (own + dark_variance + unrest).sqrt();
        let (counts, exposure_s) = place.counts();
        // An exposure in which the light jumps at any time is off by as much as ±half of that, evenly.
        let jump = place.jump / (12.0_f64.sqrt() * place.exposures.len().max(1) as f64);
        let step = drift.is_step || place.jump != 0.0;
        // A missing reading has no uncertainty either: the reduction flags it.
        let sigma = if sigma.is_finite() { sigma } else { 0.0 };
        format!(
            "{},{light:e},{dark:e},{sigma:e},{counts},{exposure_s},{dark_counts},{dark_s},{:e},{:e},{},{}\n",
            place.wavelength_nm,
            drift.relative,
            drift.sigma.hypot(jump),
            u8::from(step),
            u8::from(at.is_some_and(|at| at.second_order)),
        )
    };
    let table = |part: Part, drift: Option<&Drift>| {
        let unit = measuring.meter.unit.name();
        let mut text = format!("# The photodiode's columns are in {unit}.\n{HEADER}");
        let mut rows: Vec<&Place> = of(part).collect();
        rows.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        for place in rows {
            text += &row(place, drift.map_or(Change::default(), |drift| drift.at(place.time_s)));
        }
        text
    };
    let mut references: Vec<&Place> = of(Part::Reference).collect();
    references.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let reference = (!references.is_empty()).then(|| table(Part::Reference, None));
    let drift = match &reference {
        Some(text) => drift(plan, text, &references, folder)?,
        None => None,
    };
    let lamp: Vec<f64> = (references.iter())
        .map(|p| p.light() - darks.photodiode(p.time_s).0)
        .filter(|light| light.is_finite())
        .collect();
    let lamp_range = range(&lamp);
    let mut warnings = Vec::new();
    let over = places.iter().filter(|p| p.is_over).count();
    if over > 0 {
        warnings.push(format!(
            "the photodiode's meter was over its range at {}: no efficiency there; choose a higher range",
            counted(over, "place")
        ));
    }
    if let Some(drift) = &drift {
        warnings.extend(said(drift, of(Part::Step), lamp_range));
    }
    let jumps = places.iter().filter(|p| p.jump != 0.0);
    let largest = jumps.clone().map(|p| p.jump.abs()).fold(0.0, f64::max);
    if largest > 0.0 {
        warnings.push(format!(
            "the light changed suddenly, by up to {:.1} %, during the exposures at {} (flag drift_step): it is in the uncertainty there; look at the lamp",
            100.0 * largest,
            counted(jumps.count(), "place")
        ));
    }
    if !darks.is_steady {
        warnings.push(
            "the sensor's dark rate changed in the run: each wavelength takes the dark readings next to it".into(),
        );
    }
    if unrest > 0.0 {
        warnings.push(format!(
            "the light changed by {:.2} % (standard deviation) from exposure to exposure, more than photons do: it is in the uncertainties",
            100.0 * unrest.sqrt()
        ));
    }
    Ok(Made {
        steps: of(Part::Step).count(),
        scan: table(Part::Step, drift.as_ref()),
        reference,
        drift,
        lamp_range,
        noise: noise.additive.sqrt(),
        unrest: unrest.sqrt(),
        warnings,
    })
}

/// Largest less least of numbers above 0, over their mean; 0 of none.
fn range(all: &[f64]) -> f64 {
    let most = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let least = all.iter().copied().fold(f64::INFINITY, f64::min);
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    if mean > 0.0 { (most - least) / mean } else { 0.0 }
}

/// Warnings about a drift.
fn said<'a>(
    drift: &Drift,
    steps: impl Iterator<Item = &'a Place> + Clone,
    lamp_range: f64,
) -> Vec<String> {
    let mut said = vec![];
    let (percent, lamp) = (100.0 * drift.range(), 100.0 * lamp_range);
    if drift.is_corrected() {
        said.push(format!(
            "the rig drifted: the efficiency at the reference wavelength changed by {percent:.2} % in the run (the lamp by {lamp:.1} %, which is in no efficiency). It was undone: all efficiencies are those at the first reading of the reference"
        ));
    }
    for step in drift.steps() {
        let between = |p: &&Place| (step.from_s..step.to_s).contains(&p.time_s);
        let count = steps.clone().filter(between).count();
        said.push(format!(
            "the rig changed suddenly, by {:.2} %, between {:.0} and {:.0} s of the run: {} between those readings of the reference (flag drift_step) {} half of that as uncertainty; look whether the lamp went out or something was moved, and read them again",
            100.0 * step.relative,
            step.from_s,
            step.to_s,
            counted(count, "wavelength"),
            if count == 1 { "has" } else { "have" }
        ));
    }
    let late = steps.filter(|p| p.time_s > drift.end_s()).count();
    if drift.is_corrected() && late > 0 {
        said.push(format!(
            "{} came after the last reading of the reference: the drift goes on unseen there, which is in the uncertainty",
            counted(late, "wavelength")
        ));
    }
    said
}

/// Change of the efficiency at the reference wavelength; none where less than two of its readings give one. `text` is the table of the readings, a row each.
fn drift(
    plan: &RunPlan,
    text: &str,
    places: &[&Place],
    folder: &Path,
) -> Result<Option<Drift>, TableError> {
    write_text(&folder.join(REFERENCE), text)?;
    let mut known = local(&plan.known).0;
    if let Some(set) = known.get_mut("set").and_then(|set| set.get_mut(0)) {
        set["readings"] = REFERENCE.into();
    }
    let document = Document::new(folder.join(RUN), known.to_string())?;
    let parts = read_run(&document)?;
    let mut points = Vec::new();
    for set in &parts.sets {
        for (reading, place) in set.readings.iter().zip(places) {
            let one = Set { readings: vec![*reading], ..set.clone() };
            let found = reduce(&[one], &parts.sensor)?;
            points.extend(found.rows.iter().filter(|row| row.efficiency > 0.0).map(|row| Point {
                time_s: place.time_s,
                ln: row.efficiency.ln(),
                sigma: (row.components.own() / row.efficiency).max(1e-12),
            }));
        }
    }
    Ok(Drift::new(points))
}

/// The run's file with its curves beside it, and the curves: name in the folder, path as the plan has it.
fn local(known: &toml::Table) -> (toml::Table, Vec<(String, PathBuf)>) {
    let mut copy = known.clone();
    let mut curves: Vec<(String, PathBuf)> = Vec::new();
    for (_, value) in copy.iter_mut() {
        localise(value, &mut curves);
    }
    (copy, curves)
}

fn localise(value: &mut toml::Value, curves: &mut Vec<(String, PathBuf)>) {
    match value {
        toml::Value::Array(all) => all.iter_mut().for_each(|one| localise(one, curves)),
        toml::Value::Table(table) => {
            for (key, value) in table.iter_mut() {
                let is_curve = matches!(key.as_str(), "curve" | "responsivity" | "linearity");
                match value {
                    toml::Value::String(path) if is_curve => {
                        let name = format!("{key}_{}.csv", curves.len() + 1);
                        curves.push((name.clone(), PathBuf::from(&*path)));
                        *path = name;
                    }
                    other => localise(other, curves),
                }
            }
        }
        _ => {}
    }
}

fn write_text(path: &Path, text: &str) -> Result<(), FileError> {
    std::fs::write(path, text).map_err(|error| FileError::io("write", path, error))
}

/// Writes the tables of a run's lines, the curves that they need and the reduction's file into the run's folder: what is there of an earlier time is made anew.
///
/// # Errors
/// The errors of [`make`]; the disk refuses.
pub fn write(plan: &RunPlan, lines: &[Line], folder: &Path) -> Result<Made, TableError> {
    let (known, curves) = local(&plan.known);
    let beside = plan.path.parent().unwrap_or(Path::new(""));
    for (name, path) in curves {
        let text = sunglint_formats::read::text(beside.join(path))?;
        write_text(&folder.join(name), &text)?;
    }
    let made = make(plan, lines, folder)?;
    write_text(&folder.join(STEPS), &made.scan)?;
    let mut text = String::new();
    let _ = write!(
        text,
        "# Made by `sunglint efficiency run` of readings.ecsv and plan.toml: `sunglint efficiency {RUN}` reduces it again.\n{known}"
    );
    write_text(&folder.join(RUN), &text)?;
    Ok(made)
}
