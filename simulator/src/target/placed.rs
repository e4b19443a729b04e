//! A target as it stands at one moment: hinges turned, parts in the body's axes.

use super::{Shape, Target};
use crate::mesh::shapes::{Faceting, icosphere};
use crate::mesh::{Mesh, write_obj};
use glam::{DQuat, DVec3};

/// Round spheres are written as 20·4⁵ triangles.
const SPHERE_SUBDIVISIONS: u32 = 5;

impl Target {
    /// The angle of each hinge (radians) that turns it to the Sun (unit vector, body axes).
    pub fn hinge_angles_rad(&self, sun_body: DVec3) -> Vec<f64> {
        self.hinges.iter().map(|hinge| hinge.angle_rad(sun_body)).collect()
    }

    /// The turn and the move from a part's axes to the body's, with hinges at these angles (radians; 0 for those that are missing).
    pub fn part_to_body(&self, part: usize, angles_rad: &[f64]) -> (DQuat, DVec3) {
        let part = &self.parts[part];
        let place = part.placement;
        let Some(hinge) = part.hinge else { return (place.rotation, place.offset_m) };
        let angle = angles_rad.get(hinge).copied().unwrap_or(0.0);
        let hinge = &self.hinges[hinge];
        let turn = DQuat::from_axis_angle(hinge.axis, angle);
        (turn * place.rotation, hinge.point(angle, place.offset_m))
    }

    /// The triangles of a part in the body's axes; a round sphere as an inscribed one of 20,480, cylinders, cones and dishes with 256 corners
    /// around and their normals.
    pub fn part_mesh(&self, part: usize, angles_rad: &[f64]) -> Mesh {
        let (rotation, offset) = self.part_to_body(part, angles_rad);
        match &self.parts[part].shape {
            Shape::Mesh(mesh) => mesh.transformed(rotation, offset),
            Shape::Sphere { radius_m } => {
                let mut mesh = icosphere(*radius_m, SPHERE_SUBDIVISIONS, Faceting::Inscribed);
                mesh.normals = mesh.vertices.iter().map(|v| v.normalize()).collect();
                mesh.transformed(rotation, offset)
            }
            Shape::Curved(curved) => curved.mesh().transformed(rotation, offset),
        }
    }

    /// For every part, whether each of its triangles belongs to a closed piece (nothing for what is round). Parts that move
    /// together are looked at as one, since faces of different materials close only with each other.
    pub fn closed_triangles(&self) -> Vec<Vec<bool>> {
        let mut closed: Vec<Vec<bool>> = vec![Vec::new(); self.parts.len()];
        let hinges = (0..self.hinges.len()).map(Some).chain([None]);
        for hinge in hinges {
            let together: Vec<usize> = (0..self.parts.len())
                .filter(|&p| self.parts[p].hinge == hinge)
                .filter(|&p| matches!(self.parts[p].shape, Shape::Mesh(_)))
                .collect();
            let meshes: Vec<Mesh> = together.iter().map(|&p| self.part_mesh(p, &[])).collect();
            let report = Mesh::merged(&meshes).examine();
            let mut first = 0;
            for (&part, mesh) in together.iter().zip(&meshes) {
                let end = first + mesh.triangles.len();
                closed[part] = (first..end).map(|t| report.closed(t)).collect();
                first = end;
            }
        }
        closed
    }

    /// All parts as one OBJ in the body's axes, metres: a group for each part with its material, hinges at these angles (radians). For
    /// people to look at and for other programs.
    pub fn to_obj(&self, angles_rad: &[f64]) -> String {
        let meshes: Vec<Mesh> =
            (0..self.parts.len()).map(|part| self.part_mesh(part, angles_rad)).collect();
        let mut comment = format!("{}, body axes, metres", self.name);
        for (hinge, angle) in self.hinges.iter().zip(angles_rad) {
            comment += &format!("\nhinge {} at {} deg", hinge.name, angle.to_degrees());
        }
        if self.parts.iter().any(|part| !matches!(part.shape, Shape::Mesh(_))) {
            comment += "\nspheres, cylinders, cones and dishes are round in the target, and inscribed triangles with normals here";
        }
        let pieces = self.parts.iter().zip(&meshes).map(|(part, mesh)| {
            (part.name.as_str(), self.materials[part.material].name.as_str(), mesh)
        });
        write_obj(&comment, pieces)
    }
}
