//! The frequencies that are looked at.
//!
//! Even samples show nothing above half of their rate. Uneven ones do (Eyer & Bartholdi 1999, A&AS 135, 1): up to half of the frequency at which their spectral window comes back to 1. The usual range ends at half of the median rate. Where the samples are uneven, a second one follows it.

use super::super::spectrum::median_step;
use super::super::sums::sums;
use super::super::{FrequencyGrid, PeriodError};
use super::outcome::{Options, Reason, Uneven};
use crate::rounding::rounding_s;
use crate::series::Series;

/// Frequencies of a search to a resolution of the highest harmonic.
pub(super) const OVERSAMPLING: f64 = 5.0;
/// More frequencies than that are refused.
pub(super) const MOST_FREQUENCIES: usize = 20_000_000;

/// Factor from the shortest usual period down to the shortest one that uneven samples are asked for.
const BEYOND: f64 = 100.0;
/// Frequencies of all series beyond the usual ones, at most.
const MOST_BEYOND: f64 = 1e6;
/// Samples whose neighbours are in step like that at about their own rate are even, as in the module `rivals`.
const EVEN: f64 = 0.9;
/// In step like that at a higher frequency they show nothing above half of it.
const REPEATS: f64 = 0.98;
/// About their own rate: frequencies times the median step.
const OWN_RATE: std::ops::Range<f64> = 0.75..1.25;
/// Neighbours up to that many samples on, without a gap of more than so many median steps.
const LAGS: usize = 8;
const GAP_STEPS: f64 = 20.0;
/// Samples whose neighbours are looked at, at most.
const MOST_NEIGHBOURS: usize = 2000;
/// Frequencies to one over the longest distance of neighbours: 0.4 % of the height of a peak is lost between two.
const FINE: f64 = 20.0;

/// Spectral window of near pairs of samples, which tells whether neighbours are in step: the mean of cos 2πf(t_j − t_i). Parts of a curve far from one another may be out of step with each other, and slow drifts do not count.
struct Neighbours {
    distance_s: Vec<f64>,
    step_s: f64,
    rounding_s: f64,
}

impl Neighbours {
    fn new(series: &Series) -> Option<Self> {
        let step_s = median_step(series)?;
        let time = &series.time_s;
        let mut distance_s = Vec::new();
        for i in (0..time.len()).step_by(1 + time.len() / MOST_NEIGHBOURS) {
            for k in i + 1..(i + 1 + LAGS).min(time.len()) {
                if time[k] - time[k - 1] > GAP_STEPS * step_s {
                    break;
                }
                distance_s.push(time[k] - time[i]);
            }
        }
        distance_s.retain(|d| *d > 0.0);
        let rounding_s = rounding_s(time).unwrap_or(0.0);
        (!distance_s.is_empty()).then_some(Self { distance_s, step_s, rounding_s })
    }

    /// The lowest frequency of a range at which neighbours are in step by `least`. What rounding of the times took away from that is put back: two roundings of a step τ leave (sin πfτ/πfτ)².
    fn in_step(&self, from_hz: f64, to_hz: f64, least: f64) -> Option<f64> {
        let longest = self.distance_s.iter().copied().fold(0.0, f64::max);
        let step_hz = 1.0 / (FINE * longest);
        let n = ((to_hz - from_hz) / step_hz).ceil();
        if !(n >= 1.0 && n < MOST_FREQUENCIES as f64) {
            return None;
        }
        let grid = FrequencyGrid { first_hz: from_hz, step_hz, n: n as usize + 1 };
        let ones = vec![1.0; self.distance_s.len()];
        let found = sums(&self.distance_s, &[&ones], &grid).pop()?;
        let rounded = |f: f64| {
            let x = std::f64::consts::PI * f * self.rounding_s;
            // Beyond a turn nothing is left that could be put back.
            if x > 0.0 && x < 0.5 * std::f64::consts::PI { (x.sin() / x).powi(2) } else { 1.0 }
        };
        let height = |(i, c): (usize, &f64)| {
            let f = grid.frequency_hz(i);
            (f, c / self.distance_s.len() as f64 / rounded(f))
        };
        found.cos.iter().enumerate().map(height).find(|(_, h)| *h > least).map(|(f, _)| f)
    }

    fn is_even(&self) -> bool {
        self.in_step(OWN_RATE.start / self.step_s, OWN_RATE.end / self.step_s, EVEN).is_some()
    }
}

/// The frequencies that are looked at.
#[derive(Debug, Clone, Copy)]
pub(super) struct Range {
    pub lowest_hz: f64,
    pub highest_hz: f64,
    /// Highest frequency that the sampling shows: harmonics lie below it.
    pub limit_hz: f64,
    pub span_s: f64,
    /// Chances count the frequencies up to this.
    pub counted_hz: f64,
}

impl Range {
    fn ends(series: &[&Series], options: &Options) -> (f64, f64, f64, f64) {
        let span_s = series.iter().map(|s| s.span_s()).fold(0.0, f64::max);
        let step_s = series.iter().filter_map(|s| median_step(s)).fold(f64::INFINITY, f64::min);
        let exposure_s = series.iter().map(|s| s.exposure_s).fold(f64::INFINITY, f64::min);
        let finest_s = 2.0 * step_s.max(exposure_s);
        (
            span_s,
            finest_s,
            options.shortest_s.unwrap_or(finest_s),
            options.longest_s.unwrap_or(0.5 * span_s),
        )
    }

    pub fn new(series: &[&Series], options: &Options) -> Result<Option<Self>, PeriodError> {
        let (span_s, finest_s, shortest_s, longest_s) = Self::ends(series, options);
        let is_asked = options.shortest_s.is_some() || options.longest_s.is_some();
        let good = shortest_s > 0.0 && shortest_s < longest_s && longest_s.is_finite();
        if !good && is_asked && finest_s < 0.5 * span_s {
            return Err(PeriodError::Range { shortest_s, longest_s });
        }
        if !good || span_s <= 0.0 {
            return Ok(None);
        }
        let limit_hz = 1.0 / finest_s.min(shortest_s);
        let (lowest_hz, highest_hz) = (1.0 / longest_s, 1.0 / shortest_s);
        let frequencies = (OVERSAMPLING * span_s * highest_hz) as usize;
        if frequencies > MOST_FREQUENCIES {
            return Err(PeriodError::TooMany { frequencies, most: MOST_FREQUENCIES, shortest_s });
        }
        Ok(Some(Self { lowest_hz, highest_hz, limit_hz, span_s, counted_hz: highest_hz }))
    }

    /// Frequencies beyond the usual ones that uneven samples show, and what is said of them; `None` where the samples of a series are even, or nothing may be looked for.
    pub fn beyond(&self, series: &[&Series], options: &Options) -> Option<(Self, Uneven)> {
        if options.shortest_s.is_some() {
            return None;
        }
        let all: Option<Vec<Neighbours>> = series.iter().map(|s| Neighbours::new(s)).collect();
        let all = all?;
        let usual_s = 1.0 / self.highest_hz;
        let exposure_s = series.iter().map(|s| s.exposure_s).fold(0.0, f64::max);
        let rounding_s = all.iter().map(|n| n.rounding_s).fold(0.0, f64::max);
        let by_cost_s = OVERSAMPLING * self.span_s * series.len() as f64 / MOST_BEYOND;
        let by_light_s = 2.0 * exposure_s.max(rounding_s);
        let mut shortest_s = (usual_s / BEYOND).max(by_cost_s).max(by_light_s);
        if shortest_s >= usual_s || all.iter().any(Neighbours::is_even) {
            return None;
        }
        let mut is_cut = by_light_s < shortest_s;
        let repeats =
            all.iter().filter_map(|n| n.in_step(self.highest_hz, 2.0 / shortest_s, REPEATS));
        if let Some(f) = repeats.min_by(f64::total_cmp) {
            (shortest_s, is_cut) = (2.0 / f, false);
        }
        if shortest_s >= usual_s {
            return None;
        }
        let highest_hz = 1.0 / shortest_s;
        let range = Self { lowest_hz: self.highest_hz, highest_hz, limit_hz: highest_hz, ..*self };
        Some((range, Uneven { usual_s, shortest_s, is_cut }))
    }

    pub fn reason(series: &[&Series], options: &Options) -> Reason {
        let (span_s, _, shortest_s, longest_s) = Self::ends(series, options);
        let step_s = series.iter().filter_map(|s| median_step(s)).fold(f64::INFINITY, f64::min);
        let exposure_s = series.iter().map(|s| s.exposure_s).fold(f64::INFINITY, f64::min);
        Reason::Range { step_s, exposure_s, span_s, shortest_s, longest_s }
    }

    /// A grid for a model of so many harmonics; `None` where there is no room below the limit.
    pub fn grid(&self, harmonics: usize) -> Option<FrequencyGrid> {
        let last = self.highest_hz.min(self.limit_hz / harmonics as f64);
        let step_hz = 1.0 / (OVERSAMPLING * harmonics as f64 * self.span_s);
        let n = ((last - self.lowest_hz) / step_hz).floor();
        (n >= 2.0).then(|| FrequencyGrid { first_hz: self.lowest_hz, step_hz, n: n as usize + 1 })
    }
}
