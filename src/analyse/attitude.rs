//! `sunglint analyse attitude`: how a body of known shape spins, from its light.
//!
//! [`sunglint_inference::attitude`] finds it, [`sunglint_report::attitude`] shows it.

use crate::curve_file::Magnitudes;
use crate::fit::inputs::{self, joined, with_stations};
use crate::output::{Console, OutputArgs, Usage};
use crate::progress::Bar;
use crate::station::StationArgs;
use anyhow::anyhow;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use sunglint_inference::attitude::{self, AnalysisError, AnalysisOptions, Scale, Unknowns};
use sunglint_report::attitude as report;

/// Arguments of `sunglint analyse attitude`.
#[derive(Debug, Args)]
pub struct AttitudeArgs {
    /// Calibrated light curves and the scene that they are of: `CURVE… PASS.toml`; with several scenes each stands after its own curves. `[attitude]` of the first says law = "spin" and `axis_body`,
    /// the axis in the body
    #[arg(required = true, num_args = 2.., value_name = "FILE")]
    pub inputs: Vec<PathBuf>,
    /// Known parts of the scene's attitude, which are not searched for; may be given several times
    #[arg(long, value_name = "WHAT", value_delimiter = ',')]
    pub known: Vec<Known>,
    /// The shortest and the longest period to look for, s (`LO..HI`; `LO..` without an upper bound) [default: from four steps of the data, without]
    #[arg(long, value_name = "LO..HI")]
    pub period: Option<String>,
    /// The sense in which the body turns about its axis
    #[arg(long, value_enum, default_value_t)]
    pub sense: Sense,
    /// Free part of the brightness: nothing, a factor for all, for each channel, for each material
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

/// Part of a spin that may be known.
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

/// Free part of the brightness.
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

impl From<Sense> for attitude::Sense {
    fn from(name: Sense) -> Self {
        match name {
            Sense::Both => Self::Both,
            Sense::Right => Self::Right,
            Sense::Left => Self::Left,
        }
    }
}

pub(super) fn run(args: &AttitudeArgs, seed: u64, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    args.out.check_names(&["attitude.ecsv", "attitude_curve.ecsv"])?;
    args.out.check_targets(args.scene_out.as_deref())?;
    let mut curves = joined(&args.inputs, &args.magnitudes)?;
    let options = args.options(seed)?;
    with_stations(&mut curves, &args.station)?;
    let bar = Bar::new(console);
    let found = attitude::analyse(curves, &options, &bar).map_err(told)?;
    bar.end();
    for warning in &found.warnings {
        console.warn(warning);
    }
    let mut files = Vec::new();
    if let Some(text) = &found.scene {
        let name = format!("{}.attitude.toml", found.name);
        let folders = args.out.folders();
        let into = folders.output.iter().map(|f| f.join(&name)).chain(args.scene_out.clone());
        files.extend(into.map(|path| (path, text.clone().into_bytes())));
    }
    args.out.finish_with(&report::product(&found), files, &report::text(&found), console)
}

impl AttitudeArgs {
    fn options(&self, seed: u64) -> anyhow::Result<AnalysisOptions> {
        let unknown = |what: Known| !self.known.contains(&what);
        let mut options = AnalysisOptions::default();
        options.unknowns = Unknowns {
            axis: unknown(Known::Axis),
            phase: unknown(Known::Phase),
            period: unknown(Known::Period),
        };
        options.period_s = match self.period.as_deref() {
            // Beside a known period any bounds are refused, whatever they are.
            Some(_) if !options.unknowns.period => Some((0.0, f64::INFINITY)),
            text => text.map(bounds).transpose()?,
        };
        options.sense = self.sense.into();
        options.scale = self.scale.into();
        options.channels = self.channel.clone();
        options.search =
            attitude::Options { seed, axes: self.axes as usize, all_light: !self.direct_only };
        options.checkpoint = self.checkpoint.clone();
        options.anew = self.out.force;
        Ok(options)
    }
}

/// The error with the option that may help.
fn told(error: AnalysisError) -> anyhow::Error {
    match error {
        AnalysisError::Measured(error) => inputs::told(error),
        AnalysisError::NothingUnknown => Usage("--known axis,phase,period leaves nothing to look for: `sunglint compare` compares a scene with a curve".into()).into(),
        AnalysisError::PeriodKnown => {
            Usage("--known period takes the scene's: neither --period nor --sense beside it".into())
                .into()
        }
        AnalysisError::NoAxis { path } => anyhow!(
            "{}: --known axis, but [attitude] has neither axis_ra_dec_deg nor axis_gcrs",
            path.display()
        ),
        AnalysisError::NoPhase { path } => anyhow!(
            "{}: --known phase, but [attitude] has no axis_ra_dec_deg from which a phase counts",
            path.display()
        ),
        AnalysisError::Checkpoint { path, source } => anyhow::Error::from(source).context(format!(
            "{}: this is no checkpoint of `analyse attitude` (--force begins anew and overwrites it)",
            path.display()
        )),
        error => error.into(),
    }
}

/// Reads the bounds of a period, `LO..HI` in seconds; `LO..` has no upper one.
///
/// # Errors
/// Where it is neither, or the bounds are not above 0 and in order.
pub fn bounds(text: &str) -> anyhow::Result<(f64, f64)> {
    let wrong = || {
        Usage(format!(
            "--period {text}: expected LO..HI in seconds, above 0 and the first below the second (LO.. without an upper bound)"
        ))
    };
    let (low, high) = text.split_once("..").ok_or_else(wrong)?;
    let low: f64 = low.trim().parse().map_err(|_| wrong())?;
    let high: f64 = match high.trim() {
        "" => f64::INFINITY,
        high => high.parse().map_err(|_| wrong())?,
    };
    if low > 0.0 && low.is_finite() && low < high { Ok((low, high)) } else { Err(wrong().into()) }
}
