//! Errors that a channel's samples of a night have in common, in the sum of squares: those of the calibration.
//!
//! Without priors they move the parameters as they move the data, and it is enough to add them to the covariance. A prior that is as tight as they are changes that: then the data say less, and the prior
//! more, than the samples' noise alone would have it. The covariance of the whitened rows is I + BBᵀ, a column of B for each channel of each night. Its inverse root is closed: I − UΦUᵀ, with U the
//! directions of B, D their squares and Φ = 1 − 1/√(1 + D).

use super::Data;
use super::whiten::PerSample;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use ndarray::Array2;
use std::collections::BTreeMap;

/// Directions whose square is below this share of the largest are those of rounding.
const NOTHING: f64 = 1e-12;

/// Common errors of all nights.
#[derive(Debug, Clone)]
pub(super) struct Common {
    /// Rows × errors, for errors that are independent and of variance 1.
    columns: DMatrix<f64>,
    /// Curves that have each night's errors, and from independent errors to ln κ of each channel.
    nights: Vec<(Vec<usize>, DMatrix<f64>)>,
    directions: DMatrix<f64>,
    less: DVector<f64>,
}

/// Curves of each night whose calibration has errors.
pub(super) fn nights(data: &[Data]) -> Vec<Vec<usize>> {
    let mut nights: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (p, data) in data.iter().enumerate() {
        if let Some(calibration) = &data.calibration {
            nights.entry(calibration.key.as_str()).or_default().push(p);
        }
    }
    nights.into_values().collect()
}

/// Rates of one channel of some curves, 0 elsewhere.
pub(super) fn of_channel(rates: &PerSample, curves: &[usize], channel: usize) -> PerSample {
    let mut change: PerSample = rates.iter().map(|r| Array2::zeros(r.raw_dim())).collect();
    for p in curves {
        change[*p].column_mut(channel).assign(&rates[*p].column(channel));
    }
    change
}

/// A root of a covariance: R with RRᵀ its matrix.
fn root(covariance: &Array2<f64>) -> DMatrix<f64> {
    let n = covariance.nrows();
    let eigen = SymmetricEigen::new(DMatrix::from_fn(n, n, |a, b| covariance[[a, b]]));
    let sizes = eigen.eigenvalues.map(|v| v.max(0.0).sqrt());
    eigen.eigenvectors * DMatrix::from_diagonal(&sizes)
}

impl Common {
    /// By the model's rates; `white` whitens numbers of all samples by their own noise. The errors' variances are divided by `scale`, for whoever multiplies all variances by it afterwards. `None` where no calibration has
    /// errors.
    pub fn new(
        data: &[Data],
        rates: &PerSample,
        scale: f64,
        white: impl Fn(&PerSample) -> DVector<f64>,
    ) -> Option<Self> {
        let (mut all, mut known) = (Vec::new(), Vec::new());
        for curves in nights(data) {
            let Some(of) = data[curves[0]].calibration.as_ref() else { continue };
            let root = root(&of.covariance) / scale.sqrt();
            let columns: Vec<DVector<f64>> = (0..root.nrows())
                .map(|channel| white(&of_channel(rates, &curves, channel)))
                .collect();
            all.push(DMatrix::from_columns(&columns) * &root);
            known.push((curves, root));
        }
        let rows = all.first()?.nrows();
        let count = all.iter().map(DMatrix::ncols).sum();
        let mut columns = DMatrix::zeros(rows, count);
        let mut at = 0;
        for part in &all {
            columns.columns_mut(at, part.ncols()).copy_from(part);
            at += part.ncols();
        }
        let eigen = SymmetricEigen::new(columns.tr_mul(&columns));
        let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
        let kept: Vec<usize> =
            (0..count).filter(|k| eigen.eigenvalues[*k] > NOTHING * largest).collect();
        let squares =
            DVector::from_iterator(kept.len(), kept.iter().map(|k| eigen.eigenvalues[*k]));
        let mut directions = &columns * eigen.eigenvectors.select_columns(&kept);
        for (mut direction, square) in directions.column_iter_mut().zip(squares.iter()) {
            direction /= square.sqrt();
        }
        let less = squares.map(|d| 1.0 - (1.0 + d).sqrt().recip());
        Some(Self { columns, nights: known, directions, less })
    }

    /// Makes whitened rows independent.
    pub fn apply(&self, x: &mut DVector<f64>) {
        let along = self.directions.tr_mul(x).component_mul(&self.less);
        *x -= &self.directions * along;
    }

    /// Rates with the most likely errors in them, by what the rows (each sample's noise alone whitened) leave of the data.
    pub fn found(&self, left: &DVector<f64>, rates: &PerSample) -> PerSample {
        let n = self.columns.ncols();
        let normal = DMatrix::identity(n, n) + self.columns.tr_mul(&self.columns);
        let Some(errors) = normal.cholesky().map(|c| c.solve(&self.columns.tr_mul(left))) else {
            return rates.clone();
        };
        let (mut rates, mut at) = (rates.clone(), 0);
        for (curves, root) in &self.nights {
            let ln = root * errors.rows(at, root.ncols());
            at += root.ncols();
            for p in curves {
                for (mut column, ln) in rates[*p].columns_mut().into_iter().zip(ln.iter()) {
                    column *= 1.0 + ln;
                }
            }
        }
        rates
    }
}
