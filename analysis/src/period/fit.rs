//! Harmonics at one frequency, with their coefficients: for refining a period and for what it leaves.

use super::PeriodError;
use super::lomb_scargle::{Centred, Normal};
use super::sums::turns;
use crate::series::Series;
use std::f64::consts::TAU;

/// A mean and harmonics, fitted at one frequency.
#[derive(Debug, Clone, PartialEq)]
pub struct HarmonicFit {
    /// The frequency, Hz.
    pub frequency_hz: f64,
    /// The moment of phase 0: the middle of the series, s on its axis.
    pub middle_s: f64,
    /// The constant of the model, in units of the values.
    pub constant: f64,
    /// Coefficients [cos, sin] of the harmonics, from the first.
    pub harmonics: Vec<[f64; 2]>,
    /// Share of the weighted variance that is explained, 0 to 1.
    pub power: f64,
}

impl HarmonicFit {
    /// The model at a moment of the series' axis, s.
    pub fn at(&self, time_s: f64) -> f64 {
        let (sin, cos) = (TAU * turns(self.frequency_hz, time_s - self.middle_s)).sin_cos();
        let (mut c, mut s) = (1.0, 0.0);
        let mut value = self.constant;
        for [a, b] in &self.harmonics {
            (c, s) = (c * cos - s * sin, c * sin + s * cos);
            value += a * c + b * s;
        }
        value
    }

    /// Half of the distance between two neighbouring extremes, roughly: the root of the sum of squared amplitudes.
    pub fn amplitude(&self) -> f64 {
        self.harmonics.iter().map(|[a, b]| a * a + b * b).sum::<f64>().sqrt()
    }
}

/// Fits a mean and harmonics at a frequency.
///
/// # Errors
/// The errors of [`super::lomb_scargle()`].
pub fn fit(
    series: &Series,
    frequency_hz: f64,
    harmonics: usize,
) -> Result<HarmonicFit, PeriodError> {
    if !(frequency_hz.is_finite() && frequency_hz > 0.0) {
        return Err(PeriodError::Period(1.0 / frequency_hz));
    }
    let centred = Centred::new(series, harmonics)?;
    let (mut normal, gain) = solve(&centred, frequency_hz, harmonics);
    let (constant, coefficients) = normal.coefficients(centred.total);
    normal.values.clear();
    Ok(HarmonicFit {
        frequency_hz,
        middle_s: series.time_s[0] + 0.5 * series.span_s(),
        constant: constant + series.mean(),
        harmonics: coefficients,
        power: centred.share(gain),
    })
}

/// The normal equations at a frequency, solved, and by how much χ² falls.
pub(super) fn solve(centred: &Centred, frequency_hz: f64, harmonics: usize) -> (Normal, f64) {
    let mut normal = Normal::new(harmonics);
    normal.weights[0] = [centred.total, 0.0];
    for ((t, w), y) in centred.time.iter().zip(centred.weight).zip(&centred.weighted) {
        let (sin, cos) = (TAU * turns(frequency_hz, *t)).sin_cos();
        let (mut c, mut s) = (1.0, 0.0);
        for k in 1..=2 * harmonics {
            (c, s) = (c * cos - s * sin, c * sin + s * cos);
            let of_weights = &mut normal.weights[k];
            of_weights[0] += w * c;
            of_weights[1] += w * s;
            if k <= harmonics {
                let of_values = &mut normal.values[k - 1];
                of_values[0] += y * c;
                of_values[1] += y * s;
            }
        }
    }
    let gain = normal.reduction(centred.total);
    (normal, gain)
}
