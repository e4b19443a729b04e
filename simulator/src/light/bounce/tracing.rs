//! Paths for each epoch: as many as the tolerance asks for.

use super::BounceOptions;
use super::cast::Caster;
use super::nodes::Nodes;
use super::optics::Optics;
use super::paths::{MOST_POINTS, Paths, SCRAMBLES, Sums, mixed};
use super::pilot::Pilot;
use super::surfaces::Surfaces;
use crate::light::Scene;
use crate::light::occlude::Toward;
use glam::DVec3;
use std::sync::Arc;

/// Paths of each scramble at least.
const LEAST: u32 = 16;
/// Standard errors that are claimed: Student's t of 7 degrees of freedom at 99 %.
const CLAIMED: f64 = 3.5;
/// Of the tolerance, the part that the claimed error of the paths may take.
const OF_TOLERANCE: f64 = 0.7;
/// Cost of a path, s, estimated for the report.
const PATH_S: f64 = 1e-6;

/// What does not change from epoch to epoch.
#[derive(Debug)]
pub struct Plan {
    surfaces: Surfaces,
    active: Vec<usize>,
    nodes: Nodes,
    tolerance: f64,
    both_ends: bool,
    seed: u32,
}

impl Plan {
    pub fn new(
        scene: &Scene,
        surfaces: Surfaces,
        active: Vec<usize>,
        nodes: &Nodes,
        options: &BounceOptions,
    ) -> Self {
        let optics = Optics::new(scene.materials(), &nodes.nm);
        let both_ends =
            active.iter().any(|k| optics.lambert(surfaces.list[*k].material).is_none());
        let (tolerance, seed) = (options.tolerance, mixed(options.seed, 0x7a));
        Self { surfaces, active, nodes: nodes.clone(), tolerance, both_ends, seed }
    }

    /// In words.
    pub fn describe(&self) -> String {
        "light paths for each epoch".into()
    }

    /// By how many paths the first look would have wanted in the mean of its pairs.
    pub fn cost_s(&self, pilot: &Pilot) -> f64 {
        let (mut paths, mut pairs) = (0.0, 0.0_f64);
        for pair in pilot.pairs.iter().filter(|p| p.counts) {
            let wanted = OF_TOLERANCE * self.tolerance * (pair.direct + pair.bounced);
            let more = (CLAIMED * pair.sigma / wanted).powi(2) * 64.0;
            paths += f64::from(SCRAMBLES) * more.clamp(f64::from(LEAST), f64::from(MOST_POINTS));
            pairs += 1.0;
        }
        PATH_S * paths / pairs.max(1.0)
    }
}

/// Paths of one thread.
#[derive(Debug)]
pub struct Tracing<'a> {
    scene: &'a Scene,
    plan: Arc<Plan>,
    surfaces: Surfaces,
    caster: Caster,
    optics: Optics,
}

impl<'a> Tracing<'a> {
    pub fn new(scene: &'a Scene, plan: Arc<Plan>) -> Self {
        let surfaces = plan.surfaces.clone();
        let caster = Caster::new(&surfaces.list, scene.touching_m);
        let optics = Optics::new(scene.materials(), &plan.nodes.nm);
        Self { scene, plan, surfaces, caster, optics }
    }

    /// Adds weights and errors. Paths are traced until the claimed error is below its part of the tolerance, of the light that the paths themselves have found.
    pub fn add(&mut self, sun: DVec3, eye: Toward, weights: &mut [f64], errors: &mut [f64]) {
        if self.surfaces.turn(self.scene, sun) {
            self.caster = Caster::new(&self.surfaces.list, self.scene.touching_m);
        }
        let plan = &*self.plan;
        let nodes = plan.nodes.nm.len();
        let mut sums = Sums::new(nodes);
        let mut paths = Paths {
            surfaces: &self.surfaces,
            caster: &self.caster,
            optics: &mut self.optics,
            active: &plan.active,
            both_ends: plan.both_ends,
            seed: plan.seed,
        };
        let mut until = LEAST;
        loop {
            paths.trace(sun, eye, until, &mut sums);
            let enough = (0..nodes).all(|s| {
                let (mean, sigma) = sums.bounced(s);
                let light = sums.direct(s) + mean;
                CLAIMED * sigma <= OF_TOLERANCE * plan.tolerance * light
            });
            if enough || until >= MOST_POINTS {
                break;
            }
            until *= 2;
        }
        for s in 0..nodes {
            let (mean, sigma) = sums.bounced(s);
            weights[s] += mean;
            errors[s] += CLAIMED * sigma + plan.nodes.error * mean;
        }
    }
}
