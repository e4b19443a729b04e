//! How a material reflects.
//!
//! Wavelength and direction are kept apart: f_r(λ; ω_i, ω_o) = Σ_k ρ_k(λ) w_k(ω_i, ω_o), with spectra ρ_k that do not depend on the
//! geometry (all between 0 and 1) and weights w_k in sr⁻¹ that do not depend on the wavelength. So the geometry of a whole
//! body is summed once into one number per k, whatever the number of bins and channels. A Lambert material has one such term, a microfacet
//! material with a measured reflectance one, with Schlick's Fresnel term two; with n + ik the reflectance at a handful of
//! angles of incidence, between which the weights interpolate.
//!
//! - [`microfacet`]: Beckmann and GGX, their masking;
//! - [`fresnel`], [`conductor`]: what each microfacet reflects;
//! - Phong, Ward, ABg, Maxwell–Beard and Cook–Torrance with several lobes ([`Gloss`], [`MaxwellBeard`], [`CookTorranceLobe`]), lobes with a coherent mirror ([`Material::composite`]), foil ([`Material::foil`]);
//! - [`measured`]: `.bsdf` files read and written; [`brdf_table`]: measured tables of directions;
//! - [`mod@file`]: materials as people write them, in TOML; [`built_in`]: those that the program knows.

mod ageing;
mod albedo;
mod blend;
pub mod brdf_table;
pub mod built_in;
mod colour;
pub mod conductor;
mod cubature;
mod curve;
mod doubted;
pub mod file;
mod foil;
pub mod fresnel;
pub mod measured;
pub mod microfacet;
mod momentum;
mod parametric;
mod polarised;
mod real;
mod sampling;
mod scatter;
mod shape;
mod slope;
mod sphere;
mod tensor;
mod width;

pub use ageing::Ageing;
pub use conductor::ComplexIndex;
pub use fresnel::Fresnel;
pub(crate) use microfacet::Masked;
pub use microfacet::{Distribution, Lobe, Masking};
pub use parametric::{CompositeLobe, CookTorranceLobe, Diffuse, Gloss, MaxwellBeard, MirrorTerm};
pub use polarised::PolarisedPart;
pub(crate) use polarised::{Facets, Mueller};
pub use sampling::Sampled;
pub use shape::{Shape, WardForm};
pub(crate) use slope::central;
pub use tensor::warp::{Blend, Grid, Warp};
pub(crate) use width::Width;

use glam::DVec3;
use std::f64::consts::FRAC_1_PI;
use sunglint_radiometry::spectrum::{Reflectance, Spectrum, SpectrumError};

/// A material.
#[derive(Debug, Clone)]
pub struct Material {
    /// Name of the material.
    pub name: String,
    /// The spectra ρ_k.
    spectra: Vec<Spectrum<Reflectance>>,
    model: Model,
    /// How directions are drawn.
    proposals: sampling::Mixture,
    /// The largest albedo, where it was looked for.
    largest: Option<scatter::LargestAlbedo>,
    notes: Vec<String>,
    /// How well f is known, as a file says it.
    stated: Option<scatter::Stated>,
    /// How it has aged.
    ageing: Option<String>,
}

/// Directions to either side in which two materials are compared.
const PROBES: u32 = 8;

/// A wavelength below all others, nm: a spectrum of nothing else covers nothing.
const UNCOVERED_NM: f64 = 1e-3;

/// The spectrum before a weight that only says that a geometry was not measured: it is 0, and at no wavelength covered. A positive weight so makes every integral
/// over wavelength say that it has no data, as for wavelengths beyond a table.
fn uncovered() -> Result<Spectrum<Reflectance>, SpectrumError> {
    Spectrum::constant(0.0, 0.5 * UNCOVERED_NM, UNCOVERED_NM)
}

/// Returns true for the range of the spectrum whose weight says how much of the light comes from geometries that were not measured.
pub(crate) fn is_uncovered((_, to_nm): (f64, f64)) -> bool {
    to_nm <= UNCOVERED_NM
}

#[derive(Debug, Clone)]
enum Model {
    Lambert,
    Mirror {
        fresnel: Fresnel,
    },
    Microfacet {
        lobe: Lobe,
        fresnel: Fresnel,
    },
    Blend {
        lobe: Lobe,
        fresnel: Fresnel,
        base: Box<blend::Base>,
    },
    /// All others.
    Law(std::sync::Arc<dyn scatter::Scatter>),
}

/// Why there is no such material.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MaterialError {
    /// A roughness out of range.
    #[error(
        "the roughness is {alpha}, expected a number from 1e-5 to 2: what is smoother is a mirror"
    )]
    Roughness {
        /// Requested value.
        alpha: f64,
    },
    /// More light than came.
    #[error("the reflectance is {value} at {wavelength_nm} nm, expected a fraction from 0 to 1")]
    Reflectance {
        /// The wavelength.
        wavelength_nm: f64,
        /// The reflectance there.
        value: f64,
    },
    /// A refractive index that no material has.
    #[error("n at row {row} is {n}, expected a number above 0")]
    Index {
        /// Row, counted from 1.
        row: usize,
        /// The index there.
        n: f64,
    },
    /// A reflectance with a kink in angle: total reflection.
    #[error(
        "the reflectance of {name} is not smooth enough in angle for {angles} angles: n < 1 with k near 0 reflects totally, which no metal does"
    )]
    NotSmooth {
        /// Name of the material or quantity.
        name: String,
        /// The number of angles that did not do.
        angles: usize,
    },
    /// An integral over all directions that did not converge.
    #[error(
        "the albedo at {theta_deg}° of incidence is known to {error:.1e} only, expected 1e-5 (of a table: floor_per_sr leaves out values that are the detector's floor)"
    )]
    Albedo {
        /// The angle of incidence.
        theta_deg: f64,
        /// The last change, relative.
        error: f64,
    },
    /// A coat whose albedo is not smooth enough in angle.
    #[error(
        "the coat's albedo between {nodes} angles of incidence is known to {error:.1e} only, expected {expected:.0e}"
    )]
    Coat {
        /// The number of angles.
        nodes: usize,
        /// The error between them.
        error: f64,
        /// Required value.
        expected: f64,
    },
    /// Two reflectances without a common range of wavelengths.
    #[error(
        "the coat is tabulated from {coat_from_nm} to {coat_to_nm} nm and the base from {base_from_nm} to {base_to_nm} nm: they need wavelengths in common"
    )]
    Disjoint {
        /// Where the coat's table begins.
        coat_from_nm: f64,
        /// Where it ends.
        coat_to_nm: f64,
        /// Where the base's table begins.
        base_from_nm: f64,
        /// Where it ends.
        base_to_nm: f64,
    },
    /// A spectrum with a step that no number of wavelengths resolves.
    #[error(
        "the reflectance between {from_nm} and {to_nm} nm is not smooth enough to be linear between {points} wavelengths"
    )]
    Wavelengths {
        /// The wavelength before.
        from_nm: f64,
        /// The wavelength after.
        to_nm: f64,
        /// The number of wavelengths that did not do.
        points: usize,
    },
    /// A phase angle out of range.
    #[error("the phase angle is {phase_rad} rad, expected one from 0 to π")]
    Phase {
        /// Requested value.
        phase_rad: f64,
    },
    /// A material with a tangent where there is none.
    #[error(
        "{name} has different roughnesses along and across its tangent, and a sphere has no tangent: give it one alpha, or use a mesh"
    )]
    Tangent {
        /// The material.
        name: String,
    },
    /// A coat with a tangent.
    #[error(
        "the coat of {name} has different roughnesses along and across its tangent: a blend takes one alpha"
    )]
    CoatTangent {
        /// The material.
        name: String,
    },
    /// A number out of range.
    #[error("{name} is {value}, expected a number {expected}")]
    Parameter {
        /// Which.
        name: &'static str,
        /// Requested value.
        value: f64,
        /// Required value.
        expected: String,
    },
    /// A material that makes light.
    #[error(
        "it reflects {albedo:.4} of the light at {theta_deg}° of incidence and {wavelength_nm} nm: lower its reflectances"
    )]
    Gain {
        /// The angle of incidence.
        theta_deg: f64,
        /// The wavelength.
        wavelength_nm: f64,
        /// The albedo there.
        albedo: f64,
    },
    /// Measured values that cannot be.
    #[error("{found} in {what}, expected {expected}")]
    Data {
        /// Name of the material or quantity.
        what: String,
        /// Value that was found.
        found: String,
        /// Value that was expected.
        expected: String,
    },
    /// Numbers that make no spectrum.
    #[error(transparent)]
    Spectrum(#[from] SpectrumError),
}

impl Material {
    /// A Lambert surface: f_r = ρ(λ)/π.
    ///
    /// # Errors
    /// A reflectance above 1.
    pub fn lambert(
        name: impl Into<String>,
        reflectance: Spectrum<Reflectance>,
    ) -> Result<Self, MaterialError> {
        check_reflectance(&reflectance)?;
        let ways = vec![(1.0, sampling::Proposal::Cosine)];
        Ok(Self::plain(name.into(), vec![reflectance], Model::Lambert, ways))
    }

    /// A perfect mirror, plane but for the shape that it is put on.
    pub fn mirror(name: impl Into<String>, fresnel: Fresnel) -> Self {
        let spectra = fresnel.spectra().to_vec();
        Self::plain(name.into(), spectra, Model::Mirror { fresnel }, vec![])
    }

    /// A rough surface of little mirrors: f_r = F D G/(4 cosθ_i cosθ_o).
    pub fn microfacet(name: impl Into<String>, lobe: Lobe, fresnel: Fresnel) -> Self {
        let spectra = fresnel.spectra().to_vec();
        Self::plain(name.into(), spectra, Model::Microfacet { lobe, fresnel }, lobe.proposals())
    }

    /// A coat of microfacets over a Lambert surface, as paints have it: what the coat does not reflect reaches the base and leaves it again. The sum reflects
    /// no more than came and is reciprocal: f = f_coat + ρ/π (1 − E(θ_i))(1 − E(θ_o))/(1 − E_avg), with E the coat's albedo, from above to 1e-7. Making it takes
    /// some 10 ms (E over all angles).
    ///
    /// # Errors
    /// A base that reflects more than came; a coat with a tangent; tables without common wavelengths.
    pub fn blend(
        name: impl Into<String>,
        reflectance: Spectrum<Reflectance>,
        lobe: Lobe,
        fresnel: Fresnel,
    ) -> Result<Self, MaterialError> {
        let name = name.into();
        check_reflectance(&reflectance)?;
        if !lobe.is_isotropic() {
            return Err(MaterialError::CoatTangent { name });
        }
        let (base, below) = blend::Base::new(&reflectance, &lobe, &fresnel)?;
        let mut spectra = fresnel.spectra().to_vec();
        spectra.extend(below);
        let mut ways = lobe.proposals();
        ways.push((1.0, sampling::Proposal::Cosine));
        let model = Model::Blend { lobe, fresnel, base: Box::new(base) };
        Ok(Self::plain(name, spectra, model, ways))
    }

    fn plain(
        name: String,
        spectra: Vec<Spectrum<Reflectance>>,
        model: Model,
        ways: Vec<(f64, sampling::Proposal)>,
    ) -> Self {
        let proposals = sampling::Mixture::new(ways);
        let (notes, stated, ageing) = (Vec::new(), None, None);
        Self { name, spectra, model, proposals, largest: None, notes, stated, ageing }
    }

    /// The spectra ρ_k: as many as there are weights.
    pub fn spectra(&self) -> &[Spectrum<Reflectance>] {
        &self.spectra
    }

    /// Whether it differs from another of its name at most in its spectra: the weights before these are the same to the last bit, in some pairs of directions.
    pub(crate) fn has_weights_of(&self, other: &Self) -> bool {
        let count = self.spectra.len();
        if self.name != other.name || count != other.spectra.len() {
            return false;
        }
        let direction = |k: u32, turn: f64| {
            let z = (f64::from(k) + 0.5) / f64::from(PROBES);
            let (sin, cos) = (turn * f64::from(k)).sin_cos();
            let across = (1.0 - z * z).sqrt();
            DVec3::new(across * cos, across * sin, z)
        };
        if let (Width::Mirror(own), Width::Mirror(other)) = (self.width(), other.width()) {
            let weights = |of: &Fresnel, k: u32| {
                let mut own = vec![0.0; of.spectra().len()];
                of.add_weights((f64::from(k) + 0.5) / f64::from(PROBES), 1.0, &mut own);
                own
            };
            return (0..PROBES).all(|k| weights(own, k) == weights(other, k));
        }
        // The mirrored direction is among them: narrow lobes are nothing elsewhere.
        (0..PROBES * (PROBES + 1)).all(|k| {
            let i = direction(k % PROBES, 2.4);
            let o = match k / PROBES {
                PROBES => DVec3::new(-i.x, -i.y, i.z),
                other => direction(other, -2.4),
            };
            let mut both = [vec![0.0; count], vec![0.0; count]];
            self.add_weights(i, o, 1.0, &mut both[0]);
            other.add_weights(i, o, 1.0, &mut both[1]);
            both[0] == both[1]
        })
    }

    /// Adds `scale` times the weights w_k \[sr⁻¹\] for light from `i` to `o` to `sum` (one per spectrum). Unit vectors in the surface's
    /// own axes (z the normal, x the tangent), both away from the surface. Nothing is added where either is at or below the horizon,
    /// and nothing of a mirror.
    pub fn add_weights(&self, i: DVec3, o: DVec3, scale: f64, sum: &mut [f64]) {
        if !(i.z > 0.0 && o.z > 0.0) {
            return;
        }
        match &self.model {
            Model::Lambert => sum[0] += scale * FRAC_1_PI,
            Model::Microfacet { lobe, fresnel } => {
                let reflection = scale * lobe.reflection(i, o);
                if reflection != 0.0 {
                    fresnel.add_weights(cos_difference(i, o), reflection, sum);
                }
            }
            Model::Blend { lobe, fresnel, base } => {
                let (coat, below) = sum.split_at_mut(fresnel.spectra().len());
                let reflection = scale * lobe.reflection(i, o);
                if reflection != 0.0 {
                    fresnel.add_weights(cos_difference(i, o), reflection, coat);
                }
                base.add_weights(i.z, o.z, scale, below);
            }
            Model::Mirror { .. } => {}
            Model::Law(law) => {
                let covered = law.add_and_cover(i, o, scale, sum);
                if !covered && let Some(last) = sum.last_mut() {
                    *last += scale;
                }
            }
        }
    }

    /// Prepares a direction that is asked for with many others ([`Material::add_weights_between`]).
    pub(crate) fn masked(&self, v: DVec3) -> Masked {
        match &self.model {
            Model::Microfacet { lobe, .. } | Model::Blend { lobe, .. } if v.z > 0.0 => {
                lobe.masked(v)
            }
            _ => Masked::default(),
        }
    }

    /// [`Material::add_weights`] of two directions that are prepared.
    pub(crate) fn add_weights_between(
        &self,
        i: (DVec3, Masked),
        o: (DVec3, Masked),
        scale: f64,
        sum: &mut [f64],
    ) {
        if !(i.0.z > 0.0 && o.0.z > 0.0) {
            return;
        }
        let (lobe, fresnel, coat) = match &self.model {
            Model::Microfacet { lobe, fresnel } => (lobe, fresnel, sum),
            Model::Blend { lobe, fresnel, base } => {
                let (coat, below) = sum.split_at_mut(fresnel.spectra().len());
                base.add_weights(i.0.z, o.0.z, scale, below);
                (lobe, fresnel, coat)
            }
            _ => return self.add_weights(i.0, o.0, scale, sum),
        };
        let reflection = scale * lobe.reflection_between(i, o);
        if reflection != 0.0 {
            fresnel.add_weights(cos_difference(i.0, o.0), reflection, coat);
        }
    }

    /// f_r \[sr⁻¹\] at a wavelength (vacuum nm); beyond the tables the reflectances are held.
    pub fn brdf(&self, wavelength_nm: f64, i: DVec3, o: DVec3) -> f64 {
        let mut weights = vec![0.0; self.spectra.len()];
        self.add_weights(i, o, 1.0, &mut weights);
        self.times_spectra(wavelength_nm, &weights)
    }

    /// Σ_k ρ_k(λ) W_k.
    pub fn times_spectra(&self, wavelength_nm: f64, weights: &[f64]) -> f64 {
        self.spectra.iter().zip(weights).map(|(rho, w)| rho.at(wavelength_nm) * w).sum()
    }

    /// Whether it is a perfect mirror, whose f_r is no function: its weights are not defined, and only a sphere of it has a
    /// radiant intensity under a point-like Sun.
    pub fn is_mirror(&self) -> bool {
        matches!(self.model, Model::Mirror { .. })
    }

    /// Whether it reflects alike into all directions: no lobe that could be narrow.
    pub fn is_lambert(&self) -> bool {
        matches!(self.model, Model::Lambert)
    }

    /// Whether it reflects the same whatever its tangent.
    pub fn is_isotropic(&self) -> bool {
        match &self.model {
            Model::Microfacet { lobe, .. } => lobe.is_isotropic(),
            Model::Law(law) => law.is_isotropic(),
            _ => true,
        }
    }

    /// The kind and the roughness of its narrowest lobe: the smaller of two roughnesses, 0 for a mirror; `None` where it only diffuses.
    pub fn narrowest_lobe(&self) -> Option<(Distribution, f64)> {
        match &self.model {
            Model::Lambert => None,
            Model::Mirror { .. } => Some((Distribution::Beckmann, 0.0)),
            Model::Microfacet { lobe, .. } | Model::Blend { lobe, .. } => {
                Some((lobe.distribution, lobe.alpha_x.min(lobe.alpha_y)))
            }
            // Half-vectors turn by half of what directions do. What is as wide as that is no lobe.
            Model::Law(law) => Some((Distribution::Beckmann, 0.5 * law.lobe_width_rad()))
                .filter(|(_, alpha)| *alpha < 0.7),
        }
    }

    /// The material in a line, for summaries.
    pub fn describe(&self) -> String {
        let what = match &self.model {
            Model::Lambert => format!("Lambert, reflectance {}", range_of(&self.spectra[0])),
            Model::Mirror { fresnel } => format!("mirror, {}", fresnel.describe()),
            Model::Microfacet { lobe, fresnel } => {
                format!("{}, {}", lobe.describe(), fresnel.describe())
            }
            Model::Blend { lobe, fresnel, .. } => {
                format!("{}, {}, over a Lambert base", lobe.describe(), fresnel.describe())
            }
            Model::Law(law) => law.describe(),
        };
        let aged = self.ageing().map_or(String::new(), |aged| format!("; {aged}"));
        format!("{}: {what}{aged}", self.name)
    }
}

/// The cosine of the angle of incidence on the microfacet that turns `i` into `o`, without cancellation where both graze.
fn cos_difference(i: DVec3, o: DVec3) -> f64 {
    0.5 * (i + o).length()
}

fn check_reflectance(reflectance: &Spectrum<Reflectance>) -> Result<(), MaterialError> {
    match reflectance.value().iter().position(|v| *v > 1.0) {
        Some(row) => Err(MaterialError::Reflectance {
            wavelength_nm: reflectance.wavelength_nm()[row],
            value: reflectance.value()[row],
        }),
        None => Ok(()),
    }
}

/// A parameter to four digits, for people.
fn short(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

/// `0.9`, or `0.05 to 0.85`.
fn range_of(reflectance: &Spectrum<Reflectance>) -> String {
    let (least, most) = reflectance
        .value()
        .iter()
        .fold((f64::INFINITY, 0.0_f64), |(a, b), v| (a.min(*v), b.max(*v)));
    let (least, most) = (short(least), short(most));
    if least == most { format!("{least}") } else { format!("{least} to {most}") }
}
