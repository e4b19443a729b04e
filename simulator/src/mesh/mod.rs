//! Triangles: read from files, built in, examined.

use glam::DVec3;

/// A surface of flat triangles. Counter-clockwise seen from outside; metres.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Corners, m.
    pub vertices: Vec<DVec3>,
    /// Three corners each, indices into `vertices`.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// The corners of a triangle.
    pub fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|i| self.vertices[i as usize])
    }
}
