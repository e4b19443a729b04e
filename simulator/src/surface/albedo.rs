//! The fraction of light that a rough surface reflects in all directions.
//!
//! With the slopes (x, y) of a microfacet in units of α_x, α_y, its distribution is a fixed bell p, and
//! E(i) = ∫∫ p F G (1 + B r) r dr dφ with B r the slope towards the light over its height. What leaves above the horizon fills
//! in each direction φ the slopes up to r = (B + √(B² + A))/A with A = α_x²cos²φ + α_y²sin²φ: for every roughness and incidence a smooth limit,
//! but for a step at B = 0 near grazing incidence, towards which the panels shrink.

use super::{Distribution, Fresnel, Lobe, Material, Model, cos_difference, rule};
use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, FRAC_PI_2, PI};

/// The relative change from one order of the quadrature to the next at which it is taken as converged.
const TOLERANCE: f64 = 1e-9;

impl Material {
    /// The directional–hemispherical reflectance ∫ f_r cosθ_o dω_o at a wavelength (vacuum nm) for light from `i` (unit vector, surface's own
    /// axes). 0 for light from below; the quadrature stops when its orders agree to 1e-9.
    pub fn albedo(&self, wavelength_nm: f64, i: DVec3) -> f64 {
        self.times_spectra(wavelength_nm, &self.albedo_weights(i))
    }

    /// [`Material::albedo`] as weights, one per spectrum.
    pub fn albedo_weights(&self, i: DVec3) -> Vec<f64> {
        let mut sum = vec![0.0; self.spectra.len()];
        if i.z.is_nan() || i.z <= 0.0 {
            return sum;
        }
        match &self.model {
            Model::Lambert => sum[0] = 1.0,
            Model::Mirror { fresnel } => fresnel.add_weights(i.z, 1.0, &mut sum),
            Model::Microfacet { lobe, fresnel } => sum = weights(lobe, fresnel, i),
            Model::Blend { lobe, fresnel, base } => {
                let coat = weights(lobe, fresnel, i);
                sum[..coat.len()].copy_from_slice(&coat);
                base.add_albedo(i.z, &mut sum[coat.len()..]);
            }
        }
        sum
    }
}

/// The albedo of a lobe for light from `i`, above the horizon, one weight for each spectrum of the Fresnel term.
pub(super) fn weights(lobe: &Lobe, fresnel: &Fresnel, i: DVec3) -> Vec<f64> {
    let (alpha_x, alpha_y) = lobe.alpha();
    // Slope towards the light, per unit of slope.
    let tilt = |phi: f64| (i.x * alpha_x * phi.cos() + i.y * alpha_y * phi.sin()) / i.z;
    // The direction of the largest B; the steps are a quarter turn away from it.
    let top = (i.y * alpha_y).atan2(i.x * alpha_x);
    let steepest = tilt(top).max(0.0);
    let scale = (0.2 / (1.0 + steepest * 6.0_f64.max(1.0 / alpha_x.min(alpha_y)))).max(1e-6);
    let mut edges = rule::towards(0.0, FRAC_PI_2, scale);
    edges.extend(rule::towards(PI, FRAC_PI_2, scale).iter().rev().skip(1));
    // Of an isotropic lobe the other half is the same.
    let halves: &[f64] = if lobe.is_isotropic() { &[1.0] } else { &[1.0, -1.0] };
    let share = 2.0 / halves.len() as f64;
    let mut last: Option<Vec<f64>> = None;
    for order in 0..rule::ORDERS.len() {
        let mut sum = vec![0.0; fresnel.spectra().len()];
        for &(delta, weight) in &rule::points(&edges, order) {
            for half in halves {
                let phi = top + half * delta;
                let b = tilt(phi);
                ray(lobe, fresnel, i, phi, b, share * weight * FRAC_1_PI, order, &mut sum);
            }
        }
        let size = sum.iter().fold(1e-12_f64, |a, v| a.max(v.abs()));
        let done = last.as_ref().is_some_and(|last| {
            last.iter().zip(&sum).all(|(a, b)| (a - b).abs() <= TOLERANCE * size)
        });
        last = Some(sum);
        if done {
            break;
        }
    }
    last.unwrap_or_default()
}

/// Adds what microfacets reflect that are tilted towards azimuth `phi` (in slopes of α).
#[expect(clippy::too_many_arguments, reason = "the inner loop of one integral")]
fn ray(
    lobe: &Lobe,
    fresnel: &Fresnel,
    i: DVec3,
    phi: f64,
    b: f64,
    scale: f64,
    order: usize,
    sum: &mut [f64],
) {
    let (x, y) = (lobe.alpha_x * phi.cos(), lobe.alpha_y * phi.sin());
    let a = x * x + y * y;
    let root = (b * b + a).sqrt();
    let limit = if b > 0.0 { (b + root) / a } else { 1.0 / (root - b) };
    let mut add = |r: f64, weight: f64| {
        let h = DVec3::new(x * r, y * r, 1.0).normalize();
        let o = h * (2.0 * i.dot(h)) - i;
        if o.z > 0.0 {
            let height = |v: DVec3| (v.z, (lobe.alpha_x * v.x).hypot(lobe.alpha_y * v.y));
            let seen = i.z * o.z * lobe.masking_over_heights(height(i), height(o));
            // Both directions have the same angle to h.
            fresnel.add_weights(cos_difference(i, o), scale * weight * seen * (1.0 + b * r), sum);
        }
    };
    match lobe.distribution {
        Distribution::Beckmann => {
            // e^(−6.5²) is 5e-19. Masking varies near the horizon, where the limit is not far.
            let end = limit.min(6.5);
            for (r, weight) in rule::points(&[0.0, 0.5 * end, end], order) {
                add(r, weight * r * (-r * r).exp());
            }
        }
        Distribution::Ggx => {
            // r = tan ψ: p r dr = sin ψ cos ψ dψ.
            let end = limit.atan();
            let scale = (1.0 / (1.0 + limit * limit)).min(lobe.alpha_x).clamp(1e-5, 0.4);
            for (psi, weight) in rule::points(&rule::towards(0.0, end, scale), order) {
                add(psi.tan(), weight * psi.sin() * psi.cos());
            }
        }
    }
}
