//! Numbers made independent and of variance 1. The covariance of an epoch is D + v vᵀ: D each channel's own variance, v = s·rate what all share by
//! scintillation of relative standard deviation s. Its inverse root is closed: (1 − α u uᵀ) D^(−1/2), u = D^(−1/2) v, α = (1 − 1/√(1+|u|²))/|u|².

use super::Data;
use ndarray::Array2;

/// One epoch with samples that count.
#[derive(Debug, Clone)]
pub(super) struct Epoch {
    pub pass: usize,
    pub epoch: usize,
    /// The channels that count here.
    pub channels: Vec<usize>,
    /// √weight/σ of each.
    inverse: Vec<f64>,
    u: Vec<f64>,
    alpha: f64,
    /// The first of its rows.
    pub row: usize,
}

/// All epochs of all curves.
#[derive(Debug, Clone)]
pub(super) struct Whitener {
    pub epochs: Vec<Epoch>,
    pub rows: usize,
}

/// One number for each sample of each curve.
pub(super) type PerSample = Vec<Array2<f64>>;

impl Whitener {
    /// By the model's rates where there are any, else by the measured ones; `weights` (1 where there are none) multiply squared residuals;
    /// what has none does not count.
    pub fn new(data: &[Data], models: Option<&PerSample>, weights: Option<&PerSample>) -> Self {
        let (mut epochs, mut row) = (Vec::new(), 0);
        for (p, curve) in data.iter().enumerate() {
            for i in 0..curve.epochs() {
                let weight = |c: usize| weights.map_or(1.0, |w| w[p][[i, c]]);
                let channels: Vec<usize> = (0..curve.channels())
                    .filter(|c| curve.used[[i, *c]] && weight(*c) > 0.0)
                    .collect();
                if channels.is_empty() {
                    continue;
                }
                let (mut inverse, mut u) = (Vec::new(), Vec::new());
                let s = curve.common_variance[i].sqrt();
                for c in &channels {
                    let model = models.map(|m| m[p][[i, *c]]);
                    let sigma = curve.variance(i, *c, model).sqrt();
                    inverse.push(weight(*c).sqrt() / sigma);
                    u.push(s * model.unwrap_or(curve.rate[[i, *c]]) / sigma);
                }
                let square: f64 = u.iter().map(|u| u * u).sum();
                // (1 − 1/√(1+q))/q without cancellation.
                let root = (1.0 + square).sqrt();
                let alpha = 1.0 / (root * (1.0 + root));
                let count = channels.len();
                epochs.push(Epoch { pass: p, epoch: i, channels, inverse, u, alpha, row });
                row += count;
            }
        }
        Self { epochs, rows: row }
    }
}

impl Epoch {
    /// Whitens one number for each channel that counts.
    pub fn apply(&self, x: &mut [f64]) {
        let mut along = 0.0;
        for ((x, inverse), u) in x.iter_mut().zip(&self.inverse).zip(&self.u) {
            *x *= inverse;
            along += *x * u;
        }
        let along = self.alpha * along;
        x.iter_mut().zip(&self.u).for_each(|(x, u)| *x -= along * u);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use ndarray::array;

    /// Truth: W Wᵀ-form of the inverse by nalgebra's LU: |Wx|² = xᵀ(D + vvᵀ)⁻¹x. Tolerance: rounding.
    #[test]
    fn whitened_squares_are_those_of_the_inverse_covariance() {
        let rate = array![[100.0, 250.0, 30.0]];
        let sigma = array![[3.0, 4.0, 1.5]];
        let mut data = Data::new("a", rate.clone(), sigma.clone());
        data.common_variance = vec![0.03_f64.powi(2)];
        let whitener = Whitener::new(&[data], None, None);
        let v = DVector::from_iterator(3, rate.iter().map(|r| 0.03 * r));
        let d = DVector::from_iterator(3, sigma.iter().map(|s| s * s));
        let inverse = (DMatrix::from_diagonal(&d) + &v * v.transpose()).try_inverse().unwrap();
        for x in [[1.0, 0.0, 0.0], [2.0, -3.0, 5.0], [100.0, 250.0, 30.0]] {
            let truth = (DVector::from_row_slice(&x).transpose()
                * &inverse
                * DVector::from_row_slice(&x))[0];
            let mut white = x;
            whitener.epochs[0].apply(&mut white);
            let found: f64 = white.iter().map(|w| w * w).sum();
            assert!((found / truth - 1.0).abs() < 1e-12, "{found} {truth}");
        }
    }
}
