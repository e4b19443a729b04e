//! A path tracer of the test's own: plain random numbers, every triangle looked at for every ray.

use super::scenes::*;
use glam::{DQuat, DVec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::{PI, TAU};
use sunglint_simulator::light::bounce::{Bounce, BounceOptions};
use sunglint_simulator::light::{Scene, View};
use sunglint_simulator::mesh::shapes::{Side, cuboid};
use sunglint_simulator::target::{Placement, Shape, Target};
use sunglint_testkit::Campaign;

type Rng = Xoshiro256PlusPlus;

/// f_r of a normal and two directions, sr⁻¹.
pub type Law = fn(DVec3, DVec3, DVec3) -> f64;

struct Triangle {
    corner: DVec3,
    edges: [DVec3; 2],
    normal: DVec3,
    /// Share of the light that falls on it with which a path goes on; the reflectance of a Lambert surface.
    rho: f64,
    /// Where it is not Lambert.
    law: Option<Law>,
}

/// The triangles of a target of grey meshes without hinges.
pub struct Rays(Vec<Triangle>);

impl Rays {
    pub fn new(target: &Target) -> Self {
        Self::with_laws(target, &[])
    }

    /// The materials of some parts by their laws.
    pub fn with_laws(target: &Target, laws: &[(usize, Law)]) -> Self {
        let mut all = Vec::new();
        for (k, part) in target.parts.iter().enumerate() {
            let law = laws.iter().find(|l| l.0 == k).map(|l| l.1);
            let grey = || target.materials[part.material].spectra()[0].at(550.0);
            let rho = if law.is_some() { 0.8 } else { grey() };
            let mesh = target.part_mesh(k, &[]);
            for t in 0..mesh.triangles.len() {
                let [a, b, c] = mesh.corners(t);
                let edges = [b - a, c - a];
                let normal = edges[0].cross(edges[1]).normalize();
                all.push(Triangle { corner: a, edges, normal, rho, law });
            }
        }
        Self(all)
    }

    /// The first triangle along a ray and how far it is (Möller and Trumbore 1997).
    fn first(&self, from: DVec3, along: DVec3) -> Option<(f64, &Triangle)> {
        let mut found: Option<(f64, &Triangle)> = None;
        // Of faces in one place that look the same way the later counts.
        for triangle in &self.0 {
            let [e, f] = triangle.edges;
            let p = along.cross(f);
            let determinant = e.dot(p);
            let s = from - triangle.corner;
            let u = s.dot(p) / determinant;
            let q = s.cross(e);
            let (v, t) = (along.dot(q) / determinant, f.dot(q) / determinant);
            let same = found.is_some_and(|(_, f)| f.normal.dot(triangle.normal) > 0.999);
            let tie = if same { 1e-9 } else { 0.0 };
            let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 1e-9;
            if inside && found.is_none_or(|(nearest, _)| t < nearest + tie) {
                found = Some((t, triangle));
            }
        }
        found
    }

    /// Returns the area of fronts that a direction sees, across it, m²; by rays from a square about the origin.
    pub fn across(&self, d: DVec3, half: f64, n: usize) -> f64 {
        let (x, y) = d.any_orthonormal_pair();
        let at = |k: usize| half * (2.0 * (k as f64 + 0.5) / n as f64 - 1.0);
        let sees = |i: usize, j: usize| {
            let from = at(i) * x + at(j) * y + 10.0 * half * d;
            self.first(from, -d).is_some_and(|(_, t)| t.normal.dot(d) > 0.0)
        };
        let seen = (0..n * n).filter(|k| sees(k / n, k % n)).count();
        4.0 * half * half * seen as f64 / (n * n) as f64
    }

    /// W of light scattered twice or more with its standard error, from rays that come with the sunlight: two from each cell of a square about the target.
    pub fn bounced(&self, sun: DVec3, to: DVec3, count: u32, rng: &mut Rng) -> (f64, f64) {
        let (x, y) = sun.any_orthonormal_pair();
        let range = |axis: DVec3| {
            let corners = self
                .0
                .iter()
                .flat_map(|t| [t.corner, t.corner + t.edges[0], t.corner + t.edges[1]]);
            corners
                .map(|p| p.dot(axis))
                .fold((f64::MAX, f64::MIN), |(a, b), h| (a.min(h), b.max(h)))
        };
        let ((x0, x1), (y0, y1)) = (range(x), range(y));
        let start = (range(sun).1 + 1.0) * sun;
        let cells = (0.5 * f64::from(count)).sqrt().ceil();
        let cell = (x1 - x0) * (y1 - y0) / (cells * cells);
        let (mut sum, mut square) = (0.0, 0.0);
        for k in 0..(cells * cells) as u32 {
            let (row, column) = (f64::from(k / cells as u32), f64::from(k % cells as u32));
            let mut one = || {
                let u = x0 + (x1 - x0) * (column + rng.random::<f64>()) / cells;
                let v = y0 + (y1 - y0) * (row + rng.random::<f64>()) / cells;
                cell * self.path(start + u * x + v * y, -sun, to, rng)
            };
            let (a, b) = (one(), one());
            sum += 0.5 * (a + b);
            square += 0.25 * (a - b) * (a - b);
        }
        (sum, square.sqrt())
    }

    /// Returns the light that one ray brings to the observer after the first scattering.
    fn path(&self, mut from: DVec3, mut along: DVec3, to: DVec3, rng: &mut Rng) -> f64 {
        let (mut light, mut got) = (1.0, 0.0);
        for order in 1.. {
            let Some((t, triangle)) = self.first(from, along) else { break };
            let normal = triangle.normal;
            if normal.dot(along) >= 0.0 {
                break;
            }
            let reflects =
                |o: DVec3| triangle.law.map_or(triangle.rho / PI, |f| f(normal, -along, o));
            from += t * along;
            let cos = normal.dot(to);
            if order > 1 && cos > 0.0 && self.first(from, to).is_none() {
                got += light * reflects(to) * cos;
            }
            // Kept with probability ρ: the light of Lambert surfaces stays what it is.
            if rng.random::<f64>() >= triangle.rho {
                break;
            }
            let (a, b) = (rng.random::<f64>(), TAU * rng.random::<f64>());
            let (p, q) = normal.any_orthonormal_pair();
            let next = a.sqrt() * (b.cos() * p + b.sin() * q) + (1.0 - a).sqrt() * normal;
            let next = next.normalize();
            light *= PI * reflects(next) / triangle.rho;
            along = next;
        }
        got
    }
}

fn direction(rng: &mut Rng) -> DVec3 {
    loop {
        let v = DVec3::new(rng.random(), rng.random(), rng.random()) * 2.0 - 1.0;
        if (0.01..1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    }
}

/// Boxes and open sheets at random, apart, touching and in each other, of random reflectances.
fn bodies(seed: u64) -> Target {
    let mut rng = Rng::seed_from_u64(seed);
    let mut target = Target::default();
    for k in 0..4 {
        let size = DVec3::new(rng.random(), rng.random(), rng.random()) + 0.2;
        let mesh = if k > 1 && seed % 2 == 1 {
            cuboid(size, &[Side::ALL[0], Side::ALL[3], Side::ALL[4]])
        } else {
            cuboid(size, &Side::ALL)
        };
        let turn = DQuat::from_axis_angle(direction(&mut rng), 6.0 * rng.random::<f64>());
        // Every third scene stands on a grid: faces touch.
        let grid = seed.is_multiple_of(3);
        let rotation = if grid { DQuat::IDENTITY } else { turn };
        let mut offset_m = 0.9 * direction(&mut rng);
        if grid {
            offset_m = (4.0 * offset_m).round() / 4.0 + 0.5 * size.fract();
        }
        let rho = 0.2 + 0.75 * rng.random::<f64>();
        add(&mut target, Shape::Mesh(mesh), grey("grey", rho), Placement { rotation, offset_m });
    }
    target
}

/// Found light and true light.
struct Trial {
    found: f64,
    claimed: f64,
    truth: f64,
    sigma: f64,
}

impl Trial {
    /// Whether the claim holds; two standard errors of the truth and 1e-5 m² sr⁻¹ are nobody's.
    fn is_covered(&self) -> bool {
        (self.found - self.truth).abs() <= self.claimed + 2.0 * self.sigma + 1e-5
    }
}

/// All light together, relative, and its standard error.
fn pooled(trials: &[Trial]) -> (f64, f64) {
    let all: f64 = trials.iter().map(|t| t.truth).sum();
    let off: f64 = trials.iter().map(|t| t.found - t.truth).sum();
    let square: f64 = trials.iter().map(|t| t.sigma * t.sigma).sum();
    (off / all, square.sqrt() / all)
}

/// All light together is right to this.
const BIAS: f64 = 0.015;

/// Truth: the path tracer above, whose light of all scenes together is known to 1 % (a tenth of them) or better. In random scenes of bodies and sheets
/// apart, in each other and face to face the claimed error covers in 95 % of them (misses are as likely as 1 %), and the light of all of them is
/// right to 1.5 % and three standard errors; the same light 5 % lower would not be.
#[test]
fn campaign_bounce_rays() {
    let mut campaign = Campaign::with_part("bounce_rays", 100, 10);
    let mut trials = Vec::new();
    for seed in campaign.seeds() {
        let target = bodies(seed);
        let mut rng = Rng::seed_from_u64(1000 + seed);
        let sun = direction(&mut rng);
        let to = (sun + 0.9 * direction(&mut rng)).normalize();
        let scene = Scene::new(&target).unwrap();
        let options = BounceOptions { tolerance: 3e-3, seed: 5, ..BounceOptions::default() };
        let bounce = Bounce::new(&scene, &options).unwrap();
        let (truth, sigma) = Rays::new(&target).bounced(sun, to, 600_000, &mut rng);
        let view = View::Distant(to);
        let once = direct(&scene, sun, view);
        let (found, claimed) = if bounce.need().needed {
            grey_light(&bounce, sun, view)
        } else {
            // Left out: the largest share that was met.
            (0.0, bounce.need().bound.unwrap() * once.max(0.05))
        };
        let trial = Trial { found, claimed, truth, sigma };
        let mark = if trial.is_covered() { "" } else { " MISSED" };
        let why = &bounce.need().why;
        eprintln!(
            "{seed}: {found:.5} of {truth:.5} ± {sigma:.1e}, claimed {claimed:.1e}{mark}; {why}"
        );
        trials.push(trial);
    }
    let misses = trials.iter().filter(|t| !t.is_covered()).count();
    let (bias, sigma) = pooled(&trials);
    eprintln!("{misses} of {} missed, all light {bias:.4} ± {sigma:.4} off", trials.len());
    let chance = sunglint_testkit::chance_of_misses(trials.len() as u64, misses as u64, 0.05);
    assert!(chance > 0.01, "{misses} of {}", trials.len());
    let allowed = BIAS + 3.0 * sigma;
    assert!(bias.abs() <= allowed, "{bias} ± {sigma}");
    // So that this means something.
    trials.iter_mut().for_each(|t| t.found *= 0.95);
    assert!(pooled(&trials).0.abs() > allowed, "{} ± {sigma}", pooled(&trials).0);
    campaign.largest("misses", misses as f64);
    campaign.finish();
}
