//! Non-negative least squares by an active set, on a free or on a given sum.
//!
//! [`sunglint_numerics::bounded`] solves; here are the words of unmixing for it.

use ndarray::{ArrayView2, Axis};
pub use sunglint_numerics::bounded::Solution;
use sunglint_numerics::bounded::{BoundedError, BoundedSystem, Region};

/// Constraint that the weights meet besides a_j ≥ 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Constraint {
    /// Nothing.
    Free,
    /// Their sum, above 0: the columns are then in one unit.
    Sum(f64),
}

/// Why there are no weights.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NnlsError {
    /// Nothing to fit, or nothing to fit with.
    #[error("{rows} channels and {columns} endmembers: at least one of each is needed")]
    Empty {
        /// Channels.
        rows: usize,
        /// Endmembers.
        columns: usize,
    },
    /// A vector has another number of values than there are channels.
    #[error("{found} values for {rows} channels")]
    Length {
        /// Channels.
        rows: usize,
        /// Values.
        found: usize,
    },
    /// A number that is none.
    #[error("{value} in {what}: expected finite numbers")]
    NotFinite {
        /// Where.
        what: String,
        /// Value that was given.
        value: f64,
    },
    /// An endmember that reflects nothing.
    #[error("endmember {} is 0 in all channels in use: nothing could show how much there is of it", column + 1)]
    Zero {
        /// Which, counted from 0.
        column: usize,
    },
    /// A sum that is none.
    #[error("the sum of the weights is to be {total}, expected a number above 0")]
    Sum {
        /// Total that was asked for.
        total: f64,
    },
    /// The active set did not come to rest.
    #[error("no support was found in {iterations} steps; the correlations stand at {kkt:.1e}")]
    NotConverged {
        /// Steps.
        iterations: usize,
        /// The largest violation.
        kkt: f64,
    },
}

/// The columns, scaled and, where there are more rows than columns, turned into their own space: made once for many x.
#[derive(Debug, Clone)]
pub struct Nnls {
    system: BoundedSystem,
    rows: usize,
    constraint: Constraint,
}

impl Nnls {
    /// Columns of an n × p matrix: a row for each channel, a column for each endmember.
    ///
    /// # Errors
    /// No row or column, numbers that are none, a column of zeros, a sum that is not above 0.
    pub fn new(matrix: ArrayView2<'_, f64>, constraint: Constraint) -> Result<Self, NnlsError> {
        let (rows, count) = matrix.dim();
        if rows == 0 || count == 0 {
            return Err(NnlsError::Empty { rows, columns: count });
        }
        if let Constraint::Sum(total) = constraint
            && !(total.is_finite() && total > 0.0)
        {
            return Err(NnlsError::Sum { total });
        }
        let original: Vec<Vec<f64>> = matrix.axis_iter(Axis(1)).map(|c| c.to_vec()).collect();
        for (column, values) in original.iter().enumerate() {
            if let Some((row, value)) = values.iter().enumerate().find(|(_, v)| !v.is_finite()) {
                let what = format!("endmember {}, channel {}", column + 1, row + 1);
                return Err(NnlsError::NotFinite { what, value: *value });
            }
            if values.iter().all(|v| *v == 0.0) {
                return Err(NnlsError::Zero { column });
            }
        }
        let one_unit = matches!(constraint, Constraint::Sum(_));
        let system = BoundedSystem::new(original, one_unit).map_err(told)?;
        Ok(Self { system, rows, constraint })
    }

    /// The weights a that make ‖x − S a‖ least.
    ///
    /// # Errors
    /// Another number of values than rows, or values that are no numbers; [`NnlsError::NotConverged`].
    ///
    /// ```
    /// use ndarray::array;
    /// use sunglint_analysis::unmix::nnls::{Constraint, Nnls};
    ///
    /// let columns = array![[1.0, 0.0], [0.0, 1.0]];
    /// let solution = Nnls::new(columns.view(), Constraint::Free)?.solve(&[3.0, -1.0])?;
    /// // Without the bound the second weight would be -1.
    /// assert_eq!(solution.weights, [3.0, 0.0]);
    /// assert_eq!(solution.in_use, [true, false]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn solve(&self, x: &[f64]) -> Result<Solution, NnlsError> {
        if x.len() != self.rows {
            return Err(NnlsError::Length { rows: self.rows, found: x.len() });
        }
        if let Some((row, value)) = x.iter().enumerate().find(|(_, v)| !v.is_finite()) {
            let what = format!("the data, channel {}", row + 1);
            return Err(NnlsError::NotFinite { what, value: *value });
        }
        let region = match self.constraint {
            Constraint::Free => Region::NotNegative,
            Constraint::Sum(total) => Region::Sum(total),
        };
        self.system.solve(x, &region).map_err(told)
    }
}

/// The error in the words of unmixing. Lengths, numbers and sums were seen to before.
fn told(error: BoundedError) -> NnlsError {
    match error {
        BoundedError::NotConverged { iterations, kkt } => {
            NnlsError::NotConverged { iterations, kkt }
        }
        BoundedError::NotFinite { value, .. } => {
            let what = "the weights: an endmember is too small against the data".to_owned();
            NnlsError::NotFinite { what, value }
        }
        other => NnlsError::NotFinite { what: other.to_string(), value: f64::NAN },
    }
}
