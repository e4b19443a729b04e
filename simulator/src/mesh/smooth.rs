//! Normals of the smooth surface that triangles stand for.

use super::{Mesh, area_vector, weld};
use glam::DVec3;
use std::collections::HashMap;

impl Mesh {
    /// The mesh with a normal at each corner, made from the triangles around it that lean by no more than `crease_rad` against the
    /// corner's own; corners whose normals differ become vertices of their own. The triangles' weights are those of N. Max (1999, J.
    /// Graphics Tools 4(2)), 1/(length² length²) of the corner's two edges before their cross product: exact for corners on a sphere.
    #[must_use]
    pub fn smoothed(&self, crease_rad: f64) -> Self {
        let place = weld::weld(&self.vertices, 0.0);
        let facets: Vec<Option<DVec3>> =
            self.faces().map(|corners| area_vector(corners).try_normalize()).collect();
        // For each place the triangles that meet there, with the weight times the normal.
        let mut around: Vec<Vec<(usize, DVec3)>> = vec![Vec::new(); self.vertices.len()];
        for (t, corners) in self.faces().enumerate() {
            if facets[t].is_none() {
                continue;
            }
            for k in 0..3 {
                let (a, b) = (corners[(k + 1) % 3] - corners[k], corners[(k + 2) % 3] - corners[k]);
                let weight = a.length_squared() * b.length_squared();
                let at = place[self.triangles[t][k] as usize] as usize;
                around[at].push((t, a.cross(b) / weight));
            }
        }
        let least = crease_rad.clamp(0.0, std::f64::consts::PI).cos() - 1e-12;
        let mut mesh = Self::default();
        let mut known: HashMap<(u32, [u64; 3]), u32> = HashMap::new();
        for (t, corners) in self.triangles.iter().enumerate() {
            let triangle = corners.map(|vertex| {
                let at = place[vertex as usize];
                let normal = facets[t].map_or(DVec3::ZERO, |own| {
                    let near = around[at as usize]
                        .iter()
                        .filter(|(other, _)| facets[*other].is_some_and(|n| n.dot(own) >= least));
                    near.map(|(_, n)| *n).sum::<DVec3>().try_normalize().unwrap_or(own)
                });
                *known.entry((at, normal.to_array().map(f64::to_bits))).or_insert_with(|| {
                    mesh.vertices.push(self.vertices[at as usize]);
                    mesh.normals.push(normal);
                    mesh.vertices.len() as u32 - 1
                })
            });
            mesh.triangles.push(triangle);
        }
        mesh
    }

    /// The mesh without normals: its triangles are flat.
    #[must_use]
    pub fn flat(mut self) -> Self {
        self.normals.clear();
        self
    }

    /// Vertices without a normal get 0, where others have one.
    pub(super) fn complete_normals(&mut self) {
        if !self.normals.is_empty() {
            self.normals.resize(self.vertices.len(), DVec3::ZERO);
        }
    }
}
