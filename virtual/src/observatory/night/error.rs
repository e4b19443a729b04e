//! Why there is no such night.

use crate::options::OptionError;
use hifitime::Epoch;
use sunglint_radiometry::air::AirError;
use sunglint_radiometry::sky::{SkyError, StarError};
use sunglint_radiometry::star_light::StarLightError;

/// Why there is no such night.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NightError {
    /// A value that a night cannot have.
    #[error(transparent)]
    Option(#[from] OptionError),
    /// A channel that the station does not have.
    #[error("{key}: the station {station} has no channel {channel}; it has {known}")]
    Channel {
        /// The table of the options.
        key: &'static str,
        /// Channel that was asked for.
        channel: String,
        /// The station.
        station: String,
        /// Channels that there are.
        known: String,
    },
    /// A dead time of the station that no virtual counter has.
    #[error(
        "channel {channel}: its dead time is of a kind that virtual counters do not have; give [counter.{channel}] a dead_time_model"
    )]
    DeadTime {
        /// The channel.
        channel: String,
    },
    /// A star that the catalogue does not have.
    #[error(transparent)]
    Star(#[from] StarError),
    /// A star without light.
    #[error("{star}: {source}")]
    Light {
        /// The star.
        star: String,
        /// Why.
        source: StarLightError,
    },
    /// A star that is below the horizon.
    #[error("{star} is {:.1}° below the horizon at {at}: visit it when it is up", zenith_deg - 90.0)]
    Below {
        /// The star.
        star: String,
        /// When.
        at: Epoch,
        /// True zenith angle, degrees.
        zenith_deg: f64,
    },
    /// No star for the plan.
    #[error("no star of V {} to {} mag stands {} to {}° high at {at}: widen plan.v_mag or plan.altitude_deg", v_mag[0], v_mag[1], altitude_deg[0], altitude_deg[1])]
    NoStar {
        /// The range of magnitudes.
        v_mag: [f64; 2],
        /// The range of altitudes, degrees.
        altitude_deg: [f64; 2],
        /// When.
        at: Epoch,
    },
    /// Visits that overlap or do not follow each other.
    #[error(
        "visit {number} begins at {from_s} s, before the end of the one before it at {before_s} s"
    )]
    Overlap {
        /// Number, from 0.
        number: usize,
        /// When it begins, s.
        from_s: f64,
        /// When the one before it ends, s.
        before_s: f64,
    },
    /// A satellite without a curve.
    #[error(
        "visit {number} ({name}) is of a satellite: it needs a `curve`, a predicted light curve (sunglint simulate)"
    )]
    NoCurve {
        /// Number, from 0.
        number: usize,
        /// Name.
        name: String,
    },
    /// A curve that cannot be read.
    #[error("{message}")]
    Curve {
        /// Why, with its path.
        message: String,
    },
    /// A curve whose columns are not of one length, or one rate short.
    #[error(
        "the curve of {name} has {times} times and {rows} rows of rates for {channels} channels: expected one row with all channels a time, increasing"
    )]
    CurveShape {
        /// The target.
        name: String,
        /// Number of times.
        times: usize,
        /// Number of rows.
        rows: usize,
        /// Number of the station's channels.
        channels: usize,
    },
    /// The sky.
    #[error(transparent)]
    Sky(#[from] SkyError),
    /// The air.
    #[error(transparent)]
    Air(#[from] AirError),
}
