//! Directions as angles of the axes, and back.
//!
//! The sample's axes: its normal is z, the light comes from −x at an angle of incidence above 0. The bench's angles are those of the four axes: incidence θ_i,
//! the detector's angle δ from the normal (above 0 on the mirrored side), the angle ψ of its plane from the plane of incidence, and the light's azimuth φ_i on the
//! sample. A stage stands at its zero ± the bench's angle.

use super::bench::{Bench, From};
use crate::plan::Planned;
use crate::samples::direction;
use serde::Serialize;
use sunglint_numerics::measured::Interval;

/// Angles that differ by less than this are the same, degrees.
const SAME_DEG: f64 = 1e-3;

/// A direction of light and detector, degrees.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Pose {
    /// Angle of the light from the normal.
    pub theta_i_deg: f64,
    /// Azimuth of the light.
    pub phi_i_deg: f64,
    /// Angle of the detector from the normal.
    pub theta_o_deg: f64,
    /// Azimuth of the detector; the light's + 180° is the mirrored side.
    pub phi_o_deg: f64,
}

impl std::convert::From<&Planned> for Pose {
    fn from(planned: &Planned) -> Self {
        Self {
            theta_i_deg: planned.theta_i_deg,
            phi_i_deg: planned.phi_i_deg,
            theta_o_deg: planned.theta_o_deg,
            phi_o_deg: planned.phi_o_deg,
        }
    }
}

impl Pose {
    /// A direction in the plane of incidence; the detector's angle is above 0 on the mirrored side.
    #[must_use]
    pub fn in_plane(theta_i_deg: f64, detector_deg: f64) -> Self {
        let phi_o_deg = if detector_deg < 0.0 { 0.0 } else { 180.0 };
        Self { theta_i_deg, phi_i_deg: 0.0, theta_o_deg: detector_deg.abs(), phi_o_deg }
    }

    /// The angle between lamp and detector, degrees.
    #[must_use]
    pub fn phase_deg(&self) -> f64 {
        let i = direction(self.theta_i_deg, self.phi_i_deg);
        let o = direction(self.theta_o_deg, self.phi_o_deg);
        i.cross(o).length().atan2(i.dot(o)).to_degrees()
    }
}

/// An angle from −180 to 180 degrees.
#[must_use]
pub fn wrapped(deg: f64) -> f64 {
    let turned = (deg + 180.0).rem_euclid(360.0) - 180.0;
    if turned == -180.0 { 180.0 } else { turned }
}

/// Angles of the four axes: sample, detector, azimuth, turn; none where there is no such axis.
pub type Angles = [Option<f64>; 4];

/// Where the stages go, and between which angles they turn.
#[derive(Debug, Clone)]
pub struct Kinematics {
    zero_deg: [f64; 4],
    sense: [f64; 4],
    has: [bool; 4],
    from: From,
    /// Angles between which each stage turns, degrees; none where it turns freely.
    pub travel_deg: [Option<Interval>; 4],
}

impl Kinematics {
    /// Those of a bench whose stages turn freely.
    #[must_use]
    pub fn new(bench: &Bench) -> Self {
        let axes = bench.all_axes();
        let each = |of: &dyn Fn(&super::bench::Axis) -> f64| {
            [0, 1, 2, 3].map(|k| axes[k].as_ref().map_or(0.0, of))
        };
        Self {
            zero_deg: each(&|axis| axis.zero_deg.get()),
            sense: each(&|axis| if axis.reversed { -1.0 } else { 1.0 }),
            has: [0, 1, 2, 3].map(|k| axes[k].is_some()),
            from: bench.axes.detector.from,
            travel_deg: [None; 4],
        }
    }

    /// Whether there is an axis.
    #[must_use]
    pub fn has(&self, axis: usize) -> bool {
        self.has[axis]
    }

    /// True where the detector's arm counts from the lamp.
    #[must_use]
    pub fn is_from_lamp(&self) -> bool {
        self.from == From::Lamp
    }

    /// The stages' angles for the bench's.
    #[must_use]
    pub fn stages(&self, bench: [f64; 4]) -> Angles {
        let mut angle = bench;
        if self.from == From::Lamp {
            angle[1] += bench[0];
        }
        [0, 1, 2, 3].map(|k| self.has[k].then(|| self.zero_deg[k] + self.sense[k] * angle[k]))
    }

    /// The bench's angles for the stages', each zero wrong by so much (degrees; 0 where there is no axis).
    #[must_use]
    pub fn bench(&self, stages: &Angles, error_deg: [f64; 4]) -> [f64; 4] {
        let mut angle = [0, 1, 2, 3].map(|k| {
            stages[k].map_or(0.0, |at| self.sense[k] * (at - self.zero_deg[k]) - error_deg[k])
        });
        if self.from == From::Lamp {
            angle[1] -= angle[0];
        }
        angle
    }

    /// Whether the stages turn so far.
    #[must_use]
    pub fn reaches(&self, stages: &Angles) -> bool {
        (0..4).all(|k| match (stages[k], self.travel_deg[k]) {
            (Some(at), Some(Interval { low: least, high: most })) => {
                (least - 1e-9..=most + 1e-9).contains(&at)
            }
            _ => true,
        })
    }

    /// The stages' angles for a direction; none where the axes do not reach it.
    #[must_use]
    pub fn of(&self, pose: &Pose) -> Option<Angles> {
        let turn = pose.phi_i_deg;
        if !self.has[3] && wrapped(turn).abs() > SAME_DEG {
            return None;
        }
        let side = wrapped(pose.phi_o_deg - pose.phi_i_deg - 180.0);
        let ways = if self.has[2] {
            [(pose.theta_o_deg, side), (-pose.theta_o_deg, wrapped(side + 180.0))]
        } else if side.abs() < SAME_DEG || pose.theta_o_deg < SAME_DEG {
            [(pose.theta_o_deg, 0.0); 2]
        } else if (side.abs() - 180.0).abs() < SAME_DEG {
            [(-pose.theta_o_deg, 0.0); 2]
        } else {
            return None;
        };
        let stages = ways.map(|(detector, azimuth)| {
            self.stages([pose.theta_i_deg, detector, azimuth, wrapped(turn)])
        });
        stages.into_iter().find(|stages| self.reaches(stages))
    }

    /// The direction in which the bench's angles look.
    #[must_use]
    pub fn pose(bench: [f64; 4]) -> Pose {
        let [theta_i, detector, azimuth, turn] = bench;
        // An angle below 0 is on the other side.
        let (theta_i_deg, phi_i_deg) =
            if theta_i < 0.0 { (-theta_i, turn + 180.0) } else { (theta_i, turn) };
        let side = if detector < 0.0 { 0.0 } else { 180.0 };
        Pose {
            theta_i_deg,
            phi_i_deg: wrapped(phi_i_deg),
            theta_o_deg: detector.abs(),
            phi_o_deg: wrapped(turn + side + azimuth),
        }
    }
}
