//! Phase dispersion minimisation (Stellingwerf 1978, ApJ 224, 953): how much the samples of a phase bin differ among themselves.

use super::PeriodError;
use super::stats::f_survival;
use crate::fold::phase_of;
use crate::series::Series;

/// Dispersion that is left after folding on one period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dispersion {
    /// Pooled variance within the phase bins over the variance of all samples: near 1 for a period that is none, near 0 for a good one.
    pub theta: f64,
    /// Weighted squares within the bins, Σ w (y − ȳ_bin)².
    pub within: f64,
    /// Bins with at least one sample.
    pub bins: usize,
    /// Samples.
    pub samples: usize,
}

/// Θ of every period, with `bins` phase bins. Weights count as in a weighted variance: scaled to a mean of 1, a sample of weight w as w samples.
/// A bin with one sample has no variance and adds nothing to either sum.
///
/// # Errors
/// Bins, periods or samples that cannot be; constant values.
///
/// ```
/// use sunglint_analysis::period::pdm;
/// use sunglint_analysis::series::Series;
///
/// let time: Vec<f64> = (0..60).map(f64::from).collect();
/// let value: Vec<f64> = (0..60).map(|i| f64::from(i % 6)).collect();
/// let series = Series::new("steps", &time, &value, None)?;
/// let theta = pdm(&series, &[6.0, 7.0], 6)?;
/// // In its own period every phase has one value.
/// assert!(theta[0].theta < 1e-9 && theta[1].theta > 0.5);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn pdm(
    series: &Series,
    periods_s: &[f64],
    bins: usize,
) -> Result<Vec<Dispersion>, PeriodError> {
    if !(2..=10_000).contains(&bins) {
        return Err(PeriodError::Bins(bins));
    }
    let (name, samples) = (series.name.clone(), series.len());
    if samples < 3 {
        return Err(PeriodError::Samples { name, samples, harmonics: 1 });
    }
    let mean = series.mean();
    let about: Vec<f64> = series.value.iter().map(|v| v - mean).collect();
    let all: f64 = about.iter().zip(&series.weight).map(|(v, w)| w * v * v).sum();
    if about.iter().all(|v| v.abs() <= 1e-14 * mean.abs()) {
        return Err(PeriodError::Constant { name, samples, value: series.value[0] });
    }
    let variance = all / (samples - 1) as f64;
    let zero = series.time_s[0];
    let mut sums = vec![[0.0; 3]; bins];
    let mut counts = vec![0_usize; bins];
    let one = |period: &f64| {
        if !(period.is_finite() && *period > 0.0) {
            return Err(PeriodError::Period(*period));
        }
        sums.fill([0.0; 3]);
        counts.fill(0);
        for ((t, v), w) in series.time_s.iter().zip(&about).zip(&series.weight) {
            let (phase, _) = phase_of(*t, zero, *period);
            let bin = ((phase * bins as f64) as usize).min(bins - 1);
            let sum = &mut sums[bin];
            *sum = [sum[0] + w, sum[1] + w * v, sum[2] + w * v * v];
            counts[bin] += 1;
        }
        let filled = counts.iter().filter(|n| **n > 0).count();
        let within: f64 = sums
            .iter()
            .zip(&counts)
            .filter(|(_, n)| **n > 1)
            .map(|([w, wy, wyy], _)| (wyy - wy * wy / w).max(0.0))
            .sum();
        let free = samples - filled;
        // As many bins as samples: nothing is left to compare.
        let theta = if free == 0 { f64::NAN } else { within / free as f64 / variance };
        Ok(Dispersion { theta, within, bins: filled, samples })
    };
    periods_s.iter().map(one).collect()
}

/// Below this Θ nothing but rounding is left, which says nothing of a longer period.
const ROUNDED: f64 = 1e-12;

/// Chance that phase bins that are `times` as fine in turns would lower the dispersion this much: the F test of a model within a larger one.
/// `coarse` is a period in M bins, `fine` a multiple of it in as many times M bins, so that every fine bin lies within a coarse one. `independent` (0 to 1) is the
/// share of the samples that are independent of their neighbours. `None` where nothing is left to judge by.
pub fn dispersion_test(coarse: &Dispersion, fine: &Dispersion, independent: f64) -> Option<f64> {
    let more = fine.bins.checked_sub(coarse.bins).filter(|n| *n > 0)? as f64;
    let free = fine.samples.checked_sub(fine.bins).filter(|n| *n > 0)? as f64;
    let free = free * independent;
    if coarse.theta < ROUNDED {
        return Some(1.0);
    }
    if fine.within <= 0.0 || free < 2.0 {
        return None;
    }
    let gain = (coarse.within - fine.within).max(0.0);
    // Neighbours that say the same make both variances as uncertain as fewer samples would; they do not change what the ratio is expected to be,
    // as long as they fall into one bin. The wider distribution is the careful one.
    let ratio = gain / more / (fine.within / (fine.samples - fine.bins) as f64);
    Some(f_survival(ratio * independent, more, free))
}
