//! How a material reflects.
//!
//! Wavelength and direction are kept apart: f_r(λ; ω_i, ω_o) = Σ_k ρ_k(λ) w_k(ω_i, ω_o), with spectra ρ_k that do not depend on the
//! geometry (all between 0 and 1) and weights w_k in sr⁻¹ that do not depend on the wavelength. So the geometry of a whole
//! body is summed once into one number per k, whatever the number of bins and channels. A Lambert material has one such term, a microfacet
//! material with a measured reflectance one, with Schlick's Fresnel term two; with n + ik the reflectance at a handful of
//! angles of incidence, between which the weights interpolate.

use glam::DVec3;
use std::f64::consts::FRAC_1_PI;
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};

/// A material.
#[derive(Debug, Clone)]
pub struct Material {
    /// Its name.
    pub name: String,
    /// The spectra ρ_k.
    spectra: Vec<Spectrum<Reflectance>>,
}

impl Material {
    /// A Lambert surface: f_r = ρ(λ)/π.
    pub fn lambert(name: impl Into<String>, reflectance: Spectrum<Reflectance>) -> Self {
        Self { name: name.into(), spectra: vec![reflectance] }
    }

    /// The spectra ρ_k: as many as there are weights.
    pub fn spectra(&self) -> &[Spectrum<Reflectance>] {
        &self.spectra
    }

    /// Adds `scale` times the weights w_k \[sr⁻¹\] for light from `i` to `o` to `sum` (one per spectrum). Unit vectors in the surface's
    /// own axes (z the normal, x the tangent), both away from the surface. Nothing is added where either is at or below the horizon.
    pub fn add_weights(&self, i: DVec3, o: DVec3, scale: f64, sum: &mut [f64]) {
        if i.z > 0.0 && o.z > 0.0 {
            sum[0] += scale * FRAC_1_PI;
        }
    }

    /// Whether it is a perfect mirror, whose f_r is no function: its weights are not defined, and only a sphere of it has a
    /// radiant intensity under a point-like Sun.
    pub fn is_mirror(&self) -> bool {
        false
    }
}
