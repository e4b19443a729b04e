//! Triangles of one plane and one side that cover each other: they would reflect twice.

use super::{Bounds, Mesh, area_vector};
use glam::DVec3;

/// All pairs that are near are looked at; with more triangles than this they would take too long.
pub(super) const MOST_TRIANGLES: usize = 20_000;

struct Face {
    triangle: usize,
    corners: [DVec3; 3],
    normal: DVec3,
    area: f64,
    bounds: Bounds,
}

/// Pairs of triangles that face the same way within `tolerance` of one plane and share more than a millionth of the smaller one's area:
/// how many, and of the first of them the later triangle and the earlier. The triangles of `known` (in order), which are there twice, are
/// left out. Nothing for a mesh of more than [`MOST_TRIANGLES`].
pub(super) fn overlaps(
    mesh: &Mesh,
    tolerance: f64,
    known: &[usize],
) -> (usize, Option<(usize, usize)>) {
    if mesh.triangles.len() > MOST_TRIANGLES {
        return (0, None);
    }
    let mut faces: Vec<Face> = mesh
        .faces()
        .enumerate()
        .filter(|(triangle, _)| known.binary_search(triangle).is_err())
        .filter_map(|(triangle, corners)| {
            let vector = area_vector(corners);
            let (area, bounds) = (vector.length(), Bounds::of(corners)?);
            Some(Face { triangle, corners, normal: vector.try_normalize()?, area, bounds })
        })
        .collect();
    let size = Bounds::of(mesh.faces().flatten()).map_or(DVec3::ZERO, |b| b.size_m());
    let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).unwrap_or(0);
    faces.sort_by(|a, b| {
        let order = a.bounds.least[axis].total_cmp(&b.bounds.least[axis]);
        order.then(a.triangle.cmp(&b.triangle))
    });
    // Counted, not kept: of triangles in one place there are half their number's square.
    let (mut count, mut first) = (0, None::<(usize, usize)>);
    for (k, face) in faces.iter().enumerate() {
        let near = faces[k + 1..]
            .iter()
            .take_while(|other| other.bounds.least[axis] < face.bounds.most[axis])
            .filter(|other| overlap(face, other, tolerance));
        for other in near {
            let (a, b) = (face.triangle, other.triangle);
            let pair = (a.max(b), a.min(b));
            count += 1;
            first = Some(first.map_or(pair, |first| first.min(pair)));
        }
    }
    (count, first)
}

fn overlap(a: &Face, b: &Face, tolerance: f64) -> bool {
    let apart = a.bounds.least.cmpgt(b.bounds.most + tolerance).any()
        || b.bounds.least.cmpgt(a.bounds.most + tolerance).any();
    if apart || a.normal.dot(b.normal) < 0.999_999 {
        return false;
    }
    let in_plane = |corner: &DVec3| (*corner - a.corners[0]).dot(a.normal).abs() <= tolerance;
    if !b.corners.iter().all(in_plane) {
        return false;
    }
    // What of b lies on the inner side of each edge of a.
    let mut piece = b.corners.to_vec();
    for k in 0..3 {
        let (from, to) = (a.corners[k], a.corners[(k + 1) % 3]);
        let inward = a.normal.cross(to - from);
        piece = cut(&piece, |p| (p - from).dot(inward));
        if piece.len() < 3 {
            return false;
        }
    }
    let fan = (1..piece.len() - 1).map(|k| area_vector([piece[0], piece[k], piece[k + 1]]));
    fan.sum::<DVec3>().length() > 1e-6 * a.area.min(b.area)
}

/// The part of a convex polygon on which a linear function is not negative.
fn cut(polygon: &[DVec3], side: impl Fn(DVec3) -> f64) -> Vec<DVec3> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (k, &p) in polygon.iter().enumerate() {
        let q = polygon[(k + 1) % polygon.len()];
        let (at_p, at_q) = (side(p), side(q));
        if at_p >= 0.0 {
            kept.push(p);
        }
        if (at_p > 0.0 && at_q < 0.0) || (at_p < 0.0 && at_q > 0.0) {
            kept.push(p + (at_p / (at_p - at_q)) * (q - p));
        }
    }
    kept
}
