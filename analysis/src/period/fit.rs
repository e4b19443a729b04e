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
    let (normal, gain) = Sampled::new(&centred, frequency_hz, harmonics).solved(harmonics);
    let (constant, coefficients) = normal.coefficients(centred.total);
    Ok(HarmonicFit {
        frequency_hz,
        middle_s: series.time_s[0] + 0.5 * series.span_s(),
        constant: constant + series.mean(),
        harmonics: coefficients,
        power: centred.share(gain),
    })
}

/// Sums over the samples at one frequency: of these all models up to a number of harmonics are solved.
pub(super) struct Sampled {
    total: f64,
    /// Σ w cos kωt, Σ w sin kωt for k from 1 to twice the harmonics.
    weights: Vec<[f64; 2]>,
    /// Σ w y cos kωt, Σ w y sin kωt for k from 1.
    values: Vec<[f64; 2]>,
}

impl Sampled {
    pub fn new(centred: &Centred, frequency_hz: f64, harmonics: usize) -> Self {
        let (mut weights, mut values) = (vec![[0.0; 2]; 2 * harmonics], vec![[0.0; 2]; harmonics]);
        for ((t, w), y) in centred.time.iter().zip(centred.weight).zip(&centred.weighted) {
            let (sin, cos) = (TAU * turns(frequency_hz, *t)).sin_cos();
            let (mut c, mut s) = (1.0, 0.0);
            for (k, of_weights) in weights.iter_mut().enumerate() {
                (c, s) = (c * cos - s * sin, c * sin + s * cos);
                of_weights[0] += w * c;
                of_weights[1] += w * s;
                if let Some(of_values) = values.get_mut(k) {
                    of_values[0] += y * c;
                    of_values[1] += y * s;
                }
            }
        }
        Self { total: centred.total, weights, values }
    }

    /// The normal equations of so many harmonics, solved, and by how much χ² falls.
    pub fn solved(&self, harmonics: usize) -> (Normal<1>, f64) {
        let mut normal = Normal::new(harmonics);
        for (to, from) in normal.weights[1..].iter_mut().zip(&self.weights) {
            *to = from.map(|v| [v]);
        }
        for (to, from) in normal.values.iter_mut().zip(&self.values) {
            *to = from.map(|v| [v]);
        }
        let [gain] = normal.reduction(self.total);
        (normal, gain)
    }
}
