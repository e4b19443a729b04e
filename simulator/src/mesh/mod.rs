//! Triangles: read from files, built in, examined.
//!
//! - [`read()`]: OBJ, PLY, STL, glTF, each group by its name;
//! - [`shapes`]: box, plate, sphere, cylinder, cone, prism;
//! - [`Mesh::smoothed`]: normals of the surface that the triangles stand for;
//! - [`faults`]: what is wrong with a mesh, and which of its parts are closed;
//! - [`Mesh`]: what every engine gets.

pub mod faults;
mod gltf;
mod gltf_data;
mod obj;
mod overlap;
mod ply;
pub mod read;
pub mod shapes;
mod smooth;
mod stl;
mod topology;
mod triangulate;
mod weld;

pub use faults::{Component, Fault, Report};
pub use obj::write_obj;
pub use read::{NamedMesh, read};

use glam::{DQuat, DVec3};

/// A surface of flat triangles. Counter-clockwise seen from outside; metres.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Corners, m.
    pub vertices: Vec<DVec3>,
    /// Three corners each, indices into `vertices`.
    pub triangles: Vec<[u32; 3]>,
    /// Unit normals of the surface that the triangles stand for, one for each vertex (0 where it has none there); empty where the
    /// triangles are meant to be flat.
    pub normals: Vec<DVec3>,
}

/// The smallest box along the axes that holds a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// The least coordinates, m.
    pub least: DVec3,
    /// The largest coordinates, m.
    pub most: DVec3,
}

impl Bounds {
    /// Returns the bounding box of points; `None` without any.
    pub fn of(points: impl IntoIterator<Item = DVec3>) -> Option<Self> {
        let mut points = points.into_iter();
        let first = points.next()?;
        let start = Self { least: first, most: first };
        Some(points.fold(start, |b, p| Self { least: b.least.min(p), most: b.most.max(p) }))
    }

    /// Returns the lengths of the box's edges, m.
    pub fn size_m(&self) -> DVec3 {
        self.most - self.least
    }

    /// Returns the middle of the box, m.
    pub fn centre(&self) -> DVec3 {
        0.5 * (self.least + self.most)
    }

    /// Whether another box lies in it.
    pub fn holds(&self, other: &Self) -> bool {
        self.least.cmple(other.least).all() && self.most.cmpge(other.most).all()
    }
}

impl Mesh {
    /// The corners of a triangle.
    pub fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|i| self.vertices[i as usize])
    }

    /// The corners of all triangles, in order.
    pub fn faces(&self) -> impl ExactSizeIterator<Item = [DVec3; 3]> {
        self.triangles.iter().map(|t| t.map(|i| self.vertices[i as usize]))
    }

    /// Half the cross product of a triangle's edges: outward, as long as its area in m².
    pub fn area_vector(&self, triangle: usize) -> DVec3 {
        area_vector(self.corners(triangle))
    }

    /// The outward unit normal of a triangle; `None` where it has no area.
    pub fn normal(&self, triangle: usize) -> Option<DVec3> {
        self.area_vector(triangle).try_normalize()
    }

    /// The smallest box around the triangles; `None` where there are none.
    pub fn bounds(&self) -> Option<Bounds> {
        Bounds::of(self.faces().flatten())
    }

    /// The area of all triangles, m².
    pub fn area_m2(&self) -> f64 {
        self.faces().map(|c| area_vector(c).length()).sum()
    }

    /// The volume inside, m³: negative where the triangles face inwards. It has a meaning only for a closed mesh, for which it does
    /// not depend on the origin (divergence theorem).
    pub fn signed_volume_m3(&self) -> f64 {
        let Some(bounds) = self.bounds() else { return 0.0 };
        // About the middle, so that a body far from the origin keeps its digits.
        let middle = bounds.centre();
        self.faces().map(|c| cone_volume(c, middle)).sum()
    }

    /// The centroid of the surface (each triangle weighs its area), m; `None` where it has no area.
    pub fn centroid(&self) -> Option<DVec3> {
        let bounds = self.bounds()?;
        let middle = bounds.centre();
        let (mut sum, mut area) = (DVec3::ZERO, 0.0);
        for corners in self.faces() {
            let weight = area_vector(corners).length();
            sum += weight * (corners.iter().sum::<DVec3>() / 3.0 - middle);
            area += weight;
        }
        (area > 0.0).then(|| middle + sum / area)
    }

    /// The mesh turned, then moved.
    #[must_use]
    pub fn transformed(&self, rotation: DQuat, offset_m: DVec3) -> Self {
        let vertices = self.vertices.iter().map(|&v| rotation * v + offset_m).collect();
        let normals = self.normals.iter().map(|&n| rotation * n).collect();
        Self { vertices, triangles: self.triangles.clone(), normals }
    }

    /// The mesh made larger by a factor about the origin. A negative factor mirrors: the triangles are turned, so that outside stays
    /// outside.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let vertices = self.vertices.iter().map(|&v| factor * v).collect();
        let mesh = Self { vertices, ..self.clone() };
        if factor < 0.0 { mesh.flipped() } else { mesh }
    }

    /// The mesh with outside and inside exchanged.
    #[must_use]
    pub fn flipped(&self) -> Self {
        let triangles = self.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
        let normals = self.normals.iter().map(|&n| -n).collect();
        Self { vertices: self.vertices.clone(), triangles, normals }
    }

    /// Several meshes in one, in order; corners that coincide stay apart.
    pub fn merged<'a>(meshes: impl IntoIterator<Item = &'a Self>) -> Self {
        let mut all = Self::default();
        for mesh in meshes {
            let first = all.vertices.len() as u32;
            all.vertices.extend(&mesh.vertices);
            if !mesh.normals.is_empty() {
                all.normals.resize(first as usize, DVec3::ZERO);
                all.normals.extend(&mesh.normals);
            }
            all.triangles.extend(mesh.triangles.iter().map(|t| t.map(|i| first + i)));
        }
        if !all.normals.is_empty() {
            all.normals.resize(all.vertices.len(), DVec3::ZERO);
        }
        all
    }

    /// The mesh with corners closer than a tolerance made one (chains of close corners too; the first of them stays), and the
    /// triangles that thereby lose a corner left out, as are normals, which close corners may have had for good reason. On request only:
    /// it changes the shape.
    #[must_use]
    pub fn welded(&self, tolerance_m: f64) -> Self {
        let to = weld::weld(&self.vertices, tolerance_m);
        let mut place = vec![u32::MAX; self.vertices.len()];
        let mut vertices = Vec::new();
        for (i, &vertex) in self.vertices.iter().enumerate() {
            if to[i] as usize == i {
                place[i] = vertices.len() as u32;
                vertices.push(vertex);
            }
        }
        let triangles = self.triangles.iter().map(|t| t.map(|i| place[to[i as usize] as usize]));
        let triangles = triangles.filter(|[a, b, c]| a != b && b != c && c != a).collect();
        Self { vertices, triangles, normals: Vec::new() }
    }

    /// Finds the faults of the mesh, and which of its parts are closed.
    pub fn examine(&self) -> Report {
        Report::of(self)
    }
}

/// Half the cross product of two edges: normal to the triangle, as long as its area.
pub(crate) fn area_vector([a, b, c]: [DVec3; 3]) -> DVec3 {
    0.5 * (b - a).cross(c - a)
}

/// The signed volume of the tetrahedron that a triangle makes with a point.
pub(crate) fn cone_volume([a, b, c]: [DVec3; 3], apex: DVec3) -> f64 {
    (a - apex).dot((b - apex).cross(c - apex)) / 6.0
}
