//! Folding: every sample at its phase in a period, and means over stretches of phase.

mod curves;

pub use curves::{
    FoldCurvesError, FoldOptions, FoldedChannel, FoldedCurves, SpinAxis, fold_curves,
};

use crate::series::Series;

/// Why nothing was folded.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FoldError {
    /// A period that is none.
    #[error("the period is {0} s, expected a time above 0")]
    Period(f64),
    /// An uncertainty that is none.
    #[error("the period's uncertainty is {0} s, expected a time not below 0")]
    Uncertainty(f64),
    /// Too few or too many stretches of phase.
    #[error("{0} phase bins, expected 2 to 100,000")]
    Bins(usize),
    /// No sample.
    #[error("{0}: there is no sample to fold")]
    Empty(String),
}

/// Options of a folding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Folding {
    /// The period, s.
    pub period_s: f64,
    /// Standard uncertainty, s, where it is known.
    pub period_sigma_s: Option<f64>,
    /// The moment of phase 0, s on the axis of the series.
    pub epoch_s: f64,
    /// Stretches of phase.
    pub bins: usize,
}

/// The samples of one stretch of phase.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhaseBin {
    /// Middle, 0 to 1.
    pub phase: f64,
    /// Samples in it.
    pub samples: usize,
    /// Weighted mean of their values; `NaN` without samples.
    pub mean: f64,
    /// Standard uncertainty of the mean from the scatter of the samples about it; `NaN` with fewer than two.
    pub sigma: f64,
    /// Weighted standard deviation of the samples; `NaN` with fewer than two.
    pub scatter: f64,
}

/// A folded series.
#[derive(Debug, Clone, PartialEq)]
pub struct Folded {
    /// Phase of every sample of the series, 0 to below 1.
    pub phase: Vec<f64>,
    /// Turn that every sample belongs to, counted from the epoch.
    pub turn: Vec<i64>,
    /// Means over stretches of phase.
    pub bins: Vec<PhaseBin>,
    /// Turns from the first sample to the last.
    pub turns: f64,
    /// Part of a turn by which the phases of the first and last sample may slip against one another, from the period's uncertainty.
    pub slip: Option<f64>,
}

/// Phase and turn of a moment. Exact to the last bit of `t − epoch`: the remainder is taken before the division.
///
/// ```
/// use sunglint_analysis::fold::phase_of;
///
/// assert_eq!(phase_of(25.0, 0.0, 10.0), (0.5, 2));
/// assert_eq!(phase_of(-2.5, 0.0, 10.0), (0.75, -1));
/// ```
pub fn phase_of(time_s: f64, epoch_s: f64, period_s: f64) -> (f64, i64) {
    let t = time_s - epoch_s;
    let phase = t.rem_euclid(period_s) / period_s;
    // A remainder just below the period may round up to it.
    let (phase, over) = if phase >= 1.0 { (0.0, 1) } else { (phase, 0) };
    (phase, (t / period_s - phase).round() as i64 + over)
}

/// Folds.
///
/// # Errors
/// A period, an uncertainty or a number of bins that cannot be; no sample.
///
/// ```
/// use sunglint_analysis::fold::{Folding, fold};
/// use sunglint_analysis::series::Series;
///
/// let series = Series::new("two steps", &[0.0, 6.0, 10.0, 16.0], &[1.0, 3.0, 1.0, 3.0], None)?;
/// let folding = Folding { period_s: 10.0, period_sigma_s: None, epoch_s: 0.0, bins: 2 };
/// let folded = fold(&series, &folding)?;
/// assert_eq!(folded.turn, [0, 0, 1, 1]);
/// assert_eq!((folded.bins[0].mean, folded.bins[1].mean), (1.0, 3.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn fold(series: &Series, folding: &Folding) -> Result<Folded, FoldError> {
    let Folding { period_s, period_sigma_s, epoch_s, bins } = *folding;
    if !(period_s.is_finite() && period_s > 0.0) {
        return Err(FoldError::Period(period_s));
    }
    if let Some(sigma) = period_sigma_s.filter(|s| !(s.is_finite() && *s >= 0.0)) {
        return Err(FoldError::Uncertainty(sigma));
    }
    if !(2..=100_000).contains(&bins) {
        return Err(FoldError::Bins(bins));
    }
    if series.is_empty() {
        return Err(FoldError::Empty(series.name.clone()));
    }
    let (phase, turn): (Vec<f64>, Vec<i64>) =
        series.time_s.iter().map(|t| phase_of(*t, epoch_s, period_s)).unzip();
    let mut members = vec![Vec::new(); bins];
    for (i, phase) in phase.iter().enumerate() {
        members[((phase * bins as f64) as usize).min(bins - 1)].push(i);
    }
    let bins_of = members.iter().enumerate().map(|(k, members)| {
        let (mean, sigma, scatter) = moments(series, members);
        PhaseBin {
            phase: (k as f64 + 0.5) / bins as f64,
            samples: members.len(),
            mean,
            sigma,
            scatter,
        }
    });
    let turns = series.span_s() / period_s;
    let slip = period_sigma_s.map(|sigma| turns * sigma / period_s);
    Ok(Folded { bins: bins_of.collect(), phase, turn, turns, slip })
}

/// Weighted mean, its uncertainty from the scatter, and the scatter.
fn moments(series: &Series, members: &[usize]) -> (f64, f64, f64) {
    let weight: f64 = members.iter().map(|i| series.weight[*i]).sum();
    let squares: f64 = members.iter().map(|i| series.weight[*i].powi(2)).sum();
    let mean = members.iter().map(|i| series.weight[*i] * series.value[*i]).sum::<f64>() / weight;
    if members.len() < 2 {
        return (mean, f64::NAN, f64::NAN);
    }
    let about: f64 =
        members.iter().map(|i| series.weight[*i] * (series.value[*i] - mean).powi(2)).sum();
    // Unbiased for weights of any scale.
    let variance = about / (weight - squares / weight);
    (mean, (variance * squares).sqrt() / weight, variance.sqrt())
}
