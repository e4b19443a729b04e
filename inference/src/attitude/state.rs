//! A steady spin as the search moves it.

use super::AttitudeError;
use glam::{DQuat, DVec3};
use hifitime::Epoch;
use std::f64::consts::TAU;
use sunglint_simulator::attitude::Spin;

/// Unknown numbers of a spin; the others are known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unknowns {
    /// The axis among the stars: two numbers.
    pub axis: bool,
    /// How far the body is turned about it at the law's epoch.
    pub phase: bool,
    /// The period and the sense.
    pub period: bool,
}

impl Unknowns {
    /// How many numbers.
    pub fn count(self) -> usize {
        2 * usize::from(self.axis) + usize::from(self.phase) + usize::from(self.period)
    }
}

/// A spin by the numbers of a scene file (law `spin` with `axis_body`, `axis_ra_dec_deg`, `phase_deg`, `period_s`, `epoch_utc`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn {
    /// The axis, GCRS, a unit vector: the body's own axis points there.
    pub axis_gcrs: DVec3,
    /// Turns a second against the stars; negative is left-handed about the axis.
    pub turns_per_s: f64,
    /// The turn about the axis at the law's epoch, radians, as [`Spin::along`] counts it.
    pub phase_rad: f64,
}

/// Constants of all trials: the axis in the body, and from when the phase counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Law {
    axis_body: DVec3,
    epoch: Epoch,
    /// The law's epoch, s after [`super::Forward::zero`].
    pub epoch_s: f64,
    /// The moment at which [`State::at_zero`] stands, s after [`super::Forward::zero`]: in the middle of the data that are looked at.
    pub middle_s: f64,
    /// Half of what these span, s: at least 1e-3.
    pub half_span_s: f64,
}

/// A trial: how the body stands in the middle of the data, and how fast it turns about its axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Body to GCRS in the middle ([`Law::middle_s`]).
    pub at_zero: DQuat,
    /// Turns a second.
    pub turns_per_s: f64,
}

impl Law {
    /// A body that turns about `axis_body` (any length above 0); its phase counts at `epoch`, seconds from `zero`, `half_span_s` of them to both sides.
    ///
    /// # Errors
    /// An axis that is zero or not finite.
    pub fn new(
        axis_body: DVec3,
        epoch: Epoch,
        zero: Epoch,
        half_span_s: f64,
    ) -> Result<Self, AttitudeError> {
        let axis_body = axis_body.try_normalize().ok_or(AttitudeError::Axis { axis_body })?;
        let half_span_s = half_span_s.max(1e-3);
        let epoch_s = (epoch - zero).to_seconds();
        Ok(Self { axis_body, epoch, epoch_s, middle_s: 0.0, half_span_s })
    }

    /// The body's own axis of the spin, unit.
    pub fn axis_body(&self) -> DVec3 {
        self.axis_body
    }

    /// The attitude of phase 0 for an axis.
    ///
    /// # Errors
    /// The errors of [`Spin::along`].
    pub fn upright(&self, axis_gcrs: DVec3) -> Result<DQuat, AttitudeError> {
        Ok(Spin::along(self.axis_body, axis_gcrs, 0.0, 0.0, self.epoch)?.body_to_gcrs(self.epoch))
    }

    /// The trial of a spin.
    ///
    /// # Errors
    /// The errors of [`Spin::along`].
    pub fn state(&self, turn: &Turn) -> Result<State, AttitudeError> {
        let Turn { axis_gcrs, turns_per_s, phase_rad } = *turn;
        let spin = Spin::along(self.axis_body, axis_gcrs, turns_per_s, phase_rad, self.epoch)?;
        let middle = self.epoch + hifitime::Duration::from_seconds(self.middle_s - self.epoch_s);
        Ok(State { at_zero: spin.body_to_gcrs(middle), turns_per_s })
    }

    /// The same law for data with another middle and span.
    pub fn about(&self, middle_s: f64, half_span_s: f64) -> Self {
        Self { middle_s, half_span_s: half_span_s.max(1e-3), ..*self }
    }

    /// A trial of this law as one of another that has its middle elsewhere.
    pub fn carried(&self, state: &State, to: &Self) -> State {
        State { at_zero: self.at(state, to.middle_s), ..*state }
    }

    /// The spin of a trial.
    ///
    /// # Errors
    /// The errors of [`Law::upright`].
    pub fn turn(&self, state: &State) -> Result<Turn, AttitudeError> {
        let axis_gcrs = (state.at_zero * self.axis_body).normalize();
        let there = self.at(state, self.epoch_s) * self.upright(axis_gcrs)?.conjugate();
        let along = DVec3::new(there.x, there.y, there.z).dot(axis_gcrs);
        let phase_rad = (2.0 * along.atan2(there.w)).rem_euclid(TAU);
        Ok(Turn { axis_gcrs, turns_per_s: state.turns_per_s, phase_rad })
    }

    /// The axis among the stars.
    pub fn axis(&self, state: &State) -> DVec3 {
        (state.at_zero * self.axis_body).normalize()
    }

    /// Body to GCRS, s after [`super::Forward::zero`].
    pub fn at(&self, state: &State, time_s: f64) -> DQuat {
        let turns = state.turns_per_s * (time_s - self.middle_s);
        let angle = TAU * (turns - turns.round());
        (state.at_zero * DQuat::from_axis_angle(self.axis_body, angle)).normalize()
    }

    /// The trial that lies a small step away, radians: turns of the body about three axes across one another (the first two tilt the axis) where axis and phase are unknown; tilts alone, or
    /// the turn about the axis alone, where one of them is; then the period, by the turn at the end of the data that its change makes.
    ///
    /// # Errors
    /// The errors of [`Law::state`].
    pub fn moved(
        &self,
        state: &State,
        unknowns: Unknowns,
        step: &[f64],
    ) -> Result<State, AttitudeError> {
        let axis = self.axis(state);
        let across = axis.any_orthonormal_vector();
        let frame = [across, axis.cross(across), axis];
        let rest = 2 * usize::from(unknowns.axis) + usize::from(unknowns.phase);
        let by = |i: usize| step.get(i).copied().unwrap_or(0.0);
        let turns_per_s = state.turns_per_s
            + if unknowns.period { by(rest) / (TAU * self.half_span_s) } else { 0.0 };
        if unknowns.phase {
            let turn = match unknowns.axis {
                true => frame[0] * by(0) + frame[1] * by(1) + frame[2] * by(2),
                false => frame[2] * by(0),
            };
            let at_zero = (DQuat::from_scaled_axis(turn) * state.at_zero).normalize();
            return Ok(State { at_zero, turns_per_s });
        }
        let mut turn = self.turn(state)?;
        turn.turns_per_s = turns_per_s;
        if unknowns.axis {
            let tilt = frame[0] * by(0) + frame[1] * by(1);
            turn.axis_gcrs = DQuat::from_scaled_axis(tilt) * turn.axis_gcrs;
        }
        self.state(&turn)
    }

    /// Returns the largest difference of two trials at the ends and in the middle of the data: the angle of the rotation between them, radians.
    pub fn apart(&self, a: &State, b: &State) -> f64 {
        [-1.0, 0.0, 1.0]
            .map(|end| self.middle_s + end * self.half_span_s)
            .map(|t| angle(self.at(a, t), self.at(b, t)))
            .into_iter()
            .fold(0.0, f64::max)
    }
}

/// The angle of the rotation from one attitude to another, radians.
pub fn angle(a: DQuat, b: DQuat) -> f64 {
    let q = b * a.conjugate();
    2.0 * DVec3::new(q.x, q.y, q.z).length().atan2(q.w.abs())
}
