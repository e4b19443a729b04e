//! Chance that noise alone gives such a peak.
//!
//! The gain of a model over a mean is a χ² process along frequency. The chance that it crosses a level anywhere is at most the chance at one frequency plus
//! the expected number of upcrossings (Rice 1945; of periodograms Baluev 2008, MNRAS 385, 1279; of harmonics Baluev 2009, MNRAS 395, 1541): an
//! upper bound, close where it is small.

use super::PeriodError;
use super::stats::chi2_survival;
use crate::series::Series;
use libm::lgamma;
use std::f64::consts::PI;

/// The gain in twice the logarithm of the likelihood, its noise unknown: −(N − 2K − 1) ln(1 − P), from powers P of [`super::lomb_scargle()`]. Those of
/// channels with noises of their own add up.
pub fn joint_gain(power: f64, samples: usize, harmonics: usize) -> f64 {
    let free = samples.saturating_sub(2 * harmonics + 1) as f64;
    // Noiseless curves leave roundings: more than that is not told apart.
    -free * (1.0 - power).max(1e-14).ln()
}

/// An upper bound of the chance that the joint gain of noise exceeds `gain` somewhere up to `highest_hz`, with `harmonics` harmonics in each of `series`. `independent` scales
/// the gain and the degrees of freedom where samples or channels say the same twice (1: they do not).
///
/// # Errors
/// No series, or no harmonics.
pub fn false_alarm(
    gain: f64,
    series: &[&Series],
    harmonics: usize,
    highest_hz: f64,
    independent: f64,
) -> Result<f64, PeriodError> {
    if harmonics == 0 {
        return Err(PeriodError::Harmonics(harmonics));
    }
    let Some(first) = series.first() else {
        return Err(PeriodError::Samples { name: "the question".into(), samples: 0, harmonics });
    };
    let degrees = (2 * harmonics * series.len()) as f64 * independent;
    // The widest of the series' effective spans √(4π var t).
    let spread = |s: &Series| {
        let total: f64 = s.weight.iter().sum();
        let mean = s.time_s.iter().zip(&s.weight).map(|(t, w)| t * w).sum::<f64>() / total;
        let about = |(t, w): (&f64, &f64)| w * (t - mean).powi(2);
        (4.0 * PI * s.time_s.iter().zip(&s.weight).map(about).sum::<f64>() / total).sqrt()
    };
    let span = series.iter().map(|s| spread(s)).fold(spread(first), f64::max);
    // The harmonics run through phase k times as fast: the mean of √(Σ k² u²) over directions is at most the root of the mean.
    let k = harmonics as f64;
    let speed = ((k + 1.0) * (2.0 * k + 1.0) / 6.0).sqrt();
    let z = 0.5 * gain * independent;
    if z <= 0.0 {
        return Ok(1.0);
    }
    let crossings = (0.5 * (degrees - 1.0) * z.ln() - z - lgamma(0.5 * degrees)).exp()
        * highest_hz
        * span
        * speed;
    Ok((chi2_survival(2.0 * z, degrees) + crossings).min(1.0))
}
