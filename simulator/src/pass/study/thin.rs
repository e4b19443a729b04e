//! Light at few epochs, where epochs are nearer to one another than light changes. It is computed at some ("nodes") and is linear in time between them: its
//! weights in the body's axes are, while distances, air and channels are those of each epoch. Direct light and all other ("indirect": bounced, from the Earth, from the
//! Moon; a hundred times as costly and more, and smoother) have nodes of their own. Nodes are found once, wherever the light is not on the line between others; then
//! they stay, whatever turns or shines, so that a small change of the pass makes a small change of its light.

use super::{PassError, Study, first_error};
use crate::light::engine::Worker;
use crate::light::{DirectionError, Engine, Source};
use crate::pass::{BANDS, Place};
use rayon::prelude::*;
use sunglint_formats::time::{format_utc_shortest, tai_nanoseconds};

/// Between neighbouring nodes of direct light the Sun and the observer turn by no more than this in the body's axes: the light of another attitude or
/// another surface may bend where that of the first did not, but not within so little unless it is a mirror's.
const TURN_RAD: f64 = 0.01;
/// The same of indirect light, which is only looked at in the middle between nodes.
const INDIRECT_TURN_RAD: f64 = 0.2;
/// Largest distance from the line over that in the middle between two nodes, where the light has one bend in between, at most: at a fraction
/// t of the way t/2 against t (1 − t).
const AWAY: f64 = 2.0;
/// Share of the brightest epoch's light that counts as light where there is less.
const FAINT: f64 = 0.01;
/// More nodes than this part of all epochs spare nothing.
const WORTH: f64 = 0.5;

/// At how many epochs light is computed, and what that may err by.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Thinned {
    /// All epochs.
    pub epochs: usize,
    /// Epochs at which direct light is computed.
    pub direct: usize,
    /// Epochs at which indirect light is computed; 0 where there is none.
    pub indirect: usize,
    /// The largest error that the lines between them make: of direct light at any epoch, and of indirect light twice that in the middle between two nodes, of all light there in
    /// any channel or band (or of a hundredth of that of the brightest epoch). What is within the light's own stated error counts as on the line.
    pub error: f64,
}

/// The nodes.
#[derive(Debug, Clone)]
pub(super) struct Nodes {
    /// Epochs in the order of their times.
    order: Vec<usize>,
    /// Places in `order` that are nodes, increasing; first and last are among them.
    chosen: Vec<usize>,
    /// For each epoch the interval of nodes that it is in, and how far along.
    within: Vec<(usize, f64)>,
}

/// Weights of one epoch, m² sr⁻¹, and their errors.
pub(super) type Row = (Vec<f64>, Vec<f64>);

/// Nodes of indirect light, the error of the lines between them, and the light at them; `None` for light that is computed at all epochs, or was not at all nodes.
type Indirect = (Option<Nodes>, f64, Option<Vec<Row>>);

impl Nodes {
    fn new(order: Vec<usize>, chosen: Vec<usize>, times_s: &[f64]) -> Self {
        let mut within = vec![(0, 0.0); order.len()];
        for (interval, ends) in chosen.windows(2).enumerate() {
            let (from, to) = (times_s[order[ends[0]]], times_s[order[ends[1]]]);
            for k in &order[ends[0]..=ends[1]] {
                let along = if to > from { (times_s[*k] - from) / (to - from) } else { 0.0 };
                within[*k] = (interval, along);
            }
        }
        Self { order, chosen, within }
    }

    /// The epochs that are nodes.
    fn epochs(&self) -> impl Iterator<Item = usize> {
        self.chosen.iter().map(|k| self.order[*k])
    }

    /// Adds to the weights of an epoch what lies on the line between its nodes' rows.
    pub fn add(&self, epoch: usize, rows: &[Row], weights: &mut [f64]) {
        let (interval, along) = self.within[epoch];
        for (part, row) in [(1.0 - along, rows.get(interval)), (along, rows.get(interval + 1))] {
            if let (Some((row, _)), true) = (row, part > 0.0) {
                weights.iter_mut().zip(row).for_each(|(w, r)| *w += part * r);
            }
        }
    }
}

fn direct(source: Source) -> bool {
    source == Source::Direct
}

/// Whether light came by another way than straight from the Sun.
fn indirect(source: Source) -> bool {
    source != Source::Direct
}

/// The light of a place by some ways.
pub(super) fn weigh(
    worker: &mut Worker<'_>,
    place: &Place,
    wanted: &dyn Fn(Source) -> bool,
    weights: &mut [f64],
    errors: &mut [f64],
) -> Result<(), PassError> {
    let failed = |source: DirectionError| PassError::Light {
        epoch_utc: format_utc_shortest(place.geometry.epoch),
        source: Box::new(source),
    };
    worker.light_of(&place.lighting(), wanted, weights, errors).map_err(failed)
}

impl Study {
    /// Has light computed at as few epochs as keep what is linear in time between them within `tolerance` of all light, as the pass stands now.
    /// Nodes that there were before stay. What is itself unsure by more (light paths are drawn) needs be on the line no better than that.
    ///
    /// # Errors
    /// [`PassError::Light`].
    pub fn thin(&mut self, tolerance: f64) -> Result<Thinned, PassError> {
        let epochs = self.places.len();
        // Single observations lie on no line in time.
        if epochs < 3 || !self.pass.observations.is_empty() {
            return Ok(Thinned { epochs, direct: epochs, indirect: epochs, error: 0.0 });
        }
        let times_s: Vec<f64> =
            self.places.iter().map(|p| tai_nanoseconds(p.geometry.epoch) as f64 * 1e-9).collect();
        let mut order: Vec<usize> = (0..epochs).collect();
        order.sort_by(|a, b| times_s[*a].total_cmp(&times_s[*b]));
        let all: Vec<usize> = (0..epochs).collect();
        let rows = self.rows(&all, &direct)?;
        let light = self.all_light(&rows);
        let way =
            Way { order: &order, times_s: &times_s, light: &light, tolerance: 0.5 * tolerance };
        let (own, straight) = self.thin_direct(&way, &rows);
        let (others, bent, at_nodes) = self.thin_indirect(&way)?;
        let count =
            |nodes: &Option<Nodes>, all: usize| nodes.as_ref().map_or(all, |n| n.chosen.len());
        let lit = &self.engine.terms()[..self.engine.lit_terms()];
        let most = if lit.iter().any(|t| indirect(t.source)) { epochs } else { 0 };
        let found = Thinned {
            epochs,
            direct: count(&own, epochs),
            indirect: count(&others, most),
            error: straight + bent,
        };
        self.nodes = [own, others];
        self.indirect = at_nodes;
        Ok(found)
    }

    /// Nodes of direct light, which is known at all epochs: where the largest error of an interval is too large, its epoch becomes a node.
    fn thin_direct(&self, way: &Way, rows: &[Row]) -> (Option<Nodes>, f64) {
        let mut chosen = self.before(0, way, TURN_RAD);
        let mut open = intervals(&chosen);
        let mut error = 0.0_f64;
        while let Some([a, b]) = open.pop() {
            let ends = [a, b].map(|k| &rows[way.order[k]]);
            let off = |k: usize| {
                let i = way.order[k];
                self.off_the_line([ends[0], &rows[i], ends[1]], way.along(a, k, b), &way.light[i]).0
            };
            let worst = (a + 1..b).map(|k| (k, off(k))).max_by(|x, y| x.1.total_cmp(&y.1));
            match worst {
                Some((k, off)) if off > way.tolerance => {
                    chosen.push(k);
                    open.extend(intervals(&[a, k, b]));
                }
                Some((_, off)) => error = error.max(off),
                None => {}
            }
        }
        if chosen.len() as f64 > WORTH * way.order.len() as f64 {
            return (None, 0.0);
        }
        chosen.sort_unstable();
        (Some(Nodes::new(way.order.to_vec(), chosen, way.times_s)), error)
    }

    /// Nodes of indirect light, which is computed at them and in the middle between two of them alone; their error, and the light at them.
    fn thin_indirect(&self, way: &Way) -> Result<Indirect, PassError> {
        let lit = &self.engine.terms()[..self.engine.lit_terms()];
        if !lit.iter().any(|t| indirect(t.source)) {
            return Ok((None, 0.0, None));
        }
        let mut nodes = self.before(1, way, INDIRECT_TURN_RAD);
        let mut rows: Vec<Option<Row>> = vec![None; way.order.len()];
        let mut open = intervals(&nodes);
        let mut error = 0.0_f64;
        // Level by level, so that each has many epochs for all threads.
        while !open.is_empty() {
            let ends = open.iter().flat_map(|[a, b]| [*a, (a + b) / 2, *b]);
            let mut wanted: Vec<usize> = ends.map(|k| way.order[k]).collect();
            wanted.sort_unstable();
            wanted.dedup();
            wanted.retain(|i| rows[*i].is_none());
            for (i, row) in wanted.iter().zip(self.rows(&wanted, &indirect)?) {
                rows[*i] = Some(row);
            }
            let mut next = Vec::new();
            for [a, b] in open {
                let middle = (a + b) / 2;
                let all = [a, middle, b].map(|k| way.order[k]);
                let [Some(low), Some(own), Some(high)] = all.map(|i| rows[i].as_ref()) else {
                    continue;
                };
                let along = way.along(a, middle, b);
                let (off, unsure) = self.off_the_line([low, own, high], along, &way.light[all[1]]);
                let off = AWAY * off;
                if off > way.tolerance.max(unsure) {
                    nodes.push(middle);
                    next.extend(intervals(&[a, middle, b]));
                } else if off > unsure {
                    error = error.max(off);
                }
            }
            open = next;
        }
        nodes.sort_unstable();
        let at_nodes = nodes.iter().map(|k| rows[way.order[*k]].take()).collect();
        Ok((Some(Nodes::new(way.order.to_vec(), nodes, way.times_s)), error, at_nodes))
    }

    /// Returns the error of the lines between the nodes, as the pass stands now. `None` where light is computed at all epochs.
    ///
    /// # Errors
    /// [`PassError::Light`].
    pub fn thinned(&self) -> Result<Option<Thinned>, PassError> {
        let [own, others] = &self.nodes;
        if own.is_none() && others.is_none() {
            return Ok(None);
        }
        let epochs = self.places.len();
        let all: Vec<usize> = (0..epochs).collect();
        let rows = self.rows(&all, &direct)?;
        let light = self.all_light(&rows);
        let mut found = Thinned { epochs, direct: epochs, indirect: 0, error: 0.0 };
        if let Some(nodes) = own {
            found.direct = nodes.chosen.len();
            let off = all.iter().map(|i| {
                let (k, along) = nodes.within[*i];
                let ends = [nodes.chosen[k], nodes.chosen[k + 1]].map(|k| &rows[nodes.order[k]]);
                self.off_the_line([ends[0], &rows[*i], ends[1]], along, &light[*i]).0
            });
            found.error += off.fold(0.0, f64::max);
        }
        if let Some(nodes) = others {
            found.indirect = nodes.chosen.len();
            let at_nodes = self.rows(&nodes.epochs().collect::<Vec<_>>(), &indirect)?;
            let open = nodes.chosen.windows(2).enumerate().filter(|(_, e)| e[1] > e[0] + 1);
            let middles: Vec<(usize, usize)> =
                open.map(|(k, ends)| (k, nodes.order[(ends[0] + ends[1]) / 2])).collect();
            let own = self.rows(&middles.iter().map(|(_, i)| *i).collect::<Vec<_>>(), &indirect)?;
            let off = middles.iter().zip(&own).map(|((k, i), own)| {
                let ends = [&at_nodes[*k], own, &at_nodes[k + 1]];
                let (off, unsure) = self.off_the_line(ends, nodes.within[*i].1, &light[*i]);
                if AWAY * off > unsure { AWAY * off } else { 0.0 }
            });
            found.error += off.fold(0.0, f64::max);
        }
        Ok(Some(found))
    }

    /// Nodes that there were, or both ends, and what the body's turning asks for.
    fn before(&self, set: usize, way: &Way, turn_rad: f64) -> Vec<usize> {
        let mut chosen = match &self.nodes[set] {
            Some(nodes) => nodes.chosen.clone(),
            None => vec![0, way.order.len() - 1],
        };
        chosen.extend(self.by_turns(way.order, turn_rad));
        chosen.sort_unstable();
        chosen.dedup();
        chosen
    }

    /// Places in an order of epochs between which the body turns by so much at most.
    fn by_turns(&self, order: &[usize], most_rad: f64) -> Vec<usize> {
        let (mut all, mut last) = (Vec::new(), 0);
        for k in 1..order.len() {
            let [a, b] = [last, k].map(|k| &self.places[order[k]]);
            let turned = |a: glam::DVec3, b: glam::DVec3| a.angle_between(b) > most_rad;
            if turned(a.sun_body, b.sun_body) || turned(a.observer_body, b.observer_body) {
                last = (k - 1).max(last + 1);
                all.push(last);
            }
        }
        all
    }

    /// Weights of light that came by some ways, at some epochs.
    fn rows(
        &self,
        epochs: &[usize],
        wanted: &(dyn Fn(Source) -> bool + Sync),
    ) -> Result<Vec<Row>, PassError> {
        self.rows_by(&self.engine, epochs, wanted)
    }

    /// The same by an engine of the same terms.
    fn rows_by(
        &self,
        engine: &Engine,
        epochs: &[usize],
        wanted: &(dyn Fn(Source) -> bool + Sync),
    ) -> Result<Vec<Row>, PassError> {
        let rows = epochs.par_iter().map_init(
            || engine.worker(),
            |worker, i| {
                let room = vec![0.0; engine.terms().len()];
                let (mut weights, mut errors) = (room.clone(), room);
                weigh(worker, &self.places[*i], wanted, &mut weights, &mut errors)?;
                Ok((weights, errors))
            },
        );
        first_error(rows.collect())
    }

    /// The weights of light that came by another way than straight from the Sun, by an engine of the same terms, at all epochs.
    pub(super) fn indirect_by(&self, engine: &Engine) -> Result<Vec<Vec<f64>>, PassError> {
        let n = self.places.len();
        let Some(nodes) = &self.nodes[1] else {
            let rows = self.rows_by(engine, &(0..n).collect::<Vec<_>>(), &indirect)?;
            return Ok(rows.into_iter().map(|(weights, _)| weights).collect());
        };
        let found = self.rows_by(engine, &nodes.epochs().collect::<Vec<_>>(), &indirect)?;
        let mut rows = vec![vec![0.0; engine.terms().len()]; n];
        rows.iter_mut().enumerate().for_each(|(i, row)| nodes.add(i, &found, row));
        Ok(rows)
    }

    /// The weights of all light at all epochs, one row an epoch.
    pub(super) fn weights(&self) -> Result<Vec<Row>, PassError> {
        let all: Vec<usize> = (0..self.places.len()).collect();
        let [own, others] = &self.nodes;
        let at = |nodes: &Option<Nodes>, wanted: &(dyn Fn(Source) -> bool + Sync)| {
            let epochs = nodes.as_ref().map(|n| n.epochs().collect::<Vec<_>>());
            epochs.map(|epochs| self.rows(&epochs, wanted)).transpose()
        };
        let straight = at(own, &direct)?;
        let bent = match &self.indirect {
            Some(known) if others.is_some() => Some(known.clone()),
            _ => at(others, &indirect)?,
        };
        let mut rows = match (&straight, &bent) {
            (None, None) => self.rows(&all, &|_| true)?,
            (None, Some(_)) => self.rows(&all, &direct)?,
            (Some(_), None) => self.rows(&all, &indirect)?,
            (Some(_), Some(_)) => {
                vec![(vec![0.0; self.engine.terms().len()], Vec::new()); all.len()]
            }
        };
        for (nodes, found) in [(own, straight), (others, bent)] {
            if let (Some(nodes), Some(found)) = (nodes, found) {
                rows.iter_mut().enumerate().for_each(|(i, row)| nodes.add(i, &found, &mut row.0));
            }
        }
        Ok(rows)
    }

    /// Returns the direct light in all channels and bands at each epoch, at least a hundredth of the most.
    fn all_light(&self, rows: &[Row]) -> Vec<Vec<f64>> {
        let mut rows: Vec<Vec<f64>> = rows.iter().map(|(w, _)| self.summed(w)).collect();
        for q in 0..self.quantities() {
            let most = rows.iter().map(|r| r[q]).fold(0.0, f64::max);
            rows.iter_mut().for_each(|r| r[q] = r[q].max(FAINT * most));
        }
        rows
    }

    /// How far light lies from the line between two epochs, and how unsure it is itself, of all light.
    fn off_the_line(&self, [low, own, high]: [&Row; 3], along: f64, light: &[f64]) -> (f64, f64) {
        let line = low.0.iter().zip(&high.0).map(|(a, b)| a + along * (b - a));
        let off: Vec<f64> = line.zip(&own.0).map(|(line, own)| (own - line).abs()).collect();
        let (off, unsure, own) = (self.summed(&off), self.summed(&own.1), self.summed(&own.0));
        let (mut most, mut least) = (0.0_f64, 0.0_f64);
        for q in 0..self.quantities() {
            // Of direct light its own is all; of other the larger of both is no more than all.
            let all = light[q].max(own[q].abs());
            if all > 0.0 {
                most = most.max(off[q] / all);
                least = least.max(unsure[q] / all);
            }
        }
        (most, least)
    }

    fn quantities(&self) -> usize {
        self.pass.station.channels.len() + BANDS.len()
    }

    /// Returns the light of weights in each channel and band above the air, distances aside.
    fn summed(&self, weights: &[f64]) -> Vec<f64> {
        (0..self.quantities()).map(|q| self.functionals.sums.above(q, weights)).collect()
    }
}

/// Inputs for finding nodes.
struct Way<'a> {
    /// Epochs in the order of their times.
    order: &'a [usize],
    /// The times of all epochs, s.
    times_s: &'a [f64],
    /// All light of each epoch, by quantity.
    light: &'a [Vec<f64>],
    /// Error allowed on the lines, as a share of that light.
    tolerance: f64,
}

impl Way<'_> {
    /// How far along from one place to another a third is, in time.
    fn along(&self, from: usize, at: usize, to: usize) -> f64 {
        let [from, at, to] = [from, at, to].map(|k| self.times_s[self.order[k]]);
        if to > from { (at - from) / (to - from) } else { 0.0 }
    }
}

/// Neighbours among places, of those that have others between them.
fn intervals(places: &[usize]) -> Vec<[usize; 2]> {
    places.windows(2).map(|p| [p[0], p[1]]).filter(|[a, b]| *b > a + 1).collect()
}
