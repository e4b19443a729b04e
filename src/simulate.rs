//! `sunglint simulate`: what a pass should look like in every channel.

mod active;
pub(crate) mod figure;
mod report;

use crate::explain;
use crate::output::{Console, OutputArgs, Usage};
use crate::star::when;
use crate::station::StationArgs;
use anyhow::{Context as _, bail};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
pub(crate) use report::Cost;
use report::Report;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};
use sunglint_radiometry::station::Laser;
use sunglint_report::Product;
use sunglint_simulator::attitude::Attitude;
use sunglint_simulator::pass::{Overrides, Pass, PassFile, Progress, Simulation, Stage};
use sunglint_simulator::target::Shape;

/// What takes longer shows its progress.
const PATIENCE: Duration = Duration::from_secs(1);

/// Arguments of `sunglint simulate`.
#[derive(Debug, Args)]
pub struct SimulateArgs {
    /// The scene: target, orbit, attitude, station, times (docs/pass.md)
    pub pass: PathBuf,
    /// First moment, in place of the file's: UTC, ISO 8601, or `now`
    #[arg(long, value_name = "TIME")]
    pub from: Option<String>,
    /// Last moment, in place of the file's
    #[arg(long, value_name = "TIME")]
    pub to: Option<String>,
    /// Seconds between samples, in place of the file's
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub step_s: Option<f64>,
    /// Model what may change the light by more than this: `0.2%` or `0.002`, in place of the file's [default: 0.1%]
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true, value_parser = explain::tolerance)]
    pub tolerance: Option<f64>,
    /// Add the returns of the station's lasers (`[[laser]]` in station.toml or PASS.toml, docs/active.md)
    #[arg(long)]
    pub active: bool,
    /// Of this laser alone; may be given several times
    #[arg(long, value_name = "NAME", requires = "active")]
    pub laser: Vec<String>,
    /// Which station, in place of the file's.
    #[command(flatten)]
    pub station: StationArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Simulates a pass.
pub fn run(args: &SimulateArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    if let Some(step_s) = args.step_s
        && !(step_s.is_finite() && step_s > 0.0)
    {
        return Err(Usage(format!("--step-s is {step_s}, expected seconds above 0")).into());
    }
    let time = |option: &str, text: &Option<String>| {
        text.as_deref().map(when).transpose().with_context(|| option.to_owned())
    };
    let overrides = Overrides {
        station: None,
        from: time("--from", &args.from)?,
        to: time("--to", &args.to)?,
        step_s: args.step_s,
        tolerance: args.tolerance,
    };
    let pass = read(&args.pass, &args.station, overrides)?;
    args.out.check_names(&[format!("{}.ecsv", pass.name)])?;
    let lasers = if args.active { active::lasers(&pass, &args.laser)? } else { Vec::new() };
    let shown = show(&pass, &args.pass.display().to_string(), &lasers, console)?;
    if !shown.has_light && args.out.output.iter().any(|p| is_picture(p)) {
        bail!(
            "{}: there is no light to draw in any sample (see the warnings); write a table instead",
            args.pass.display()
        );
    }
    args.out.finish(&shown.product, &shown.text, console)
}

/// Reads a scene file and what it names; the station is the one that is asked for, else the file's, else the usual one.
pub(crate) fn read(
    path: &Path,
    station: &StationArgs,
    overrides: Overrides,
) -> anyhow::Result<Pass> {
    let file = PassFile::read(path)?;
    let station = if station.station.is_some() {
        Some(station.get()?)
    } else if file.names_station() {
        None
    } else {
        Some(station.get_or(&format!("(or name one in [station] of {})", path.display()))?)
    };
    Ok(file.resolve(Overrides { station, ..overrides })?)
}

/// A pass, simulated and ready to be written.
struct Shown {
    /// Tables, figures and summary.
    pub product: Product,
    /// The summary as text.
    pub text: String,
    /// Whether any sample has light.
    pub has_light: bool,
}

/// Simulates a pass, with the returns of some lasers, and says on stderr what a person should hear of; `name` is that of its file.
fn show(pass: &Pass, name: &str, lasers: &[&Laser], console: Console) -> anyhow::Result<Shown> {
    let clock = Clock::new(pass.times.len(), console);
    let simulation =
        pass.simulate(&|progress| clock.tell(progress)).with_context(|| name.to_owned())?;
    let cost = clock.cost();
    let mut warnings = pass.warnings.clone();
    warnings.extend(concerns(pass, &simulation));
    warnings.extend(of_times(pass));
    for warning in &warnings {
        console.warn(warning);
    }
    for (part, note) in &pass.station.notes {
        console.detail(&format!("{}, {part}: {note}", pass.station.name));
    }
    console.detail(&simulation.places[0].orientation.to_string());
    for material in &pass.target.materials {
        console.detail(&format!("material {}", material.describe()));
    }
    let report = Report { simulation: &simulation, cost, warnings: &warnings };
    let (product, text) = (report.product()?, report.text());
    let mut shown = Shown { product, text, has_light: simulation.has_light() };
    if !lasers.is_empty() {
        active::add(&mut shown, &simulation, lasers, console)?;
    }
    Ok(shown)
}

fn is_picture(path: &std::path::Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png") || e.eq_ignore_ascii_case("svg"))
}

/// What a person should hear of before believing the numbers.
pub(crate) fn concerns(pass: &Pass, simulation: &Simulation) -> Vec<String> {
    let mut concerns = simulation.scene.warnings.clone();
    concerns.extend(explain::concerns(&simulation.needs));
    let round = |shape: &Shape| matches!(shape, Shape::Sphere { .. });
    let turned =
        !pass.target.parts.iter().all(|p| round(&p.shape)) || !pass.target.hinges.is_empty();
    if turned && !pass.attitude_given && matches!(pass.attitude, Attitude::Inertial(_)) {
        concerns.push("no [attitude] is given: the body stands still among the stars, its axes along those of the GCRS".into());
    }
    let places = &simulation.places;
    let orientation = places.iter().map(|p| p.orientation).find(|o| o.is_outside());
    concerns.extend(orientation.map(|o| format!("{o} ([earth_orientation] file = \"FILE\")")));
    if places.iter().all(|p| p.hidden) {
        let height = |p: &&sunglint_simulator::pass::Place| p.geometry.horizontal.altitude_deg();
        if let Some(best) = places.iter().max_by(|a, b| height(a).total_cmp(&height(b))) {
            concerns.push(format!(
                "{} is never above the horizon of {} in these times: at its highest, {}, it stands at {:+.2}° (the horizon there is at {:.1}°); take other times or another station",
                pass.orbit.name(),
                pass.station.name,
                sunglint_formats::time::format_utc(best.geometry.epoch, 1),
                height(&best),
                pass.station.horizon.elevation_deg(best.geometry.horizontal.azimuth_deg()),
            ));
        }
    }
    if places.iter().all(|p| p.sunlit == 0.0) {
        concerns.push(format!(
            "{} is in the Earth's shadow all the time: the Sun stands behind the Earth, and every rate is 0 (flag eclipsed)",
            pass.orbit.name()
        ));
    }
    let day = places.iter().filter(|p| !p.hidden && p.sun_altitude_deg > -6.0).count();
    if day > 0 {
        concerns.push(format!(
            "in {day} of the visible samples the Sun is above -6° at {}: the sky is bright, and its light is not in the rates",
            pass.station.name
        ));
    }
    for channel in &simulation.channels {
        let saturated = channel.predicted.iter().filter(|p| p.saturated).count();
        if saturated > 0 {
            concerns
                .push(format!("{}: {saturated} samples past saturation: attenuate", channel.name));
        }
        let uncovered = channel.uncovered_nm.iter().copied().fold(0.0, f64::max);
        if uncovered > 0.0 {
            concerns.push(format!(
                "{}: for {uncovered:.0} nm of it sunlight, a material or the air is not tabulated (flag extrapolated)",
                channel.name
            ));
        }
    }
    concerns
}

/// Times that are probably not meant so.
fn of_times(pass: &Pass) -> Vec<String> {
    let steps_s: Vec<f64> = pass.times.windows(2).map(|p| (p[1] - p[0]).to_seconds()).collect();
    let mut concerns = Vec::new();
    if let Some(i) = steps_s.iter().position(|s| *s <= 0.0) {
        let what = if steps_s[i] == 0.0 { "is that of sample" } else { "is before that of sample" };
        concerns.push(format!(
            "the times do not increase: that of sample {} ({}) {what} {}; the result keeps their order",
            i + 2,
            sunglint_formats::time::format_utc(pass.times[i + 1], 3),
            i + 1
        ));
    } else if let Some(i) =
        steps_s.iter().zip(&pass.exposure_s).position(|(s, e)| *e > s * (1.0 + 1e-6))
    {
        concerns.push(format!(
            "exposures are longer than the step between them ({} s and {:.6} s at sample {}): each sample is that of its mid-exposure, and they overlap",
            pass.exposure_s[i],
            steps_s[i],
            i + 1
        ));
    }
    concerns
}

/// Measures what each stage costs, and shows how far the simulation is where that takes long.
pub(crate) struct Clock {
    start: Instant,
    stages: Mutex<Vec<(Stage, Instant)>>,
    bar: Mutex<Option<ProgressBar>>,
    epochs: usize,
    quiet: bool,
}

impl Clock {
    pub(crate) fn new(epochs: usize, console: Console) -> Self {
        let (stages, bar) = (Mutex::default(), Mutex::default());
        Self { start: Instant::now(), stages, bar, epochs, quiet: console.quiet }
    }

    pub(crate) fn tell(&self, progress: Progress) {
        // A lock that a panicking thread left holds nothing that could be wrong.
        let mut stages = self.stages.lock().unwrap_or_else(|e| e.into_inner());
        if stages.last().is_none_or(|(stage, _)| *stage != progress.stage) {
            stages.push((progress.stage, Instant::now()));
        }
        drop(stages);
        if self.quiet || self.start.elapsed() < PATIENCE {
            return;
        }
        let mut bar = self.bar.lock().unwrap_or_else(|e| e.into_inner());
        // Hidden where stderr is no terminal.
        let bar = bar.get_or_insert_with(|| {
            let style = ProgressStyle::with_template("{msg:>8} {wide_bar} {pos}/{len} {eta}");
            let bar = ProgressBar::new(progress.of as u64);
            if let Ok(style) = style { bar.with_style(style) } else { bar }
        });
        bar.set_message(progress.stage.name());
        bar.set_position(progress.done as u64);
        if progress.stage == Stage::Done {
            bar.finish_and_clear();
        }
    }

    pub(crate) fn cost(&self) -> Cost {
        let stages = self.stages.lock().unwrap_or_else(|e| e.into_inner());
        let seconds = |pair: &[(Stage, Instant)]| {
            (pair[0].0, pair[1].1.duration_since(pair[0].1).as_secs_f64())
        };
        let stages: Vec<(Stage, f64)> = stages.windows(2).map(seconds).collect();
        let total_s = stages.iter().map(|(_, s)| s).sum();
        Cost { stages, total_s, epochs: self.epochs, threads: rayon::current_num_threads() }
    }
}
