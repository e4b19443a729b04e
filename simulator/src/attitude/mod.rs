//! How a body is turned: the rotation from its own axes to the GCRS at a moment.
//!
//! Every law is a function of the moment alone: any moment costs the same, in any order, and nothing drifts. A motion under torques is integrated once,
//! over the time that is asked for ([`torques`]), and is then read like a table.
//!
//! # Conventions
//! A rotation `a_to_b` takes the coordinates of a vector in axes a to its coordinates in axes b. In files it is `[w, x, y, z]`, or
//! three angles `euler_zyx_deg = [yaw, pitch, roll]`: a body whose axes lie along b's is turned by yaw about its z, then by pitch about
//! its new y, then by roll about its newest x (intrinsic z-y′-x″, all right-handed), so that `a_to_b` = R_z(yaw) R_y(pitch) R_x(roll).

mod elliptic;
pub mod file;
mod pointing;
mod spin;
mod table;
pub mod torques;
mod tumble;

use glam::{DQuat, DVec3};
use hifitime::Epoch;
use sunglint_ephemeris::orbit::State;
use sunglint_ephemeris::orbit::seconds_between;

pub use pointing::{Direction, Pointing, orbit_to_gcrs};
pub use spin::Spin;
pub use table::{AttitudeTable, Interpolation};
pub use tumble::{Inertia, Tumble};

/// Circumstances of one moment that an attitude law may use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// When (at the target).
    pub epoch: Epoch,
    /// The target's position and velocity, GCRS.
    pub target: State,
    /// Unit vector from the target to the Sun, GCRS axes.
    pub to_sun: DVec3,
}

/// An attitude law.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Attitude {
    /// Fixed among the stars: body → GCRS.
    Inertial(DQuat),
    /// A steady spin about an axis that is fixed among the stars.
    Spin(Spin),
    /// A rigid body without torque.
    Tumble(Tumble),
    /// Follows the orbit with a constant offset: body → the orbit's axes (see [`orbit_to_gcrs`]).
    Orbit(DQuat),
    /// Two axes that point: at the Sun, at the Earth …
    Pointing(Pointing),
    /// A table of attitudes.
    Table(AttitudeTable),
    /// A rigid body under torques, integrated over a span of time.
    Torques(std::sync::Arc<torques::Driven>),
}

/// The fastest spin, 1/s: a day later its phase still has four digits, and nothing larger than dust turns faster.
const MOST_TURNS_PER_S: f64 = 1e6;

/// Fault of an attitude.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AttitudeError {
    /// A time that the table does not reach.
    #[error(
        "the attitude is asked for at {epoch}, but its table runs from {first} to {last}: nothing is extrapolated"
    )]
    OutsideTable {
        /// The time.
        epoch: String,
        /// The table's first time.
        first: String,
        /// The table's last time.
        last: String,
    },
    /// Two directions that would define an attitude are parallel.
    #[error("{what} are parallel or zero, so that they define no attitude")]
    Undefined {
        /// Which directions.
        what: &'static str,
    },
    /// Both axes point at the same.
    #[error("both axes point at {what}: the second needs another direction")]
    SameDirection {
        /// At what.
        what: &'static str,
    },
    /// A number that is none.
    #[error("{what} is not finite, or zero where it must not be")]
    NotFinite {
        /// Name of the quantity.
        what: &'static str,
    },
    /// A spin that no body survives, and of which no phase would be left.
    #[error(
        "{what} is {turns_per_s:e} turns a second; at most {MOST_TURNS_PER_S:e} have a phase that means something"
    )]
    TooFast {
        /// Name of the quantity.
        what: &'static str,
        /// The rate, 1/s.
        turns_per_s: f64,
    },
    /// A tensor that no body has.
    #[error("no body has this inertia: {why}")]
    Inertia {
        /// Why, with the numbers.
        why: String,
    },
    /// A quaternion that is no rotation.
    #[error("the quaternion has the length {length}, not 1 (to 1e-6): it is no rotation")]
    NotUnit {
        /// Length of the quaternion.
        length: f64,
    },
    /// A time to which a motion under torques was not followed.
    #[error(
        "the attitude is asked for at {epoch}, but the motion under torques was followed from {first} to {last}"
    )]
    NotFollowed {
        /// The time.
        epoch: String,
        /// The first time.
        first: String,
        /// The last time.
        last: String,
    },
    /// A motion under torques that cannot be followed.
    #[error("the motion under torques cannot be followed: {why}")]
    Torques {
        /// Why, with the numbers.
        why: String,
    },
    /// A table without rows, or with columns of several lengths.
    #[error("the table has {times} times and {attitudes} attitudes: as many of both, at least one")]
    TableSize {
        /// Times.
        times: usize,
        /// Attitudes.
        attitudes: usize,
    },
    /// Times that do not increase.
    #[error("row {row} of the table, {epoch}, is not after the row before it")]
    TableOrder {
        /// The row, from 1.
        row: usize,
        /// Time of the row.
        epoch: String,
    },
    /// A quaternion of a table that is no rotation.
    #[error("the quaternion of row {row} has the length {length}, not 1 (to 1e-6)")]
    TableNotUnit {
        /// The row, from 1.
        row: usize,
        /// Length of the quaternion.
        length: f64,
    },
}

impl Attitude {
    /// The rotation from body axes to the GCRS, a unit quaternion.
    ///
    /// # Errors
    /// [`AttitudeError::OutsideTable`]; [`AttitudeError::Undefined`] at a moment at which the directions that the body points at are
    /// parallel. Inertial, spinning and tumbling bodies have an attitude at every moment.
    pub fn body_to_gcrs(&self, moment: &Moment) -> Result<DQuat, AttitudeError> {
        match self {
            Attitude::Inertial(body_to_gcrs) => Ok(*body_to_gcrs),
            Attitude::Spin(spin) => Ok(spin.body_to_gcrs(moment.epoch)),
            Attitude::Tumble(tumble) => Ok(tumble.body_to_gcrs(moment.epoch)),
            Attitude::Orbit(body_to_orbit) => {
                Ok((orbit_to_gcrs(moment)? * *body_to_orbit).normalize())
            }
            Attitude::Pointing(pointing) => pointing.body_to_gcrs(moment),
            Attitude::Table(table) => table.body_to_gcrs(moment.epoch),
            Attitude::Torques(driven) => driven.body_to_gcrs(moment.epoch),
        }
    }

    /// Returns warnings about steps of a table so large that the way between rows is a guess.
    pub fn warnings(&self) -> Vec<String> {
        const LARGE_STEP_DEG: f64 = 90.0;
        match self {
            Attitude::Table(table) if table.largest_step_deg() > LARGE_STEP_DEG => vec![format!(
                "the attitude turns by up to {:.0}° between rows of its table; the shortest way is taken, which may not be the body's: give more rows",
                table.largest_step_deg()
            )],
            _ => Vec::new(),
        }
    }
}

/// The rotation R_z(yaw) R_y(pitch) R_x(roll), radians; see the module for its meaning.
pub fn euler_zyx(yaw_rad: f64, pitch_rad: f64, roll_rad: f64) -> DQuat {
    DQuat::from_rotation_z(yaw_rad)
        * DQuat::from_rotation_y(pitch_rad)
        * DQuat::from_rotation_x(roll_rad)
}

/// A rotation from the four numbers of a file, `[w, x, y, z]`.
///
/// # Errors
/// A length that differs from 1 by more than 1e-6: six digits are a rounding, more is a mistake.
pub fn quaternion_wxyz(wxyz: [f64; 4]) -> Result<DQuat, AttitudeError> {
    let [w, x, y, z] = wxyz;
    unit(DQuat::from_xyzw(x, y, z, w)).map_err(|length| AttitudeError::NotUnit { length })
}

/// The same quaternion with unit length, or its length where that is not 1 within 1e-6.
fn unit(q: DQuat) -> Result<DQuat, f64> {
    let length = q.length();
    // Written so that NaN is refused too.
    if (length - 1.0).abs() <= 1e-6 { Ok(q.normalize()) } else { Err(length) }
}
