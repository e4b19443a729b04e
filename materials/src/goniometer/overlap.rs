//! The part of the beam that lies on the sample and in the detector's field.
//!
//! The beam's footprint becomes longer as the sample turns away (1/cosθ_i), and so does the field on the sample as the detector turns (1/cosθ_o). While the footprint lies
//! within both, all of it counts (underfilled). Beyond that the light that is seen is f cosθ_o Ω times the incident power on the place where the three overlap.

use glam::DVec3;
use libm::erf;
use std::f64::consts::{PI, SQRT_2};
use sunglint_numerics::gauss::legendre;

/// Sizes on the sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sizes {
    /// The beam's diameter where it has fallen to 1/e², mm.
    pub beam_mm: f64,
    /// The sample's width along its x, mm.
    pub width_mm: f64,
    /// The sample's height along its y, mm.
    pub height_mm: f64,
    /// The diameter of the detector's field, mm; none where it sees all.
    pub field_mm: Option<f64>,
}

/// Rows across the plane of incidence.
const ROWS: usize = 96;
/// The beam ends here, in radii at 1/e².
const END: f64 = 2.4;

impl Sizes {
    /// The part of the beam that lies on the sample and in the field, for light at `theta_i_deg` in the plane of x and z, a detector towards the unit vector `o`, and a sample turned by
    /// `turn_deg` about its normal.
    #[must_use]
    pub fn part(&self, theta_i_deg: f64, turn_deg: f64, o: DVec3) -> f64 {
        let radius = 0.5 * self.beam_mm;
        let cos = theta_i_deg.to_radians().cos();
        if cos <= 0.0 {
            return 0.0;
        }
        let mut most = END * radius;
        if let Some(field) = self.field_mm {
            // The field's ellipse on the sample reaches as far across.
            let sin2 = o.x * o.x + o.y * o.y;
            let half = 0.5 * field;
            let across = half * ((1.0 - o.x * o.x) / (1.0 - sin2).max(1e-12)).sqrt();
            most = most.min(across);
        }
        let (sin_t, cos_t) = turn_deg.to_radians().sin_cos();
        let half_diagonal = 0.5 * self.width_mm.hypot(self.height_mm);
        most = most.min(half_diagonal);
        // ∫ exp(−2 (x cosθ)²/w²) dx between two places.
        let scale = SQRT_2 * cos / radius;
        let row = |y: f64| {
            let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
            // |a x + b y| < h for both pairs of the sample's edges.
            for (a, b, h) in
                [(cos_t, sin_t, 0.5 * self.width_mm), (-sin_t, cos_t, 0.5 * self.height_mm)]
            {
                if a.abs() < 1e-12 {
                    if (b * y).abs() > h {
                        return 0.0;
                    }
                    continue;
                }
                let ends = [(-h - b * y) / a, (h - b * y) / a];
                from = from.max(ends[0].min(ends[1]));
                to = to.min(ends[0].max(ends[1]));
            }
            if let Some(field) = self.field_mm {
                // x² (1 − o_x²) − 2 x y o_x o_y + y² (1 − o_y²) < r².
                let (a, b) = ((1.0 - o.x * o.x).max(1e-12), -o.x * o.y * y);
                let c = y * y * (1.0 - o.y * o.y) - 0.25 * field * field;
                let root = b * b - a * c;
                if root <= 0.0 {
                    return 0.0;
                }
                from = from.max((-b - root.sqrt()) / a);
                to = to.min((-b + root.sqrt()) / a);
            }
            if from >= to {
                return 0.0;
            }
            let along = 0.5 * (erf(scale * to) - erf(scale * from));
            along * (-2.0 * (y / radius).powi(2)).exp() * (2.0 / PI).sqrt() / radius
        };
        // Rows are denser at the ends, where the field's ellipse closes.
        let rule = legendre(ROWS);
        let half_pi = 0.5 * PI;
        rule.iter()
            .map(|(t, weight)| {
                let angle = half_pi * t;
                weight * half_pi * most * angle.cos() * row(most * angle.sin())
            })
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::direction;

    /// Truth: 1 where all is large; erf(√2 h cosθ/w) of a long strip; 1 − exp(−2 r²/w²) of a round field seen along the normal; and places on the sample counted one by one
    /// (800 × 800, its own error 1e-3).
    #[test]
    fn the_part_is_that_of_places_counted_one_by_one() {
        let all = Sizes { beam_mm: 2.0, width_mm: 1e3, height_mm: 1e3, field_mm: None };
        assert!((all.part(60.0, 0.0, DVec3::Z) - 1.0).abs() < 1e-5);
        let strip = Sizes { width_mm: 4.0, ..all };
        let exact = erf(SQRT_2 * 2.0 * 75_f64.to_radians().cos());
        assert!((strip.part(75.0, 0.0, DVec3::Z) / exact - 1.0).abs() < 1e-5);
        let field = Sizes { field_mm: Some(1.5), ..all };
        let exact = 1.0 - (-2.0 * 0.75_f64 * 0.75).exp();
        assert!((field.part(0.0, 0.0, DVec3::Z) / exact - 1.0).abs() < 1e-5);
        let both = Sizes { beam_mm: 3.0, width_mm: 20.0, height_mm: 12.0, field_mm: Some(4.0) };
        for (theta_i, turn, theta_o, phi_o) in [
            (0.0, 0.0, 40.0, 30.0),
            (75.0, 20.0, 10.0, 180.0),
            (75.0, 0.0, 75.0, 180.0),
            (60.0, 50.0, 70.0, 77.0),
        ] {
            let o = direction(theta_o, phi_o);
            let (sin, cos) = f64::sin_cos(f64::to_radians(turn));
            let n = 800;
            let end = 40.0;
            let mut sum = 0.0;
            for i in 0..n {
                for j in 0..n {
                    let x = ((f64::from(i) + 0.5) / f64::from(n) * 2.0 - 1.0) * end;
                    let y = ((f64::from(j) + 0.5) / f64::from(n) * 2.0 - 1.0) * 6.0;
                    let p = DVec3::new(x, y, 0.0);
                    let seen = (p - p.dot(o) * o).length() < 2.0;
                    let on = (x * cos + y * sin).abs() < 10.0 && (y * cos - x * sin).abs() < 6.0;
                    if seen && on {
                        let c = f64::to_radians(theta_i).cos();
                        sum += (-2.0 * ((x * c).powi(2) + y * y) / (1.5 * 1.5)).exp() * c;
                    }
                }
            }
            let area = (2.0 * end / f64::from(n)) * (12.0 / f64::from(n));
            let truth = sum * area / (0.5 * PI * 1.5 * 1.5);
            let found = both.part(theta_i, turn, o);
            assert!(
                (found / truth - 1.0).abs() < 5e-3,
                "{theta_i} {turn} {theta_o}: {found} {truth}"
            );
        }
    }
}
