//! The beam on the sample: a Gaussian spot that becomes longer as the sample turns away.

use super::RetroError;
use serde::Serialize;
use std::f64::consts::SQRT_2;

/// A beam and the sample's width in the plane of incidence.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spot {
    /// The beam's diameter where it has fallen to 1/e², mm.
    pub beam_diameter_mm: f64,
    /// The sample's width in the plane of incidence, mm.
    pub sample_width_mm: f64,
    /// How far the spot's middle may be from the sample's, mm, along the sample.
    pub off_centre_mm: f64,
}

impl Spot {
    /// Looks whether there can be such a spot.
    ///
    /// # Errors
    /// Sizes that are not above 0; a middle beside the sample.
    pub fn check(&self) -> Result<(), RetroError> {
        let sizes = [
            ("beam's diameter, mm", self.beam_diameter_mm),
            ("sample's width, mm", self.sample_width_mm),
        ];
        for (name, found) in sizes {
            if !(found.is_finite() && found > 0.0) {
                return Err(RetroError::Number { name, found, expected: "a number above 0" });
            }
        }
        let found = self.off_centre_mm;
        if !(0.0..0.5 * self.sample_width_mm).contains(&found) {
            let (name, expected) = ("off centre, mm", "0 or above, less than half the width");
            return Err(RetroError::Number { name, found, expected });
        }
        Ok(())
    }

    /// The part of the beam that passes beside the sample at an angle from its normal, degrees: both sides of a Gaussian.
    pub fn spilled(&self, theta_deg: f64) -> f64 {
        let radius = 0.5 * self.beam_diameter_mm;
        let cos = theta_deg.to_radians().cos().max(0.0);
        let beyond = |half_mm: f64| 0.5 * libm::erfc(SQRT_2 * half_mm * cos / radius);
        let half = 0.5 * self.sample_width_mm;
        beyond(half - self.off_centre_mm) + beyond(half + self.off_centre_mm)
    }

    /// The least angle from the normal, degrees, at which more than `most` of the beam passes beside the sample; none below 90° where it never does.
    pub fn limit_deg(&self, most: f64) -> Option<f64> {
        if self.spilled(0.0) > most {
            return Some(0.0);
        }
        if self.spilled(90.0) <= most {
            return None;
        }
        let (mut low, mut high) = (0.0, 90.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.spilled(middle) > most { high = middle } else { low = middle }
        }
        Some(high)
    }
}
