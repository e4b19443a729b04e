//! `sunglint calibrate`: the coefficient of every channel and night from visits to stars.

use crate::air::{AirModelArgs, implausible};
use crate::output::{Console, OutputArgs};
use crate::station::StationArgs;
use anyhow::bail;
use clap::Args;
use std::path::PathBuf;
use sunglint_calibration::stars::scintillation::USUAL_COEFFICIENT;
use sunglint_calibration::stars::{
    NightsError, NightsOptions, Options, calibrate_nights, read_visits,
};
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_report::calibrate as report;

/// Arguments of `sunglint calibrate`.
#[derive(Debug, Args)]
pub struct CalibrateArgs {
    /// Linear light curves of stars (ECSV), or folders of them
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// Relative scatter of catalogued magnitudes and types at least
    #[arg(long, value_name = "FRACTION", default_value_t = 0.02, allow_negative_numbers = true)]
    pub floor: f64,
    /// Standard deviations beyond which a visit is an outlier
    #[arg(long, value_name = "K", default_value_t = 4.0, allow_negative_numbers = true)]
    pub clip_sigma: f64,
    /// Coverage of the intervals
    #[arg(long, value_name = "P", default_value_t = 0.95, allow_negative_numbers = true)]
    pub confidence: f64,
    /// Fit an aerosol's optical depth with kappa, where the range of airmass allows it
    #[arg(long)]
    pub fit_aerosol: bool,
    /// Young's coefficient of the scintillation
    #[arg(long, value_name = "C", default_value_t = USUAL_COEFFICIENT, allow_negative_numbers = true)]
    pub scintillation: f64,
    /// Magnitude of Vega that V counts from, or `ab`
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

/// Calibrates; `seed` is the bootstrap's.
pub fn run(args: &CalibrateArgs, seed: u64, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    args.out.check_names(&["calibration.ecsv"])?;
    if !(0.0..=10.0).contains(&args.scintillation) {
        bail!("--scintillation is {}, expected 0 to 10", args.scintillation);
    }
    let station = args.station.get()?;
    let air = args.model.air(station.site.geodetic().height_m, Some(&station))?;
    let mut warnings = [station.warnings.clone(), implausible(&air)].concat();
    let (visits, left_out) = read_visits(&args.inputs).map_err(hint)?;
    warnings.extend(left_out);
    let found = calibrate_nights(&visits, &station, &air, &args.options(seed));
    warnings.extend(match &found {
        Ok(found) => found.warnings.clone(),
        Err(NightsError::NoNight { warnings, .. }) => warnings.clone(),
        Err(_) => Vec::new(),
    });
    for warning in &warnings {
        console.warn(warning);
    }
    let report =
        report::CalibrationReport { found: &found?, station: &station, warnings: &warnings };
    args.out.finish(&report.product(), &report.text(), console)
}

impl CalibrateArgs {
    fn options(&self, seed: u64) -> NightsOptions {
        let fit = Options {
            floor: self.floor,
            clip_sigma: self.clip_sigma,
            confidence: self.confidence,
            fit_aerosol: self.fit_aerosol,
            seed,
            ..Options::default()
        };
        NightsOptions { fit, scintillation: self.scintillation, zero_point: self.zero_point }
    }
}

/// The error with the option that may help.
fn hint(error: NightsError) -> anyhow::Error {
    match error {
        NightsError::Reduce(error) => crate::reduce::hint(error),
        error => error.into(),
    }
}
