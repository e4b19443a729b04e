//! Why a target has no place at an epoch.

use std::fmt;

/// Why an orbit has no state to give. The message holds the numbers, and what to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OrbitError {
    /// SGP4 cannot start from these elements.
    #[error("{name}: SGP4 cannot start from these elements: {reason}; take another set")]
    Elements {
        /// The object.
        name: String,
        /// Reason that the propagator gives.
        reason: String,
    },
    /// The model's orbit came down, or came apart, by that time.
    #[error(
        "{name}: decayed or out of SGP4's reach {hours_after_epoch:+.2} h from the epoch of its elements ({elements_epoch_utc}): {cause}; \
         take elements nearer to {epoch_utc}, or an earlier time"
    )]
    Decayed {
        /// The object.
        name: String,
        /// The epoch that was asked for, UTC.
        epoch_utc: String,
        /// The epoch of the elements, UTC.
        elements_epoch_utc: String,
        /// The former after the latter, h.
        hours_after_epoch: f64,
        /// Cause that SGP4 found.
        cause: DecayCause,
    },
    /// The epoch is not in the table.
    #[error(
        "{name}: {epoch_utc} is outside the table of positions, which holds {first_utc} to {last_utc} and is not extrapolated"
    )]
    OutsideEphemeris {
        /// The object.
        name: String,
        /// The epoch that was asked for, UTC.
        epoch_utc: String,
        /// The first row, UTC.
        first_utc: String,
        /// The last row, UTC.
        last_utc: String,
    },
    /// A table with too few rows.
    #[error("{name}: {rows} rows of positions; at least {needed} are needed to interpolate")]
    TooFewRows {
        /// The object.
        name: String,
        /// Number of those there are.
        rows: usize,
        /// How many there should be: 2 with velocities, 4 without.
        needed: usize,
    },
    /// A row that cannot be.
    #[error("{name}, row {row}: {quantity} is {value}, expected {expected}")]
    Row {
        /// The object.
        name: String,
        /// The row, counted from 0.
        row: usize,
        /// Quantity that is wrong, with its unit.
        quantity: &'static str,
        /// Value.
        value: String,
        /// Value that would be right.
        expected: &'static str,
    },
}

/// Cause for which SGP4 could not go on.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum DecayCause {
    /// The mean eccentricity left 0…1 by drag or by the secular effects of the Sun and the Moon (error 1 of the published code).
    MeanEccentricity(f64),
    /// The eccentricity left 0…1 by the periodic effects of the Sun and the Moon (error 3).
    PerturbedEccentricity(f64),
    /// The semi-latus rectum became negative (error 4).
    SemiLatusRectum,
    /// The place is below the Earth's equatorial radius, 6378.135 km from its centre (error 6); here that distance in km.
    BelowSurface(f64),
    /// The result is not a number: the mean motion has run away (error 2 of the published code, which this
    /// propagator does not test).
    NotFinite,
}

impl std::error::Error for DecayCause {}

impl fmt::Display for DecayCause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::MeanEccentricity(e) => {
                write!(f, "the mean eccentricity is {e:.6}, outside 0 to 1")
            }
            Self::PerturbedEccentricity(e) => {
                write!(f, "the eccentricity under the Sun and the Moon is {e:.6}, outside 0 to 1")
            }
            Self::SemiLatusRectum => f.write_str("the semi-latus rectum is negative"),
            Self::BelowSurface(km) => {
                write!(f, "it would be {km:.1} km from the Earth's centre, below the surface")
            }
            Self::NotFinite => f.write_str("the mean motion has no number"),
        }
    }
}
