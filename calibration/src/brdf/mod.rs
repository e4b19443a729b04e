//! A sample's bidirectional reflectance, from a goniometer: after Dupuy and Jakob (ACM TOG 37, 274, 2018).
//!
//! In the order of the work in the lab, each step a table that the next one reads:
//!
//! - [`table`]: retro-reflection against angle, as the first run leaves it;
//! - [`ndf`]: the density of microfacet normals (NDF), by power iteration, with its uncertainties;
//! - [`plan`]: the directions in which the sample is then measured.

pub mod ndf;
pub mod plan;
pub mod table;
