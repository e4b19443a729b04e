//! How the direct light changes with attitude, with the directions of Sun and observer, and with roughness.
//!
//! W of a flat facet is A cosθ_i cosθ_o w(ω_i, ω_o), A the area of what is lit and seen of it. The last three factors are differentiated
//! by their formulas, in dual numbers. A changes because shadows move over the facet, and does so at the rate at which their edges sweep
//! over what is open: dA = −Σ ∫ v·n ds over the parts of the shadows' edges that lie within the facet and in no other shadow (Reynolds'
//! transport theorem; v the velocity of the edge, n its normal out of the shadow). An edge's velocity is linear along it, since its ends
//! are points of the body thrown onto the plane: the integral is its value at the middle. So the derivative is exact as the sum is,
//! shadows and silhouettes included, and one sweep over the facets serves any number of parameters. Path tracers that differentiate only
//! what is inside of the edges miss this term altogether.
//!
//! # What is differentiated how
//! - Flat facets of Lambert and microfacet materials, seen from afar: exactly. Hinged parts follow the Sun as they do in the sum, and
//!   what they shade and what shades them with them; at a stop of its range a hinge stands.
//! - Other materials: the factor w by central differences of the sixth order in the two directions, with an error
//!   ([`Evaluator::derivative_errors`]).
//! - Spheres with nothing before them, seen from afar: by the phase angle; closed form (Lambert) or differences of that smooth function,
//!   with an error.
//! - All else (other curved parts, spheres that shade or are shaded, bent triangles, observers at a point): central differences of the
//!   whole sum, with an error; [`Derivation::method`] says so. Where a kink lies within three steps that error is large, and says it.
//!
//! Scenes prepared with a tolerance are summed exactly here: the values are those of tolerance 0.
//!
//! # Where there is no derivative
//! Where a facet turns edge-on, where edges of shadows coincide (the Sun behind the observer; an edge along the light), at a hinge's stop and
//! where the Sun stands on a hinge's axis, W has a kink, and the derivatives on its two sides differ. What comes out there is finite:
//! that of one of the sides, or between them.
//!
//! # Example
//! The box-wing satellite, turned about its three axes:
//!
//! ```
//! use glam::DVec3;
//! use sunglint_simulator::light::{Parameter, Scene, View};
//! use sunglint_simulator::target::Target;
//!
//! let scene = Scene::new(&Target::built_in("box_wing").expect("it is built in"))?;
//! let mut evaluator = scene.evaluator();
//! let (sun, view) = (DVec3::new(0.7, 0.6, 0.25), View::Distant(DVec3::new(0.6, -0.1, 0.3)));
//! let turns = [DVec3::X, DVec3::Y, DVec3::Z].map(Parameter::Attitude);
//!
//! let count = scene.weight_count();
//! let (mut w, mut dw) = (vec![0.0; count], vec![0.0; 3 * count]);
//! evaluator.direct_derivatives(sun, view, &turns, &mut w, &mut dw)?;
//! // What 1 mrad about z changes in the first weight, m² sr⁻¹:
//! let change = 1e-3 * dw[2 * count];
//! # assert!(change.is_finite());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod differences;
mod exposed;
mod facet;
mod flux;
mod rate;
mod sphere;

use super::curved::Light;
use super::evaluate::{COVERING, Direct, DirectionError, Evaluator};
use super::occlude::{Kind, Toward};
use super::scene::Scene;
use super::{View, curved::Round};
use glam::DVec3;
use rate::Rate;

/// Something that W is differentiated by. Vectors are in the body's axes, of any length: the derivative is by the number before them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Parameter {
    /// The body turns about this axis through its origin, right-handed, by the axis' length in radians; Sun and observer stay where they
    /// are in the world.
    Attitude(DVec3),
    /// The Sun moves this way, rad; only what lies across its direction counts. Hinged parts follow.
    Sun(DVec3),
    /// The observer moves this way: rad across the direction of a distant one, m of one at a point.
    Observer(DVec3),
    /// The roughness of a material of microfacets.
    Roughness {
        /// The material's number.
        material: usize,
        /// Which.
        of: Roughness,
    },
}

/// Which roughness.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Roughness {
    /// Both alike: α of an isotropic material.
    Alpha,
    /// α_x, along the tangent.
    Along,
    /// α_y, across it.
    Across,
}

impl Roughness {
    /// Returns the shares of α_x and α_y that change.
    fn share(self) -> [f64; 2] {
        match self {
            Self::Alpha => [1.0, 1.0],
            Self::Along => [1.0, 0.0],
            Self::Across => [0.0, 1.0],
        }
    }
}

/// How derivatives were found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// By formulas of all facets and spheres.
    Forward,
    /// By differences of the whole sum.
    Differences,
}

/// Report of a differentiation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Derivation {
    /// How the derivatives were found.
    pub method: Method,
    /// Report of the sum itself.
    pub direct: Direct,
    /// Parts of shadows' edges that were integrated over.
    pub edges: usize,
}

/// Why nothing was differentiated.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DerivativeError {
    /// Fault of a direction, as in the sum itself.
    #[error(transparent)]
    Direction(#[from] DirectionError),
    /// Room for another number of derivatives.
    #[error(
        "room for {found} derivatives, expected {expected}: as many as there are weights, for each parameter"
    )]
    Room {
        /// Given value.
        found: usize,
        /// Required number.
        expected: usize,
    },
    /// A vector that is none.
    #[error("parameter {parameter} is a vector of ({}, {}, {}), expected finite numbers", value.x, value.y, value.z)]
    NotFinite {
        /// Number of the parameter, from 0.
        parameter: usize,
        /// Given value.
        value: DVec3,
    },
    /// A material that is not there.
    #[error("parameter {parameter} names material {material}, there are {count}")]
    Missing {
        /// Number of the parameter, from 0.
        parameter: usize,
        /// Number of the material that it names.
        material: usize,
        /// How many there are.
        count: usize,
    },
    /// A material without microfacets.
    #[error(
        "parameter {parameter} is the roughness of material {material}, which is no material of microfacets alone: its derivative is not known"
    )]
    NoRoughness {
        /// Number of the parameter, from 0.
        parameter: usize,
        /// Number of the material that it names.
        material: usize,
    },
}

/// Buffers.
#[derive(Debug, Default)]
pub(super) struct Room {
    rates: Vec<Rate>,
    errors: Vec<f64>,
    /// How far the weights' sum may be off, m² sr⁻¹.
    value_error: f64,
    flux: flux::Flux,
    edges: usize,
}

/// Something in the scene for which there are no formulas.
#[derive(Debug)]
struct Unknown;

impl Evaluator<'_> {
    /// Computes the weights of [`Evaluator::direct`], and sets `derivatives[p * weight_count + k]` to ∂W_k/∂p \[m² sr⁻¹ per unit of the parameter\].
    ///
    /// # Errors
    /// The errors of [`Evaluator::direct`]; a vector that is not finite, a material that is not there or has no roughness.
    pub fn direct_derivatives(
        &mut self,
        sun_body: DVec3,
        view: View,
        parameters: &[Parameter],
        values: &mut [f64],
        derivatives: &mut [f64],
    ) -> Result<Derivation, DerivativeError> {
        self.check(values, self.scene.weight_count())?;
        let (found, expected) = (derivatives.len(), parameters.len() * values.len());
        if found != expected {
            return Err(DerivativeError::Room { found, expected });
        }
        for (p, parameter) in parameters.iter().enumerate() {
            rate::check(self.scene, p, parameter)?;
        }
        let (sun, eye) = self.aim(sun_body, sun_body, view)?;
        if let Some(direct) = self.forward(Light { sun, eye }, parameters, values, derivatives) {
            let edges = self.rates.edges;
            return Ok(Derivation { method: Method::Forward, direct, edges });
        }
        let direct = self.by_differences(sun, view, parameters, values, derivatives)?;
        Ok(Derivation { method: Method::Differences, direct, edges: 0 })
    }

    /// For each parameter of the last call how far Σ_k |∂W_k/∂p| may be off \[m² sr⁻¹ per unit of the parameter\]: of differences, and
    /// rounding.
    pub fn derivative_errors(&self) -> &[f64] {
        &self.rates.errors
    }

    /// All by formulas; `None` where there are none.
    fn forward(
        &mut self,
        light: Light,
        parameters: &[Parameter],
        values: &mut [f64],
        derivatives: &mut [f64],
    ) -> Option<Direct> {
        let (scene, Toward::Far(eye)) = (self.scene, light.eye) else { return None };
        if !scene.patches.is_empty() || !scene.rounds.iter().all(is_sphere) {
            return None;
        }
        values.fill(0.0);
        derivatives.fill(0.0);
        self.work.done = Direct::default();
        self.sort(light.sun, light.eye);
        let mut room = std::mem::take(&mut self.rates);
        room.start(scene, light.sun, eye, parameters);
        let mut all = || -> Result<(), Unknown> {
            for facet in 0..scene.facets.len() {
                self.facet_slopes(facet, light.sun, eye, &mut room, values, derivatives)?;
            }
            (0..scene.rounds.len()).try_for_each(|round| {
                self.sphere_slopes(round, light, &mut room, values, derivatives)
            })
        };
        let known = all().is_ok();
        let total: f64 = values.iter().sum();
        if total > 0.0 {
            self.work.done.error = room.value_error / total + 1e-15;
        }
        self.rates = room;
        known.then_some(self.work.done)
    }

    /// Whether a curved part throws one of the shadows that were gathered last.
    fn shaded_by_round(&self) -> bool {
        self.work.casters.iter().any(|(k, _)| {
            matches!(self.scene.occluders[*k as usize].kind, Kind::Sphere | Kind::Outline(_))
        })
    }
}

fn is_sphere(round: &Round) -> bool {
    round.sphere.is_some()
}

impl Room {
    fn start(&mut self, scene: &Scene, sun: DVec3, eye: DVec3, parameters: &[Parameter]) {
        self.rates.clear();
        self.rates.extend(parameters.iter().map(|p| Rate::of(scene, p, sun, eye)));
        self.errors.clear();
        self.errors.resize(parameters.len(), 0.0);
        self.edges = 0;
        self.value_error = if scene.covers {
            let area: f64 = scene.facets.iter().map(|f| f.area).sum();
            COVERING * area * std::f64::consts::FRAC_1_PI
        } else {
            0.0
        };
    }
}
