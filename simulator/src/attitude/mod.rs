//! How a body is turned: the rotation from its own axes to the GCRS at a moment.

use crate::orbit::State;
use glam::DVec3;
use hifitime::Epoch;

/// What an attitude law may look at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// When (at the target).
    pub epoch: Epoch,
    /// The target's position and velocity, GCRS.
    pub target: State,
    /// Unit vector from the target to the Sun, GCRS axes.
    pub to_sun: DVec3,
}
