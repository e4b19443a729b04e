//! The bodies of the bench scenes: built-in targets, and two of more than 100,000 triangles.

use crate::mesh::Mesh;
use crate::surface::Material;
use crate::target::{Part, Placement, Shape, Target};
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Domes along each edge of each face of the dense satellite.
const DOMES: u32 = 20;
/// Their radius, m.
const DOME_M: f64 = 0.015;

/// The body of a scene.
pub(super) fn target(name: &str) -> Option<Target> {
    match name {
        "dense_sphere" => {
            let mut target = Target { name: name.into(), ..Target::default() };
            target.materials.push(Material::built_in("unit")?);
            target.parts.push(part("sphere", uv_sphere(225, 256, 1.0), 0));
            Some(target)
        }
        "dense_satellite" => {
            let mut target = Target::built_in("box_wing")?;
            target.name = name.into();
            let white = target.materials.iter().position(|m| m.name == "white")?;
            target.parts.push(part("domes", domes(), white));
            Some(target)
        }
        built_in => Target::built_in(built_in),
    }
}

fn part(name: &str, mesh: Mesh, material: usize) -> Part {
    Part {
        name: name.into(),
        shape: Shape::Mesh(mesh),
        material,
        placement: Placement::default(),
        hinge: None,
        tangent: DVec3::X,
    }
}

/// A sphere about the origin in rings of latitude: `rings` steps from pole to pole, `sides` along each, 2·sides·(rings − 1) triangles.
fn uv_sphere(rings: u32, sides: u32, radius_m: f64) -> Mesh {
    let mut mesh = Mesh::default();
    for ring in 1..rings {
        let polar = PI * f64::from(ring) / f64::from(rings);
        for side in 0..sides {
            let azimuth = TAU * f64::from(side) / f64::from(sides);
            let (sin, cos) = azimuth.sin_cos();
            let place = DVec3::new(polar.sin() * cos, polar.sin() * sin, polar.cos());
            mesh.vertices.push(radius_m * place);
        }
    }
    mesh.vertices.extend([DVec3::Z * radius_m, DVec3::NEG_Z * radius_m]);
    let (top, bottom) = ((rings - 1) * sides, (rings - 1) * sides + 1);
    let at = |ring: u32, side: u32| ring * sides + side % sides;
    for side in 0..sides {
        mesh.triangles.push([top, at(0, side), at(0, side + 1)]);
        mesh.triangles.push([bottom, at(rings - 2, side + 1), at(rings - 2, side)]);
        for ring in 0..rings - 2 {
            let (a, b) = (at(ring, side), at(ring + 1, side));
            let (c, d) = (at(ring + 1, side + 1), at(ring, side + 1));
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

/// Spheres of 48 triangles in a grid on every face of the box of 1 × 1 × 2 m, their middles in the face.
fn domes() -> Mesh {
    let dome = uv_sphere(4, 8, DOME_M);
    let mut mesh = Mesh::default();
    for axis in 0..3 {
        for side in [0.5, -0.5] {
            for i in 0..DOMES {
                for j in 0..DOMES {
                    let along = |k: u32| (f64::from(k) + 0.5) / f64::from(DOMES) - 0.5;
                    let mut middle = DVec3::ZERO;
                    middle[axis] = side;
                    middle[(axis + 1) % 3] = along(i);
                    middle[(axis + 2) % 3] = along(j);
                    middle.z *= 2.0;
                    let first = mesh.vertices.len() as u32;
                    mesh.vertices.extend(dome.vertices.iter().map(|p| *p + middle));
                    mesh.triangles.extend(dome.triangles.iter().map(|t| t.map(|k| k + first)));
                }
            }
        }
    }
    mesh
}
