//! Brightness of a target without a model: a diffuse sphere, or a standard magnitude.

use std::f64::consts::PI;
use sunglint_radiometry::constants::AU_M;

/// A law of brightness.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Brightness {
    /// A Lambert sphere: Φ/Φ☉ = 2/(3π) ρ (R/r)² (sin γ + (π − γ) cos γ).
    Sphere {
        /// Diameter, m.
        diameter_m: f64,
        /// Lambert reflectance ρ, 0 to 1.
        reflectance: f64,
    },
    /// A standard magnitude: the V at 1000 km when half of the disc is lit (phase angle 90°), with a brightness that goes with the
    /// illuminated fraction (1 + cos γ)/2, as published lists of intrinsic magnitudes have it.
    Standard {
        /// V at 1000 km, half lit.
        magnitude: f64,
    },
}

impl Brightness {
    /// The irradiance at the observer over the Sun's at 1 au, above the air: for a target at that phase angle (radians) and range (m)
    /// with the Sun at that distance (m) and that visible part of its disc. `sun_v` is the Sun's V at 1 au.
    ///
    /// A standard magnitude holds for the Sun at 1 au.
    ///
    /// ```
    /// use sunglint_ephemeris::passes::brightness::Brightness;
    /// use sunglint_radiometry::constants::AU_M;
    ///
    /// let sphere = Brightness::Sphere { diameter_m: 1.0, reflectance: 0.2 };
    /// let full = sphere.of_sunlight(0.0, 1e6, AU_M, 1.0, -26.7);
    /// let half = sphere.of_sunlight(std::f64::consts::FRAC_PI_2, 1e6, AU_M, 1.0, -26.7);
    /// // A half-lit Lambert sphere is π times fainter than a full one.
    /// assert!((full / half - std::f64::consts::PI).abs() < 1e-12);
    /// ```
    pub fn of_sunlight(
        &self,
        phase_rad: f64,
        range_m: f64,
        sun_distance_m: f64,
        sunlit: f64,
        sun_v: f64,
    ) -> f64 {
        let nearer = (AU_M / sun_distance_m).powi(2) * sunlit;
        nearer
            * match self {
                Brightness::Sphere { diameter_m, reflectance } => {
                    reflectance * (0.5 * diameter_m / range_m).powi(2) * sphere_phase(phase_rad)
                }
                Brightness::Standard { magnitude } => {
                    let fraction = 0.5 * (1.0 + phase_rad.cos());
                    let at_1000_km = 10_f64.powf(-0.4 * (magnitude - sun_v));
                    at_1000_km * (1e6 / range_m).powi(2) * fraction / 0.5
                }
            }
    }
}

/// The phase function of a Lambert sphere, 2/(3π) (sin γ + (π − γ) cos γ): 2/3 at 0, 0 at π.
pub fn sphere_phase(phase_rad: f64) -> f64 {
    2.0 / (3.0 * PI) * (phase_rad.sin() + (PI - phase_rad) * phase_rad.cos())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: by hand. A sphere of 1 m and ρ = 0.2 at 1000 km and 90°: 0.2 · (0.5e-6)² · 2/(3π) = 1.0610e-14, 34.936 mag fainter than
    /// the Sun; at 0° π times brighter. A standard magnitude at 1000 km, half lit, is itself; at 2000 km and full 5 log 2 − 2.5 log 2
    /// fainter. Rounding, and the digits given.
    #[test]
    fn closed_forms() {
        let sphere = Brightness::Sphere { diameter_m: 1.0, reflectance: 0.2 };
        let half = sphere.of_sunlight(PI / 2.0, 1e6, AU_M, 1.0, -26.7);
        assert!((half - 1.0610e-14).abs() < 1e-18, "{half:e}");
        assert!((-2.5 * half.log10() - 34.936).abs() < 1e-3);
        let full = sphere.of_sunlight(0.0, 1e6, AU_M, 1.0, -26.7);
        assert!((full / half - PI).abs() < 1e-12);
        assert!(sphere.of_sunlight(PI, 1e6, AU_M, 1.0, -26.7).abs() < 1e-28);
        let standard = Brightness::Standard { magnitude: 5.0 };
        let v = |phase: f64, range: f64| {
            -26.7 - 2.5 * standard.of_sunlight(phase, range, AU_M, 1.0, -26.7).log10()
        };
        assert!((v(PI / 2.0, 1e6) - 5.0).abs() < 1e-12);
        assert!((v(0.0, 2e6) - 5.0 - 2.5 * 2_f64.log10()).abs() < 1e-12);
    }
}
