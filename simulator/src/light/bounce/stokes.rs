//! Polarisation along light paths: the Stokes vector of each path's light behind an ideal polariser.
//!
//! A path is drawn, weighed and ended by the light without polarisation. Beside it goes, for each node, what polarisation makes of that: from the Sun on the light's Stokes vector over the
//! light that is followed, (1, 0, 0, 0) at first; from the observer on the row that the polariser and all reflections since make of a Stokes vector. Each reflection multiplies by its Mueller matrix over
//! its first element ([`Facets::mueller`]), or by the transposed one.
//!
//! A vector counts from an axis across its ray: S₁ is along it, S₂ at 45° counter-clockwise as who looks at the light sees it. The sign of S₃ is that of 2 Im(E_x E_y*) for fields e^(−iωt).

use super::surfaces::Place;
use crate::surface::{Facets, Material, Mueller};
use glam::DVec3;

/// Facets of a scene's materials, and the polariser before the observer.
#[derive(Debug)]
pub(super) struct Polariser {
    facets: Vec<Facets>,
    /// From the direction perpendicular to the plane of light and observer, counter-clockwise as the observer sees it, radians.
    angle_rad: f64,
}

impl Polariser {
    pub fn new(materials: &[Material], nm: &[f64], angle_rad: f64) -> Self {
        Self { facets: materials.iter().map(|m| m.facets(nm)).collect(), angle_rad }
    }

    /// Returns its axis for light that arrives along `along` from a body that is lit from `light`, unit vectors.
    fn axis(&self, light: DVec3, along: DVec3) -> DVec3 {
        let normal = light.cross(along);
        let normal = match normal.length() > 1e-9 {
            true => normal.normalize(),
            false => along.any_orthonormal_vector(),
        };
        let (sin, cos) = self.angle_rad.sin_cos();
        cos * normal + sin * along.cross(normal)
    }

    /// Vectors of a path that begins at the light (`from_light`), or at the observer in the direction `to` from the body.
    pub fn start(&self, vectors: &mut Vectors, from_light: bool, light: DVec3, to: DVec3) {
        vectors.from_light = from_light;
        vectors.light = light;
        let first = if from_light { [1.0, 0.0, 0.0, 0.0] } else { [0.5, 0.5, 0.0, 0.0] };
        vectors.axis = match from_light {
            true => light.any_orthonormal_vector(),
            false => self.axis(light, to),
        };
        vectors.each.fill(first);
    }

    /// Takes a path on at a place of a material: `came` is where it came from, `to` where it goes (the place's axes, away from the surface), `factors` what the surface reflects there at each node, sr⁻¹.
    pub fn reflect(
        &self,
        vectors: &mut Vectors,
        (material, place): (usize, &Place),
        [came, to]: [DVec3; 2],
        factors: &[f64],
    ) {
        let facets = &self.facets[material];
        let (from, next) = (place.body(came), place.body(to));
        let across = from.cross(next);
        let across = match across.length() > 1e-12 {
            true => across.normalize(),
            false => from.any_orthonormal_vector(),
        };
        // Light moves along −from when it is followed from its source, along it when from the observer.
        let along = if vectors.from_light { -from } else { from };
        vectors.turn(along, across);
        let sign = if vectors.from_light { 1.0 } else { -1.0 };
        for (node, v) in vectors.each.iter_mut().enumerate() {
            let Mueller { a, g, b, c } = facets.mueller(node, came, to, factors[node]);
            let c = sign * c;
            *v = [v[0] + a * v[1], a * v[0] + g * v[1], b * v[2] - c * v[3], c * v[2] + b * v[3]];
        }
    }

    /// Multiplies light at each node by what passes the polariser, of a path that ends with light along `along` to the observer, or at the light's source.
    pub fn pass(&self, vectors: &mut Vectors, along: DVec3, light: &mut [f64]) {
        if vectors.from_light {
            vectors.turn(along, self.axis(vectors.light, along));
        }
        for (light, v) in light.iter_mut().zip(&vectors.each) {
            *light *= if vectors.from_light { 0.5 * (v[0] + v[1]) } else { v[0] };
        }
    }
}

/// Vectors of one path, one for each node.
#[derive(Debug, Clone, Default)]
pub(super) struct Vectors {
    from_light: bool,
    /// Direction of the light from the body.
    light: DVec3,
    /// The axis that they count from.
    axis: DVec3,
    each: Vec<[f64; 4]>,
}

impl Vectors {
    pub fn new(nodes: usize) -> Self {
        Self { each: vec![[0.0; 4]; nodes], ..Self::default() }
    }

    /// The same as another's, in the room of this one.
    pub fn copy(&mut self, other: &Self) {
        (self.from_light, self.light, self.axis) = (other.from_light, other.light, other.axis);
        self.each.clone_from(&other.each);
    }

    /// Counts from another axis, of light that moves along `along`; both axes are across it.
    fn turn(&mut self, along: DVec3, axis: DVec3) {
        // Of twice the angle between the axes.
        let (x, y) = (self.axis.dot(axis), along.dot(self.axis.cross(axis)));
        let size = (x * x + y * y).max(f64::MIN_POSITIVE);
        let (cos, sin) = ((x * x - y * y) / size, 2.0 * x * y / size);
        for v in &mut self.each {
            (v[1], v[2]) = (cos * v[1] + sin * v[2], cos * v[2] - sin * v[1]);
        }
        self.axis = axis;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::Scene;
    use crate::light::bounce::surfaces::Surfaces;
    use crate::surface::{ComplexIndex, Distribution, Fresnel, Lobe, Masking};
    use crate::target::Target;

    type C = (f64, f64);

    fn mul(a: C, b: C) -> C {
        (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
    }

    fn div(a: C, b: C) -> C {
        let m = b.0 * b.0 + b.1 * b.1;
        ((a.0 * b.0 + a.1 * b.1) / m, (a.1 * b.0 - a.0 * b.1) / m)
    }

    /// r_s and r_p by Snell's complex angle, p = k × s on both rays.
    fn amplitudes(index: C, cos: f64) -> [C; 2] {
        let sin_t = div(((1.0 - cos * cos).sqrt(), 0.0), index);
        let square = mul(sin_t, sin_t);
        let (x, y) = (1.0 - square.0, -square.1);
        let (r, phi) = (x.hypot(y).sqrt(), 0.5 * y.atan2(x));
        let cos_t = (r * phi.cos(), r * phi.sin());
        let ratio = |a: C, b: C| div((a.0 - b.0, a.1 - b.1), (a.0 + b.0, a.1 + b.1));
        let (m, c) = (index, (cos, 0.0));
        [ratio(c, mul(m, cos_t)), ratio(mul(m, c), cos_t)]
    }

    /// A field after a reflection from `i` to `o`.
    fn reflected(field: [C; 3], index: C, i: DVec3, o: DVec3) -> ([C; 3], f64) {
        let s = i.cross(o).normalize();
        let (p_in, p_out) = ((-i).cross(s), o.cross(s));
        let [rs, rp] = amplitudes(index, 0.5 * (i + o).length());
        let dot = |d: DVec3| {
            let d = d.to_array();
            (0..3).fold((0.0, 0.0), |sum, k| (sum.0 + d[k] * field[k].0, sum.1 + d[k] * field[k].1))
        };
        let (a, b) = (mul(rs, dot(s)), mul(rp, dot(p_in)));
        let (s, p) = (s.to_array(), p_out.to_array());
        let size = |c: C| c.0 * c.0 + c.1 * c.1;
        let out = std::array::from_fn(|k| (a.0 * s[k] + b.0 * p[k], a.1 * s[k] + b.1 * p[k]));
        (out, 0.5 * (size(rs) + size(rp)))
    }

    /// Truth: electric fields in space, reflected twice by Fresnel's complex amplitudes, of two polarisations of the light; what an ideal polariser lets through of both. From either end of the path, at
    /// three angles of the polariser and for planes that do not coincide. Tolerance: rounding.
    #[test]
    fn two_reflections_are_those_of_fields() {
        let indices = [(2.9, 3.1), (0.958, 6.69), (1.5, 0.0)];
        let lobe = Lobe::isotropic(Distribution::Ggx, 0.4, Masking::Separable).unwrap();
        let material = |name: &str, (n, k): C| {
            let index = ComplexIndex::new(name, vec![300.0, 1200.0], vec![n; 2], vec![k; 2]);
            let fresnel = match k {
                0.0 => Fresnel::dielectric(n, 300.0, 1200.0).unwrap(),
                _ => Fresnel::conductor(&index.unwrap()).unwrap(),
            };
            Material::microfacet(name, lobe, fresnel)
        };
        let text = "[[part]]\nname = \"floor\"\nshape = \"plate\"\nsize_m = [1, 1]\nmaterial = \"m\"\n\
                    [[part]]\nname = \"wall\"\nshape = \"plate\"\nsize_m = [1, 1]\noffset_m = [0, 0.5, 0.5]\n\
                    euler_zyx_deg = [30, 0, 90]\nmaterial = \"m\"\n\
                    [[material]]\nname = \"m\"\nmodel = \"lambert\"\nreflectance = 0.5\n";
        let scene = Scene::new(&Target::parse("two.toml", text).unwrap()).unwrap();
        let surfaces = Surfaces::new(&scene);
        let mut compared = 0;
        for first in 0..surfaces.list.len() {
            for second in (0..surfaces.list.len()).filter(|k| *k != first) {
                let places = [first, second].map(|k| surfaces.list[k].even(k, [0.3, 0.6]));
                let d = |x, y, z| DVec3::new(x, y, z).normalize();
                let (light, mid, eye) = (d(0.3, -0.5, 0.8), d(0.2, 0.9, 0.4), d(-0.4, -0.7, 0.5));
                for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                    let materials = [a, b].map(|k| material(&format!("m{k}"), indices[k]));
                    for angle in [0.0_f64, 0.7, 2.0] {
                        let polariser = Polariser::new(&materials, &[550.0], angle);
                        let axis = polariser.axis(light, eye);
                        let (x, y) = light.any_orthonormal_pair();
                        let mut truth = 0.0;
                        for e in [x, y] {
                            let field = e.to_array().map(|v| (v, 0.0));
                            let (field, one) = reflected(field, indices[a], light, mid);
                            let (field, two) = reflected(field, indices[b], -mid, eye);
                            let axis = axis.to_array();
                            let (re, im) = (0..3).fold((0.0, 0.0), |sum, k| {
                                (sum.0 + axis[k] * field[k].0, sum.1 + axis[k] * field[k].1)
                            });
                            truth += 0.5 * (re * re + im * im) / (one * two);
                        }
                        let ways = [[light, mid], [-mid, eye]];
                        for from_light in [true, false] {
                            let mut vectors = Vectors::new(1);
                            polariser.start(&mut vectors, from_light, light, eye);
                            for step in 0..2 {
                                let k = if from_light { step } else { 1 - step };
                                let place = &places[k];
                                let [i, o] = ways[k].map(|d| place.local(d));
                                let ways = if from_light { [i, o] } else { [o, i] };
                                let f = materials[k].brdf(550.0, i, o);
                                if i.z > 0.0 && o.z > 0.0 {
                                    polariser.reflect(&mut vectors, (k, place), ways, &[f]);
                                } else {
                                    vectors.each[0] = [f64::NAN; 4];
                                }
                            }
                            let mut found = [1.0];
                            let along = if from_light { eye } else { -light };
                            polariser.pass(&mut vectors, along, &mut found);
                            if found[0].is_finite() {
                                compared += 1;
                                let off = (found[0] - truth).abs();
                                assert!(
                                    off < 1e-5,
                                    "{a} {b} {angle} {from_light}: {found:?} {truth}"
                                );
                            }
                        }
                    }
                }
            }
        }
        assert!(compared >= 18, "{compared}");
    }
}
