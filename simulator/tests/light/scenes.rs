//! Random scenes, and rays as an independent truth.

use glam::{DQuat, DVec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::{FRAC_1_PI, PI};
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::light::{Direct, Scene, View};
use sunglint_simulator::mesh::Mesh;
use sunglint_simulator::mesh::shapes::{Side, cuboid};
use sunglint_simulator::surface::Material;
use sunglint_simulator::target::{Part, Placement, Shape, Target};

pub type Rng = Xoshiro256PlusPlus;

pub fn rng(seed: u64) -> Rng {
    Rng::seed_from_u64(seed)
}

pub fn direction(rng: &mut Rng) -> DVec3 {
    loop {
        let v = DVec3::new(rng.random(), rng.random(), rng.random()) * 2.0 - 1.0;
        if (0.01..1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    }
}

pub fn turn(rng: &mut Rng) -> DQuat {
    DQuat::from_axis_angle(direction(rng), rng.random::<f64>() * 6.0)
}

/// Towards the Sun, and to an observer within 60° or so of it, so that something is seen.
pub fn directions(rng: &mut Rng) -> (DVec3, DVec3) {
    let sun = direction(rng);
    (sun, (sun + 0.9 * direction(rng)).normalize())
}

pub fn white(name: &str) -> Material {
    Material::lambert(name, Spectrum::constant(1.0, 300.0, 1240.0).unwrap()).unwrap()
}

/// Adds a white Lambert part with a material of its own.
pub fn add(target: &mut Target, shape: Shape, placement: Placement) {
    let k = target.parts.len();
    target.materials.push(white(&format!("m{k}")));
    target.parts.push(Part {
        name: format!("p{k}"),
        shape,
        material: k,
        placement,
        hinge: None,
        tangent: DVec3::X,
    });
}

/// White Lambert parts without rotation.
pub fn target(parts: impl IntoIterator<Item = (Shape, DVec3)>) -> Target {
    let mut target = Target::default();
    for (shape, offset_m) in parts {
        add(&mut target, shape, Placement { offset_m, ..Placement::default() });
    }
    target
}

/// Kinds of [`scene`].
pub const KINDS: u64 = 4;

/// Six boxes; `seed` modulo 4: that reach into each other; some of them open sheets; some concave; all on one grid, touching with whole
/// faces and lying in each other.
pub fn scene(seed: u64) -> Target {
    let mut rng = rng(seed);
    let mut target = Target::default();
    let kind = seed % KINDS;
    let all = turn(&mut rng);
    for k in 0..6 {
        let (mut size, mut offset_m) = (
            DVec3::new(rng.random(), rng.random(), rng.random()) + 0.1,
            0.8 * direction(&mut rng) * rng.random::<f64>(),
        );
        let mut rotation = turn(&mut rng);
        if kind == 3 {
            size = (4.0 * size).ceil() / 4.0;
            offset_m = all * ((8.0 * offset_m).round() / 8.0);
            rotation = all;
        }
        let mut mesh = cuboid(size, &Side::ALL);
        match (kind, k) {
            (1, 0..3) => {
                mesh = cuboid(size, &[Side::ALL[k], Side::ALL[5 - k], Side::ALL[(k + 2) % 6]]);
            }
            (2, 0..3) => dent(&mut mesh, 0.1),
            _ => {}
        }
        add(&mut target, Shape::Mesh(mesh), Placement { rotation, offset_m });
    }
    target
}

/// Draws one corner of a box in: it becomes concave.
pub fn dent(mesh: &mut Mesh, to: f64) {
    mesh.vertices.iter_mut().filter(|v| v.min_element() > 0.0).for_each(|v| *v *= to);
}

/// A body with `count` small bodies about it, every other one concave.
pub fn dense(count: usize, seed: u64) -> Target {
    let mut rng = rng(seed);
    let mut target = target([(Shape::Mesh(cuboid(DVec3::splat(2.0), &Side::ALL)), DVec3::ZERO)]);
    for k in 0..count {
        let size = 0.3 * (DVec3::new(rng.random(), rng.random(), rng.random()) + 0.1);
        let mut mesh = cuboid(size, &Side::ALL);
        if k % 2 == 1 {
            dent(&mut mesh, 0.1);
        }
        let offset_m = direction(&mut rng) * (1.0 + 0.6 * rng.random::<f64>());
        let rotation = turn(&mut rng);
        add(&mut target, Shape::Mesh(mesh), Placement { rotation, offset_m });
    }
    target
}

pub fn evaluate(scene: &Scene, sun: DVec3, view: View) -> (Vec<f64>, Direct) {
    let mut out = vec![0.0; scene.weight_count()];
    let done = scene.evaluator().direct(sun, view, &mut out).unwrap();
    (out, done)
}

pub fn weights(target: &Target, sun: DVec3, view: View) -> Vec<f64> {
    evaluate(&Scene::new(target).unwrap(), sun, view).0
}

/// ΣW and its claimed absolute error.
pub fn total(target: &Target, sun: DVec3, view: View) -> (f64, f64) {
    let (out, done) = evaluate(&Scene::new(target).unwrap(), sun, view);
    let sum: f64 = out.iter().sum();
    (sum, sum * done.error)
}

/// The largest W that white Lambert parts of this area could have: all of it square to the Sun and the observer.
pub fn most(target: &Target) -> f64 {
    let area = |p: &Part| match &p.shape {
        Shape::Mesh(mesh) => mesh.area_m2(),
        Shape::Sphere { radius_m } => 4.0 * PI * radius_m * radius_m,
        Shape::Curved(_) => panic!("curved parts have tests of their own"),
    };
    target.parts.iter().map(area).sum::<f64>() * FRAC_1_PI
}

/// The whole target turned and moved.
pub fn turned(target: &Target, rotation: DQuat, offset_m: DVec3) -> Target {
    let mut turned = target.clone();
    for part in &mut turned.parts {
        part.placement.rotation = rotation * part.placement.rotation;
        part.placement.offset_m = rotation * part.placement.offset_m + offset_m;
    }
    turned
}

struct Triangle {
    a: DVec3,
    ab: DVec3,
    ac: DVec3,
}

impl Triangle {
    /// Möller and Trumbore (1997).
    fn hit(&self, from: DVec3, d: DVec3) -> Option<f64> {
        let p = d.cross(self.ac);
        let det = self.ab.dot(p);
        if det.abs() < 1e-14 {
            return None;
        }
        let s = from - self.a;
        let u = s.dot(p) / det;
        let q = s.cross(self.ab);
        let v = d.dot(q) / det;
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0).then(|| self.ac.dot(q) / det)
    }
}

/// W of each part with its standard error: points at random on all surfaces, from each a ray to the Sun and one to the observer. Lambert,
/// white. Shares nothing with the engine, nor with polygons at all.
pub fn rays(target: &Target, sun: DVec3, view: View, count: u64, seed: u64) -> Vec<(f64, f64)> {
    let mut triangles = Vec::new();
    let mut balls = Vec::new();
    let mut sums = Vec::new();
    for (part, p) in target.parts.iter().enumerate() {
        match &p.shape {
            Shape::Mesh(mesh) => {
                for [a, b, c] in mesh.faces() {
                    let [a, b, c] = [a, b, c].map(|v| p.placement.point(v));
                    let area = 0.5 * (b - a).cross(c - a).length();
                    sums.push((area, part, triangles.len(), false));
                    triangles.push(Triangle { a, ab: b - a, ac: c - a });
                }
            }
            Shape::Sphere { radius_m } => {
                sums.push((4.0 * PI * radius_m * radius_m, part, balls.len(), true));
                balls.push((p.placement.offset_m, *radius_m));
            }
            Shape::Curved(_) => panic!("curved parts have tests of their own"),
        }
    }
    let whole: f64 = sums.iter().map(|s| s.0).sum();
    let blocked = |from: DVec3, d: DVec3, range: f64| {
        let between = |r: f64| r > 1e-9 && r < range;
        triangles.iter().any(|t| t.hit(from, d).is_some_and(between))
            || balls.iter().any(|(middle, radius)| {
                let away = middle - from;
                let along = away.dot(d);
                let root = along * along - away.length_squared() + radius * radius;
                root > 0.0 && (between(along + root.sqrt()) && along + root.sqrt() > 1e-7)
            })
    };
    let mut rng = rng(seed);
    let mut found = vec![(0.0, 0.0); target.parts.len()];
    for _ in 0..count {
        let mut at = whole * rng.random::<f64>();
        let chosen = sums.iter().find(|s| {
            at -= s.0;
            at <= 0.0
        });
        let Some(&(_, part, number, round)) = chosen else { continue };
        let (point, normal) = if round {
            let (middle, radius) = balls[number];
            let (z, turn) = (2.0 * rng.random::<f64>() - 1.0, 2.0 * PI * rng.random::<f64>());
            let s = (1.0 - z * z).sqrt();
            let n = DVec3::new(s * turn.cos(), s * turn.sin(), z);
            (middle + radius * n, n)
        } else {
            let t = &triangles[number];
            let (mut u, mut v) = (rng.random::<f64>(), rng.random::<f64>());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            (t.a + u * t.ab + v * t.ac, t.ab.cross(t.ac).normalize())
        };
        let (to, range, scale) = match view {
            View::Distant(d) => (d, f64::INFINITY, 1.0),
            View::At(q) => {
                let away = q - point;
                (away.normalize(), away.length(), q.length_squared() / away.length_squared())
            }
        };
        let (i, o) = (normal.dot(sun), normal.dot(to));
        if i <= 0.0 || o <= 0.0 || blocked(point, sun, f64::INFINITY) || blocked(point, to, range) {
            continue;
        }
        let value = whole * i * o * scale * FRAC_1_PI;
        found[part].0 += value;
        found[part].1 += value * value;
    }
    let n = count as f64;
    let error = |s: f64, s2: f64| ((s2 / n - (s / n).powi(2)).max(0.0) / n).sqrt();
    found.into_iter().map(|(s, s2)| (s / n, error(s, s2))).collect()
}

/// Asserts that each part agrees with rays within 4 of their standard errors; parts that hardly a ray meets within `floor`, m² sr⁻¹.
pub fn agree_with_rays(target: &Target, sun: DVec3, view: View, count: u64, floor: f64, seed: u64) {
    let out = weights(target, sun, view);
    for (part, (w, sigma)) in rays(target, sun, view, count, seed).into_iter().enumerate() {
        let off = (out[part] - w).abs();
        assert!(off <= 4.0 * sigma + floor, "{seed} part {part}: {} for {w} ± {sigma}", out[part]);
    }
}
