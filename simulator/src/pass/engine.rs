//! STAND-IN until the light engine is merged: spheres in closed form, facets without occlusion.

use crate::target::{Shape, Target};
use glam::DVec3;
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};

pub(super) struct Engine<'a> {
    target: &'a Target,
    first: Vec<usize>,
}

impl<'a> Engine<'a> {
    pub fn new(target: &'a Target) -> Result<Self, String> {
        let mut first = vec![0];
        for m in &target.materials {
            first.push(first[first.len() - 1] + m.spectra().len());
        }
        Ok(Self { target, first })
    }

    pub fn spectra(&self) -> Vec<&'a Spectrum<Reflectance>> {
        self.target.materials.iter().flat_map(|m| m.spectra()).collect()
    }

    pub fn evaluator(&self) -> Evaluator<'_> {
        Evaluator { engine: self }
    }
}

pub(super) struct Evaluator<'a> {
    engine: &'a Engine<'a>,
}

impl Evaluator<'_> {
    pub fn direct(&mut self, sun: DVec3, to: DVec3, out: &mut [f64]) -> Result<(), String> {
        out.fill(0.0);
        let target = self.engine.target;
        let angles = target.hinge_angles_rad(sun);
        for (p, part) in target.parts.iter().enumerate() {
            let first = self.engine.first[part.material];
            let material = &target.materials[part.material];
            match &part.shape {
                Shape::Sphere { radius_m } => {
                    let gamma = sun.angle_between(to);
                    let f = 2.0 / (3.0 * std::f64::consts::PI)
                        * (gamma.sin() + (std::f64::consts::PI - gamma) * gamma.cos());
                    out[first] += radius_m * radius_m * f;
                }
                Shape::Mesh(_) => {
                    let mesh = target.part_mesh(p, &angles);
                    for t in 0..mesh.triangles.len() {
                        let [a, b, c] = mesh.corners(t);
                        let n = (b - a).cross(c - a);
                        let area = 0.5 * n.length();
                        let n = n.normalize();
                        let x = n.any_orthonormal_vector();
                        let y = n.cross(x);
                        let local = |v: DVec3| DVec3::new(v.dot(x), v.dot(y), v.dot(n));
                        let (i, o) = (local(sun), local(to));
                        let end = first + material.spectra().len();
                        material.add_weights(i, o, area * i.z * o.z, &mut out[first..end]);
                    }
                }
            }
        }
        Ok(())
    }
}
