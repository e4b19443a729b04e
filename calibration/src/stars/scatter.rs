//! Components of the scatter, from the residuals of visits that agree.

use super::gls::Scatter;
use super::sample::Sample;

/// The residuals of a visit, split into what its channels have in common and the rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Split {
    /// The common offset: the weighted mean of the residuals.
    pub offset: f64,
    /// Variance of the common offset by counts and the channels' own scatter alone.
    pub own_variance: f64,
    /// Σ w (r − offset)², χ² of `channels − 1` degrees of freedom.
    pub chi2: f64,
    /// Channels that were measured.
    pub channels: usize,
}

/// Splits residuals (`None` where there is none).
pub(super) fn split(residuals: &[Option<f64>], sample: &Sample, own: &[f64]) -> Split {
    let mut sums = [0.0; 3];
    let mut channels = 0;
    let terms = || {
        residuals
            .iter()
            .zip(&sample.points)
            .zip(own)
            .filter_map(|((r, p), own)| Some(((*r)?, 1.0 / ((*p)?.counts + own))))
    };
    for (r, w) in terms() {
        sums[0] += w;
        sums[1] += w * r;
        channels += 1;
    }
    let offset = sums[1] / sums[0];
    sums[2] = terms().map(|(r, w)| w * (r - offset).powi(2)).sum();
    Split { offset, own_variance: 1.0 / sums[0], chi2: sums[2], channels }
}

/// Scatter at first: the floor, shared between what is common and what is a channel's own.
pub(super) fn floor(floor: f64, channels: usize) -> Scatter {
    match channels {
        // One channel cannot tell them apart.
        1 => Scatter { common: floor * floor, own: vec![0.0] },
        _ => Scatter { common: 0.5 * floor * floor, own: vec![0.5 * floor * floor; channels] },
    }
}

/// The scatter that makes the residuals as large as they are (moments of Paule and Mandel), nowhere below the floor's. `residuals` belong to
/// `samples`; `per_channel` is how many parameters each channel had.
pub(super) fn estimate(
    samples: &[&Sample],
    residuals: &[Vec<Option<f64>>],
    least: &Scatter,
    per_channel: usize,
) -> Scatter {
    let mut scatter = least.clone();
    let channels = least.own.len();
    // Common and own scatter lean on each other: a few rounds settle both.
    for _ in 0..4 {
        if channels >= 3 {
            for c in 0..channels {
                scatter.own[c] =
                    own(c, samples, residuals, &scatter, per_channel).max(least.own[c]);
            }
        } else if channels == 2 {
            let pair = pair(samples, residuals, per_channel).max(least.own[0]);
            scatter.own = vec![pair; 2];
        }
        let splits = samples.iter().zip(residuals).map(|(s, r)| (split(r, s, &scatter.own), *s));
        let terms: Vec<(f64, f64)> = splits
            .filter(|(s, _)| s.channels > 0)
            .map(|(split, s)| (split.offset, split.own_variance + s.scintillation))
            .collect();
        scatter.common = excess(&terms, per_channel).max(least.common);
    }
    scatter
}

/// A channel's own variance: how its residuals scatter about what the other channels of the visit have in common.
fn own(
    c: usize,
    samples: &[&Sample],
    residuals: &[Vec<Option<f64>>],
    scatter: &Scatter,
    per_channel: usize,
) -> f64 {
    let term = |(sample, residuals): (&&Sample, &Vec<Option<f64>>)| {
        let (r, point) = (residuals[c]?, sample.points[c]?);
        let mut others = residuals.clone();
        others[c] = None;
        let rest = split(&others, sample, &scatter.own);
        (rest.channels > 0).then_some((r - rest.offset, point.counts + rest.own_variance))
    };
    let terms: Vec<(f64, f64)> = samples.iter().zip(residuals).filter_map(term).collect();
    excess(&terms, per_channel)
}

/// The own variance of each of two channels: half of what their difference scatters.
fn pair(samples: &[&Sample], residuals: &[Vec<Option<f64>>], per_channel: usize) -> f64 {
    let term = |(sample, r): (&&Sample, &Vec<Option<f64>>)| {
        let counts = sample.points[0]?.counts + sample.points[1]?.counts;
        Some((r[0]? - r[1]?, counts))
    };
    let terms: Vec<(f64, f64)> = samples.iter().zip(residuals).filter_map(term).collect();
    0.5 * excess(&terms, per_channel)
}

/// The variance τ² beside the known variances v that solves Σ r²/(v + τ²) = n − parameters; 0 where the known ones suffice.
fn excess(terms: &[(f64, f64)], parameters: usize) -> f64 {
    let freedom = terms.len() as f64 - parameters as f64;
    if freedom < 1.0 {
        return 0.0;
    }
    let misfit = |t: f64| terms.iter().map(|(r, v)| r * r / (v + t)).sum::<f64>() - freedom;
    if misfit(0.0).is_nan() || misfit(0.0) <= 0.0 {
        return 0.0;
    }
    let largest = terms.iter().map(|(r, _)| r * r).sum::<f64>() / freedom;
    // Above that the misfit is below 0: every term is below r²/τ².
    let (mut low, mut high) = (0.0, largest.max(f64::MIN_POSITIVE));
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if misfit(middle) > 0.0 { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}
