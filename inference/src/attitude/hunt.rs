//! Parts that all stages of the search share: descents from many trials side by side, minima that are told apart, twins.

use super::AttitudeError;
use super::compare::Compared;
use super::descent::{Descent, Found, Sample, Space};
use super::forward::Forward;
use super::question::{Options, Progress, Question, Watch};
use super::state::{Law, State};
use super::twins::{self, Symmetry};
use rayon::prelude::*;
use std::sync::Arc;
use sunglint_numerics::order::median;

/// Trials nearer than this at both ends and in the middle of the data are one, radians.
const SAME: f64 = 0.035;

/// Inputs that all stages of the search share.
#[derive(Clone, Copy)]
pub(super) struct Hunt<'a> {
    pub question: &'a Question,
    pub options: &'a Options,
    pub forward: &'a Forward,
    pub compared: &'a Compared,
    pub materials: &'a [usize],
    pub symmetries: &'a [Symmetry],
    pub watch: &'a dyn Watch,
}

/// A trial to go down from, with the light that is added to it.
#[derive(Debug, Clone)]
pub(super) struct Trial {
    pub state: State,
    pub held: Option<Arc<Vec<f64>>>,
    /// The sum of squares that it came with; 0 where it is not known.
    pub cost: f64,
}

impl Trial {
    pub fn of(found: &Found) -> Self {
        Self { state: found.state, held: found.held.clone(), cost: found.cost }
    }
}

impl Hunt<'_> {
    /// A descent by direct light.
    pub fn descent<'b>(&'b self, law: &'b Law, moments: &'b [usize], space: Space) -> Descent<'b> {
        Descent {
            forward: self.forward,
            compared: self.compared,
            law,
            unknowns: self.question.unknowns,
            moments,
            space,
            scale: self.question.scale,
            materials: self.materials,
            held: None,
        }
    }

    /// Goes down from all of them, side by side; the best first.
    pub(super) fn descend(
        &self,
        law: &Law,
        moments: &[usize],
        space: Space,
        starts: &[State],
        most: usize,
        stage: &'static str,
    ) -> Result<Vec<Found>, AttitudeError> {
        let trials: Vec<Trial> =
            starts.iter().map(|state| Trial { state: *state, held: None, cost: 0.0 }).collect();
        self.descend_from(law, moments, space, &trials, most, stage)
    }

    /// The same with the light that each has added.
    pub(super) fn descend_from(
        &self,
        law: &Law,
        moments: &[usize],
        space: Space,
        trials: &[Trial],
        most: usize,
        stage: &'static str,
    ) -> Result<Vec<Found>, AttitudeError> {
        self.watch.tell(Progress { stage, done: 0, of: trials.len() });
        let found: Result<Vec<Found>, AttitudeError> = trials
            .par_iter()
            .map_init(
                || self.forward.eye(),
                |eye, trial| {
                    let mut descent = self.descent(law, moments, space);
                    descent.held = trial.held.as_ref().map(|h| h.as_slice());
                    let found = descent.down(eye, &trial.state, most)?;
                    Ok(Found { held: trial.held.clone(), ..found })
                },
            )
            .collect();
        Ok(self.distinct(law, found?, usize::MAX))
    }

    /// The best first, each some way from the others.
    pub(super) fn distinct(&self, law: &Law, mut found: Vec<Found>, most: usize) -> Vec<Found> {
        found.retain(|f| f.cost.is_finite());
        found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let mut kept: Vec<Found> = Vec::new();
        for f in found {
            if kept.len() >= most {
                break;
            }
            if kept.iter().all(|k| law.apart(&k.state, &f.state) > SAME) {
                kept.push(f);
            }
        }
        kept
    }

    /// Returns the trials that the symmetries make of some minima. A sense, an axis or a phase that is known stays so.
    pub(super) fn twins_of(&self, law: &Law, minima: &[Found]) -> Vec<State> {
        let unknowns = self.question.unknowns;
        if !(unknowns.axis && unknowns.phase) {
            return Vec::new();
        }
        let inside = |rate: f64| match unknowns.period {
            true => self.question.rates.iter().any(|(low, high)| (*low..=*high).contains(&rate)),
            false => (rate - self.question.known.turns_per_s).abs() <= 1e-12 * rate.abs(),
        };
        let of = |m: &Found| twins::twins(self.forward, law, &m.state, self.symmetries);
        let all = minima.iter().flat_map(of).map(|(_, state)| state);
        all.filter(|s| inside(s.turns_per_s)).collect()
    }

    /// Returns the light that the model leaves unexplained, as a median difference of logarithms beyond the stated noise.
    pub(super) fn left_over(&self, samples: &[Sample]) -> f64 {
        let off = samples.iter().map(|s| {
            let ln = |rate: f64| self.compared.ln(s.moment, s.channel, rate);
            (ln(s.rate) - ln(s.model)).abs() - self.compared.sigma(s.moment, s.channel)
        });
        median(off.filter(|v| v.is_finite())).unwrap_or(f64::INFINITY)
    }
}

/// So many of them, evenly spread but for chance within each stretch: no period of the data falls together with that of the choice.
pub(super) fn spread_out(all: &[usize], most: usize, seed: u64) -> Vec<usize> {
    use rand::{RngExt as _, SeedableRng as _};
    if all.len() <= most {
        return all.to_vec();
    }
    let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut chosen: Vec<usize> = (0..most)
        .map(|i| {
            let at = (i as f64 + random.random::<f64>()) / most as f64 * all.len() as f64;
            all[(at as usize).min(all.len() - 1)]
        })
        .collect();
    chosen.dedup();
    chosen
}

/// The noise beyond the stated that brings the middle residual to where a normal distribution has it, of the rate.
pub(super) fn extra_noise(samples: &[Sample]) -> f64 {
    // The median of |x| of a normal distribution.
    const MIDDLE: f64 = 0.674_489_750_196_081_7;
    let middle = |extra: f64| {
        let all = samples.iter().map(|s| (s.rate - s.model).abs() / s.sigma.hypot(extra * s.model));
        median(all.filter(|v| v.is_finite())).unwrap_or(0.0)
    };
    if middle(0.0) <= MIDDLE {
        return 0.0;
    }
    let (mut low, mut high) = (0.0, 10.0);
    for _ in 0..50 {
        let half = 0.5 * (low + high);
        if middle(half) > MIDDLE { low = half } else { high = half }
    }
    0.5 * (low + high)
}
