//! `sunglint compare`: a measured pass beside the simulated one.
//!
//! [`sunglint_inference::compare`] compares, [`sunglint_report::compare`] shows it.

use crate::curve_file::{Magnitudes, with_hint};
use crate::explain;
use crate::output::{Console, OutputArgs};
use crate::progress::Bar;
use crate::simulate;
use crate::station::StationArgs;
use anyhow::anyhow;
use clap::Args;
use std::path::{Path, PathBuf};
use sunglint_inference::compare::{CompareError, MeasuredPass, at_measured_times};
use sunglint_report::{Product, compare as report};
use sunglint_simulator::pass::Overrides;

/// Arguments of `sunglint compare`.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// Measurement: a calibrated light curve (`sunglint apply`), or magnitudes in any format that `sunglint import` understands
    pub measured: PathBuf,
    /// The scene: target, orbit, attitude, station, times (docs/pass.md)
    pub pass: PathBuf,
    /// Compare this channel; may be given several times [default: all that were measured]
    #[arg(long, value_name = "NAME")]
    pub channel: Vec<String>,
    /// How magnitudes are read.
    #[command(flatten)]
    pub magnitudes: Magnitudes,
    /// Model what may change the light by more than this: `0.2%` or `0.002`, in place of the file's [default: 0.1%]
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true, value_parser = explain::tolerance)]
    pub tolerance: Option<f64>,
    /// Which station, in place of the file's.
    #[command(flatten)]
    pub station: StationArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

impl CompareArgs {
    /// All of a calibrated curve, with the scene's own station, into no file.
    pub(crate) fn of(measured: PathBuf, pass: PathBuf) -> Self {
        Self {
            measured,
            pass,
            channel: Vec::new(),
            magnitudes: Magnitudes::default(),
            tolerance: None,
            station: StationArgs::default(),
            out: OutputArgs::default(),
        }
    }
}

/// Compares.
pub fn run(args: &CompareArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    let (product, text) = compare(args, console)?;
    args.out.finish(&product, &text, console)
}

/// Returns the product of the comparison that arguments ask for, and its summary; says on stderr what a person should hear of.
pub(crate) fn compare(args: &CompareArgs, console: Console) -> anyhow::Result<(Product, String)> {
    let told = |error| told(error, &args.pass);
    let overrides = Overrides { tolerance: args.tolerance, ..Overrides::default() };
    let scene = simulate::read(&args.pass, &args.station, overrides)?;
    let options = args.magnitudes.options();
    let mut measured = MeasuredPass::read(&args.measured, &options, &scene).map_err(told)?;
    measured.keep(&args.channel, &scene.station).map_err(told)?;
    let scene = at_measured_times(scene, &measured).map_err(told)?;
    let bar = Bar::new(console);
    let compared = sunglint_inference::compare::compare(&scene, measured, &bar).map_err(told)?;
    bar.end();
    for warning in &compared.warnings {
        console.warn(warning);
    }
    Ok((report::product(&compared), report::text(&compared)))
}

/// The error with the option that may help.
fn told(error: CompareError, scene: &Path) -> anyhow::Error {
    match error {
        CompareError::Published(error) => with_hint(error),
        CompareError::NotOfTheStation { .. } => {
            anyhow!("{error}: give the station that measured it, or --channel for those to compare")
        }
        CompareError::Simulation(error) => {
            anyhow::Error::from(error).context(scene.display().to_string())
        }
        error => error.into(),
    }
}
