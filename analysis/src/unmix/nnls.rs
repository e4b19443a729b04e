//! Non-negative least squares by an active set, on a free or on a given sum.
//!
//! Lawson and Hanson (1974, ch. 23), with these differences: columns are scaled to lengths near 1 by powers of two, so that neither the support nor a
//! digit of the answer depends on their units; each face is solved by an orthogonal basis made anew (no update can drift) and refined once; a column that
//! is, to rounding, a combination of those in use is left out; a given sum is kept exactly, by going along differences of columns, not by a heavy row.

use super::basis::{Basis, dot, norm};
use ndarray::{ArrayView2, Axis};

/// A column enters where its correlation with what is left exceeds this; rounding alone makes some 1e-15.
const ENTER: f64 = 2e-14;
/// A column of which less than this stands upright on the others is their combination: leaving it out changes no correlation by more.
const PARALLEL: f64 = 1e-13;
/// Correlation below which a column that is not in use could be in use as well: then the answer is one of many unless the columns are independent.
const EVEN: f64 = 1e-10;

/// A weight that contributes less than this of the data is rounding about 0.
const NEGLIGIBLE: f64 = 1e-13;

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

/// Weights, and how well they answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// The weights; those out of use are exactly 0.
    pub weights: Vec<f64>,
    /// True for those in use.
    pub in_use: Vec<bool>,
    /// x − S a.
    pub residual: Vec<f64>,
    /// The largest violation of the Karush–Kuhn–Tucker conditions: |s_jᵀ(x − S a)| over ‖s_j‖ max(‖x‖, ‖s_k‖a_k) of what is in use, the positive part of it for what
    /// is not; with a given sum the same of differences of columns.
    pub kkt: f64,
    /// True where no other weights fit as well.
    pub unique: bool,
    /// Steps of the active set.
    pub steps: usize,
}

/// The columns, scaled and, where there are more rows than columns, turned into their own space: made once for many x.
#[derive(Debug, Clone)]
pub struct Nnls {
    original: Vec<Vec<f64>>,
    /// Scaled by `2^-exponent`, in the space of `turn` where there is one.
    columns: Vec<Vec<f64>>,
    exponent: Vec<i32>,
    turn: Option<Basis>,
    constraint: Constraint,
}

/// The power of two next to a length.
fn exponent(length: f64) -> i32 {
    length.log2().round() as i32
}

/// v · 2^e, in two steps where 2^e itself is no number.
fn ldexp(v: f64, e: i32) -> f64 {
    let half = e / 2;
    v * 2.0_f64.powi(half) * 2.0_f64.powi(e - half)
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
        let mut exponents: Vec<i32> = original.iter().map(|c| exponent(norm(c))).collect();
        if let (Constraint::Sum(_), Some(most)) = (constraint, exponents.iter().max().copied()) {
            exponents.fill(most);
        }
        let scaled = original.iter().zip(&exponents);
        let mut columns: Vec<Vec<f64>> =
            scaled.map(|(c, e)| c.iter().map(|v| ldexp(*v, -e)).collect()).collect();
        let turn = (rows > count).then(|| {
            let mut basis = Basis::default();
            for column in &columns {
                basis.push(column, f64::EPSILON);
            }
            basis
        });
        if let Some(turn) = &turn {
            columns = columns.iter().map(|c| turn.coordinates(c)).collect();
        }
        Ok(Self { original, columns, exponent: exponents, turn, constraint })
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
        let rows = self.original[0].len();
        if x.len() != rows {
            return Err(NnlsError::Length { rows, found: x.len() });
        }
        if let Some((row, value)) = x.iter().enumerate().find(|(_, v)| !v.is_finite()) {
            let what = format!("the data, channel {}", row + 1);
            return Err(NnlsError::NotFinite { what, value: *value });
        }
        let length = norm(x);
        let scale = match self.constraint {
            Constraint::Free => exponent(if length > 0.0 { length } else { 1.0 }),
            // In the unit of the columns: weights are then shares of the sum.
            Constraint::Sum(total) => exponent(total) + self.exponent[0],
        };
        let scaled: Vec<f64> = x.iter().map(|v| ldexp(*v, -scale)).collect();
        let work = match &self.turn {
            Some(turn) => turn.coordinates(&scaled),
            None => scaled.clone(),
        };
        let total = match self.constraint {
            Constraint::Free => None,
            Constraint::Sum(total) => Some(ldexp(total, -exponent(total))),
        };
        let face = Face { columns: &self.columns, x: &work, length: norm(&scaled), total };
        let found = face.solve()?;
        let shift = |e: &i32| scale - e;
        let weights: Vec<f64> =
            found.weights.iter().zip(&self.exponent).map(|(b, e)| ldexp(*b, shift(e))).collect();
        if let Some(bad) = weights.iter().find(|w| !w.is_finite()) {
            let what = "the weights: an endmember is too small against the data".to_owned();
            return Err(NnlsError::NotFinite { what, value: *bad });
        }
        let mut residual = x.to_vec();
        for (column, weight) in self.original.iter().zip(&weights).filter(|(_, w)| **w != 0.0) {
            residual.iter_mut().zip(column).for_each(|(r, s)| *r -= weight * s);
        }
        Ok(Solution { weights, residual, ..found })
    }
}

/// One problem, scaled.
struct Face<'a> {
    columns: &'a [Vec<f64>],
    x: &'a [f64],
    /// ‖x‖, what lies outside the space of the columns included.
    length: f64,
    total: Option<f64>,
}

impl Face<'_> {
    /// The least squares answer on some columns, in their order, without a bound; `None` where they depend on one another. With a sum, `used[0]` is what the
    /// differences start from.
    fn least(&self, used: &[usize]) -> Option<Vec<f64>> {
        let mut basis = Basis::default();
        match self.total {
            None => {
                for j in used {
                    if basis.push(&self.columns[*j], PARALLEL) <= PARALLEL {
                        return None;
                    }
                }
                let mut z = basis.solve(basis.coordinates(self.x));
                let left = self.left(used, &z);
                let step = basis.solve(basis.coordinates(&left));
                z.iter_mut().zip(step).for_each(|(z, s)| *z += s);
                Some(z)
            }
            Some(total) => {
                let (first, others) = used.split_first()?;
                for j in others {
                    let difference = self.difference(*j, *first);
                    let whole = norm(&self.columns[*j]) + norm(&self.columns[*first]);
                    if norm(&difference) <= PARALLEL * whole
                        || basis.push(&difference, PARALLEL) <= PARALLEL
                    {
                        return None;
                    }
                }
                let rest = |z: &[f64]| total - z.iter().sum::<f64>();
                let mut z = vec![0.0; others.len()];
                for _ in 0..2 {
                    let all: Vec<f64> = std::iter::once(rest(&z)).chain(z.clone()).collect();
                    let step = basis.solve(basis.coordinates(&self.left(used, &all)));
                    z.iter_mut().zip(step).for_each(|(z, s)| *z += s);
                }
                Some(std::iter::once(rest(&z)).chain(z.clone()).collect())
            }
        }
    }

    fn difference(&self, j: usize, from: usize) -> Vec<f64> {
        self.columns[j].iter().zip(&self.columns[from]).map(|(a, b)| a - b).collect()
    }

    /// x less some columns.
    fn left(&self, used: &[usize], z: &[f64]) -> Vec<f64> {
        let mut left = self.x.to_vec();
        for (j, z) in used.iter().zip(z) {
            left.iter_mut().zip(&self.columns[*j]).for_each(|(l, s)| *l -= z * s);
        }
        left
    }

    /// Returns the scale by which the correlations are measured.
    fn scale(&self, used: &[usize], z: &[f64]) -> f64 {
        let parts = used.iter().zip(z).map(|(j, z)| norm(&self.columns[*j]) * z.abs());
        parts.fold(self.length, f64::max)
    }

    /// The correlation of each column, or of its difference to the first one in use, with what is left.
    fn correlations(&self, used: &[usize], z: &[f64]) -> Vec<f64> {
        let left = self.left(used, z);
        let scale = self.scale(used, z);
        let one = |j: usize| {
            let (part, length) = match (self.total, used.first()) {
                (Some(_), Some(first)) => {
                    let lengths = norm(&self.columns[j]).max(norm(&self.columns[*first]));
                    (dot(&self.difference(j, *first), &left), lengths)
                }
                _ => (dot(&self.columns[j], &left), norm(&self.columns[j])),
            };
            if scale > 0.0 && length > 0.0 { part / (length * scale) } else { 0.0 }
        };
        (0..self.columns.len()).map(one).collect()
    }

    fn solve(&self) -> Result<Solution, NnlsError> {
        let p = self.columns.len();
        let most_steps = 100 + 30 * p;
        let (mut used, mut z) = self.start();
        let mut barred = vec![false; p];
        let mut steps = 0;
        loop {
            let correlations = self.correlations(&used, &z);
            let free = (0..p).filter(|j| !barred[*j] && !used.contains(j));
            let best = free.max_by(|a, b| correlations[*a].total_cmp(&correlations[*b]));
            let Some(enters) = best.filter(|j| correlations[*j] > ENTER) else { break };
            steps += 1;
            if steps > most_steps {
                let kkt = correlations.iter().fold(0.0, |m: f64, c| m.max(*c));
                return Err(NnlsError::NotConverged { iterations: steps, kkt });
            }
            used.push(enters);
            z.push(0.0);
            let Some(mut trial) = self.least(&used).filter(|t| t[used.len() - 1] > 0.0) else {
                barred[enters] = true;
                used.pop();
                z.pop();
                continue;
            };
            // Back to the bound that is met first, until the face's own answer lies within all bounds.
            while trial.iter().any(|t| *t <= 0.0) {
                let reach = |i: usize| if trial[i] <= 0.0 { z[i] / (z[i] - trial[i]) } else { 1.0 };
                let part = (0..used.len()).map(reach).fold(1.0, f64::min);
                let keep: Vec<bool> =
                    (0..used.len()).map(|i| trial[i] > 0.0 || reach(i) > part).collect();
                z.iter_mut().zip(&trial).for_each(|(z, t)| *z += part * (t - *z));
                let mut kept = keep.iter();
                used.retain(|_| kept.next().copied().unwrap_or(true));
                let mut kept = keep.iter();
                z.retain(|_| kept.next().copied().unwrap_or(true));
                steps += 1;
                trial = match self.least(&used) {
                    Some(trial) => trial,
                    // Fewer of independent columns are independent: only rounding comes here.
                    None => break,
                };
            }
            if trial.len() == used.len() {
                z = trial;
            }
            barred.fill(false);
        }
        let (used, z) = self.without_rounding(used, z);
        Ok(self.report(&used, &z, steps))
    }

    /// The face without weights that are rounding about 0: whether they came out above or below it depends on the units.
    fn without_rounding(&self, used: Vec<usize>, z: Vec<f64>) -> (Vec<usize>, Vec<f64>) {
        let least = NEGLIGIBLE * self.scale(&used, &z);
        let counts = |i: &usize| z[*i] * norm(&self.columns[used[*i]]) > least;
        let kept: Vec<usize> = (0..used.len()).filter(counts).map(|i| used[i]).collect();
        if kept.len() == used.len() {
            return (used, z);
        }
        match self.least(&kept).filter(|t| t.iter().all(|t| *t > 0.0)) {
            Some(trial) => (kept, trial),
            None => (used, z),
        }
    }

    /// Nothing in use; with a sum, the one column that alone comes nearest.
    fn start(&self) -> (Vec<usize>, Vec<f64>) {
        let Some(total) = self.total else { return (Vec::new(), Vec::new()) };
        let far = |j: usize| norm(&self.left(&[j], &[total]));
        let nearest = (0..self.columns.len()).min_by(|a, b| far(*a).total_cmp(&far(*b)));
        (vec![nearest.unwrap_or(0)], vec![total])
    }

    fn report(&self, used: &[usize], z: &[f64], steps: usize) -> Solution {
        let p = self.columns.len();
        let correlations = self.correlations(used, z);
        let mut weights = vec![0.0; p];
        used.iter().zip(z).for_each(|(j, z)| weights[*j] = *z);
        let in_use: Vec<bool> = (0..p).map(|j| used.contains(&j)).collect();
        let violation = |j: usize| if in_use[j] { correlations[j].abs() } else { correlations[j] };
        let kkt = (0..p).map(violation).fold(0.0, f64::max);
        let even: Vec<usize> = (0..p).filter(|j| in_use[*j] || correlations[*j] > -EVEN).collect();
        let unique = self.independent(&even);
        Solution { weights, in_use, residual: Vec::new(), kkt, unique, steps }
    }

    /// Whether some columns (with a sum, their differences) are independent.
    fn independent(&self, some: &[usize]) -> bool {
        let mut basis = Basis::default();
        match (self.total, some.split_first()) {
            (Some(_), Some((first, others))) => others.iter().all(|j| {
                let difference = self.difference(*j, *first);
                let whole = norm(&self.columns[*j]).max(norm(&self.columns[*first]));
                norm(&difference) > EVEN * whole && basis.push(&difference, EVEN) > EVEN
            }),
            _ => some.iter().all(|j| basis.push(&self.columns[*j], EVEN) > EVEN),
        }
    }
}
