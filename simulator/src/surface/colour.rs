//! The one spectrum that a material is known by.

use super::Material;
use glam::DVec3;
use sunglint_radiometry::spectrum::{Reflectance, Spectrum, SpectrumError};

impl Material {
    /// The colour of a material at normal incidence, seen from there: Σ_k ρ_k w_k / Σ_k w_k. Where a material's colour changes with the angle (Fresnel, coats) that is one
    /// colour of many; `true` beside it says so.
    ///
    /// # Errors
    /// Wavelengths that are none.
    pub fn normal_colour(&self) -> Result<(Spectrum<Reflectance>, bool), SpectrumError> {
        let spectra = self.spectra();
        let mut weights = vec![0.0; spectra.len()];
        if self.is_mirror() {
            // A mirror has no f_r; its first spectrum is that at normal incidence.
            weights[0] = 1.0;
        } else {
            self.add_weights(DVec3::Z, DVec3::Z, 1.0, &mut weights);
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
        Ok((reflectance, changes))
    }
}
