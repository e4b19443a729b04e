//! Attitudes at times, with what lies between them.

use super::{AttitudeError, seconds_between};
use glam::DQuat;
use hifitime::Epoch;
use sunglint_formats::time::format_utc_shortest;

/// How a table is read between its rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Interpolation {
    /// Shortest rotation at a constant rate between two rows.
    #[default]
    Slerp,
    /// Shoemake's spherical cubic: the rate is continuous too. Rows spaced unevenly make it uneven.
    Squad,
}

/// Attitudes at increasing times.
#[derive(Debug, Clone, PartialEq)]
pub struct AttitudeTable {
    epochs: Vec<Epoch>,
    /// body → GCRS, signs chosen so that neighbours are near.
    attitudes: Vec<DQuat>,
    /// The inner control points of squad; empty for slerp.
    controls: Vec<DQuat>,
}

impl AttitudeTable {
    /// Creates a table from times (strictly increasing) and rotations from body axes to the GCRS.
    ///
    /// # Errors
    /// No rows, times that do not increase (with the row, from 1), quaternions that are not of unit length.
    pub fn new(
        epochs: Vec<Epoch>,
        mut attitudes: Vec<DQuat>,
        interpolation: Interpolation,
    ) -> Result<Self, AttitudeError> {
        if epochs.is_empty() || epochs.len() != attitudes.len() {
            let (times, attitudes) = (epochs.len(), attitudes.len());
            return Err(AttitudeError::TableSize { times, attitudes });
        }
        for (i, pair) in epochs.windows(2).enumerate() {
            if seconds_between(pair[0], pair[1]) <= 0.0 {
                let epoch = format_utc_shortest(pair[1]);
                return Err(AttitudeError::TableOrder { row: i + 2, epoch });
            }
        }
        for (i, q) in attitudes.iter_mut().enumerate() {
            *q = super::unit(*q)
                .map_err(|length| AttitudeError::TableNotUnit { row: i + 1, length })?;
        }
        for i in 1..attitudes.len() {
            if attitudes[i].dot(attitudes[i - 1]) < 0.0 {
                attitudes[i] = -attitudes[i];
            }
        }
        let controls = match interpolation {
            Interpolation::Slerp => Vec::new(),
            Interpolation::Squad => controls(&attitudes),
        };
        Ok(Self { epochs, attitudes, controls })
    }

    /// The first and the last time.
    pub fn span(&self) -> (Epoch, Epoch) {
        (self.epochs[0], self.epochs[self.epochs.len() - 1])
    }

    /// The largest rotation between two rows, degrees: above 90 or so, the way between them is a guess.
    pub fn largest_step_deg(&self) -> f64 {
        let angle = |pair: &[DQuat]| 2.0 * pair[0].dot(pair[1]).abs().min(1.0).acos().to_degrees();
        self.attitudes.windows(2).map(angle).fold(0.0, f64::max)
    }

    /// The rotation from body axes to the GCRS.
    ///
    /// # Errors
    /// [`AttitudeError::OutsideTable`]: nothing is extrapolated.
    pub fn body_to_gcrs(&self, epoch: Epoch) -> Result<DQuat, AttitudeError> {
        let i = self.epochs.partition_point(|e| seconds_between(*e, epoch) >= 0.0);
        let outside = || {
            let (first, last) = self.span();
            AttitudeError::OutsideTable {
                epoch: format_utc_shortest(epoch),
                first: format_utc_shortest(first),
                last: format_utc_shortest(last),
            }
        };
        if i == 0 {
            return Err(outside());
        }
        let after_s = seconds_between(self.epochs[i - 1], epoch);
        if after_s == 0.0 {
            return Ok(self.attitudes[i - 1]);
        }
        if i == self.epochs.len() {
            return Err(outside());
        }
        let part = after_s / seconds_between(self.epochs[i - 1], self.epochs[i]);
        let straight = slerp(self.attitudes[i - 1], self.attitudes[i], part);
        if self.controls.is_empty() {
            return Ok(straight);
        }
        let inner = slerp(self.controls[i - 1], self.controls[i], part);
        Ok(slerp(straight, inner, 2.0 * part * (1.0 - part)))
    }
}

/// s_i = q_i exp(−¼ (log(q_i⁻¹ q_{i+1}) + log(q_i⁻¹ q_{i−1}))) (Shoemake 1987); the ends are their own.
fn controls(q: &[DQuat]) -> Vec<DQuat> {
    let control = |i: usize| {
        if i == 0 || i + 1 == q.len() {
            return q[i];
        }
        let from = q[i].inverse();
        let sum = (from * q[i + 1]).to_scaled_axis() + (from * q[i - 1]).to_scaled_axis();
        let control = q[i] * DQuat::from_scaled_axis(-0.25 * sum);
        if control.dot(q[i]) < 0.0 { -control } else { control }
    };
    (0..q.len()).map(control).collect()
}

/// The rotation at a part of the shortest way from one to the other.
fn slerp(from: DQuat, to: DQuat, part: f64) -> DQuat {
    let step = from.inverse() * to;
    let step = if step.w < 0.0 { -step } else { step };
    // By the rotation vector, which keeps its digits for small steps, where an arc cosine would not.
    let sine = DQuat::from_xyzw(step.x, step.y, step.z, 0.0).length();
    if sine == 0.0 {
        return from;
    }
    let half = sine.atan2(step.w) * part;
    let scale = half.sin() / sine;
    (from * DQuat::from_xyzw(step.x * scale, step.y * scale, step.z * scale, half.cos()))
        .normalize()
}
