//! Samples that stand alone: cosmic rays, passing stars, wrong readings.
//!
//! A sample stands alone where it is eight standard deviations or more from the median of its neighbours and these agree with one another: in the light, and then in what the harmonics of the period leave of it. Glints and flashes of a turning body may be as short as a sample; they come again. So nothing is left out
//! where such samples fall together at a phase of the period that is found, or of a multiple of it, where flashes have a period of their own, or where more than one sample in twenty stands alone.

use super::flashes::flash_train;
use super::lines::residual;
use super::spectrum::median_step;
use super::verdict::{Options, Outcome, Verdict};
use super::{FlashTrain, PeriodError, verdict};
use crate::series::Series;
use sunglint_numerics::order::{SIGMA_PER_MAD, median, robust_sigma};

/// Neighbours on either side.
const BESIDE: usize = 3;
/// Neighbours that there have to be.
const LEAST_BESIDE: usize = 4;
/// Neighbours lie within that many steps.
const NEAR_STEPS: f64 = 5.0;
/// Standard deviations from the neighbours' median, of the sample itself and of those next to it.
const ALONE: f64 = 8.0;
const AGREES: f64 = 4.0;
/// Share of the samples that may stand alone.
const MOST: f64 = 0.05;
/// Multiples of a period at whose phases they are looked for.
const MULTIPLES: usize = 5;
/// Width of a phase, turns.
const PHASE: f64 = 0.02;

/// True for the samples whose values, the light or what a model leaves of it, stand alone in time.
fn alone(series: &Series, values: &[f64]) -> Vec<bool> {
    let n = series.len();
    let mut found = vec![false; n];
    let steps = values.windows(2).map(|p| p[1] - p[0]);
    let (Some(noise), Some(step_s)) = (robust_sigma(steps), median_step(series)) else {
        return found;
    };
    let noise = noise / 2_f64.sqrt();
    for i in 0..n {
        let all = i.saturating_sub(BESIDE)..(i + BESIDE + 1).min(n);
        let near = |k: &usize| {
            *k != i && (series.time_s[*k] - series.time_s[i]).abs() <= NEAR_STEPS * step_s
        };
        let beside: Vec<f64> = all.filter(near).map(|k| values[k]).collect();
        let Some(middle) = median(beside.iter().copied()).filter(|_| beside.len() >= LEAST_BESIDE)
        else {
            continue;
        };
        let spread = median(beside.iter().map(|v| (v - middle).abs())).unwrap_or(0.0);
        let sigma = noise.max(SIGMA_PER_MAD * spread);
        let agrees = |k: Option<usize>| {
            k.and_then(|k| values.get(k)).is_none_or(|v| (v - middle).abs() <= AGREES * sigma)
        };
        let far = (values[i] - middle).abs() > ALONE * sigma;
        found[i] = sigma > 0.0 && far && agrees(i.checked_sub(1)) && agrees(Some(i + 1));
    }
    found
}

/// Whether moments fall together at phases of a period or of a multiple of it more often than by chance.
fn come_again(times: &[f64], period_s: f64) -> bool {
    let n = times.len() as f64;
    (1..=MULTIPLES).any(|k| {
        let mut phases: Vec<f64> = times
            .iter()
            .map(|t| {
                let turn = t / (period_s * k as f64);
                turn - turn.floor()
            })
            .collect();
        phases.sort_by(f64::total_cmp);
        let mut pairs = 0.0;
        for (i, a) in phases.iter().enumerate() {
            let after = phases.iter().cycle().skip(i + 1).take(phases.len() - 1);
            pairs += after.take_while(|b| (**b - a).rem_euclid(1.0) <= PHASE).count() as f64;
        }
        let expected = 0.5 * n * (n - 1.0) * 2.0 * PHASE;
        pairs > expected + 4.0 * expected.sqrt() + 1.0
    })
}

/// The verdict without samples that stand alone.
pub(super) struct Without {
    pub series: Vec<Series>,
    pub verdict: Verdict,
    /// The flashes of all samples, which have no period.
    pub flashes: Option<FlashTrain>,
    pub left_out: usize,
}

/// Leaves out the samples that stand alone, where they do not come again; `None` where there are none, or they belong to the light.
pub(super) fn without(
    series: &[Series],
    options: &Options,
    whole: &Verdict,
) -> Result<Option<Without>, PeriodError> {
    let mut found: Vec<Vec<bool>> = series.iter().map(|s| alone(s, &s.value)).collect();
    let left_out = found.iter().flatten().filter(|a| **a).count();
    let samples: usize = series.iter().map(Series::len).sum();
    if left_out == 0 || left_out as f64 > MOST * samples as f64 {
        return Ok(None);
    }
    let flashes = flash_train(series, options);
    if flashes.as_ref().is_some_and(|f| !f.periods.is_empty()) {
        return Ok(None);
    }
    let keep = |found: &[Vec<bool>]| -> Vec<Series> {
        let own = |(s, alone): (&Series, &Vec<bool>)| {
            let mut own = s.kept(&alone.iter().map(|a| !a).collect::<Vec<_>>());
            own.left_out.alone = s.len() - own.len();
            own
        };
        series.iter().zip(found).map(own).collect()
    };
    let mut kept = keep(&found);
    let mut verdict = verdict(&kept, options)?;
    // On a slope of the light faint samples are not seen: they are in what the first answer leaves.
    if let Some(best) = verdict.best {
        let mut more = 0;
        for (own, found) in kept.iter().zip(&mut found) {
            let left = residual(own, 1.0 / best.period_s, verdict.harmonics.max(1), 1);
            let Some(left) = left else { continue };
            let places = found.iter_mut().filter(|f| !**f);
            for (place, alone) in places.zip(alone(own, &left)) {
                *place |= alone;
                more += usize::from(alone);
            }
        }
        if more > 0 {
            kept = keep(&found);
            verdict = super::verdict(&kept, options)?;
        }
    }
    let left_out = found.iter().flatten().filter(|a| **a).count();
    if left_out as f64 > MOST * samples as f64 {
        return Ok(None);
    }
    let is_answer = |v: &Verdict| !matches!(v.outcome, Outcome::NotEnough(_));
    if is_answer(whole) && !is_answer(&verdict) {
        return Ok(None);
    }
    for best in [whole.best, verdict.best].into_iter().flatten() {
        for (s, alone) in series.iter().zip(&found) {
            let times: Vec<f64> =
                s.time_s.iter().zip(alone).filter(|(_, a)| **a).map(|(t, _)| *t).collect();
            if times.len() > 1 && come_again(&times, best.period_s) {
                return Ok(None);
            }
        }
    }
    Ok(Some(Without { series: kept, verdict, flashes, left_out }))
}
