//! How fast a material's reflection changes with direction: what an average over a source of some extent has to resolve.

use super::{Fresnel, Lobe, Material, Model};

/// Angular structure of a material that there is to resolve.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Width<'a> {
    /// Nothing: f is the same in all directions.
    Even,
    /// A lobe, perhaps over something wider.
    Lobe {
        /// The lobe.
        lobe: &'a Lobe,
        /// Whether nothing lies below it.
        alone: bool,
    },
    /// Something of which only the narrowest half-width is known, radians of the outgoing direction.
    Other(f64),
    /// A single direction.
    Mirror(&'a Fresnel),
}

impl Material {
    /// How many of its weights, from the first on, are those of its lobe of microfacets; 0 where it has none.
    pub(crate) fn lobe_weights(&self) -> usize {
        match &self.model {
            Model::Microfacet { fresnel, .. } | Model::Blend { fresnel, .. } => {
                fresnel.spectra().len()
            }
            _ => 0,
        }
    }

    /// The relative error at which an average of it is good enough: 0 of a formula.
    pub(crate) fn grain(&self) -> f64 {
        match &self.model {
            Model::Law(law) => law.grain(),
            _ => 0.0,
        }
    }

    pub(crate) fn width(&self) -> Width<'_> {
        match &self.model {
            Model::Lambert => Width::Even,
            Model::Mirror { fresnel } => Width::Mirror(fresnel),
            Model::Microfacet { lobe, .. } => Width::Lobe { lobe, alone: true },
            Model::Blend { lobe, .. } => Width::Lobe { lobe, alone: false },
            Model::Law(law) => Width::Other(law.lobe_width_rad()),
        }
    }
}
