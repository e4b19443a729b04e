//! Microfacets: how the little mirrors of a rough surface are tilted, and how they hide one another.
//!
//! The reflection is F·D(h)·G/(4 cosθ_i cosθ_o) with h the bisector (Torrance and Sparrow 1967; Cook and Torrance 1982; Walter et al. 2007).
//! Beckmann and GGX, each with two roughnesses along the surface's x and y axes, and Smith's masking of just that distribution
//! in closed form (Walter et al. 2007, eqs. 20–34; Heitz 2014, JCGT 3(2), eqs. 68, 72, 80–87).

use super::MaterialError;
use super::real::Real;
use super::sampling::Proposal;
use glam::DVec3;
use std::f64::consts::PI;

/// 1/√π.
const FRAC_1_SQRT_PI: f64 = 0.564_189_583_547_756_3;

/// The smallest roughness; what is smoother is a mirror.
pub const LEAST_ALPHA: f64 = 1e-5;
/// Exponent of Beckmann's density beyond which many directions together are not asked.
const FAINT_EXPONENT: f64 = 24.0;
/// The largest roughness.
pub const LARGEST_ALPHA: f64 = 2.0;

/// How the slopes of microfacets are distributed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Distribution {
    /// Gaussian: exp(−tan²θ/α²)/(π α² cos⁴θ).
    Beckmann,
    /// With long tails (Trowbridge and Reitz 1975): 1/(π α² cos⁴θ (1+tan²θ/α²)²).
    Ggx,
}

/// How masking (towards the observer) and shadowing (towards the light) go together.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Hash, Default, serde::Deserialize, serde::Serialize,
)]
#[serde(rename_all = "snake_case")]
pub enum Masking {
    /// Independent masking and shadowing: G = G₁(i) G₁(o).
    #[default]
    Separable,
    /// At heights in common: G = 1/(1 + Λ(i) + Λ(o)) (Heitz 2014, eq. 99).
    HeightCorrelated,
}

/// A direction with its part of the masking, which does not depend on the other direction ([`Lobe::masked`]).
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Masked {
    z: f64,
    /// G₁/cosθ where masking is separable, else Λ cosθ.
    part: f64,
}

/// The tilts of the microfacets and their masking.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lobe {
    pub(super) distribution: Distribution,
    pub(super) alpha_x: f64,
    pub(super) alpha_y: f64,
    pub(super) masking: Masking,
}

impl Lobe {
    /// A lobe with the same roughness in every direction.
    ///
    /// # Errors
    /// α is not from 1e-5 to 2.
    pub fn isotropic(
        distribution: Distribution,
        alpha: f64,
        masking: Masking,
    ) -> Result<Self, MaterialError> {
        Self::anisotropic(distribution, alpha, alpha, masking)
    }

    /// A lobe with one roughness along the surface's x axis and one along its y axis.
    ///
    /// # Errors
    /// A roughness that is not from 1e-5 to 2.
    pub fn anisotropic(
        distribution: Distribution,
        alpha_x: f64,
        alpha_y: f64,
        masking: Masking,
    ) -> Result<Self, MaterialError> {
        for alpha in [alpha_x, alpha_y] {
            if !(LEAST_ALPHA..=LARGEST_ALPHA).contains(&alpha) {
                return Err(MaterialError::Roughness { alpha });
            }
        }
        Ok(Self { distribution, alpha_x, alpha_y, masking })
    }

    /// The distribution of tilts.
    pub fn distribution(&self) -> Distribution {
        self.distribution
    }

    /// The roughnesses along x and y.
    pub fn alpha(&self) -> (f64, f64) {
        (self.alpha_x, self.alpha_y)
    }

    /// The kind of masking.
    pub fn masking(&self) -> Masking {
        self.masking
    }

    /// The smaller of its two roughnesses.
    pub(crate) fn narrowest(&self) -> f64 {
        self.alpha_x.min(self.alpha_y)
    }

    /// Whether it is the same in every direction.
    pub fn is_isotropic(&self) -> bool {
        self.alpha_x == self.alpha_y
    }

    /// D·G/(4 cosθ_i cosθ_o) \[sr⁻¹\] of unit vectors above the horizon: the reflection of microfacets that are perfect mirrors.
    pub fn reflection(&self, i: DVec3, o: DVec3) -> f64 {
        self.reflection_of([self.alpha_x, self.alpha_y], i.to_array(), o.to_array())
    }

    /// [`Lobe::reflection`] of other roughnesses, in numbers that may carry their derivatives.
    pub(super) fn reflection_of<T: Real>(&self, alpha: [T; 2], i: [T; 3], o: [T; 3]) -> T {
        let density = self.density_of(alpha, [i[0] + o[0], i[1] + o[1], i[2] + o[2]]);
        if density.value() == 0.0 {
            return T::constant(0.0);
        }
        let height = |v: [T; 3]| (v[2], slope_times_sine(alpha, v));
        T::constant(0.25) * density * self.masking_over_heights(height(i), height(o))
    }

    /// Prepares a direction (unit, z > 0) that is asked for with many others.
    pub(crate) fn masked(&self, v: DVec3) -> Masked {
        let height = (v.z, self.slope_times_sine(v));
        let part = match self.masking {
            Masking::Separable => self.masking_one_over_height(height),
            Masking::HeightCorrelated => self.lambda_times_height(height),
        };
        Masked { z: v.z, part }
    }

    /// [`Lobe::reflection`] of two directions that are prepared; 0 in the tails of Beckmann's density, below e^−24 (4e-11) of its peak.
    pub(crate) fn reflection_between(&self, i: (DVec3, Masked), o: (DVec3, Masked)) -> f64 {
        let h = i.0 + o.0;
        if self.distribution == Distribution::Beckmann {
            let (x, y) = (h.x * self.alpha_y, h.y * self.alpha_x);
            let z = h.z * self.alpha_x * self.alpha_y;
            if x * x + y * y > FAINT_EXPONENT * z * z {
                return 0.0;
            }
        }
        let density = self.density(h);
        if density == 0.0 {
            return 0.0;
        }
        let masking = match self.masking {
            Masking::Separable => i.1.part * o.1.part,
            Masking::HeightCorrelated => {
                1.0 / (i.1.z * o.1.z + (o.1.z * i.1.part + i.1.z * o.1.part))
            }
        };
        0.25 * density * masking
    }

    /// D \[sr⁻¹\] of the tilt towards a direction, of any length, with z > 0.
    ///
    /// ∫ D(h) cosθ_h dω = 1.
    pub fn density(&self, h: DVec3) -> f64 {
        self.density_of([self.alpha_x, self.alpha_y], h.to_array())
    }

    fn density_of<T: Real>(&self, alpha: [T; 2], h: [T; 3]) -> T {
        let one = T::constant(1.0);
        let (x, y) = (h[0] / alpha[0], h[1] / alpha[1]);
        let scale = one / (T::constant(PI) * alpha[0] * alpha[1]);
        match self.distribution {
            Distribution::Beckmann => {
                let inverse = one / h[2];
                let (x, y) = (x * inverse, y * inverse);
                let exponent = x * x + y * y;
                // e^-746 is 0; what follows must not meet ∞·0, and a vanishing h has no number here.
                if exponent.value().is_nan() || exponent.value() > 746.0 {
                    return T::constant(0.0);
                }
                let (x, y) = (h[0] * inverse, h[1] * inverse);
                let secant2 = one + x * x + y * y;
                scale * secant2 * secant2 * (-exponent).exp()
            }
            Distribution::Ggx => {
                // With lengths in place of tangents nothing overflows at the horizon.
                let stretched = x * x + y * y + h[2] * h[2];
                if stretched.value() > 0.0 {
                    let ratio = (h[0] * h[0] + h[1] * h[1] + h[2] * h[2]) / stretched;
                    scale * ratio * ratio
                } else {
                    T::constant(0.0)
                }
            }
        }
    }

    /// G₁: the fraction of the microfacets that face `v` (unit, z > 0) which is seen from there.
    pub fn masking_one(&self, v: DVec3) -> f64 {
        v.z * self.masking_one_over_height((v.z, self.slope_times_sine(v)))
    }

    /// G/(cosθ_i cosθ_o), without the quotients of vanishing numbers that each has at the horizon.
    pub(super) fn masking_over_cosines(&self, i: DVec3, o: DVec3) -> f64 {
        self.masking_over_heights((i.z, self.slope_times_sine(i)), (o.z, self.slope_times_sine(o)))
    }

    /// G/(cosθ_i cosθ_o) of two directions, each as (cosθ, α sinθ).
    pub(super) fn masking_over_heights<T: Real>(&self, i: (T, T), o: (T, T)) -> T {
        match self.masking {
            Masking::Separable => self.masking_one_over_height(i) * self.masking_one_over_height(o),
            Masking::HeightCorrelated => {
                T::constant(1.0)
                    / (i.0 * o.0
                        + (o.0 * self.lambda_times_height(i) + i.0 * self.lambda_times_height(o)))
            }
        }
    }

    /// The half-width at 1/e of what it reflects of a ray at normal incidence, radians: twice the tilt at which the density has fallen to 1/e.
    pub fn width_rad(&self) -> f64 {
        let slope = match self.distribution {
            Distribution::Beckmann => 1.0,
            Distribution::Ggx => (0.5_f64.exp() - 1.0).sqrt(),
        };
        2.0 * (slope * self.alpha_x.min(self.alpha_y)).atan()
    }

    /// How directions are drawn that follow it. Beckmann's are drawn among all tilts, seen or not: where light grazes, the cosine's share bounds the weights.
    pub(super) fn proposals(&self) -> Vec<(f64, Proposal)> {
        match self.distribution {
            Distribution::Beckmann => {
                vec![(0.9, Proposal::Facets(*self)), (0.1, Proposal::Cosine)]
            }
            Distribution::Ggx => vec![(1.0, Proposal::Facets(*self))],
        }
    }

    pub(super) fn name(&self) -> &'static str {
        match self.distribution {
            Distribution::Beckmann => "Beckmann",
            Distribution::Ggx => "GGX",
        }
    }

    pub(super) fn describe(&self) -> String {
        let name = self.name();
        let alpha = if self.is_isotropic() {
            format!("α {}", super::short(self.alpha_x))
        } else {
            format!("α_x {} α_y {}", super::short(self.alpha_x), super::short(self.alpha_y))
        };
        let masking = match self.masking {
            Masking::Separable => "separable",
            Masking::HeightCorrelated => "height-correlated",
        };
        format!("{name} {alpha}, {masking} masking")
    }

    fn slope_times_sine(&self, v: DVec3) -> f64 {
        slope_times_sine([self.alpha_x, self.alpha_y], v.to_array())
    }

    /// G₁/cosθ of (cosθ, s = α sinθ). With a = cosθ/s: Beckmann 2/(cosθ (1 + erf a) + s e^(−a²)/√π), GGX 2/(cosθ + √(cos²θ + s²)).
    fn masking_one_over_height<T: Real>(&self, (z, s): (T, T)) -> T {
        let two = T::constant(2.0);
        match self.distribution {
            // From a = 6 on 1 − G₁ is below 1e-17.
            Distribution::Beckmann if z.value() >= 6.0 * s.value() => T::constant(1.0) / z,
            Distribution::Beckmann => {
                let a = z / s;
                two / (z * (T::constant(1.0) + a.erf())
                    + s * T::constant(FRAC_1_SQRT_PI) * (-(a * a)).exp())
            }
            Distribution::Ggx => two / (z + (z * z + s * s).sqrt()),
        }
    }

    /// Λ cosθ of (cosθ, s = α sinθ), with G₁ = 1/(1 + Λ).
    fn lambda_times_height<T: Real>(&self, (z, s): (T, T)) -> T {
        let half = T::constant(0.5);
        match self.distribution {
            Distribution::Beckmann if z.value() >= 6.0 * s.value() => T::constant(0.0),
            Distribution::Beckmann => {
                let a = z / s;
                half * (s * T::constant(FRAC_1_SQRT_PI) * (-(a * a)).exp() - z * a.erfc())
            }
            Distribution::Ggx => half * s * (s / (z + (z * z + s * s).sqrt())),
        }
    }
}

/// sinθ·α(φ): the root mean square slope along the direction's azimuth, times its sine.
fn slope_times_sine<T: Real>(alpha: [T; 2], v: [T; 3]) -> T {
    let (x, y) = (alpha[0] * v[0], alpha[1] * v[1]);
    (x * x + y * y).sqrt()
}
