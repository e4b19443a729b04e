//! Numerical methods that several crates need.
//!
//! - [`gauss`]: Gauss–Legendre nodes;
//! - [`least_squares`]: fits by the steps of Levenberg and Marquardt;
//! - [`measured`]: values with their uncertainty, intervals;
//! - [`order`]: medians and quantiles;
//! - [`panels`]: Gauss–Legendre quadrature over panels;
//! - [`progress`]: what long work tells whoever watches it;
//! - [`sphere`]: directions over the whole sphere.

pub mod gauss;
pub mod least_squares;
pub mod measured;
pub mod order;
pub mod panels;
pub mod progress;
pub mod sphere;
