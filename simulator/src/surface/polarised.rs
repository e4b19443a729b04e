//! The polarised part of a material's light, as a material of its own.
//!
//! Microfacets and mirrors turn unpolarised light into light that is polarised perpendicular to the plane of incidence, by (R_s − R_p)/(R_s + R_p). For a distant Sun and
//! observer the bisector of the two directions is the same on the whole body, and so are that plane and the angle of incidence on all facets that send light to the
//! observer: half the phase angle. So the polarised light of a body is the light of the same body with (R_s − R_p)/2 in place of (R_s + R_p)/2 in each Fresnel term.
//! Diffuse light has no polarisation left.

use super::{Material, MaterialError, Model};
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};

/// The polarised part of a material's light.
#[derive(Debug, Clone)]
pub enum PolarisedPart {
    /// This material's light.
    Of(Box<Material>),
    /// None: it is diffuse.
    Nothing,
    /// Not known: a reflectance without a refractive index, a table.
    Unknown,
}

impl Material {
    /// The polarised part of what this material makes of unpolarised light in one reflection.
    ///
    /// # Errors
    /// A refractive index between whose angles the difference is not smooth.
    pub fn polarised(&self) -> Result<PolarisedPart, MaterialError> {
        let name = self.name.clone();
        let part = |found: Option<Self>| {
            found.map_or(PolarisedPart::Unknown, |found| PolarisedPart::Of(Box::new(found)))
        };
        Ok(match &self.model {
            Model::Lambert => PolarisedPart::Nothing,
            Model::Mirror { fresnel } => {
                part(fresnel.difference()?.map(|fresnel| Self::mirror(name, fresnel)))
            }
            // The base below a coat is diffuse.
            Model::Microfacet { lobe, fresnel } | Model::Blend { lobe, fresnel, .. } => {
                part(fresnel.difference()?.map(|fresnel| Self::microfacet(name, *lobe, fresnel)))
            }
            Model::Law(law) => law.polarised(&name)?,
        })
    }

    /// A material that reflects nothing at any wavelength.
    ///
    /// # Errors
    /// None for the numbers that it has.
    pub fn black(name: &str) -> Result<Self, MaterialError> {
        Self::lambert(name, Spectrum::<Reflectance>::constant(0.0, 10.0, 1e6)?)
    }
}
