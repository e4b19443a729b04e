//! `sunglint fit`: what a simulation must be like for it to look as what was measured.
//!
//! [`sunglint_inference::fit`] fits, [`sunglint_report::fit`] shows it.

pub(crate) mod inputs;

use crate::curve_file::Magnitudes;
use crate::output::{Console, OutputArgs, Usage};
use crate::progress::Bar;
use crate::station::StationArgs;
use anyhow::{anyhow, bail};
use clap::{Args, ValueEnum};
use inputs::with_stations;
use std::path::PathBuf;
use sunglint_inference::fit::{FitOptions, FreeParameter, LeaveOut, PassFit, PassFitError};
use sunglint_inference::solver::Loss;
use sunglint_report::fit as report;

/// Arguments of `sunglint fit`.
#[derive(Debug, Default, Args)]
pub struct FitArgs {
    /// Calibrated light curves (or tables of magnitudes) and the scene that they are of: `MEASURED… PASS.toml`; with several scenes each stands after
    /// its own curves
    #[arg(required = true, num_args = 2.., value_name = "FILE")]
    pub inputs: Vec<PathBuf>,
    /// Free parameters: `NAME`, `NAME=LO..HI`, with a prior `NAME~MEAN+-SIGMA` or `NAME=LO..HI~MEAN+-SIGMA`, beside those that `[fit]` of the scene names. `albedo`, `albedo.MATERIAL[.CHANNEL]`, `scale.MATERIAL`,
    /// `time_offset_s`, `size`, `gain`, `extinction[.CHANNEL]`, `zero_point`, and every number of the scene's attitude, parts, hinges and materials
    #[arg(long, value_name = "NAME")]
    pub free: Vec<FreeParameter>,
    /// Parameters of which each curve has its own
    #[arg(long, value_name = "NAME")]
    pub per_pass: Vec<String>,
    /// Predict these curves by fits of the others: `each` in turn, or files with commas between them (all tracks of one satellite) that are left out together
    #[arg(long, value_name = "each|FILES")]
    pub leave_out: Vec<LeaveOut>,
    /// Largest albedo that is solved for, and largest reflectance that a scale may lead to [default: 1]
    #[arg(long, value_name = "A")]
    pub largest_albedo: Option<f64>,
    /// Only these channels
    #[arg(long, value_name = "NAME")]
    pub channel: Vec<String>,
    /// How residuals count [default: huber]
    #[arg(long, value_enum)]
    pub loss: Option<LossName>,
    /// Young's coefficient of the scintillation, which the channels share; 0 for none [default: 1.5]
    #[arg(long, value_name = "C")]
    pub scintillation: Option<f64>,
    /// Places over the box of what is searched for that are looked at first [default: 128]
    #[arg(long, value_name = "N")]
    pub places: Option<u32>,
    /// From how many of them a search starts, the scene's own values besides [default: 8]
    #[arg(long, value_name = "N")]
    pub starts: Option<u32>,
    /// Iterations of a descent to the bottom of a minimum, at most; with 0 only places are looked at [default: 60]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(..=10_000))]
    pub iterations: Option<u32>,
    /// How a table of magnitudes is read.
    #[command(flatten)]
    pub magnitudes: Magnitudes,
    /// Write the scene with what was found (`simulate` runs it); a folder of `-o` gets it too
    #[arg(long, value_name = "FILE.toml")]
    pub scene_out: Option<PathBuf>,
    /// Which station, in place of the file's.
    #[command(flatten)]
    pub station: StationArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// How residuals count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum LossName {
    /// By their squares
    Squares,
    /// Beyond 1.345 standard deviations linearly (Huber)
    Huber,
    /// Student's t with four degrees of freedom
    Student,
    /// Beyond 4.685 standard deviations not at all, and clouds left out (Tukey)
    Tukey,
}

impl From<LossName> for Loss {
    fn from(name: LossName) -> Self {
        match name {
            LossName::Squares => Loss::Squares,
            LossName::Huber => Loss::Huber,
            LossName::Student => Loss::Student,
            LossName::Tukey => Loss::Tukey,
        }
    }
}

impl FitArgs {
    /// A fit of one curve, with what the scene's `[fit]` says.
    pub fn of(measured: PathBuf, scene: PathBuf, output: PathBuf) -> Self {
        let out = OutputArgs { output: vec![output], force: false };
        Self { inputs: vec![measured, scene], out, ..Self::default() }
    }
}

/// Fits.
pub fn run(args: &FitArgs, seed: u64, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    args.out.check_targets(args.scene_out.as_deref())?;
    let answer = solve(args, seed, console)?;
    write(&answer, args, console)?;
    if !answer.fit.converged {
        bail!(
            "the fit did not converge: what it reached is in the output, and its intervals mean nothing; start nearer (--free NAME=LO..HI), let it go on for longer (--iterations), or search more (--places, --starts)"
        );
    }
    Ok(())
}

/// Writes an answer where it is wanted, and says it.
pub fn write(answer: &PassFit, args: &FitArgs, console: Console) -> anyhow::Result<()> {
    let product = report::product(answer)?;
    let mut files = Vec::new();
    for (number, scene) in answer.scenes.iter().enumerate() {
        let folders = args.out.folders();
        let name = format!("{}.fitted.toml", scene.name);
        let alone = args.scene_out.clone().map(|path| numbered(path, number));
        let into = folders.output.iter().map(|f| f.join(&name)).chain(alone);
        files.extend(into.map(|path| (path, scene.text.clone().into_bytes())));
    }
    args.out.finish_with(&product, files, &report::text(answer), console)
}

/// The file of a scene that is not the first: `found.toml`, `found_2.toml`, …
fn numbered(path: PathBuf, number: usize) -> PathBuf {
    if number == 0 {
        return path;
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    path.with_file_name(format!("{stem}_{}.toml", number + 1))
}

/// Does all of `sunglint fit` but write: for other commands that show a fit.
pub fn solve(args: &FitArgs, seed: u64, console: Console) -> anyhow::Result<PassFit> {
    if let Some(c) = args.scintillation
        && !(0.0..=10.0).contains(&c)
    {
        return Err(Usage(format!("--scintillation is {c}, expected 0 to 10")).into());
    }
    let mut curves = inputs::joined(&args.inputs, &args.magnitudes)?;
    let scene = &curves[0].scene;
    let options = options(args, FitOptions::of_scene(&scene.path).map_err(told)?, seed);
    let name = scene.name();
    args.out.check_names(&[format!("{name}_fit.ecsv"), format!("{name}.fitted.toml")])?;
    with_stations(&mut curves, &args.station)?;
    let bar = Bar::new(console);
    let answer = sunglint_inference::fit::fit(&curves, &options, &bar).map_err(told)?;
    bar.end();
    for warning in &answer.warnings {
        console.warn(warning);
    }
    Ok(answer)
}

/// Returns the options of the scene's `[fit]`, as the command line overrules them.
fn options(args: &FitArgs, of_scene: FitOptions, seed: u64) -> FitOptions {
    let mut all = FitOptions::default();
    let given = |name: &str| args.free.iter().any(|w| w.name == name);
    all.free = of_scene.free.into_iter().filter(|w| !given(&w.name)).collect();
    all.free.extend(args.free.iter().cloned());
    all.per_pass = of_scene.per_pass;
    all.per_pass.extend(args.per_pass.iter().cloned());
    all.channels = if args.channel.is_empty() { of_scene.channels } else { args.channel.clone() };
    all.largest_albedo = args.largest_albedo.unwrap_or(of_scene.largest_albedo);
    all.leave_out = args.leave_out.clone();
    all.loss = args.loss.map_or(of_scene.loss, Loss::from);
    all.scintillation = args.scintillation.unwrap_or(of_scene.scintillation);
    all.places = args.places.map_or(of_scene.places, |n| n as usize);
    all.starts = args.starts.map_or(of_scene.starts, |n| n as usize);
    all.iterations = args.iterations.map_or(of_scene.iterations, |n| n as usize);
    all.seed = seed;
    all
}

/// The error with the option that may help.
fn told(error: PassFitError) -> anyhow::Error {
    match error {
        PassFitError::Measured(error) => inputs::told(error),
        PassFitError::FreeTwice { .. }
        | PassFitError::NotACurve { .. }
        | PassFitError::AllLeftOut { .. }
        | PassFitError::LargestAlbedo { .. } => Usage(error.to_string()).into(),
        PassFitError::NothingFree => Usage(format!(
            "{error}: say what with --free NAME[=LO..HI], or in [fit] of the scene: free = [\"albedo\"]"
        ))
        .into(),
        PassFitError::NoRange { ref name, .. } => anyhow!("{error}: --free {name}=LO..HI"),
        error => error.into(),
    }
}
