//! Closed forms of what samples reflect back towards the light, and beside it.
//!
//! Microfacets: F₀ D(h) G/(4 cosθ_i cosθ_o) with Beckmann's and GGX's D and Smith's G₁ (Walter et al., EGSR 2007, eqs. 25–34). Light and
//! observer look from the same side, so that masking and shadowing are those of the same heights and azimuths: what the one sees, the other sees too,
//! G = min(G₁(i), G₁(o)) (Ashikhmin, Premože and Shirley, SIGGRAPH 2000), which is G₁ where i = o.

use super::options::{Sample, SampleKind};
use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, PI};

/// Standard deviation of the directions that a mirror sends a beam into, rad: the beam's own divergence.
pub const MIRROR_SPREAD_RAD: f64 = 1e-3;

impl Sample {
    /// f·cosθ_o \[sr⁻¹\] for unit vectors `i` and `o` on the outer side, in axes whose z is the sample's normal; 0 below it.
    pub fn radiance(&self, i: DVec3, o: DVec3) -> f64 {
        if i.z <= 0.0 || o.z <= 0.0 {
            return 0.0;
        }
        let lobe = match self.kind {
            SampleKind::Lambert => self.reflectance * FRAC_1_PI * o.z,
            SampleKind::Mirror => {
                let away = (o - DVec3::new(-i.x, -i.y, i.z)).length_squared();
                let spread = MIRROR_SPREAD_RAD * MIRROR_SPREAD_RAD;
                self.reflectance * (-0.5 * away / spread).exp() / (2.0 * PI * spread)
            }
            SampleKind::Ggx | SampleKind::Beckmann => {
                let h = (i + o).normalize();
                let masking = self.masking(i.z).min(self.masking(o.z));
                self.reflectance * self.density(h.z) * masking / (4.0 * i.z)
            }
        };
        lobe + self.base_reflectance * FRAC_1_PI * o.z
    }

    /// f(ω, ω) \[sr⁻¹\] at an angle of incidence, rad: the truth of a retro-reflection with no cone. Of a mirror there is none.
    pub fn retro(&self, theta_rad: f64) -> Option<f64> {
        let w = DVec3::new(theta_rad.sin(), 0.0, theta_rad.cos());
        let finite = self.kind != SampleKind::Mirror && w.z > 0.0;
        finite.then(|| self.radiance(w, w) / w.z)
    }

    /// D \[sr⁻¹\] of the microfacets whose normals have this cosine; ∫ D cosθ dω = 1.
    pub fn density(&self, cos: f64) -> f64 {
        if cos <= 0.0 {
            return 0.0;
        }
        let a2 = self.alpha * self.alpha;
        let cos2 = cos * cos;
        let tan2 = (1.0 - cos2).max(0.0) / cos2;
        match self.kind {
            SampleKind::Beckmann => (-tan2 / a2).exp() / (PI * a2 * cos2 * cos2),
            _ => 1.0 / (PI * a2 * cos2 * cos2 * (1.0 + tan2 / a2).powi(2)),
        }
    }

    /// G₁: the part of the microfacets that face a direction of this cosine and are seen from it.
    fn masking(&self, cos: f64) -> f64 {
        let tan = (1.0 - cos * cos).max(0.0).sqrt() / cos;
        if tan < 1e-12 {
            return 1.0;
        }
        match self.kind {
            SampleKind::Beckmann => {
                let a = 1.0 / (self.alpha * tan);
                2.0 / (1.0 + libm::erf(a) + (-a * a).exp() / (a * PI.sqrt()))
            }
            _ => 2.0 / (1.0 + (1.0 + (self.alpha * tan).powi(2)).sqrt()),
        }
    }
}
