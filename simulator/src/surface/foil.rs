//! Wrinkled foil: facets of a material, tilted as Gaussian slopes, too small to be seen one by one.
//!
//! f(i, o) = G/(cosθ_i cosθ_o) ∫ f_base(i, o; m) (i·m)₊ (o·m)₊ D(m) dω_m: each facet counts with the area that it turns to the light and to the
//! observer, and G is Smith's for those slopes (Walter et al. 2007, eqs. 8–11; Heitz 2014, eq. 52). It is reciprocal where the base is, and reflects no
//! more than the base does: ∫ G₁ D (i·m)₊ dω_m = cosθ_i. A perfect mirror as the base gives the microfacet lobe of that roughness.
//!
//! The integral is taken over slopes in units of the roughness, in panels that become smaller towards the tilt that would mirror the one direction into
//! the other.

use super::sampling::{Mixture, Proposal};
use super::scatter::{Effort, LargestAlbedo, Scatter};
use super::{Distribution, Lobe, Masking, Material, MaterialError, Model};
use glam::DVec3;
use std::f64::consts::FRAC_1_PI;
use std::sync::Arc;
use sunglint_numerics::panels;

/// e^(−4.2²) is 2e-8.
const END: f64 = 4.2;
/// Points in a panel: `panels::ORDERS[1]`.
const ORDER: usize = 1;

#[derive(Debug)]
struct Foil {
    tilts: Lobe,
    base: Material,
}

impl Material {
    /// A foil of a material with Gaussian slopes of root mean square `slope_x` and `slope_y` along and across the tangent. Its light is reflected once: what goes
    /// from wrinkle to wrinkle is lost, as it is between microfacets.
    ///
    /// # Errors
    /// Slopes out of range (1e-5 to 1.4); a base that is a foil.
    pub fn foil(
        name: impl Into<String>,
        base: Self,
        slope_x: f64,
        slope_y: f64,
        masking: Masking,
    ) -> Result<Self, MaterialError> {
        let alpha = std::f64::consts::SQRT_2;
        let (x, y) = (alpha * slope_x, alpha * slope_y);
        let tilts = Lobe::anisotropic(Distribution::Beckmann, x, y, masking)?;
        if let Model::Mirror { fresnel } = base.model {
            return Ok(Self::microfacet(name, tilts, fresnel));
        }
        // For drawing: the tilts of both together, with longer tails.
        let own = 0.5 * base.lobe_width_rad();
        let both = |a: f64| a.hypot(own.tan().min(1.0)).min(2.0);
        let wide = Lobe::anisotropic(Distribution::Ggx, both(x), both(y), Masking::Separable)?;
        let ways = vec![(0.6, Proposal::Facets(wide)), (0.4, Proposal::Cosine)];
        let (spectra, notes) = (base.spectra.clone(), base.notes.clone());
        // It reflects no more than its base.
        let largest = LargestAlbedo::bound(base.albedo_bound());
        let law = Arc::new(Foil { tilts, base });
        Ok(Self {
            name: name.into(),
            spectra,
            model: Model::Law(law),
            proposals: Mixture::new(ways),
            largest: Some(largest),
            notes,
            stated: None,
            ageing: None,
        })
    }
}

impl Scatter for Foil {
    fn add_weights(&self, i: DVec3, o: DVec3, scale: f64, sum: &mut [f64]) {
        let (alpha_x, alpha_y) = self.tilts.alpha();
        let scale = scale * FRAC_1_PI * self.tilts.masking_over_cosines(i, o);
        let h = i + o;
        let width = 0.5 * self.base.lobe_width_rad();
        let (xs, ys) = (
            panels(-h.x / h.z / alpha_x, width / alpha_x),
            panels(-h.y / h.z / alpha_y, width / alpha_y),
        );
        for &(y, height) in &ys {
            for &(x, across) in &xs {
                // A facet of unit area in the plane has the area √(1+slopes²), and its normal that length: two of the three cancel.
                let up = DVec3::new(-alpha_x * x, -alpha_y * y, 1.0);
                let (lit, seen) = (i.dot(up), o.dot(up));
                if lit > 0.0 && seen > 0.0 {
                    let length = up.length();
                    let bell = (-x * x - y * y).exp() * across * height;
                    let axes = Axes::of(up / length);
                    let weight = scale * bell * lit * seen / length;
                    self.base.add_weights(axes.local(i), axes.local(o), weight, sum);
                }
            }
        }
    }

    fn is_isotropic(&self) -> bool {
        self.tilts.is_isotropic() && self.base.is_isotropic()
    }

    fn describe(&self) -> String {
        let (x, y) = self.tilts.alpha();
        let rms = |alpha: f64| alpha / std::f64::consts::SQRT_2;
        format!(
            "foil with slopes of {:.4} and {:.4} (rms), of {}",
            rms(x),
            rms(y),
            self.base.describe()
        )
    }

    fn effort(&self) -> Effort {
        Effort { tolerance: 1e-3, most: 4_000 }
    }

    fn has_gaps(&self) -> bool {
        matches!(&self.base.model, Model::Law(law) if law.has_gaps())
    }

    fn covers(&self, i: DVec3, o: DVec3) -> bool {
        self.base.covers(i, o)
    }

    fn lobe_width_rad(&self) -> f64 {
        self.tilts.width_rad().hypot(self.base.lobe_width_rad()).min(std::f64::consts::FRAC_PI_2)
    }
}

/// Points and weights from −END to END, in panels that shrink towards `peak` down to `width`.
fn panels(peak: f64, width: f64) -> Vec<(f64, f64)> {
    let peak = if peak.is_nan() { 0.0 } else { peak.clamp(-END, END) };
    let scale = width.clamp(1e-4, 1.5);
    let mut points = Vec::new();
    for end in [-END, END] {
        if end != peak {
            let side = panels::points(&panels::towards(end, peak, scale), ORDER);
            points.extend(side.into_iter().map(|(x, w)| (x, w.abs())));
        }
    }
    points
}

/// The axes of a tilted facet: x as near to the surface's x as may be.
struct Axes {
    x: DVec3,
    y: DVec3,
    z: DVec3,
}

impl Axes {
    fn of(z: DVec3) -> Self {
        let x = (DVec3::X - z * z.x).normalize();
        Self { x, y: z.cross(x), z }
    }

    fn local(&self, v: DVec3) -> DVec3 {
        DVec3::new(v.dot(self.x), v.dot(self.y), v.dot(self.z))
    }
}
