//! Reflectances by which the weights of a scene count at one wavelength.

use super::Scene;
use crate::surface::is_uncovered;

/// A wavelength beyond a material's table.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{nm} nm: the material {material} is tabulated from {first_nm} to {last_nm} nm")]
pub struct UncoveredError {
    /// The wavelength, nm.
    pub nm: f64,
    /// The material.
    pub material: String,
    /// The first wavelength of its table, nm.
    pub first_nm: f64,
    /// The last wavelength of its table, nm.
    pub last_nm: f64,
}

impl Scene {
    /// Returns the reflectance ρ_k(λ) of each weight at a vacuum wavelength, nm.
    ///
    /// # Errors
    /// A wavelength beyond a material's table.
    pub fn reflectances(&self, nm: f64) -> Result<Vec<f64>, UncoveredError> {
        let mut all = Vec::with_capacity(self.weight_count());
        for material in self.materials() {
            for spectrum in material.spectra() {
                let (first_nm, last_nm) = spectrum.range_nm();
                // It only says which geometries were not measured: no light is known of these.
                if is_uncovered((first_nm, last_nm)) {
                    all.push(0.0);
                    continue;
                }
                if !(first_nm..=last_nm).contains(&nm) {
                    let material = material.name.clone();
                    return Err(UncoveredError { nm, material, first_nm, last_nm });
                }
                all.push(spectrum.at(nm));
            }
        }
        Ok(all)
    }
}
