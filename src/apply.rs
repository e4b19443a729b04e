//! `sunglint apply`: a linear light curve times κ; magnitudes and irradiances by a stated spectrum.

use crate::air::AirModelArgs;
use crate::output::{Console, OutputArgs};
use crate::station::StationArgs;
use anyhow::{anyhow, bail};
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use sunglint_calibration::apply::{self, ApplyError, PhotometryOptions};
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_report::apply as report;

/// Arguments of `sunglint apply`.
#[derive(Debug, Args)]
pub struct ApplyArgs {
    /// Calibration that `sunglint calibrate` wrote
    pub calibration: PathBuf,
    /// A linear light curve
    pub curve: PathBuf,
    /// The night whose kappa to use, as 2020-11-18 [default: the curve's own]
    #[arg(long, value_name = "DATE")]
    pub night: Option<String>,
    /// The light's spectrum above the air, by which rates become irradiances: `sun`, a star's type (`G2V`), or a curve's file
    #[arg(long, value_name = "SPECTRUM")]
    pub spectrum: Option<String>,
    /// Magnitudes in a band (`V`, `Gaia_G`; see `sunglint tables`); of sunlight unless --spectrum says otherwise
    #[arg(long, value_name = "BAND")]
    pub magnitudes: Option<String>,
    /// How the brightness goes with phase angle, for magnitudes at 1,000 km and a phase angle of 90°
    #[arg(long, value_enum, default_value_t)]
    pub phase_law: PhaseLaw,
    /// Also write magnitudes and irradiances, as a table
    #[arg(long, value_name = "FILE")]
    pub photometry_out: Vec<PathBuf>,
    /// Magnitude of Vega that magnitudes count from, or `ab`
    #[arg(long, value_name = "ZERO", default_value = "vega=0.03")]
    pub zero_point: ZeroPoint,
    /// Which station.
    #[command(flatten)]
    pub station: StationArgs,
    /// Known properties of the air.
    #[command(flatten)]
    pub model: AirModelArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// A law of phase angle, 1 at 90°.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum PhaseLaw {
    /// Lambert sphere: sin γ + (π − γ) cos γ
    #[default]
    Lambert,
    /// Illuminated fraction of the disc: 1 + cos γ
    Illuminated,
}

impl From<PhaseLaw> for apply::PhaseLaw {
    fn from(asked: PhaseLaw) -> Self {
        match asked {
            PhaseLaw::Lambert => Self::Lambert,
            PhaseLaw::Illuminated => Self::Illuminated,
        }
    }
}

/// Applies.
pub fn run(args: &ApplyArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    let others = OutputArgs { output: args.photometry_out.clone(), force: args.out.force };
    others.check()?;
    let is_photometry = args.magnitudes.is_some() || args.spectrum.is_some();
    if !args.photometry_out.is_empty() && !is_photometry {
        bail!(
            "--photometry-out needs --magnitudes BAND or --spectrum SPECTRUM: nothing else is photometry"
        );
    }
    let input = apply::read(&args.calibration, &args.curve)?;
    let station = args.station.of_curve(&input.curve.provenance, console)?;
    let mut found = apply::apply(&input, &station, args.night.as_deref()).map_err(hint)?;
    if is_photometry {
        let air = args.model.air(station.site.geodetic().height_m, Some(&station))?;
        found.add_photometry(&station, &air, &args.photometry()).map_err(hint)?;
    }
    for warning in &found.warnings {
        console.warn(warning);
    }
    let report = report::AppliedReport { found: &found, station: &station };
    let product = report.product()?;
    let files = match &found.photometry {
        Some(photometry) => others.files_of(&report::photometry_product(photometry))?,
        None => Vec::new(),
    };
    args.out.finish_with(&product, files, &report.text(), console)
}

impl ApplyArgs {
    fn photometry(&self) -> PhotometryOptions {
        let usual = PhotometryOptions::default();
        PhotometryOptions {
            spectrum: self.spectrum.clone().unwrap_or(usual.spectrum),
            band: self.magnitudes.clone().unwrap_or(usual.band),
            zero_point: self.zero_point,
            phase_law: self.phase_law.into(),
            keep_aerosol: self.model.aerosol.is_some(),
        }
    }
}

/// The error with the option that it is about.
fn hint(error: ApplyError) -> anyhow::Error {
    match error {
        ApplyError::NoNight { .. } => anyhow!("{error}, --night takes another's all the same"),
        ApplyError::Spectrum { name, source } => anyhow::Error::new(source).context(format!(
            "--spectrum `{name}` is neither `sun`, nor a file, nor a star's type"
        )),
        error => error.into(),
    }
}
