//! Shares found against shares that are true.

use ndarray::{Array2, ArrayView2};

/// Why there is no confusion matrix.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ConfusionError {
    /// Two tables that do not match.
    #[error(
        "{truth_rows} x {truth_columns} true shares and {found_rows} x {found_columns} found ones: expected as many"
    )]
    Shape {
        /// Samples with a truth.
        truth_rows: usize,
        /// Materials with a truth.
        truth_columns: usize,
        /// Samples found.
        found_rows: usize,
        /// Materials found.
        found_columns: usize,
    },
    /// Shares that are none.
    #[error("sample {sample}, material {material}: {value}, expected a share of 0 or above", sample = row + 1, material = column + 1)]
    Share {
        /// Sample, counted from 0.
        row: usize,
        /// Material, counted from 0.
        column: usize,
        /// Value that was given.
        value: f64,
    },
}

/// Confusion matrix: shares that are taken for one another.
#[derive(Debug, Clone, PartialEq)]
pub struct Confusion {
    /// Part of the light that is material i's in truth that material j was said to have: rows sum to 1; NaN where there is no light of a material.
    pub matrix: Array2<f64>,
    /// The light of each material in truth, in samples.
    pub truth: Vec<f64>,
    /// Samples that went in.
    pub samples: usize,
    /// Samples left out: no number among the shares found or true.
    pub left_out: usize,
}

impl Confusion {
    /// Builds the matrix from shares, samples × materials. What agrees is on the diagonal, min(t_i, f_i); what is left of the true shares is spread over what is left of those found,
    /// (t_i − min)(f_j − min)/Σ(f − min): the composite operator of Pontius and Cheuk (2006).
    ///
    /// # Errors
    /// Tables that do not match; shares below 0.
    pub fn of(
        truth: ArrayView2<'_, f64>,
        found: ArrayView2<'_, f64>,
    ) -> Result<Self, ConfusionError> {
        let ((truth_rows, p), (found_rows, found_columns)) = (truth.dim(), found.dim());
        if (truth_rows, p) != (found_rows, found_columns) {
            let truth_columns = p;
            return Err(ConfusionError::Shape {
                truth_rows,
                truth_columns,
                found_rows,
                found_columns,
            });
        }
        let mut sums = Array2::<f64>::zeros((p, p));
        let mut left_out = 0;
        for (row, (t, f)) in truth.rows().into_iter().zip(found.rows()).enumerate() {
            if t.iter().chain(f).any(|v| !v.is_finite()) {
                left_out += 1;
                continue;
            }
            if let Some((i, v)) = t.iter().chain(f).enumerate().find(|(_, v)| **v < 0.0) {
                return Err(ConfusionError::Share { row, column: i % p, value: *v });
            }
            let same: Vec<f64> = t.iter().zip(f).map(|(t, f)| t.min(*f)).collect();
            let rest: f64 = f.iter().zip(&same).map(|(f, s)| f - s).sum();
            for i in 0..p {
                sums[(i, i)] += same[i];
                let missing = t[i] - same[i];
                if rest > 0.0 && missing > 0.0 {
                    for j in (0..p).filter(|j| *j != i) {
                        sums[(i, j)] += missing * (f[j] - same[j]) / rest;
                    }
                }
            }
        }
        let truth: Vec<f64> = sums.rows().into_iter().map(|r| r.sum()).collect();
        let matrix = Array2::from_shape_fn((p, p), |(i, j)| sums[(i, j)] / truth[i]);
        Ok(Self { matrix, truth, samples: truth_rows - left_out, left_out })
    }

    /// The smallest number on the diagonal of materials that have light.
    pub fn worst(&self) -> f64 {
        self.matrix.diag().iter().copied().filter(|v| v.is_finite()).fold(f64::INFINITY, f64::min)
    }
}
