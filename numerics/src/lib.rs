//! What every room needs once.
//!
//! - [`panels`]: Gauss–Legendre quadrature over panels;
//! - [`progress`]: what long work tells whoever watches it;
//! - [`sphere`]: directions over the whole sphere.

pub mod panels;
pub mod progress;
pub mod sphere;
