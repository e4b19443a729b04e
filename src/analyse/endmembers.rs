//! `sunglint analyse endmembers`: the spectra that a curve is made of, nobody having said which.

use super::given::{GivenArgs, with_options, worded};
use crate::output::{Console, OutputArgs};
use anyhow::{anyhow, bail};
use clap::Args;
use std::path::PathBuf;
use sunglint_inference::endmembers::{
    EndmemberOptions, EndmembersError, NO_UNCERTAINTIES, find_endmembers,
};
use sunglint_inference::unmix::Materials;
use sunglint_report::endmembers;

/// Arguments of `sunglint analyse endmembers`.
#[derive(Debug, Args)]
pub struct EndmembersArgs {
    /// The curve: calibrated or predicted rates (ECSV), or spectra of `simulate` (FITS)
    pub curve: PathBuf,
    /// Largest number of endmembers
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..))]
    pub most: u32,
    /// Noise of a sample, as a share of it [default: by the curve's own uncertainties]
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
    pub noise: Option<f64>,
    /// Known materials to hold them against: built-in ones, all of a target, or the columns of a file, as in `unmix`
    #[arg(long, value_name = "NAME|FILE", value_delimiter = ',')]
    pub against: Vec<String>,
    /// Under what light it was taken.
    #[command(flatten)]
    pub given: GivenArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Finds them.
pub(super) fn run(args: &EndmembersArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    if let Some(noise) = args.noise.filter(|noise| !(0.0..1.0).contains(noise)) {
        bail!("--noise is {noise}, expected a share from 0 to below 1");
    }
    let known = Materials::read(&args.against)?;
    let given = args.given.read(&args.curve, console)?;
    let options = EndmemberOptions { most: args.most as usize, noise: args.noise };
    let mut found = find_endmembers(&given, &known, &options).map_err(|error| match error {
        EndmembersError::Samples(error) => worded(error),
        EndmembersError::Noisy { .. } => anyhow!("{error} (--noise takes another level)"),
        error => error.into(),
    })?;
    with_options(&mut found.warnings);
    for warning in &mut found.warnings {
        if warning == NO_UNCERTAINTIES {
            warning.push_str("; --noise SHARE says what does not");
        }
        console.warn(warning);
    }
    args.out.finish(&endmembers::product(&found), &endmembers::text(&found), console)
}
