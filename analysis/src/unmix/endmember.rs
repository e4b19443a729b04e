//! The spectrum of a material.

use glam::DVec3;
use sunglint_radiometry::spectrum::{Reflectance, Spectrum, SpectrumError};
use sunglint_simulator::surface::Material;

/// A material's spectrum by its name.
#[derive(Debug, Clone, PartialEq)]
pub struct Endmember {
    /// The material's name.
    pub name: String,
    /// Its reflectance.
    pub reflectance: Spectrum<Reflectance>,
}

impl Endmember {
    /// The colour of a material at normal incidence, seen from there: Σ_k ρ_k w_k / Σ_k w_k. Where a material's colour changes with the angle (Fresnel, coats) that is one
    /// colour of many; `true` beside it says so.
    ///
    /// # Errors
    /// Wavelengths that are none.
    pub fn of(material: &Material) -> Result<(Self, bool), SpectrumError> {
        let spectra = material.spectra();
        let mut weights = vec![0.0; spectra.len()];
        if material.is_mirror() {
            // A mirror has no f_r; its first spectrum is that at normal incidence.
            weights[0] = 1.0;
        } else {
            material.add_weights(DVec3::Z, DVec3::Z, 1.0, &mut weights);
        }
        let sum: f64 = weights.iter().sum();
        let used: Vec<_> = spectra.iter().zip(&weights).filter(|(_, w)| **w > 0.0).collect();
        let changes = spectra.len() > 1;
        let reflectance = match used[..] {
            // Dark in this direction: the first spectrum is all that is known.
            [] => spectra[0].clone(),
            [(only, _)] => only.clone(),
            _ => {
                let grids = used.iter().flat_map(|(s, _)| s.wavelength_nm().iter().copied());
                let mut nm: Vec<f64> = grids.collect();
                nm.sort_by(f64::total_cmp);
                nm.dedup();
                // Where all are tabulated.
                let from = used.iter().map(|(s, _)| s.range_nm().0).fold(0.0, f64::max);
                let to = used.iter().map(|(s, _)| s.range_nm().1).fold(f64::INFINITY, f64::min);
                nm.retain(|nm| (from..=to).contains(nm));
                let at = |nm: &f64| used.iter().map(|(s, w)| s.at(*nm) * **w).sum::<f64>() / sum;
                let value = nm.iter().map(at).collect();
                Spectrum::new(nm, value)?
            }
        };
        Ok((Self { name: material.name.clone(), reflectance }, changes))
    }
}
