//! Whether the turn is a multiple of a comb's period: by the light at its teeth, turn by turn.
//!
//! The light is summed over the width of a flash at the time that the comb gives, whether a flash was found there or not: nothing is lost below a threshold, and it does not matter where in a sample the flash
//! fell. Ranks of every n-th turn against those of the others (Kruskal and Wallis 1952, J. Am. Stat. Assoc. 47, 583) ask for no shape of the scatter.

use super::super::stats::chi2_survival;
use super::super::verdict::Question;
use super::FlashPhase;
use super::comb::Comb;
use super::events::Light;
use std::collections::BTreeSet;

/// A chance below this is a yes, above the next a no, between them neither.
const YES: f64 = 1e-6;
const NO: f64 = 0.02;
/// Turns that may differ by more than this share of their flashes are not known to be alike.
const ALIKE: f64 = 0.2;
/// Multiples that are asked about.
const MULTIPLES: [usize; 5] = [2, 3, 4, 5, 7];
/// Parts of the period that a rhythm of samples and turns may hide.
const PARTS: [usize; 4] = [2, 3, 4, 5];
/// Times that the period is made longer at most.
const ROUNDS: usize = 4;
/// Length of the mean of unit vectors from which on the place of flashes between samples repeats: of those that slip evenly by three quarters of a sample.
const REPEATS: f64 = 0.3;
/// Turns of each kind that a question needs.
const LEAST_OF_KIND: usize = 4;
/// Turns that a period needs.
const LEAST_TURNS: f64 = 5.0;
/// Standard deviations of the largest difference that is still possible (95 %, one side).
const ONE_SIDED: f64 = 1.645;

/// The comb at the turn, as far as the flashes tell.
pub(super) struct Answer {
    pub comb: Comb,
    /// Multiples of it that are neither there nor ruled out.
    pub open: Vec<usize>,
    /// Parts of it whose flashes may fall between samples.
    pub parts: Vec<usize>,
    pub questions: Vec<Question>,
    pub phases: Vec<FlashPhase>,
}

/// Turn and light of a tooth, where it was seen.
type Lights = Vec<(i64, f64)>;

fn lights(light: &Light, comb: &Comb) -> Vec<Lights> {
    let half = 0.5 * comb.width_s + light.step_s;
    let turns = (0.5 * light.span_s / comb.period_s).ceil() as i64 + 1;
    let of = |time_s: f64| {
        let own = (-turns..=turns).filter_map(|k| {
            let t = time_s + k as f64 * comb.period_s;
            light.around(t, half).map(|v| (k, v))
        });
        own.collect()
    };
    comb.teeth.iter().map(|t| of(t.time_s)).collect()
}

/// H of Kruskal and Wallis with ties, and its degrees of freedom; `None` of too few.
fn ranks(classes: &[Vec<f64>]) -> Option<(f64, f64)> {
    if classes.iter().any(|c| c.len() < LEAST_OF_KIND) {
        return None;
    }
    let mut all: Vec<(f64, usize)> =
        classes.iter().enumerate().flat_map(|(k, c)| c.iter().map(move |v| (*v, k))).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let n = all.len() as f64;
    let mut sums = vec![0.0; classes.len()];
    let mut ties = 0.0;
    let mut i = 0;
    while i < all.len() {
        let same = all[i..].iter().take_while(|v| v.0 == all[i].0).count();
        let rank = i as f64 + 0.5 * (same as f64 + 1.0);
        all[i..i + same].iter().for_each(|v| sums[v.1] += rank);
        ties += (same as f64).powi(3) - same as f64;
        i += same;
    }
    let squares: f64 = sums.iter().zip(classes).map(|(s, c)| s * s / c.len() as f64).sum();
    let h = 12.0 / (n * (n + 1.0)) * squares - 3.0 * (n + 1.0);
    let correction = 1.0 - ties / (n * n * n - n);
    (correction > 0.0).then(|| (h / correction, classes.len() as f64 - 1.0))
}

/// Whether flashes of every n-th turn differ, with H and its degrees of freedom.
///
/// The teeth are asked together and each for itself, times their number: one that differs is not lost among others that do not. Not one of them may be left out for turns that are known to be alike.
fn question(all: &[Lights], comb: &Comb, n: usize) -> (Question, f64, f64) {
    let (mut h, mut degrees) = (0.0, 0.0);
    let (mut largest, mut least, mut asked) = (0.0_f64, 1.0_f64, 0_usize);
    for own in all {
        let mut classes = vec![Vec::new(); n];
        own.iter().for_each(|(k, v)| classes[k.rem_euclid(n as i64) as usize].push(*v));
        let Some((own_h, own_degrees)) = ranks(&classes) else { continue };
        asked += 1;
        h += own_h;
        degrees += own_degrees;
        least = least.min(chi2_survival(own_h, own_degrees));
        let means: Vec<(f64, f64)> = classes
            .iter()
            .map(|c| {
                let m = c.len() as f64;
                let mean = c.iter().sum::<f64>() / m;
                let variance = c.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (m - 1.0) / m;
                (mean, variance)
            })
            .collect();
        let mean = means.iter().map(|m| m.0).sum::<f64>() / n as f64;
        for (i, a) in means.iter().enumerate() {
            for b in &means[..i] {
                let differs = (a.0 - b.0).abs() + ONE_SIDED * (a.1 + b.1).sqrt();
                largest = largest.max(if mean > 0.0 { differs / mean } else { f64::INFINITY });
            }
        }
    }
    let chance = (asked > 0).then(|| chi2_survival(h, degrees).min(asked as f64 * least).min(1.0));
    let unlike = (asked > 0 && asked == all.len() && largest.is_finite()).then_some(largest);
    let q = Question {
        longer_s: n as f64 * comb.period_s,
        shorter_s: comb.period_s,
        chance,
        unlike,
        dispersion_chance: None,
    };
    (q, h, degrees)
}

/// Length of the mean of unit vectors of the places between samples at which flashes of a period fall: 1 where they fall at the same, 0 at all.
fn repeats(light: &Light, comb: &Comb, part: usize) -> f64 {
    let period_s = comb.period_s / part as f64;
    let turns = (0.5 * light.span_s / period_s).ceil() as i64;
    let of = |time_s: f64| {
        let (mut n, mut cos, mut sin) = (0.0, 0.0, 0.0);
        for k in -turns..=turns {
            let t = time_s + k as f64 * period_s;
            let next = light.time_s.partition_point(|s| *s <= t);
            let Some((from, to)) = next
                .checked_sub(1)
                .and_then(|i| Some((light.time_s[i], *light.time_s.get(next)?)))
                .filter(|(from, to)| to - from < 1.5 * light.step_s)
            else {
                continue;
            };
            let turn = std::f64::consts::TAU * (t - from) / (to - from);
            (n, cos, sin) = (n + 1.0, cos + turn.cos(), sin + turn.sin());
        }
        if n > 0.0 { f64::hypot(cos, sin) / n } else { 0.0 }
    };
    comb.teeth.iter().map(|t| of(t.time_s)).fold(0.0, f64::max)
}

/// Parts of a period whose turns fall on other places between the samples, over and over: flashes that are shorter than the time between exposures are lost in every second or third turn.
fn hidden(light: &Light, comb: &Comb) -> Vec<usize> {
    let whole = repeats(light, comb, 1);
    if whole < REPEATS {
        return Vec::new();
    }
    PARTS.into_iter().filter(|n| repeats(light, comb, *n) < 0.5 * whole).collect()
}

/// Makes the period longer while flashes of every n-th turn differ, and names the multiples that stay open.
///
/// Turns that are alike rule a multiple out only where some turns were found to differ, that is where the body is known to have mirrors that are not: a body of two rings of three like mirrors has six flashes
/// a turn, on two phases of a third of it.
pub(super) fn multiples(light: &Light, comb: &Comb, longest_s: f64) -> Answer {
    let mut comb = comb.clone();
    let mut questions = Vec::new();
    let mut rounds = 0;
    let (open, parts) = loop {
        let all = lights(light, &comb);
        let parts = hidden(light, &comb);
        // What differs may be the place between samples.
        let differ = rounds > 0 && parts.is_empty();
        let mut open = Vec::new();
        let mut yes: Option<(f64, usize)> = None;
        let mut by_two = (0.0, 0.0);
        for n in MULTIPLES {
            let longer_s = n as f64 * comb.period_s;
            if longer_s > longest_s {
                // Too few turns to tell, and few enough to be the period.
                if light.span_s / longer_s > 0.5 * LEAST_TURNS {
                    open.push(n);
                }
                continue;
            }
            let (q, h, degrees) = question(&all, &comb, n);
            if n == 2 {
                by_two = (h, degrees);
            }
            // Four has to tell more than two.
            let more = n != 4
                || (degrees > by_two.1
                    && chi2_survival((h - by_two.0).max(0.0), degrees - by_two.1) < YES);
            match q.chance {
                Some(p) if p < YES && more => {
                    if yes.is_none_or(|(other, m)| p < other && !(m == 2 && n == 4)) {
                        yes = Some((p, n));
                    }
                    open.push(n);
                }
                Some(p) if p > NO && differ && q.unlike.is_some_and(|u| u < ALIKE) => {}
                _ => open.push(n),
            }
            questions.push(q);
        }
        match yes {
            Some((_, n)) if rounds < ROUNDS => comb = comb.times(n),
            _ => break (open, parts),
        }
        rounds += 1;
    };
    let all = lights(light, &comb);
    let phases = comb.teeth.iter().zip(&all).map(|(tooth, own)| {
        let turn = tooth.time_s / comb.period_s;
        let strength = sunglint_numerics::order::median(own.iter().map(|o| o.1)).unwrap_or(0.0);
        // A turn with two flashes within the width counts once; one that flashed was seen, even where a sample beside is missing.
        let flashed: BTreeSet<i64> = tooth.flashes.iter().map(|f| f.0 as i64).collect();
        let seen = own.iter().filter(|(k, _)| !flashed.contains(k)).count() + flashed.len();
        FlashPhase { phase: turn - turn.floor(), seen, flashed: flashed.len(), strength }
    });
    let mut phases: Vec<FlashPhase> = phases.collect();
    phases.sort_by(|a, b| a.phase.total_cmp(&b.phase));
    Answer { comb, open, parts, questions, phases }
}
