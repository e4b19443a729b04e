//! Errors that a channel's samples have in common, in the sum of squares: those of a night's calibration, and of the levels that were taken off a curve.
//!
//! Without priors they move the parameters as they move the data, and it is enough to add them to the covariance. A prior that is as tight as they are changes that: then the data say less, and the prior
//! more, than the samples' noise alone would have it. The covariance of the whitened rows is I + BBᵀ, a column of B for each of these errors. Its inverse root is closed: I − UΦUᵀ, with U the
//! directions of B, D their squares and Φ = 1 − 1/√(1 + D).

use super::Data;
use super::whiten::PerSample;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use ndarray::{Array1, Array2};
use std::collections::BTreeMap;

/// Directions whose square is below this share of the largest are those of rounding.
const NOTHING: f64 = 1e-12;

/// Common errors of all nights.
#[derive(Debug, Clone)]
pub(super) struct Common {
    /// Rows × errors, for errors that are independent and of variance 1.
    columns: DMatrix<f64>,
    errors: Vec<SharedError>,
    scale: f64,
    directions: DMatrix<f64>,
    less: DVector<f64>,
}

/// Changes of samples by an error of variance 1 that is independent of all others.
#[derive(Debug, Clone)]
pub(super) struct SharedError {
    /// By curve and channel, in the unit of the rates.
    parts: Vec<(usize, usize, Array1<f64>)>,
    /// Whether it is one of the calibration, not of a level.
    pub of_calibration: bool,
}

impl SharedError {
    /// The change of all samples, 0 where it has none. `like` has their number.
    pub fn of_all(&self, like: &PerSample) -> PerSample {
        let mut change: PerSample = like.iter().map(|r| Array2::zeros(r.raw_dim())).collect();
        self.add_to(&mut change, 1.0);
        change
    }

    fn add_to(&self, rates: &mut PerSample, times: f64) {
        for (curve, channel, change) in &self.parts {
            rates[*curve].column_mut(*channel).scaled_add(times, change);
        }
    }
}

/// All errors that samples have in common, by the model's rates: those of each night's κ, and those of the levels that were taken off a curve's channel.
pub(super) fn shared(data: &[Data], rates: &PerSample) -> Vec<SharedError> {
    let mut errors = Vec::new();
    for curves in nights(data) {
        let Some(of) = data[curves[0]].calibration.as_ref() else { continue };
        let root = root(&of.covariance);
        for error in root.column_iter() {
            let channels = || error.iter().enumerate().filter(|(_, ln)| **ln != 0.0);
            let parts = curves
                .iter()
                .flat_map(|p| channels().map(|(c, ln)| (*p, c, &rates[*p].column(c) * *ln)));
            errors.push(SharedError { parts: parts.collect(), of_calibration: true });
        }
    }
    for (p, level) in data.iter().enumerate().filter_map(|(p, d)| Some((p, d.level.as_ref()?))) {
        for (c, column) in level.columns().into_iter().enumerate() {
            if column.iter().any(|hz| *hz > 0.0) {
                let parts = vec![(p, c, column.to_owned())];
                errors.push(SharedError { parts, of_calibration: false });
            }
        }
    }
    errors
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

/// A root of a covariance: R with RRᵀ its matrix.
fn root(covariance: &Array2<f64>) -> DMatrix<f64> {
    let n = covariance.nrows();
    let eigen = SymmetricEigen::new(DMatrix::from_fn(n, n, |a, b| covariance[[a, b]]));
    let sizes = eigen.eigenvalues.map(|v| v.max(0.0).sqrt());
    eigen.eigenvectors * DMatrix::from_diagonal(&sizes)
}

impl Common {
    /// By the model's rates; `white` whitens numbers of all samples by their own noise. The errors' variances are divided by `scale`, for whoever multiplies all variances by it afterwards. `None` where samples share
    /// no error.
    pub fn new(
        data: &[Data],
        rates: &PerSample,
        scale: f64,
        white: impl Fn(&PerSample) -> DVector<f64>,
    ) -> Option<Self> {
        let errors = shared(data, rates);
        let columns: Vec<DVector<f64>> =
            errors.iter().map(|error| white(&error.of_all(rates)) / scale.sqrt()).collect();
        if columns.is_empty() {
            return None;
        }
        let (columns, count) = (DMatrix::from_columns(&columns), columns.len());
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
        Some(Self { columns, errors, scale, directions, less })
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
        let mut rates = rates.clone();
        for (shared, error) in self.errors.iter().zip(errors.iter()) {
            shared.add_to(&mut rates, error / self.scale.sqrt());
        }
        rates
    }
}
