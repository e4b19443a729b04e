//! The light engine: one weight per material spectrum, from what is lit and seen of a body.
//!
//! I(λ) = E(λ) Σ_k ρ_k(λ) W_k with W_k = Σ_facets A(visible ∩ lit) cosθ_i cosθ_o w_k(ω_i, ω_o) \[m² sr⁻¹\]: physics of one scattering under
//! a collimated Sun (thesis eq. 5.5 and its generalisation). For flat facets, a distant Sun and a distant observer no integral is left but
//! the area of a polygon, and [`Scene`] computes that area exactly, in double precision, by subtraction of convex polygons.
//!
//! A big mesh may be wanted at a tolerance instead ([`Scene::with_tolerance`]): then the facets' sum stays exact, and what share of them is lit and
//! seen is found at points, with an error for each weight ([`Evaluator::errors`]).
//!
//! A target is prepared once ([`Scene::new`]) and evaluated for as many directions as wanted ([`Scene::evaluator`], one for each thread).
//!
//! # What hides what
//! A point of a facet is lit if the open ray from it towards the Sun meets no surface. Closed bodies are met where a ray *leaves* them,
//! whether it started outside or inside: so only surfaces that face the direction count, points buried in another body are dark, and a
//! face in contact with another body is dark too, since the ray leaves that body somewhere. Open sheets hide with both sides and reflect
//! with their front alone. A convex closed body hides by its outline, as one polygon, and never its own facets.
//!
//! # What is curved
//! Spheres, cylinders, cones and dishes stand for themselves (`curved`): normals and outlines are exact, and so is what a surface hides of
//! itself. Where nothing else interferes they are closed forms or integrals to 1e-9; where something does they are divided into cells until
//! [`Scene::CURVED_TOLERANCE`] holds ([`Evaluator::set_curved_tolerance`] changes it). Triangles with normals at their corners are bent
//! surfaces over the same visible and lit polygons. Each says its error.
//!
//! Two rules make touching parts safe. A corner nearer to a facet's plane than [`Scene::TOUCHING`] times the scene's size lies *in* that
//! plane. Coincident faces that look the same way would count twice: there the later part covers the earlier one, found when the scene
//! is prepared, and said in [`SceneReport::warnings`] (not for faces that come to coincide by the turning of a hinge).

pub mod bounce;
mod builder;
mod buried;
mod clip;
mod closed;
mod coincident;
mod curved;
pub mod derivative;
pub mod disc;
pub mod earth;
mod effect;
pub mod engine;
mod evaluate;
mod exposed;
mod faceted;
mod facets;
mod geometry;
mod glint;
mod grid;
mod large;
mod near;
mod occlude;
mod parts;
mod pieces;
mod reflectances;
mod rounded;
mod scene;
pub mod shine;
mod solid;
mod weld;

pub use bounce::Analyser;
pub use derivative::{Derivation, DerivativeError, Method, Parameter, Roughness};
pub use disc::SunOptions;
pub use earth::EarthAlbedo;
pub use effect::{Effect, Globe, Lighting, Need, Source, Stated, Term, Way, concerns, percent};
pub use engine::{Course, Engine, Options};
pub use evaluate::{Direct, DirectionError, Evaluator};
pub use exposed::Exposed;
pub use faceted::{Faceted, FacetedEye, Glint};
pub use large::Sampling;
pub use pieces::Piece;
pub use reflectances::UncoveredError;
pub use scene::{Scene, SceneError, SceneOptions, SceneReport};

use glam::DVec3;

/// Where the observer is, in the body's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum View {
    /// So far away that all lines of sight are parallel: the unit vector towards the observer.
    Distant(DVec3),
    /// At a point, m from the body's origin.
    At(DVec3),
}
