//! Random scenes of random materials, and their light by a path tracer that shares nothing with the engine.

use glam::{DQuat, DVec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::{FRAC_1_PI, PI, TAU};
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::mesh::shapes::{Side, cuboid};
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};
use sunglint_simulator::target::{Part, Placement, Shape, Target};

/// Depth at which paths end: what is left is below 0.9⁸ of what a wall of a closed room would have, and far less here.
const DEPTH: usize = 8;

pub type Rng = Xoshiro256PlusPlus;

/// What a part is painted with: its reflectance and the roughness of a Beckmann lobe, `None` for a Lambert surface.
#[derive(Debug, Clone, Copy)]
pub struct Paint {
    pub reflectance: f64,
    pub alpha: Option<f64>,
}

/// A scene: a target with the paints of its parts, the directions of Sun and observer, the Sun's angular radius.
pub struct RandomScene {
    pub target: Target,
    pub paints: Vec<Paint>,
    pub sun: DVec3,
    pub to: DVec3,
    pub sun_radius_rad: f64,
}

pub fn direction(rng: &mut Rng) -> DVec3 {
    let z = 2.0 * rng.random::<f64>() - 1.0;
    let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
    let across = (1.0 - z * z).sqrt();
    DVec3::new(across * cos, across * sin, z)
}

/// One to five boxes, turned, perhaps reaching into each other; every third scene with concave bodies; half of the paints diffuse.
pub fn scene(seed: u64) -> RandomScene {
    let mut rng = Rng::seed_from_u64(seed);
    let (mut target, mut paints) = (Target::default(), Vec::new());
    for k in 0..1 + (seed % 5) as usize {
        let size = DVec3::new(rng.random(), rng.random(), rng.random()) + 0.1;
        let mut mesh = cuboid(size, &Side::ALL);
        if seed.is_multiple_of(3) {
            mesh.vertices.iter_mut().filter(|v| v.min_element() > 0.0).for_each(|v| *v *= 0.1);
        }
        let placement = Placement {
            rotation: DQuat::from_axis_angle(direction(&mut rng), rng.random::<f64>() * TAU),
            offset_m: 0.9 * direction(&mut rng) * rng.random::<f64>(),
        };
        let reflectance = 0.05 + 0.85 * rng.random::<f64>();
        let rough = rng.random_bool(0.5).then(|| 0.1 * (6.0_f64).powf(rng.random()));
        let spectrum = Spectrum::constant(reflectance, 300.0, 1240.0).unwrap();
        target.materials.push(match rough {
            None => Material::lambert(format!("m{k}"), spectrum).unwrap(),
            Some(alpha) => {
                let lobe = Lobe::isotropic(Distribution::Beckmann, alpha, Masking::Separable);
                let fresnel = Fresnel::constant(spectrum).unwrap();
                Material::microfacet(format!("m{k}"), lobe.unwrap(), fresnel)
            }
        });
        paints.push(Paint { reflectance, alpha: rough });
        target.parts.push(Part {
            name: format!("p{k}"),
            shape: Shape::Mesh(mesh),
            material: k,
            placement,
            hinge: None,
            tangent: DVec3::X,
        });
    }
    let sun = direction(&mut rng);
    let to = (sun + 1.2 * direction(&mut rng)).normalize();
    RandomScene { target, paints, sun, to, sun_radius_rad: 4.65e-3 }
}

impl Paint {
    /// f_r, sr⁻¹, written out from the paper (Walter et al. 2007): Beckmann's slopes, Smith's masking of each direction.
    fn brdf(self, i: DVec3, o: DVec3, n: DVec3) -> f64 {
        let (ci, co) = (i.dot(n), o.dot(n));
        if ci <= 0.0 || co <= 0.0 {
            return 0.0;
        }
        let Some(alpha) = self.alpha else { return self.reflectance * FRAC_1_PI };
        let ch = (i + o).normalize().dot(n);
        let tan2 = 1.0 / (ch * ch) - 1.0;
        let d = (-tan2 / (alpha * alpha)).exp() / (PI * alpha * alpha * ch.powi(4));
        let masking = |c: f64| {
            let tan = (1.0 / (c * c) - 1.0).max(0.0).sqrt();
            if tan == 0.0 {
                return 1.0;
            }
            let a = 1.0 / (alpha * tan);
            2.0 / (1.0 + libm::erf(a) + (-a * a).exp() / (a * PI.sqrt()))
        };
        self.reflectance * d * masking(ci) * masking(co) / (4.0 * ci * co)
    }
}

struct Triangle {
    a: DVec3,
    ab: DVec3,
    ac: DVec3,
    normal: DVec3,
    part: usize,
}

/// The path tracer: triangles, paints, and the light of a disc.
pub struct Tracer<'a> {
    scene: &'a RandomScene,
    triangles: Vec<Triangle>,
}

impl<'a> Tracer<'a> {
    pub fn new(scene: &'a RandomScene) -> Self {
        let mut triangles = Vec::new();
        for (part, p) in scene.target.parts.iter().enumerate() {
            let Shape::Mesh(mesh) = &p.shape else { continue };
            for t in 0..mesh.triangles.len() {
                let [a, b, c] =
                    mesh.corners(t).map(|v| p.placement.rotation * v + p.placement.offset_m);
                let normal = (b - a).cross(c - a).normalize();
                triangles.push(Triangle { a, ab: b - a, ac: c - a, normal, part });
            }
        }
        Self { scene, triangles }
    }

    /// The nearest triangle along a ray, from beyond a nanometre (Möller and Trumbore 1997).
    fn nearest(&self, from: DVec3, d: DVec3) -> Option<(f64, &Triangle)> {
        let hit = |t: &Triangle| {
            let p = d.cross(t.ac);
            let det = t.ab.dot(p);
            let s = from - t.a;
            let (u, q) = (s.dot(p) / det, s.cross(t.ab));
            let v = d.dot(q) / det;
            let range = t.ac.dot(q) / det;
            (det.abs() > 1e-14 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 && range > 1e-9)
                .then_some(range)
        };
        let hits = self.triangles.iter().filter_map(|t| Some((hit(t)?, t)));
        hits.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// A direction to the Sun's disc, evenly lit.
    fn to_sun(&self, rng: &mut Rng) -> DVec3 {
        let radius = self.scene.sun_radius_rad * rng.random::<f64>().sqrt();
        let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
        let (x, y) = self.scene.sun.any_orthonormal_pair();
        (self.scene.sun + radius * (cos * x + sin * y)).normalize()
    }

    /// Radiance over the Sun's irradiance, sr⁻¹, from a point of a triangle towards `to`.
    fn radiance(&self, at: DVec3, on: &Triangle, to: DVec3, depth: usize, rng: &mut Rng) -> f64 {
        if on.normal.dot(to) <= 0.0 {
            return 0.0;
        }
        let paint = self.scene.paints[on.part];
        let sun = self.to_sun(rng);
        let cos = on.normal.dot(sun);
        let mut sum = 0.0;
        if cos > 0.0 && self.nearest(at, sun).is_none() {
            sum += paint.brdf(sun, to, on.normal) * cos;
        }
        if depth == DEPTH {
            return sum;
        }
        // By the cosine: the estimator is π f L.
        let (x, y) = on.normal.any_orthonormal_pair();
        let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
        let square: f64 = rng.random();
        let across = square.sqrt();
        let next = (across * (cos * x + sin * y) + (1.0 - square).sqrt() * on.normal).normalize();
        if let Some((range, other)) = self.nearest(at, next) {
            let incoming = self.radiance(at + range * next, other, -next, depth + 1, rng);
            sum += PI * paint.brdf(next, to, on.normal) * incoming;
        }
        sum
    }

    /// The radiant intensity over the Sun's irradiance, m² sr⁻¹, with its standard error, from so many paths of an even grid of pixels
    /// (one path at random within each).
    pub fn intensity(&self, paths: usize, seed: u64) -> (f64, f64) {
        let to = self.scene.to;
        let (x, y) = to.any_orthonormal_pair();
        let corners = || self.triangles.iter().flat_map(|t| [t.a, t.a + t.ab, t.a + t.ac]);
        let span = |axis: DVec3| {
            let along = corners().map(|c| c.dot(axis));
            along.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)))
        };
        let ((x0, x1), (y0, y1)) = (span(x), span(y));
        let area = (x1 - x0) * (y1 - y0);
        let side = (paths as f64).sqrt().ceil() as usize;
        let mut rng = Rng::seed_from_u64(seed);
        let (mut sum, mut squares) = (0.0, 0.0);
        for k in 0..side * side {
            let u = ((k % side) as f64 + rng.random::<f64>()) / side as f64;
            let v = ((k / side) as f64 + rng.random::<f64>()) / side as f64;
            let from = (x0 + (x1 - x0) * u) * x + (y0 + (y1 - y0) * v) * y + 100.0 * to;
            let Some((range, seen)) = self.nearest(from, -to) else { continue };
            let value = area * self.radiance(from - range * to, seen, to, 0, &mut rng);
            sum += value;
            squares += value * value;
        }
        let n = (side * side) as f64;
        // Of independent paths: those of a grid scatter less.
        (sum / n, ((squares / n - (sum / n).powi(2)).max(0.0) / n).sqrt())
    }
}
