//! Measured passes fitted by simulated ones, and compared with them; the attitude of a known shape.
//!
//! - [`compare`]: a measured pass beside the simulated one;
//! - [`measured`] and [`scene`]: measured curves with their scenes, and scenes in which numbers are set by name;
//! - [`mod@fit`]: measured passes fitted by simulated ones;
//! - [`solver`]: the mathematics of a fit of measured passes by simulated ones;
//! - [`attitude`]: spin axis, period and phase of a known shape;
//! - [`range`]: how far the lit and seen surface is.

pub mod attitude;
pub mod compare;
pub mod fit;
pub mod measured;
mod progress;
pub mod range;
pub mod scene;
pub mod solver;
