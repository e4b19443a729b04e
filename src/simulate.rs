//! `sunglint simulate`: what a pass should look like in every channel.

mod active;

use crate::explain;
use crate::output::{Console, Made, MadeFile, OutputArgs, Target, Usage, clean_up_on_signals};
use crate::star::when;
use crate::station::StationArgs;
use anyhow::{Context as _, bail};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};
use sunglint_formats::Table;
use sunglint_radiometry::light_curve::SpectralFile;
use sunglint_radiometry::station::Laser;
use sunglint_report::simulate::{Gathered, SimulationReport, names};
use sunglint_report::{Format, Product, TableRows};
use sunglint_simulator::pass::{
    Cost, Extras, Overrides, Pass, PassError, PassFile, Piece, Progress, Stage, Stopwatch,
};

/// Time after which work shows its progress.
const PATIENCE: Duration = Duration::from_secs(1);
/// Epochs of a piece at most, and values of its spectra: some 25 MB with all that is made of it.
const PIECE_EPOCHS: usize = 2048;
const PIECE_BINS: usize = 400_000;

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
    /// Model what may change the light by more than this: `0.2%` or `0.002`, in place of the file's [default: 0.1%; of a table of single observations 1%]
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
    /// Epochs that are computed and written at once, for tests: results do not depend on it
    #[arg(long, hide = true, value_name = "EPOCHS")]
    pub piece_epochs: Option<NonZeroUsize>,
    /// Which station, in place of the file's.
    #[command(flatten)]
    pub station: StationArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Simulates a pass; detections of range data are drawn from the seed.
pub fn run(args: &SimulateArgs, seed: u64, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    let (out, ranges) = args.out.parted(active::is_range_data);
    out.check()?;
    ranges.check_targets(ranges.output.iter().map(PathBuf::as_path))?;
    if let Some(path) = ranges.output.first().filter(|_| !args.active) {
        let text = format!("-o {}: range data need --active", path.display());
        return Err(Usage(text).into());
    }
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
    let [curve, geometry, spectra] = names(&pass);
    out.check_names(&[
        format!("{curve}.ecsv"),
        format!("{geometry}.ecsv"),
        format!("{spectra}.fits"),
    ])?;
    let lasers = if args.active { active::lasers(&pass, &args.laser)? } else { Vec::new() };
    if !ranges.output.is_empty() {
        active::check_ranging(&lasers, console)?;
    }
    clean_up_on_signals()?;
    let name = args.pass.display().to_string();
    let asked = Asked { args, seed, out: &out, ranges: &ranges.output, lasers: &lasers };
    let shown = show(&pass, &name, &asked, console)?;
    if !shown.has_light && out.output.iter().any(|p| is_picture(p)) {
        bail!(
            "{}: there is no light to draw in any sample (see the warnings); write a table instead",
            args.pass.display()
        );
    }
    out.finish_made(&shown.product, shown.made, shown.ranges, &shown.text, console)
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
    /// Figures and summary.
    pub product: Product,
    /// Tables.
    pub made: Made,
    /// Files of range data.
    pub ranges: Vec<(PathBuf, Vec<u8>)>,
    /// The summary as text.
    pub text: String,
    /// Whether any sample has light.
    pub has_light: bool,
}

/// Epochs of a piece, where nobody asks for another number.
fn piece(pass: &Pass, asked: Option<NonZeroUsize>, lasers: &[&Laser]) -> NonZeroUsize {
    let usual = || NonZeroUsize::new((PIECE_BINS / pass.bins().max(1)).clamp(16, PIECE_EPOCHS));
    // What comes back of pulses is told of all epochs together.
    let epochs = if lasers.is_empty() { asked.or_else(usual) } else { None };
    epochs.or_else(|| NonZeroUsize::new(pass.times.len())).unwrap_or(NonZeroUsize::MIN)
}

/// Options of a simulation, with the files of range data apart from the others.
struct Asked<'a> {
    args: &'a SimulateArgs,
    seed: u64,
    out: &'a OutputArgs,
    ranges: &'a [PathBuf],
    lasers: &'a [&'a Laser],
}

/// Simulates a pass, with the returns of some lasers, writes its tables as they are made, and says on stderr what a person should hear of; `name` is that of its file.
fn show(pass: &Pass, name: &str, asked: &Asked<'_>, console: Console) -> anyhow::Result<Shown> {
    let Asked { args, seed, out, ranges, lasers } = *asked;
    let polarised = args.polarisation;
    let clock = Clock::new(pass.times.len(), console);
    let epochs = piece(pass, args.piece_epochs, lasers);
    if !lasers.is_empty() {
        active::warn_of_memory(pass, lasers, console);
    }
    let mut gathered = Gathered::new(pass);
    let mut files = Files::new(pass, out, lasers.is_empty())?;
    let mut returned = None;
    let extras = Extras { material: true, polarisation: polarised };
    let bounds = pass.simulate_in_pieces_with(
        epochs,
        extras,
        &|progress| clock.tell(progress),
        |piece| -> Result<(), Stopped> {
            gathered.add(piece);
            files.push(pass, piece).map_err(Stopped::Files)?;
            if !lasers.is_empty() {
                returned = Some(
                    active::of(piece.simulation, lasers, (ranges, seed)).map_err(Stopped::Files)?,
                );
            }
            Ok(())
        },
    );
    let bounds = bounds.map_err(|stopped| match stopped {
        Stopped::Pass(error) => anyhow::Error::from(error).context(name.to_owned()),
        Stopped::Files(error) => error,
    })?;
    let cost = clock.cost();
    let totals = &gathered.totals;
    let mut warnings = pass.warnings.clone();
    warnings.extend(totals.concerns());
    warnings.extend(pass.concerns_of_times());
    for warning in &warnings {
        console.warn(warning);
    }
    for (part, note) in &pass.station.notes {
        console.detail(&format!("{}, {part}: {note}", pass.station.name));
    }
    if let Some(orientation) = &totals.orientation {
        console.detail(&orientation.to_string());
    }
    for material in &pass.target.materials {
        console.detail(&format!("material {}", material.describe()));
    }
    let report =
        SimulationReport { gathered: &gathered, polarised, bounds, cost, warnings: &warnings };
    let (product, text) = (report.product(), report.text());
    let mut shown = Shown {
        product,
        made: files.made()?,
        ranges: Vec::new(),
        text,
        has_light: totals.has_light,
    };
    if let Some(returned) = returned {
        active::add(&mut shown, returned, console);
    }
    Ok(shown)
}

/// Why a simulation ended early.
enum Stopped {
    Pass(PassError),
    Files(anyhow::Error),
}

impl From<PassError> for Stopped {
    fn from(error: PassError) -> Self {
        Self::Pass(error)
    }
}

/// Tables of a pass in the files that want them, written piece by piece.
struct Files<'a> {
    out: &'a OutputArgs,
    made: Made,
    rates: Vec<(Target, Format)>,
    geometry: Vec<(Target, Format)>,
    spectra: Vec<(Target, Format)>,
    begun: Option<Begun>,
}

struct Begun {
    rates: Vec<TableRows<MadeFile>>,
    geometry: Vec<TableRows<MadeFile>>,
    spectra: Vec<(String, SpectralFile<MadeFile>)>,
}

impl<'a> Files<'a> {
    /// `alone`: whether a file that is named itself gets the light curve, or the spectra.
    fn new(pass: &Pass, out: &'a OutputArgs, alone: bool) -> anyhow::Result<Self> {
        let [rates, geometry, spectra] = names(pass);
        let of = |forms: &'static [Format]| if alone { forms } else { &[] };
        Ok(Self {
            out,
            made: Made::default(),
            rates: out.streams(&rates, Format::Ecsv, of(&[Format::Ecsv, Format::Csv]))?,
            geometry: out.streams(&geometry, Format::Ecsv, &[])?,
            spectra: out.streams(&spectra, Format::Fits, of(&[Format::Fits]))?,
            begun: None,
        })
    }

    fn begin(&mut self, pass: &Pass, piece: &Piece<'_>) -> anyhow::Result<Begun> {
        let (out, made) = (self.out, &mut self.made);
        let mut tables = |wanted: &[(Target, Format)]| {
            let begin = |(target, format): &(Target, Format)| {
                Ok(TableRows::new(out.begin(target, made)?, *format))
            };
            wanted.iter().map(begin).collect::<anyhow::Result<Vec<_>>>()
        };
        let (rates, geometry) = (tables(&self.rates)?, tables(&self.geometry)?);
        let mut spectra = Vec::new();
        for (target, _) in &self.spectra {
            let file = self.out.begin(target, &mut self.made)?;
            let place = file.place();
            let curve = sunglint_report::simulate::spectra(piece);
            let file = SpectralFile::begin(&curve, &pass.times, file)
                .with_context(|| format!("cannot write {place}"))?;
            spectra.push((place, file));
        }
        Ok(Begun { rates, geometry, spectra })
    }

    fn push(&mut self, pass: &Pass, piece: &Piece<'_>) -> anyhow::Result<()> {
        let mut begun = match self.begun.take() {
            Some(begun) => begun,
            None => self.begin(pass, piece)?,
        };
        let all = |files: &mut [TableRows<MadeFile>], table: Table| {
            files.iter_mut().try_for_each(|file| {
                let written = file.push(&table);
                written.with_context(|| format!("cannot write {}", file.get_ref().place()))
            })
        };
        if !begun.rates.is_empty() {
            all(&mut begun.rates, sunglint_report::simulate::rates(piece)?)?;
        }
        if !begun.geometry.is_empty() {
            all(&mut begun.geometry, sunglint_report::simulate::geometry(piece))?;
        }
        if !begun.spectra.is_empty() {
            let curve = sunglint_report::simulate::spectra(piece);
            for (place, file) in &mut begun.spectra {
                file.push(&curve).with_context(|| format!("cannot write {place}"))?;
            }
        }
        self.begun = Some(begun);
        Ok(())
    }

    /// The files, with all that belongs into them.
    fn made(mut self) -> anyhow::Result<Made> {
        if let Some(begun) = self.begun.take() {
            let tables = begun.rates.into_iter().chain(begun.geometry);
            tables.for_each(|file| self.made.add(file.into_inner()));
            for (place, file) in begun.spectra {
                let file = file.finish().with_context(|| format!("cannot write {place}"))?;
                self.made.add(file);
            }
        }
        Ok(self.made)
    }
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
