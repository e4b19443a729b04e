//! `sunglint analyse fold`: samples by their phase in a period.

use super::curves::CurveArgs;
use crate::output::{Console, OutputArgs};
use crate::star::when;
use anyhow::Context as _;
use clap::Args;
use std::path::PathBuf;
use sunglint_analysis::curves::Curves;
use sunglint_analysis::fold::{FoldOptions, SpinAxis, fold_curves};
use sunglint_report::fold;

/// Arguments of `sunglint analyse fold`.
#[derive(Debug, Args)]
pub struct FoldArgs {
    /// Which curves.
    #[command(flatten)]
    pub curves: CurveArgs,
    /// The period, s
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub period: f64,
    /// Standard uncertainty of the period, s
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub period_sigma: Option<f64>,
    /// The moment of phase 0 [default: the first sample]
    #[arg(long, value_name = "TIME")]
    pub epoch: Option<String>,
    /// The scene of the pass (PASS.toml), for --axis: its orbit and station
    #[arg(long, value_name = "FILE", requires = "axis")]
    pub pass: Option<PathBuf>,
    /// Right ascension and declination of the spin axis, degrees: phases then count turns of the body under the bisector of Sun and station, and --period is that of the spin (sidereal; turns are
    /// right-handed about the axis)
    #[arg(long, value_name = "RA,DEC", value_parser = axis, requires = "pass", allow_hyphen_values = true)]
    pub axis: Option<(f64, f64)>,
    /// Stretches of phase
    #[arg(long, value_name = "N", default_value_t = 50)]
    pub bins: usize,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

pub(super) fn run(args: &FoldArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let curves = args.curves.read()?;
    let epoch = args.epoch.as_deref().map(when).transpose().context("--epoch")?;
    let options = FoldOptions {
        period_sigma_s: args.period_sigma,
        epoch,
        bins: args.bins,
        axis: spin_axis(args, &curves)?,
        ..FoldOptions::new(args.period)
    };
    let found = fold_curves(&curves, &options)?;
    for warning in &found.warnings {
        console.warn(warning);
    }
    args.out.finish(&fold::product(&found), &fold::text(&found), console)
}

/// The axis of the spin, and the way of the bisector of Sun and station.
fn spin_axis(args: &FoldArgs, curves: &Curves) -> anyhow::Result<Option<SpinAxis>> {
    let (Some(scene), Some((ra_deg, dec_deg))) = (&args.pass, args.axis) else { return Ok(None) };
    // A period that is none is refused before the scene is read.
    let bisectors = match args.period.is_finite() && args.period > 0.0 {
        true => args.curves.bisectors(scene, curves.zero, &curves.series()?)?,
        false => None,
    };
    Ok(Some(SpinAxis { ra_deg, dec_deg, bisectors }))
}

/// Two angles, degrees.
fn axis(text: &str) -> Result<(f64, f64), String> {
    let wrong = || {
        format!("expected a right ascension and a declination, degrees, as 83.6,22.0, found {text}")
    };
    let (ra, dec) = text.split_once(',').ok_or_else(wrong)?;
    let number = |t: &str| t.trim().parse::<f64>().map_err(|_| wrong());
    let (ra_deg, dec_deg) = (number(ra)?, number(dec)?);
    if !(ra_deg.is_finite() && (-90.0..=90.0).contains(&dec_deg)) {
        return Err(wrong());
    }
    Ok((ra_deg, dec_deg))
}
