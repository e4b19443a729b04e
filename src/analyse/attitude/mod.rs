//! `sunglint analyse attitude`: how a body of known shape spins, from its light.
//!
//! `question` makes of scene and options what is asked, `watch` shows progress and keeps what a search that is cut off can go on from, `report` says what was found; the
//! mathematics is [`sunglint_inference::attitude`].

mod question;
mod report;
mod watch;

use crate::curve_file::Magnitudes;
use crate::fit::inputs::{channels, joined, pass_of, place, prepared};
use crate::output::{Console, OutputArgs};
use crate::station::StationArgs;
use anyhow::Context as _;
use clap::{Args, ValueEnum};
use question::asked;
use report::Told;
use std::path::PathBuf;
use std::time::Instant;
use sunglint_inference::attitude::{Measured, Options, Scale, find};
use sunglint_inference::solver::Unit;
use sunglint_simulator::light::engine::Switches;
use sunglint_simulator::pass::{Pass, Study};
use watch::Kept;

/// The band of published magnitudes.
const V: usize = 2;

/// Arguments of `sunglint analyse attitude`.
#[derive(Debug, Args)]
pub struct AttitudeArgs {
    /// Calibrated light curves and the scene that they are of: `CURVE… PASS.toml`; with several scenes each stands after its own curves. `[attitude]` of the first says law = "spin" and `axis_body`,
    /// the axis in the body
    #[arg(required = true, num_args = 2.., value_name = "FILE")]
    pub inputs: Vec<PathBuf>,
    /// What the scene's attitude says and is not looked for; may be given several times
    #[arg(long, value_name = "WHAT", value_delimiter = ',')]
    pub known: Vec<Known>,
    /// The shortest and the longest period to look for, s (`LO..HI`; `LO..` without an upper bound) [default: from four steps of the data, without]
    #[arg(long, value_name = "LO..HI")]
    pub period: Option<String>,
    /// The sense in which the body turns about its axis
    #[arg(long, value_enum, default_value_t)]
    pub sense: Sense,
    /// What of the brightness is free: nothing, a factor for all, for each channel, for each material
    #[arg(long, value_enum, default_value_t)]
    pub scale: ScaleName,
    /// Only these channels
    #[arg(long, value_name = "NAME")]
    pub channel: Vec<String>,
    /// Axes that are looked at first, spread over the sphere
    #[arg(long, value_name = "N", default_value_t = 640, value_parser = clap::value_parser!(u32).range(12..=100_000))]
    pub axes: u32,
    /// Direct sunlight alone: neither the Earth's nor light between the parts in the last steps
    #[arg(long)]
    pub direct_only: bool,
    /// How a table of magnitudes is read.
    #[command(flatten)]
    pub magnitudes: Magnitudes,
    /// A file that the first look at all axes is kept in from time to time; where it is there, the search goes on from it
    #[arg(long, value_name = "FILE.json")]
    pub checkpoint: Option<PathBuf>,
    /// Write the scene with the best attitude (`simulate` runs it); a folder of `-o` gets it too
    #[arg(long, value_name = "FILE.toml")]
    pub scene_out: Option<PathBuf>,
    /// Which station, in place of the file's.
    #[command(flatten)]
    pub station: StationArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// What may be known of a spin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Known {
    /// The axis among the stars
    Axis,
    /// The turn about it at the scene's epoch
    Phase,
    /// The period and the sense
    Period,
}

/// The sense of a spin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum Sense {
    /// Either
    #[default]
    Both,
    /// Right-handed about the axis: positive periods
    Right,
    /// Left-handed: negative periods
    Left,
}

/// What of the brightness is free.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum ScaleName {
    /// Nothing
    #[default]
    None,
    /// One factor
    Grey,
    /// One for each channel
    Channel,
    /// One for each material
    Material,
}

impl From<ScaleName> for Scale {
    fn from(name: ScaleName) -> Self {
        match name {
            ScaleName::None => Self::None,
            ScaleName::Grey => Self::Grey,
            ScaleName::Channel => Self::Channels,
            ScaleName::Material => Self::Materials,
        }
    }
}

pub(super) fn run(args: &AttitudeArgs, seed: u64, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    args.out.check_names(&["attitude.ecsv", "attitude_curve.ecsv"])?;
    args.out.check_targets(args.scene_out.as_deref())?;
    let start = Instant::now();
    let jobs = joined(&args.inputs, &args.magnitudes)?;
    let mut warnings = Vec::new();
    let mut passes = Vec::new();
    for job in &jobs {
        warnings.extend(job.measured.warnings.iter().cloned());
        passes.push(pass_of(job, &args.station, &mut warnings)?);
    }
    let studies = passes
        .iter()
        .zip(&jobs)
        .map(|(pass, job)| {
            Study::new(direct(pass)).with_context(|| job.measured.path.display().to_string())
        })
        .collect::<anyhow::Result<Vec<_>>>()?;
    let channels = channels(&jobs, &studies, &args.channel)?;
    let (mut curves, mut left_out) = (Vec::new(), Vec::new());
    for ((job, study), pass) in jobs.iter().zip(&studies).zip(passes) {
        let (data, lost) = prepared(&job.measured, study, &channels, 0.0)?;
        left_out.push(lost);
        let unit = match job.measured.magnitudes {
            true => Unit::Band(V),
            false => Unit::Channels(channels.iter().map(|c| place(&pass.station, c)).collect()),
        };
        curves.push(Measured { pass, unit, data });
    }
    drop(studies);
    let scene = &jobs[0].scene;
    let question = asked(args, scene, &curves)?;
    let options = Options { seed, axes: args.axes as usize, all_light: !args.direct_only };
    let kept = Kept::new(args.checkpoint.clone(), args.out.force, console)?;
    let answer = find(&curves, &question, &options, &kept, kept.from())
        .with_context(|| scene.path.display().to_string())?;
    kept.end();
    warnings.extend(answer.warnings.iter().cloned());
    for warning in &warnings {
        console.warn(warning);
    }
    let materials = curves[0].pass.target.materials.iter().map(|m| m.name.clone()).collect();
    let told = Told {
        answer: &answer,
        question: &question,
        name: scene.path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        channels,
        materials,
        jobs: &jobs,
        left_out,
        warnings,
        seconds: start.elapsed().as_secs_f64(),
    };
    let mut files = Vec::new();
    if let Some(text) = told.scene()? {
        let name = format!("{}.attitude.toml", told.name);
        let folders = args.out.folders();
        let into = folders.output.iter().map(|f| f.join(&name)).chain(args.scene_out.clone());
        files.extend(into.map(|path| (path, text.clone().into_bytes())));
    }
    args.out.finish_with(&told.product(), files, &told.text(), console)
}

/// The pass with direct light alone: what places and samples are asked of costs little then.
fn direct(pass: &Pass) -> Pass {
    Pass { effects: Switches::OFF, ..pass.clone() }
}
