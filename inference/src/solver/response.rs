//! How parameters answer to a change of all data: what an error does that the samples have in common.

use super::common::Common;
use super::whiten::{PerSample, Whitener};
use super::{Estimate, Fit, IntervalMethod};
use nalgebra::{DMatrix, DVector};

/// Two-sided 95 % of a normal distribution.
const Z95: f64 = 1.959_963_984_540_054;

/// Response of the parameters at the minimum to a change of the data, to first order.
#[derive(Debug, Clone)]
pub(super) struct Response {
    pub whitener: Whitener,
    pub common: Option<Common>,
    /// Parameters × whitened rows, in the parameters' units; NaN for what stands at a bound or is not determined.
    pub pull: DMatrix<f64>,
    /// Bounds of each parameter.
    pub bounds: Vec<(f64, f64)>,
}

impl Response {
    /// How far each parameter moves if the model's rates change by `change`: NaN where it is not known.
    fn shift(&self, change: &PerSample) -> Vec<f64> {
        let mut rows = DVector::zeros(self.pull.ncols());
        let mut white = Vec::new();
        for epoch in &self.whitener.epochs {
            white.clear();
            let of = |c: &usize| {
                let value = change[epoch.pass][[epoch.epoch, *c]];
                // Where the error is not known it is none: light that is not there.
                if value.is_finite() { value } else { 0.0 }
            };
            white.extend(epoch.channels.iter().map(of));
            epoch.apply(&mut white);
            white.iter().enumerate().for_each(|(k, value)| rows[epoch.row + k] = *value);
        }
        if let Some(common) = &self.common {
            common.apply(&mut rows);
        }
        (&self.pull * rows).iter().copied().collect()
    }
}

impl Fit {
    /// Carries errors of the model's light into the parameters: `changes` holds, by material, one standard deviation of the rates of each curve (epochs × channels), all samples off alike. Different materials
    /// are independent. Standard uncertainties, intervals and the covariance grow by it. What a free parameter takes up of an error, such as the albedo of the material itself, moves that parameter and no other.
    pub fn add_materials(&mut self, changes: &[(String, PerSample)]) {
        let Some(response) = &self.response else { return };
        let shifts: Vec<Vec<f64>> =
            changes.iter().map(|(_, change)| response.shift(change)).collect();
        let n = self.parameters.len();
        for i in 0..n {
            for j in 0..n {
                let sum: f64 = shifts.iter().map(|s| s[i] * s[j]).sum();
                self.covariance[i][j] += sum;
            }
            let sigma = shifts.iter().map(|s| s[i] * s[i]).sum::<f64>().sqrt();
            widen(&mut self.parameters[i], sigma, response.bounds[i]);
        }
    }
}

fn widen(estimate: &mut Estimate, sigma: f64, (least, most): (f64, f64)) {
    if !sigma.is_finite() {
        return;
    }
    estimate.sigma_material = Some(sigma);
    estimate.sigma = estimate.sigma.map(|own| own.hypot(sigma));
    if estimate.interval_method == IntervalMethod::None {
        return;
    }
    let value = estimate.value;
    let [low, high] = estimate.interval_95;
    estimate.interval_95 = [
        low.map(|low| (value - (value - low).hypot(Z95 * sigma)).max(least)),
        high.map(|high| (value + (high - value).hypot(Z95 * sigma)).min(most)),
    ];
}
