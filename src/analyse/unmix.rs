//! `sunglint analyse unmix`: how much of the light comes from which material.

use super::given::{GivenArgs, with_options, worded};
use crate::output::{Console, OutputArgs};
use anyhow::{anyhow, bail};
use clap::Args;
use std::path::PathBuf;
use sunglint_analysis::unmix::nnls::Constraint;
use sunglint_inference::unmix::{
    MaterialConfusionError, Materials, UnmixCurveError, UnmixOptions, unmix_curve,
};
use sunglint_report::unmix;

/// Arguments of `sunglint analyse unmix`.
#[derive(Debug, Args)]
pub struct UnmixArgs {
    /// The curve: calibrated or predicted rates (ECSV), or spectra of `simulate` (FITS)
    pub curve: PathBuf,
    /// The materials, separated by commas: built-in ones (`white`), all of a target (`box_wing`, a target.toml), or the columns of a file (.csv, .ecsv with wavelength_nm)
    #[arg(long, value_name = "NAME|FILE", value_delimiter = ',', required = true)]
    pub endmembers: Vec<String>,
    /// Sum of all weights, m² sr⁻¹; without it they are free
    #[arg(long, value_name = "M2_SR", allow_negative_numbers = true)]
    pub total: Option<f64>,
    /// All channels count alike, whatever their uncertainties
    #[arg(long)]
    pub unweighted: bool,
    /// How the materials are taken for one another: the scene's own light beside the shares that are found (thesis figure 8.4). The endmembers have to be materials of the scene's target
    #[arg(long, requires = "pass")]
    pub confusion: bool,
    /// Under what light it was taken.
    #[command(flatten)]
    pub given: GivenArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Unmixes a curve.
pub(super) fn run(args: &UnmixArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    let constraint = match args.total {
        None => Constraint::Free,
        Some(total) if total.is_finite() && total > 0.0 => Constraint::Sum(total),
        Some(total) => bail!("--total is {total}, expected an area above 0, m² sr⁻¹"),
    };
    let materials = Materials::read(&args.endmembers)?;
    let given = args.given.read(&args.curve, console)?;
    let options =
        UnmixOptions { constraint, unweighted: args.unweighted, confusion: args.confusion };
    let mut unmixed =
        unmix_curve(&given, &materials, &options).map_err(|error| refused(error, console))?;
    with_options(&mut unmixed.warnings);
    for warning in &unmixed.warnings {
        console.warn(warning);
    }
    args.out.finish(&unmix::product(&unmixed), &unmix::text(&unmixed), console)
}

/// The error with the option that it is about, after the warnings that come before it.
fn refused(error: UnmixCurveError, console: Console) -> anyhow::Error {
    match error {
        UnmixCurveError::Samples(error) => worded(error),
        UnmixCurveError::Confusion(
            error @ (MaterialConfusionError::Other { .. } | MaterialConfusionError::NoSample),
        ) => anyhow!("--confusion: {error}"),
        UnmixCurveError::NoSample { ref warnings, .. } => {
            let mut warnings = warnings.clone();
            with_options(&mut warnings);
            for warning in &warnings {
                console.warn(warning);
            }
            error.into()
        }
        error => error.into(),
    }
}
