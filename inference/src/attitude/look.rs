//! The first look in two steps: all axes at few epochs, then closer about the best of them.
//!
//! A wrong axis rarely fits a few epochs by chance, whatever its period and phase: sixteen epochs tell which part of the sphere the axis is in, and the grid there can be finer for less than half of the
//! simulations that all axes at all epochs would take.

use super::AttitudeError;
use super::coarse::{self, Look, Place};
use super::hunt::{Hunt, spread_out};
use super::question::{Checkpoint, Progress};
use super::state::{Law, State, Turn};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::hash_map::DefaultHasher;
use std::f64::consts::PI;
use std::hash::{Hash as _, Hasher as _};
use sunglint_numerics::sphere::spread;

/// Epochs at which all axes are looked at, of one period; each doubling of the periods that chance can choose from takes one more.
const EPOCHS: f64 = 4.0;
/// Epochs of the closer look.
const CLOSER_EPOCHS: usize = 48;
/// The closer look is about one axis in so many.
const OF_ALL: usize = 8;
/// Axes of the closer look for each of the first.
const CLOSER: usize = 4;
/// How far about a first axis the closer ones lie, in mean distances between the first ones.
const REACH: f64 = 0.6;
/// Axes that are looked at side by side between two reports.
const CHUNK: usize = 64;
/// Starts nearer than this are one, radians.
const NEAR: f64 = 0.10;

/// Result of the first look at all axes.
pub(super) struct Seen {
    /// The axes of the closer look, and the best places of each.
    axes: Vec<DVec3>,
    places: Vec<Vec<Place>>,
    /// All axes, and the mean cost of the best place of each.
    pub surface: Vec<(DVec3, f64)>,
    /// Periods that were tried.
    pub rates: usize,
    /// Epochs that were simulated.
    pub simulated: usize,
}

impl Hunt<'_> {
    /// The first look, with so many times the usual number of axes, at moments of `own`.
    pub(super) fn look(
        &self,
        law: &Law,
        own: &[usize],
        times: usize,
        from: Option<&Checkpoint>,
    ) -> Result<Seen, AttitudeError> {
        let question = self.question;
        let rates: Vec<f64> = match question.unknowns.period {
            true => question
                .rates
                .iter()
                .flat_map(|(low, high)| coarse::rates(*low, *high, law, question.unknowns))
                .collect(),
            false => vec![question.known.turns_per_s],
        };
        if rates.len() > super::MOST_RATES {
            return Err(AttitudeError::TooManyPeriods {
                periods: rates.len(),
                most: super::MOST_RATES,
            });
        }
        let of = self.fingerprint();
        if from.is_some_and(|c| c.of != of) {
            return Err(AttitudeError::Checkpoint);
        }
        let mut checkpoint = match from.filter(|c| c.times == times) {
            Some(from) => from.clone(),
            None => Checkpoint { of, times, wide: Vec::new(), closer: Vec::new() },
        };
        let epochs = (EPOCHS + (rates.len() as f64).log2()).ceil() as usize;
        let few = spread_out(own, epochs, self.options.seed + 4);
        let more = spread_out(own, CLOSER_EPOCHS, self.options.seed);
        let look = |moments| Look {
            forward: self.forward,
            compared: self.compared,
            law,
            unknowns: question.unknowns,
            moments,
            rates: &rates,
            phase_rad: question.known.phase_rad,
            scale: question.scale,
        };
        let mut simulated = 0;
        let shift = (self.options.seed as f64 * 0.618_033_988_749_895).fract();
        let all = match question.unknowns.axis {
            true => spread(self.options.axes.max(12) * times, shift),
            false => vec![question.known.axis_gcrs],
        };
        let axes = if question.unknowns.axis {
            let look = look(&few);
            self.chunks(
                &mut checkpoint,
                "all axes",
                all.len(),
                |c| &mut c.wide,
                |i| Ok(look.axis(i, all[i])?.first().map_or(f64::INFINITY, |p| p.cost)),
            )?;
            simulated += all.len() * coarse::PHASES * few.len();
            closer(&all, &checkpoint.wide, shift)
        } else {
            all.clone()
        };
        let look = look(&more);
        self.chunks(
            &mut checkpoint,
            "the best axes",
            axes.len(),
            |c| &mut c.closer,
            |i| look.axis(i, axes[i]),
        )?;
        simulated += axes.len() * coarse::PHASES * more.len();
        let surface = all.into_iter().zip(checkpoint.wide).collect();
        Ok(Seen { axes, places: checkpoint.closer, surface, rates: rates.len(), simulated })
    }

    /// Looks at so many axes, chunk by chunk, from where the checkpoint ends.
    fn chunks<T: Send>(
        &self,
        checkpoint: &mut Checkpoint,
        stage: &'static str,
        of: usize,
        list: fn(&mut Checkpoint) -> &mut Vec<T>,
        at: impl Fn(usize) -> Result<T, AttitudeError> + Sync,
    ) -> Result<(), AttitudeError> {
        // A checkpoint that has more was not written by this search.
        if list(checkpoint).len() > of {
            return Err(AttitudeError::Checkpoint);
        }
        while list(checkpoint).len() < of {
            let done = list(checkpoint).len();
            self.watch.tell(Progress { stage, done, of });
            let chunk: Vec<usize> = (done..(done + CHUNK).min(of)).collect();
            let found: Result<Vec<T>, _> = chunk.into_par_iter().map(&at).collect();
            list(checkpoint).extend(found?);
            self.watch.keep(checkpoint);
        }
        Ok(())
    }

    /// The best places, each some way from the others.
    pub(super) fn starts(
        &self,
        law: &Law,
        seen: &Seen,
        most: usize,
    ) -> Result<Vec<State>, AttitudeError> {
        let mut all: Vec<Place> = seen.places.iter().flatten().copied().collect();
        all.sort_by(|a, b| a.cost.total_cmp(&b.cost).then(a.axis.cmp(&b.axis)));
        let mut starts: Vec<State> = Vec::new();
        for place in all {
            if starts.len() >= most {
                break;
            }
            let axis_gcrs = seen.axes[place.axis];
            let state = if self.question.unknowns.phase {
                place.state(law, axis_gcrs)?
            } else {
                // The grid's phase is rounded; the known one is not.
                let known = self.question.known;
                law.state(&Turn { axis_gcrs, turns_per_s: place.turns_per_s, ..known })?
            };
            if starts.iter().all(|s| law.apart(s, &state) > NEAR) {
                starts.push(state);
            }
        }
        Ok(starts)
    }

    /// Returns a hash of the question and the data, by which a checkpoint is recognised.
    fn fingerprint(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        let mut number = |v: f64| v.to_bits().hash(&mut hasher);
        let f = self.forward;
        f.rate.iter().chain(&f.sigma).for_each(|v| number(*v));
        (0..f.moments.len()).for_each(|m| f.unit_rates(m).iter().for_each(|v| number(*v)));
        f.moments.iter().for_each(|m| {
            number(m.time_s);
            m.to_sun.to_array().into_iter().chain(m.to_observer.to_array()).for_each(&mut number);
        });
        let q = self.question;
        q.axis_body.to_array().into_iter().for_each(&mut number);
        q.known.axis_gcrs.to_array().into_iter().for_each(&mut number);
        [q.known.turns_per_s, q.known.phase_rad].into_iter().for_each(&mut number);
        q.rates.iter().for_each(|(a, b)| {
            number(*a);
            number(*b);
        });
        (q.scale as u8, q.unknowns.axis, q.unknowns.phase, q.unknowns.period).hash(&mut hasher);
        (self.options.seed, self.options.axes).hash(&mut hasher);
        hasher.finish()
    }
}

/// A finer grid about the best of the axes.
fn closer(axes: &[DVec3], costs: &[f64], shift: f64) -> Vec<DVec3> {
    let mut order: Vec<usize> = (0..axes.len()).collect();
    order.sort_by(|a, b| costs[*a].total_cmp(&costs[*b]).then(a.cmp(b)));
    order.truncate((axes.len() / OF_ALL).max(1));
    let distance = (4.0 * PI / axes.len() as f64).sqrt();
    let least = (REACH * distance).min(PI).cos();
    let mut all = spread(CLOSER * axes.len(), shift);
    all.retain(|axis| order.iter().any(|i| axes[*i].dot(*axis) >= least));
    all
}
