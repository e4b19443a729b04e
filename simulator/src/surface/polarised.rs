//! The polarised part of a material's light, as a material of its own.
//!
//! Microfacets and mirrors turn unpolarised light into light that is polarised perpendicular to the plane of incidence, by (R_s − R_p)/(R_s + R_p). For a distant Sun and
//! observer the bisector of the two directions is the same on the whole body, and so are that plane and the angle of incidence on all facets that send light to the
//! observer: half the phase angle. So the polarised light of a body is the light of the same body with (R_s − R_p)/2 in place of (R_s + R_p)/2 in each Fresnel term.
//! Diffuse light has no polarisation left.

use super::conductor::amplitudes;
use super::{Lobe, Material, MaterialError, Model, Shape, cos_difference};
use glam::DVec3;
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

/// How a material's reflection changes Stokes vectors, as far as light between surfaces is followed.
#[derive(Debug, Clone)]
pub(crate) enum Facets {
    /// It is diffuse: no polarisation is left.
    None,
    /// Not known.
    Unknown,
    /// Mirrors of one refractive index, in all directions of lobes or in one (`lobes` is none), over something diffuse or not.
    Of {
        /// Lobes, each with a factor.
        lobes: Option<Vec<(Shape, f64)>>,
        /// n and k at each of the wavelengths asked for.
        index: Vec<[f64; 2]>,
    },
}

/// Mueller matrix of a reflection over its first element, in the axes of the plane of incidence (s, and the cross product of each direction of propagation and s):
/// `[1, a, 0, 0; a, g, 0, 0; 0, 0, b, −c; 0, 0, c, b]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Mueller {
    pub a: f64,
    pub g: f64,
    pub b: f64,
    pub c: f64,
}

impl Mueller {
    /// Part that leaves without polarisation.
    pub const DIFFUSE: Self = Self { a: 0.0, g: 0.0, b: 0.0, c: 0.0 };
}

impl Facets {
    /// The matrix at one of the wavelengths for a reflection of `reflectance` \[sr⁻¹\] from `i` to `o` (surface's axes, away from the surface), of which what a lobe of facets does not explain is diffuse. Of
    /// mirrors the reflectance does not matter.
    pub fn mueller(&self, node: usize, i: DVec3, o: DVec3, reflectance: f64) -> Mueller {
        let Self::Of { lobes, index } = self else { return Mueller::DIFFUSE };
        let [n, k] = index[node];
        let [s, p, re, im] = amplitudes(n, k, cos_difference(i, o));
        let mean = 0.5 * (s + p);
        let of = match lobes {
            None => mean.recip(),
            // What is reflected at all is at least what the facets do; a table between angles may be a millionth less.
            Some(lobes) if reflectance > 0.0 => {
                let own: f64 = lobes.iter().map(|(shape, factor)| factor * shape.value(i, o)).sum();
                own / reflectance.max(own * mean)
            }
            Some(_) => return Mueller::DIFFUSE,
        };
        if !of.is_finite() {
            return Mueller::DIFFUSE;
        }
        Mueller { a: 0.5 * (s - p) * of, g: mean * of, b: re * of, c: im * of }
    }
}

impl Material {
    /// Facets of the material, with their index at some wavelengths (vacuum nm).
    pub(crate) fn facets(&self, nm: &[f64]) -> Facets {
        if self.ageing().is_some() && !matches!(self.model, Model::Lambert) {
            return Facets::Unknown;
        }
        let of = |lobe: Option<Lobe>, fresnel: &super::Fresnel| {
            let lobes = lobe.map(|lobe| vec![(Shape::Facets(lobe), 1.0)]);
            let index = fresnel.indices(nm);
            index.map_or(Facets::Unknown, |index| Facets::Of { lobes, index })
        };
        match &self.model {
            Model::Lambert => Facets::None,
            Model::Mirror { fresnel } => of(None, fresnel),
            Model::Microfacet { lobe, fresnel } | Model::Blend { lobe, fresnel, .. } => {
                of(Some(*lobe), fresnel)
            }
            Model::Law(law) => law.facets(nm),
        }
    }

    /// The polarised part of what this material makes of unpolarised light in one reflection.
    ///
    /// # Errors
    /// A refractive index between whose angles the difference is not smooth.
    pub fn polarised(&self) -> Result<PolarisedPart, MaterialError> {
        let name = self.name.clone();
        if self.ageing().is_some() && !matches!(self.model, Model::Lambert) {
            return Ok(PolarisedPart::Unknown);
        }
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
