//! Indirect light along a pass: bounced, from the Earth, from the Moon. It costs a hundred times what direct light costs and changes slowly, so where epochs are dense it is
//! computed at some of them (*nodes*) and interpolated in time between, by a cubic through the two nodes on either side. Direct light is computed at every epoch.
//!
//! Nodes begin as dense as the body turns (a lobe must not fall between two), and at the edges of the Earth's shadow. Then every interval is computed in its middle: where that is off
//! the cubic by more than half of the tolerance of all light, or the interval beside it is, it falls in two. A middle that was computed is a node in either case, so what is left is mostly less
//! than what was seen: a half of it where the light has a kink, a sixteenth where it is smooth. What was seen is in the stated error: it is added to that of the nodes as squares are, since sizes of patches and rays know nothing of time.
//!
//! Each way of the light has nodes of its own: what lobes bounce needs many, what the wide Earth sends needs few and costs more.
//!
//! In time: weights of terms in the body's axes are interpolated; distances, air and channels are those of each epoch. What comes out depends on the epochs of the pass
//! and on no number of threads.

use super::functionals::Functionals;
use super::simulate::{Place, first_error};
use super::{Pass, PassError, Ready};
use crate::light::{Engine, Source};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use sunglint_formats::time::tai_nanoseconds;

/// Fewer epochs are computed one by one.
const LEAST_EPOCHS: usize = 16;
/// Epochs between two of the first nodes at most, in passes of so many times [`FIRST`] epochs and fewer.
const FARTHEST: usize = 32;
/// Longer passes begin with about so many nodes where the body's turning asks for no more: a node has some kB, and epochs that are denser need no more of them.
const FIRST: usize = 2048;
/// Between two of the first nodes the Sun and the observer turn by no more than this in the body's axes.
const TURN_RAD: f64 = 0.2;
/// The same where light between surfaces has lobes, or the Moon shines: a share of the narrowest lobe's α. Half of that, with the middle, is in a half vector a quarter of α.
const OF_LOBE: f64 = 1.0;
/// Share of the tolerance of all light that the cubics of all ways may be off in the middle.
const OF_TOLERANCE: f64 = 0.5;
/// Share of the light's own stated error that it may be off as well: light paths are drawn, and need be no smoother than they are known.
const OF_STATED: f64 = 0.25;
/// A node farther than this many times the interval is no support of its cubic.
const FAR: f64 = 8.0;

/// Weights of one epoch, m² sr⁻¹, and their errors.
type Row = (Vec<f64>, Vec<f64>);

/// Indirect light along a pass.
#[derive(Debug)]
pub(super) struct Along {
    /// For each epoch its place in the order of time.
    place: Vec<usize>,
    /// Times of the places, s.
    times_s: Vec<f64>,
    /// The light of each way that it came by.
    ways: Vec<Nodes>,
}

/// Light that came by one way, at the nodes.
#[derive(Debug)]
struct Nodes {
    /// Places that are nodes, increasing; the first and the last are among them.
    nodes: Vec<usize>,
    /// Terms at each node.
    rows: Vec<Row>,
    /// For each interval the number of its error in `off`; none where there is no epoch between its ends.
    of_interval: Vec<Option<usize>>,
    /// Error of the cubic in the middle of the interval, each term, m² sr⁻¹.
    off: Vec<Vec<f64>>,
}

/// One epoch, as far as the choice of nodes needs it: a pass in pieces holds no more of all its epochs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sketch {
    time_s: f64,
    sun_body: DVec3,
    observer_body: DVec3,
    /// Whether the body is in the Earth's shadow wholly; whether it is outside.
    shadow: [bool; 2],
}

impl Sketch {
    pub fn of(place: &Place) -> Self {
        Self {
            time_s: tai_nanoseconds(place.geometry.epoch) as f64 * 1e-9,
            sun_body: place.sun_body,
            observer_body: place.observer_body,
            shadow: [place.sunlit <= 0.0, place.sunlit >= 1.0],
        }
    }
}

/// The place of an epoch, by its number in the pass.
pub(super) type PlaceOf<'a> = dyn Fn(usize) -> Result<Place, PassError> + Sync + 'a;

pub(super) fn indirect(source: Source) -> bool {
    !matches!(source, Source::Direct | Source::Unknown)
}

impl Along {
    /// Computes the nodes; `None` where every epoch is better computed for itself: single observations, few epochs, equal times, no indirect light.
    ///
    /// # Errors
    /// [`PassError::Light`]; the errors of `place`.
    pub fn new(
        ready: &Ready<'_>,
        sketches: &[Sketch],
        place: &PlaceOf<'_>,
        tick: &(dyn Fn() + Sync),
    ) -> Result<Option<Self>, PassError> {
        let (pass, engine) = (ready.pass, &ready.engine);
        let has = |wanted: &dyn Fn(Source) -> bool| {
            engine.terms()[..engine.lit_terms()].iter().any(|t| wanted(t.source))
        };
        if sketches.len() < LEAST_EPOCHS || !pass.observations.is_empty() || !has(&indirect) {
            return Ok(None);
        }
        let mut order: Vec<usize> = (0..sketches.len()).collect();
        order.sort_by(|a, b| sketches[*a].time_s.total_cmp(&sketches[*b].time_s));
        let times_s: Vec<f64> = order.iter().map(|i| sketches[*i].time_s).collect();
        if times_s.windows(2).any(|t| t[1] <= t[0]) {
            return Ok(None);
        }
        let mut ways = Vec::new();
        let sources: Vec<Source> = [Source::Bounce, Source::Earthshine, Source::Moonshine]
            .into_iter()
            .filter(|source| has(&|of| of == *source))
            .collect();
        let of_tolerance = OF_TOLERANCE / sources.len() as f64;
        for source in sources {
            // The Earth is far wider than any lobe that counts.
            let turn_rad = match engine.narrowest_lobe() {
                Some(alpha) if source != Source::Earthshine => TURN_RAD.min(OF_LOBE * alpha),
                _ => TURN_RAD,
            };
            let (order, times_s) = (&order[..], &times_s[..]);
            let course =
                Course { ready, sketches, place, source, of_tolerance, order, times_s, tick };
            ways.push(course.nodes(turn_rad)?);
        }
        let mut place = vec![0; sketches.len()];
        order.iter().enumerate().for_each(|(k, i)| place[*i] = k);
        Ok(Some(Self { place, times_s, ways }))
    }

    /// How many epochs are nodes, of the way that has most.
    pub fn computed(&self) -> usize {
        self.ways.iter().map(|way| way.nodes.len()).max().unwrap_or(0)
    }

    /// Adds the light of an epoch to its weights and their errors.
    pub fn add(&self, epoch: usize, weights: &mut [f64], errors: &mut [f64]) {
        for way in &self.ways {
            way.add(&self.times_s, self.place[epoch], weights, errors);
        }
    }
}

impl Nodes {
    /// Adds the light at a place.
    fn add(&self, times_s: &[f64], k: usize, weights: &mut [f64], errors: &mut [f64]) {
        let interval = self.nodes.partition_point(|n| *n <= k).max(1) - 1;
        if self.nodes[interval] == k {
            let (row, own) = &self.rows[interval];
            weights.iter_mut().zip(row).for_each(|(w, r)| *w += r);
            errors.iter_mut().zip(own).for_each(|(e, r)| *e += r);
            return;
        }
        let at = |n: usize| times_s[self.nodes[n]];
        let time = times_s[k];
        let support = support(&at, self.nodes.len(), interval, time);
        let rows: Vec<(f64, &[f64])> =
            support.into_iter().map(|(n, part)| (part, &self.rows[n].0[..])).collect();
        for (t, weight) in weights.iter_mut().enumerate() {
            *weight += cubic(&rows, t);
        }
        let along = (time - at(interval)) / (at(interval + 1) - at(interval));
        for (part, n) in [(1.0 - along, interval), (along, interval + 1)] {
            errors.iter_mut().zip(&self.rows[n].1).for_each(|(e, r)| *e += part * r);
        }
        if let Some(off) = self.of_interval[interval] {
            errors
                .iter_mut()
                .zip(&self.off[off])
                .for_each(|(e, off)| *e = (*e * *e + off * off).sqrt());
        }
    }
}

/// The nodes whose cubic holds in an interval, with their parts at a time: two on either side, fewer at the ends and where others are far.
fn support(
    at: &dyn Fn(usize) -> f64,
    nodes: usize,
    interval: usize,
    time: f64,
) -> Vec<(usize, f64)> {
    let (low, high) = (at(interval), at(interval + 1));
    let reach = FAR * (high - low);
    let mut all = vec![interval, interval + 1];
    if interval > 0 && low - at(interval - 1) <= reach {
        all.push(interval - 1);
    }
    if interval + 2 < nodes && at(interval + 2) - high <= reach {
        all.push(interval + 2);
    }
    let part = |n: usize| {
        let others = all.iter().filter(|m| **m != n);
        others.map(|m| (time - at(*m)) / (at(n) - at(*m))).product::<f64>()
    };
    all.iter().map(|n| (*n, part(*n))).collect()
}

/// The sum of parts of rows, not below 0 where none of them is.
fn cubic(rows: &[(f64, &[f64])], term: usize) -> f64 {
    let sum: f64 = rows.iter().map(|(part, row)| part * row[term]).sum();
    if sum < 0.0 && rows.iter().all(|(_, row)| row[term] >= 0.0) { 0.0 } else { sum }
}

/// A pass whose nodes are looked for.
struct Course<'a> {
    ready: &'a Ready<'a>,
    sketches: &'a [Sketch],
    place: &'a PlaceOf<'a>,
    /// The way that the light came.
    source: Source,
    /// Share of the tolerance of all light that the cubic may be off.
    of_tolerance: f64,
    order: &'a [usize],
    times_s: &'a [f64],
    tick: &'a (dyn Fn() + Sync),
}

/// Rows of nodes, each with all light there in each channel and band.
type Rows = BTreeMap<usize, (Row, Vec<f64>)>;

impl Course<'_> {
    fn at(&self, k: usize) -> &Sketch {
        &self.sketches[self.order[k]]
    }

    /// The light at all nodes, from first ones that are so far apart.
    fn nodes(&self, turn_rad: f64) -> Result<Nodes, PassError> {
        let (rows, off) = self.refined(self.first(turn_rad))?;
        let (nodes, rows): (Vec<usize>, Vec<Row>) =
            rows.into_iter().map(|(k, (row, _))| (k, row)).unzip();
        let numbers: BTreeMap<usize, usize> =
            off.iter().enumerate().map(|(number, (k, _))| (*k, number)).collect();
        let own = |ends: &[usize]| (ends[1] > ends[0] + 1).then(|| numbers.get(&ends[0]).copied());
        let of_interval = nodes.windows(2).map(|ends| own(ends).flatten()).collect();
        Ok(Nodes { nodes, rows, of_interval, off: off.into_values().collect() })
    }

    /// The first nodes: as far apart as the body's turning and the Earth's shadow allow.
    fn first(&self, turn_rad: f64) -> Vec<usize> {
        let last = self.order.len() - 1;
        let (mut all, mut before) = (vec![0, last], 0);
        let farthest = FARTHEST.max(self.order.len() / FIRST);
        for k in 1..=last {
            let [a, b] = [before, k].map(|k| self.at(k));
            let turned = |a: DVec3, b: DVec3| a.angle_between(b) > turn_rad;
            if k - before > farthest
                || turned(a.sun_body, b.sun_body)
                || turned(a.observer_body, b.observer_body)
            {
                before = (k - 1).max(before + 1);
                all.push(before);
            }
            if self.at(k - 1).shadow != self.at(k).shadow {
                all.extend([k - 1, k]);
            }
        }
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Divides the intervals of some nodes until the middle of each is on its cubic: the rows of all nodes, and how far off the middles were, by the place at which an interval begins.
    fn refined(&self, first: Vec<usize>) -> Result<(Rows, BTreeMap<usize, Vec<f64>>), PassError> {
        let mut rows: Rows = first.iter().copied().zip(self.rows(&first)?).collect();
        let mut off = BTreeMap::new();
        let mut open: Vec<[usize; 2]> = intervals(&first);
        // Level by level, so that each has many epochs for all threads.
        while !open.is_empty() {
            let middles: Vec<usize> = open.iter().map(|[a, b]| (a + b) / 2).collect();
            let nodes: Vec<usize> = rows.keys().copied().collect();
            let found = self.rows(&middles)?;
            let aways: Vec<Vec<f64>> = (open.iter().zip(&middles).zip(&found))
                .map(|(([a, _], middle), (row, _))| self.away(&nodes, &rows, (*a, *middle), row))
                .collect();
            let near: Vec<bool> = (aways.iter().zip(&found))
                .map(|(away, (row, light))| self.is_near(away, row, light))
                .collect();
            let mut next = Vec::new();
            for (n, ([a, b], middle)) in open.iter().zip(&middles).enumerate() {
                // A kink bends the cubics of the neighbours, too, and may be missed by one of them alone.
                let beside = |m: usize, at: usize| {
                    open.get(m).is_some_and(|other| other.contains(&at)) && !near[m]
                };
                let kinked = (n > 0 && beside(n - 1, *a)) || beside(n + 1, *b);
                if near[n] && !kinked {
                    off.insert(*middle, aways[n].clone());
                    off.insert(*a, aways[n].clone());
                } else {
                    next.extend(intervals(&[*a, *middle, *b]));
                }
            }
            rows.extend(middles.into_iter().zip(found));
            open = next;
        }
        Ok((rows, off))
    }

    /// How far the light in the middle of an interval is from its cubic, each term.
    fn away(
        &self,
        nodes: &[usize],
        rows: &Rows,
        (a, middle): (usize, usize),
        own: &Row,
    ) -> Vec<f64> {
        let interval = nodes.partition_point(|n| *n <= a).max(1) - 1;
        let at = |n: usize| self.times_s[nodes[n]];
        let support = support(&at, nodes.len(), interval, self.times_s[middle]);
        let rows: Vec<(f64, &[f64])> = support
            .into_iter()
            .filter_map(|(n, part)| Some((part, &rows.get(&nodes[n])?.0.0[..])))
            .collect();
        own.0.iter().enumerate().map(|(t, own)| (cubic(&rows, t) - own).abs()).collect()
    }

    /// Whether that is little of all light in every channel and band, or of what is stated.
    fn is_near(&self, away: &[f64], (_, errors): &Row, light: &[f64]) -> bool {
        let sum = |row: &[f64], q: usize| self.ready.functionals.sums.above(q, row);
        let wanted = self.of_tolerance * self.ready.pass.tolerance;
        light.iter().enumerate().all(|(q, light)| {
            sum(away, q).abs() <= (wanted * light).max(OF_STATED * sum(errors, q).abs())
        })
    }

    /// The light of the way at some places, with what is straight from the Sun beside it in each channel and band.
    fn rows(&self, places: &[usize]) -> Result<Vec<(Row, Vec<f64>)>, PassError> {
        let rows = places.par_iter().map_init(
            || self.ready.eye(),
            |eye, k| {
                let place = (self.place)(self.order[*k])?;
                let row = eye.weigh_some(&place, &|source| source == self.source)?;
                let (straight, _) = eye.weigh_some(&place, &|source| source == Source::Direct)?;
                let all: Vec<f64> = straight.iter().zip(&row.0).map(|(a, b)| a + b).collect();
                (self.tick)();
                let light = self.ready.functionals.sums_above(self.ready.pass, &all);
                Ok((row, light))
            },
        );
        first_error(rows.collect())
    }
}

/// Neighbours among places, of those that have others between them.
fn intervals(places: &[usize]) -> Vec<[usize; 2]> {
    places.windows(2).map(|p| [p[0], p[1]]).filter(|[a, b]| *b > a + 1).collect()
}

impl Functionals {
    /// Light of weights in each channel and band above the air, distances aside.
    pub(super) fn sums_above(&self, pass: &Pass, weights: &[f64]) -> Vec<f64> {
        let quantities = pass.station.channels.len() + super::BANDS.len();
        (0..quantities).map(|q| self.sums.above(q, weights)).collect()
    }
}

impl Engine {
    /// α of the narrowest lobe of any surface; 0 of a mirror, `None` of a diffuse body.
    fn narrowest_lobe(&self) -> Option<f64> {
        self.body().narrowest().map(|(_, alpha)| alpha)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pass::{Overrides, PassFile};

    /// The scene of the demonstration with another target, other times, another attitude.
    fn pass(target: &str, [from, to]: [&str; 2], step_s: f64, attitude: &str) -> Pass {
        let path = sunglint_testkit::repository().join("fixtures/scenes/box_wing_dusk.toml");
        let text = std::fs::read_to_string(&path).unwrap();
        let text = text
            .replace("built_in = \"box_wing\"", target)
            .replace("2020-11-18T16:22:00", from)
            .replace("2020-11-18T16:30:00", to)
            .replace("step_s = 0.5", &format!("step_s = {step_s:?}"))
            .replace("period_s = 120.0", attitude);
        PassFile::parse(&path, &text).unwrap().resolve(Overrides::default()).unwrap()
    }

    /// Truth: the same engine at every epoch. Promise: in 99 % of epochs, channels and bands interpolation errs by no more than what is wanted of a middle, half of the tolerance of all light or a quarter of
    /// the light's own stated error; and nowhere by more than half of what is stated in all. Scenes: lobes, a turn in twenty seconds, a corner, balls, the Earth's shadow.
    #[test]
    fn light_between_nodes_is_within_its_error() {
        let dusk = ["2020-11-18T16:25:00", "2020-11-18T16:25:20"];
        let cases = [
            ("built_in = \"box_wing\"", dusk, 0.1, "period_s = 120.0"),
            (
                "built_in = \"box_wing\"",
                ["2020-11-18T16:25:00", "2020-11-18T16:25:15"],
                0.05,
                "period_s = 20.0",
            ),
            ("built_in = \"corner\"", dusk, 0.1, "period_s = 60.0"),
            ("built_in = \"lambert_sphere\"", dusk, 0.2, "period_s = 60.0"),
            ("built_in = \"hexagon\"", dusk, 0.1, "period_s = 90.0"),
            ("built_in = \"lcs_1\"", dusk, 0.2, "period_s = 60.0"),
            (
                "built_in = \"box_with_panels\"",
                ["2020-11-18T16:36:00", "2020-11-18T16:36:30"],
                0.1,
                "period_s = 40.0",
            ),
        ];
        for (target, times, step_s, attitude) in cases {
            let pass = pass(target, times, step_s, attitude);
            let places = pass.places(&|| ()).unwrap();
            let ready = pass.ready_for(&pass.course(&places)).unwrap();
            let sketches: Vec<Sketch> = places.iter().map(Sketch::of).collect();
            let Some(along) = Along::new(&ready, &sketches, &|i| Ok(places[i]), &|| ()).unwrap()
            else {
                println!("{target}: nothing indirect");
                continue;
            };
            let sums = |row: &[f64]| ready.functionals.sums_above(&pass, row);
            let (mut all, mut rough, mut most, mut worst) = (0, 0, 0.0_f64, 0.0_f64);
            let mut eye = ready.eye();
            for (i, place) in places.iter().enumerate() {
                let (own, known) = eye.weigh(place).unwrap();
                let (own, known) = (own.to_vec(), known.to_vec());
                let (found, stated) = eye.weigh_beside(place, &|w, e| along.add(i, w, e)).unwrap();
                let off: Vec<f64> = own.iter().zip(found).map(|(a, b)| a - b).collect();
                let more: Vec<f64> =
                    stated.iter().zip(&known).map(|(a, b)| (a - b).max(0.0)).collect();
                let lit = ready.engine.lit_terms();
                let (off, more, light, known) =
                    (sums(&off), sums(&more[..lit]), sums(&own), sums(&known[..lit]));
                for q in 0..off.len() {
                    if light[q] <= 0.0 {
                        continue;
                    }
                    let off = off[q].abs();
                    all += 1;
                    let wanted = (OF_TOLERANCE * pass.tolerance * light[q]).max(0.25 * known[q]);
                    rough += usize::from(off > wanted);
                    most = most.max(off / (known[q] + more[q]).max(1e-12 * light[q]));
                    worst = worst.max(off / light[q]);
                }
            }
            println!(
                "{target} {step_s}: {} of {} epochs, {rough} of {all} beyond what is wanted, at most {most:.3} of what is stated in all, {worst:.2e} of light",
                along.computed(),
                places.len()
            );
            assert!(100 * rough <= all && most < 0.5, "{target}");
        }
    }
}
