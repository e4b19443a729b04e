//! How parameters answer to a change of all data: what an error does that the samples have in common.

use super::common::{Common, shared};
use super::correlation::Residuals;
use super::whiten::{PerSample, Whitener};
use super::{Data, Estimate, Fit, IntervalMethod, Warning};
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
    /// Rows of `pull` of parameters that stand at a bound, as if they alone could leave it.
    pub held: Vec<(usize, DVector<f64>)>,
    /// The whitened residuals that the loss leaves, over the mean slope of its influence: the parameters' errors are `pull` times its errors.
    pub left: DVector<f64>,
}

impl Response {
    /// How far each parameter moves if the model's rates change by `change`: NaN where it is not known.
    fn shift(&self, change: &PerSample) -> Vec<f64> {
        let mut rows = self.white(change, self.pull.ncols());
        if let Some(common) = &self.common {
            common.apply(&mut rows);
        }
        (&self.pull * rows).iter().copied().collect()
    }

    /// Numbers of all samples, whitened by their own noise.
    fn white(&self, change: &PerSample, rows: usize) -> DVector<f64> {
        let mut rows = DVector::zeros(rows);
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
        rows
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

impl Fit {
    /// Widens covariance and intervals where residuals hang together in time, along each curve and in its channels ([`Fit::correlation`]): where they do, intervals by independent residuals are too narrow, however much they
    /// are widened by χ². Where they do not, nothing changes. `data` are those that were fitted. To be called once, before [`Fit::add_materials`].
    pub fn widen_for_correlation(&mut self, data: &[Data]) {
        let Some(response) = self.response.take() else { return };
        self.widen_with(&response, data);
        self.response = Some(response);
    }

    fn widen_with(&mut self, response: &Response, data: &[Data]) {
        let rates: PerSample = self.curves.iter().map(|c| c.model.clone()).collect();
        let time_s: Vec<Vec<f64>> = data.iter().map(|d| d.time_s.clone()).collect();
        let rows = response.whitener.rows;
        // Errors that samples have in common last as long as a curve: they are not what is looked for.
        let nuisance: Vec<DVector<f64>> = shared(data, &rates)
            .iter()
            .map(|error| response.white(&error.of_all(&rates), rows))
            .filter(|row| row.norm_squared() > 0.0)
            .collect();
        let (left, pull) = (&response.left, &response.pull);
        let residuals = Residuals::new(&response.whitener, &time_s, &rates, left, pull, &nuisance);
        let Some(residuals) = residuals else { return };
        // Parameters by number, and how they answer to errors of the samples.
        let determined = pull.row_iter().enumerate().filter(|(_, row)| row[0].is_finite());
        let mut answers: Vec<(usize, DVector<f64>)> =
            determined.map(|(i, row)| (i, row.transpose())).collect();
        let free = answers.len();
        answers.extend(response.held.iter().cloned());
        if let Some(common) = &response.common {
            answers.iter_mut().for_each(|(_, row)| common.apply(row));
        }
        let a = DMatrix::from_fn(answers.len(), rows, |k, row| answers[k].1[row]);
        let Some((found, spread)) = residuals.spread(&a) else { return };
        let (scale, mean) = (self.scaled_by, spread.mean());
        // No uncertainty becomes smaller.
        let least = |k: usize| (scale * spread.plain[(k, k)] / mean[(k, k)]).sqrt().max(1.0);
        for (k, (i, _)) in answers.iter().enumerate() {
            let before = scale * spread.plain[(k, k)];
            let parameter = &mut self.parameters[*i];
            // What is known beside the samples: calibration and priors.
            let beside = match parameter.sigma {
                Some(sigma) if k < free => (sigma * sigma - before).max(0.0),
                _ => 0.0,
            };
            if before.is_nan() || before <= 0.0 {
                continue;
            }
            let wider = spread.wider(k, scale, beside);
            let more = least(k).powi(2) * mean[(k, k)] - before;
            parameter.sigma = parameter.sigma.map(|own| (own * own + more.max(0.0)).sqrt());
            if parameter.interval_method != IntervalMethod::None {
                let (value, (low, high)) = (parameter.value, response.bounds[*i]);
                let [a, b] = parameter.interval_95;
                parameter.interval_95 = [
                    a.map(|a| (value - wider * (value - a)).max(low)),
                    b.map(|b| (value + wider * (b - value)).min(high)),
                ];
            }
        }
        for (k, (i, _)) in answers.iter().enumerate().take(free) {
            for (l, (j, _)) in answers.iter().enumerate().take(free) {
                let more = least(k) * least(l) * mean[(k, l)] - scale * spread.plain[(k, l)];
                self.covariance[*i][*j] += more;
            }
        }
        self.correlation = Some(found);
        self.warnings.push(Warning::Wandering { found });
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
