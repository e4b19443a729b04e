//! `sunglint analyse unmix`: how much of the light comes from which material.

mod confusion;
mod endmembers;
mod given;
mod report;

use crate::output::{Console, OutputArgs};
use anyhow::bail;
use clap::Args;
use confusion::Told;
pub(super) use endmembers::{column_name, endmembers};
pub(super) use given::{Given, GivenArgs};
use report::Report;
use std::path::PathBuf;
use sunglint_analysis::unmix::nnls::Constraint;
use sunglint_analysis::unmix::{Mixing, Unmixed, Values, unmix};

/// A condition number of more is warned of.
const CONDITION: f64 = 100.0;

/// Arguments of `sunglint analyse unmix`.
#[derive(Debug, Args)]
pub struct UnmixArgs {
    /// The curve: calibrated or predicted rates (ECSV), or spectra of `simulate` (FITS)
    pub curve: PathBuf,
    /// The materials, separated by commas: built-in ones (`white`), all of a target (`box_wing`, a target.toml), or the columns of a file (.csv, .ecsv with wavelength_nm)
    #[arg(long, value_name = "NAME|FILE", value_delimiter = ',', required = true)]
    pub endmembers: Vec<String>,
    /// What all weights add up to, m² sr⁻¹; without it they are free
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
pub fn run(args: &UnmixArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    let constraint = match args.total {
        None => Constraint::Free,
        Some(total) if total.is_finite() && total > 0.0 => Constraint::Sum(total),
        Some(total) => bail!("--total is {total}, expected an area above 0, m² sr⁻¹"),
    };
    let mut warnings = Vec::new();
    let (endmembers, inputs) = endmembers(&args.endmembers, &mut warnings)?;
    let given = Given::read(&args.curve, &args.given)?;
    let bands = given.bands(&endmembers)?;
    let (lights, mut numbers) = given.samples(&mut warnings)?;
    if args.unweighted {
        numbers.sigma = None;
    }

    // What all bands together can tell, before any sample: at the zenith angle of the first.
    let zenith = lights.iter().map(|l| l.zenith).find(|z| bands.at(*z).is_ok());
    let zenith = zenith.unwrap_or(sunglint_radiometry::air::Zenith::Apparent(0.0));
    let mixing = Mixing::new(bands.at(zenith)?.matrix, &bands.endmembers)?;
    warnings.extend(concerns(&mixing, &bands.names, &bands.endmembers));
    let uncovered = bands.uncovered_nm();
    for (e, name) in bands.endmembers.iter().enumerate() {
        let most = uncovered.column(e).iter().copied().fold(0.0, f64::max);
        if most > 0.0 {
            warnings.push(format!(
                "{name}: for up to {most:.0} nm of a band its spectrum, sunlight or the air is not tabulated and its end was held"
            ));
        }
    }
    let values = Values {
        value: numbers.value.view(),
        sigma: numbers.sigma.as_ref().map(|s| s.view()),
        valid: numbers.valid.view(),
    };
    let found: Vec<Unmixed> = unmix(&bands, &lights, values, constraint)?;
    let told = match &given.pass {
        Some(pass) if args.confusion => {
            let told = Told::of(pass, &given.curve, &bands.endmembers, &found)?;
            if told.others > 1e-3 {
                warnings.push(format!(
                    "{:.1} % of the scene's light is of materials that are not among the endmembers: it is in no row of the confusion, and what unmixing made of it is in its columns",
                    100.0 * told.others
                ));
            }
            Some(told)
        }
        _ => None,
    };
    for warning in &warnings {
        console.warn(warning);
    }
    if found.iter().all(|u| u.mixture.is_none()) {
        bail!("{}: no sample can be unmixed: {}", args.curve.display(), report::reasons(&found));
    }
    let mut all_inputs = vec![given.curve.input.clone()];
    all_inputs.extend(inputs);
    let report = Report {
        curve: &given.curve,
        bands: &bands,
        mixing: &mixing,
        found: &found,
        warnings: &warnings,
        inputs: all_inputs,
        is_absolute: given.is_absolute(),
        told: told.as_ref(),
    };
    args.out.finish(&report.product()?, &report.text(), console)
}

/// What a person should hear of before believing the weights.
pub(super) fn concerns(mixing: &Mixing, bands: &[String], endmembers: &[String]) -> Vec<String> {
    let mut concerns = Vec::new();
    let (channels, count) = (bands.len(), endmembers.len());
    if channels < count {
        concerns.push(format!(
            "{channels} channels for {count} endmembers: where light of all of them is possible, many answers fit alike; such samples get no weights"
        ));
    } else if !mixing.is_complete() {
        concerns.push(format!(
            "the {channels} channels tell {} of {count} endmembers apart",
            mixing.rank
        ));
    }
    if mixing.condition.is_finite() && mixing.condition > CONDITION {
        let twins = mixing.nearest.as_ref().map_or(String::new(), |twins| {
            let [a, b] = twins.pair;
            format!(
                "; nearest to each other are {} and {}, {:.2}° apart",
                endmembers[a],
                endmembers[b],
                twins.angle_rad.to_degrees()
            )
        });
        concerns.push(format!(
            "the endmembers are nearly collinear: relative errors of rates may grow {:.0}-fold{twins}",
            mixing.condition
        ));
    }
    concerns
}
