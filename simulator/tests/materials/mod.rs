//! Parametric, measured and wrinkled materials.
#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod cases;
mod files;
mod foil;
mod laws;
mod measured;
mod numerics;
mod tables;

use glam::DVec3;
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};

/// One reflectance, 300 to 1240 nm.
pub fn flat(value: f64) -> Spectrum<Reflectance> {
    Spectrum::constant(value, 300.0, 1240.0).unwrap()
}

/// A unit vector.
pub fn direction(theta_deg: f64, phi_deg: f64) -> DVec3 {
    let (theta, phi) = (theta_deg.to_radians(), phi_deg.to_radians());
    DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
}

/// ∫ f(o) cosθ_o dω_o by the midpoint rule in (θ, φ): independent of the library's quadratures.
pub fn hemisphere(steps: usize, f: impl Fn(DVec3) -> f64) -> f64 {
    let step = std::f64::consts::FRAC_PI_2 / steps as f64;
    let mut sum = 0.0;
    for j in 0..steps {
        let theta = (j as f64 + 0.5) * step;
        for k in 0..2 * steps {
            let phi = (k as f64 + 0.5) / steps as f64 * std::f64::consts::PI;
            let o = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            sum += f(o) * theta.cos() * theta.sin();
        }
    }
    sum * step * std::f64::consts::PI / steps as f64
}
