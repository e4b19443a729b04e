//! The Fourier spectrum of a curve that is sampled regularly.

use super::lomb_scargle::centred_times;
use super::sums::sums;
use super::{FrequencyGrid, PeriodError};
use crate::series::Series;
use sunglint_numerics::order::median;

/// A Fourier spectrum.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    /// Frequencies: whole numbers of turns in the span, up to half of the sampling.
    pub grid: FrequencyGrid,
    /// Amplitudes at them, in units of the values: a sine of amplitude A gives A at its frequency.
    pub amplitude: Vec<f64>,
    /// The step between samples, s.
    pub step_s: f64,
    /// Places on the regular grid of times without a sample: they count as the mean, which lowers and broadens every peak.
    pub missing: usize,
    /// Samples that lie more than a tenth of a step beside their place: moved to it, they would lie about phase; here they stay where they are.
    pub beside: usize,
}

/// The spectrum of a regularly sampled series, its mean subtracted. Samples are taken at their own times (no interpolation); what is missing counts as the mean.
///
/// # Errors
/// Fewer than four samples, or constant values.
///
/// ```
/// use sunglint_analysis::period::spectrum;
/// use sunglint_analysis::series::Series;
///
/// let time: Vec<f64> = (0..100).map(f64::from).collect();
/// let value: Vec<f64> = time.iter().map(|t| 2.0 * (std::f64::consts::TAU * 0.2 * t).sin()).collect();
/// let found = spectrum(&Series::new("sine", &time, &value, None)?)?;
/// let most = found.amplitude.iter().copied().fold(0.0, f64::max);
/// assert!((most - 2.0).abs() < 1e-6);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn spectrum(series: &Series) -> Result<Spectrum, PeriodError> {
    let (name, samples) = (series.name.clone(), series.len());
    let step_s = median_step(series);
    let (true, Some(step_s)) = (samples >= 4, step_s) else {
        return Err(PeriodError::Samples { name, samples, harmonics: 1 });
    };
    let mean = series.value.iter().sum::<f64>() / samples as f64;
    let about: Vec<f64> = series.value.iter().map(|v| v - mean).collect();
    if about.iter().all(|v| v.abs() <= 1e-14 * mean.abs()) {
        return Err(PeriodError::Constant { name, samples, value: series.value[0] });
    }
    // As many places as whole steps fit.
    let places = (series.span_s() / step_s).round() + 1.0;
    let missing = (places - samples as f64).max(0.0) as usize;
    let beside = series
        .time_s
        .iter()
        .map(|t| (t - series.time_s[0]) / step_s)
        .filter(|place| (place - place.round()).abs() > 0.1)
        .count();
    let resolution = 1.0 / (places * step_s);
    let n = ((0.5 / step_s) / resolution * (1.0 + 1e-9)).floor() as usize;
    let grid = FrequencyGrid { first_hz: resolution, step_hz: resolution, n: n.max(1) };
    let found = sums(&centred_times(series), &[&about], &grid);
    let scale = 2.0 / samples as f64;
    let amplitude = found[0].cos.iter().zip(&found[0].sin).map(|(c, s)| scale * c.hypot(*s));
    Ok(Spectrum { grid, amplitude: amplitude.collect(), step_s, missing, beside })
}

/// The median time between neighbouring samples that differ, s.
pub(super) fn median_step(series: &Series) -> Option<f64> {
    median(series.time_s.windows(2).map(|t| t[1] - t[0]).filter(|dt| *dt > 0.0))
}
