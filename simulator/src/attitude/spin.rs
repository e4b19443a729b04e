//! A steady spin about an axis that is fixed among the stars.

use super::{AttitudeError, MOST_TURNS_PER_S, seconds_between};
use glam::{DQuat, DVec3};
use hifitime::Epoch;
use std::f64::consts::TAU;

/// A steady spin about a fixed axis. The period is the inertial (sidereal) one: against the stars, not that between two glints,
/// which the motion of Sun and observer changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spin {
    axis_gcrs: DVec3,
    turns_per_s: f64,
    epoch: Epoch,
    at_epoch: DQuat,
}

impl Spin {
    /// A body that stands as `body_to_gcrs` at an epoch and turns about an axis in the GCRS, `turns_per_s` revolutions a second:
    /// positive is right-handed about the axis (anticlockwise seen from its tip).
    ///
    /// # Errors
    /// An axis that is zero, or numbers that are not finite.
    pub fn new(
        axis_gcrs: DVec3,
        turns_per_s: f64,
        body_to_gcrs: DQuat,
        epoch: Epoch,
    ) -> Result<Self, AttitudeError> {
        let axis_gcrs =
            axis_gcrs.try_normalize().ok_or(AttitudeError::NotFinite { what: "the spin axis" })?;
        if !turns_per_s.is_finite() {
            return Err(AttitudeError::NotFinite { what: "the rate of the spin" });
        }
        if turns_per_s.abs() > MOST_TURNS_PER_S {
            return Err(AttitudeError::TooFast { what: "the spin", turns_per_s });
        }
        Ok(Self { axis_gcrs, turns_per_s, epoch, at_epoch: body_to_gcrs })
    }

    /// The same about an axis of the body.
    ///
    /// # Errors
    /// The errors of [`Spin::new`].
    pub fn about_body_axis(
        axis_body: DVec3,
        turns_per_s: f64,
        body_to_gcrs: DQuat,
        epoch: Epoch,
    ) -> Result<Self, AttitudeError> {
        Self::new(body_to_gcrs * axis_body, turns_per_s, body_to_gcrs, epoch)
    }

    /// A body whose axis `axis_body` lies along `axis_gcrs` and is its spin axis. At the epoch it stands as the shortest rotation of
    /// the one axis to the other leaves it (of the half turns for opposite axes, the one about the axis that lies in the
    /// body's x–y plane, or about its x for an axis along z), turned further by `phase_rad` about the axis.
    ///
    /// # Errors
    /// The errors of [`Spin::new`].
    pub fn along(
        axis_body: DVec3,
        axis_gcrs: DVec3,
        turns_per_s: f64,
        phase_rad: f64,
        epoch: Epoch,
    ) -> Result<Self, AttitudeError> {
        let unit = |axis: DVec3| {
            axis.try_normalize().ok_or(AttitudeError::NotFinite { what: "the spin axis" })
        };
        let (body, gcrs) = (unit(axis_body)?, unit(axis_gcrs)?);
        if !phase_rad.is_finite() {
            return Err(AttitudeError::NotFinite { what: "the phase of the spin" });
        }
        let shortest = if 1.0 + body.dot(gcrs) > 1e-12 {
            let across = body.cross(gcrs);
            DQuat::from_xyzw(across.x, across.y, across.z, 1.0 + body.dot(gcrs)).normalize()
        } else {
            let across = DVec3::Z.cross(body).try_normalize().unwrap_or(DVec3::X);
            DQuat::from_xyzw(across.x, across.y, across.z, 0.0)
        };
        let at_epoch = DQuat::from_axis_angle(gcrs, phase_rad) * shortest;
        Self::new(gcrs, turns_per_s, at_epoch.normalize(), epoch)
    }

    /// The rotation from body axes to the GCRS.
    pub fn body_to_gcrs(&self, epoch: Epoch) -> DQuat {
        let turns = self.turns_per_s * seconds_between(self.epoch, epoch);
        let angle_rad = TAU * (turns - turns.round());
        (DQuat::from_axis_angle(self.axis_gcrs, angle_rad) * self.at_epoch).normalize()
    }
}
