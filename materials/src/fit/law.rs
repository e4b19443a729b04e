//! The laws that are fitted: each a lobe, and a Lambert term where asked for, with parameters whose logarithms are the fit's variables.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_1_PI;
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};
use sunglint_simulator::surface::{
    ComplexIndex, CookTorranceLobe, Distribution, Fresnel, Gloss, Lobe, Masking, Material,
    MaterialError, MaxwellBeard, Shape, WardForm,
};

/// The lobe of a law.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum LobeKind {
    /// None: the Lambert term alone.
    Lambert,
    /// Phong's, modified.
    Phong,
    /// A/(B + x^g).
    Abg,
    /// Ward's, with bounded albedo.
    Ward,
    /// Microfacets (Cook–Torrance) with Beckmann's slopes and Smith's masking.
    Beckmann,
    /// The same with GGX slopes.
    Ggx,
    /// Maxwell and Beard's first surface and volume.
    MaxwellBeard,
}

/// A law.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Law {
    /// Lobe of the law.
    pub lobe: LobeKind,
    /// Different roughnesses along and across the tangent (x).
    pub anisotropic: bool,
    /// Schlick's Fresnel term, of microfacets; else a reflectance that is the same at all angles.
    pub schlick: bool,
    /// Whether Lambert light is added.
    pub diffuse: bool,
}

/// Name of a parameter, and the range in which it may lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Key of the parameter in a material's file.
    pub name: &'static str,
    /// The least value.
    pub least: f64,
    /// The largest value.
    pub most: f64,
}

const fn range(name: &'static str, least: f64, most: f64) -> Range {
    Range { name, least, most }
}

const DIFFUSE: Range = range("diffuse", 1e-9, 1.0);
const REFLECTANCE: Range = range("reflectance", 1e-9, 1.0);
const ALPHA: [f64; 2] = [1e-4, 2.0];

impl Law {
    /// All laws: with and without a Lambert term; anisotropic ones and Schlick's term where asked for, Maxwell and Beard's where an index is known.
    pub fn all(anisotropic: bool, schlick: bool, index: bool) -> Vec<Self> {
        let plain = |lobe, diffuse| Self { lobe, anisotropic: false, schlick: false, diffuse };
        let mut laws = vec![plain(LobeKind::Lambert, true)];
        for diffuse in [false, true] {
            laws.push(plain(LobeKind::Phong, diffuse));
            laws.push(plain(LobeKind::Abg, diffuse));
            for lobe in [LobeKind::Ward, LobeKind::Beckmann, LobeKind::Ggx] {
                for anisotropic in [false, true] {
                    for schlick in [false, true] {
                        laws.push(Self { lobe, anisotropic, schlick, diffuse });
                    }
                }
            }
        }
        laws.retain(|law| {
            let facets = matches!(law.lobe, LobeKind::Beckmann | LobeKind::Ggx);
            (anisotropic || !law.anisotropic) && (!law.schlick || (schlick && facets))
        });
        if index {
            laws.push(plain(LobeKind::MaxwellBeard, true));
        }
        laws
    }

    /// Returns the law's name for people: `ggx_anisotropic_schlick+lambert`.
    pub fn name(&self) -> String {
        let lobe = match self.lobe {
            LobeKind::Lambert => return "lambert".into(),
            LobeKind::Phong => "phong",
            LobeKind::Abg => "abg",
            LobeKind::Ward => "ward",
            LobeKind::Beckmann => "beckmann",
            LobeKind::Ggx => "ggx",
            LobeKind::MaxwellBeard => return "maxwell_beard".into(),
        };
        let anisotropic = if self.anisotropic { "_anisotropic" } else { "" };
        let schlick = if self.schlick { "_schlick" } else { "" };
        let diffuse = if self.diffuse { "+lambert" } else { "" };
        format!("{lobe}{anisotropic}{schlick}{diffuse}")
    }

    /// Returns the law's parameters, the lobe's strength first and the Lambert term last.
    pub fn ranges(&self) -> Vec<Range> {
        let alpha = |name| range(name, ALPHA[0], ALPHA[1]);
        let mut ranges = match self.lobe {
            LobeKind::Lambert => return vec![DIFFUSE],
            LobeKind::Phong => vec![REFLECTANCE, range("exponent", 1e-3, 1e8)],
            LobeKind::Abg => {
                vec![range("a_per_sr", 1e-12, 1e9), range("b", 1e-12, 1e3), range("g", 0.2, 9.0)]
            }
            LobeKind::Ward | LobeKind::Beckmann | LobeKind::Ggx if self.anisotropic => {
                vec![REFLECTANCE, alpha("alpha_x"), alpha("alpha_y")]
            }
            LobeKind::Ward | LobeKind::Beckmann | LobeKind::Ggx => {
                vec![REFLECTANCE, alpha("alpha")]
            }
            LobeKind::MaxwellBeard => vec![
                range("bias_per_sr", 1e-12, 1e6),
                range("sigma", 1e-4, 5.0),
                range("tau_deg", 0.5, 1e3),
                range("omega_deg", 0.5, 1e3),
                range("volume", 1e-9, 1.0),
            ],
        };
        if self.diffuse {
            ranges.push(DIFFUSE);
        }
        ranges
    }

    /// Parameters at which a fit may begin, without strengths (which are then 1).
    pub fn starts(&self) -> Vec<Vec<f64>> {
        let alphas: [f64; 6] = [0.003, 0.01, 0.03, 0.1, 0.25, 0.6];
        let all: Vec<Vec<f64>> = match self.lobe {
            LobeKind::Lambert => return vec![vec![1.0]],
            LobeKind::Phong => {
                [0.5, 3.0, 20.0, 100.0, 1e3, 1e4, 1e5].iter().map(|n| vec![1.0, *n]).collect()
            }
            LobeKind::Abg => {
                let mut all = Vec::new();
                for b in [1e-8, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0] {
                    all.extend([1.2, 2.0, 3.0].map(|g| vec![1.0, b, g]));
                }
                all
            }
            _ if self.anisotropic => {
                let mut all = Vec::new();
                for x in alphas {
                    all.extend([0.3, 0.8, 1.25, 3.0].map(|r: f64| vec![1.0, x, (x * r).min(1.9)]));
                }
                all
            }
            LobeKind::MaxwellBeard => {
                let mut all = Vec::new();
                for sigma in [0.003, 0.01, 0.03, 0.1, 0.3, 1.0] {
                    for (tau, omega) in [(20.0, 20.0), (10.0, 60.0), (60.0, 10.0)] {
                        all.push(vec![1.0, sigma, tau, omega, 1e-3]);
                    }
                }
                all
            }
            _ => alphas.iter().map(|a| vec![1.0, *a]).collect(),
        };
        let diffuse = |mut p: Vec<f64>| {
            if self.diffuse {
                p.push(1e-3);
            }
            p
        };
        all.into_iter().map(diffuse).collect()
    }

    /// The lobe's shape with its strength, and what Fresnel's term is at normal incidence (before Schlick's rise).
    pub(super) fn shape(&self, p: &[f64]) -> Option<(Shape, f64)> {
        let lobe = |distribution| {
            let (x, y) = if self.anisotropic { (p[1], p[2]) } else { (p[1], p[1]) };
            Lobe::anisotropic(distribution, x, y, Masking::Separable).ok()
        };
        Some(match self.lobe {
            LobeKind::Lambert => return None,
            LobeKind::Phong => (Shape::Phong { exponent: p[1] }, p[0]),
            LobeKind::Abg => (Shape::Abg { a_per_sr: 1.0, b: p[1], g: p[2] }, p[0]),
            LobeKind::Ward => {
                let (alpha_x, alpha_y) = if self.anisotropic { (p[1], p[2]) } else { (p[1], p[1]) };
                (Shape::Ward { alpha_x, alpha_y, form: WardForm::Bounded }, p[0])
            }
            LobeKind::Beckmann => (Shape::Facets(lobe(Distribution::Beckmann)?), p[0]),
            LobeKind::Ggx => (Shape::Facets(lobe(Distribution::Ggx)?), p[0]),
            LobeKind::MaxwellBeard => {
                let (tau_rad, omega_rad) = (p[2].to_radians(), p[3].to_radians());
                (Shape::FirstSurface { bias_per_sr: 1.0, sigma: p[1], tau_rad, omega_rad }, p[0])
            }
        })
    }

    /// The Lambert reflectance and π ρ_V.
    pub(super) fn broad(&self, p: &[f64]) -> (f64, f64) {
        let diffuse = if self.diffuse { p[p.len() - 1] } else { 0.0 };
        let volume = if self.lobe == LobeKind::MaxwellBeard { p[4] } else { 0.0 };
        (diffuse, volume)
    }

    /// The law with these parameters, ready to be asked.
    pub fn with<'a>(&self, p: &[f64], rise: Option<&'a Rise>) -> Evaluated<'a> {
        let (diffuse, volume) = self.broad(p);
        Evaluated { shape: self.shape(p), schlick: self.schlick, diffuse, volume, rise }
    }

    /// The material with these parameters, of one reflectance for all wavelengths.
    ///
    /// # Errors
    /// Parameters that make none: more light than came up to 60° of incidence.
    pub fn material(
        &self,
        name: &str,
        p: &[f64],
        index: Option<&ComplexIndex>,
    ) -> Result<Material, MaterialError> {
        let grey = |value: f64| {
            Ok::<_, MaterialError>(Spectrum::<Reflectance>::constant(value, 300.0, 1240.0)?)
        };
        let (diffuse, volume) = self.broad(p);
        let under = if self.diffuse { Some(grey(diffuse)?) } else { None };
        let pair = if self.anisotropic {
            (p[1], p[2])
        } else {
            (p[p.len().min(2) - 1], p[p.len().min(2) - 1])
        };
        match self.lobe {
            LobeKind::Lambert => Material::lambert(name, grey(diffuse)?),
            LobeKind::Phong => {
                Material::glossy(name, Gloss::Phong { exponent: p[1] }, grey(p[0])?, under)
            }
            LobeKind::Abg => {
                let gloss = Gloss::Abg { a_per_sr: p[0], b: p[1], g: p[2] };
                Material::glossy(name, gloss, grey(1.0)?, under)
            }
            LobeKind::Ward => {
                let gloss =
                    Gloss::Ward { alpha_x: pair.0, alpha_y: pair.1, form: WardForm::Bounded };
                Material::glossy(name, gloss, grey(p[0])?, under)
            }
            LobeKind::Beckmann | LobeKind::Ggx => {
                let kind = match self.lobe {
                    LobeKind::Beckmann => Distribution::Beckmann,
                    _ => Distribution::Ggx,
                };
                let lobe = Lobe::anisotropic(kind, pair.0, pair.1, Masking::Separable)?;
                let fresnel = match self.schlick {
                    true => Fresnel::schlick(grey(p[0])?)?,
                    false => Fresnel::constant(grey(p[0])?)?,
                };
                let lobe = CookTorranceLobe { lobe, grooves: false, share: 1.0 };
                Material::cook_torrance(name, &[lobe], &fresnel, under)
            }
            LobeKind::MaxwellBeard => {
                let numbers =
                    MaxwellBeard { bias_per_sr: p[0], sigma: p[1], tau_deg: p[2], omega_deg: p[3] };
                let Some(index) = index else {
                    return Err(MaterialError::Data {
                        what: "Maxwell and Beard's law".into(),
                        found: "no refractive index".into(),
                        expected: "one: its Fresnel term follows from it".into(),
                    });
                };
                Material::maxwell_beard(name, numbers, index, under, Some(grey(volume)?))
            }
        }
    }
}

/// R(β)/R(0) of a refractive index at one wavelength, by cosβ.
#[derive(Debug, Clone)]
pub struct Rise {
    ratio: Vec<f64>,
}

impl Rise {
    /// Makes the rise from a complex index at a wavelength, vacuum nm.
    ///
    /// # Errors
    /// The errors of [`Fresnel::conductor`].
    pub fn new(index: &ComplexIndex, wavelength_nm: f64) -> Result<Self, MaterialError> {
        const NODES: usize = 1024;
        let fresnel = Fresnel::conductor(index)?;
        let at = |cos: f64| {
            let mut weights = vec![0.0; fresnel.spectra().len()];
            fresnel.add_weights(cos, 1.0, &mut weights);
            fresnel
                .spectra()
                .iter()
                .zip(&weights)
                .map(|(s, w)| s.at(wavelength_nm) * w)
                .sum::<f64>()
        };
        let normal = at(1.0);
        let ratio = (0..=NODES).map(|k| at(k as f64 / NODES as f64) / normal).collect();
        Ok(Self { ratio })
    }

    fn at(&self, cos: f64) -> f64 {
        let x = cos.clamp(0.0, 1.0) * (self.ratio.len() - 1) as f64;
        let k = (x as usize).min(self.ratio.len() - 2);
        let t = x - k as f64;
        self.ratio[k] * (1.0 - t) + self.ratio[k + 1] * t
    }
}

/// A law with its parameters.
#[derive(Debug, Clone, Copy)]
pub struct Evaluated<'a> {
    pub(super) shape: Option<(Shape, f64)>,
    pub(super) schlick: bool,
    pub(super) diffuse: f64,
    pub(super) volume: f64,
    rise: Option<&'a Rise>,
}

impl Evaluated<'_> {
    /// f_r \[sr⁻¹\] of unit vectors above the horizon.
    pub fn brdf(&self, i: DVec3, o: DVec3) -> f64 {
        self.lobe(i, o) + FRAC_1_PI * (self.diffuse + 2.0 * self.volume / (i.z + o.z))
    }

    /// Without the Lambert term and the volume.
    pub(super) fn lobe(&self, i: DVec3, o: DVec3) -> f64 {
        let Some((shape, strength)) = &self.shape else { return 0.0 };
        let value = shape.value(i, o);
        // The angle of incidence on a microfacet.
        let cos = 0.5 * (i + o).length();
        let term = match (self.schlick, self.rise) {
            (true, _) => strength + (1.0 - strength) * (1.0 - cos.min(1.0)).powi(5),
            (false, Some(rise)) if matches!(shape, Shape::FirstSurface { .. }) => {
                strength * rise.at(cos)
            }
            _ => *strength,
        };
        value * term
    }
}
