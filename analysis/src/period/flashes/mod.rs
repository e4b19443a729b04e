//! Flash trains: the period of a body whose mirrors flash, from the times and strengths of the flashes.
//!
//! A mirror that flashes for a hundredth of a turn has its light in a hundred harmonics, and each of them is too weak to stand out of the noise. So flashes are found first, against a running median of
//! the light at every sample (`events`). Their times are folded, and a comb of a few phases is weighed against flashes at random times (`comb`). Whether the turn is a multiple of the comb's
//! period is asked of the light at the comb's teeth, whether a flash was found there or not (`order`).
//!
//! - [`flash_train`]: the flashes and their comb;
//! - [`with_flashes`]: the verdict of harmonics with that of flashes. A verdict that harmonics give is kept: flashes answer where harmonics have none, and what they contradict becomes a family.

mod comb;
mod events;
mod order;

use super::verdict::{Estimate, Member, Membership, Options, Outcome, Question, Verdict};
use crate::series::Series;
use comb::Comb;
use events::Light;

/// Fewer flashes are no train.
const LEAST_FLASHES: usize = 8;
/// Light that is in flashes for more than this share of its samples has no flashes.
const MOST_LIT: f64 = 0.3;
/// Flashes at random times make so good a comb with no more than this chance.
const CHANCE: f64 = 1e-4;
/// Share of the flashes that a comb has to hold: with fewer, the light has another cause.
const LEAST_HELD: f64 = 0.5;
/// Logarithm of the likelihood by which another comb may be worse and still be possible.
const POSSIBLE: f64 = 10.0;
/// More combs than that leave no answer.
const MOST_RIVALS: usize = 2;

/// A phase at which a body flashes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlashPhase {
    /// Phase in turns of the best period, 0 to 1, from [`FlashTrain::middle_s`].
    pub phase: f64,
    /// Turns in which there were samples at this phase.
    pub seen: usize,
    /// Flashes that were found there.
    pub flashed: usize,
    /// Median light above the level, in standard deviations of a sample between the flashes, summed over the samples of a flash; 0 where no turn was seen whole.
    pub strength: f64,
}

/// The flashes of a curve and the period at which they come.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FlashTrain {
    /// Flashes that stand out of the light.
    pub flashes: usize,
    /// Share of the samples that are in them.
    pub lit: f64,
    /// Share of the flashes that the best comb holds.
    pub held: f64,
    /// Width within which flashes of one phase fall together, s.
    pub width_s: f64,
    /// Periods that the flashes leave possible, the best first; empty where they give none.
    pub periods: Vec<Member>,
    /// The best period, even where it is no answer.
    pub best: Option<Estimate>,
    /// Phases of the best period at which flashes stand.
    pub phases: Vec<FlashPhase>,
    /// Moment from which phases count, s on the axis of the series.
    pub middle_s: f64,
    /// Chance that flashes at random times make so good a comb at any period that was tried: by the largest values of displaced flashes.
    pub chance: Option<f64>,
    /// Questions about multiples.
    pub questions: Vec<Question>,
    /// The shortest and the longest period that were looked for, s.
    pub searched_s: Option<(f64, f64)>,
    /// Why they give no period; `None` where they do.
    pub refusal: Option<Refusal>,
    /// Whether the verdict is that of the flashes ([`with_flashes`]).
    pub decides: bool,
}

/// Why flashes give no period.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// There is no comb.
    #[error("no period at which they fall together")]
    NoComb,
    /// Displaced flashes make as good a comb.
    #[error("no period at which they fall together more than by chance")]
    Chance,
    /// Too few of the flashes are on the best comb.
    #[error("no period at which half of them fall together")]
    Held,
    /// Half or a third of the best period is too short for flashes of this width.
    #[error(
        "the period at which they fall together may be twice or three times one that is too short for flashes of this width: faster samples would tell"
    )]
    Short,
    /// Many combs are as good.
    #[error("they fall together at {} periods alike: more turns, or no gaps, would tell", .0 + 1)]
    Rivals(usize),
}

/// Finds the flashes of series and the period at which they come. `None` where fewer than eight flashes stand out, where the light is in them for more than 30 % of the samples, and of series
/// that do not share their times: nobody counts the turns between tracks.
pub fn flash_train(series: &[Series], options: &Options) -> Option<FlashTrain> {
    let light = Light::new(series)?;
    if light.flashes.len() < LEAST_FLASHES || light.lit > MOST_LIT {
        return None;
    }
    let mut train = FlashTrain {
        flashes: light.flashes.len(),
        lit: light.lit,
        held: 0.0,
        width_s: light.width_s,
        periods: Vec::new(),
        best: None,
        phases: Vec::new(),
        middle_s: light.middle_s,
        chance: None,
        questions: Vec::new(),
        searched_s: None,
        refusal: None,
        decides: false,
    };
    let Some(found) = comb::search(&light, options) else {
        train.refusal = Some(Refusal::NoComb);
        return Some(train);
    };
    train.searched_s = Some(found.searched_s);
    train.chance = Some(found.chance);
    let Some(best) = found.combs.first() else {
        train.refusal = Some(Refusal::NoComb);
        return Some(train);
    };
    let answer = order::multiples(&light, best, found.searched_s.1);
    train.best = Some(answer.comb.estimate(&light));
    train.width_s = best.width_s;
    train.held = best.held() as f64 / light.flashes.len() as f64;
    train.phases = answer.phases;
    train.questions = answer.questions;
    if found.chance > CHANCE {
        train.refusal = Some(Refusal::Chance);
        return Some(train);
    }
    if train.held < LEAST_HELD {
        train.refusal = Some(Refusal::Held);
        return Some(train);
    }
    // Halves and thirds that flashes of this width cannot show.
    let hidden = |n: f64| {
        let part = best.period_s / n;
        part < found.least_s && part >= options.shortest_s.unwrap_or(0.0)
    };
    if hidden(2.0) || hidden(3.0) {
        train.refusal = Some(Refusal::Short);
        return Some(train);
    }
    let span_s = light.span_s;
    let member = |comb: &Comb, by: f64, membership: Membership| {
        let e = comb.estimate(&light);
        let estimate = Estimate { period_s: by * e.period_s, sigma_s: by * e.sigma_s };
        Member { estimate, membership, turns: span_s / estimate.period_s }
    };
    let mut periods = vec![member(&answer.comb, 1.0, Membership::Best)];
    for n in answer.parts {
        if answer.comb.period_s / n as f64 >= found.allowed_s {
            periods.push(member(&answer.comb, 1.0 / n as f64, Membership::Part(n)));
        }
    }
    for n in answer.open {
        periods.push(member(&answer.comb, n as f64, Membership::Multiple(n)));
    }
    let rivals = found.combs.iter().skip(1).filter(|c| best.score - c.score < POSSIBLE);
    let mut others = 0;
    for rival in rivals {
        let p = rival.period_s;
        if periods.iter().any(|m| comb::is_same(m.estimate.period_s, rival, span_s)) {
            continue;
        }
        let is_whole = |ratio: f64| {
            let whole = ratio.round();
            (whole >= 2.0 && comb::is_same(p * ratio / whole, rival, span_s))
                .then_some(whole as usize)
        };
        let membership =
            match (is_whole(answer.comb.period_s / p), is_whole(p / answer.comb.period_s)) {
                (Some(n), _) => Membership::Part(n),
                (_, Some(n)) => Membership::Multiple(n),
                _ => {
                    others += 1;
                    Membership::Alias
                }
            };
        periods.push(member(rival, 1.0, membership));
    }
    if others <= MOST_RIVALS {
        train.periods = periods;
    } else {
        train.refusal = Some(Refusal::Rivals(others));
    }
    Some(train)
}

/// Whether two periods are the same for all that a curve of that span tells.
fn alike(a: &Estimate, b: &Estimate, span_s: f64) -> bool {
    let sigmas = [a, b].map(|e| if e.sigma_s.is_finite() { e.sigma_s } else { 0.0 });
    let within = 3.0 * sigmas[0].hypot(sigmas[1]) + 0.2 * a.period_s * a.period_s / span_s;
    (a.period_s - b.period_s).abs() <= within.min(0.05 * a.period_s)
}

/// Turns over a span by which a frequency may miss a multiple of the comb's.
const HARMONIC: f64 = 0.5;

/// Whether the frequency of a period is a multiple of that of a comb.
fn is_harmonic(of: &Estimate, comb: &Estimate, span_s: f64) -> bool {
    let ratio = comb.period_s / of.period_s;
    let miss = (ratio - ratio.round()).abs() * span_s / comb.period_s;
    ratio.round() >= 1.0 && miss < HARMONIC
}

/// Whether the flashes of some series have a period of which two others are parts: flashes of one period have lines at many multiples of its frequency, and harmonics may take these for two periods at once.
pub(super) fn explains_both(series: &[Series], pair: [Estimate; 2]) -> bool {
    let span_s = series.iter().map(Series::span_s).fold(0.0, f64::max);
    let train = flash_train(series, &Options::default());
    let best = train.and_then(|train| train.periods.first().map(|m| m.estimate));
    best.is_some_and(|comb| pair.iter().all(|e| is_harmonic(e, &comb, span_s)))
}

/// The verdict of harmonics together with the flashes of the same series. A verdict of harmonics is never replaced: where flashes have periods of which none is among its own, both are members of a
/// family. Where harmonics have no answer, that of the flashes is given.
pub fn with_flashes(
    series: &[Series],
    options: &Options,
    mut verdict: Verdict,
) -> (Verdict, Option<FlashTrain>) {
    let Some(mut train) = flash_train(series, options) else { return (verdict, None) };
    let Some(first) = train.periods.first().copied() else { return (verdict, Some(train)) };
    let span_s = series.iter().map(Series::span_s).fold(0.0, f64::max);
    // Harmonics see periods that are too short for flashes, whose combs then stand at multiples.
    let least_s = train.searched_s.map_or(0.0, |s| s.0);
    let explains = |harmonic: &Estimate, flashes: &Estimate| {
        let whole = (flashes.period_s / harmonic.period_s).round().max(1.0);
        let by = if harmonic.period_s < least_s { whole } else { 1.0 };
        let longer = Estimate { period_s: by * harmonic.period_s, sigma_s: by * harmonic.sigma_s };
        alike(&longer, flashes, span_s)
    };
    match &mut verdict.outcome {
        Outcome::NotEnough(_) => {
            train.decides = true;
            verdict.outcome = match train.periods.as_slice() {
                [_] => Outcome::One(first.estimate),
                many => Outcome::Family(many.to_vec()),
            };
            verdict.best = Some(first.estimate);
            verdict.harmonics = 0;
            (verdict.false_alarm, verdict.beside) = (None, None);
            verdict.questions.clone_from(&train.questions);
            verdict.searched_s = train.searched_s.or(verdict.searched_s);
        }
        Outcome::One(e) => {
            let e = *e;
            if !train.periods.iter().any(|m| explains(&e, &m.estimate)) {
                let turns = span_s / e.period_s;
                let mut all = vec![Member { estimate: e, membership: Membership::Best, turns }];
                all.extend(by_flashes(&train.periods));
                verdict.outcome = Outcome::Family(all);
            }
        }
        // Light with two periods has no comb of one: flashes were asked before.
        Outcome::Two(..) => {}
        Outcome::Family(members) => {
            // One of two periods at once says nothing about a comb. A ninth of a comb's period is one of its lines, and no reason to leave the comb out.
            let known = |f: &Member| {
                let of_one = members.iter().filter(|m| m.membership != Membership::Second);
                of_one.into_iter().any(|m| alike(&m.estimate, &f.estimate, span_s))
            };
            let new: Vec<Member> = train.periods.iter().filter(|f| !known(f)).copied().collect();
            members.extend(by_flashes(&new));
        }
    }
    (verdict, Some(train))
}

/// Members that stand in a family because flashes ask for them.
fn by_flashes(periods: &[Member]) -> impl Iterator<Item = Member> + '_ {
    periods.iter().map(|m| Member { membership: Membership::Flashes, ..*m })
}
