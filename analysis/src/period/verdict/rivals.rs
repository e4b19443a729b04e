//! Rivals of a period: other peaks, and what the sampling does.

use super::super::{FrequencyGrid, PeriodError, window};
use super::range::{MOST_FREQUENCIES, OVERSAMPLING};
use super::search::Search;
use crate::series::Series;

/// A peak this much lower in twice the logarithm of the likelihood is not ruled out: once in 2,000 by chance.
pub(super) const RIVAL: f64 = 12.0;
/// A window's peak this high makes aliases.
const WINDOW_PEAK: f64 = 0.3;

impl Search<'_> {
    /// Peaks of the sampling's own spectrum, the highest first.
    pub fn window_peaks(&self) -> Result<Vec<(f64, f64)>, PeriodError> {
        let Some(longest) = self.series.iter().max_by(|a, b| a.span_s().total_cmp(&b.span_s()))
        else {
            return Ok(Vec::new());
        };
        let step_hz = 1.0 / (OVERSAMPLING * self.range.span_s);
        let n = (2.0 * self.range.limit_hz / step_hz) as usize + 2;
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

    /// Other peaks that are nearly as high as the best at their own best number of harmonics, and no multiple or part of it.
    pub fn rivals(
        &self,
        base: f64,
        curves: &[(usize, FrequencyGrid, Vec<f64>)],
        independent: f64,
    ) -> Vec<f64> {
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
        for (harmonics, grid, joint) in curves {
            let floor = highest - RIVAL / independent + cost * *harmonics as f64;
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
