//! `sunglint fit`: what a simulation must be like for it to look as what was measured.
//!
//! `measured` reads curves, `inputs` joins them with their scenes, `scene` holds a scene in which numbers can be set, `parameters` finds what is free, the mathematics is
//! [`sunglint_inference::solver`], `found` puts it back into the scene, `report` says what it is, [`answer`] holds it for whoever shows it otherwise.

pub mod answer;
mod found;
pub(crate) mod inputs;
pub mod measured;
mod page;
mod parameters;
mod progress;
mod report;
pub(crate) mod scene;

use crate::curve_file::Magnitudes;
use crate::output::{Console, OutputArgs, Usage};
use crate::station::StationArgs;
use answer::{Answer, AnsweredCurve};
use anyhow::{Context as _, bail};
use clap::{Args, ValueEnum};
use found::{Bouncing, fitted_scene, spectra_of};
use inputs::{Job, channels, jobs, pass_of, place, prepared, wanted};
use parameters::{Parameters, Side, Wanted};
use progress::Shown;
use serde::Deserialize;
use std::path::PathBuf;
use std::time::Instant;
use sunglint_calibration::stars::scintillation::USUAL_COEFFICIENT;
use sunglint_formats::time::format_utc;
use sunglint_formats::toml::NonNegative;
use sunglint_inference::solver::{
    self, Data, Fit, Free, Loss, Options, ParameterKind, StudyModel, Unit,
};
use sunglint_radiometry::light_curve::Input;
use sunglint_simulator::light::engine::Switch;
use sunglint_simulator::pass::{Averaged, BANDS, Study, Thinned};
use sunglint_simulator::target::Shape;

/// The band of published magnitudes.
const V: usize = 2;

/// Of the scene's tolerance, the part that light may err by that is computed at some epochs and is linear in time between them.
const THINNED: f64 = 0.3;
/// Of the best sample's uncertainty, the part that the light of an exposure's middle may be off from the mean.
const AVERAGED_SIGMAS: f64 = 0.1;
/// How often such epochs, and moments within exposures, are added where a fit ended.
const REFINED: usize = 3;

/// Arguments of `sunglint fit`.
#[derive(Debug, Default, Args)]
pub struct FitArgs {
    /// Calibrated light curves (or tables of magnitudes) and the scene that they are of: `MEASURED… PASS.toml`; with several scenes each stands after
    /// its own curves
    #[arg(required = true, num_args = 2.., value_name = "FILE")]
    pub inputs: Vec<PathBuf>,
    /// What is free: `NAME` or `NAME=LO..HI`, beside what `[fit]` of the scene says. `albedo`, `albedo.MATERIAL[.CHANNEL]`, `scale.MATERIAL`,
    /// `time_offset_s`, `size`, `gain`, `extinction[.CHANNEL]`, and every number of the scene's attitude, parts, hinges and materials
    #[arg(long, value_name = "NAME")]
    pub free: Vec<Wanted>,
    /// Of these each curve has its own
    #[arg(long, value_name = "NAME")]
    pub per_pass: Vec<String>,
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LossName {
    /// By their squares
    Squares,
    /// Beyond 1.345 standard deviations linearly (Huber)
    Huber,
    /// As of Student's t with four degrees of freedom
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

/// `[fit]` of a scene file.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct FitKeys {
    free: Vec<String>,
    per_pass: Vec<String>,
    channels: Vec<String>,
    loss: Option<LossName>,
    scintillation: Option<NonNegative>,
    places: Option<u32>,
    starts: Option<u32>,
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
pub fn write(answer: &Answer, args: &FitArgs, console: Console) -> anyhow::Result<()> {
    let product = report::product(answer)?;
    let mut files = Vec::new();
    if let Some(scene) = &answer.scene {
        let folders = args.out.folders();
        let name = format!("{}.fitted.toml", answer.name);
        let into = folders.output.iter().map(|f| f.join(&name)).chain(args.scene_out.clone());
        files.extend(into.map(|path| (path, scene.clone().into_bytes())));
    }
    args.out.finish_with(&product, files, &report::text(answer), console)
}

/// Does all of `sunglint fit` but write: for other commands that show a fit.
pub fn solve(args: &FitArgs, seed: u64, console: Console) -> anyhow::Result<Answer> {
    let start = Instant::now();
    if let Some(c) = args.scintillation
        && !(0.0..=10.0).contains(&c)
    {
        return Err(Usage(format!("--scintillation is {c}, expected 0 to 10")).into());
    }
    let (jobs, keys) = jobs(args)?;
    let name = jobs[0].scene.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    args.out.check_names(&[format!("{name}_fit.ecsv"), format!("{name}.fitted.toml")])?;
    let wanted = wanted(args, &keys)?;
    let mut per_pass = keys.per_pass.clone();
    per_pass.extend(args.per_pass.iter().cloned());
    let only = if args.channel.is_empty() { &keys.channels } else { &args.channel };
    let mut warnings = Vec::new();

    let (mut studies, mut bouncing) = (Vec::new(), Vec::new());
    for job in &jobs {
        warnings.extend(job.measured.warnings.iter().cloned());
        let mut pass = pass_of(job, &args.station, &mut warnings)?;
        // Light between parts costs too much for a search; of a lone sphere there is none.
        let lone = matches!(&pass.target.parts[..], [p] if matches!(p.shape, Shape::Sphere { .. }));
        let auto = pass.effects.inter_reflection == Switch::Auto;
        bouncing.push(auto && !lone);
        if auto {
            pass.effects.inter_reflection = Switch::Off;
        }
        let (first, last) = job.measured.ends();
        let study = Study::new(pass).with_context(|| {
            format!(
                "{}: its samples are from {} to {}",
                job.measured.path.display(),
                format_utc(first, 1),
                format_utc(last, 1)
            )
        })?;
        studies.push(study);
    }
    let channels = channels(&jobs, &studies, only)?;
    let coefficient = args
        .scintillation
        .or(keys.scintillation.map(NonNegative::get))
        .unwrap_or(USUAL_COEFFICIENT);
    let mut data = Vec::new();
    let mut left_out = Vec::new();
    for (job, study) in jobs.iter().zip(&studies) {
        let (own, lost) = prepared(&job.measured, study, &channels, coefficient)?;
        left_out.push(lost);
        data.push(own);
    }

    let unit = |job: &Job, study: &Study| match job.measured.magnitudes {
        true => Unit::Band(V),
        false => Unit::Channels(channels.iter().map(|c| place(&study.pass().station, c)).collect()),
    };
    let sides: Vec<Side> = jobs
        .iter()
        .zip(&studies)
        .zip(&data)
        .map(|((job, study), data)| Side {
            scene: &job.scene,
            study,
            unit: unit(job, study),
            has: data.used.columns().into_iter().map(|c| c.iter().any(|u| *u)).collect(),
        })
        .collect();
    let parameters = Parameters::new(&wanted, &per_pass, &channels, &sides)?;
    drop(sides);
    let with = jobs
        .iter()
        .zip(studies)
        .map(|(job, study)| (job.scene.clone(), unit(job, &study), study))
        .map(|(scene, unit, study)| (scene, study, unit))
        .collect();
    let mut model = parameters.model(with);

    let options = Options {
        loss: args.loss.or(keys.loss).map_or(Loss::default(), Loss::from),
        places: args.places.or(keys.places).unwrap_or(128) as usize,
        starts: args.starts.or(keys.starts).unwrap_or(8) as usize,
        seed,
        iterations: args.iterations.map_or(Options::default().iterations, |n| n as usize),
    };
    let mut shown = Shown::new(console);
    let (free, linear) = (&parameters.free, &parameters.linear);
    let near = Options { places: 0, starts: 0, ..options.clone() };
    let mut refit = |model: &mut StudyModel, fit: &Fit, shown: &mut Shown| {
        let again: Vec<Free> = (free.iter().zip(&fit.parameters))
            .map(|(f, p)| Free { start: p.value.clamp(f.low, f.high), ..f.clone() })
            .collect();
        let mut next = solver::fit(&data, model, &again, linear, &near, &mut |p| shown.tell(p))?;
        next.evaluations += fit.evaluations;
        // Other minima are those of the search.
        next.minima.extend(fit.minima.iter().skip(1).cloned());
        Ok(next)
    };
    let moments = |all: &[Averaged]| all.iter().map(|a| a.moments).sum::<usize>();
    let count = |all: &[Thinned]| all.iter().map(|t| t.direct + t.indirect).sum::<usize>();
    let begin: Vec<f64> = free.iter().map(|f| f.start).collect();
    let middles: Vec<f64> = (data.iter().enumerate())
        .map(|(k, data)| middle_may_err(data, model.study(k).map_or(0.0, |s| s.pass().tolerance)))
        .collect();
    let mut averaged = model.average(&begin, &middles)?;
    let mut nodes = model.thin(&begin, THINNED)?;
    let mut fit = solver::fit(&data, &mut model, free, linear, &options, &mut |p| shown.tell(p))?;
    for _ in 0..REFINED {
        // What was smooth where the search began may not be so where it ended. What is linear moves no light.
        if free.is_empty() {
            break;
        }
        let before = moments(&averaged);
        averaged = model.average(&searched(&fit), &middles)?;
        let grew = moments(&averaged) > before;
        if !grew && wrong_between(&mut model, &fit)? <= 1.0 {
            break;
        }
        let finer = model.thin(&searched(&fit), THINNED)?;
        if !grew && count(&finer) == count(&nodes) {
            break;
        }
        nodes = finer;
        fit = refit(&mut model, &fit, &mut shown)?;
    }
    let bouncing =
        Bouncing { jobs: &jobs, of: &bouncing, args, parameters: &parameters, channels: &channels };
    let mut bounces = None;
    if bouncing.of.iter().any(|b| *b) {
        (fit, bounces) = bouncing.settle(&mut model, fit, &mut shown, &mut refit)?;
    }
    // What is linear moves no light.
    let thinned: Vec<Option<Thinned>> = match free.is_empty() {
        true => nodes.iter().map(|t| Some(*t)).collect(),
        false => model.thinned(&searched(&fit))?,
    };
    if let Some(bounces) = bounces.as_ref().filter(|b| !b.settled) {
        warnings.push(format!(
            "light between the parts, up to {:.1} % of a sample's, had not settled after {} rounds: the last moved a parameter by {:.1} of its standard uncertainty",
            100.0 * bounces.share, bounces.rounds, bounces.moved_sigmas
        ));
    }
    shown.end();
    warnings.extend(fit.warnings.iter().map(ToString::to_string));
    let spectra = match model.study(0) {
        Some(study) => {
            let magnitudes = jobs[0].measured.magnitudes;
            spectra_of(&parameters, &fit, &channels, study, magnitudes, &mut warnings)?
        }
        None => Vec::new(),
    };
    let scene = fitted_scene(&jobs[0].scene, &parameters, &fit, &spectra, &mut warnings)?;
    for warning in &warnings {
        console.warn(warning);
    }
    let curves = jobs
        .iter()
        .enumerate()
        .filter_map(|(k, job)| {
            Some(AnsweredCurve::new(
                &job.measured,
                model.study(k)?,
                &data[k],
                &fit.curves[k],
                left_out[k].clone(),
                averaged[k],
                thinned[k],
            ))
        })
        .collect();
    Ok(Answer {
        name,
        scene_file: jobs[0].scene.path.clone(),
        station: model.study(0).map(|s| s.pass().station.name.clone()).unwrap_or_default(),
        groups: answer::groups(&data, &fit, &model, &channels),
        channels,
        curves,
        inputs: inputs_of(&jobs, &model)?,
        fit,
        spectra,
        scene,
        in_the_scene: parameters.in_the_scene(),
        scintillation: coefficient,
        bounces,
        seconds: start.elapsed().as_secs_f64(),
        warnings,
    })
}

/// The files that a fit was made of.
fn inputs_of(jobs: &[Job], model: &StudyModel) -> anyhow::Result<Vec<Input>> {
    let mut all: Vec<Input> = Vec::new();
    let mut add = |input: Input| {
        if !all.iter().any(|own| own.sha256 == input.sha256) {
            all.push(input);
        }
    };
    for (k, job) in jobs.iter().enumerate() {
        for path in [&job.measured.path, &job.scene.path] {
            let bytes = std::fs::read(path).with_context(|| path.display().to_string())?;
            let sha256 = sunglint_formats::sha256(&bytes);
            add(Input { file: path.display().to_string(), sha256 });
        }
        let own = model.study(k).map(|s| s.pass().inputs.clone());
        own.into_iter().flatten().for_each(&mut add);
    }
    Ok(all)
}

/// By how much, relative, the light of an exposure's middle may differ from the mean of a curve's samples: by what does not matter beside the best sample's
/// uncertainty, or beside what light itself may err by.
fn middle_may_err(data: &Data, tolerance: f64) -> f64 {
    let used = data.used.iter().zip(data.sigma.iter().zip(&data.rate)).filter(|(used, _)| **used);
    let relative = used.map(|(_, (sigma, rate))| sigma / rate.abs().max(*sigma));
    let best = relative.filter(|r| r.is_finite()).fold(1.0, f64::min);
    (AVERAGED_SIGMAS * best).max(THINNED * tolerance)
}

/// Values of what was searched for.
fn searched(fit: &Fit) -> Vec<f64> {
    let own = fit.parameters.iter().filter(|p| p.kind == ParameterKind::Nonlinear);
    own.map(|p| p.value).collect()
}

/// What the lines between epochs at which light was computed err by, over what they may.
fn wrong_between(model: &mut StudyModel, fit: &Fit) -> anyhow::Result<f64> {
    let thinned = model.thinned(&searched(fit))?;
    let own = thinned.iter().enumerate().filter_map(|(k, t)| {
        let allowed = THINNED * model.study(k)?.pass().tolerance;
        t.as_ref().map(|t| t.error / allowed)
    });
    Ok(own.fold(0.0, f64::max))
}

const _: () = assert!(V < BANDS.len());
