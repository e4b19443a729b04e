//! Rivals of a period: other peaks, and what the sampling does.

use super::super::fit::{HarmonicFit, fit};
use super::super::sums::turns;
use super::super::{FrequencyGrid, PeriodError, window};
use super::judge::{ALIKE, ALIKE_RARE};
use super::outcome::Folding;
use super::range::{MOST_FREQUENCIES, OVERSAMPLING};
use super::search::{Gains, Search};
use crate::series::Series;

/// A peak this much lower in twice the logarithm of the likelihood is not ruled out: once in 2,000 by chance.
pub(super) const RIVAL: f64 = 12.0;
/// A window's peak this high makes aliases.
const WINDOW_PEAK: f64 = 0.3;
/// Samples whose window has a peak this high are even: f and f_s ± f are the same to them.
const EVEN: f64 = 0.9;
/// Shortest turn, in exposures, of the highest harmonic that stands out at a folded period: an exposure leaves 10 % of the amplitude of this (sin πx/πx), and nothing of one turn.
const LEAST_EXPOSURES: f64 = 1.1;
/// Folded periods that are named.
const MOST_FOLDED: usize = 12;
/// Multiples of the sampling that are counted.
const MOST_MULTIPLES: usize = 10_000;

/// Variance of the cosine's or the sine's amplitude of a fit.
fn noise_of(series: &Series, model: &HarmonicFit, independent: f64) -> f64 {
    let n = series.len() as f64;
    let mean = series.mean();
    let about = series.value.iter().zip(&series.weight).map(|(v, w)| w * (v - mean).powi(2));
    let left = about.sum::<f64>() * (1.0 - model.power);
    let free = (n - 2.0 * model.harmonics.len() as f64 - 1.0).max(1.0);
    2.0 * left / free / (n * independent)
}

impl Search<'_> {
    /// Peaks of the sampling's own spectrum, the highest first.
    pub fn window_peaks(&self) -> Result<Vec<(f64, f64)>, PeriodError> {
        let Some(longest) = self.series.iter().max_by(|a, b| a.span_s().total_cmp(&b.span_s()))
        else {
            return Ok(Vec::new());
        };
        let step_hz = 1.0 / (OVERSAMPLING * self.range.span_s);
        // A little beyond the sampling itself, so that its peak has two flanks.
        let n = (2.0 * self.range.limit_hz / step_hz) as usize + 12;
        if n > MOST_FREQUENCIES {
            return Ok(Vec::new());
        }
        let grid = FrequencyGrid { first_hz: 0.0, step_hz, n };
        // The sampling's own: weights follow the light, and would bring its period in.
        let even = Series { weight: vec![1.0; longest.len()], ..(*longest).clone() };
        let power = window(&even, &grid)?;
        let mut peaks: Vec<(f64, f64)> = (1..n - 1)
            .filter(|i| {
                power[*i] > WINDOW_PEAK && power[*i] >= power[i - 1] && power[*i] >= power[i + 1]
            })
            .map(|i| (grid.frequency_hz(i), power[i]))
            .collect();
        peaks.sort_by(|a, b| b.1.total_cmp(&a.1));
        peaks.truncate(8);
        Ok(peaks)
    }

    /// Samples per second where the sampling of all series is even, from the peaks of the longest one's window.
    fn even_hz(&self, peaks: &[(f64, f64)]) -> Option<f64> {
        const GOLDEN: f64 = 0.618_033_988_749_895;
        let high = peaks.iter().filter(|p| p.1 > EVEN).map(|p| p.0);
        let near = high.min_by(f64::total_cmp)?;
        let height = |s: &Series, f: f64| {
            let first = s.time_s.first().copied().unwrap_or(0.0);
            let (a, b) = s.time_s.iter().fold((0.0, 0.0), |(a, b), t| {
                let (sin, cos) = (std::f64::consts::TAU * turns(f, t - first)).sin_cos();
                (a + cos, b + sin)
            });
            (a * a + b * b) / (s.len() as f64).powi(2)
        };
        let longest = self.series.iter().max_by(|a, b| a.span_s().total_cmp(&b.span_s()))?;
        let half = 1.0 / (OVERSAMPLING * self.range.span_s);
        let (mut a, mut b) = (near - half, near + half);
        for _ in 0..30 {
            let (x, y) = (b - GOLDEN * (b - a), a + GOLDEN * (b - a));
            if height(longest, x) > height(longest, y) { b = y } else { a = x }
        }
        let found = 0.5 * (a + b);
        self.series.iter().all(|s| height(s, found) > EVEN).then_some(found)
    }

    /// Even sampling, and the frequencies that it folds onto `base` and the exposures do not rule out, the lowest first, by the multiple of the sampling. `harmonics` stand out at `base`. The light that is seen at `base` may also be the second or third harmonic of a
    /// folded turn, whose other harmonics are seen elsewhere: as with the multiples of a period, where it is not known that they are missing.
    pub fn folded(
        &self,
        base: f64,
        harmonics: usize,
        independent: f64,
        peaks: &[(f64, f64)],
    ) -> Option<(Folding, Vec<(usize, f64)>)> {
        let even_hz = self.even_hz(peaks)?;
        let known = self.series.iter().all(|s| s.exposure_s > 0.0);
        let longest = self.series.iter().map(|s| s.exposure_s).fold(0.0, f64::max);
        let mut folding = Folding {
            step_s: 1.0 / even_hz,
            exposure_s: known.then_some(longest),
            unnamed: 0,
            shortest_s: f64::INFINITY,
        };
        if !known {
            return Some((folding, Vec::new()));
        }
        let highest_hz = 1.0 / (LEAST_EXPOSURES * longest * harmonics as f64);
        // By the part of a turn, the rest of the multiple of the sampling, and the sign: (n f_s ± f)/part. Of pairs that fold onto one another one is asked.
        let open = |f: f64, part: usize| self.is_part_open(f, part, harmonics, independent);
        let halves = [open(base / 2.0, 2), open((even_hz - base) / 2.0, 2)];
        let thirds = [base, even_hz - base, 2.0 * even_hz - base].map(|times| open(times / 3.0, 3));
        let is_possible = |n: usize, sign: f64, part: usize| match (part, n % part, sign < 0.0) {
            (1, ..) => true,
            (2, rest, _) => halves[rest],
            (_, 0, _) => thirds[0],
            (_, 1, true) | (_, 2, false) => thirds[1],
            _ => thirds[2],
        };
        let mut all = Vec::new();
        for n in 1..=MOST_MULTIPLES {
            let middle = n as f64 * even_hz;
            if (middle - base) / 3.0 > highest_hz {
                break;
            }
            for part in 1..=3 {
                for sign in [-1.0, 1.0] {
                    let f = (middle + sign * base) / part as f64;
                    // A part of a turn has as many more harmonics.
                    let above = part as f64 * f > highest_hz && part > 1;
                    // What is searched for is found there, but for turns of which a harmonic beyond the search is what is seen.
                    let is_beyond = f > self.range.highest_hz || part > 1;
                    if is_beyond
                        && f >= self.range.lowest_hz
                        && f <= highest_hz
                        && !above
                        && is_possible(n, sign, part)
                    {
                        all.push((n, f));
                    }
                }
            }
        }
        all.sort_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((_, highest)) = all.last() {
            folding.shortest_s = 1.0 / highest;
        }
        folding.unnamed = all.len().saturating_sub(MOST_FOLDED);
        all.truncate(MOST_FOLDED);
        Some((folding, all))
    }

    /// Whether the harmonics of a frequency that are no multiples of `part` may be there, by as much as turns of bodies with like sides may differ.
    fn is_part_open(&self, f: f64, part: usize, harmonics: usize, independent: f64) -> bool {
        let limit = if part == 3 { ALIKE_RARE } else { ALIKE };
        let (mut others, mut own, mut noise, mut number) = (0.0, 0.0, 0.0, 0.0);
        for s in self.series {
            let Ok(model) = fit(s, f, part * harmonics) else { return true };
            let each = noise_of(s, &model, independent);
            for (k, [a, b]) in model.harmonics.iter().enumerate() {
                // Squares of cosine and sine: noise gives as much again as their scatter.
                let light = a * a + b * b - 2.0 * each;
                if (k + 1).is_multiple_of(part) {
                    own += light;
                } else {
                    (others, noise, number) = (others + light, noise + 2.0 * each, number + 1.0);
                }
            }
        }
        let scatter = noise / f64::max(number, 1.0).sqrt();
        own <= 0.0 || 2.0 * ((others.max(0.0) + 2.0 * scatter) / own).sqrt() > limit
    }

    /// Other peaks that are nearly as high as the best at their own best number of harmonics, and no multiple or part of it. `handicap` is that of the best.
    pub fn rivals(&self, base: f64, curves: &[Gains], handicap: f64, independent: f64) -> Vec<f64> {
        let resolution = 1.0 / self.range.span_s;
        let related = |f: f64| {
            (1..=24).any(|i| {
                (1..=24).any(|j| {
                    let at = base * i as f64 / j as f64;
                    (f - at).abs() < 1.5 * resolution / j as f64
                        && (i == 1 || j == 1 || i <= 4 && j <= 4)
                })
            })
        };
        let mut rivals: Vec<f64> = Vec::new();
        let cost = 2.0 * self.series.len() as f64 * (self.samples() as f64).ln();
        let harmonics = self.order(base);
        let highest = self.gain(base, harmonics) - cost * harmonics as f64;
        for Gains { harmonics, grid, joint, handicap: own } in curves {
            let floor = highest - handicap + own - RIVAL / independent + cost * *harmonics as f64;
            for i in 1..grid.n - 1 {
                let f = grid.frequency_hz(i);
                let is_peak = joint[i] >= joint[i - 1] && joint[i] >= joint[i + 1];
                if is_peak
                    && joint[i] > floor
                    && !related(f)
                    && rivals.iter().all(|r| (r - f).abs() > resolution)
                {
                    rivals.push(f);
                }
            }
        }
        rivals.truncate(6);
        rivals
    }
}
