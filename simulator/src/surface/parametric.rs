//! Materials that are sums of lobes, each before a Fresnel term and a spectrum.

use super::sampling::{Mixture, Proposal};
use super::scatter::Scatter;
use super::shape::{Shape, WardForm};
use super::{
    ComplexIndex, Distribution, Facets, Fresnel, Lobe, Masking, Material, MaterialError,
    PolarisedPart, cos_difference,
};
use glam::DVec3;
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};

/// A lobe of [`Material::cook_torrance`].
#[derive(Debug, Clone)]
pub struct CookTorranceLobe {
    /// Tilts and, where `grooves` is false, Smith's masking.
    pub lobe: Lobe,
    /// Whether microfacets hide one another as V-shaped grooves do (Cook and Torrance 1982).
    pub grooves: bool,
    /// Share of the microfacets, 0 to 1.
    pub share: f64,
}

/// The lobe of Phong's, Ward's and the ABg model, as numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Gloss {
    /// (n+2)/(2π) cosⁿα.
    Phong {
        /// n, 0 or more.
        exponent: f64,
    },
    /// Ward's model.
    Ward {
        /// Along the tangent.
        alpha_x: f64,
        /// Across the tangent.
        alpha_y: f64,
        /// Denominator of the lobe.
        form: WardForm,
    },
    /// A/(B + x^g).
    Abg {
        /// A, sr⁻¹.
        a_per_sr: f64,
        /// B, above 0.
        b: f64,
        /// g, 0 or more.
        g: f64,
    },
}

/// The numbers of [`Material::maxwell_beard`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaxwellBeard {
    /// B of the first surface, sr⁻¹.
    pub bias_per_sr: f64,
    /// σ, the width of its tilts (tangent).
    pub sigma: f64,
    /// τ of shadowing and obscuration, degrees.
    pub tau_deg: f64,
    /// Ω of shadowing and obscuration, degrees.
    pub omega_deg: f64,
}

/// A lobe of [`Material::composite`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum CompositeLobe {
    /// Microfacets, with their share.
    Facets {
        /// Tilts and masking.
        lobe: Lobe,
        /// Factor on the microfacets: a part of the surface, or more where roughness within roughness sends more light there.
        share: f64,
    },
    /// A/(B + x^g) before the Fresnel term.
    Abg {
        /// A, sr⁻¹.
        a_per_sr: f64,
        /// B, above 0.
        b: f64,
        /// g.
        g: f64,
    },
}

/// Coherent reflection by a surface of [`Material::composite`], like that of a mirror: share · F(θ_d) · exp(−(g cosθ_d)²), in a lobe of Beckmann microfacets that is as narrow as
/// the mirror is flat.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MirrorTerm {
    /// Share of the surface, 0 to 1.
    pub share: f64,
    /// g = 4πσ/λ of the heights' root mean square σ; 0 for a perfect one.
    pub g: f64,
    /// The roughness of the waviness that is left: the lobe's half-width at 1/e is twice that.
    pub alpha: f64,
    /// The wavelength of g, nm: at others it goes as 1/λ. None where it is the same at all.
    pub wavelength_nm: Option<f64>,
}

/// Diffuse light of [`Material::composite`].
#[derive(Debug, Clone, PartialEq)]
pub struct Diffuse {
    /// The hemispherical reflectance at normal incidence.
    pub reflectance: Spectrum<Reflectance>,
    /// p of (cosθ_i cosθ_o)^p; 0 for Lambert's law.
    pub power: f64,
}

#[derive(Debug)]
struct Part {
    shape: Shape,
    fresnel: Fresnel,
    /// Before its weights.
    scale: f64,
}

#[derive(Debug)]
struct Sum {
    parts: Vec<Part>,
}

impl Material {
    /// Lobes of microfacets over one Fresnel term, and Lambert light from below where there is any. The parts add up: nothing is taken from the one by the other.
    ///
    /// # Errors
    /// Shares that exceed 1 together; a sum that reflects more than came up to 60° of incidence.
    pub fn cook_torrance(
        name: impl Into<String>,
        lobes: &[CookTorranceLobe],
        fresnel: &Fresnel,
        diffuse: Option<Spectrum<Reflectance>>,
    ) -> Result<Self, MaterialError> {
        let all: f64 = lobes.iter().map(|lobe| lobe.share).sum();
        let fits = lobes.iter().all(|lobe| (0.0..=1.0).contains(&lobe.share));
        if !(fits && all <= 1.0 + 1e-12) || lobes.is_empty() {
            return Err(parameter("the sum of the lobes' shares", all, "above 0 and at most 1"));
        }
        let part = |lobe: &CookTorranceLobe| Part {
            shape: if lobe.grooves { Shape::Grooves(lobe.lobe) } else { Shape::Facets(lobe.lobe) },
            fresnel: fresnel.clone(),
            scale: lobe.share,
        };
        sum(name.into(), lobes.iter().map(part).collect(), diffuse)
    }

    /// Lobes of microfacets or of the ABg model and a coherent mirror, all behind one Fresnel term of the angle θ_d between light and bisector, and diffuse light. The parts
    /// add up; each is reciprocal.
    ///
    /// # Errors
    /// No part, numbers out of range, a sum that reflects more than came up to 60° of incidence.
    pub fn composite(
        name: impl Into<String>,
        lobes: &[CompositeLobe],
        mirror: Option<MirrorTerm>,
        fresnel: &Fresnel,
        diffuse: Option<Diffuse>,
    ) -> Result<Self, MaterialError> {
        let mut parts = Vec::new();
        for lobe in lobes {
            let (shape, scale) = match *lobe {
                CompositeLobe::Facets { lobe, share } => {
                    within("the share of a lobe", share, 0.0, 10.0)?;
                    (Shape::Facets(lobe), share)
                }
                CompositeLobe::Abg { a_per_sr, b, g } => {
                    within("A", a_per_sr, 0.0, 1e12)?;
                    within("B", b, 1e-15, 1e6)?;
                    within("g", g, 0.1, 10.0)?;
                    (Shape::Abg { a_per_sr, b, g }, 1.0)
                }
            };
            parts.push(Part { shape, fresnel: fresnel.clone(), scale });
        }
        if let Some(MirrorTerm { share, g, alpha, wavelength_nm }) = mirror {
            within("the share of the mirror", share, 0.0, 1.0)?;
            within("g of the mirror", g, 0.0, 1e3)?;
            let lobe = Lobe::isotropic(Distribution::Beckmann, alpha, Masking::Separable)?;
            let fresnel = match wavelength_nm {
                Some(nm) => {
                    within("the wavelength of the mirror's g", nm, 10.0, 1e5)?;
                    fresnel.clone().coherent_at(g, nm)?
                }
                None => fresnel.clone().coherent(g),
            };
            parts.push(Part { shape: Shape::Facets(lobe), fresnel, scale: share });
        }
        if let Some(Diffuse { reflectance, power }) = diffuse {
            within("the power of the diffuse light", power, 0.0, 10.0)?;
            let fresnel = Fresnel::constant(reflectance)?;
            let shape = if power == 0.0 { Shape::Lambert } else { Shape::Falling { power } };
            parts.push(Part { shape, fresnel, scale: 1.0 });
        }
        if parts.is_empty() {
            return Err(parameter("the number of lobes", 0.0, "1 or more, or a diffuse part"));
        }
        sum(name.into(), parts, None)
    }

    /// Phong's, Ward's or the ABg lobe before a reflectance, and Lambert light where there is any.
    ///
    /// # Errors
    /// Numbers out of range; a sum that reflects more than came up to 60° of incidence.
    pub fn glossy(
        name: impl Into<String>,
        gloss: Gloss,
        reflectance: Spectrum<Reflectance>,
        diffuse: Option<Spectrum<Reflectance>>,
    ) -> Result<Self, MaterialError> {
        let shape = match gloss {
            Gloss::Phong { exponent } => {
                within("the exponent", exponent, 0.0, 1e8)?;
                Shape::Phong { exponent }
            }
            Gloss::Ward { alpha_x, alpha_y, form } => {
                within("alpha_x", alpha_x, 1e-5, 2.0)?;
                within("alpha_y", alpha_y, 1e-5, 2.0)?;
                Shape::Ward { alpha_x, alpha_y, form }
            }
            Gloss::Abg { a_per_sr, b, g } => {
                within("A", a_per_sr, 0.0, 1e12)?;
                within("B", b, 1e-15, 1e6)?;
                within("g", g, 0.1, 10.0)?;
                Shape::Abg { a_per_sr, b, g }
            }
        };
        let fresnel = Fresnel::constant(reflectance)?;
        sum(name.into(), vec![Part { shape, fresnel, scale: 1.0 }], diffuse)
    }

    /// The Maxwell–Beard model in the form of the Nonconventional Exploitation Factors database: first surface with R(β)/R(0) of `index`, Lambert light of
    /// reflectance π ρ_D, and light from the volume with ρ_V = `volume`/π.
    ///
    /// # Errors
    /// Numbers out of range; a sum that reflects more than came up to 60° of incidence.
    pub fn maxwell_beard(
        name: impl Into<String>,
        numbers: MaxwellBeard,
        index: &ComplexIndex,
        diffuse: Option<Spectrum<Reflectance>>,
        volume: Option<Spectrum<Reflectance>>,
    ) -> Result<Self, MaterialError> {
        let MaxwellBeard { bias_per_sr, sigma, tau_deg, omega_deg } = numbers;
        within("the bias (sr⁻¹)", bias_per_sr, 0.0, 1e8)?;
        within("sigma", sigma, 1e-5, 10.0)?;
        within("tau (degrees)", tau_deg, 1e-3, 1e6)?;
        within("omega (degrees)", omega_deg, 1e-3, 1e6)?;
        let (fresnel, scale) = Fresnel::conductor(index)?.relative()?;
        let (tau_rad, omega_rad) = (tau_deg.to_radians(), omega_deg.to_radians());
        let shape = Shape::FirstSurface { bias_per_sr, sigma, tau_rad, omega_rad };
        let mut parts = vec![Part { shape, fresnel, scale }];
        if let Some(volume) = volume {
            let fresnel = Fresnel::constant(volume)?;
            parts.push(Part { shape: Shape::Volume, fresnel, scale: 1.0 });
        }
        sum(name.into(), parts, diffuse)
    }
}

fn sum(
    name: String,
    mut parts: Vec<Part>,
    diffuse: Option<Spectrum<Reflectance>>,
) -> Result<Material, MaterialError> {
    if let Some(diffuse) = diffuse {
        let fresnel = Fresnel::constant(diffuse)?;
        parts.push(Part { shape: Shape::Lambert, fresnel, scale: 1.0 });
    }
    let spectra = parts.iter().flat_map(|part| part.fresnel.spectra().to_vec()).collect();
    let share = 1.0 / parts.len() as f64;
    let ways: Vec<(f64, Proposal)> = parts
        .iter()
        .flat_map(|part| part.shape.proposals())
        .map(|(of, way)| (of * share, way))
        .collect();
    Material::of_law(name, spectra, Arc::new(Sum { parts }), Mixture::new(ways), false)
}

impl Scatter for Sum {
    fn add_weights(&self, i: DVec3, o: DVec3, scale: f64, sum: &mut [f64]) {
        let mut rest = sum;
        for part in &self.parts {
            let (own, others) = rest.split_at_mut(part.fresnel.spectra().len());
            rest = others;
            let value = scale * part.scale * part.shape.value(i, o);
            if value != 0.0 {
                part.fresnel.add_weights(cos_difference(i, o), value, own);
            }
        }
    }

    fn is_isotropic(&self) -> bool {
        self.parts.iter().all(|part| part.shape.is_isotropic())
    }

    fn polarised(&self, name: &str) -> Result<PolarisedPart, MaterialError> {
        let mut parts = Vec::new();
        for part in self.parts.iter().filter(|part| !part.shape.is_diffuse()) {
            let Some(fresnel) = part.fresnel.difference()? else {
                return Ok(PolarisedPart::Unknown);
            };
            parts.push(Part { shape: part.shape, fresnel, scale: part.scale });
        }
        if parts.is_empty() {
            return Ok(PolarisedPart::Nothing);
        }
        Ok(PolarisedPart::Of(Box::new(sum(name.to_owned(), parts, None)?)))
    }

    fn facets(&self, nm: &[f64]) -> Facets {
        let glossy = || self.parts.iter().filter(|part| !part.shape.is_diffuse());
        let lobes = glossy().map(|part| (part.shape, part.scale)).collect();
        let mut each = glossy().map(|part| part.fresnel.indices(nm));
        match each.next() {
            None => Facets::None,
            Some(Some(index)) if each.all(|other| other.as_ref() == Some(&index)) => {
                Facets::Of { lobes: Some(lobes), index }
            }
            Some(_) => Facets::Unknown,
        }
    }

    fn describe(&self) -> String {
        let part = |part: &Part| {
            let share = if part.scale < 1.0 {
                format!("{} of ", super::short(part.scale))
            } else {
                String::new()
            };
            format!("{share}{}, {}", part.shape.describe(), part.fresnel.describe())
        };
        self.parts.iter().map(part).collect::<Vec<_>>().join("; ")
    }

    fn lobe_width_rad(&self) -> f64 {
        self.parts.iter().fold(FRAC_PI_2, |least, part| least.min(part.shape.width_rad()))
    }
}

fn within(name: &'static str, value: f64, least: f64, most: f64) -> Result<(), MaterialError> {
    if (least..=most).contains(&value) {
        Ok(())
    } else {
        Err(parameter(name, value, &format!("from {least:e} to {most:e}")))
    }
}

pub(super) fn parameter(name: &'static str, value: f64, expected: &str) -> MaterialError {
    MaterialError::Parameter { name, value, expected: expected.to_owned() }
}
