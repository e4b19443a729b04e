//! Numerical methods that several crates need.
//!
//! - [`axes`]: a number for each of the two axes of a mount;
//! - [`basis`]: an orthonormal basis that grows column by column;
//! - [`bounded`]: linear least squares with lower and upper bounds;
//! - [`gauss`]: Gauss–Legendre nodes;
//! - [`least_squares`]: fits by the steps of Levenberg and Marquardt;
//! - [`measured`]: values with their uncertainty, intervals;
//! - [`order`]: medians and quantiles;
//! - [`panels`]: Gauss–Legendre quadrature over panels;
//! - [`progress`]: what long work tells whoever watches it;
//! - [`raster`]: pictures of half the size;
//! - [`sphere`]: directions over the whole sphere.

pub mod axes;
pub mod basis;
pub mod bounded;
pub mod gauss;
pub mod least_squares;
pub mod measured;
pub mod order;
pub mod panels;
pub mod progress;
pub mod raster;
pub mod sphere;
