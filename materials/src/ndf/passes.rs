//! Passes over the same angles, held against one another.

use super::Note;
use crate::table::{Reading, RetroFlags};
use sunglint_numerics::order::median;

/// Readings that two passes must have at the same angles.
const LEAST: usize = 8;
/// The same angle is one that is apart by less than this of a step.
const SAME: f64 = 0.1;
/// Standard deviations, and part, from which on two passes disagree.
const SIGMAS: f64 = 5.0;
const PART: f64 = 0.01;
/// Where standard deviations are not known readings count above this part of the peak.
const BRIGHT: f64 = 0.01;
/// Standard errors beyond all doubt.
const MOST_SIGMAS: f64 = 1000.0;

/// Returns a note where the readings are of several passes and one of them is brighter or dimmer than the first: the one that is farthest off.
pub(super) fn differ(readings: &[Reading]) -> Option<Note> {
    let passes = passes(readings);
    let (first, others) = passes.split_first()?;
    let off = others.iter().enumerate().filter_map(|(k, pass)| {
        let (ln_ratio, sigma, angles) = ratio(first, pass)?;
        let sigmas = (ln_ratio.abs() / sigma.max(f64::MIN_POSITIVE)).min(MOST_SIGMAS);
        let differs = sigmas > SIGMAS && ln_ratio.abs() > PART;
        let (pass, ratio) = (k + 2, ln_ratio.exp());
        differs.then_some((
            ln_ratio.abs(),
            Note::PassesDiffer { pass, ratio, sigma: ratio * sigma, sigmas, angles },
        ))
    });
    off.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, note)| note)
}

/// Stretches of the readings that go one way; of a table that is sorted, the first reading of each angle, the second, and so on.
fn passes(readings: &[Reading]) -> Vec<Vec<Reading>> {
    let mut passes: Vec<Vec<Reading>> = Vec::new();
    let mut way = 0.0;
    for reading in readings {
        let last = passes.last().and_then(|pass| pass.last());
        let step = last.map_or(0.0, |last| reading.angle_deg - last.angle_deg);
        let turns = way * step < 0.0;
        match passes.last_mut() {
            Some(pass) if !turns => pass.push(*reading),
            _ => passes.push(vec![*reading]),
        }
        way = if turns { 0.0 } else { way + step };
    }
    passes.retain(|pass| pass.len() >= LEAST);
    if passes.len() > 1 {
        return passes;
    }
    let mut sorted = readings.to_vec();
    sorted.sort_by(|a, b| a.angle_deg.total_cmp(&b.angle_deg));
    let mut passes: Vec<Vec<Reading>> = Vec::new();
    for same in sorted.chunk_by(|a, b| a.angle_deg == b.angle_deg) {
        for (k, reading) in same.iter().enumerate() {
            if k == passes.len() {
                passes.push(Vec::new());
            }
            passes[k].push(*reading);
        }
    }
    passes
}

/// Mean of ln(f of the second over f of the first) at the angles that both have, its standard deviation by the scatter, and how many angles.
fn ratio(first: &[Reading], second: &[Reading]) -> Option<(f64, f64, usize)> {
    let mut first = first.to_vec();
    first.sort_by(|a, b| a.angle_deg.total_cmp(&b.angle_deg));
    let steps = first.windows(2).map(|p| p[1].angle_deg - p[0].angle_deg).filter(|d| *d > 1e-9);
    let near = SAME * median(steps)?;
    let all = || first.iter().chain(second);
    let top = all().map(|r| r.f_per_sr).filter(|f| f.is_finite()).fold(0.0, f64::max);
    let knows_sigma = all().all(|r| r.sigma_f_per_sr > 0.0);
    let least = |r: &Reading| {
        if knows_sigma { 3.0 * r.sigma_f_per_sr } else { BRIGHT * top }
    };
    let counts = |r: &Reading| {
        let spoilt = r.flags.difference(RetroFlags::OUTLIERS);
        spoilt.is_empty() && r.f_per_sr > 0.0 && r.f_per_sr > least(r)
    };
    let pairs: Vec<(f64, f64)> = (second.iter().filter(|r| counts(r)))
        .filter_map(|b| {
            let at = first.partition_point(|a| a.angle_deg < b.angle_deg - near);
            let a = first.get(at).filter(|a| (a.angle_deg - b.angle_deg).abs() <= near)?;
            let variance = |r: &Reading| (r.sigma_f_per_sr / r.f_per_sr).powi(2);
            let weight = if knows_sigma { (variance(a) + variance(b)).recip() } else { 1.0 };
            counts(a).then(|| ((b.f_per_sr / a.f_per_sr).ln(), weight))
        })
        .collect();
    if pairs.len() < LEAST {
        return None;
    }
    let weights: f64 = pairs.iter().map(|(_, w)| w).sum();
    let mean = pairs.iter().map(|(x, w)| w * x).sum::<f64>() / weights;
    let square: f64 = pairs.iter().map(|(x, w)| (w * (x - mean)).powi(2)).sum();
    Some((mean, square.sqrt() / weights, pairs.len()))
}
