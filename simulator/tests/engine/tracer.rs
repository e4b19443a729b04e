//! The light of a scene by a path tracer that shares nothing with the engine: its own intersections, its own BRDFs, Sun and Earth as extended lights.

use super::scenes::{Paint, RandomScene, Rng};
use glam::{DQuat, DVec3};
use rand::{RngExt as _, SeedableRng as _};
use std::f64::consts::{FRAC_1_PI, PI, TAU};
use sunglint_simulator::light::View;
use sunglint_simulator::surface::Distribution;
use sunglint_simulator::target::Shape;

/// Depth at which paths end: what is left is below 0.9⁸ of what a wall of a closed room would have, and far less here.
const DEPTH: usize = 8;
/// Limb darkening of sunlight near 550 nm, 1 − u (1 − μ) (Allen, Astrophysical Quantities: u = 0.6).
const LIMB: f64 = 0.6;
/// The mean albedo of the Earth (Stephens et al. 2015: 0.29 to 0.30).
const ALBEDO: f64 = 0.30;

impl Paint {
    /// f_r, sr⁻¹, written out from the paper (Walter et al. 2007, eqs. 20, 25, 27, 33, 34): slopes, Smith's masking of each direction.
    fn brdf(self, i: DVec3, o: DVec3, n: DVec3) -> f64 {
        let (ci, co) = (i.dot(n), o.dot(n));
        if ci <= 0.0 || co <= 0.0 {
            return 0.0;
        }
        let Some((kind, alpha)) = self.lobe else { return self.reflectance * FRAC_1_PI };
        let d = slopes(kind, alpha, (i + o).normalize().dot(n));
        let masking = |c: f64| {
            let tan = (1.0 / (c * c) - 1.0).max(0.0).sqrt();
            if tan == 0.0 {
                return 1.0;
            }
            let a = 1.0 / (alpha * tan);
            match kind {
                Distribution::Beckmann => {
                    2.0 / (1.0 + libm::erf(a) + (-a * a).exp() / (a * PI.sqrt()))
                }
                Distribution::Ggx => 2.0 / (1.0 + (1.0 + 1.0 / (a * a)).sqrt()),
            }
        };
        self.reflectance * d * masking(ci) * masking(co) / (4.0 * ci * co)
    }

    /// A direction by the cosine or, of what shines, as often by the lobe; with the density of both together.
    fn draw(self, to: DVec3, n: DVec3, rng: &mut Rng) -> (DVec3, f64) {
        let (x, y) = n.any_orthonormal_pair();
        let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
        let u: f64 = rng.random();
        let about = |sine: f64, cosine: f64| sine * (cos * x + sin * y) + cosine * n;
        let Some((kind, alpha)) = self.lobe else {
            let next = about(u.sqrt(), (1.0 - u).sqrt()).normalize();
            return (next, FRAC_1_PI * next.dot(n));
        };
        let next = if rng.random_bool(0.5) {
            about(u.sqrt(), (1.0 - u).sqrt()).normalize()
        } else {
            let slope = match kind {
                Distribution::Beckmann => alpha * (-(1.0 - u).ln()).sqrt(),
                Distribution::Ggx => alpha * (u / (1.0 - u)).sqrt(),
            };
            let h = about(slope, 1.0).normalize();
            2.0 * to.dot(h) * h - to
        };
        let h = (next + to).normalize();
        let lobe = slopes(kind, alpha, h.dot(n)) * h.dot(n) / (4.0 * h.dot(to).abs());
        (next, 0.5 * (FRAC_1_PI * next.dot(n).max(0.0) + lobe))
    }
}

/// The distribution of normals.
fn slopes(kind: Distribution, alpha: f64, ch: f64) -> f64 {
    let tan2 = (1.0 / (ch * ch) - 1.0) / (alpha * alpha);
    let shape = match kind {
        Distribution::Beckmann => (-tan2).exp(),
        Distribution::Ggx => 1.0 / ((1.0 + tan2) * (1.0 + tan2)),
    };
    shape / (PI * alpha * alpha * ch.powi(4))
}

enum Solid {
    Triangle { a: DVec3, ab: DVec3, ac: DVec3 },
    Sphere { middle: DVec3, radius: f64 },
}

struct Surface {
    solid: Solid,
    part: usize,
}

impl Surface {
    fn normal(&self, at: DVec3) -> DVec3 {
        match &self.solid {
            Solid::Triangle { ab, ac, .. } => ab.cross(*ac).normalize(),
            Solid::Sphere { middle, .. } => (at - *middle).normalize(),
        }
    }

    /// The way to it along a ray, from beyond a nanometre (triangles: Möller and Trumbore 1997).
    fn meets(&self, from: DVec3, d: DVec3) -> Option<f64> {
        match &self.solid {
            Solid::Triangle { a, ab, ac } => {
                let p = d.cross(*ac);
                let det = ab.dot(p);
                let s = from - *a;
                let (u, q) = (s.dot(p) / det, s.cross(*ab));
                let v = d.dot(q) / det;
                let range = ac.dot(q) / det;
                (det.abs() > 1e-14 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 && range > 1e-9)
                    .then_some(range)
            }
            Solid::Sphere { middle, radius } => {
                let s = from - *middle;
                let b = s.dot(d);
                let root = (b * b - s.length_squared() + radius * radius).sqrt();
                [-b - root, -b + root].into_iter().find(|t| *t > 1e-9)
            }
        }
    }

    fn corners(&self) -> [DVec3; 3] {
        match &self.solid {
            Solid::Triangle { a, ab, ac } => [*a, *a + *ab, *a + *ac],
            Solid::Sphere { middle, .. } => [*middle; 3],
        }
    }
}

/// The path tracer.
pub struct Tracer<'a> {
    scene: &'a RandomScene,
    surfaces: Vec<Surface>,
}

impl<'a> Tracer<'a> {
    pub fn new(scene: &'a RandomScene) -> Self {
        let mut surfaces = Vec::new();
        for (part, p) in scene.target.parts.iter().enumerate() {
            // A hinge turns its face as near to the Sun as it goes: the Sun then lies in the plane of axis and face.
            let turn = p.hinge.map(|h| {
                let hinge = &scene.target.hinges[h];
                let wanted = scene.sun.reject_from(hinge.axis).normalize();
                (hinge.point_m, DQuat::from_rotation_arc(hinge.face, wanted))
            });
            let place = |v: DVec3| {
                let v = p.placement.rotation * v + p.placement.offset_m;
                turn.map_or(v, |(about, turn)| about + turn * (v - about))
            };
            match &p.shape {
                Shape::Mesh(mesh) => surfaces.extend((0..mesh.triangles.len()).map(|t| {
                    let [a, b, c] = mesh.corners(t).map(place);
                    Surface { solid: Solid::Triangle { a, ab: b - a, ac: c - a }, part }
                })),
                Shape::Sphere { radius_m } => {
                    let (middle, radius) = (place(DVec3::ZERO), *radius_m);
                    surfaces.push(Surface { solid: Solid::Sphere { middle, radius }, part });
                }
                other => unreachable!("no scene has {other:?}"),
            }
        }
        Self { scene, surfaces }
    }

    fn nearest(&self, from: DVec3, d: DVec3) -> Option<(f64, &Surface)> {
        let hits = self.surfaces.iter().filter_map(|s| Some((s.meets(from, d)?, s)));
        hits.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// A direction to the Sun's disc, and how bright it is there, of its mean.
    fn to_sun(&self, rng: &mut Rng) -> (DVec3, f64) {
        let square: f64 = rng.random();
        let radius = self.scene.sun_radius_rad * square.sqrt();
        let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
        let (x, y) = self.scene.sun.any_orthonormal_pair();
        let bright = (1.0 - LIMB * (1.0 - (1.0 - square).sqrt())) / (1.0 - LIMB / 3.0);
        ((self.scene.sun + radius * (cos * x + sin * y)).normalize(), bright)
    }

    /// A direction to the Earth, and the irradiance that stands for it, of the Sun's.
    fn to_earth(&self, rng: &mut Rng) -> Option<(DVec3, f64)> {
        let earth = self.scene.earth?;
        let sine = earth.radius_m / earth.distance_m;
        let cap = 1.0 - (1.0 - sine * sine).sqrt();
        let cos = 1.0 - cap * rng.random::<f64>();
        let (s, c) = (TAU * rng.random::<f64>()).sin_cos();
        let (x, y) = earth.toward.any_orthonormal_pair();
        let d = (1.0 - cos * cos).sqrt() * (c * x + s * y) + cos * earth.toward;
        let aside2 = earth.distance_m.powi(2) * (1.0 - cos * cos);
        let range = earth.distance_m * cos - (earth.radius_m.powi(2) - aside2).max(0.0).sqrt();
        let ground = (range * d - earth.distance_m * earth.toward).normalize();
        Some((d, ALBEDO * FRAC_1_PI * ground.dot(earth.sun).max(0.0) * TAU * cap))
    }

    /// Radiance over the Sun's irradiance, sr⁻¹, from a point of a surface towards `to`.
    fn radiance(&self, at: DVec3, on: &Surface, to: DVec3, depth: usize, rng: &mut Rng) -> f64 {
        let n = on.normal(at);
        if n.dot(to) <= 0.0 {
            return 0.0;
        }
        let paint = self.scene.paints[on.part];
        let mut sum = 0.0;
        let lights = [Some(self.to_sun(rng)), self.to_earth(rng)];
        for (light, bright) in lights.into_iter().flatten() {
            let cos = n.dot(light);
            if cos > 0.0 && bright > 0.0 && self.nearest(at, light).is_none() {
                sum += bright * paint.brdf(light, to, n) * cos;
            }
        }
        if depth == DEPTH {
            return sum;
        }
        let (next, density) = paint.draw(to, n, rng);
        let cos = next.dot(n);
        if cos > 0.0
            && let Some((range, other)) = self.nearest(at, next)
        {
            let incoming = self.radiance(at + range * next, other, -next, depth + 1, rng);
            sum += paint.brdf(next, to, n) * cos / density * incoming;
        }
        sum
    }

    /// The radiant intensity over the Sun's irradiance, m² sr⁻¹ (towards a near observer the irradiance there times the square of its distance from the origin),
    /// with its standard error, from so many paths of an even grid of pixels (one path at random within each).
    pub fn intensity(&self, paths: usize, seed: u64) -> (f64, f64) {
        let (to, near) = match self.scene.view {
            View::Distant(to) => (to, None),
            View::At(q) => (q.normalize(), Some(q)),
        };
        let (x, y) = to.any_orthonormal_pair();
        let reach = |s: &Surface| match s.solid {
            Solid::Sphere { radius, .. } => radius,
            Solid::Triangle { .. } => 0.0,
        };
        // Where the line of sight to a point meets the plane of the origin.
        let span = |axis: DVec3| {
            let wide = |p: DVec3| near.map_or(1.0, |q| q.length() / (q.length() - p.dot(to)));
            let ends = self.surfaces.iter().flat_map(|s| {
                let r = reach(s);
                // A sphere's outline lies outside of its great circle: within 2 r of the middle from 3 m.
                let r = if near.is_some() { 2.0 * r } else { r };
                s.corners().into_iter().flat_map(move |c| [(c, r), (c, -r)])
            });
            let along = ends.map(|(c, r)| (c.dot(axis) + r) * wide(c));
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
            let point = (x0 + (x1 - x0) * u) * x + (y0 + (y1 - y0) * v) * y;
            let from = near.unwrap_or(point + 100.0 * to);
            let along = (point - from).normalize();
            let Some((range, seen)) = self.nearest(from, along) else { continue };
            // Of a pixel of the plane, dω r² = dA cos³.
            let cube = along.dot(-to).powi(3);
            let radiance = self.radiance(from + range * along, seen, -along, 0, &mut rng);
            let value = area * cube * radiance;
            sum += value;
            squares += value * value;
        }
        let n = (side * side) as f64;
        // Of independent paths: those of a grid scatter less.
        (sum / n, ((squares / n - (sum / n).powi(2)).max(0.0) / n).sqrt())
    }
}
