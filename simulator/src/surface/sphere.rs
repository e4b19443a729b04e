//! Reflection by a sphere: ∫ f_r cosθ_i cosθ_o dA over all that is lit and seen, under a collimated Sun and a distant observer.
//!
//! For microfacets the bisector h, and so the angle of incidence on the microfacets (half the phase angle γ), is the same all over the
//! sphere: F stands before the integral, the two cosines cancel, and W = F/4 ∫ D(n·h) G dω_n. With the slopes x, y of the
//! normal n against h in units of α, x in the plane of Sun and observer, D becomes a fixed bell and W = F/(4π) ∫∫ p(r) √(1+α²r²) G dx dy
//! over the strip |x| < cot(γ/2)/α, where the normal is lit and seen. That holds for every α: the bell has no narrow peak, and the strip no
//! edge that would have to be found.

use super::{Distribution, Lobe, Material, MaterialError, Model};
use std::f64::consts::{FRAC_1_PI, FRAC_PI_2, PI};
use sunglint_numerics::panels;

/// The relative change from one order of the quadrature to the next at which it is taken as converged.
const TOLERANCE: f64 = 1e-9;

impl Material {
    /// Adds `scale` times the weights W_k \[m² sr⁻¹\] of a sphere of 1 m radius at a phase angle (radians, 0 to π) to `sum` (one per
    /// spectrum): I(λ) = E(λ) R² Σ_k ρ_k(λ) W_k. Gives the estimated relative error, 0 of closed forms: Lambert
    /// 2/(3π) (sin γ + (π − γ) cos γ), mirror F(γ/2)/4.
    ///
    /// # Errors
    /// A material with a tangent, which has no place on a sphere; a phase angle out of range.
    pub fn add_sphere_weights(
        &self,
        phase_rad: f64,
        scale: f64,
        sum: &mut [f64],
    ) -> Result<f64, MaterialError> {
        if !(0.0..=PI).contains(&phase_rad) {
            return Err(MaterialError::Phase { phase_rad });
        }
        if !self.is_isotropic() {
            return Err(MaterialError::Tangent { name: self.name.clone() });
        }
        if phase_rad == PI {
            return Ok(0.0);
        }
        let (integrals, error) = self.sphere_integrals(phase_rad);
        self.add_sphere_integrals(phase_rad, &integrals, scale, sum);
        Ok(error)
    }

    /// Whether its weights on a sphere are closed forms: [`Material::sphere_integrals`] then has nothing.
    pub(crate) fn has_closed_sphere(&self) -> bool {
        matches!(self.model, Model::Lambert | Model::Mirror { .. })
    }

    /// The integrals over a sphere of 1 m that stand in its weights, at a phase angle from 0 to below π, and their estimated relative error: smooth functions of
    /// the phase angle, without Fresnel factors. Of an isotropic material.
    pub(crate) fn sphere_integrals(&self, phase_rad: f64) -> (Vec<f64>, f64) {
        match &self.model {
            Model::Lambert | Model::Mirror { .. } => (Vec::new(), 0.0),
            Model::Microfacet { lobe, .. } => {
                let (value, error) = microfacet(lobe, phase_rad);
                (vec![value], error)
            }
            Model::Blend { lobe, base, .. } => {
                let (value, error) = microfacet(lobe, phase_rad);
                let (weights, base_error) = diffuse(phase_rad, |cos_i, cos_o, scale, sum| {
                    base.add_weights(cos_i, cos_o, scale, sum);
                });
                let all = std::iter::once(value).chain(weights).collect();
                (all, error.max(base_error))
            }
            Model::Law(law) => {
                let mut weights = vec![0.0; self.spectra.len()];
                let error = self.numerical_sphere(&**law, phase_rad, 1.0, &mut weights);
                (weights, error)
            }
        }
    }

    /// Adds `scale` times the weights of a sphere of 1 m from its integrals.
    pub(crate) fn add_sphere_integrals(
        &self,
        phase_rad: f64,
        integrals: &[f64],
        scale: f64,
        sum: &mut [f64],
    ) {
        let cos_half = (0.5 * (PI - phase_rad)).sin();
        match &self.model {
            Model::Lambert => sum[0] += scale * lambert(phase_rad),
            Model::Mirror { fresnel } => fresnel.add_weights(cos_half, 0.25 * scale, sum),
            Model::Microfacet { fresnel, .. } => {
                fresnel.add_weights(cos_half, scale * integrals[0], sum);
            }
            Model::Blend { fresnel, .. } => {
                let (coat, below) = sum.split_at_mut(fresnel.spectra().len());
                fresnel.add_weights(cos_half, scale * integrals[0], coat);
                below.iter_mut().zip(&integrals[1..]).for_each(|(sum, w)| *sum += scale * w);
            }
            Model::Law(_) => {
                sum.iter_mut().zip(integrals).for_each(|(sum, w)| *sum += scale * w);
            }
        }
    }
}

/// A Lambert sphere of reflectance 1: 2/(3π) (sin γ + (π − γ) cos γ) (Russell 1916), by its series where both terms all but cancel.
fn lambert(phase: f64) -> f64 {
    let left = PI - phase;
    let lit = if left < 0.1 {
        // sin ε − ε cos ε.
        let square = left * left;
        left * square
            * (1.0 / 3.0 - square * (1.0 / 30.0 - square * (1.0 / 840.0 - square / 45_360.0)))
    } else {
        left.sin() - left * left.cos()
    };
    2.0 / 3.0 * FRAC_1_PI * lit
}

/// W of an isotropic lobe with F = 1, and its estimated relative error.
fn microfacet(lobe: &Lobe, phase: f64) -> (f64, f64) {
    let (cos, sin) = ((0.5 * (PI - phase)).sin(), (0.5 * phase).sin());
    let alpha = lobe.alpha_x;
    // √(1+α²r²)·cosθ and √(1+α²r²)·α sinθ towards Sun and observer.
    let masking = |x: f64, y: f64| {
        let (x, y) = (alpha * x, alpha * y);
        let i = (cos + sin * x, alpha * (sin - cos * x).hypot(y));
        let o = ((cos - sin * x).max(0.0), alpha * (sin + cos * x).hypot(y));
        i.0 * o.0 * lobe.masking_over_heights(i, o)
    };
    // Half the width of the strip.
    let edge = if sin > 0.0 { cos / (sin * alpha) } else { f64::INFINITY };
    let (value, error) = match lobe.distribution {
        Distribution::Beckmann => {
            // e^(−6.5²) is 5e-19.
            let edges = |most: f64| [0.0, most / 3.0, most * 2.0 / 3.0, most];
            let (across, along) = (edges(edge.min(6.5)), edges(6.5));
            panels::converge(TOLERANCE, |order| {
                let along = panels::points(&along, order);
                let column = |x: f64| -> f64 {
                    let value = |y: f64| {
                        let r2 = x * x + y * y;
                        (-r2).exp() * (1.0 + alpha * alpha * r2).sqrt() * masking(x, y)
                    };
                    along.iter().map(|&(y, w)| w * value(y)).sum()
                };
                [panels::points(&across, order).iter().map(|&(x, w)| w * column(x)).sum()]
            })
        }
        Distribution::Ggx => {
            // x = tan χ and y = tan ψ/cos χ bring the long tails to a finite range, on which what is left of the
            // bell and the root is cos ψ √(cos²χ cos²ψ (1 − α²) + α²). Masking varies at slopes of 1/α, and within 1 of the strip's edge.
            let end = edge.atan();
            let scale = |length: f64| length.clamp(1e-6, 0.4);
            let across = panels::towards(0.0, end, scale(alpha.min(1.0 / (1.0 + edge * edge))));
            let along = panels::towards(0.0, FRAC_PI_2, scale(alpha));
            panels::converge(TOLERANCE, |order| {
                let along = panels::points(&along, order);
                let column = |chi: f64| -> f64 {
                    let value = |psi: f64| {
                        let (cos_chi, cos_psi) = (chi.cos(), psi.cos());
                        let (x, y) = (chi.tan(), psi.tan() / cos_chi);
                        let narrow = (cos_chi * cos_psi).powi(2) * (1.0 - alpha * alpha);
                        cos_psi * (narrow + alpha * alpha).sqrt() * masking(x, y)
                    };
                    along.iter().map(|&(psi, w)| w * value(psi)).sum()
                };
                [panels::points(&across, order).iter().map(|&(chi, w)| w * column(chi)).sum()]
            })
        }
    };
    // A quarter of the bell four times.
    (FRAC_1_PI * value[0], error)
}

/// ∫ w cosθ_i cosθ_o dA of weights that depend on the two cosines alone, and its estimated relative error.
fn diffuse(phase: f64, add: impl Fn(f64, f64, f64, &mut [f64])) -> ([f64; 3], f64) {
    // Longitude from the middle of what is lit and seen, in the plane of Sun and observer; latitude above it, and below the same.
    let half = 0.5 * (PI - phase);
    let edges = |most: f64| [panels::towards(0.0, -most, 0.02), panels::towards(0.0, most, 0.02)];
    let longitudes = edges(half);
    let latitudes = panels::towards(0.0, FRAC_PI_2, 0.05);
    panels::converge(TOLERANCE, |order| {
        let mut sum = [0.0; 3];
        for side in &longitudes {
            for (longitude, width) in panels::points(side, order) {
                // cos(longitude ± γ/2), from the angle left to the terminator.
                let (i, o) = ((half + longitude).sin(), (half - longitude).sin());
                for (latitude, height) in panels::points(&latitudes, order) {
                    let cos = latitude.cos();
                    let (cos_i, cos_o) = ((cos * i).max(0.0), (cos * o).max(0.0));
                    let area = 2.0 * width.abs() * height * cos;
                    add(cos_i, cos_o, area * cos_i * cos_o, &mut sum);
                }
            }
        }
        sum
    })
}
