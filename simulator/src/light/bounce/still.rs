//! Patches of flat surfaces that do not move against each other: all that depends on the body alone is done once.

use super::BounceOptions;
use super::bound::Bound;
use super::cast::Caster;
use super::clear::Clear;
use super::draft::Draft;
use super::nodes::Nodes;
use super::optics::Optics;
use super::orders::{Found, Orders, brightest};
use super::pilot::{self, Pilot};
use super::split;
use super::surfaces::Surfaces;
use super::tracing::{Plan, Tracing};
use super::transport::SCRAMBLES;
use super::views::{Patched, Views};
use super::{claim::Claim, patches::Patches, paths::mixed};
use crate::light::Scene;
use crate::light::occlude::Toward;
use crate::surface::Width;
use glam::DVec3;
use std::sync::Arc;

/// More surfaces than this are left to paths.
const MOST_SURFACES: usize = 300;
/// Rays of each patch and scramble to begin with, and directions of a rough surface and scramble.
const LEAST_RAYS: u32 = 32;
const LEAST_CHORDS: u32 = 16;
/// Error that rays may leave, as a share of the error by the patches' size.
const OF_COARSENESS: f64 = 0.3;
/// The first cells, of which there are about as many as this; then cells this much smaller.
const FIRST_CELLS: f64 = 24.0;
const FINER: f64 = 1.5;
/// Light paths of an epoch beside which [`Effort::SUN`] is reasonable; the fewest and the most patches for others, and how many times as much as that is done at most where paths are many.
const USUAL_PATHS: f64 = 4096.0;
const LEAST_PATCHES: f64 = 64.0;
const MOST_PATCHES: f64 = 2000.0;
const MOST_SPARE: f64 = 20.0;
/// Diffuse patches, and all where the budget has paths to spare besides, may state so many times the error of paths before these take their place: they cost a hundredth.
const KEPT_OF_PATHS: f64 = 2.0;
/// Times as many numbers in matrices at most: 250 MB while they are made.
const MOST_SPARE_NUMBERS: f64 = 4.0;
/// Matrices that many wavelengths take.
const USUAL_MATRICES: usize = 40;
/// Shares of the tolerance that patches and rays may take.
const OF_TOLERANCE: f64 = 0.5;
const OF_RAYS: f64 = 0.3;

/// Limits of the cost of an epoch of one direction, and when this cost is worth it.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Patches at most.
    pub patches: usize,
    /// Directions for which materials are asked at most.
    pub asked: usize,
    /// Rays of rough patches that meet anything, at most: some nanoseconds each in an epoch.
    pub meetings: usize,
    /// Numbers in all matrices at most.
    pub numbers: usize,
    /// Pairs of surfaces whose exchange is exact at most.
    pub clear: usize,
    /// Error that patches may state where they do not meet the tolerance, as a share of the error that paths would state: where paths would know it better, they are traced besides,
    /// direction by direction, and a pass has many that patches know well.
    pub of_paths: f64,
    /// Least relative error between nodes of wavelength: less is not worth the work.
    pub between: f64,
}

impl Effort {
    /// For the Sun: a few milliseconds.
    pub const SUN: Self = Self {
        patches: 640,
        asked: 20_000,
        meetings: 200_000,
        numbers: 16_000_000,
        clear: 200,
        of_paths: 0.5,
        between: 1e-4,
    };

    /// For the Sun, with so many light paths to spare: an epoch of patches costs about as their number squared, or as the directions of rough ones.
    pub fn of_sun(paths: u32) -> Self {
        let spare = f64::from(paths) / USUAL_PATHS;
        // Solving them grows with the third power, so that many more paths allow somewhat more patches.
        let root = if spare > 1.0 { spare.powf(0.25) } else { spare.sqrt() };
        let patches = (root * Self::SUN.patches as f64).clamp(LEAST_PATCHES, MOST_PATCHES);
        let times = |usual: usize, most: f64| (usual as f64 * spare.clamp(1.0, most)) as usize;
        Self {
            patches: patches as usize,
            asked: times(Self::SUN.asked, MOST_SPARE),
            meetings: times(Self::SUN.meetings, MOST_SPARE),
            numbers: times(Self::SUN.numbers, MOST_SPARE_NUMBERS),
            of_paths: if spare > 1.0 { KEPT_OF_PATHS } else { Self::SUN.of_paths },
            ..Self::SUN
        }
    }

    /// For each of the Earth's directions: some 50 µs.
    pub const EARTH: Self = Self {
        patches: 100,
        asked: 400,
        clear: 0,
        of_paths: f64::INFINITY,
        between: 0.01,
        ..Self::SUN
    };
}

/// Preparation that is done once.
#[derive(Debug)]
pub struct Still {
    nodes: Nodes,
    patched: Patched,
    orders: Orders,
    rays: u32,
    seed: u32,
    /// The node of the trials.
    node: usize,
    claim: Claim,
    /// The paths of what is left, where there is anything.
    rest: Option<Arc<Plan>>,
    /// The paths of all light, where the budget holds so many that they may know it better than patches do.
    beyond: Option<Arc<Plan>>,
    /// How many times the light paths of an epoch would have to be more to know it as well as patches do.
    as_good: f64,
}

impl Still {
    /// `None` where the surfaces that exchange light move, are not flat, are mirrors or too many; where paths find other light; and where paths
    /// state a smaller error and this does not meet the tolerance.
    pub fn new(
        scene: &Scene,
        surfaces: &Surfaces,
        bound: &Bound,
        nodes: &Nodes,
        pilot: &Pilot,
        (options, effort): (&BounceOptions, &Effort),
    ) -> Option<Self> {
        let optics = Optics::new(scene.materials(), &nodes.nm);
        let active = &bound.active;
        let still = |k: &usize| {
            let surface = &surfaces.list[*k];
            let mirror = matches!(optics.material(surface.material).width(), Width::Mirror(_));
            !surface.is_sphere() && !mirror
        };
        // What moves could come between, too.
        let moves = surfaces.list.iter().any(|s| s.group != 0);
        if moves || active.len() > MOST_SURFACES || !active.iter().all(still) {
            return None;
        }
        let lambert = |k: &usize| optics.lambert(surfaces.list[*k].material).is_some();
        let (diffuse, rough): (Vec<usize>, Vec<usize>) = active.iter().partition(|k| lambert(k));
        let area: f64 = active.iter().map(|k| surfaces.list[*k].area).sum();
        let caster = Caster::new(&surfaces.list, scene.touching_m);
        let node = brightest(&optics, surfaces, active);
        let clear = Arc::new(Clear::new(surfaces, &diffuse, scene.touching_m, effort.clear));
        let pieces = |of: &[usize]| split::pieces(&surfaces.list, of, scene.touching_m);
        let (diffuse, rough) = (pieces(&diffuse)?, pieces(&rough)?);
        let cells = |size: f64| Patches::new([&diffuse, &rough], size);
        let first = (area / FIRST_CELLS).sqrt();
        let mut size = first;
        let seed = mixed(options.seed, 0x5e);
        let target = OF_TOLERANCE * options.tolerance;
        loop {
            let patches = cells(size);
            if patches.list.len() > effort.patches && size < first {
                return None;
            }
            let mut draft = Draft::new(
                scene,
                surfaces,
                patches,
                &caster,
                &optics,
                (node, nodes.nm.len()),
                clear.clone(),
            );
            let (mut rays, mut chords) = (LEAST_RAYS, LEAST_CHORDS);
            draft.shoot(rays, chords, seed);
            let mut look = draft.look(pilot);
            // Many rays are worth their time for the last size alone.
            let last = look.coarseness <= target || {
                let next = cells(size / FINER);
                let numbers = next.diffuse[0].pow(2) * nodes.nm.len().min(USUAL_MATRICES);
                next.list.len() > effort.patches || numbers > effort.numbers
            };
            if !last {
                size /= FINER;
                continue;
            }
            // Nothing is gained by far less noise than the patches' size leaves open.
            let enough = (OF_RAYS * options.tolerance).max(OF_COARSENESS * look.coarseness);
            loop {
                let more_rays = if look.factors > enough { draft.more_rays(rays) } else { rays };
                let more_chords =
                    if look.chords > enough { draft.more_chords(chords, effort) } else { chords };
                if (more_rays, more_chords) == (rays, chords) {
                    break;
                }
                (rays, chords) = (more_rays, more_chords);
                draft.shoot(rays, chords, seed);
                look = draft.look(pilot);
            }
            // Where patches are wrong by more than their size tells, paths do it.
            let all = Plan::new(surfaces.clone(), active.clone(), nodes, options);
            let looked = (pilot, look);
            let (claim, stated) = draft.held(looked, active, &all, nodes.nm[node], options.seed)?;
            let by_paths = pilot.stated(|s| all.claimed(s, pilot::POINTS));
            let of_paths =
                if rough.is_empty() { effort.of_paths.max(KEPT_OF_PATHS) } else { effort.of_paths };
            if stated > options.tolerance.max(of_paths * by_paths) {
                return None;
            }
            let plan = || Plan::new(surfaces.clone(), active.clone(), nodes, options);
            let rest = draft.leaves_a_rest().then(|| Arc::new(plan().of_rest()));
            let as_good = (by_paths / stated.max(f64::MIN_POSITIVE)).powi(2);
            let beyond = (as_good < 1.0 && effort.clear > 0).then(|| Arc::new(all));
            let (patched, orders) = draft.finish(nodes)?;
            let nodes = nodes.clone();
            return Some(Self {
                nodes,
                patched,
                orders,
                rays,
                seed,
                node,
                claim,
                rest,
                beyond,
                as_good,
            });
        }
    }

    /// The same patches, rays and wavelengths for the same body in other reflectances. What was found on trial is taken to hold for these. `None` where light is never lost,
    /// or is less linear between the wavelengths.
    pub fn recoloured(&self, scene: &Scene) -> Option<Self> {
        let Patched { surfaces, patches, .. } = &self.patched;
        let among = surfaces.materials(patches.cells.iter().map(|cells| cells.surface));
        let nodes = self.nodes.again(scene.materials(), &among)?;
        let optics = Optics::new(scene.materials(), &nodes.nm);
        let patched = self.patched.clone();
        let caster = Caster::new(&self.patched.surfaces.list, scene.touching_m);
        let of = (self.node, nodes.nm.len());
        let mut draft = Draft::of(scene, patched, &caster, &optics, of);
        draft.shoot(self.rays, self.patched.chords.each, self.seed);
        let (patched, orders) = draft.finish(&nodes)?;
        let (rest, beyond) = (self.rest.clone(), self.beyond.clone());
        let Self { rays, seed, node, claim, as_good, .. } = *self;
        Some(Self { nodes, patched, orders, rays, seed, node, claim, rest, beyond, as_good })
    }

    /// In words.
    pub fn describe(&self) -> String {
        let rays = self.rays as usize * SCRAMBLES;
        let (patches, left) =
            (self.patched.patches.list.len(), 100.0 * self.claim.scale * self.claim.typical);
        let rough = match self.patched.chords.each as usize * SCRAMBLES {
            _ if self.patched.chords.channels.is_empty() => String::new(),
            directions => format!(", lobes along {directions} directions"),
        };
        let rest = if self.rest.is_some() { ", light paths between lobes" } else { "" };
        let beyond = match self.beyond {
            Some(_) => ", light paths where that misses the tolerance".into(),
            None if self.as_good.is_finite() && self.as_good > 1.0 => {
                format!(
                    ", light paths would know it better from {:.0} times the budget on",
                    self.as_good.ceil()
                )
            }
            None => String::new(),
        };
        format!(
            "{patches} patches that leave {left:.1} % of it, form factors by {rays} rays each{rough}{rest}{beyond}"
        )
    }

    /// About a nanosecond for two numbers of a matrix, a tenth of a microsecond for a patch, some nanoseconds for what a direction
    /// meets and ten times that for a material that is asked.
    pub fn cost_s(&self, pilot: &Pilot) -> f64 {
        let n = self.patched.patches.list.len() as f64;
        let diffuse = self.patched.patches.diffuse[0] as f64;
        let meetings = self.patched.chords.meetings() as f64;
        let asked = 2.0 * 5e-8 * self.patched.chords.asked() as f64;
        let matrices = 0.5e-9 * diffuse * diffuse * self.orders.matrices() as f64;
        1e-7 * n
            + matrices
            + 5e-9 * meetings
            + asked
            + self.rest.as_ref().map_or(0.0, |r| r.cost_s(pilot))
    }
}

/// Patches with room to work in, for one thread.
#[derive(Debug)]
pub struct StillLight<'a> {
    still: Arc<Still>,
    views: Views<'a>,
    rest: Option<Box<Tracing<'a>>>,
    beyond: Option<Box<Tracing<'a>>>,
}

impl<'a> StillLight<'a> {
    pub fn new(scene: &'a Scene, still: Arc<Still>) -> Self {
        let paths = |plan: &Arc<Plan>| Box::new(Tracing::new(scene, plan.clone()));
        let (rest, beyond) = (still.rest.as_ref().map(paths), still.beyond.as_ref().map(paths));
        Self { views: still.views(scene), rest, beyond, still }
    }

    /// Adds weights and errors.
    pub fn add(&mut self, sun: DVec3, eye: Toward, weights: &mut [f64], errors: &mut [f64]) {
        self.still.see(&mut self.views, eye);
        let found = self.still.found(&mut self.views, &[(sun, 1.0)]);
        let (mut light, mut off): (Vec<f64>, Vec<f64>) = found.into_iter().unzip();
        if let Some(rest) = &mut self.rest {
            let beside = light.clone();
            rest.add((sun, eye), Some(&beside), &mut light, &mut off);
        }
        if let Some(beyond) = &mut self.beyond {
            beyond.improve((sun, eye), &mut light, &mut off);
        }
        for s in 0..light.len() {
            weights[s] += light[s];
            errors[s] += off[s];
        }
    }
}

impl Still {
    /// The wavelengths.
    pub fn nodes(&self) -> &Nodes {
        &self.nodes
    }

    /// Whether patches find all light.
    pub fn is_whole(&self) -> bool {
        self.rest.is_none()
    }

    /// Room to look at the scene in that this was made for.
    pub fn views<'a>(&self, scene: &'a Scene) -> Views<'a> {
        Views::new(scene, &self.patched)
    }

    /// Looks from the observer, for all that is [`Still::found`] until the next look.
    pub fn see(&self, views: &mut Views, eye: Toward) {
        views.see(&self.patched, eye);
    }

    /// Returns the light that patches find for some directions, each times its irradiance, and its claimed error, at each node, m² sr⁻¹.
    pub fn found(&self, views: &mut Views, from: &[(DVec3, f64)]) -> Vec<(f64, f64)> {
        let found = views.between(&self.patched, &self.orders, from);
        found.iter().map(|f| (f.light, self.claimed(f))).collect()
    }

    /// The claimed error of what was found, m² sr⁻¹.
    fn claimed(&self, found: &Found) -> f64 {
        let left = self.claim.of_size(found.light, found.left);
        left + found.noise() + (self.nodes.error + 1e-7) * found.light
    }
}
