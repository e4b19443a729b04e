//! The spectrum of a material.

use sunglint_radiometry::spectrum::{Reflectance, Spectrum};

/// A material's spectrum by its name.
#[derive(Debug, Clone, PartialEq)]
pub struct Endmember {
    /// The material's name.
    pub name: String,
    /// Reflectance.
    pub reflectance: Spectrum<Reflectance>,
}

/// A material's name as columns of tables have it: letters, digits and `_`.
pub fn column_name(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}
