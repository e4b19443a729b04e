//! The first curve: a look at everything, descents from the best places and from their twins.

use super::AttitudeError;
use super::coarse;
use super::descent::Found;
use super::descent::Space;
use super::hunt::{Hunt, spread_out};
use super::question::{Checkpoint, Progress};
use super::state::{Law, State, Turn};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash as _, Hasher as _};

/// Epochs of the first look, and of the first descents.
pub(super) const FIRST: usize = 64;
/// Epochs of the second descents.
pub(super) const SECOND: usize = 240;
/// Axes that are looked at side by side between two reports.
const CHUNK: usize = 64;
/// Where the first descents start, of a usual search.
const STARTS: usize = 160;
/// Minima that are carried on.
pub(super) const CARRIED: usize = 24;
/// Starts nearer than this are one.
const NEAR: f64 = 0.10;
/// Where more than this is left over of the light, the search is made again, finer.
const POOR: f64 = 0.18;

/// What the first curve says.
pub(super) struct First {
    pub minima: Vec<Found>,
    pub surface: Vec<(DVec3, f64)>,
    pub simulated: usize,
    pub finer: bool,
    pub rates: usize,
}

impl Hunt<'_> {
    /// Minima by the longest curve alone.
    pub(super) fn first_curve(
        &self,
        law: &Law,
        from: Option<&Checkpoint>,
        finer: bool,
    ) -> Result<(First, Law), AttitudeError> {
        let order = self.order();
        let own = self.moments_of(&order[..1]);
        let law = self.law_about(law, &own);
        let few = spread_out(&own, FIRST, self.options.seed);
        let more = spread_out(&own, SECOND, self.options.seed + 1);
        let mut simulated = 0;
        let mut finer = finer || from.is_some_and(|c| c.finer);
        loop {
            let times = if finer { 3 } else { 1 };
            let (places, axes, rates) = self.look(&law, &few, times, from, finer)?;
            simulated += axes.len() * coarse::PHASES * few.len();
            let surface: Vec<(DVec3, f64)> = axes
                .iter()
                .zip(&places)
                .map(|(a, p)| (*a, p.first().map_or(f64::NAN, |p| p.cost)))
                .collect();
            let starts = self.starts(&law, &few, &places, &axes, STARTS * times)?;
            let space = Space::Logarithms { spread: 0.15 };
            let mut minima = self.descend(&law, &few, space, &starts, 15, "descents")?;
            minima.truncate(CARRIED);
            let twins = self.twins_of(&law, &minima[..minima.len().min(4)]);
            minima.extend(self.descend(&law, &few, space, &twins, 15, "twins")?);
            let minima = self.distinct(&law, minima, CARRIED);
            simulated += minima.iter().map(|m| m.simulated).sum::<usize>();
            let starts: Vec<State> = minima.iter().map(|m| m.state).collect();
            let wide = self.descend(
                &law,
                &more,
                Space::Logarithms { spread: 0.2 },
                &starts,
                20,
                "descents",
            )?;
            simulated += wide.iter().map(|m| m.simulated).sum::<usize>();
            let starts: Vec<State> = wide.iter().map(|m| m.state).collect();
            let space = Space::Logarithms { spread: 0.07 };
            let mut minima = self.descend(&law, &more, space, &starts, 20, "descents")?;
            let twins = self.twins_of(&law, &minima[..minima.len().min(3)]);
            minima.extend(self.descend(&law, &more, space, &twins, 20, "twins")?);
            let minima = self.distinct(&law, minima, CARRIED / 2);
            simulated += minima.iter().map(|m| m.simulated).sum::<usize>();
            let best = minima.first().ok_or(AttitudeError::NoMinimum)?;
            let descent = self.descent(&law, &more, space);
            let samples = descent.samples(&mut self.forward.eye(), &best.state)?;
            if self.left_over(&samples) < POOR || finer {
                let rates = rates.len();
                return Ok((First { minima, surface, simulated, finer, rates }, law));
            }
            finer = true;
        }
    }

    /// The first look at all axes.
    #[expect(clippy::type_complexity, reason = "three lists that belong together")]
    fn look(
        &self,
        law: &Law,
        few: &[usize],
        times: usize,
        from: Option<&Checkpoint>,
        finer: bool,
    ) -> Result<(Vec<Vec<coarse::Place>>, Vec<DVec3>, Vec<f64>), AttitudeError> {
        let question = self.question;
        let shift = (self.options.seed as f64 * 0.618_033_988_749_895).fract();
        let axes = match question.unknowns.axis {
            true => coarse::axes(self.options.axes.max(12) * times, shift),
            false => vec![question.known.axis_gcrs],
        };
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
        let look = coarse::Look {
            forward: self.forward,
            compared: self.compared,
            law,
            unknowns: question.unknowns,
            moments: few,
            rates: &rates,
            phase_rad: question.known.phase_rad,
            scale: question.scale,
        };
        let of = self.fingerprint();
        if from.is_some_and(|c| c.of != of) {
            return Err(AttitudeError::Checkpoint);
        }
        let mut checkpoint = match from.filter(|c| c.finer == finer && c.places.len() <= axes.len())
        {
            Some(from) => from.clone(),
            None => Checkpoint { of, finer, places: Vec::new() },
        };
        while checkpoint.places.len() < axes.len() {
            let done = checkpoint.places.len();
            self.watch.tell(Progress { stage: "all axes", done, of: axes.len() });
            let chunk: Vec<usize> = (done..(done + CHUNK).min(axes.len())).collect();
            let found: Result<Vec<_>, _> =
                chunk.into_par_iter().map(|i| look.axis(i, axes[i])).collect();
            checkpoint.places.extend(found?);
            self.watch.keep(&checkpoint);
        }
        Ok((checkpoint.places, axes, rates))
    }

    /// The best places, each some way from the others.
    fn starts(
        &self,
        law: &Law,
        few: &[usize],
        places: &[Vec<coarse::Place>],
        axes: &[DVec3],
        most: usize,
    ) -> Result<Vec<State>, AttitudeError> {
        let look = coarse::Look {
            forward: self.forward,
            compared: self.compared,
            law,
            unknowns: self.question.unknowns,
            moments: few,
            rates: &[],
            phase_rad: self.question.known.phase_rad,
            scale: self.question.scale,
        };
        let mut all: Vec<coarse::Place> = places.iter().flatten().copied().collect();
        all.sort_by(|a, b| a.cost.total_cmp(&b.cost).then(a.axis.cmp(&b.axis)));
        let mut starts: Vec<State> = Vec::new();
        for place in all {
            if starts.len() >= most {
                break;
            }
            let mut state = look.state(&place, axes[place.axis])?;
            if !self.question.unknowns.phase {
                // The grid's phase is rounded; the known one is not.
                let known = self.question.known;
                let axis_gcrs = axes[place.axis];
                state = law.state(&Turn { axis_gcrs, turns_per_s: place.turns_per_s, ..known })?;
            }
            if starts.iter().all(|s| law.apart(s, &state) > NEAR) {
                starts.push(state);
            }
        }
        Ok(starts)
    }

    /// What question and data these are.
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
