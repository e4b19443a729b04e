//! Why curves and scenes cannot be brought together.

use super::curve::NO_SIGMA;
use crate::scene::SceneError;
use std::path::PathBuf;
use sunglint_formats::{FileError, ParseError};
use sunglint_radiometry::light_curve::RateKind;
use sunglint_radiometry::light_curve::published::PublishedError;
use sunglint_simulator::pass::PassError;

fn reasons(left_out: &[(String, usize)]) -> String {
    let all: Vec<String> = left_out.iter().map(|(why, n)| format!("{n} {why}")).collect();
    all.join(", ")
}

fn advice(left_out: &[(String, usize)], flagged: bool) -> &'static str {
    if left_out.iter().any(|(why, _)| why == NO_SIGMA) {
        "a sample counts by its uncertainty; state uncertainties above 0 in the columns NAME_sigma_hz"
    } else if flagged {
        "every sample is flagged"
    } else {
        "do measured and simulated epochs belong to the same pass?"
    }
}

/// Why curves and scenes cannot be brought together.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeasuredError {
    /// Magnitudes whose zero point nobody knows.
    #[error(
        "{}: its magnitudes are differences from comparison stars: without a zero point they cannot be compared with a model",
        path.display()
    )]
    Relative {
        /// The file.
        path: PathBuf,
    },
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file that is no light curve of the schema.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// A file that is no curve.
    #[error(transparent)]
    Published(#[from] PublishedError),
    /// Times that the scene does not know.
    #[error("{}", path.display())]
    Times {
        /// The curve.
        path: PathBuf,
        /// Cause of the error.
        source: Box<PassError>,
    },
    /// A scene that is none.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A scene without a curve before it.
    #[error("no curve stands before the scene {}", scene.display())]
    NoCurve {
        /// The scene.
        scene: PathBuf,
    },
    /// A curve without a scene after it.
    #[error("no scene stands after the curve {}", curve.display())]
    NoScene {
        /// The curve.
        curve: PathBuf,
    },
    /// No file at all.
    #[error("neither a curve nor a scene")]
    Nothing,
    /// The same samples in two files.
    #[error("{} has the samples that {} has: give them once", path.display(), other.display())]
    Twice {
        /// The curve.
        path: PathBuf,
        /// The curve before it that has the same.
        other: PathBuf,
    },
    /// Curves of both kinds.
    #[error("rates and magnitudes cannot be fitted together: fit each on its own")]
    Mixed,
    /// Rates that are not calibrated.
    #[error("{}: its rates are {kind}, and only calibrated ones are compared with a simulation", path.display())]
    NotCalibrated {
        /// The curve.
        path: PathBuf,
        /// Kind of the curve's rates.
        kind: RateKind,
    },
    /// A curve without samples.
    #[error("{}: it has no sample", path.display())]
    NoSample {
        /// The curve.
        path: PathBuf,
    },
    /// A measured channel that the station lacks.
    #[error("{}: the station {station} has no channel `{channel}`, it has {known}", path.display())]
    NotOfTheStation {
        /// The curve.
        path: PathBuf,
        /// The station.
        station: String,
        /// The channel.
        channel: String,
        /// The channels that the station has.
        known: String,
    },
    /// A channel that was asked for and not measured.
    #[error("no curve has the channel `{channel}` that was asked for")]
    NotMeasured {
        /// The channel.
        channel: String,
    },
    /// No sample that counts.
    #[error("{}: no sample is left to be fitted ({}): {}", path.display(), reasons(.left_out), advice(.left_out, *.flagged))]
    NothingLeft {
        /// The curve.
        path: PathBuf,
        /// Why samples were left out, and how many.
        left_out: Vec<(String, usize)>,
        /// Whether the file's own flags left none.
        flagged: bool,
    },
}
