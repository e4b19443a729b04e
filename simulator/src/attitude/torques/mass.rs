//! Mass properties of a closed body of uniform density.

use crate::mesh::Mesh;
use glam::{DMat3, DVec3};

/// Mass properties of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MassProperties {
    /// Enclosed volume, m³.
    pub volume_m3: f64,
    /// Centre of mass, m.
    pub centre_m: DVec3,
    /// Inertia tensor about the centre of mass, kg m².
    pub inertia_kg_m2: DMat3,
}

/// Mass properties of a closed mesh that is filled with `mass_kg` of uniform density: sums over the tetrahedra of its triangles and a point
/// (Blow and Binstock 2004). `None` where it encloses no volume.
pub fn of_mesh(mesh: &Mesh, mass_kg: f64) -> Option<MassProperties> {
    let origin = mesh.bounds()?.centre();
    let (mut volume, mut first, mut second) = (0.0, DVec3::ZERO, DMat3::ZERO);
    let outer = |a: DVec3| DMat3::from_cols(a * a.x, a * a.y, a * a.z);
    for corners in mesh.faces() {
        let [a, b, c] = corners.map(|p| p - origin);
        let six = a.dot(b.cross(c));
        volume += six / 6.0;
        first += six / 24.0 * (a + b + c);
        second += (outer(a) + outer(b) + outer(c) + outer(a + b + c)) * (six / 120.0);
    }
    // Written so that NaN is refused too.
    if volume.is_nan() || volume <= 0.0 {
        return None;
    }
    let middle = first / volume;
    let covariance = second * (1.0 / volume) - outer(middle);
    let trace = covariance.x_axis.x + covariance.y_axis.y + covariance.z_axis.z;
    let inertia_kg_m2 = (DMat3::from_diagonal(DVec3::splat(trace)) - covariance) * mass_kg;
    Some(MassProperties { volume_m3: volume, centre_m: origin + middle, inertia_kg_m2 })
}
