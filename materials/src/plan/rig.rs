//! A rig that turns in one plane: sample and detector on concentric stages, set by hand to marks.

use super::density::direction;
use super::{Cell, PlanError, Step};
use glam::DVec3;
use std::f64::consts::PI;

/// Reach of a rig in the plane of incidence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rig {
    /// The least angle between lamp and detector, degrees: closer, the detector shades the sample.
    pub least_phase_deg: f64,
    /// The largest angle of incidence, degrees: beyond, the light falls beside the sample.
    pub most_theta_i_deg: f64,
    /// The largest angle of the detector from the normal, degrees.
    pub most_theta_o_deg: f64,
    /// The marks' distance, degrees.
    pub mark_deg: f64,
}

impl Default for Rig {
    fn default() -> Self {
        Self {
            least_phase_deg: 30.0,
            most_theta_i_deg: 55.0,
            most_theta_o_deg: 89.0,
            mark_deg: 1.0,
        }
    }
}

impl Rig {
    pub(super) fn check(&self, side: usize) -> Result<(), PlanError> {
        let wrong = |name, found, expected| Err(PlanError::Option { name, found, expected });
        if side.is_multiple_of(2) {
            let expected = "an odd number: the middle row is the plane of incidence";
            return wrong("side", side as f64, expected);
        }
        if !(0.0..180.0).contains(&self.least_phase_deg) {
            return wrong("least_phase_deg", self.least_phase_deg, "an angle from 0 to below 180°");
        }
        if !(self.most_theta_i_deg > 0.0 && self.most_theta_i_deg < 90.0) {
            let expected = "an angle above 0 and below 90°";
            return wrong("most_theta_i_deg", self.most_theta_i_deg, expected);
        }
        if !(self.most_theta_o_deg > 0.0 && self.most_theta_o_deg < 90.0) {
            let expected = "an angle above 0 and below 90°";
            return wrong("most_theta_o_deg", self.most_theta_o_deg, expected);
        }
        if !(self.mark_deg >= 0.001 && self.mark_deg <= 15.0) {
            return wrong("mark_deg", self.mark_deg, "a step from 0.001 to 15°");
        }
        Ok(())
    }

    fn mark(&self, angle_deg: f64) -> f64 {
        (angle_deg / self.mark_deg).round() * self.mark_deg
    }

    /// The measurements for cells of one incident direction; cells in the plane and within reach get their numbers.
    pub(super) fn steps(
        &self,
        cells: &mut [Cell],
        incident: [usize; 2],
        [phi, theta]: [f64; 2],
    ) -> Vec<Step> {
        let incident_deg = self.mark(theta.to_degrees());
        if incident_deg > self.most_theta_i_deg + 1e-9 {
            return Vec::new();
        }
        let mut steps: Vec<Step> = Vec::new();
        for cell in cells {
            let Some(detector_deg) = in_plane(cell.outgoing, phi) else { continue };
            let detector_deg = self.mark(detector_deg);
            // The lamp is at −θ_i.
            let phase_deg = detector_deg + incident_deg;
            let out_of_reach = phase_deg.abs() < self.least_phase_deg - 1e-9
                || detector_deg.abs() > self.most_theta_o_deg + 1e-9;
            if out_of_reach {
                continue;
            }
            let marks_deg = Some([incident_deg, detector_deg]);
            let at = steps.iter().position(|s| s.marks_deg == marks_deg).unwrap_or_else(|| {
                let outgoing = direction(detector_deg.to_radians(), phi + PI);
                steps.push(Step { incident, outgoing, marks_deg });
                steps.len() - 1
            });
            cell.step = Some(at);
        }
        steps
    }

    /// From one end to the other, beginning at the nearer.
    pub(super) fn order(&self, steps: &[Step], stands: DVec3) -> Vec<usize> {
        let angle = |k: &usize| steps[*k].marks_deg.map_or(0.0, |m| m[1]);
        let mut order: Vec<usize> = (0..steps.len()).collect();
        order.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        let far = |k: Option<&usize>| k.map_or(0.0, |k| (steps[*k].outgoing - stands).length());
        if far(order.last()) < far(order.first()) {
            order.reverse();
        }
        order
    }
}

/// The angle from the normal of a direction in the plane of light from the azimuth `phi`, degrees: negative on the light's side. None off the plane or below the
/// horizon.
fn in_plane(outgoing: DVec3, phi: f64) -> Option<f64> {
    let along = outgoing.x * phi.cos() + outgoing.y * phi.sin();
    let across = outgoing.y * phi.cos() - outgoing.x * phi.sin();
    let is_there = across.abs() < 1e-4 && outgoing.z > 1e-6;
    is_there.then(|| (-along).atan2(outgoing.z).to_degrees())
}
