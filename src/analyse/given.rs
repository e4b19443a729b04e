//! A curve and the light under which it was taken.

use crate::air::AirModelArgs;
use crate::output::Console;
use crate::simulate;
use crate::station::StationArgs;
use anyhow::anyhow;
use clap::Args;
use std::path::{Path, PathBuf};
use sunglint_analysis::samples::{NO_RANGE, SampledCurve, SamplesError};
use sunglint_inference::lit_curve::LitCurve;
use sunglint_simulator::pass::Overrides;

/// Known facts about the light: a scene, or a station and its air.
#[derive(Debug, Args)]
pub struct GivenArgs {
    /// The scene of the curve: where target and Sun stood, its air and station
    #[arg(long, value_name = "PASS.toml")]
    pub pass: Option<PathBuf>,
    /// The rates are those above the air
    #[arg(long, conflicts_with_all = ["profile", "pressure_hpa", "ozone_du", "water_mm", "co2_ppm", "aerosol", "no_refraction"])]
    pub no_air: bool,
    /// Which station, in place of the scene's.
    #[command(flatten)]
    pub station: StationArgs,
    /// Known properties of the air, where no scene says.
    #[command(flatten)]
    pub model: AirModelArgs,
}

impl GivenArgs {
    /// Reads a curve, and the scene or the station.
    pub fn read(&self, path: &Path, console: Console) -> anyhow::Result<LitCurve> {
        let curve = SampledCurve::read(path).map_err(worded)?;
        if let Some(scene) = &self.pass {
            let pass = simulate::read(scene, &self.station, Overrides::default())?;
            return Ok(LitCurve::of_scene(curve, pass, self.no_air)?);
        }
        let station = match curve.needs_station(self.no_air) {
            true => Some(self.station.of_curve(curve.provenance(), console)?),
            false => None,
        };
        let air = match &station {
            Some(s) if !self.no_air => Some(self.model.air(s.site.geodetic().height_m, Some(s))?),
            _ => None,
        };
        Ok(LitCurve::of_station(curve, station, air))
    }
}

/// The error with the option or the command that may help.
pub(super) fn worded(error: SamplesError) -> anyhow::Error {
    match error {
        SamplesError::Kind { .. } => {
            anyhow!("{error}: `sunglint apply` makes calibrated rates of linear ones")
        }
        SamplesError::Channel { .. } => anyhow!("{error} with --station"),
        SamplesError::Zenith { .. } => anyhow!(
            "{error}: give --pass PASS.toml, which knows where the target stood, or --no-air"
        ),
        error => error.into(),
    }
}

/// The warnings with the options that may help.
pub(super) fn with_options(warnings: &mut [String]) {
    for warning in warnings.iter_mut().filter(|w| *w == NO_RANGE) {
        warning.push_str(" (--pass PASS.toml knows the range)");
    }
}
