//! The Sun's disc: limb-darkened, tinted, and averaged over wherever something is as narrow as it is.
//!
//! Under a Sun of angular radius δ (0.27°) a facet's answer is the average of f·cosθ_i·(lit) over the disc. For most facets the
//! direction to its middle does; not for lobes that are not much wider than the disc, flat mirrors (R ℓ/(π sin²δ) within the Sun's image, with
//! ℓ the brightness of [`profile`], and 0 beyond), facets whose horizon the Sun crosses, spheres near a phase of 180°, and where
//! the Earth hides a part of it.
//!
//! - [`profile`]: the law of limb darkening as a sum over fixed profiles p_j(μ) times functions L_j(λ);
//! - `cut`: what a horizon or the Earth leaves of the disc; `rings` and `rays`: averages over that, of what varies slowly and of lobes;
//! - `average`: which of them a material needs, and the average before each profile; `sphere`: the same for spheres;
//! - `light`: the same for all facets and spheres of a scene, with shadows;
//! - [`eclipse`]: what the Earth leaves of each profile's light, for passes that take eclipses as one factor.
//!
//! # Terms
//! W_k before ρ_k(λ) becomes Σ_j L_j(λ) W_kj before ρ_k(λ) L_j(λ), with L_0 = 1: so the first weights of a scene with a disc
//! are those of a scene without, under a grey disc, and what the tint of the limb changes stands behind them ([`Scene::terms`]). Only materials
//! whose answer depends on the tint have such terms: mirrors, narrow lobes, those of flat facets (whose horizon cuts the disc, which leaves more of the limb), and all of them where eclipses are wanted.
//!
//! # Shadows
//! The edges of shadows move over the disc. The lit and seen area is taken towards the place of the disc that the light of the facet comes from on the
//! average (a mirror's image of the observer, the middle for paint) and, where shadows may fall on it, towards four places about that
//! at two standard deviations; what these five disagree about is counted as error.

pub(super) mod average;
pub(super) mod cut;
pub mod eclipse;
mod light;
pub mod profile;
pub(super) mod rays;
pub(super) mod rings;
pub(super) mod sphere;
pub(super) mod sums;

pub use light::Room;

use super::effect::{Source, Term};
use super::scene::{Scene, SceneError, SceneOptions};
use crate::surface::{Material, MaterialError, Width};
use crate::target::{Part, Shape, Target};
use profile::PROFILES;
use std::ops::Range;

/// The Sun's angular radius at 1 au, radians: which materials are narrow.
const USUAL_RADIUS_RAD: f64 = 4.65e-3;

/// How the Sun's disc is modelled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SunOptions {
    /// Relative error at which the average over the disc of a facet is good enough; 1e-5 unless set.
    pub tolerance: f64,
    /// Whether all materials have terms for the tint of a partial eclipse ([`Lighting::earth`](super::Lighting::earth)). Without them
    /// what is missing is counted as error.
    pub eclipse: bool,
}

impl Default for SunOptions {
    fn default() -> Self {
        Self { tolerance: 1e-5, eclipse: false }
    }
}

/// The disc of a scene.
#[derive(Debug, Clone)]
pub struct Sun {
    pub(super) options: SunOptions,
    /// Where each material's tinted weights begin, one block of its spectra for each profile from the second on.
    pub(super) tinted: Vec<Option<usize>>,
    /// How many weights there are.
    pub(super) terms: usize,
    /// The largest |L_j|.
    pub(super) largest: [f64; PROFILES],
}

impl Sun {
    pub(in crate::light) fn new(target: &Target, options: SunOptions) -> Self {
        let mut terms: usize = target.materials.iter().map(|m| m.spectra().len()).sum();
        let tinted = target.materials.iter().enumerate().map(|(number, material)| {
            let flat = |p: &Part| p.material == number && matches!(p.shape, Shape::Mesh(_));
            let horizons = target.parts.iter().any(flat);
            (horizons || is_tinted(material, options)).then(|| {
                let first = terms;
                terms += (PROFILES - 1) * material.spectra().len();
                first
            })
        });
        let tinted = tinted.collect();
        Self { options, tinted, terms, largest: profile::largest_factors() }
    }
}

/// Whether limb darkening tints a material's answer by more than the tolerance.
fn is_tinted(material: &Material, options: SunOptions) -> bool {
    match material.width() {
        _ if options.eclipse => true,
        Width::Even => false,
        Width::Mirror(_) => true,
        // ⟨x²⟩ differs by 0.03 at most between wavelengths; a lobe's relative curvature in half-vectors is 2/α², ten times that in its wings.
        Width::Lobe { lobe, .. } => {
            0.3 * (0.5 * USUAL_RADIUS_RAD / lobe.narrowest()).powi(2) > options.tolerance
        }
        Width::Other(width) => 0.3 * (USUAL_RADIUS_RAD / width).powi(2) > options.tolerance,
    }
}

impl Scene {
    /// Prepares a target for [`Evaluator::light`](super::Evaluator::light) under the Sun's disc: flat mirrors are welcome.
    ///
    /// # Errors
    /// The errors of [`Scene::new`], except for flat mirrors.
    pub fn with_sun(target: &Target, options: SunOptions) -> Result<Self, SceneError> {
        let sun = Some(options);
        Self::with_options(target, SceneOptions { sun, ..SceneOptions::default() })
    }

    /// The same scene under the disc.
    pub(in crate::light) fn under_sun(&mut self, target: &Target, options: SunOptions) {
        self.sun = Some(Sun::new(target, options));
    }

    /// How many weights [`Evaluator::light`](super::Evaluator::light) gives: [`Scene::weight_count`], and what the disc's tint adds.
    pub fn term_count(&self) -> usize {
        self.sun.as_ref().map_or(self.weight_count(), |sun| sun.terms)
    }

    /// The terms before those weights, in their order: first the materials' spectra ρ_k, then of each tinted material ρ_k L_j, by profile.
    ///
    /// # Errors
    /// A spectrum that is none.
    pub fn terms(&self) -> Result<Vec<Term>, MaterialError> {
        let mut terms = Vec::with_capacity(self.term_count());
        for (number, material) in self.materials().iter().enumerate() {
            terms.extend(Term::of_material(Source::Direct, number, material)?);
        }
        let Some(sun) = &self.sun else { return Ok(terms) };
        for (number, material) in self.materials().iter().enumerate() {
            if sun.tinted[number].is_none() {
                continue;
            }
            for profile in 1..PROFILES {
                for rho in material.spectra() {
                    let spectrum =
                        profile::times_factor(rho.wavelength_nm(), rho.value(), profile)?;
                    terms.push(Term { source: Source::Direct, material: Some(number), spectrum });
                }
            }
        }
        Ok(terms)
    }

    /// Where a material's weights before a profile stand among the terms; `None` where it has none.
    pub fn terms_of(&self, material: usize, profile: usize) -> Option<Range<usize>> {
        let grey = self.weights_of(material);
        if profile == 0 {
            return Some(grey);
        }
        let first = self.sun.as_ref()?.tinted[material]?;
        let start = first + (profile - 1) * grey.len();
        (profile < PROFILES).then(|| start..start + grey.len())
    }
}
