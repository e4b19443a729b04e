//! Questions about a target's parts that arise while a scene is made.

use super::closed;
use crate::target::{Shape, Target};
use glam::DVec3;

/// Half the diagonal of the bounding box, at least 1e-300 m.
pub fn size(target: &Target) -> f64 {
    let (mut low, mut high) = (DVec3::MAX, DVec3::MIN);
    let mut take = |p: DVec3, r: f64| {
        low = low.min(p - r);
        high = high.max(p + r);
    };
    for part in &target.parts {
        match &part.shape {
            Shape::Mesh(mesh) => {
                mesh.vertices.iter().for_each(|v| take(part.placement.point(*v), 0.0));
            }
            Shape::Sphere { radius_m } => take(part.placement.point(DVec3::ZERO), *radius_m),
            Shape::Curved(shape) => {
                let middle = part.placement.point(DVec3::new(0.0, 0.0, shape.middle_m()));
                take(middle, 0.5 * shape.size_m().length());
            }
        }
    }
    // Coordinates far from the origin carry the rounding of that distance.
    let far = low.abs().max(high.abs()).max_element();
    if far.is_finite() { (0.5 * (high - low).length()).max(far).max(1e-300) } else { 1.0 }
}

/// Components, those that are closed within one part before those that only several parts close together.
pub fn components_of_parts(
    places: &[DVec3],
    triangles: &[([u32; 3], usize)],
    tolerance_m: f64,
) -> (Vec<usize>, Vec<bool>) {
    let mut of = vec![usize::MAX; triangles.len()];
    let mut closed = Vec::new();
    let mut take = |members: &[usize], keep_open: bool, of: &mut Vec<usize>| {
        let corners: Vec<[u32; 3]> = members.iter().map(|&t| triangles[t].0).collect();
        let found = closed::components(places, &corners, tolerance_m);
        let mut numbers = vec![usize::MAX; found.closed.len()];
        for (&t, &c) in members.iter().zip(&found.of) {
            let c = c as usize;
            if !found.closed[c] && !keep_open {
                continue;
            }
            if numbers[c] == usize::MAX {
                numbers[c] = closed.len();
                closed.push(found.closed[c]);
            }
            of[t] = numbers[c];
        }
    };
    let mut first = 0;
    // A part's triangles stand together.
    while first < triangles.len() {
        let part = triangles[first].1;
        let end = first + triangles[first..].iter().take_while(|t| t.1 == part).count();
        let members: Vec<usize> = (first..end).collect();
        take(&members, false, &mut of);
        first = end;
    }
    let rest: Vec<usize> = (0..triangles.len()).filter(|&t| of[t] == usize::MAX).collect();
    if !rest.is_empty() {
        take(&rest, true, &mut of);
    }
    (of, closed)
}
