//! Patches of flat Lambert surfaces that do not move against each other: all that depends on the body alone is done once.

use super::BounceOptions;
use super::bound::Bound;
use super::cast::Caster;
use super::claim::{Claim, Trial};
use super::nodes::Nodes;
use super::optics::Optics;
use super::patches::{Patches, Room};
use super::paths::{Paths, Sums, mixed};
use super::pilot::Pilot;
use super::split;
use super::surfaces::Surfaces;
use super::transport::{self, Exchange, MOST_RAYS, Matrix, SCRAMBLES};
use crate::light::occlude::Toward;
use crate::light::{Evaluator, Scene};
use glam::DVec3;
use std::ops::Range;
use std::sync::Arc;

/// More surfaces than this are left to paths.
const MOST_SURFACES: usize = 300;
/// Patches at most, and numbers in all matrices.
const MOST_PATCHES: usize = 640;
const MOST_NUMBERS: usize = 16_000_000;
/// White is taken as a little darker: of a cavity that loses nothing there is no end.
const WHITEST: f64 = 1.0 - 1e-7;
/// Rays of each patch and scramble to begin with.
const LEAST_RAYS: u32 = 32;
/// The first cells, of which there are about as many as this; then cells this much smaller.
const FIRST_CELLS: f64 = 24.0;
const FINER: f64 = 1.5;
/// Standard errors that are claimed: Student's t of 7 degrees of freedom at 96 %.
const CLAIMED: f64 = 2.5;
/// Of the difference that patches of twice the size make, what is left: they converge with the square of the size at best. Held by the tests.
const DIFFERENCE: f64 = 1.0;
/// Paths of each pair and scramble against which patches are held.
const AGREEING: u32 = 512;
/// Of the tolerance, the part that patches and rays may take each.
const OF_TOLERANCE: f64 = 0.5;

/// What is done once.
#[derive(Debug)]
pub struct Still {
    nodes: Nodes,
    surfaces: Surfaces,
    patches: Patches,
    /// What of the patches and of the larger ones is not inside of another body, m².
    areas: [Vec<f64>; 2],
    /// Q for each node, and the same of the larger patches.
    fine: Vec<Matrix>,
    coarse: Vec<Matrix>,
    /// S of the larger patches by each scramble, less their mean; and that mean.
    scrambles: Vec<Matrix>,
    mean: Matrix,
    rays: u32,
    claim: Claim,
}

impl Still {
    /// `None` where the surfaces that exchange light move, are not flat, not Lambert or too many.
    pub fn new(
        scene: &Scene,
        surfaces: &Surfaces,
        bound: &Bound,
        nodes: &Nodes,
        pilot: &Pilot,
        options: &BounceOptions,
    ) -> Option<Self> {
        let optics = Optics::new(scene.materials(), &nodes.nm);
        let active = &bound.active;
        let first = &surfaces.list[*active.first()?];
        let still = |k: &usize| {
            let surface = &surfaces.list[*k];
            !surface.is_sphere()
                && surface.group == first.group
                && optics.lambert(surface.material).is_some()
        };
        // What moves could come between, too.
        let moves = surfaces.list.iter().any(|s| s.group != first.group);
        if moves || first.group != 0 || active.len() > MOST_SURFACES || !active.iter().all(still) {
            return None;
        }
        let area: f64 = active.iter().map(|k| surfaces.list[*k].area).sum();
        let caster = Caster::new(&surfaces.list, scene.touching_m);
        let brightest = brightest(&optics, surfaces, active);
        let pieces = split::pieces(&surfaces.list, active, scene.touching_m)?;
        let mut size = (area / FIRST_CELLS).sqrt();
        let seed = mixed(options.seed, 0x5e);
        let target = OF_TOLERANCE * options.tolerance;
        loop {
            let patches = Patches::new(&pieces, size);
            if patches.list.len() > MOST_PATCHES {
                return None;
            }
            let mut draft = Draft::new(scene, surfaces, patches, &optics, brightest);
            let mut rays = LEAST_RAYS;
            draft.shoot(&caster, rays, seed);
            let enough = draft.coarseness(pilot) <= target;
            // Many rays are worth their time for the last size alone.
            let last = enough || {
                let next = Patches::new(&pieces, size / FINER).list.len();
                next > MOST_PATCHES || next * next * nodes.nm.len() > MOST_NUMBERS
            };
            while last && draft.noise(pilot) > target && rays < MOST_RAYS {
                rays *= 2;
                draft.shoot(&caster, rays, seed);
            }
            if last {
                // Where patches are wrong by more than their size tells, paths do it.
                let nm = nodes.nm[brightest];
                let claim = draft.held(pilot, &caster, active, scene, nm, options.seed)?;
                return Some(draft.finish(&optics, nodes, claim));
            }
            size /= FINER;
        }
    }

    /// In words.
    pub fn describe(&self) -> String {
        let rays = self.rays as usize * SCRAMBLES;
        let (patches, left) =
            (self.patches.list.len(), 100.0 * self.claim.scale * self.claim.typical);
        format!("{patches} patches that leave {left:.1} % of it, form factors by {rays} rays each")
    }

    /// About a nanosecond for two numbers of a matrix, a tenth of a microsecond for a patch.
    pub fn cost_s(&self) -> f64 {
        let n = self.patches.list.len() as f64;
        1e-7 * n + 0.25e-9 * n * n * self.fine.len() as f64
    }
}

/// The node where most light is bounced.
fn brightest(optics: &Optics, surfaces: &Surfaces, active: &[usize]) -> usize {
    let sum = |s: usize| -> f64 {
        let rho = |k: &usize| optics.lambert(surfaces.list[*k].material).map_or(0.0, |r| r[s]);
        active.iter().map(|k| surfaces.list[*k].area * rho(k)).sum()
    };
    (0..optics.nodes).max_by(|a, b| sum(*a).total_cmp(&sum(*b))).unwrap_or(0)
}

/// Root of the mean square.
#[derive(Debug, Default)]
struct Rms {
    sum: f64,
    count: f64,
}

impl Rms {
    fn add(&mut self, value: f64) {
        self.sum += value * value;
        self.count += 1.0;
    }

    fn get(&self) -> f64 {
        (self.sum / self.count.max(1.0)).sqrt()
    }
}

/// Patches on trial.
struct Draft<'a> {
    scene: &'a Scene,
    surfaces: Surfaces,
    patches: Patches,
    exchange: Exchange,
    /// The cells of each surface.
    of_surface: Vec<Range<usize>>,
    /// Reflectances of the patches and the larger ones at the brightest node.
    rho: [Vec<f64>; 2],
    areas: [Vec<f64>; 2],
    scrambles: Vec<Matrix>,
    mean: Matrix,
}

impl<'a> Draft<'a> {
    fn new(
        scene: &'a Scene,
        surfaces: &Surfaces,
        patches: Patches,
        optics: &Optics,
        node: usize,
    ) -> Self {
        let mut of_surface = vec![0..0; surfaces.list.len()];
        let mut first = 0;
        for list in patches.of_surfaces() {
            of_surface[list[0].surface] = first..first + list.len();
            first += list.len();
        }
        let rho = reflectances(&patches, surfaces, optics, node);
        let exchange = Exchange::new(&patches);
        let surfaces = surfaces.clone();
        let (areas, scrambles, mean) = (Default::default(), Vec::new(), Vec::new());
        Self { scene, surfaces, patches, exchange, of_surface, rho, areas, scrambles, mean }
    }

    fn shoot(&mut self, caster: &Caster, rays: u32, seed: u32) {
        let (surfaces, patches) = (&self.surfaces, &self.patches);
        self.exchange.shoot(surfaces, caster, patches, &self.of_surface, rays, seed);
        let mut scrambles: Vec<Matrix> =
            (0..SCRAMBLES).map(|k| self.exchange.scramble(k)).collect();
        let n = scrambles[0].len();
        let share = 1.0 / SCRAMBLES as f64;
        self.mean = (0..n).map(|k| share * scrambles.iter().map(|s| s[k]).sum::<f64>()).collect();
        for scramble in &mut scrambles {
            scramble.iter_mut().zip(&self.mean).for_each(|(s, m)| *s -= m);
        }
        self.scrambles = scrambles;
        self.areas = self.exchange.open_areas(&self.patches);
    }

    /// The claimed error of the form factors of the pairs' light: root of the mean square over those that count.
    fn noise(&self, pilot: &Pilot) -> f64 {
        let mut views = Views::new(self.scene, &self.patches);
        let mut rms = Rms::default();
        for pair in pilot.pairs.iter().filter(|p| p.counts) {
            views.set(&self.surfaces, &self.patches, &self.areas, pair.sun, Toward::Far(pair.to));
            let noise = noise(&views, &self.mean, &self.scrambles);
            rms.add(noise * pair.bounced / (pair.direct + pair.bounced));
        }
        rms.get()
    }

    /// The same of what patches of twice the size change.
    fn coarseness(&self, pilot: &Pilot) -> f64 {
        let s = self.exchange.matrix(&self.patches);
        let Some([fine, coarse]) = both(&s, &self.patches, &self.areas, &self.rho) else {
            return f64::INFINITY;
        };
        let mut views = Views::new(self.scene, &self.patches);
        let mut rms = Rms::default();
        for pair in pilot.pairs.iter().filter(|p| p.counts) {
            views.set(&self.surfaces, &self.patches, &self.areas, pair.sun, Toward::Far(pair.to));
            let (light, error) = views.light(&fine, &coarse);
            rms.add(error / (pair.direct + light));
        }
        rms.get()
    }

    /// What patches may claim, held against light paths over all pairs; `None` where these find other light by more than the patches' size explains.
    fn held(
        &self,
        pilot: &Pilot,
        caster: &Caster,
        active: &[usize],
        scene: &Scene,
        nm: f64,
        seed: u32,
    ) -> Option<Claim> {
        let s = self.exchange.matrix(&self.patches);
        let [fine, coarse] = both(&s, &self.patches, &self.areas, &self.rho)?;
        let mut optics = Optics::new(scene.materials(), &[nm]);
        let mut views = Views::new(self.scene, &self.patches);
        let mut trials = Vec::with_capacity(pilot.pairs.len());
        for pair in &pilot.pairs {
            let to = Toward::Far(pair.to);
            views.set(&self.surfaces, &self.patches, &self.areas, pair.sun, to);
            let (light, left) = views.light(&fine, &coarse);
            let mut sums = Sums::new(1);
            let mut paths = Paths {
                surfaces: &self.surfaces,
                caster,
                optics: &mut optics,
                active,
                both_ends: false,
                seed: mixed(seed, 0xa9),
            };
            paths.trace(pair.sun, to, AGREEING, &mut sums);
            let (found, sigma) = sums.bounced(0);
            let noise = noise(&views, &self.mean, &self.scrambles) * light;
            trials.push(Trial { light, left, noise, found, sigma });
        }
        Claim::of(&trials)
    }

    fn finish(self, optics: &Optics, nodes: &Nodes, claim: Claim) -> Still {
        let s = self.exchange.matrix(&self.patches);
        let (mut fine, mut coarse) = (Vec::new(), Vec::new());
        for node in 0..nodes.nm.len() {
            let rho = reflectances(&self.patches, &self.surfaces, optics, node);
            // Nothing is whiter than `WHITEST`, so there is a solution.
            if let Some([f, c]) = both(&s, &self.patches, &self.areas, &rho) {
                fine.push(f);
                coarse.push(c);
            }
        }
        Still {
            nodes: nodes.clone(),
            rays: self.exchange.rays,
            claim,
            surfaces: self.surfaces,
            patches: self.patches,
            areas: self.areas,
            fine,
            coarse,
            scrambles: self.scrambles,
            mean: self.mean,
        }
    }
}

/// Of the patches and of the larger ones.
fn reflectances(
    patches: &Patches,
    surfaces: &Surfaces,
    optics: &Optics,
    node: usize,
) -> [Vec<f64>; 2] {
    let mut coarse = vec![0.0; patches.coarse_area.len()];
    let fine = patches
        .list
        .iter()
        .map(|patch| {
            let surface = &surfaces.list[patches.cells[patch.cells].surface];
            let rho = optics.lambert(surface.material).map_or(0.0, |r| r[node]).min(WHITEST);
            coarse[patch.coarse] = rho;
            rho
        })
        .collect();
    [fine, coarse]
}

/// Q of the patches and of the larger ones.
fn both(
    s: &Matrix,
    patches: &Patches,
    areas: &[Vec<f64>; 2],
    rho: &[Vec<f64>; 2],
) -> Option<[Matrix; 2]> {
    let fine = transport::solve(s, &areas[0], &rho[0])?;
    let gathered = transport::gathered(s, patches);
    let coarse = transport::solve(&gathered, &areas[1], &rho[1])?;
    Some([fine, coarse])
}

/// The claimed error of the form factors, relative.
fn noise(views: &Views, mean: &Matrix, scrambles: &[Matrix]) -> f64 {
    let whole = transport::between(&views.coarse[1], mean, &views.coarse[0]);
    if whole <= 0.0 {
        return 0.0;
    }
    let n = SCRAMBLES as f64;
    let square: f64 = scrambles
        .iter()
        .map(|s| transport::between(&views.coarse[1], s, &views.coarse[0]).powi(2))
        .sum();
    CLAIMED * (square / (n * (n - 1.0))).sqrt() / whole
}

/// What of each patch is lit (first) and seen (second), times the cosine.
#[derive(Debug)]
struct Views<'a> {
    evaluator: Evaluator<'a>,
    fine: [Vec<f64>; 2],
    coarse: [Vec<f64>; 2],
    room: Room,
}

impl<'a> Views<'a> {
    fn new(scene: &'a Scene, patches: &Patches) -> Self {
        let (n, m) = (patches.list.len(), patches.coarse_area.len());
        Self {
            evaluator: scene.evaluator(),
            fine: [vec![0.0; n], vec![0.0; n]],
            coarse: [vec![0.0; m], vec![0.0; m]],
            room: Room::default(),
        }
    }

    fn set(
        &mut self,
        surfaces: &Surfaces,
        patches: &Patches,
        areas: &[Vec<f64>; 2],
        sun: DVec3,
        eye: Toward,
    ) {
        for (end, toward) in [Toward::Far(sun), eye].into_iter().enumerate() {
            let (fine, coarse) = (&mut self.fine[end], &mut self.coarse[end]);
            fine.fill(0.0);
            coarse.fill(0.0);
            self.evaluator.prepare(toward);
            for list in patches.of_surfaces() {
                let surface = &surfaces.list[list[0].surface];
                let own = || list.iter().flat_map(|cells| cells.patches());
                // In front of the plane, from wherever it is looked at.
                let height = match toward {
                    Toward::Far(d) => d.dot(surface.normal),
                    Toward::Near(q) => (q - surface.origin).dot(surface.normal),
                };
                if height <= 0.0 {
                    continue;
                }
                match self.evaluator.open(surface.number, toward) {
                    None => own().for_each(|p| fine[p] = patches.list[p].area),
                    Some(open) => {
                        for (polygon, cells) in
                            open.iter().flat_map(|o| list.iter().map(move |c| (o, c)))
                        {
                            cells.share(polygon, list.len() == 1, &mut self.room, fine);
                        }
                    }
                }
                for p in own() {
                    if fine[p] == 0.0 {
                        continue;
                    }
                    let patch = &patches.list[p];
                    let scale = match toward {
                        Toward::Far(_) => height,
                        Toward::Near(q) => {
                            let away = q - surface.point(patch.middle);
                            let range2 = away.length_squared();
                            let cos = away.dot(surface.normal) / range2.sqrt();
                            cos * q.length_squared() / range2
                        }
                    };
                    let lit = scale * fine[p];
                    fine[p] = lit / areas[0][p];
                    coarse[patch.coarse] += lit / areas[1][patch.coarse];
                }
            }
        }
    }

    /// The light and what the size of the patches leaves open.
    fn light(&self, fine: &Matrix, coarse: &Matrix) -> (f64, f64) {
        let light = transport::between(&self.fine[1], fine, &self.fine[0]);
        let other = transport::between(&self.coarse[1], coarse, &self.coarse[0]);
        (light, DIFFERENCE * (light - other).abs())
    }
}

/// Patches with room to work in, for one thread.
#[derive(Debug)]
pub struct StillLight<'a> {
    still: Arc<Still>,
    views: Views<'a>,
}

impl<'a> StillLight<'a> {
    pub fn new(scene: &'a Scene, still: Arc<Still>) -> Self {
        let views = Views::new(scene, &still.patches);
        Self { still, views }
    }

    /// Adds weights and errors.
    pub fn add(&mut self, sun: DVec3, eye: Toward, weights: &mut [f64], errors: &mut [f64]) {
        let still = &*self.still;
        self.views.set(&still.surfaces, &still.patches, &still.areas, sun, eye);
        let noise = noise(&self.views, &still.mean, &still.scrambles);
        for (s, (fine, coarse)) in still.fine.iter().zip(&still.coarse).enumerate() {
            let (light, left) = self.views.light(fine, coarse);
            weights[s] += light;
            let left = still.claim.of_size(light, left);
            errors[s] += left + (noise + still.nodes.error + 1e-7) * light;
        }
    }
}
