//! Why there is no comparison.

use std::path::PathBuf;
use sunglint_calibration::comparison::ComparisonError;
use sunglint_formats::{FileError, ParseError};
use sunglint_radiometry::light_curve::RateKind;
use sunglint_radiometry::light_curve::published::PublishedError;
use sunglint_simulator::pass::PassError;

fn advice(kind: RateKind) -> &'static str {
    match kind {
        RateKind::Raw | RateKind::Linear => {
            "a rate is compared when the night's coefficient is in it: `sunglint calibrate` finds it from stars, `sunglint apply` multiplies"
        }
        _ => "a simulation is no measurement",
    }
}

/// Why there is no comparison.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CompareError {
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file that is not what it should be.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// A file that is no curve.
    #[error(transparent)]
    Published(#[from] PublishedError),
    /// Magnitudes whose zero point nobody knows.
    #[error(
        "{}: its magnitudes are differences from comparison stars: without a zero point they cannot be compared with a model",
        path.display()
    )]
    Relative {
        /// The measured file.
        path: PathBuf,
    },
    /// Samples out of order, or none.
    #[error("{}", path.display())]
    Order {
        /// The measured file.
        path: PathBuf,
        /// Cause of the error.
        source: Box<ComparisonError>,
    },
    /// Rates that are not calibrated.
    #[error("{}: its rates are {kind}, expected calibrated ({})", path.display(), advice(*.kind))]
    NotCalibrated {
        /// The measured file.
        path: PathBuf,
        /// Kind of the curve's rates.
        kind: RateKind,
    },
    /// An exposure that is none.
    #[error("{}: exposure_s, row {row}: expected a time above 0 s", path.display())]
    Exposure {
        /// The measured file.
        path: PathBuf,
        /// The row, from 1.
        row: usize,
    },
    /// A channel that was asked for and not measured.
    #[error("{} has no channel `{channel}`: it has {has}", path.display())]
    NoChannel {
        /// The measured file.
        path: PathBuf,
        /// The channel.
        channel: String,
        /// Those that it has.
        has: String,
    },
    /// A measured channel that the station lacks.
    #[error("{}: its channel `{channel}` is none of the station {station} ({has})", path.display())]
    NotOfTheStation {
        /// The measured file.
        path: PathBuf,
        /// The channel.
        channel: String,
        /// The station.
        station: String,
        /// The channels that it has.
        has: String,
    },
    /// A scene without times.
    #[error("a scene without times")]
    NoTimes,
    /// Measured and simulated spans of time that do not meet.
    #[error("{}, [times] of {scene}", path.display())]
    Times {
        /// The measured file.
        path: PathBuf,
        /// The scene's name.
        scene: String,
        /// The spans.
        source: Box<ComparisonError>,
    },
    /// More samples than are compared.
    #[error("{}: {samples} samples in the scene's times, at most {most} are compared: give shorter [times]", path.display())]
    TooMany {
        /// The measured file.
        path: PathBuf,
        /// Samples in the scene's times.
        samples: usize,
        /// How many are compared at most.
        most: usize,
    },
    /// A scene that cannot be simulated.
    #[error(transparent)]
    Simulation(#[from] PassError),
    /// No sample that is left to compare.
    #[error("{}", path.display())]
    NothingLeft {
        /// The measured file.
        path: PathBuf,
        /// Why, channel by channel.
        source: Box<ComparisonError>,
    },
}
