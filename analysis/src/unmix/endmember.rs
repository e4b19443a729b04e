//! The spectrum of a material.

use sunglint_radiometry::spectrum::{Reflectance, Spectrum};

/// A material's spectrum by its name.
#[derive(Debug, Clone, PartialEq)]
pub struct Endmember {
    /// The material's name.
    pub name: String,
    /// Its reflectance.
    pub reflectance: Spectrum<Reflectance>,
}
