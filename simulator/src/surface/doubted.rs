//! A material's doubt as a material of its own: f times what f may be too high by, e^δ − 1, with δ the half-width of the 95 % interval of ln f.
//!
//! In a scene in which it alone is not black, the light that a body sends is so by how much the material's doubt may change it, all directions off alike.

use super::sampling::Mixture;
use super::scatter::{Effort, Scatter};
use super::{Material, Model};
use glam::DVec3;
use std::sync::Arc;

/// An error of an error needs no more digits.
const ROUGH: Effort = Effort { tolerance: 1e-2, most: 6_000 };

#[derive(Debug)]
struct Doubted(Material);

impl Doubted {
    fn law(&self) -> Option<&Arc<dyn Scatter>> {
        match &self.0.model {
            Model::Law(law) => Some(law),
            _ => None,
        }
    }
}

impl Scatter for Doubted {
    fn add_weights(&self, i: DVec3, o: DVec3, scale: f64, sum: &mut [f64]) {
        let doubt = self.0.ln_doubt(i, o).unwrap_or(0.0);
        // Where nothing was measured the material says so itself.
        match self.law() {
            Some(law) => law.add_weights(i, o, scale * doubt.exp_m1(), sum),
            None => self.0.add_weights(i, o, scale * doubt.exp_m1(), sum),
        }
    }

    fn is_isotropic(&self) -> bool {
        self.0.is_isotropic()
    }

    fn describe(&self) -> String {
        format!("the doubt of {}", self.0.describe())
    }

    fn lobe_width_rad(&self) -> f64 {
        let of_lobe = || self.0.narrowest_lobe().map_or(1.5, |(_, alpha)| 2.0 * alpha);
        self.law().map_or_else(of_lobe, |law| law.lobe_width_rad())
    }

    fn effort(&self) -> Effort {
        ROUGH
    }

    fn grain(&self) -> f64 {
        ROUGH.tolerance
    }
}

impl Material {
    /// Whether it says how well f is known ([`Material::ln_doubt`]).
    pub fn says_doubt(&self) -> bool {
        let i = DVec3::new(0.3, 0.0, 0.91_f64.sqrt());
        !self.is_mirror() && self.ln_doubt(i, DVec3::Z).is_some()
    }

    /// The half-width of the 95 % interval of f as a material; `None` where nothing says how well f is known. It may reflect more than came.
    pub fn doubted(&self) -> Option<Self> {
        if !self.says_doubt() {
            return None;
        }
        Some(Self {
            name: self.name.clone(),
            spectra: self.spectra.clone(),
            model: Model::Law(Arc::new(Doubted(self.clone()))),
            proposals: Mixture::clone(&self.proposals),
            largest: self.largest,
            notes: Vec::new(),
            stated: None,
            ageing: None,
        })
    }
}
