//! Flashes: runs of samples above a running median.

use super::super::spectrum::median_step;
use crate::series::Series;
use sunglint_numerics::order::{SIGMA_PER_MAD, median};

/// Samples of the running median: some tens of flashes' widths. The level is taken at every sample, because nodes some samples apart would beat with the period.
const WINDOW: usize = 101;
/// A gap of more than that many steps parts the light: the level is not taken across it.
const GAP_STEPS: f64 = 20.0;
/// Fewer samples between two gaps have no level.
const LEAST_SAMPLES: usize = 15;
/// A flash has a sample that many standard deviations above the level, and neighbours above the second.
const FLASH: f64 = 4.5;
const FLANK: f64 = 2.5;
/// Mean absolute deviation of the lower nine tenths of normal deviates, inverted.
const SIGMA_PER_LOWER_MEAN: f64 = 1.521;

/// A flash.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Flash {
    /// Middle of its light, s from [`Light::middle_s`].
    pub time_s: f64,
    /// Its light, in standard deviations of a sample.
    pub sum: f64,
}

/// Light above its level, and the flashes in it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Light {
    /// Times of the samples, s from the middle, increasing.
    pub time_s: Vec<f64>,
    /// Light above the level, in standard deviations of the light between flashes.
    pub above: Vec<f64>,
    pub flashes: Vec<Flash>,
    pub span_s: f64,
    pub step_s: f64,
    /// Middle of the span, s on the axis of the series.
    pub middle_s: f64,
    /// Width that holds the times of flashes of one phase, s.
    pub width_s: f64,
    /// Share of the samples that are in flashes.
    pub lit: f64,
}

/// Median and robust standard deviation of sorted values.
fn level_of(sorted: &[f64]) -> (f64, f64) {
    let n = sorted.len();
    let middle = 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]);
    // Deviations in rising order: from the middle outwards on both sides.
    let (mut low, mut high) = (n / 2, n / 2);
    let (mut sum, mut at_half) = (0.0, 0.0);
    let kept = (9 * n).div_ceil(10);
    for k in 0..kept {
        let below = (low > 0).then(|| (middle - sorted[low - 1]).abs());
        let up = (high < n).then(|| (sorted[high] - middle).abs());
        let next = match (below, up) {
            (Some(a), Some(b)) if a <= b => {
                low -= 1;
                a
            }
            (Some(a), None) => {
                low -= 1;
                a
            }
            (_, Some(b)) => {
                high += 1;
                b
            }
            (None, None) => break,
        };
        sum += next;
        if k == (n - 1) / 2 {
            at_half = next;
        }
    }
    // Counts of a few photons have a median deviation of 0 or 1: the mean of the lower nine tenths beside it.
    let mean = SIGMA_PER_LOWER_MEAN * sum / kept as f64;
    (middle, (SIGMA_PER_MAD * at_half).max(mean))
}

/// The least standard deviation of a channel: a dark channel of a few counts is 0 in most of its samples, and its robust deviation 0 or next to it. If the smallest step of the values is a
/// photon, this is the law of Poisson for the light above the median; of light that is no count it is far below the noise.
fn floor_of(values: &[f64]) -> f64 {
    let Some(level) = median(values.iter().copied()) else { return 0.0 };
    let mean = values.iter().map(|v| v - level).sum::<f64>() / values.len() as f64;
    let steps = values.iter().map(|v| (v - level).abs()).filter(|d| *d > 0.0);
    let least = steps.min_by(f64::total_cmp).unwrap_or(0.0);
    (mean.max(0.0) * least).sqrt()
}

/// Subtracts the running median and divides by the running deviation, sample by sample; the deviation is not below `floor`.
fn above(values: &[f64], floor: f64, to: &mut Vec<f64>) {
    let n = values.len();
    let size = WINDOW.min(n);
    let mut sorted: Vec<f64> = values[..size].to_vec();
    sorted.sort_by(f64::total_cmp);
    let mut from = 0;
    for (i, v) in values.iter().enumerate() {
        let wanted = i.saturating_sub(size / 2).min(n - size);
        if wanted > from {
            let (old, new) = (values[from], values[from + size]);
            let place =
                |sorted: &[f64], v: f64| sorted.partition_point(|s| s.total_cmp(&v).is_lt());
            let at = place(&sorted, old);
            sorted.remove(at);
            let at = place(&sorted, new);
            sorted.insert(at, new);
            from = wanted;
        }
        let (level, sigma) = level_of(&sorted);
        let sigma = sigma.max(floor);
        to.push(if sigma > 0.0 { (v - level) / sigma } else { 0.0 });
    }
}

impl Light {
    /// `None` where there is too little light, or the series do not share their times. Channels are added: what is a flash in one is one in all.
    pub fn new(series: &[Series]) -> Option<Self> {
        let first = series.first()?;
        if !series.iter().all(|s| s.time_s == first.time_s) || first.len() < WINDOW {
            return None;
        }
        let step_s = median_step(first).filter(|s| *s > 0.0)?;
        let span_s = first.span_s();
        let middle_s = first.time_s.first()? + 0.5 * span_s;
        let mut pieces = vec![0];
        pieces.extend(
            (1..first.len())
                .filter(|i| first.time_s[*i] - first.time_s[*i - 1] > GAP_STEPS * step_s),
        );
        pieces.push(first.len());
        let scale = 1.0 / (series.len() as f64).sqrt();
        let floors: Vec<f64> = series.iter().map(|s| floor_of(&s.value)).collect();
        let (mut time_s, mut all) = (Vec::new(), Vec::new());
        let mut own = Vec::new();
        for piece in pieces.windows(2).filter(|p| p[1] - p[0] >= LEAST_SAMPLES) {
            let from = all.len();
            time_s.extend(first.time_s[piece[0]..piece[1]].iter().map(|t| t - middle_s));
            all.resize(time_s.len(), 0.0);
            for (s, floor) in series.iter().zip(&floors) {
                own.clear();
                above(&s.value[piece[0]..piece[1]], *floor, &mut own);
                all[from..].iter_mut().zip(&own).for_each(|(a, o)| *a += scale * o);
            }
        }
        let (mut flashes, mut lengths): (Vec<Flash>, Vec<f64>) = (Vec::new(), Vec::new());
        let mut i = 0;
        while i < all.len() {
            if all[i] <= FLANK {
                i += 1;
                continue;
            }
            let from = i;
            let (mut sum, mut moment, mut peak) = (0.0, 0.0, 0.0_f64);
            while i < all.len()
                && all[i] > FLANK
                && (i == from || time_s[i] - time_s[i - 1] <= 1.5 * step_s)
            {
                sum += all[i];
                moment += all[i] * time_s[i];
                peak = peak.max(all[i]);
                i += 1;
            }
            if peak >= FLASH {
                flashes.push(Flash { time_s: moment / sum, sum });
                lengths.push((i - from) as f64);
            }
        }
        let lit = lengths.iter().sum::<f64>() / all.len().max(1) as f64;
        let width_s = step_s * (1.0 + median(lengths).unwrap_or(1.0));
        Some(Self { time_s, above: all, flashes, span_s, step_s, middle_s, width_s, lit })
    }

    /// Light within `half_s` of a moment, in standard deviations of a sample; `None` where samples are missing there.
    pub fn around(&self, time_s: f64, half_s: f64) -> Option<f64> {
        let from = self.time_s.partition_point(|t| *t < time_s - half_s);
        let to = self.time_s.partition_point(|t| *t <= time_s + half_s);
        let whole = (2.0 * half_s / self.step_s).floor().max(1.0);
        let enough = (to.saturating_sub(from)) as f64 >= whole - 0.5;
        enough.then(|| self.above[from..to].iter().sum())
    }

    /// Whether there is a sample within a step and a half of a moment.
    pub fn sees(&self, time_s: f64) -> bool {
        let next = self.time_s.partition_point(|t| *t < time_s);
        let near = |i: usize| (self.time_s[i] - time_s).abs() <= 1.5 * self.step_s;
        (next < self.time_s.len() && near(next)) || (next > 0 && near(next - 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the definitions by sorting everything anew, on values with ties.
    #[test]
    fn running_level_is_that_of_the_window() {
        let values: Vec<f64> =
            (0..400_u32).map(|i| f64::from((i * i * 7 + i * 13) % 101)).collect();
        let mut found = Vec::new();
        above(&values, 0.0, &mut found);
        for (i, z) in found.iter().enumerate() {
            let from = i.saturating_sub(50).min(400 - WINDOW);
            let own = &values[from..from + WINDOW];
            let level = median(own.iter().copied()).unwrap();
            let mut off: Vec<f64> = own.iter().map(|v| (v - level).abs()).collect();
            off.sort_by(f64::total_cmp);
            let mean = off[..91].iter().sum::<f64>() / 91.0;
            let sigma = (SIGMA_PER_MAD * off[50]).max(SIGMA_PER_LOWER_MEAN * mean);
            assert!((z - (values[i] - level) / sigma).abs() < 1e-12, "{i}: {z}");
        }
    }

    /// Truth: counts of a dark channel, one in 20 samples, and flashes of 12 counts every 2.37 s: these are the flashes, and single counts are none.
    #[test]
    fn a_dark_channel_has_flashes() {
        for share in [0, 20] {
            let n = 12_000_usize;
            let time: Vec<f64> = (0..n).map(|i| 0.01 * i as f64).collect();
            let mut value: Vec<f64> =
                (0..n).map(|i| f64::from(u8::from(share > 0 && i * i % 997 % 20 == 3))).collect();
            let mut put = 0;
            for k in 0..50 {
                let at = ((f64::from(k) + 0.2) * 2.37 / 0.01) as usize;
                if at < n {
                    value[at] += 12.0;
                    put += 1;
                }
            }
            let light = Light::new(&[Series::new("dark", &time, &value, None).unwrap()]).unwrap();
            assert_eq!(light.flashes.len(), put, "{share}");
        }
    }
}
