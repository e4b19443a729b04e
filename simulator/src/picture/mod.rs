//! Pictures of a body, for people: what the light engine sums, shown where it comes from.
//!
//! - [`Picture`]: the body as the observer sees it, orthographic, from the same exact lit and seen polygons that the engine sums. Each polygon
//!   is laid over the pixels by its exact area, so that the sum over the pixels *is* the body's intensity, whatever the size of a pixel.
//! - [`Map`]: the intensity over all directions of the phase vector, in the body's axes (thesis fig. 7.4 and 7.6).
//! - [`Aim`]: what a picture is of: a moment of a pass, or a target alone;
//! - [`Shot`]: the picture of it, with the optics that blur it;
//! - [`ReflectionMaps`], [`spheres`]: what a body sends back, what a sphere reflects.

mod aim;
mod cover;
mod map;
mod maps;
mod render;
mod shot;
pub mod spheres;

pub use aim::{Aim, ModelView, Up};
pub use map::{Map, MapError};
pub use maps::ReflectionMaps;
pub use render::{Camera, Picture, PictureError};
pub use shot::{Blur, Optics, RGB_NM, Shot, ShotOptions, What, arcsec};

use crate::light::{SceneError, UncoveredError};
use crate::pass::PassError;

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ViewError {
    /// A setting that is out of range, or does not go with another.
    #[error("{0}")]
    Setting(String),
    /// Picture that the body, the pass or the tables do not allow.
    #[error("{0}")]
    Impossible(String),
    /// No places of the pass.
    #[error(transparent)]
    Pass(#[from] PassError),
    /// A target that is none.
    #[error("the target {name}")]
    Target {
        /// Name of the target.
        name: String,
        /// Why.
        source: SceneError,
    },
    /// A picture that cannot be made.
    #[error("the picture of {name}")]
    Render {
        /// The target's name.
        name: String,
        /// Why.
        source: PictureError,
    },
    /// A map that cannot be made.
    #[error(transparent)]
    Map(#[from] MapError),
    /// A wavelength without reflectance.
    #[error(transparent)]
    Uncovered(#[from] UncoveredError),
}
