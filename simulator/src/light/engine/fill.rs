//! How much of a facet's sky the rest of a body fills.

use crate::light::scene::Scene;
use glam::{DQuat, DVec3};
use std::f64::consts::{FRAC_1_PI, TAU};

/// Points times polygons that are looked at; above it a body that is not convex is taken to fill everything.
const MOST: usize = 4_000_000;
/// Angles of hinges that are looked at.
const ANGLES: usize = 12;

/// The largest fraction of a facet's hemisphere, weighted with the cosine, that the other surfaces can fill: 0 for a convex body. What hides
/// what is not looked at, so that the true fraction is no larger; points are the corners of the facets, their middles and those of their
/// edges, where it is largest.
pub(super) fn largest(scene: &Scene) -> f64 {
    if scene.report().no_occlusion {
        return 0.0;
    }
    let facets = scene.facets.len();
    let angles = if scene.hinges.is_empty() { 1 } else { ANGLES };
    let corners: usize = (0..facets).map(|i| scene.outlines.get(i).len()).sum();
    if (2 * corners + facets).saturating_mul(facets) * angles > MOST {
        return 1.0;
    }
    let at = |angle: usize| largest_at(scene, TAU * angle as f64 / angles as f64);
    (0..angles).map(at).fold(0.0, f64::max)
}

/// A facet in its place.
struct Placed {
    corners: Vec<DVec3>,
    middle: DVec3,
    normal: DVec3,
    component: u32,
    convex: bool,
}

fn largest_at(scene: &Scene, angle_rad: f64) -> f64 {
    let placed: Vec<Placed> = (0..scene.facets.len()).map(|i| place(scene, i, angle_rad)).collect();
    let mut most = 0.0_f64;
    for facet in &placed {
        let others: Vec<&Placed> = placed
            .iter()
            .filter(|o| !(facet.convex && o.component == facet.component))
            .filter(|o| {
                let above = |c: &DVec3| (*c - facet.middle).dot(facet.normal) > scene.touching_m;
                o.corners.iter().any(above)
            })
            .collect();
        if others.is_empty() {
            continue;
        }
        let n = facet.corners.len();
        let edges = (0..n).map(|k| 0.5 * (facet.corners[k] + facet.corners[(k + 1) % n]));
        // A little inside, so that no corner of a neighbour is met.
        let points = facet.corners.iter().copied().chain(edges);
        let points = points.map(|p| p + 1e-6 * (facet.middle - p)).chain([facet.middle]);
        for point in points {
            let sum: f64 = others.iter().map(|o| fraction(point, facet.normal, &o.corners)).sum();
            most = most.max(sum);
        }
    }
    most.min(1.0)
}

fn place(scene: &Scene, i: usize, angle_rad: f64) -> Placed {
    let (facet, now) = (&scene.facets[i], &scene.geometry);
    let (rotation, point) = match facet.group {
        0 => (DQuat::IDENTITY, DVec3::ZERO),
        h => {
            let hinge = &scene.hinges[h as usize - 1];
            let angle = match hinge.range_rad {
                Some((least, most)) => least + (most - least) * angle_rad / TAU,
                None => angle_rad,
            };
            (DQuat::from_axis_angle(hinge.axis, angle), hinge.point_m)
        }
    };
    let turned = |p: DVec3| point + rotation * (p - point);
    let corners = scene.outlines.get(i).iter();
    let corner = |p: &[f64; 2]| now.origin[i] + p[0] * now.tangent[i] + p[1] * now.bitangent[i];
    let corners: Vec<DVec3> = corners.map(|p| turned(corner(p))).collect();
    let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
    let normal = rotation * now.normal[i];
    let (component, convex) = (facet.component, facet.convex);
    Placed { corners, middle, normal, component, convex }
}

/// The fraction of the hemisphere about `normal` at a point that a polygon fills, seen from either side (Lambert's formula), after what lies below the
/// horizon is cut off.
fn fraction(point: DVec3, normal: DVec3, corners: &[DVec3]) -> f64 {
    let mut above: Vec<DVec3> = Vec::with_capacity(corners.len() + 1);
    for (k, corner) in corners.iter().enumerate() {
        let (a, b) = (*corner - point, corners[(k + 1) % corners.len()] - point);
        let (za, zb) = (a.dot(normal), b.dot(normal));
        if za >= 0.0 {
            above.push(a);
        }
        if (za > 0.0 && zb < 0.0) || (za < 0.0 && zb > 0.0) {
            above.push(a + za / (za - zb) * (b - a));
        }
    }
    let n = above.len();
    let edge = |k: usize| {
        let (a, b) = (above[k], above[(k + 1) % n]);
        let cross = a.cross(b);
        let sine = cross.length();
        if sine > 0.0 { sine.atan2(a.dot(b)) / sine * cross.dot(normal) } else { 0.0 }
    };
    (0.5 * FRAC_1_PI * (0..n).map(edge).sum::<f64>()).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: from a point on the edge of a wall without end, square to the ground, the wall fills half of the sky (1/2); of a disc of radius R at height h
    /// overhead, R²/(R² + h²) (here a polygon of 720 corners). Tolerance: the size of the wall (1e-4), the polygon (1e-4).
    #[test]
    fn walls_and_ceilings_fill_what_their_formulas_say() {
        let wall = [(-1e4, 0.0), (1e4, 0.0), (1e4, 1e4), (-1e4, 1e4)];
        let wall: Vec<DVec3> = wall.iter().map(|(y, z)| DVec3::new(1e-6, *y, *z)).collect();
        assert!((fraction(DVec3::ZERO, DVec3::Z, &wall) - 0.5).abs() < 1e-4);
        let corner = |k: u32| {
            let (sin, cos) = (TAU * f64::from(k) / 720.0).sin_cos();
            DVec3::new(2.0 * cos, 2.0 * sin, 3.0)
        };
        let disc: Vec<DVec3> = (0..720).map(corner).collect();
        assert!((fraction(DVec3::ZERO, DVec3::Z, &disc) - 4.0 / 13.0).abs() < 1e-4);
        assert_eq!(fraction(DVec3::ZERO, -DVec3::Z, &disc), 0.0);
    }
}
