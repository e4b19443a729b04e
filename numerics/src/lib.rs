//! What every room needs once.
//!
//! - [`panels`]: Gauss–Legendre quadrature over panels;
//! - [`sphere`]: directions over the whole sphere.

pub mod panels;
pub mod sphere;
