//! Numbers made independent and of variance 1. The covariance of an epoch is D + v vᵀ: D each channel's own variance, v = s·rate what all share by
//! scintillation of relative standard deviation s. Its inverse root is closed: (1 − α u uᵀ) D^(−1/2), u = D^(−1/2) v, α = (1 − 1/√(1+|u|²))/|u|².
//!
//! A sample that a loss gives less weight w has more variance of its own, so much that all of its variance, scintillation in it, is 1/w of what it was:
//! D becomes D + (1/w − 1)(D + v²), and v stays. So an outlier is no longer bound to the other channels of its epoch, which keep theirs; and an epoch whose channels are off
//! together counts less as a whole.

use super::Data;
use ndarray::Array2;

/// One epoch with samples that count.
#[derive(Debug, Clone)]
pub(super) struct Epoch {
    pub pass: usize,
    pub epoch: usize,
    /// The channels that count here.
    pub channels: Vec<usize>,
    /// 1/σ of each, the weight in σ.
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
    /// By the model's rates where there are any, else by the measured ones; `weights` (1 where there are none) divide the variances of single samples;
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
                    let mut common = s * model.unwrap_or_else(|| curve.beginning(i, *c));
                    let mut own = curve.variance(i, *c, model);
                    // A channel alone shares its noise with none.
                    if channels.len() == 1 {
                        own += common * common;
                        common = 0.0;
                    }
                    let sigma = (own + (weight(*c).recip() - 1.0) * (own + common * common)).sqrt();
                    inverse.push(sigma.recip());
                    u.push(common / sigma);
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

    /// Truth: the same by nalgebra's LU where the second sample has a weight of 1/50: the matrix has 50 times its variance (its own and the common one) at its place of the diagonal, and is else as it was. And by hand:
    /// a sample alone has w/(σ² + v²) before its square, whatever its weight, also where nearly all of its noise is common. Tolerance: rounding.
    #[test]
    fn a_sample_of_less_weight_has_more_noise_of_its_own() {
        let rate = array![[100.0, 1000.0, 30.0]];
        let sigma = array![[3.0, 4.0, 1.5]];
        let mut data = Data::new("a", rate.clone(), sigma.clone());
        data.common_variance = vec![0.03_f64.powi(2)];
        let weights = vec![array![[1.0, 0.02, 1.0]]];
        let whitener = Whitener::new(&[data.clone()], None, Some(&weights));
        let v = DVector::from_iterator(3, rate.iter().map(|r| 0.03 * r));
        let d = DVector::from_iterator(3, sigma.iter().map(|s| s * s));
        let mut covariance = DMatrix::from_diagonal(&d) + &v * v.transpose();
        covariance[(1, 1)] *= 50.0;
        let inverse = covariance.try_inverse().unwrap();
        for x in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2.0, -3.0, 5.0], [1.0, 900.0, 2.0]] {
            let x = DVector::from_row_slice(&x);
            let truth = (x.transpose() * &inverse * &x)[0];
            let mut white = x;
            whitener.epochs[0].apply(white.as_mut_slice());
            assert!((white.norm_squared() / truth - 1.0).abs() < 1e-12, "{white} {truth}");
        }
        data.used = array![[false, true, false]];
        let alone = Whitener::new(&[data], None, Some(&weights));
        let mut white = [7.0];
        alone.epochs[0].apply(&mut white);
        let truth = 49.0 * 0.02 / (16.0 + 900.0);
        assert!((white[0] * white[0] / truth - 1.0).abs() < 1e-12, "{white:?} {truth}");
    }
}
