//! Light from the Earth that is scattered twice or more.
//!
//! Where patches find what surfaces send to each other ([`super::still`]), they are as coarse as earthshine's part of all light allows, and the lit cap is a
//! few directions: those of the rule for earthshine that is scattered once ([`LitCap::rule`]), with more points until two rules agree. What all
//! of them bring to the patches is added up before it goes on from patch to patch, once.
//!
//! Otherwise light paths: the Earth is wide, so each few paths have a point of its lit cap of their own: a scrambled Sobol point, drawn over the same
//! panels ([`LitCap::at`]). Eight batches that do not know of each other give the error, of cap and paths together.
//!
//! There is as much of either as the tolerance of all light asks for, in full sunlight the light of the Sun among it.

use super::bound::Bound;
use super::nodes::Nodes;
use super::paths::{SCRAMBLES, Sums, mixed};
use super::still::{Effort, Still};
use super::surfaces::Surfaces;
use super::thread::Thread;
use super::tracing::Direct;
use super::views::Views;
use super::{Bounce, BounceError, BounceOptions, Way, directions};
use crate::light::earth::cap::LitCap;
use crate::light::occlude::Toward;
use crate::light::{DirectionError, EarthAlbedo, Effect, Lighting, Scene, Source, Term, shine};
use glam::DVec3;
use std::sync::Arc;

/// Batches that do not know of each other.
const BATCHES: usize = 8;
/// Points of each scramble for each direction: one path from either end.
const POINTS: u32 = 2;
/// Points of the cap of each batch at least.
const LEAST: u32 = 4;
/// Standard errors that are claimed: Student's t of 7 degrees of freedom at 99 %, since paths end where the error happens to look small.
const CLAIMED: f64 = 3.5;
/// Share of the tolerance that the claimed error of the paths may take.
const OF_TOLERANCE: f64 = 0.5;
/// Relative error allowed between nodes of wavelength: this light is a part of a part of all light.
const BETWEEN_NODES: f64 = 0.01;
/// Cost of a path, s, estimated for the report.
const PATH_S: f64 = 1e-6;
/// Points along each side of a panel of the cap, for patches.
const ORDERS: [usize; 3] = [1, 2, 3];
/// Directions of the rules that mostly do.
const DIRECTIONS: f64 = 20.0;
/// Share of the tolerance that patches may take, and by which two rules over the cap may differ.
const OF_PATCHES: f64 = 0.5;
/// The coarsest patches that are trusted, relative to the Earth's own light.
const COARSEST: f64 = 0.05;

/// Preparation that stays the same from epoch to epoch.
#[derive(Debug)]
pub(in crate::light) struct Earthlit {
    surfaces: Surfaces,
    active: Vec<usize>,
    nodes: Nodes,
    options: BounceOptions,
    shape_error: f64,
    earth: Arc<EarthAlbedo>,
    /// Where patches do it, with what the look at them says that an epoch of one direction costs, s.
    patches: Option<(Arc<Still>, f64)>,
}

impl Earthlit {
    /// Prepares a scene; `shape_error` is that of the facets of a [`super::StandIn`], relative, `share` the most that earthshine is of sunlight. `None` where
    /// no surface sees another.
    ///
    /// # Errors
    /// Materials without common wavelengths.
    pub fn new(
        scene: &Scene,
        options: &BounceOptions,
        (shape_error, share): (f64, f64),
        earth: &Arc<EarthAlbedo>,
    ) -> Result<Option<Self>, BounceError> {
        let surfaces = Surfaces::new(scene);
        let active = Bound::new(scene, &surfaces.list).active;
        if active.is_empty() {
            return Ok(None);
        }
        let among = surfaces.materials(active.iter().copied());
        let mut nodes = Nodes::new(scene.materials(), &among, BETWEEN_NODES)?;
        let coarse = OF_PATCHES * options.tolerance / share.max(f64::MIN_POSITIVE);
        let tolerance = coarse.clamp(OF_PATCHES * options.tolerance, COARSEST);
        let bounce =
            Bounce::with_effort(scene, &BounceOptions { tolerance, ..*options }, &Effort::EARTH)?;
        let patches = match &bounce.way {
            Way::Still(still) if still.is_whole() => {
                nodes = still.nodes().clone();
                Some((still.clone(), bounce.need.cost_s.unwrap_or(0.0)))
            }
            _ => None,
        };
        let (options, earth) = (*options, earth.clone());
        Ok(Some(Self { surfaces, active, nodes, options, shape_error, earth, patches }))
    }

    /// For the same body in other reflectances, with the same terms; `None` where these do not do, or light is never lost.
    pub fn recoloured(&self, scene: &Scene) -> Option<Self> {
        let among = self.surfaces.materials(self.active.iter().copied());
        let nodes = self.nodes.again(scene.materials(), &among)?;
        let patches = match &self.patches {
            Some((still, cost_s)) => Some((Arc::new(still.recoloured(scene)?), *cost_s)),
            None => None,
        };
        let (surfaces, active) = (self.surfaces.clone(), self.active.clone());
        let earth = self.earth.clone();
        let Self { options, shape_error, .. } = *self;
        Some(Self { surfaces, active, nodes, options, shape_error, earth, patches })
    }

    /// Returns the terms: those of all nodes for each layer of the Earth.
    ///
    /// # Errors
    /// Spectra that have no product.
    pub fn terms(&self) -> Result<Vec<Term>, BounceError> {
        let mut terms = Vec::new();
        for layer in self.earth.spectra()? {
            for hat in self.nodes.spectra()? {
                let spectrum = shine::product(&layer, &hat)?;
                terms.push(Term { source: Source::Earthshine, material: None, spectrum });
            }
        }
        Ok(terms)
    }

    /// How many there are.
    fn count(&self) -> usize {
        self.earth.layers() * self.nodes.nm.len()
    }

    /// In words.
    pub fn describe(&self) -> String {
        let wavelengths = self.nodes.nm.len();
        match &self.patches {
            Some((still, _)) => format!("{}, {wavelengths} wavelengths", still.describe()),
            None => {
                format!("up to {} light paths an epoch, {wavelengths} wavelengths", self.paths())
            }
        }
    }

    /// Seconds an epoch at most, estimated.
    pub fn cost_s(&self) -> f64 {
        match self.patches {
            Some((_, direction_s)) => DIRECTIONS * self.earth.layers() as f64 * direction_s,
            None => PATH_S * f64::from(self.paths()),
        }
    }

    /// Points of the cap of each batch at most.
    fn most(&self) -> u32 {
        (self.options.most_paths / (BATCHES as u32 * SCRAMBLES * POINTS)).max(LEAST)
    }

    fn paths(&self) -> u32 {
        // A cap has two panels at most.
        2 * self.most() * BATCHES as u32 * SCRAMBLES * POINTS
    }
}

/// Bounced earthshine of a scene, for one thread.
#[derive(Debug)]
pub(in crate::light) struct EarthlitLight<'a> {
    plan: Arc<Earthlit>,
    room: Room<'a>,
}

#[derive(Debug)]
enum Room<'a> {
    Patches { still: Arc<Still>, views: Box<Views<'a>>, direct: Box<Direct<'a>> },
    Paths(Box<Thread<'a>>),
}

impl<'a> EarthlitLight<'a> {
    /// Creates the light of the scene that the plan was made for.
    pub fn new(scene: &'a Scene, plan: Arc<Earthlit>) -> Self {
        let room = match &plan.patches {
            Some((still, _)) => Room::Patches {
                still: still.clone(),
                views: Box::new(still.views(scene)),
                direct: Box::new(Direct::new(scene, &plan.nodes.nm)),
            },
            None => {
                let thread = Thread::new(scene, &plan.surfaces, &plan.active, &plan.nodes.nm);
                Room::Paths(Box::new(thread))
            }
        };
        Self { plan, room }
    }
}

impl Effect for EarthlitLight<'_> {
    fn add(
        &mut self,
        lighting: &Lighting,
        weights: &mut [f64],
        errors: &mut [f64],
    ) -> Result<(), DirectionError> {
        let (nodes, expected) = (self.plan.nodes.nm.len(), self.plan.count());
        for found in [weights.len(), errors.len()] {
            if found != expected {
                return Err(DirectionError::Room { found, expected });
            }
        }
        let Some(globe) = &lighting.earth else { return Ok(()) };
        let cap = LitCap::new(globe, &self.plan.earth);
        let ends = directions(lighting.sun_body, lighting.view)?;
        // Weights stand before the Earth's spectrum.
        let beside = lighting.sunlit / self.plan.earth.largest_factor().max(f64::MIN_POSITIVE);
        match &mut self.room {
            Room::Patches { still, views, direct } => {
                let known = direct.at(ends.0, ends.1).map(<[f64]>::to_vec);
                let sunlight = |s: usize| known.as_ref().map_or(0.0, |d| beside * d[s % nodes]);
                let found = by_patches(still, views, (&cap, ends.1), &|s, light, apart| {
                    apart <= OF_PATCHES * self.plan.options.tolerance * (sunlight(s) + light)
                });
                for (s, (light, error)) in found.into_iter().enumerate() {
                    weights[s] += light;
                    errors[s] += error + self.plan.shape_error * light;
                }
            }
            Room::Paths(thread) => {
                self.plan.by_paths(thread, (&cap, ends), beside, (weights, errors));
            }
        }
        Ok(())
    }
}

/// The light by patches and its claimed error in each layer at each node, m² sr⁻¹; `agree` says whether light is known well enough by how far two rules are apart.
fn by_patches(
    still: &Still,
    views: &mut Views,
    (cap, eye): (&LitCap, Toward),
    agree: &dyn Fn(usize, f64, f64) -> bool,
) -> Vec<(f64, f64)> {
    let mut before: Option<Vec<f64>> = None;
    let mut out = Vec::new();
    still.see(views, eye);
    for order in ORDERS {
        let rule = cap.rule(order);
        let mut found = Vec::new();
        for layer in 0..cap.layers() {
            found.extend(still.found(views, &rule.of_layer(layer)));
        }
        if let Some(before) = &before {
            let apart = |(s, f): (usize, &(f64, f64))| (f.0 - before[s]).abs();
            let errors: Vec<f64> = found.iter().enumerate().map(apart).collect();
            let enough = errors.iter().enumerate().all(|(s, apart)| agree(s, found[s].0, *apart));
            out = found.iter().zip(errors).map(|((l, e), apart)| (*l, e + apart)).collect();
            if enough {
                break;
            }
        }
        before = Some(found.iter().map(|f| f.0).collect());
    }
    out
}

impl Earthlit {
    /// Adds the light by paths.
    fn by_paths(
        &self,
        thread: &mut Thread,
        (cap, (sun, eye)): (&LitCap, (DVec3, Toward)),
        beside: f64,
        (weights, errors): (&mut [f64], &mut [f64]),
    ) {
        let (plan, nodes, count) = (self, self.nodes.nm.len(), self.count());
        thread.turn(sun);
        let direct = thread.direct(sun, eye);
        let sunlight = |s: usize| direct.as_ref().map_or(0.0, |d| beside * d[s % nodes]);
        let mut tally = Tally::new(nodes, cap.layers());
        let mut until = LEAST.min(plan.most());
        loop {
            for batch in 0..BATCHES {
                for index in tally.points..until {
                    let seed = mixed(mixed(plan.options.seed, 0xea), batch as u32);
                    let u = sobol_burley::sample_4d(index, 0, seed).map(f64::from);
                    let rule = cap.at([2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0]);
                    for (panel, (toward, irradiance)) in rule.nodes.iter().enumerate() {
                        let mut sums = Sums::new(plan.nodes.nm.len());
                        let seed = mixed(seed, 2 * index + panel as u32 + 1);
                        let mut paths = thread.paths(&plan.active, false, seed);
                        paths.trace(*toward, eye, POINTS, &mut sums);
                        tally.add(batch, *irradiance, rule.lights(panel), sums);
                    }
                }
            }
            tally.points = until;
            let missing = tally.missing();
            let enough = (0..count).all(|s| {
                let (mean, sigma) = tally.mean(s);
                let wanted = OF_TOLERANCE * plan.options.tolerance * (sunlight(s) + mean);
                CLAIMED * sigma + missing <= wanted
            });
            if enough || until >= plan.most() {
                break;
            }
            until = (2 * until).min(plan.most());
        }
        for s in 0..count {
            let (mean, sigma) = tally.mean(s);
            weights[s] += mean;
            errors[s] +=
                CLAIMED * sigma + tally.missing() + (plan.nodes.error + plan.shape_error) * mean;
        }
    }
}

/// Sums over the batches so far.
#[derive(Debug)]
struct Tally {
    nodes: usize,
    layers: usize,
    /// Points of the cap of each batch.
    points: u32,
    /// For each batch, layer and node.
    light: Vec<f64>,
    irradiance: f64,
    sums: Vec<Sums>,
}

impl Tally {
    fn new(nodes: usize, layers: usize) -> Self {
        let light = vec![0.0; BATCHES * layers * nodes];
        Self { nodes, layers, points: 0, light, irradiance: 0.0, sums: Vec::new() }
    }

    fn add(&mut self, batch: usize, irradiance: f64, lights: &[f64], sums: Sums) {
        let of_batch = &mut self.light[batch * self.layers * self.nodes..];
        for (layer, own) in of_batch.chunks_exact_mut(self.nodes).zip(lights) {
            for (s, light) in layer.iter_mut().enumerate() {
                *light += own * sums.bounced(s).0;
            }
        }
        self.irradiance += irradiance;
        self.sums.push(sums);
    }

    /// Mean over the batches and its standard error, m² sr⁻¹.
    fn mean(&self, term: usize) -> (f64, f64) {
        let (n, each) = (BATCHES as f64, f64::from(self.points.max(1)));
        let values =
            || self.light.iter().skip(term).step_by(self.layers * self.nodes).map(|l| l / each);
        let mean = values().sum::<f64>() / n;
        let square: f64 = values().map(|v| (v - mean) * (v - mean)).sum();
        (mean, (square / (n * (n - 1.0))).sqrt())
    }

    /// Returns the light that may be missing where few paths found anything, m² sr⁻¹.
    fn missing(&self) -> f64 {
        let irradiance = self.irradiance / (BATCHES as f64 * f64::from(self.points.max(1)));
        irradiance * Sums::missing_of(&self.sums)
    }
}
