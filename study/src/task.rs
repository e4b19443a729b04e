//! One task: a point of the study, for one object; simulated and summarised.

use crate::Study;
use crate::file::Passes;
use crate::table::{Cell, Columns, Kind, Rows};
use hifitime::Epoch;
use std::ops::Range;
use sunglint_ephemeris::orbit::{Orbit, TleOrbit};
use sunglint_ephemeris::passes::Search;
use sunglint_simulator::pass::{Alike, BANDS, Simulation};

/// Samples of a task at most: more are a slip of the step.
pub const MOST_SAMPLES: usize = 1_000_000;

/// A point's scene, and where its passes are looked for: shared by its tasks.
pub struct Scene {
    alike: Alike,
    search: Option<Search>,
}

impl Scene {
    /// Makes the scene of a point.
    ///
    /// # Errors
    /// The scene's fault, in words.
    pub fn new(study: &Study, point: usize) -> Result<Self, String> {
        let pass = study.pass(point)?;
        let channels: Vec<&str> = pass.station.channels.iter().map(|c| c.name.as_str()).collect();
        if channels != study.channels.iter().map(String::as_str).collect::<Vec<_>>() {
            return Err(format!(
                "the station's channels are {}, those of the first point {}: a study has the same columns for all",
                channels.join(", "),
                study.channels.join(", ")
            ));
        }
        let search = match &study.passes {
            None => None,
            Some(Passes { window, conditions, .. }) => {
                let (station, orientation) = (&pass.station, pass.orientation());
                let search =
                    Search::new(&station.site, &station.horizon, *window, *conditions, orientation);
                Some(search.map_err(|e| e.to_string())?)
            }
        };
        Ok(Self { alike: Alike::new(pass), search })
    }
}

/// Rows of a task, in its tables.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outcome {
    /// A row a pass; one without samples where there is none, or where it failed.
    pub summary: Rows,
    /// A row a sample, where these are kept.
    pub samples: Rows,
    /// Whether the task failed.
    pub failed: bool,
}

/// Columns of the summary.
pub fn summary_columns(study: &Study) -> Columns {
    let mut columns: Columns = Vec::new();
    let mut add = |name: &str, kind| columns.push((name.to_owned(), kind));
    add("task", Kind::Integer);
    add("pass", Kind::Integer);
    study.parameters.iter().zip(&study.kinds).for_each(|(name, kind)| add(name, *kind));
    if study.passes.is_some() {
        add("norad_id", Kind::Integer);
        add("object", Kind::Text);
    }
    for (name, kind) in [
        ("status", Kind::Text),
        ("message", Kind::Text),
        ("from_utc", Kind::Time),
        ("to_utc", Kind::Time),
        ("samples", Kind::Integer),
        ("over_tolerance", Kind::Integer),
        ("highest_deg", Kind::Number),
        ("nearest_m", Kind::Number),
        ("brightest_utc", Kind::Time),
        ("brightest_v_mag", Kind::Number),
        ("brightest_v_error_mag", Kind::Number),
        ("brightest_phase_deg", Kind::Number),
        ("brightest_range_m", Kind::Number),
    ] {
        add(name, kind);
    }
    for channel in &study.channels {
        add(&format!("{channel}_most_hz"), Kind::Number);
        add(&format!("{channel}_most_error_hz"), Kind::Number);
        add(&format!("{channel}_mean_hz"), Kind::Number);
    }
    columns
}

/// Columns of the samples.
pub fn sample_columns(study: &Study) -> Columns {
    let mut columns: Columns = Vec::new();
    let mut add = |name: &str, kind| columns.push((name.to_owned(), kind));
    for (name, kind) in [
        ("task", Kind::Integer),
        ("pass", Kind::Integer),
        ("time_utc", Kind::Time),
        ("range_m", Kind::Number),
        ("altitude_deg", Kind::Number),
        ("azimuth_deg", Kind::Number),
        ("phase_deg", Kind::Number),
        ("sunlit", Kind::Number),
        ("v_mag", Kind::Number),
        ("v_error_mag", Kind::Number),
        ("flags", Kind::Integer),
    ] {
        add(name, kind);
    }
    for channel in &study.channels {
        add(&format!("{channel}_rate_hz"), Kind::Number);
        add(&format!("{channel}_error_hz"), Kind::Number);
    }
    columns
}

/// Runs a task with its point's scene. What fails is a row that says why: the study goes on.
pub fn run(study: &Study, task: usize, scene: &Result<Scene, String>) -> Outcome {
    match scene.as_ref().map_err(Clone::clone).and_then(|scene| simulated(study, task, scene)) {
        Ok(outcome) => outcome,
        Err(why) => failed(study, task, why),
    }
}

/// The outcome of a task that failed: a row that says why.
pub fn failed(study: &Study, task: usize, why: String) -> Outcome {
    Outcome {
        summary: vec![without_samples(study, task, "failed", Some(why))],
        failed: true,
        ..Outcome::default()
    }
}

fn simulated(study: &Study, task: usize, scene: &Scene) -> Result<Outcome, String> {
    let (_, object) = study.task(task);
    let progress = |_| ();
    let (Some(passes), Some(search)) = (&study.passes, &scene.search) else {
        let simulation = scene.alike.pass().simulate(&progress).map_err(|e| e.to_string())?;
        let all = 0..simulation.places.len();
        return Ok(outcome(study, task, &simulation, vec![all]));
    };
    let orbit = TleOrbit::new(passes.objects[object].clone()).map_err(|e| e.to_string())?;
    let orbit = Orbit::from(orbit);
    let (times, spans) = visible(passes, search, &orbit)?;
    if times.is_empty() {
        let row = without_samples(study, task, "no pass", None);
        return Ok(Outcome { summary: vec![row], ..Outcome::default() });
    }
    let exposure_s = vec![passes.exposure_s; times.len()];
    (scene.alike)
        .simulate(orbit, times, exposure_s, &progress, |s| outcome(study, task, s, spans))
        .map_err(|e| e.to_string())
}

/// The rows of a simulation, of which each span is a pass.
fn outcome(
    study: &Study,
    task: usize,
    simulation: &Simulation<'_>,
    spans: Vec<Range<usize>>,
) -> Outcome {
    let mut outcome = Outcome::default();
    for (number, span) in spans.into_iter().enumerate() {
        outcome.summary.push(summarised(study, task, number, simulation, span.clone()));
        if study.keeps_samples {
            outcome.samples.extend(span.map(|i| sample(task, number, simulation, i)));
        }
    }
    outcome
}

/// Moments at which an object can be seen, and which of them belong to which pass.
fn visible(
    passes: &Passes,
    search: &Search,
    orbit: &Orbit,
) -> Result<(Vec<Epoch>, Vec<Range<usize>>), String> {
    let found = search.passes(orbit);
    if let (Some((when, why)), true) = (&found.ended, found.passes.is_empty()) {
        let when = sunglint_formats::time::format_utc(*when, 0);
        return Err(format!("no place from {when} on: {why}"));
    }
    let (mut times, mut parts) = (Vec::new(), Vec::new());
    for pass in &found.passes {
        let from = times.len();
        for span in &pass.visible {
            let steps = (span.seconds() / passes.step_s).floor();
            if times.len() as f64 + steps >= MOST_SAMPLES as f64 {
                return Err(format!(
                    "more than {MOST_SAMPLES} samples: [passes] step_s = {} is too short for this object",
                    passes.step_s
                ));
            }
            times.extend(
                (0..=steps as u64).map(|i| {
                    span.from + hifitime::Duration::from_seconds(i as f64 * passes.step_s)
                }),
            );
        }
        if times.len() > from {
            parts.push(from..times.len());
        }
    }
    Ok((times, parts))
}

/// Nanoseconds of UTC after 1970: a leap second repeats the one before.
fn moment(epoch: Epoch) -> Cell {
    let nanoseconds = epoch.to_unix_duration().total_nanoseconds();
    i64::try_from(nanoseconds).map_or(Cell::None, Cell::Integer)
}

fn count(n: usize) -> Cell {
    i64::try_from(n).map_or(Cell::None, Cell::Integer)
}

/// The first cells of a task's row.
fn head(study: &Study, task: usize, pass: Cell) -> Vec<Cell> {
    let (point, object) = study.task(task);
    let mut row = vec![count(task), pass];
    for (value, kind) in study.points[point].iter().zip(&study.kinds) {
        row.push(match kind {
            Kind::Number => value.number().map_or(Cell::None, Cell::Number),
            _ => Cell::Text(value.to_string()),
        });
    }
    if let Some(passes) = &study.passes {
        let object = &passes.objects[object];
        row.push(Cell::Integer(object.norad_id.into()));
        row.push(object.name.clone().map_or(Cell::None, Cell::Text));
    }
    row
}

fn without_samples(study: &Study, task: usize, status: &str, why: Option<String>) -> Vec<Cell> {
    let mut row = head(study, task, Cell::None);
    row.push(Cell::Text(status.into()));
    row.push(why.map_or(Cell::None, Cell::Text));
    row.resize(summary_columns(study).len(), Cell::None);
    row
}

/// V's place in [`BANDS`].
fn v() -> usize {
    BANDS.iter().position(|band| *band == "V").unwrap_or(0)
}

fn summarised(
    study: &Study,
    task: usize,
    number: usize,
    simulation: &Simulation<'_>,
    span: Range<usize>,
) -> Vec<Cell> {
    let places = &simulation.places;
    let seen: Vec<usize> = span.clone().filter(|i| !places[*i].hidden).collect();
    let magnitudes = simulation.magnitudes.column(v());
    let brightest = (seen.iter().copied())
        .filter(|i| magnitudes[*i].is_finite())
        .min_by(|a, b| magnitudes[*a].total_cmp(&magnitudes[*b]));
    let least = |value: &dyn Fn(usize) -> f64| {
        let least = seen.iter().map(|i| value(*i)).fold(f64::INFINITY, f64::min);
        Cell::Number(if least.is_finite() { least } else { f64::NAN })
    };
    let nearest = least(&|i| places[i].geometry.range_m);
    let highest = match least(&|i| -places[i].geometry.horizontal.altitude_deg()) {
        Cell::Number(lowest) => Cell::Number(-lowest),
        other => other,
    };
    let at = |value: &dyn Fn(usize) -> Cell| brightest.map_or(Cell::None, value);
    let times = &simulation.pass.times;
    let at_ns = |i: &usize| sunglint_formats::time::tai_nanoseconds(times[*i]);
    let (first, last) = (span.clone().min_by_key(at_ns), span.clone().max_by_key(at_ns));
    let mut row = head(study, task, count(number));
    row.extend([
        Cell::Text("done".into()),
        Cell::None,
        first.map_or(Cell::None, |i| moment(times[i])),
        last.map_or(Cell::None, |i| moment(times[i])),
        count(span.len()),
        count(span.clone().filter(|i| simulation.over_tolerance(*i).is_some()).count()),
        highest,
        nearest,
        at(&|i| moment(times[i])),
        at(&|i| Cell::Number(magnitudes[i])),
        at(&|i| finite(simulation.magnitude_errors[[i, v()]])),
        at(&|i| Cell::Number(places[i].geometry.phase_deg())),
        at(&|i| Cell::Number(places[i].geometry.range_m)),
    ]);
    for channel in &simulation.channels {
        let rates = &channel.rate_hz;
        let seen = || seen.iter().copied().filter(|i| rates[*i].is_finite());
        let most = seen().max_by(|a, b| rates[*a].total_cmp(&rates[*b]));
        let sum: f64 = seen().map(|i| rates[i]).sum();
        row.push(most.map_or(Cell::None, |i| Cell::Number(rates[i])));
        row.push(most.map_or(Cell::None, |i| finite(channel.error_hz[i])));
        row.push(most.map_or(Cell::None, |_| Cell::Number(sum / seen().count() as f64)));
    }
    row
}

/// A number; no value where it is infinite: nothing is known there.
fn finite(number: f64) -> Cell {
    if number.is_finite() { Cell::Number(number) } else { Cell::None }
}

fn sample(task: usize, number: usize, simulation: &Simulation<'_>, i: usize) -> Vec<Cell> {
    let place = &simulation.places[i];
    let horizontal = place.geometry.horizontal;
    let mut row = vec![
        count(task),
        count(number),
        moment(simulation.pass.times[i]),
        Cell::Number(place.geometry.range_m),
        Cell::Number(horizontal.altitude_deg()),
        Cell::Number(horizontal.azimuth_deg()),
        Cell::Number(place.geometry.phase_deg()),
        Cell::Number(place.sunlit),
        finite(simulation.magnitudes[[i, v()]]),
        finite(simulation.magnitude_errors[[i, v()]]),
        Cell::Integer(i64::from(simulation.flags(i).bits())),
    ];
    for channel in &simulation.channels {
        row.push(Cell::Number(channel.rate_hz[i]));
        row.push(finite(channel.error_hz[i]));
    }
    row
}
