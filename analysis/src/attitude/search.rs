//! The search: a first look at everything, descents from the best places and from their twins, then all samples.

use super::compare::{Compared, median};
use super::descent::{Descent, Found, Sample, Space};
use super::forward::{Forward, Measured};
use super::light::AllLight;
use super::state::{Law, State, Turn, Unknowns};
use super::twins::{self, Symmetry};
use super::{AttitudeError, LEAST_EPOCHS, Scale, coarse};
use glam::DVec3;
use hifitime::Epoch;
use rayon::prelude::*;
use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash as _, Hasher as _};
use std::sync::Arc;

/// Epochs of the first look, and of the first descents.
const FIRST: usize = 64;
/// Epochs of the second descents.
const SECOND: usize = 240;
/// Epochs of the last descents at most.
const LAST: usize = 1500;
/// Axes that are looked at side by side between two reports.
const CHUNK: usize = 64;
/// Where the first descents start, of a usual search.
const STARTS: usize = 160;
/// Minima that are carried on.
const CARRIED: usize = 24;
/// Minima that stand in the answer at most.
const ANSWERED: usize = 8;
/// Trials nearer than this at both ends and in the middle of the data are one, radians.
const SAME: f64 = 0.035;
/// Starts nearer than this are one.
const NEAR: f64 = 0.10;
/// Where more than this is left over of the light, the search is made again, finer.
const POOR: f64 = 0.18;
/// How often light by other ways is computed anew.
const ROUNDS: usize = 4;
/// Minima that get all light.
const ALL_LIT: usize = 3;

/// What is asked.
#[derive(Debug, Clone)]
pub struct Question {
    /// The axis of the spin in the body.
    pub axis_body: DVec3,
    /// When the phase counts.
    pub epoch: Epoch,
    /// What is unknown.
    pub unknowns: Unknowns,
    /// What is known: of it counts what is not unknown.
    pub known: Turn,
    /// Turns a second between which the spin is looked for, pairs of a lower and an upper bound; negative ones are left-handed.
    pub rates: Vec<(f64, f64)>,
    /// What of the brightness is free.
    pub scale: Scale,
}

/// How it is searched.
#[derive(Debug, Clone)]
pub struct Options {
    /// The seed of which epochs are taken first, and of how the grid of axes lies.
    pub seed: u64,
    /// Axes of the first look.
    pub axes: usize,
    /// Whether light by other ways than the direct one is added at the end, as far as the scene does not switch it off.
    pub all_light: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { seed: 0, axes: 640, all_light: true }
    }
}

/// How far the search is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// What is done.
    pub stage: &'static str,
    /// How much of it.
    pub done: usize,
    /// Of how much.
    pub of: usize,
}

/// What a search that was cut off can go on from.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Checkpoint {
    /// Of which question and which data.
    pub of: u64,
    /// Whether it is the usual or the finer look.
    pub finer: bool,
    /// Places of the axes that were looked at.
    pub places: Vec<Vec<coarse::Place>>,
}

/// Who is told.
pub trait Watch: Sync {
    /// Something was done.
    fn tell(&self, progress: Progress);
    /// What was done could be kept; called between chunks of the first look.
    fn keep(&self, checkpoint: &Checkpoint);
}

/// Nobody.
impl Watch for () {
    fn tell(&self, _: Progress) {}
    fn keep(&self, _: &Checkpoint) {}
}

/// Minima, before it is said what they mean.
pub(super) struct Searched {
    pub forward: Forward,
    pub law: Law,
    pub materials: Vec<usize>,
    pub moments: Vec<usize>,
    pub minima: Vec<Found>,
    /// Noise beyond the stated, of the rate.
    pub extra: f64,
    pub symmetries: Vec<Symmetry>,
    pub surface: Vec<(DVec3, f64)>,
    pub simulated: usize,
    pub finer: bool,
    pub rates: usize,
    /// The median and the largest share of light by other ways than the direct one, at the best.
    pub other_light: (f64, f64),
    pub warnings: Vec<String>,
}

/// What all stages share.
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

pub(super) fn search(
    curves: &[Measured],
    question: &Question,
    options: &Options,
    watch: &dyn Watch,
    from: Option<&Checkpoint>,
    finer: bool,
) -> Result<Searched, AttitudeError> {
    let forward = Forward::new(curves)?;
    let samples = forward.samples();
    let epochs = forward.moments.len();
    let least = LEAST_EPOCHS.min(2 * question.unknowns.count()).max(4);
    if epochs < least || samples <= question.unknowns.count() {
        return Err(AttitudeError::Few { samples, epochs, least });
    }
    let compared = Compared::new(&forward)?;
    let symmetries = twins::symmetries(&forward)?;
    let materials: Vec<usize> = (0..forward.scene.materials().len())
        .flat_map(|m| forward.scene.weights_of(m).map(move |_| m))
        .collect();
    let (first_s, last_s) = forward.ends_s();
    let law = Law::new(question.axis_body, question.epoch, forward.zero, 0.5 * (last_s - first_s))?;
    let hunt = Hunt {
        question,
        options,
        forward: &forward,
        compared: &compared,
        materials: &materials,
        symmetries: &symmetries,
        watch,
    };
    let (mut found, mut law) = hunt.first_curve(&law, from, finer)?;
    let mut warnings = Vec::new();
    let order = hunt.order();
    for n in 1..order.len() {
        (found.minima, law) = hunt.extended(&order[..=n], found.minima, &law, &mut warnings)?;
    }
    // All samples, each as uncertain as what is left over says; with all light, held as the last round has it.
    let all: Vec<usize> = (0..epochs).collect();
    let last = spread_out(&all, LAST, options.seed);
    let more = spread_out(&all, SECOND * order.len().min(4), options.seed + 3);
    found.minima.truncate(ANSWERED);
    let mut trials: Vec<Trial> = found.minima.iter().map(Trial::of).collect();
    let mut simulated = found.simulated;
    let (mut extra, mut other_light) = (0.0, (0.0, 0.0));
    let mut light: Option<AllLight> = None;
    let mut far: Vec<Trial> = Vec::new();
    for round in 0..ROUNDS {
        watch.tell(Progress { stage: "all light", done: round, of: ROUNDS });
        if options.all_light && round == 0 && hunt.wants_earth(curves) {
            hunt.lit(&law, &mut trials)?;
        }
        if options.all_light && round > 0 {
            let light = match &mut light {
                Some(light) => light,
                None => light.insert(AllLight::new(curves, &forward, &last)?),
            };
            let few = trials.len().min(ALL_LIT);
            other_light = hunt.all_lit(light, &law, &mut trials[..few])?;
        }
        let (moments, space) = match round {
            0 => (&more, Space::Logarithms { spread: 0.05 }),
            _ => (&last, Space::Rates { extra }),
        };
        let minima = hunt.descend_from(&law, moments, space, &trials, 20, "all samples")?;
        let best = minima.first().ok_or(AttitudeError::NoMinimum)?;
        let descent = hunt.descent(&law, moments, space).with(best);
        extra = extra_noise(&descent.samples(&mut forward.eye(), &best.state)?);
        simulated += minima.iter().map(|m| m.simulated).sum::<usize>();
        // What is far from the best need not be exact.
        let (cost, freedom) = (best.cost, (moments.len() * forward.channels) as f64);
        let near = |f: &Found| round == 0 || (f.cost - cost) < 0.5 * freedom + 400.0;
        far.extend(minima.iter().filter(|f| !near(f)).map(Trial::of));
        trials = minima.iter().filter(|f| near(f)).map(Trial::of).collect();
    }
    let space = Space::Rates { extra };
    let mut minima = hunt.descend_from(&law, &last, space, &trials, 12, "all samples")?;
    minima.extend(hunt.descend_from(&law, &last, space, &far, 12, "all samples")?);
    simulated += minima.iter().map(|m| m.simulated).sum::<usize>();
    let minima = hunt.distinct(&law, minima, ANSWERED);
    Ok(Searched {
        law,
        materials,
        moments: last,
        minima,
        extra,
        surface: found.surface,
        simulated,
        finer: found.finer,
        rates: found.rates,
        other_light,
        warnings,
        symmetries,
        forward,
    })
}

/// A trial to go down from, with the light that is added to it.
#[derive(Debug, Clone)]
pub(super) struct Trial {
    pub state: State,
    pub held: Option<Arc<Vec<f64>>>,
}

impl Trial {
    fn of(found: &Found) -> Self {
        Self { state: found.state, held: found.held.clone() }
    }
}

struct First {
    minima: Vec<Found>,
    surface: Vec<(DVec3, f64)>,
    simulated: usize,
    finer: bool,
    rates: usize,
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

    /// Curves by their number of epochs, the longest first.
    fn order(&self) -> Vec<usize> {
        let mut count: Vec<(usize, usize)> = Vec::new();
        for m in &self.forward.moments {
            match count.get_mut(m.curve) {
                Some(own) => own.1 += 1,
                None => {
                    (count.len()..=m.curve).for_each(|c| count.push((c, 0)));
                    count[m.curve].1 += 1;
                }
            }
        }
        count.retain(|c| c.1 > 0);
        count.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
        count.into_iter().map(|c| c.0).collect()
    }

    /// The moments of some curves.
    fn moments_of(&self, curves: &[usize]) -> Vec<usize> {
        let all = 0..self.forward.moments.len();
        all.filter(|m| curves.contains(&self.forward.moments[*m].curve)).collect()
    }

    /// The law about the middle of some moments.
    fn law_about(&self, law: &Law, moments: &[usize]) -> Law {
        let times = moments.iter().map(|m| self.forward.moments[*m].time_s);
        let (first, last) =
            times.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(t), b.max(t)));
        law.about(0.5 * (first + last), 0.5 * (last - first))
    }

    /// Minima by the longest curve alone.
    fn first_curve(
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

    /// Goes down from all of them, side by side; the best first.
    fn descend(
        &self,
        law: &Law,
        moments: &[usize],
        space: Space,
        starts: &[State],
        most: usize,
        stage: &'static str,
    ) -> Result<Vec<Found>, AttitudeError> {
        let trials: Vec<Trial> =
            starts.iter().map(|state| Trial { state: *state, held: None }).collect();
        self.descend_from(law, moments, space, &trials, most, stage)
    }

    /// The same with the light that each has added.
    fn descend_from(
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
    fn distinct(&self, law: &Law, mut found: Vec<Found>, most: usize) -> Vec<Found> {
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

    /// What the symmetries make of some minima. A sense, an axis or a phase that is known stays so.
    fn twins_of(&self, law: &Law, minima: &[Found]) -> Vec<State> {
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

    /// Minima of some curves, given those of all but the last: the period is known by the span of the former, and its error lets the turns of the last be counted in several ways.
    fn extended(
        &self,
        curves: &[usize],
        minima: Vec<Found>,
        before: &Law,
        warnings: &mut Vec<String>,
    ) -> Result<(Vec<Found>, Law), AttitudeError> {
        const MOST_WAYS: usize = 4000;
        const KEPT_WAYS: usize = 6;
        let own = self.moments_of(curves);
        let law = self.law_about(before, &own);
        let added = self.moments_of(&curves[curves.len() - 1..]);
        let few = spread_out(&added, FIRST, self.options.seed);
        let more = spread_out(&own, SECOND * curves.len().min(4), self.options.seed + 2);
        let space = Space::Logarithms { spread: 0.15 };
        let unknowns = self.question.unknowns;
        let mut starts = Vec::new();
        for found in &minima {
            let mut ways = vec![found.state];
            if unknowns.period {
                let covariance = found.normal.clone().try_inverse();
                let last = unknowns.count() - 1;
                let sigma = covariance.map_or(f64::INFINITY, |c| c[(last, last)].max(0.0).sqrt());
                // Four standard uncertainties, and what a model that is not perfect adds.
                let reach = (4.0 * sigma + 0.02) / (std::f64::consts::TAU * before.half_span_s);
                let furthest = added
                    .iter()
                    .map(|m| (self.forward.moments[*m].time_s - before.middle_s).abs())
                    .fold(0.0, f64::max);
                let step = 0.03 / furthest.max(1e-3);
                let count = (reach / step).ceil() as usize;
                if count > MOST_WAYS {
                    let text = format!(
                        "{} turns more or less fit between the passes: only the nearest {MOST_WAYS} to each side were tried",
                        count as f64 * 0.03
                    );
                    if !warnings.contains(&text) {
                        warnings.push(text);
                    }
                }
                let count = count.min(MOST_WAYS) as i64;
                let descent = self.descent(before, &few, space);
                let tried: Result<Vec<(f64, State)>, AttitudeError> = (-count..=count)
                    .into_par_iter()
                    .map_init(
                        || self.forward.eye(),
                        |eye, k| {
                            let turns_per_s = found.state.turns_per_s + k as f64 * step;
                            let state = State { turns_per_s, ..found.state };
                            Ok((descent.cost(eye, &state)?, state))
                        },
                    )
                    .collect();
                let mut tried = tried?;
                tried.sort_by(|a, b| a.0.total_cmp(&b.0));
                ways = tried.into_iter().take(KEPT_WAYS).map(|t| t.1).collect();
            }
            starts.extend(ways.iter().map(|s| before.carried(s, &law)));
        }
        let space = Space::Logarithms { spread: 0.05 };
        let mut minima = self.descend(&law, &more, space, &starts, 25, "further passes")?;
        minima.truncate(CARRIED);
        Ok((minima, law))
    }

    /// What is left over of the light, as a middle difference of logarithms beyond the stated noise.
    fn left_over(&self, samples: &[Sample]) -> f64 {
        let off = samples.iter().map(|s| {
            let ln = |rate: f64| self.compared.ln(s.moment, s.channel, rate);
            (ln(s.rate) - ln(s.model)).abs() - self.compared.sigma(s.moment, s.channel)
        });
        median(off.collect()).unwrap_or(f64::INFINITY)
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
        median(all.collect()).unwrap_or(0.0)
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
