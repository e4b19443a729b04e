//! Measured passes fitted by simulated ones, and the attitude of a known shape.
//!
//! - [`solver`]: the fit of measured passes by simulated ones;
//! - [`attitude`]: spin axis, period and phase of a known shape;
//! - [`range`]: how far the lit and seen surface is.

pub mod attitude;
pub mod range;
pub mod solver;
