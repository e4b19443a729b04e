//! Paths for each epoch: as many as the tolerance asks for.

use super::nodes::Nodes;
use super::paths::{MOST_POINTS, SCRAMBLES, Sums, mixed};
use super::pilot::Pilot;
use super::surfaces::Surfaces;
use super::thread::Thread;
use super::{Analyser, BounceOptions};
use crate::light::occlude::Toward;
use crate::light::{Evaluator, Scene, View};
use glam::DVec3;
use std::sync::Arc;

/// Paths of each scramble at least.
const LEAST: u32 = 64;
/// Standard errors that are claimed: Student's t of 7 degrees of freedom at 99 %, since paths end where the error happens to look small.
const CLAIMED: f64 = 3.5;
/// Share of the tolerance that the claimed error of the paths may take.
const OF_TOLERANCE: f64 = 0.7;
/// Scenes of more facets leave the direct light to the paths.
const MOST_EXACT: usize = 2000;
/// Relative error allowed in the direct light with which bounced light is compared.
const ROUGH_DIRECT: f64 = 1e-2;
/// Cost of a path, s, estimated for the report.
const PATH_S: f64 = 1e-6;

/// Preparation that stays the same from epoch to epoch.
#[derive(Debug)]
pub struct Plan {
    surfaces: Surfaces,
    active: Vec<usize>,
    nodes: Nodes,
    tolerance: f64,
    seed: u32,
    most_points: u32,
    /// Whether only what [`Still`](super::still::Still) leaves is wanted.
    rest: bool,
    /// Angle of a polariser before the observer, radians.
    polariser_rad: Option<f64>,
}

impl Plan {
    pub fn new(
        surfaces: Surfaces,
        active: Vec<usize>,
        nodes: &Nodes,
        options: &BounceOptions,
    ) -> Self {
        let (tolerance, seed) = (options.tolerance, mixed(options.seed, 0x7a));
        let most_points = (options.most_paths / SCRAMBLES).clamp(LEAST, MOST_POINTS);
        let (nodes, rest) = (nodes.clone(), false);
        let polariser_rad = options.analyser.and_then(Analyser::angle_rad);
        Self { surfaces, active, nodes, tolerance, seed, most_points, rest, polariser_rad }
    }

    /// The same for paths of [`Paths::rest_of`](super::paths::Paths::rest_of) alone.
    pub fn of_rest(self) -> Self {
        Self { rest: true, ..self }
    }

    /// The same paths for the same body in other reflectances; `None` where light is less linear between the wavelengths.
    pub fn recoloured(&self, scene: &Scene) -> Option<Self> {
        let among = self.surfaces.materials(self.active.iter().copied());
        let nodes = self.nodes.again(scene.materials(), &among)?;
        let (surfaces, active) = (self.surfaces.clone(), self.active.clone());
        Some(Self { surfaces, active, nodes, ..*self })
    }

    /// The claimed error of all paths that may be traced, of one that `points` of each scramble know to `sigma`.
    pub fn claimed(&self, sigma: f64, points: u32) -> f64 {
        CLAIMED * sigma * (f64::from(points) / f64::from(self.most_points)).sqrt()
    }

    /// In words.
    pub fn describe(&self) -> String {
        "light paths for each epoch".into()
    }

    /// Estimates the cost of an epoch, s, from the paths that the first look would have wanted in the mean of its pairs.
    pub fn cost_s(&self, pilot: &Pilot) -> f64 {
        let (mut paths, mut pairs) = (0.0, 0.0_f64);
        for pair in pilot.pairs.iter().filter(|p| p.counts) {
            let wanted = OF_TOLERANCE * self.tolerance * (pair.direct + pair.bounced);
            let more = (CLAIMED * pair.sigma / wanted).powi(2) * 64.0;
            paths +=
                f64::from(SCRAMBLES) * more.clamp(f64::from(LEAST), f64::from(self.most_points));
            pairs += 1.0;
        }
        PATH_S * paths / pairs.max(1.0)
    }
}

/// Paths of one thread.
#[derive(Debug)]
pub struct Tracing<'a> {
    plan: Arc<Plan>,
    thread: Thread<'a>,
}

impl<'a> Tracing<'a> {
    pub fn new(scene: &'a Scene, plan: Arc<Plan>) -> Self {
        let nm = &plan.nodes.nm;
        let mut thread = Thread::new(scene, &plan.surfaces, &plan.active, nm);
        if let Some(angle_rad) = plan.polariser_rad {
            thread = thread.behind(nm, angle_rad);
        }
        Self { plan, thread }
    }

    /// Adds weights and errors. Paths are traced until the claimed error is below its part of the tolerance, of all light; `beside` is
    /// what is scattered twice or more and found otherwise, at each node.
    pub fn add(
        &mut self,
        (sun, eye): (DVec3, Toward),
        beside: Option<&[f64]>,
        weights: &mut [f64],
        errors: &mut [f64],
    ) {
        self.thread.turn(sun);
        let plan = &*self.plan;
        let nodes = plan.nodes.nm.len();
        let mut sums = Sums::new(nodes);
        let known = self.thread.direct(sun, eye);
        let mut paths = self.thread.paths(&plan.active, plan.rest, plan.seed);
        let mut until = LEAST;
        loop {
            paths.trace(sun, eye, until, &mut sums);
            let enough = (0..nodes).all(|s| {
                let (mean, sigma) = sums.bounced(s);
                let direct = known.as_ref().map_or_else(|| sums.direct(s), |known| known[s]);
                let light = direct + mean + beside.map_or(0.0, |b| b[s]);
                CLAIMED * sigma + sums.missing() <= OF_TOLERANCE * plan.tolerance * light
            });
            if enough || until >= plan.most_points {
                break;
            }
            until *= 2;
        }
        for s in 0..nodes {
            let (mean, sigma) = sums.bounced(s);
            weights[s] += mean;
            errors[s] += CLAIMED * sigma + sums.missing() + plan.nodes.error * mean;
        }
    }
}

/// Paths take the place of what is known otherwise where they claim less than this share of its error.
const BETTER: f64 = 0.8;

impl Tracing<'_> {
    /// Puts the light of paths in the place of light that is known otherwise, where that misses the tolerance of all light and paths know it better: as many as the tolerance asks
    /// for and the budget holds. None are traced on where those so far say that all would not be enough.
    pub fn improve(&mut self, (sun, eye): (DVec3, Toward), light: &mut [f64], errors: &mut [f64]) {
        let plan = self.plan.clone();
        let direct = self.thread.direct(sun, eye).unwrap_or_else(|| vec![0.0; light.len()]);
        let all: Vec<f64> = direct.iter().zip(&*light).map(|(d, l)| d + l).collect();
        if errors.iter().zip(&all).all(|(e, all)| *e <= plan.tolerance * all) {
            return;
        }
        self.thread.turn(sun);
        let nodes = light.len();
        let mut sums = Sums::new(nodes);
        let mut paths = self.thread.paths(&plan.active, plan.rest, plan.seed);
        let known: f64 = errors.iter().sum();
        let mut until = LEAST;
        loop {
            paths.trace(sun, eye, until, &mut sums);
            let sigma = (0..nodes).map(|s| sums.bounced(s).1).sum::<f64>();
            let enough = (0..nodes).all(|s| {
                let claimed = CLAIMED * sums.bounced(s).1 + sums.missing();
                claimed <= OF_TOLERANCE * plan.tolerance * all[s]
            });
            if enough || until >= plan.most_points {
                break;
            }
            if plan.claimed(sigma, until) > BETTER * known {
                return;
            }
            until *= 2;
        }
        let claimed = |s: usize| {
            let (mean, sigma) = sums.bounced(s);
            CLAIMED * sigma + sums.missing() + plan.nodes.error * mean
        };
        if (0..nodes).map(claimed).sum::<f64>() > BETTER * known {
            return;
        }
        for s in 0..nodes {
            let (mean, _) = sums.bounced(s);
            // Where the two exclude each other, neither is believed alone.
            let apart = (mean - light[s]).abs() - errors[s];
            (light[s], errors[s]) = (mean, claimed(s).max(apart));
        }
    }
}

/// The singly scattered light at the nodes.
#[derive(Debug)]
pub struct Direct<'a> {
    /// `None` where the exact sum would cost more than the paths, which know what their own surfaces send.
    evaluator: Option<Evaluator<'a>>,
    rho: Vec<Vec<f64>>,
    weights: Vec<f64>,
    light: Vec<f64>,
}

impl<'a> Direct<'a> {
    pub fn new(scene: &'a Scene, nm: &[f64]) -> Self {
        let few = scene.facets.len() <= MOST_EXACT;
        let evaluator = || {
            let mut evaluator = scene.evaluator();
            // It decides how many paths there are, no more.
            evaluator.set_curved_tolerance(ROUGH_DIRECT);
            evaluator.set_near_tolerance(ROUGH_DIRECT);
            evaluator
        };
        Self {
            evaluator: few.then(evaluator),
            rho: scene.spectra().map(|s| nm.iter().map(|nm| s.at(*nm)).collect()).collect(),
            weights: vec![0.0; scene.weight_count()],
            light: vec![0.0; nm.len()],
        }
    }

    /// For one pair of directions, m² sr⁻¹; `None` where it is not known.
    pub fn at(&mut self, sun: DVec3, eye: Toward) -> Option<&[f64]> {
        let view = match eye {
            Toward::Far(d) => View::Distant(d),
            Toward::Near(q) => View::At(q),
        };
        self.evaluator.as_mut()?.direct(sun, view, &mut self.weights).ok()?;
        self.light.fill(0.0);
        for (w, rho) in self.weights.iter().zip(&self.rho) {
            self.light.iter_mut().zip(rho).for_each(|(d, rho)| *d += w * rho);
        }
        Some(&self.light)
    }
}
