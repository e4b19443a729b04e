//! The search: the first curve, further ones one by one, then all samples with all light.

use super::compare::Compared;
use super::descent::{Found, Space};
use super::first::SECOND;
use super::forward::{Forward, Measured};
use super::hunt::{Hunt, Trial, extra_noise, spread_out};
use super::light::{AllLight, wants_earth};
use super::question::{Checkpoint, Options, Progress, Question, Watch};
use super::state::{Law, State};
use super::twins::{self, Symmetry};
use super::{AttitudeError, LEAST_EPOCHS};
use glam::DVec3;

/// Epochs of the last descents at most.
const LAST: usize = 1500;
/// Minima that stand in the answer at most.
const ANSWERED: usize = 8;
/// How often light by other ways is computed anew at least, for the minima that matter.
const ROUNDS: usize = 4;
/// How often at most, for the best: until that moves by less than [`SETTLED`].
const MOST_ROUNDS: usize = 12;
/// See [`MOST_ROUNDS`], radians.
const SETTLED: f64 = 3e-4;
/// Minima that get all light at most.
const ALL_LIT: usize = 3;
/// The same of the finer search, in which light by other ways is what matters.
const ALL_LIT_FINER: usize = 12;
/// They have less than so many times the χ² of the best.
const CLOSE: f64 = 4.0;
/// Points along each side of a panel of the lit Earth, where its light is part of every trial's: two a panel.
const EARTH_ORDER: usize = 1;

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

pub(super) fn search(
    curves: &[Measured],
    question: &Question,
    options: &Options,
    watch: &dyn Watch,
    from: Option<&Checkpoint>,
    finer: bool,
) -> Result<Searched, AttitudeError> {
    let lit = options.all_light && wants_earth(curves);
    let mut forward = Forward::new(curves)?;
    if finer && lit {
        forward = forward.with_earth(EARTH_ORDER);
    }
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
    if found.poor && !finer {
        return search(curves, question, options, watch, from, true);
    }
    let mut warnings = Vec::new();
    let order = hunt.order();
    for n in 1..order.len() {
        (found.minima, law) = hunt.extended(&order[..=n], found.minima, &law, &mut warnings)?;
    }
    // All samples, each as uncertain as what is left over says; with all light, held as the last round has it.
    let all: Vec<usize> = (0..epochs).collect();
    let last = spread_out(&all, LAST, options.seed);
    let more = spread_out(&all, SECOND * order.len().min(4), options.seed + 3);
    found.minima.truncate(if finer { ALL_LIT_FINER } else { ANSWERED });
    let mut trials: Vec<Trial> = found.minima.iter().map(Trial::of).collect();
    let mut simulated = found.simulated;
    let (mut extra, mut other_light) = (0.0, (0.0, 0.0));
    let mut light: Option<AllLight> = None;
    let mut far: Vec<Trial> = Vec::new();
    let mut before: Option<State> = None;
    for round in 0..MOST_ROUNDS {
        watch.tell(Progress { stage: "all light", done: round, of: ROUNDS.max(round + 1) });
        if lit && round == 0 && !forward.has_earth() {
            hunt.lit(&law, &mut trials)?;
        }
        if options.all_light && round > 0 {
            let light = match &mut light {
                Some(light) => light,
                None => light.insert(AllLight::new(curves, &forward, &last)?),
            };
            // What is far above the best by the light so far is not made the best by what is left.
            let close = trials.iter().filter(|t| t.cost <= CLOSE * trials[0].cost).count();
            let few = match round {
                0..ROUNDS => close.clamp(1, if finer { ALL_LIT_FINER } else { ALL_LIT }),
                _ => 1,
            };
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
        // Light between the parts is held at the attitude before: where it counts for much, it takes some rounds to settle.
        let moved = before.map_or(f64::INFINITY, |b| law.apart(&b, &best.state));
        if round + 1 >= ROUNDS && (moved < SETTLED || !options.all_light) {
            break;
        }
        before = Some(best.state);
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
        finer,
        rates: found.rates,
        other_light,
        warnings,
        symmetries,
        forward,
    })
}
