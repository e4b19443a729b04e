//! Pictures of a body, for people: what the light engine sums, shown where it comes from.
//!
//! - [`Picture`]: the body as the observer sees it, orthographic, from the same exact lit and seen polygons that the engine sums. Each polygon
//!   is laid over the pixels by its exact area, so that the sum over the pixels *is* the body's intensity, whatever the size of a pixel.
//! - [`Map`]: the intensity over all directions of the phase vector, in the body's axes (thesis fig. 7.4 and 7.6).

mod cover;
mod map;
mod render;

pub use map::{Map, MapError};
pub use render::{Camera, Picture, PictureError};
