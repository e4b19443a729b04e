//! `sunglint analyse unmix`: how much of the light comes from which material.

mod endmembers;
mod report;

use super::numbers::{Curve, Source, Surroundings, places};
use crate::air::AirModelArgs;
use crate::output::{Console, OutputArgs};
use crate::simulate::read as read_pass;
use crate::station::StationArgs;
use anyhow::bail;
use clap::Args;
pub(super) use endmembers::endmembers;
use report::Report;
use std::path::PathBuf;
use sunglint_analysis::unmix::nnls::Constraint;
use sunglint_analysis::unmix::{Mixing, Unmixed, Values, unmix};
use sunglint_radiometry::air::Air;
use sunglint_simulator::pass::Overrides;

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
    /// The scene of the curve: where target and Sun stood, its air and station
    #[arg(long, value_name = "PASS.toml")]
    pub pass: Option<PathBuf>,
    /// What all weights add up to, m² sr⁻¹; without it they are free
    #[arg(long, value_name = "M2_SR", allow_negative_numbers = true)]
    pub total: Option<f64>,
    /// All channels count alike, whatever their uncertainties
    #[arg(long)]
    pub unweighted: bool,
    /// The rates are those above the air
    #[arg(long, conflicts_with_all = ["profile", "pressure_hpa", "ozone_du", "water_mm", "co2_ppm", "aerosol", "no_refraction"])]
    pub no_air: bool,
    /// Which station, in place of the scene's.
    #[command(flatten)]
    pub station: StationArgs,
    /// What is known of the air, where no scene says.
    #[command(flatten)]
    pub model: AirModelArgs,
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
    let curve = Curve::read(&args.curve)?;
    let pass = match &args.pass {
        Some(path) => Some(read_pass(path, &args.station, Overrides::default())?),
        None => None,
    };
    let rates = matches!(curve.source, Source::Rates(_));
    let own = match &pass {
        None if rates || !curve.is_intensity() && !args.no_air => Some(args.station.get()?),
        _ => None,
    };
    let station = pass.as_ref().map(|p| &p.station).or(own.as_ref());
    let model: Option<Air> = match (&pass, station) {
        (None, Some(station)) if !args.no_air => {
            Some(args.model.air(station.site.geodetic().height_m, Some(station))?)
        }
        _ => None,
    };
    let air = pass.as_ref().map_or(model.as_ref(), |p| p.air.as_ref()).filter(|_| !args.no_air);
    let around = Surroundings { pass: pass.as_ref(), station, air };
    let bands = curve.bands(&around, &endmembers)?;
    let stood = pass.as_ref().map(|p| places(p, curve.samples())).transpose()?;
    let lights = curve.lights(&around, stood.as_deref(), &mut warnings)?;
    let mut numbers = curve.numbers();
    if args.unweighted {
        numbers.sigma = None;
    }
    // In the umbra nothing is reflected that could be divided.
    for (i, light) in lights.iter().enumerate() {
        if light.sunlight <= 0.0 {
            numbers.valid.row_mut(i).fill(false);
        }
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
    for warning in &warnings {
        console.warn(warning);
    }
    if found.iter().all(|u| u.mixture.is_none()) {
        bail!("{}: no sample can be unmixed: {}", args.curve.display(), report::reasons(&found));
    }
    let mut all_inputs = vec![curve.input.clone()];
    all_inputs.extend(inputs);
    let absolute = curve.is_intensity() || stood.is_some() || curve.samples().range_m.is_some();
    let report = Report {
        curve: &curve,
        bands: &bands,
        mixing: &mixing,
        found: &found,
        warnings: &warnings,
        inputs: all_inputs,
        is_absolute: absolute,
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
