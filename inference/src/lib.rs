//! Measured passes fitted by simulated ones, and compared with them; the attitude of a known shape.
//!
//! - [`compare`]: a measured pass beside the simulated one;
//! - [`measured`] and [`scene`]: measured curves with their scenes, and scenes in which numbers are set by name;
//! - [`mod@fit`]: measured passes fitted by simulated ones;
//! - [`solver`]: the mathematics of a fit of measured passes by simulated ones;
//! - [`attitude`]: spin axis, period and phase of a known shape;
//! - [`range`]: how far the lit and seen surface is;
//! - [`bisector`]: the way of the bisector of Sun and station along a scene;
//! - [`lit_curve`]: a curve and the light under which it was taken;
//! - [`unmix`]: how much of the light of a curve comes from which material;
//! - [`endmembers`]: the spectra that a curve is made of;
//! - [`map`]: samples of a curve, or all directions, on the body's frame.

pub mod attitude;
pub mod bisector;
pub mod compare;
pub mod endmembers;
pub mod fit;
pub mod lit_curve;
pub mod map;
pub mod measured;
mod progress;
pub mod range;
pub mod scene;
pub mod solver;
pub mod unmix;
