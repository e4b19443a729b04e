//! Patches on trial: how coarse they are, how noisy, and whether light paths find the same.

use super::cast::Caster;
use super::chords::Chords;
use super::claim::{Claim, Trial};
use super::clear::Clear;
use super::nodes::Nodes;
use super::optics::Optics;
use super::orders::{Found, Orders};
use super::patches::Patches;
use super::paths::{Paths, Sums, mixed};
use super::pilot::{self, Pair, Pilot, TOGETHER};
use super::still::Effort;
use super::surfaces::Surfaces;
use super::tracing::Plan;
use super::transport::{Between, Exchange, LEAST_OPEN, MOST_RAYS, SCRAMBLES};
use super::views::{Patched, Views};
use crate::light::Scene;
use crate::light::occlude::Toward;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Paths of each pair and scramble against which patches are held at most.
const AGREEING: u32 = 512;
/// Standard error of those paths that is small enough, as a share of the patches' claims (roots of the sums of squares over all pairs): beyond it more paths say nothing new.
const OF_CLAIMS: f64 = 0.6;

/// Rays for the directions of all rough patches at most: half a second.
const MOST_CHORDS: usize = 1 << 20;
/// Rays of all diffuse patches at most, where some are followed further: a second.
const MOST_FOLLOWED: usize = 1 << 21;

/// Patches on trial.
pub struct Draft<'a> {
    scene: &'a Scene,
    caster: &'a Caster,
    optics: &'a Optics,
    patched: Patched,
    exchange: Exchange,
    /// The cells of each surface.
    of_surface: Vec<Range<usize>>,
    /// The node of the trials.
    node: usize,
}

/// Errors over all pairs of directions, relative to all light: roots of the mean squares.
#[derive(Debug, Clone)]
pub struct Look {
    /// The light of all pairs; none where light is never lost.
    found: Vec<Found>,
    /// Change of the light with patches of twice the size.
    pub coarseness: f64,
    /// The claimed error of form factors, and of the directions of rough surfaces.
    pub factors: f64,
    pub chords: f64,
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

impl<'a> Draft<'a> {
    pub fn new(
        scene: &'a Scene,
        surfaces: &Surfaces,
        patches: Patches,
        caster: &'a Caster,
        optics: &'a Optics,
        (node, nodes): (usize, usize),
        clear: Arc<Clear>,
    ) -> Self {
        let surfaces = surfaces.clone();
        let (areas, chords) = Default::default();
        let patched = Patched { surfaces, patches, areas, chords, clear };
        Self::of(scene, patched, caster, optics, (node, nodes))
    }

    /// With patches, and directions of rough surfaces, that are there.
    pub fn of(
        scene: &'a Scene,
        patched: Patched,
        caster: &'a Caster,
        optics: &'a Optics,
        (node, nodes): (usize, usize),
    ) -> Self {
        let mut of_surface = vec![0..0; patched.surfaces.list.len()];
        let mut first = 0;
        for list in patched.patches.of_surfaces() {
            of_surface[list[0].surface] = first..first + list.len();
            first += list.len();
        }
        let exchange = Exchange::new(&patched.patches, nodes, node);
        Self { scene, caster, optics, patched, exchange, of_surface, node }
    }

    /// Sends rays until each diffuse patch has sent `rays` of each scramble, and each rough one those of `chords` directions.
    pub fn shoot(&mut self, rays: u32, chords: u32, seed: u32) {
        let Patched { surfaces, patches, .. } = &self.patched;
        let of_surface = &self.of_surface;
        let between = Between { surfaces, caster: self.caster, patches, of_surface };
        self.exchange.shoot(&between, self.optics, rays, seed);
        if chords != self.patched.chords.each {
            self.patched.chords = Chords::new(&between, self.optics, (chords, seed));
        }
        let patches = &self.patched.patches;
        let mut coarse = vec![0.0; patches.coarse_area.len()];
        let buried = self.exchange.buried().chain(self.patched.chords.buried());
        let fine = patches.list.iter().zip(buried).map(|(patch, buried)| {
            let open = patch.area * (1.0 - buried).max(LEAST_OPEN);
            coarse[patch.coarse] += open;
            open
        });
        self.patched.areas = [fine.collect(), coarse];
    }

    /// Twice as many directions, as long as an epoch's effort allows it, and there are not too many otherwise.
    pub fn more_chords(&self, chords: u32, effort: &Effort) -> u32 {
        let patches = &self.patched.patches;
        let rough = patches.list.len() - patches.diffuse[0];
        let more = 2 * chords;
        let Patched { chords: now, .. } = &self.patched;
        let many = rough * SCRAMBLES * more as usize > MOST_CHORDS
            || 2 * now.meetings() > effort.meetings
            || 2 * now.asked() > effort.asked;
        if many { chords } else { more }
    }

    /// Twice as many rays of each patch, as long as there are not too many where they are followed from rough surface to rough surface.
    pub fn more_rays(&self, rays: u32) -> u32 {
        let diffuse = self.patched.patches.diffuse[0];
        let followed = diffuse < self.patched.patches.list.len();
        let all = diffuse * SCRAMBLES * 2 * rays as usize;
        if 2 * rays > MOST_RAYS || (followed && all > MOST_FOLLOWED) { rays } else { 2 * rays }
    }

    /// Whether some light is not found: see [`super::orders`].
    pub fn leaves_a_rest(&self) -> bool {
        self.patched.chords.see_each_other()
    }

    /// At the node of the trials.
    fn orders(&self) -> Option<Orders> {
        Orders::new(
            &self.patched,
            &self.exchange,
            self.optics,
            (self.node..self.node + 1, self.node),
            0.0,
        )
    }

    fn tried(&self, orders: &Orders, room: &mut Views, pair: &Pair) -> Found {
        let eye = Toward::Far(pair.to);
        room.see(&self.patched, eye);
        let found = room.between(&self.patched, orders, &[(pair.sun, 1.0)]);
        found.first().copied().unwrap_or_default()
    }

    /// The light of all pairs.
    fn of_pairs(&self, orders: &Orders, pilot: &Pilot) -> Vec<Found> {
        let pairs = pilot.pairs.par_iter().with_min_len(TOGETHER);
        let room = || Views::new(self.scene, &self.patched);
        pairs.map_init(room, |room, pair| self.tried(orders, room, pair)).collect()
    }

    /// Looks at all pairs that count.
    pub fn look(&self, pilot: &Pilot) -> Look {
        let Some(orders) = self.orders() else {
            let found = Vec::new();
            return Look { found, coarseness: f64::INFINITY, factors: 0.0, chords: 0.0 };
        };
        let all = self.of_pairs(&orders, pilot);
        let mut sums = [(); 3].map(|()| Rms::default());
        for (pair, found) in pilot.pairs.iter().zip(&all).filter(|p| p.0.counts) {
            for (sum, value) in sums.iter_mut().zip([found.left, found.factors, found.chords]) {
                sum.add(value / (pair.direct + found.light));
            }
        }
        let [coarseness, factors, chords] = sums.map(|s| s.get());
        Look { found: all, coarseness, factors, chords }
    }

    /// Returns the claim of the patches as they were looked at last, held against light paths over all pairs, and the error stated then, relative to all light (root of the mean square);
    /// `None` where paths find other light by more than the patches' size explains. `plan` is of as many paths as the rest may take.
    pub fn held(
        &self,
        (pilot, look): (&Pilot, Look),
        active: &[usize],
        plan: &Plan,
        nm: f64,
        seed: u32,
    ) -> Option<(Claim, f64)> {
        let of_patches = look.found;
        if of_patches.is_empty() {
            return None;
        }
        let optics = Optics::new(self.scene.materials(), &[nm]);
        let list = &self.patched.surfaces.list;
        let rough: Vec<bool> = list.iter().map(|s| optics.lambert(s.material).is_none()).collect();
        let both_ends = active.iter().any(|k| rough[*k]);
        let points = agreeing(pilot, &of_patches);
        let one = |optics: &mut Optics, (pair, of_patches): (&Pair, Found)| {
            let mut traced = |rest_of: Option<&[bool]>| {
                let mut sums = Sums::new(1);
                let mut paths = Paths {
                    surfaces: &self.patched.surfaces,
                    caster: self.caster,
                    optics,
                    active,
                    both_ends,
                    rest_of,
                    polariser: None,
                    seed: mixed(seed, 0xa9 + u32::from(rest_of.is_some())),
                };
                paths.trace(pair.sun, Toward::Far(pair.to), points, &mut sums);
                sums.bounced(0)
            };
            let (found, sigma) = traced(None);
            let rest = if self.leaves_a_rest() { traced(Some(&rough)) } else { (0.0, 0.0) };
            let (Found { light, left, .. }, noise) = (of_patches, of_patches.noise());
            let sigma = sigma.hypot(rest.1);
            let trial = Trial { light: light + rest.0, left, noise, found, sigma };
            (trial, noise + plan.claimed(rest.1, points))
        };
        let pairs = pilot.pairs.par_iter().zip(of_patches).with_min_len(TOGETHER);
        let (trials, claimed): (Vec<Trial>, Vec<f64>) =
            pairs.map_init(|| optics.clone(), one).unzip();
        let claim = Claim::of(&trials)?;
        let mut stated = Rms::default();
        for ((pair, trial), claimed) in pilot.pairs.iter().zip(&trials).zip(&claimed) {
            if pair.counts {
                let all = claim.of_size(trial.light, trial.left) + claimed;
                stated.add(all / (pair.direct + trial.light));
            }
        }
        Some((claim, stated.get()))
    }

    /// All nodes.
    pub fn finish(self, nodes: &Nodes) -> Option<(Patched, Orders)> {
        let wanted = (0..nodes.nm.len(), self.node);
        let orders = Orders::new(&self.patched, &self.exchange, self.optics, wanted, nodes.error)?;
        Some((self.patched, orders))
    }
}

/// Paths of each pair and scramble that know the light well beside what patches claim of it, by what the paths of the first look knew.
fn agreeing(pilot: &Pilot, of_patches: &[Found]) -> u32 {
    let plain = Claim::plain(of_patches.iter().map(|f| (f.light, f.left)));
    let square = |f: &Found| (plain.of_size(f.light, f.left) + f.noise()).powi(2);
    let claims: f64 = of_patches.iter().map(square).sum();
    let variance: f64 = pilot.pairs.iter().map(|p| p.sigma * p.sigma).sum();
    let times = variance / (OF_CLAIMS * OF_CLAIMS * claims);
    let points = |times: f64| (f64::from(pilot::POINTS) * times).ceil() as u32;
    if times <= f64::from(AGREEING / pilot::POINTS) {
        points(times.max(1.0)).next_power_of_two().min(AGREEING)
    } else {
        AGREEING
    }
}
