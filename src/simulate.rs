//! `sunglint simulate`: what a pass should look like in every channel.

mod active;

use crate::explain;
use crate::output::{Console, OutputArgs, Usage};
use crate::star::when;
use crate::station::StationArgs;
use anyhow::{Context as _, bail};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};
use sunglint_radiometry::station::Laser;
use sunglint_report::Product;
use sunglint_report::simulate::SimulationReport;
use sunglint_simulator::pass::{Cost, Overrides, Pass, PassFile, Progress, Stage, Stopwatch};

/// Time after which work shows its progress.
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
    /// Work that an epoch's light between surfaces may cost, in place of the file's [default: 0.01]
    #[arg(long, value_name = "CPU_S", allow_negative_numbers = true, value_parser = explain::budget)]
    pub budget: Option<f64>,
    /// Add the degree of linear polarisation of the light, and its direction (docs/polarisation.md)
    #[arg(long)]
    pub polarisation: bool,
    /// Add the returns of the station's lasers (`[[laser]]` in station.toml or PASS.toml, docs/active.md)
    #[arg(long)]
    pub active: bool,
    /// Only this laser; may be given several times
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
        from: time("--from", &args.from)?,
        to: time("--to", &args.to)?,
        step_s: args.step_s,
        tolerance: args.tolerance,
        budget_s: args.budget,
        ..Overrides::default()
    };
    let pass = read(&args.pass, &args.station, overrides)?;
    args.out.check_names(&[format!("{}.ecsv", pass.name)])?;
    let lasers = if args.active { active::lasers(&pass, &args.laser)? } else { Vec::new() };
    let shown = show(&pass, &args.pass.display().to_string(), args.polarisation, &lasers, console)?;
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
fn show(
    pass: &Pass,
    name: &str,
    polarised: bool,
    lasers: &[&Laser],
    console: Console,
) -> anyhow::Result<Shown> {
    let clock = Clock::new(pass.times.len(), console);
    let simulation =
        pass.simulate(&|progress| clock.tell(progress)).with_context(|| name.to_owned())?;
    let cost = clock.cost();
    let mut warnings = pass.warnings.clone();
    warnings.extend(simulation.concerns());
    warnings.extend(pass.concerns_of_times());
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
    let material = simulation.material_doubt(&|_| {}).with_context(|| name.to_owned())?;
    let polarisation = match polarised {
        true => Some(simulation.polarisation(&|_| {}).with_context(|| name.to_owned())?),
        false => None,
    };
    let warnings = &warnings;
    let report =
        SimulationReport { simulation: &simulation, material, polarisation, cost, warnings };
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

/// Measures what each stage costs, and shows how far the simulation is where that takes long.
pub(crate) struct Clock {
    start: Instant,
    watch: Stopwatch,
    bar: Mutex<Option<ProgressBar>>,
    quiet: bool,
}

impl Clock {
    pub(crate) fn new(epochs: usize, console: Console) -> Self {
        let (watch, bar) = (Stopwatch::new(epochs), Mutex::default());
        Self { start: Instant::now(), watch, bar, quiet: console.quiet }
    }

    pub(crate) fn tell(&self, progress: Progress) {
        self.watch.tell(progress);
        if self.quiet || self.start.elapsed() < PATIENCE {
            return;
        }
        // A lock that a panicking thread left holds nothing that could be wrong.
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
        self.watch.cost()
    }
}
