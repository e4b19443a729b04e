//! How much a mirror reflects, by wavelength and angle of incidence, as a few spectra times a few weights.

use super::{MaterialError, conductor};
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};

/// The Fresnel term: F(λ, θ) = Σ_k ρ_k(λ) F_k(cosθ), with θ the angle of incidence on the (micro)mirror.
#[derive(Debug, Clone)]
pub struct Fresnel {
    pub(super) spectra: Vec<Spectrum<Reflectance>>,
    pub(super) law: Law,
}

#[derive(Debug, Clone)]
pub(super) enum Law {
    Constant,
    Schlick,
    Conductor(conductor::Conductor),
}

impl Fresnel {
    /// A reflectance that is the same at all angles.
    ///
    /// # Errors
    /// A reflectance above 1.
    pub fn constant(reflectance: Spectrum<Reflectance>) -> Result<Self, MaterialError> {
        super::check_reflectance(&reflectance)?;
        Ok(Self { spectra: vec![reflectance], law: Law::Constant })
    }

    /// Schlick's approximation F = R₀ + (1 − R₀)(1 − cosθ)⁵ (Schlick 1994, eq. 15) from a reflectance that was measured at normal incidence.
    ///
    /// # Errors
    /// A reflectance above 1.
    pub fn schlick(normal: Spectrum<Reflectance>) -> Result<Self, MaterialError> {
        super::check_reflectance(&normal)?;
        let (from_nm, to_nm) = normal.range_nm();
        let one = Spectrum::constant(1.0, from_nm, to_nm)?;
        Ok(Self { spectra: vec![normal, one], law: Law::Schlick })
    }

    /// Fresnel's equations for unpolarised light and the refractive index n + ik of a bulk material in vacuum.
    /// The spectra are the reflectances at some angles, and the weights interpolate between them: see
    /// [`super::conductor`] for the error.
    ///
    /// # Errors
    /// An index whose reflectance is not smooth enough in angle (n < 1 with k near 0).
    pub fn conductor(index: &conductor::ComplexIndex) -> Result<Self, MaterialError> {
        let (conductor, spectra) = conductor::Conductor::new(index)?;
        Ok(Self { spectra, law: Law::Conductor(conductor) })
    }

    /// The spectra ρ_k, all from 0 to 1.
    pub fn spectra(&self) -> &[Spectrum<Reflectance>] {
        &self.spectra
    }

    /// Adds `scale`·F_k(cosθ) to `sum`, one per spectrum.
    pub fn add_weights(&self, cos: f64, scale: f64, sum: &mut [f64]) {
        match &self.law {
            Law::Constant => sum[0] += scale,
            Law::Schlick => {
                let rise = (1.0 - cos.clamp(0.0, 1.0)).powi(5);
                sum[0] += scale * (1.0 - rise);
                sum[1] += scale * rise;
            }
            Law::Conductor(conductor) => conductor.add_weights(cos, scale, sum),
        }
    }

    /// F_k(cosθ) and their derivatives by cosθ.
    pub(super) fn slopes(&self, cos: f64) -> Vec<(f64, f64)> {
        match &self.law {
            Law::Constant => vec![(1.0, 0.0)],
            Law::Schlick => {
                let left = 1.0 - cos.clamp(0.0, 1.0);
                let (rise, rate) = (left.powi(5), -5.0 * left.powi(4));
                vec![(1.0 - rise, -rate), (rise, rate)]
            }
            Law::Conductor(conductor) => conductor.slopes(cos),
        }
    }

    /// Whether it is the same at all angles.
    pub(super) fn is_constant(&self) -> bool {
        matches!(self.law, Law::Constant)
    }

    /// F(θ)/F(0) of each wavelength as a term whose spectra are at most 1, and the number that its weights are to be multiplied by.
    pub(super) fn relative(&self) -> Result<(Self, f64), MaterialError> {
        let mut at_normal = vec![0.0; self.spectra.len()];
        self.add_weights(1.0, 1.0, &mut at_normal);
        let mut divided = Vec::new();
        for spectrum in &self.spectra {
            let ratio = |nm: &f64| {
                let normal: f64 =
                    self.spectra.iter().zip(&at_normal).map(|(s, w)| s.at(*nm) * w).sum();
                spectrum.at(*nm) / normal.max(1e-9)
            };
            divided.push(spectrum.wavelength_nm().iter().map(ratio).collect::<Vec<f64>>());
        }
        let scale = divided.iter().flatten().copied().fold(f64::MIN_POSITIVE, f64::max);
        let spectra = self.spectra.iter().zip(divided).map(|(spectrum, ratio)| {
            let value = ratio.iter().map(|v| v / scale).collect();
            Ok(Spectrum::new(spectrum.wavelength_nm().to_vec(), value)?)
        });
        let spectra = spectra.collect::<Result<_, MaterialError>>()?;
        Ok((Self { spectra, law: self.law.clone() }, scale))
    }

    /// The largest error of F over all angles and the tabulated wavelengths, against the law that it stands for.
    pub fn error(&self) -> f64 {
        match &self.law {
            Law::Conductor(conductor) => conductor.error(),
            _ => 0.0,
        }
    }

    pub(super) fn describe(&self) -> String {
        match &self.law {
            Law::Constant => format!("reflectance {}", super::range_of(&self.spectra[0])),
            Law::Schlick => {
                format!("Schlick's Fresnel term from {}", super::range_of(&self.spectra[0]))
            }
            Law::Conductor(conductor) => format!("Fresnel term of {}", conductor.name()),
        }
    }
}
