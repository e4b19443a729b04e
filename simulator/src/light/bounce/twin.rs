//! Bodies whose curved parts are facets: what inter-reflection is found on where a target has cylinders, cones, dishes or bent triangles.

use crate::mesh::Mesh;
use crate::surface::{Material, Width};
use crate::target::{Curved, Shape, Target};
use std::f64::consts::PI;

/// Corners around at least, and at most.
const LEAST_AROUND: u32 = 24;
const MOST_AROUND: u32 = 256;
/// Largest tilt of a facet against the surface it stands for, as a share of the width of the material's lobe.
const TILTED: f64 = 0.15;

/// A target of flat facets (and spheres) that stands for another.
#[derive(Debug, Clone)]
pub struct StandIn {
    /// The same parts, materials and hinges.
    pub target: Target,
    /// Largest relative change of the inter-reflected light by the facets: (δ/w)² with δ the largest angle between a facet and what it stands for
    /// and w the half-width of the material's lobe (1 rad where it has none), at most 1. For [`super::Bounce::with_shape_error`].
    pub error: f64,
}

/// A target for inter-reflection in place of one with cylinders, cones, dishes or bent triangles; `None` where `target` itself will do. Facets have the lateral area
/// of what they stand for: areas and mean shadows of its wall stay what they are.
pub fn stand_in(target: &Target) -> Option<StandIn> {
    let mut twin = target.clone();
    let (mut found, mut error) = (false, 0.0_f64);
    for part in &mut twin.parts {
        let Some(material) = target.materials.get(part.material) else { continue };
        let width = width_rad(material);
        let (mesh, tilt) = match &part.shape {
            Shape::Curved(curved) => facets(curved, width),
            Shape::Mesh(mesh) if !mesh.normals.is_empty() => (mesh.clone().flat(), bend_rad(mesh)),
            _ => continue,
        };
        part.shape = Shape::Mesh(mesh);
        found = true;
        error = error.max((tilt / width).powi(2).min(1.0));
    }
    found.then_some(StandIn { target: twin, error })
}

/// The half-width of what a material sends, radians; next to 0 of a mirror.
fn width_rad(material: &Material) -> f64 {
    match material.width() {
        Width::Even => 1.0,
        Width::Lobe { lobe, .. } => lobe.alpha().0.min(lobe.alpha().1).min(1.0),
        Width::Other(width) => width.clamp(1e-9, 1.0),
        Width::Mirror(_) => 1e-9,
    }
}

/// Facets and their largest tilt, radians.
fn facets(curved: &Curved, width: f64) -> (Mesh, f64) {
    let wanted = (PI / (TILTED * width)).ceil().min(f64::from(MOST_AROUND)) as u32;
    let around = wanted.max(LEAST_AROUND);
    let tilt = PI / f64::from(around);
    let wider = tilt / tilt.sin();
    let scaled = match *curved {
        Curved::Frustum { bottom_radius_m, top_radius_m, height_m } => Curved::Frustum {
            bottom_radius_m: wider * bottom_radius_m,
            top_radius_m: wider * top_radius_m,
            height_m,
        },
        bowl => bowl,
    };
    (scaled.faceted(around, around / 4).flat(), tilt)
}

/// The largest angle between a triangle and the normals at its corners, radians.
fn bend_rad(mesh: &Mesh) -> f64 {
    let bend = |t: usize| {
        let Some(normal) = mesh.normal(t) else { return 0.0 };
        let corners = mesh.triangles[t].iter().filter_map(|k| mesh.normals.get(*k as usize));
        corners
            .filter_map(|n| n.try_normalize())
            .map(|n| n.angle_between(normal))
            .fold(0.0, f64::max)
    };
    // Normals that look to the other side stay flat in the scene as well.
    (0..mesh.triangles.len()).map(bend).filter(|b| *b < 0.5 * PI).fold(0.0, f64::max)
}
