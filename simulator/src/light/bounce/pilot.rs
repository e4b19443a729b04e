//! A first look: how much light is inter-reflected, for some pairs of directions.

use super::BounceOptions;
use super::cast::Caster;
use super::nodes::Nodes;
use super::optics::Optics;
use super::paths::{Paths, Sums, mixed};
use super::surfaces::Surfaces;
use super::tracing::Direct;
use crate::light::Scene;
use crate::light::occlude::Toward;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Pairs of directions.
const PAIRS: u32 = 48;
/// Pairs that one thread looks at at least: room is made for them together.
pub const TOGETHER: usize = 4;
/// Paths of each pair and scramble.
pub const POINTS: u32 = 64;
/// Pairs with less direct light than this, of the most, do not count: nobody measures a share there.
const FAINT: f64 = 0.05;
/// Cosine of the largest phase angle.
const LARGEST_PHASE_COS: f64 = -0.5;

/// Result of a first look at some pairs of directions.
#[derive(Debug, Clone)]
pub struct Pilot {
    pub pairs: Vec<Pair>,
    /// Share of inter-reflected light in all light of all pairs.
    pub mean: f64,
    /// Largest share of any pair that is not faint at any node, two standard errors above what was found.
    pub largest: f64,
}

/// One pair.
#[derive(Debug, Clone)]
pub struct Pair {
    pub sun: DVec3,
    pub to: DVec3,
    /// Scattered once, mean over the nodes, m² sr⁻¹.
    pub direct: f64,
    /// The same scattered more often, and its standard error.
    pub bounced: f64,
    pub sigma: f64,
    /// Whether it counts.
    pub counts: bool,
}

/// Sun, observer, direct light at each node, bounced light and its standard error.
type Row = (DVec3, DVec3, Vec<f64>, Vec<(f64, f64)>);

impl Pilot {
    pub fn new(
        scene: &Scene,
        surfaces: &Surfaces,
        active: &[usize],
        nodes: &Nodes,
        options: &BounceOptions,
    ) -> Self {
        let optics = Optics::new(scene.materials(), &nodes.nm);
        let count = nodes.nm.len();
        let room = || {
            let caster = Caster::new(&surfaces.list, scene.touching_m);
            (surfaces.clone(), caster, optics.clone(), Direct::new(scene, &nodes.nm))
        };
        let look = |(surfaces, caster, optics, exact): &mut (Surfaces, Caster, Optics, Direct),
                    (sun, to): (DVec3, DVec3)| {
            if surfaces.turn(scene, sun) {
                *caster = Caster::new(&surfaces.list, scene.touching_m);
            }
            let mut sums = Sums::new(count);
            let mut paths = Paths {
                surfaces,
                caster,
                optics,
                active,
                both_ends: true,
                rest_of: None,
                polariser: None,
                seed: mixed(options.seed, 0xb0),
            };
            paths.trace(sun, Toward::Far(to), POINTS, &mut sums);
            let direct = match exact.at(sun, Toward::Far(to)) {
                Some(direct) => direct.to_vec(),
                None => (0..count).map(|s| sums.direct(s)).collect(),
            };
            let bounced: Vec<(f64, f64)> = (0..count).map(|s| sums.bounced(s)).collect();
            ((sun, to, direct, bounced), sums)
        };
        let pairs: Vec<_> = directions(options.seed).collect();
        let looks = pairs.into_par_iter().with_min_len(TOGETHER).map_init(room, look);
        let (rows, all): (Vec<Row>, Vec<Sums>) = looks.unzip();
        Self::of(&rows, count, Sums::missing_of(&all))
    }

    /// The share of bounced light: root of the mean square over the pairs that count.
    pub fn typical(&self) -> f64 {
        let pairs = self.pairs.iter().filter(|p| p.counts);
        let square = |p: &Pair| (p.bounced / (p.direct + p.bounced)).powi(2);
        let (sum, count) = pairs.fold((0.0, 0.0_f64), |(s, n), p| (s + square(p), n + 1.0));
        (sum / count.max(1.0)).sqrt()
    }

    /// The error that is stated of paths, relative to all light (root of the mean square over the pairs that count): `claimed` makes it of a pair's standard error.
    pub fn stated(&self, claimed: impl Fn(f64) -> f64) -> f64 {
        let pairs = self.pairs.iter().filter(|p| p.counts);
        let square = |p: &Pair| (claimed(p.sigma) / (p.direct + p.bounced)).powi(2);
        let (sum, count) = pairs.fold((0.0, 0.0_f64), |(s, n), p| (s + square(p), n + 1.0));
        (sum / count.max(1.0)).sqrt()
    }

    fn of(rows: &[Row], count: usize, missing: f64) -> Self {
        let most: Vec<f64> =
            (0..count).map(|s| rows.iter().map(|r| r.2[s]).fold(0.0, f64::max)).collect();
        let (mut all, mut of_all, mut largest) = (0.0, 0.0, 0.0_f64);
        let mut pairs = Vec::new();
        for (sun, to, direct, bounced) in rows {
            let n = count as f64;
            let (d, b) =
                (direct.iter().sum::<f64>() / n, bounced.iter().map(|b| b.0).sum::<f64>() / n);
            let sigma = bounced.iter().map(|b| b.1).sum::<f64>() / n;
            all += d + b;
            of_all += b;
            let mut counts = false;
            for s in 0..count {
                if direct[s] > FAINT * most[s] {
                    counts = true;
                    let found = bounced[s].0 + 2.0 * bounced[s].1 + missing;
                    largest = largest.max(found / (direct[s] + found));
                }
            }
            pairs.push(Pair { sun: *sun, to: *to, direct: d, bounced: b, sigma, counts });
        }
        let mean = if all > 0.0 { of_all / all } else { 0.0 };
        // Where no direction sends direct light, nothing speaks for leaving the rest out.
        if most.iter().all(|m| *m == 0.0) && of_all > 0.0 {
            largest = 1.0;
        }
        Self { pairs, mean, largest }
    }
}

/// Suns all around, observers at phase angles up to 120°.
fn directions(seed: u32) -> impl Iterator<Item = (DVec3, DVec3)> {
    (0..PAIRS).map(move |k| {
        let u = sobol_burley::sample_4d(k, 0, mixed(seed, 0xd1)).map(f64::from);
        let on_sphere = |z: f64, turn: f64| {
            let (sin, cos) = (TAU * turn).sin_cos();
            let across = (1.0 - z * z).max(0.0).sqrt();
            DVec3::new(across * cos, across * sin, z)
        };
        let sun = on_sphere(2.0 * u[0] - 1.0, u[1]);
        let (x, y) = sun.any_orthonormal_pair();
        let at = on_sphere(LARGEST_PHASE_COS + (1.0 - LARGEST_PHASE_COS) * u[2], u[3]);
        (sun, (at.x * x + at.y * y + at.z * sun).normalize())
    })
}
