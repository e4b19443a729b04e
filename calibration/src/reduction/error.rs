//! Why a session cannot be reduced.

use crate::detector::DetectorError;
use crate::photometry::PhotometryError;
use sunglint_ephemeris::geometry::GeometryError;
use sunglint_ephemeris::orbit::OrbitError;
use sunglint_formats::{FileError, ParseError};
use sunglint_numerics::progress::Cancelled;
use sunglint_radiometry::sky::{SkyError, StarError};
use sunglint_radiometry::station::RecordedError;

/// Why a session cannot be reduced.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReduceError {
    /// No source near the place that was given for the target.
    #[error(
        "no source within {most_px} px of the place that was given for the target, column {column}, row {row}: look for it with `detect`, or leave the place out"
    )]
    NothingThere {
        /// Column of the place, px.
        column: f64,
        /// Row of the place, px.
        row: f64,
        /// Distance from it within which a source was looked for, px.
        most_px: f64,
    },
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// The session's station is not known.
    #[error(transparent)]
    Station(#[from] RecordedError),
    /// Options or frames that cannot be measured.
    #[error(transparent)]
    Photometry(#[from] PhotometryError),
    /// A law that no detector can have.
    #[error(transparent)]
    Detector(#[from] DetectorError),
    /// A place that no star can have.
    #[error(transparent)]
    Star(#[from] StarError),
    /// Elements that give no orbit.
    #[error(transparent)]
    Orbit(#[from] OrbitError),
    /// A satellite without a place at some epoch.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// An epoch for which the sky is not known.
    #[error(transparent)]
    Sky(#[from] SkyError),
    /// No frame that can be measured.
    #[error("no frame of the sky can be measured; left out: {left_out}")]
    NoFrame {
        /// Numbers of frames and why they were left out.
        left_out: String,
    },
    /// No target in the session's log.
    #[error("its log has no target")]
    NoTarget,
    /// The target that was asked for is not in the session's log.
    #[error("there is no target {wanted}; there are {}", known.join(", "))]
    UnknownTarget {
        /// The target that was asked for.
        wanted: String,
        /// The targets that there are.
        known: Vec<String>,
    },
    /// Frames, but no camera in the station.
    #[error(
        "station {station} has no [camera]: its size and noise are needed to measure the frames of session {session}"
    )]
    NoCamera {
        /// The station's name.
        station: String,
        /// The session's folder.
        session: String,
    },
    /// None of a counter's channels is in the station.
    #[error(
        "counter {counter} has the channels {}, and station {station} has a counter of none of these names: name them as the station does",
        channels.join(", ")
    )]
    NoChannel {
        /// The counter's name in the session.
        counter: String,
        /// Channels of the counter.
        channels: Vec<String>,
        /// The station's name.
        station: String,
    },
    /// Nothing was recorded.
    #[error("session {session} has neither a camera nor a counter")]
    NoInstrument {
        /// The session's folder.
        session: String,
    },
    /// Two instruments have a channel of one name.
    #[error("channel {channel} comes from two instruments: one name, one channel")]
    TwoInstruments {
        /// The channel.
        channel: String,
    },
    /// Calibration frames by which a good part of the sensor would be left out.
    #[error(
        "{bad} of {all} pixels are bad by {by}, more than {:.0} %: {hint}", 100.0 * super::sensor::MOST_BAD
    )]
    Mask {
        /// Pixels that would be left out.
        bad: usize,
        /// All pixels.
        all: usize,
        /// Calibration frames that say so.
        by: String,
        /// The remedy, in words.
        hint: &'static str,
    },
    /// The work was ended early.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// An error with the part of the work that it came from.
    #[error("{part}")]
    Within {
        /// The part of the work: a session, a camera, a counter.
        part: String,
        /// Error in that part.
        #[source]
        source: Box<ReduceError>,
    },
}

impl From<ParseError> for ReduceError {
    fn from(error: ParseError) -> Self {
        Self::File(error.into())
    }
}

/// Says which part of the work an error came from.
pub(super) trait Within<T> {
    /// Adds the part, which is only put together where there is an error.
    fn within(self, part: impl FnOnce() -> String) -> Result<T, ReduceError>;
}

impl<T, E: Into<ReduceError>> Within<T> for Result<T, E> {
    fn within(self, part: impl FnOnce() -> String) -> Result<T, ReduceError> {
        self.map_err(|error| ReduceError::Within { part: part(), source: Box::new(error.into()) })
    }
}
