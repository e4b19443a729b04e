//! Curves with their scenes, as the command line names them.

use crate::curve_file::{Magnitudes, with_hint};
use crate::output::Usage;
use crate::station::StationArgs;
use anyhow::anyhow;
use std::path::PathBuf;
use sunglint_inference::measured::{self, CurveOfScene, MeasuredError};

/// Reads curves with the scene that stands after them.
pub(crate) fn joined(
    inputs: &[PathBuf],
    magnitudes: &Magnitudes,
) -> anyhow::Result<Vec<CurveOfScene>> {
    measured::joined(inputs, &magnitudes.options()).map_err(told)
}

/// Gives each scene the station that was asked for, or the usual one where it names none.
pub(crate) fn with_stations(curves: &mut [CurveOfScene], from: &StationArgs) -> anyhow::Result<()> {
    for curve in curves {
        curve.station = if from.station.is_some() {
            Some(from.get()?)
        } else if curve.scene.names_station() {
            None
        } else {
            let path = curve.scene.path.display();
            Some(from.get_or(&format!("(or name one in [station] of {path})"))?)
        };
    }
    Ok(())
}

/// The error with the option that may help.
pub(crate) fn told(error: MeasuredError) -> anyhow::Error {
    match error {
        MeasuredError::Published(error) => with_hint(error),
        MeasuredError::NoCurve { .. } | MeasuredError::NoScene { .. } | MeasuredError::Nothing => {
            Usage(format!("{error}: MEASURED… PASS.toml")).into()
        }
        MeasuredError::NotCalibrated { ref path, .. } => {
            anyhow!("{error}: `sunglint apply CALIBRATION {}` makes them so", path.display())
        }
        MeasuredError::NotOfTheStation { .. } => {
            anyhow!("{error}; --channel NAME fits some of the curve's channels alone")
        }
        error => error.into(),
    }
}
