//! Spheres: closed forms where nothing interferes, facets for what is lost where something does.

use glam::DVec3;
use std::collections::HashMap;

/// Times that a facet of the icosahedron is divided in four: 5,120 facets.
const LEVEL: u32 = 4;

/// What the facets leave open of a sphere, of the geometric mean of the whole and of the smaller of its hidden and its remaining part: the
/// error comes from the shadow's edge, whose length grows as the root of a small part's area. Calibrated with straight edges over Lambert
/// spheres, whose remaining part has a closed form (`an_edge_over_a_lambert_sphere` prints how much of it is used).
pub const FACETING: f64 = 2e-3;

/// Triangles of a unit sphere, scaled so that their area is 4π: the mean projected area of a convex body is a quarter of its surface.
pub fn triangles() -> Vec<[DVec3; 3]> {
    let t = 0.5 * (1.0 + 5.0_f64.sqrt());
    let mut points: Vec<DVec3> = [
        [-1.0, t, 0.0],
        [1.0, t, 0.0],
        [-1.0, -t, 0.0],
        [1.0, -t, 0.0],
        [0.0, -1.0, t],
        [0.0, 1.0, t],
        [0.0, -1.0, -t],
        [0.0, 1.0, -t],
        [t, 0.0, -1.0],
        [t, 0.0, 1.0],
        [-t, 0.0, -1.0],
        [-t, 0.0, 1.0],
    ]
    .map(|p| DVec3::from(p).normalize())
    .to_vec();
    let mut faces: Vec<[usize; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..LEVEL {
        let mut middles = HashMap::new();
        let mut finer = Vec::with_capacity(4 * faces.len());
        for [a, b, c] in faces {
            let mut middle = |a: usize, b: usize| {
                *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    points.push((points[a] + points[b]).normalize());
                    points.len() - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        faces = finer;
    }
    let corners: Vec<[DVec3; 3]> = faces.iter().map(|f| f.map(|k| points[k])).collect();
    let area: f64 = corners.iter().map(|[a, b, c]| 0.5 * (*b - *a).cross(*c - *a).length()).sum();
    let scale = (4.0 * std::f64::consts::PI / area).sqrt();
    corners.into_iter().map(|t| t.map(|p| p * scale)).collect()
}
