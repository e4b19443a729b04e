//! Built-in bodies, closed unless faces are left out; counter-clockwise seen from outside.

use super::Mesh;
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// One of the six faces of a box: the axis (0, 1, 2) and the side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Side {
    /// 0 for x, 1 for y, 2 for z.
    pub axis: usize,
    /// Whether it is the face towards the positive end.
    pub positive: bool,
}

impl Side {
    /// All six, in the order `+x −x +y −y +z −z`.
    pub const ALL: [Self; 6] = {
        const fn side(axis: usize, positive: bool) -> Side {
            Side { axis, positive }
        }
        [
            side(0, true),
            side(0, false),
            side(1, true),
            side(1, false),
            side(2, true),
            side(2, false),
        ]
    };

    /// `+x` … `-z`.
    pub fn name(self) -> &'static str {
        ["+x", "-x", "+y", "-y", "+z", "-z"][2 * self.axis + usize::from(!self.positive)]
    }

    /// The face of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|side| side.name() == name)
    }
}

/// How large the facets of a round body are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Faceting {
    /// Corners on the round body, which the facets then lie inside of: its area and volume come out too small.
    #[default]
    Inscribed,
    /// Moved out by one factor, so that the facets have the area of the round surface: for a sphere its whole area, for cylinders
    /// and cones the perimeter of the circle (the sides are 2πr wide).
    SameArea,
}

/// A box about the origin with edges along the axes: two triangles for each face that is asked for.
pub fn cuboid(size_m: DVec3, faces: &[Side]) -> Mesh {
    let mut mesh = Mesh::default();
    for face in faces {
        let mut normal = DVec3::ZERO;
        normal[face.axis] = if face.positive { 1.0 } else { -1.0 };
        let mut first = DVec3::ZERO;
        first[(face.axis + 1) % 3] = 1.0;
        let second = normal.cross(first);
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        let corners = corners.map(|(i, j)| 0.5 * size_m * (normal + i * first + j * second));
        push_fan(&mut mesh, &corners);
    }
    mesh
}

/// A rectangle of no thickness in the xy-plane about the origin. With both sides it is two faces back to back, each seen and lit
/// from its own side only: a sheet that lets no light through.
pub fn plate(size_m: DVec2, front: bool, back: bool) -> Mesh {
    let half = 0.5 * size_m.extend(0.0);
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    let corners = corners.map(|(i, j)| half * DVec3::new(i, j, 0.0));
    let mut mesh = Mesh::default();
    if front {
        push_fan(&mut mesh, &corners);
    }
    if back {
        let [a, b, c, d] = corners;
        push_fan(&mut mesh, &[b, a, d, c]);
    }
    mesh
}

/// A sphere about the origin: an icosahedron whose triangles are split into four `subdivisions` times, 20·4ⁿ triangles.
///
/// The facets differ in area by less than a factor 1.9, and none is a sliver.
pub fn icosphere(radius_m: f64, subdivisions: u32, faceting: Faceting) -> Mesh {
    // The corners of an icosahedron: cyclic permutations of (0, ±1, ±golden ratio).
    let golden = 0.5 * (1.0 + 5.0_f64.sqrt());
    let mut vertices = Vec::new();
    for cycle in 0..3 {
        for (s, t) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            let mut corner = [0.0; 3];
            corner[(cycle + 1) % 3] = s;
            corner[(cycle + 2) % 3] = t * golden;
            vertices.push(DVec3::from_array(corner).normalize());
        }
    }
    // Its faces: the triples of corners that are all neighbours.
    let edge2 = (4.0 / (1.0 + golden * golden)) * (1.0 + 1e-9);
    let near = |a: usize, b: usize| vertices[a].distance_squared(vertices[b]) < edge2;
    let mut triangles = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b) && near(b, c) && near(c, a) {
                    let out = vertices[a].dot(vertices[b].cross(vertices[c])) > 0.0;
                    let (b, c) = if out { (b, c) } else { (c, b) };
                    triangles.push([a as u32, b as u32, c as u32]);
                }
            }
        }
    }
    let mut mesh = Mesh { vertices, triangles, ..Mesh::default() };
    for _ in 0..subdivisions {
        mesh = split_on_unit_sphere(&mesh);
    }
    let factor = match faceting {
        Faceting::Inscribed => 1.0,
        Faceting::SameArea => (4.0 * PI / mesh.area_m2()).sqrt(),
    };
    mesh.scaled(radius_m * factor)
}

/// Every triangle into four, the new corners on the unit sphere.
fn split_on_unit_sphere(mesh: &Mesh) -> Mesh {
    let mut vertices = mesh.vertices.clone();
    let mut middles = std::collections::HashMap::new();
    let mut middle = |a: u32, b: u32| {
        *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
            let sum = mesh.vertices[a as usize] + mesh.vertices[b as usize];
            vertices.push(sum.normalize());
            vertices.len() as u32 - 1
        })
    };
    let mut triangles = Vec::with_capacity(4 * mesh.triangles.len());
    for &[a, b, c] in &mesh.triangles {
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    Mesh { vertices, triangles, ..Mesh::default() }
}

/// Which surfaces of a cylinder, cone or prism are wanted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Walls {
    /// The end at +z.
    pub top: bool,
    /// The end at −z.
    pub bottom: bool,
    /// The sides that are wanted, counted from 0; `None` for all.
    pub sides: Option<Vec<usize>>,
}

impl Default for Walls {
    fn default() -> Self {
        Self { top: true, bottom: true, sides: None }
    }
}

/// A frustum along z about the origin with `facets` flat sides (at least 3): a cylinder where both radii are the same, a cone where
/// one is 0, a prism where the facets are few.
///
/// The radii are those of the corners. Corner 0 stands at azimuth −π/facets, so that side 0 faces +x and side k the azimuth
/// 2πk/facets. The ends are fans about their first corner, so that no corner lies within a face.
pub fn frustum(
    bottom_radius_m: f64,
    top_radius_m: f64,
    height_m: f64,
    facets: usize,
    walls: &Walls,
) -> Mesh {
    let ring = |radius: f64, z: f64| -> Vec<DVec3> {
        let corner = |k: usize| {
            let azimuth = TAU * (k as f64 - 0.5) / facets as f64;
            DVec3::new(radius * azimuth.cos(), radius * azimuth.sin(), z)
        };
        (0..facets).map(corner).collect()
    };
    let low = ring(bottom_radius_m, -0.5 * height_m);
    let high = ring(top_radius_m, 0.5 * height_m);
    let mut mesh = Mesh::default();
    for k in 0..facets {
        if walls.sides.as_ref().is_some_and(|wanted| !wanted.contains(&k)) {
            continue;
        }
        let next = (k + 1) % facets;
        if top_radius_m == 0.0 {
            push_fan(&mut mesh, &[low[k], low[next], high[0]]);
        } else if bottom_radius_m == 0.0 {
            push_fan(&mut mesh, &[low[0], high[next], high[k]]);
        } else {
            push_fan(&mut mesh, &[low[k], low[next], high[next], high[k]]);
        }
    }
    if walls.top && top_radius_m > 0.0 {
        push_fan(&mut mesh, &high);
    }
    if walls.bottom && bottom_radius_m > 0.0 {
        let turned: Vec<DVec3> = low.into_iter().rev().collect();
        push_fan(&mut mesh, &turned);
    }
    mesh
}

/// The radius of the corners of a polygon that stands for a circle.
pub fn corner_radius_m(radius_m: f64, facets: usize, faceting: Faceting) -> f64 {
    let half = PI / facets as f64;
    match faceting {
        Faceting::Inscribed => radius_m,
        Faceting::SameArea => radius_m * half / half.sin(),
    }
}

/// A convex polygon as triangles about its first corner.
fn push_fan(mesh: &mut Mesh, corners: &[DVec3]) {
    let first = mesh.vertices.len() as u32;
    mesh.vertices.extend(corners);
    for k in 1..corners.len() as u32 - 1 {
        mesh.triangles.push([first, first + k, first + k + 1]);
    }
}
