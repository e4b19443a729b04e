//! Normal matrices: their pseudo-inverse, and least squares with bounds by them.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use sunglint_numerics::bounded::{BoundedError, BoundedSystem, Region};

/// Directions of the scaled normal matrix (unit diagonal) with an eigenvalue below this share of the largest are not determined.
pub(super) const SINGULAR: f64 = 1e-11;

/// The pseudo-inverse of a symmetric matrix, and its eigenvectors that are not determined.
pub(super) fn inverse(matrix: &DMatrix<f64>) -> (DMatrix<f64>, Vec<DVector<f64>>) {
    let n = matrix.nrows();
    if n == 0 {
        return (DMatrix::zeros(0, 0), Vec::new());
    }
    let eigen = SymmetricEigen::new(matrix.clone());
    let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    let (mut inverse, mut open) = (DMatrix::zeros(n, n), Vec::new());
    for (k, value) in eigen.eigenvalues.iter().enumerate() {
        let vector = eigen.eigenvectors.column(k).into_owned();
        if *value > SINGULAR * largest {
            inverse += &vector * vector.transpose() / *value;
        } else {
            open.push(vector);
        }
    }
    (inverse, open)
}

/// A quadratic form xᵀG x − 2 gᵀx that is made least within bounds, for one G and many g.
pub(super) struct Quadratic {
    system: BoundedSystem,
    /// Turns g into the right side of the system.
    turn: DMatrix<f64>,
}

impl Quadratic {
    /// Form of a symmetric matrix without negative eigenvalues.
    pub fn new(matrix: &DMatrix<f64>) -> Result<Self, BoundedError> {
        let n = matrix.nrows();
        let root = DVector::from_fn(n, |i, _| matrix[(i, i)].max(0.0).sqrt());
        let over = |v: f64, root: f64| if root > 0.0 { v / root } else { 0.0 };
        let scaled = DMatrix::from_fn(n, n, |i, j| over(over(matrix[(i, j)], root[i]), root[j]));
        let eigen = SymmetricEigen::new(scaled);
        let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
        let kept: Vec<usize> =
            (0..n).filter(|k| eigen.eigenvalues[*k] > SINGULAR * largest).collect();
        let value = |k: usize| eigen.eigenvalues[kept[k]].sqrt();
        let vector = |k: usize, j: usize| eigen.eigenvectors[(j, kept[k])];
        let column =
            |j: usize| (0..kept.len()).map(|k| value(k) * vector(k, j) * root[j]).collect();
        let turn = DMatrix::from_fn(kept.len(), n, |k, j| over(vector(k, j), root[j]) / value(k));
        Ok(Self { system: BoundedSystem::new((0..n).map(column).collect(), false)?, turn })
    }

    /// The place within the bounds, from 0 where nothing pulls.
    pub fn least(
        &self,
        g: &DVector<f64>,
        low: &[f64],
        high: &[f64],
    ) -> Result<DVector<f64>, BoundedError> {
        let right = &self.turn * g;
        let rest = vec![0.0; low.len()];
        let found =
            self.system.solve(right.as_slice(), &Region::Between { low, high, rest: &rest })?;
        Ok(DVector::from_vec(found.weights))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: by hand: of two equal columns only the sum is determined; a diagonal form has the clamped quotients. Tolerance: rounding.
    #[test]
    fn forms_are_least_within_their_bounds() {
        let equal = DMatrix::from_row_slice(2, 2, &[1.0, 1.0, 1.0, 1.0]);
        assert_eq!(inverse(&equal).1.len(), 1);
        let form = Quadratic::new(&equal).unwrap();
        let g = DVector::from_row_slice(&[3.0, 3.0]);
        let x = form.least(&g, &[-1.0; 2], &[2.0; 2]).unwrap();
        assert!((x[0] + x[1] - 3.0).abs() < 1e-12 && x.iter().all(|x| *x <= 2.0), "{x}");
        let form = Quadratic::new(&DMatrix::from_diagonal(&DVector::from_row_slice(&[2.0, 4.0])));
        let g = DVector::from_row_slice(&[-1.0, 1.0]);
        let x = form.unwrap().least(&g, &[0.0; 2], &[9.0; 2]).unwrap();
        assert!(x[0] == 0.0 && (x[1] - 0.25).abs() < 1e-15, "{x}");
    }
}
