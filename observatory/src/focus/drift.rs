//! Drift of the focus with temperature, from several runs.

use serde::Serialize;

/// Fewest runs.
const FEWEST: usize = 3;
/// Least span of temperatures, K.
const LEAST_SPAN_K: f64 = 1.0;

/// Best position at a temperature.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct At {
    /// Temperature, °C.
    pub temperature_c: f64,
    /// Best position, steps.
    pub position: f64,
    /// Standard uncertainty of it, steps.
    pub sigma: f64,
}

/// Drift of the focus.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Drift {
    /// Runs that were used.
    pub runs: usize,
    /// Steps that the best position moves for 1 K.
    pub steps_per_k: f64,
    /// Standard uncertainty of it.
    pub sigma_steps_per_k: f64,
    /// Best position at the mean temperature, steps.
    pub position: f64,
    /// Mean temperature, °C.
    pub temperature_c: f64,
    /// χ² of the straight line.
    pub chi2: f64,
}

/// Why there is no drift.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DriftError {
    /// Too few runs.
    #[error("{found} runs have a temperature, {FEWEST} at least are needed")]
    TooFew {
        /// Runs with a temperature.
        found: usize,
    },
    /// The temperatures are the same.
    #[error("the runs' temperatures span {span_k:.2} K, {LEAST_SPAN_K} K at least are needed")]
    NoSpan {
        /// Span, K.
        span_k: f64,
    },
}

impl Drift {
    /// Straight line through the runs, in any order. Its uncertainty is enlarged where they scatter more than they say.
    ///
    /// # Errors
    /// See [`DriftError`].
    pub fn of(runs: &[At]) -> Result<Self, DriftError> {
        let mut runs = runs.to_vec();
        runs.retain(|run| {
            run.sigma > 0.0 && run.temperature_c.is_finite() && run.position.is_finite()
        });
        runs.sort_by(|a, b| {
            a.temperature_c.total_cmp(&b.temperature_c).then(a.position.total_cmp(&b.position))
        });
        if runs.len() < FEWEST {
            return Err(DriftError::TooFew { found: runs.len() });
        }
        let span_k = runs[runs.len() - 1].temperature_c - runs[0].temperature_c;
        if span_k < LEAST_SPAN_K {
            return Err(DriftError::NoSpan { span_k });
        }
        let weight = |run: &At| run.sigma.powi(-2);
        let total: f64 = runs.iter().map(weight).sum();
        let mean = |of: fn(&At) -> f64| runs.iter().map(|r| weight(r) * of(r)).sum::<f64>() / total;
        let (temperature_c, position) = (mean(|r| r.temperature_c), mean(|r| r.position));
        let spread: f64 =
            runs.iter().map(|r| weight(r) * (r.temperature_c - temperature_c).powi(2)).sum();
        let both: f64 = runs
            .iter()
            .map(|r| weight(r) * (r.temperature_c - temperature_c) * (r.position - position))
            .sum();
        let slope = both / spread;
        let off = |r: &At| r.position - position - slope * (r.temperature_c - temperature_c);
        let chi2: f64 = runs.iter().map(|r| weight(r) * off(r).powi(2)).sum();
        let enlarge = (chi2 / (runs.len() - 2) as f64).max(1.0);
        let sigma_steps_per_k = (enlarge / spread).sqrt();
        Ok(Self {
            runs: runs.len(),
            steps_per_k: slope,
            sigma_steps_per_k,
            position,
            temperature_c,
            chi2,
        })
    }

    /// Best position at a temperature, steps.
    pub fn at(&self, temperature_c: f64) -> f64 {
        self.position + self.steps_per_k * (temperature_c - self.temperature_c)
    }
}
