//! Light paths of two scatterings and more, of all orders, for one pair of directions.
//!
//! A path begins where sunlight falls (or where the observer looks), and at each surface a direction is drawn from the material; from every
//! surface but the first the light to the other end is counted, if nothing is in the way. Where materials have lobes half of the
//! paths begin at each end, and each path's light is weighed by how likely either way was to find it (Veach and Guibas 1995, balance
//! heuristic): a lobe at the first scattering is found well from the Sun, one at the last from the observer. Paths end by chance, in
//! proportion to what they have lost, so that no order is cut off. Points are Owen-scrambled Sobol points; eight scrambles that do not
//! know of each other give the error.

use super::cast::{Caster, Ray};
use super::echo::Echo;
use super::optics::Optics;
use super::stokes::{Polariser, Vectors};
use super::surfaces::{Place, Surfaces};
use crate::light::occlude::Toward;
use glam::DVec3;
use std::f64::consts::FRAC_1_PI;

/// Scrambles that do not know of each other.
pub const SCRAMBLES: u32 = 8;
/// Points of one scramble at most.
pub const MOST_POINTS: u32 = 1 << 24;
/// Points that one Sobol sequence has: beyond them another scramble of it goes on.
const OF_SEQUENCE: u32 = 1 << 16;
/// Paths of fewer scatterings are not ended by chance.
const SAFE: u32 = 3;
/// Paths that found something are few below this.
const FEW: f64 = 12.0;
/// The longest path; of what is white all over 0.99⁴⁰⁰ is left, and a path ends by chance long before.
const LONGEST: u32 = 400;

/// Inputs for tracing light paths.
#[derive(Debug)]
pub struct Paths<'a> {
    pub surfaces: &'a Surfaces,
    pub caster: &'a Caster,
    pub optics: &'a mut Optics,
    /// The surfaces on which light may fall that comes from another, or from which it may go to another.
    pub active: &'a [usize],
    pub both_ends: bool,
    /// Flags of the rough surfaces, one for each surface, where only paths of three scatterings and more count that begin or end with two rough surfaces.
    pub rest_of: Option<&'a [bool]>,
    /// Polariser that the observer looks through.
    pub polariser: Option<&'a Polariser>,
    pub seed: u32,
}

/// Room for the polarisation of one path.
#[derive(Debug)]
struct Polarised<'a> {
    by: &'a Polariser,
    /// Vectors of the path so far, and of what goes to the other end.
    vectors: [Vectors; 2],
    /// Reflection of a surface at each node, sr⁻¹.
    factors: Vec<f64>,
}

impl Polarised<'_> {
    /// Takes a path on where it is reflected; the second vectors with `ends`.
    fn reflect(&mut self, optics: &mut Optics, at: (usize, &Place), ways: [DVec3; 2], ends: bool) {
        self.factors.fill(1.0);
        optics.scatter(at.0, ways[0], ways[1], 1.0, &mut self.factors);
        let [path, last] = &mut self.vectors;
        if ends {
            last.copy(path);
        }
        let vectors = if ends { last } else { path };
        self.by.reflect(vectors, at, ways, &self.factors);
    }
}

/// One end of all paths.
#[derive(Debug)]
struct End {
    toward: Toward,
    /// Sums of what the active surfaces fill across it (of a near one: of their areas).
    sums: Vec<f64>,
    range_squared: f64,
}

/// Sums over paths.
#[derive(Debug, Clone, Default)]
pub struct Sums {
    nodes: usize,
    /// For each scramble and node.
    bounced: Vec<f64>,
    /// Singly scattered, of the active surfaces alone.
    direct: Vec<f64>,
    points: u32,
    starts: f64,
    /// Paths that found anything.
    found: u32,
    /// Upper bound of the active surfaces' projected area towards both ends, m².
    across: f64,
    /// Each path's own light, where it is wanted.
    pub echoes: Option<Vec<Echo>>,
}

impl Sums {
    pub fn new(nodes: usize) -> Self {
        let empty = vec![0.0; nodes * SCRAMBLES as usize];
        Self {
            nodes,
            bounced: empty.clone(),
            direct: empty,
            points: 0,
            starts: 0.0,
            found: 0,
            across: 0.0,
            echoes: None,
        }
    }

    /// Mean over the scrambles and its standard error, m² sr⁻¹.
    pub fn bounced(&self, node: usize) -> (f64, f64) {
        mean(&self.bounced, self.nodes, node, f64::from(self.points.max(1)))
    }

    /// Bounds the light missed where few paths found anything, m² sr⁻¹: one more path that sends all its light to the other end, white and diffuse; the less
    /// the more have found something.
    pub fn missing(&self) -> f64 {
        Self::missing_of(std::slice::from_ref(self))
    }

    /// The same of several sums together, on the average.
    pub fn missing_of(sums: &[Self]) -> f64 {
        let points: f64 = sums.iter().map(|s| f64::from(s.points)).sum();
        let found: f64 = sums.iter().map(|s| f64::from(s.found)).sum();
        let across = sums.iter().map(|s| s.across).sum::<f64>() / sums.len().max(1) as f64;
        let few = (FEW / found.max(1.0)).min(1.0);
        few * across * FRAC_1_PI / (f64::from(SCRAMBLES) * points.max(1.0))
    }

    /// The singly scattered light of the active surfaces, m² sr⁻¹.
    pub fn direct(&self, node: usize) -> f64 {
        mean(&self.direct, self.nodes, node, f64::from(self.points.max(1)) * self.starts).0
    }
}

fn mean(sums: &[f64], nodes: usize, node: usize, each: f64) -> (f64, f64) {
    let n = f64::from(SCRAMBLES);
    let values = || sums.iter().skip(node).step_by(nodes).map(|s| s / each);
    let mean = values().sum::<f64>() / n;
    let square: f64 = values().map(|v| (v - mean) * (v - mean)).sum();
    (mean, (square / (n * (n - 1.0))).sqrt())
}

impl End {
    fn new(paths: &Paths, toward: Toward) -> Self {
        let (far, range_squared) = match toward {
            Toward::Far(d) => (Some(d), 1.0),
            Toward::Near(q) => (None, q.length_squared()),
        };
        let mut sum = 0.0;
        let across = paths.active.iter().map(|&k| {
            let surface = &paths.surfaces.list[k];
            sum += far.map_or(surface.area, |d| surface.across(d));
            sum
        });
        Self { toward, sums: across.collect(), range_squared }
    }

    fn total(&self) -> f64 {
        self.sums.last().copied().unwrap_or(0.0)
    }

    /// A point of the surfaces with its density, m⁻².
    fn draw(&self, paths: &Paths, [a, b, c]: [f64; 3]) -> Place {
        let wanted = a * self.total();
        let k = self.sums.partition_point(|s| *s <= wanted).min(self.sums.len() - 1);
        let surface = paths.active[k];
        match self.toward {
            Toward::Far(d) => paths.surfaces.list[surface].facing(surface, d, [b, c]),
            Toward::Near(_) => paths.surfaces.list[surface].even(surface, [b, c]),
        }
    }

    /// The direction from a point, how far that is, and cosθ (of a near one with (range/distance)²).
    fn from(&self, place: &Place) -> (DVec3, f64, f64) {
        match self.toward {
            Toward::Far(d) => (d, f64::INFINITY, place.normal.dot(d)),
            Toward::Near(q) => {
                let away = q - place.at;
                let d = away.normalize_or_zero();
                let scale = self.range_squared / away.length_squared();
                (d, away.length(), place.normal.dot(d) * scale)
            }
        }
    }

    /// The density of a place among those drawn, m⁻².
    fn density(&self, cos: f64) -> f64 {
        match self.toward {
            Toward::Far(_) => cos / self.total(),
            Toward::Near(_) => 1.0 / self.total(),
        }
    }

    fn sees(&self, paths: &Paths, place: &Place, d: DVec3, range: f64) -> bool {
        let ray = Ray { from: place.at, along: d, leaves: place.surface };
        !paths.caster.is_blocked(&ray, range)
    }
}

impl Paths<'_> {
    /// Traces `until` points (of each scramble, counted from the first) and adds to the sums.
    pub fn trace(&mut self, sun: DVec3, eye: Toward, until: u32, sums: &mut Sums) {
        let (sun, eye) = (End::new(self, Toward::Far(sun)), End::new(self, eye));
        let (first, nodes) = (sums.points, self.optics.nodes);
        let share = if self.both_ends { 0.5 } else { 1.0 };
        let mut light = [vec![0.0; nodes], vec![0.0; nodes]];
        let mut polarised = self.polariser.map(|by| Polarised {
            by,
            vectors: [Vectors::new(nodes), Vectors::new(nodes)],
            factors: vec![0.0; nodes],
        });
        for scramble in 0..SCRAMBLES {
            let row = scramble as usize * nodes..(scramble as usize + 1) * nodes;
            let seed = mixed(self.seed, scramble);
            let before = sums.echoes.as_ref().map_or(0, Vec::len);
            for index in first..until {
                // The points' bits are stratified over both halves.
                let from_sun = !self.both_ends || index % 2 == 0;
                let (start, end) = if from_sun { (&sun, &eye) } else { (&eye, &sun) };
                if start.total() <= 0.0 || end.total() <= 0.0 {
                    continue;
                }
                let index = if self.both_ends { index / 2 } else { index };
                let seed = mixed(seed, u32::from(from_sun));
                let (bounced, direct) =
                    (&mut sums.bounced[row.clone()], &mut sums.direct[row.clone()]);
                let mut direct = from_sun.then_some(direct);
                let echoes = &mut sums.echoes;
                let found = self.one(
                    start,
                    end,
                    (index, seed),
                    share,
                    (&mut light, &mut polarised),
                    bounced,
                    &mut direct,
                    echoes,
                );
                sums.found += u32::from(found);
            }
            let own = sums.echoes.iter_mut().flat_map(|e| &mut e[before..]);
            own.for_each(|e| e.scramble = scramble as usize);
        }
        // Half of the paths begin at the Sun; each kind's sum is over its own.
        sums.starts = share;
        sums.points = until;
        sums.across = sun.total();
    }

    /// One path.
    #[expect(clippy::too_many_arguments, reason = "all of them are one path's own")]
    fn one(
        &mut self,
        start: &End,
        end: &End,
        (index, seed): (u32, u32),
        share: f64,
        ([light, last], polarised): (&mut [Vec<f64>; 2], &mut Option<Polarised>),
        bounced: &mut [f64],
        direct: &mut Option<&mut [f64]>,
        echoes: &mut Option<Vec<Echo>>,
    ) -> bool {
        let mut found = false;
        let (index, seed) = match index / OF_SEQUENCE {
            0 => (index, seed),
            more => (index % OF_SEQUENCE, mixed(seed, more)),
        };
        let numbers = |set: u32| {
            sobol_burley::sample_4d(index, set % 16, mixed(seed, set / 16)).map(f64::from)
        };
        let u = numbers(0);
        let mut here = start.draw(self, [u[0], u[1], u[2]]);
        let (d, range, cos) = start.from(&here);
        if cos <= 0.0 || !start.sees(self, &here, d, range) {
            return found;
        }
        let mut came = here.local(d);
        light.fill(cos / start.density(cos));
        if let Some(polarised) = polarised {
            let from_light = direct.is_some();
            let source = if from_light { d } else { end.from(&here).0 };
            polarised.by.start(&mut polarised.vectors[0], from_light, source, d);
        }
        if let Some(direct) = direct {
            self.count(end, &here, came, (light, last, polarised), 1.0, direct);
        }
        // How likely the way back is beside this way.
        let mut back = 1.0 / start.density(cos);
        let mut mirrored_first = false;
        let (first, mut between_m) = (here.at, 0.0);
        let rough = |place: &Place, rest: &Option<&[bool]>| rest.is_some_and(|r| r[place.surface]);
        let mut began_rough = false;
        for order in 1..LONGEST {
            let u = numbers(order);
            let material = self.surfaces.list[here.surface].material;
            let drawn = self.optics.draw(material, came, [u[0], u[1], u[2]]);
            if drawn.to.z <= 0.0 {
                return found;
            }
            let before = light.iter().copied().fold(0.0, f64::max);
            match drawn.density {
                Some(density) if density > 0.0 => {
                    let scale = drawn.to.z / density;
                    self.optics.scatter(material, came, drawn.to, scale, light);
                }
                Some(_) => return found,
                None => self.optics.mirror(material, came.z, light),
            }
            // The step that led here could have been drawn from here, had the path come the other way. Mirrors are alike both ways.
            if order > 1 && self.both_ends {
                back *= self.optics.density(material, drawn.to, came).unwrap_or(1.0);
            }
            mirrored_first |= order == 1 && drawn.density.is_none();
            if let Some(polarised) = polarised {
                polarised.reflect(self.optics, (material, &here), [came, drawn.to], false);
            }
            let after = light.iter().copied().fold(0.0, f64::max);
            if after <= 0.0 {
                return found;
            }
            if order >= SAFE {
                let stays = (after / before).min(1.0);
                if u[3] >= stays {
                    return found;
                }
                light.iter_mut().for_each(|l| *l /= stays);
            }
            let along = here.body(drawn.to);
            let ray = Ray { from: here.at, along, leaves: here.surface };
            let Some(hit) = self.caster.first(&ray).filter(|h| h.front) else { return found };
            let surface = &self.surfaces.list[hit.surface];
            let there = surface.place(hit.surface, here.at + hit.distance * along);
            let arrives = there.local(-along);
            if arrives.z <= 0.0 {
                return found;
            }
            back *= drawn.to.z / (drawn.density.unwrap_or(1.0) * arrives.z);
            let mut weight = share.recip();
            if self.both_ends && !mirrored_first {
                weight *= self.weight(end, &there, arrives, back);
            }
            between_m += hit.distance;
            let two_rough = rough(&here, &self.rest_of) && rough(&there, &self.rest_of);
            began_rough |= order == 1 && two_rough;
            let counts = self.rest_of.is_none() || (order > 1 && (began_rough || two_rough));
            let seen = counts
                && self.count(end, &there, arrives, (light, last, polarised), weight, bounced);
            if let (true, Some(echoes)) = (seen, &mut *echoes) {
                let from_sun = direct.is_some();
                echoes.push(Echo::new(from_sun, [first, there.at], between_m, last[0]));
            }
            found |= seen;
            (here, came) = (there, arrives);
        }
        found
    }

    /// The balance heuristic's weight of this way for a path that ends here.
    fn weight(&mut self, end: &End, place: &Place, came: DVec3, back: f64) -> f64 {
        let (d, _, cos) = end.from(place);
        let to = place.local(d);
        if cos <= 0.0 {
            return 0.0;
        }
        let material = self.surfaces.list[place.surface].material;
        match self.optics.density(material, to, came) {
            Some(density) => 1.0 / (1.0 + back * density * end.density(cos)),
            None => 0.0,
        }
    }

    /// Adds what goes to the other end, if it is seen from here.
    fn count(
        &mut self,
        end: &End,
        place: &Place,
        came: DVec3,
        (light, last, polarised): (&[f64], &mut [f64], &mut Option<Polarised>),
        weight: f64,
        sum: &mut [f64],
    ) -> bool {
        let (d, range, cos) = end.from(place);
        if cos <= 0.0 || weight <= 0.0 {
            return false;
        }
        let material = self.surfaces.list[place.surface].material;
        last.copy_from_slice(light);
        self.optics.scatter(material, came, place.local(d), weight * cos, last);
        let seen = last.iter().any(|l| *l > 0.0) && end.sees(self, place, d, range);
        if seen {
            if let Some(polarised) = polarised {
                let to = place.local(d);
                polarised.reflect(self.optics, (material, place), [came, to], true);
                polarised.by.pass(&mut polarised.vectors[1], d, last);
            }
            sum.iter_mut().zip(last.iter()).for_each(|(s, l)| *s += l);
        }
        seen
    }
}

/// A seed from two numbers (Wellons' lowbias32).
pub fn mixed(a: u32, b: u32) -> u32 {
    let mut x = a.wrapping_mul(0x9e37_79b9) ^ b.wrapping_add(0x85eb_ca6b);
    x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}
