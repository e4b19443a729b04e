//! The frequencies that are looked at.

use super::super::spectrum::median_step;
use super::super::{FrequencyGrid, PeriodError};
use super::outcome::{Options, Reason};
use crate::series::Series;

/// Frequencies of a search to a resolution of the highest harmonic.
pub(super) const OVERSAMPLING: f64 = 5.0;
/// More frequencies than that are refused.
pub(super) const MOST_FREQUENCIES: usize = 20_000_000;

/// The frequencies that are looked at.
#[derive(Debug, Clone, Copy)]
pub(super) struct Range {
    pub lowest_hz: f64,
    pub highest_hz: f64,
    /// Highest frequency that the sampling shows: harmonics lie below it.
    pub limit_hz: f64,
    pub span_s: f64,
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
        Ok(Some(Self { lowest_hz, highest_hz, limit_hz, span_s }))
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
