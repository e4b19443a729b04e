//! Linear least squares with lower and upper bounds, or on a given sum, by an active set.
//!
//! Lawson and Hanson (1974, ch. 23) with bounds on both sides (Stark and Parker 1995), and these differences: columns are scaled to lengths near 1 by powers of two,
//! so that neither the support nor a digit of the answer depends on their units; each face is solved by an orthogonal basis made anew (no update can drift) and
//! refined once; a given sum is kept exactly, by going along differences of columns, not by a heavy row.
//!
//! Every coefficient rests somewhere before it is used: at its lower bound, or at any value that the caller holds likely ([`Region::Between`]). A column of zeros, and a column that
//! is, to rounding, a combination of those in use, stays where it rests. What the data do not tell apart is so never sent away.
//!
//! ```
//! use sunglint_numerics::bounded::{BoundedSystem, Region};
//!
//! // Two columns that are one: the first takes what it may, the second what is left. The third is 0 and keeps its value.
//! let system = BoundedSystem::new(vec![vec![2.0, 0.0], vec![2.0, 0.0], vec![0.0, 0.0]], false)?;
//! let (low, high, rest) = ([0.0; 3], [1.0; 3], [0.0, 0.0, 0.3]);
//! let found = system.solve(&[3.0, 1.0], &Region::Between { low: &low, high: &high, rest: &rest })?;
//! assert_eq!(found.weights[0] + found.weights[1], 1.5);
//! assert_eq!(found.weights[2], 0.3);
//! # Ok::<(), sunglint_numerics::bounded::BoundedError>(())
//! ```

use crate::basis::{Basis, dot, norm};

/// A column enters where its correlation with what is left exceeds this; rounding alone makes some 1e-15.
const ENTER: f64 = 2e-14;
/// A column of which less than this stands upright on the others is their combination: leaving it out changes no correlation by more.
const PARALLEL: f64 = 1e-13;
/// Correlation below which a column that is not in use could be in use as well: then the answer is one of many unless the columns are independent.
const EVEN: f64 = 1e-10;
/// A weight that contributes less than this of the data beyond its bound is rounding about the bound.
const NEGLIGIBLE: f64 = 1e-13;

/// Set of weights that are allowed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Region<'a> {
    /// Weights not below 0.
    NotNegative,
    /// Weights not below 0 with this sum, above 0: the columns are then in one unit.
    Sum(f64),
    /// Weights between bounds, which may be infinite, one for each column.
    Between {
        /// Lower bounds.
        low: &'a [f64],
        /// Upper bounds, not below the lower ones.
        high: &'a [f64],
        /// Value that a weight keeps unless the data move it; brought within the bounds.
        rest: &'a [f64],
    },
}

/// Why there are no weights.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BoundedError {
    /// Another number of values than expected.
    #[error("{what}: {found} values, expected {expected}")]
    Length {
        /// Name of the values.
        what: &'static str,
        /// Number found.
        found: usize,
        /// Number expected.
        expected: usize,
    },
    /// A number that is none.
    #[error("{what} {}: {value}, expected a finite number", number + 1)]
    NotFinite {
        /// Name of the values.
        what: &'static str,
        /// Place, counted from 0.
        number: usize,
        /// Value that was given.
        value: f64,
    },
    /// Bounds that leave no weight.
    #[error("bounds of weight {}: {low} to {high}", column + 1)]
    Bounds {
        /// Which, counted from 0.
        column: usize,
        /// Lower bound.
        low: f64,
        /// Upper bound.
        high: f64,
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
    /// The weights; those out of use are exactly at a bound or where they rest.
    pub weights: Vec<f64>,
    /// True for those in use: free between their bounds.
    pub in_use: Vec<bool>,
    /// x − S a.
    pub residual: Vec<f64>,
    /// The largest violation of the Karush–Kuhn–Tucker conditions: |s_jᵀ(x − S a)| over ‖s_j‖ max(‖x‖, ‖s_k a_k‖) of what is free; of what stands at a bound the part that
    /// points inwards; with a given sum the same of differences of columns.
    pub kkt: f64,
    /// True where no other weights fit as well.
    pub unique: bool,
    /// Steps of the active set.
    pub steps: usize,
}

/// The columns of a system, scaled and, where there are more rows than columns, turned into their own space: made once for many right sides.
#[derive(Debug, Clone)]
pub struct BoundedSystem {
    original: Vec<Vec<f64>>,
    /// Scaled by `2^-exponent`, in the space of `turn` where there is one.
    columns: Vec<Vec<f64>>,
    exponent: Vec<i32>,
    turn: Option<Basis>,
    rows: usize,
}

/// The power of two next to a length.
fn exponent(length: f64) -> i32 {
    if length > 0.0 { length.log2().round() as i32 } else { 0 }
}

/// v · 2^e, in two steps where 2^e itself is no number.
fn ldexp(v: f64, e: i32) -> f64 {
    let half = e / 2;
    v * 2.0_f64.powi(half) * 2.0_f64.powi(e - half)
}

fn finite(what: &'static str, values: &[f64]) -> Result<(), BoundedError> {
    match values.iter().enumerate().find(|(_, v)| !v.is_finite()) {
        Some((number, value)) => Err(BoundedError::NotFinite { what, number, value: *value }),
        None => Ok(()),
    }
}

impl BoundedSystem {
    /// System of columns of one length. `one_unit` says that they are in one unit, which a [`Region::Sum`] needs.
    ///
    /// # Errors
    /// Columns of different lengths, numbers that are none.
    pub fn new(original: Vec<Vec<f64>>, one_unit: bool) -> Result<Self, BoundedError> {
        let rows = original.first().map_or(0, Vec::len);
        let count = original.len();
        for column in &original {
            if column.len() != rows {
                let (found, expected) = (column.len(), rows);
                return Err(BoundedError::Length { what: "column", found, expected });
            }
            finite("row", column)?;
        }
        let mut exponents: Vec<i32> = original.iter().map(|c| exponent(norm(c))).collect();
        if let (true, Some(most)) = (one_unit, exponents.iter().max().copied()) {
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
        Ok(Self { original, columns, exponent: exponents, turn, rows })
    }

    /// The allowed weights a that make ‖x − S a‖ least.
    ///
    /// # Errors
    /// Another number of values than rows or columns, values that are no numbers, bounds that leave nothing; [`BoundedError::NotConverged`].
    pub fn solve(&self, x: &[f64], region: &Region<'_>) -> Result<Solution, BoundedError> {
        let count = self.original.len();
        let length_of = |what, found, expected| match found == expected {
            true => Ok(()),
            false => Err(BoundedError::Length { what, found, expected }),
        };
        length_of("right side", x.len(), self.rows)?;
        finite("right side", x)?;
        let length = norm(x);
        let mut total = None;
        let mut scale = exponent(if length > 0.0 { length } else { 1.0 });
        let (mut low, mut high) = (vec![0.0; count], vec![f64::INFINITY; count]);
        let mut at = vec![0.0; count];
        match region {
            Region::NotNegative => {}
            Region::Sum(sum) => {
                if !(sum.is_finite() && *sum > 0.0) {
                    return Err(BoundedError::Sum { total: *sum });
                }
                // In the unit of the columns: weights are then shares of the sum.
                scale = exponent(*sum) + self.exponent.first().copied().unwrap_or(0);
                total = Some(ldexp(*sum, -exponent(*sum)));
            }
            Region::Between { low: least, high: most, rest } => {
                for (what, values) in
                    [("lower bounds", *least), ("upper bounds", *most), ("rests", *rest)]
                {
                    length_of(what, values.len(), count)?;
                }
                finite("rest", rest)?;
                for column in 0..count {
                    let (a, b) = (least[column], most[column]);
                    if !(a <= b && a < f64::INFINITY && b > f64::NEG_INFINITY) {
                        return Err(BoundedError::Bounds { column, low: a, high: b });
                    }
                    let e = self.exponent[column] - scale;
                    low[column] = ldexp(a, e);
                    high[column] = ldexp(b, e);
                    at[column] = ldexp(rest[column].clamp(a, b), e);
                }
            }
        }
        let scaled: Vec<f64> = x.iter().map(|v| ldexp(*v, -scale)).collect();
        let work = match &self.turn {
            Some(turn) => turn.coordinates(&scaled),
            None => scaled.clone(),
        };
        let length = norm(&scaled);
        let warm = matches!(region, Region::Between { .. });
        let mut face =
            Face { columns: &self.columns, x: &work, length, total, low, high, at, warm };
        let found = face.solve()?;
        let back = |j: usize| {
            let weight = ldexp(found.weights[j], scale - self.exponent[j]);
            // A bound is met to the last digit.
            let Region::Between { low, high, rest } = region else { return weight };
            if found.in_use[j] {
                weight.clamp(low[j], high[j])
            } else if found.weights[j] == face.low[j] {
                low[j]
            } else if found.weights[j] == face.high[j] {
                high[j]
            } else {
                rest[j].clamp(low[j], high[j])
            }
        };
        let weights: Vec<f64> = (0..count).map(back).collect();
        finite("weight", &weights)?;
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
    low: Vec<f64>,
    high: Vec<f64>,
    /// Values of what is not in use.
    at: Vec<f64>,
    /// Whether to begin with all columns in use.
    warm: bool,
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
                let none = vec![0.0; used.len()];
                let mut z = basis.solve(basis.coordinates(&self.left(used, &none)));
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

    /// x less some columns in use, and less what the others are at.
    fn left(&self, used: &[usize], z: &[f64]) -> Vec<f64> {
        let mut left = self.x.to_vec();
        let mut take = |j: usize, z: f64| {
            if z != 0.0 {
                left.iter_mut().zip(&self.columns[j]).for_each(|(l, s)| *l -= z * s);
            }
        };
        used.iter().zip(z).for_each(|(j, z)| take(*j, *z));
        let held = (0..self.columns.len()).filter(|j| !used.contains(j));
        held.for_each(|j| take(j, self.at[j]));
        left
    }

    /// Returns the scale by which the correlations are measured.
    fn scale(&self, used: &[usize], z: &[f64]) -> f64 {
        let parts = used.iter().zip(z).map(|(j, z)| norm(&self.columns[*j]) * z.abs());
        let held = (0..self.columns.len()).filter(|j| self.at[*j] != 0.0 && !used.contains(j));
        let held = held.map(|j| norm(&self.columns[j]) * self.at[j].abs());
        parts.chain(held).fold(self.length, f64::max)
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

    /// Correlation of a column that is not in use, as far as its weight may follow it; negative where it may not.
    fn gain(&self, j: usize, correlation: f64) -> f64 {
        let up = if self.at[j] < self.high[j] { correlation } else { f64::NEG_INFINITY };
        let down = if self.at[j] > self.low[j] { -correlation } else { f64::NEG_INFINITY };
        up.max(down)
    }

    /// Whether a value lies on a bound or beyond it.
    fn meets(&self, j: usize, t: f64) -> bool {
        t <= self.low[j] || t >= self.high[j]
    }

    fn solve(&mut self) -> Result<Solution, BoundedError> {
        let p = self.columns.len();
        let most_steps = 100 + 30 * p;
        let (mut used, mut z) = self.start();
        let mut barred = vec![false; p];
        let mut steps = 0;
        loop {
            let correlations = self.correlations(&used, &z);
            let gain = |j: usize| self.gain(j, correlations[j]);
            let free = (0..p).filter(|j| !barred[*j] && !used.contains(j));
            let best = free.max_by(|a, b| gain(*a).total_cmp(&gain(*b)));
            let Some(enters) = best.filter(|j| gain(*j) > ENTER) else { break };
            steps += 1;
            if steps > most_steps {
                let kkt = (0..p).map(gain).fold(0.0, f64::max);
                return Err(BoundedError::NotConverged { iterations: steps, kkt });
            }
            let (from, upwards) = (self.at[enters], correlations[enters] > 0.0);
            used.push(enters);
            z.push(from);
            let onwards = |t: &Vec<f64>| match upwards {
                true => t[t.len() - 1] > from,
                false => t[t.len() - 1] < from,
            };
            let Some(mut trial) = self.least(&used).filter(onwards) else {
                barred[enters] = true;
                used.pop();
                z.pop();
                continue;
            };
            // Back to the bound that is met first, until the face's own answer lies within all bounds.
            while used.iter().zip(&trial).any(|(j, t)| self.meets(*j, *t)) {
                let bound = |i: usize| match trial[i] <= self.low[used[i]] {
                    true => self.low[used[i]],
                    false => self.high[used[i]],
                };
                let reach = |i: usize| match self.meets(used[i], trial[i]) {
                    true if trial[i] == z[i] => 0.0,
                    true => ((bound(i) - z[i]) / (trial[i] - z[i])).clamp(0.0, 1.0),
                    false => 1.0,
                };
                let part = (0..used.len()).map(reach).fold(1.0, f64::min);
                let keep: Vec<bool> = (0..used.len())
                    .map(|i| !self.meets(used[i], trial[i]) || reach(i) > part)
                    .collect();
                let ends: Vec<(usize, f64)> =
                    (0..used.len()).filter(|i| !keep[*i]).map(|i| (used[i], bound(i))).collect();
                ends.iter().for_each(|(j, bound)| self.at[*j] = *bound);
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

    /// The face without weights that are rounding about a bound: whether they came out within it or beyond depends on the units.
    fn without_rounding(&mut self, used: Vec<usize>, z: Vec<f64>) -> (Vec<usize>, Vec<f64>) {
        let least = NEGLIGIBLE * self.scale(&used, &z);
        let own = |i: usize| norm(&self.columns[used[i]]);
        let low = |i: usize| (z[i] - self.low[used[i]]) * own(i) <= least;
        let high = |i: usize| (self.high[used[i]] - z[i]) * own(i) <= least;
        let kept: Vec<usize> =
            (0..used.len()).filter(|i| !low(*i) && !high(*i)).map(|i| used[i]).collect();
        if kept.len() == used.len() {
            return (used, z);
        }
        let ends: Vec<(usize, f64)> = (0..used.len())
            .filter_map(|i| match (low(i), high(i)) {
                (true, _) => Some((used[i], self.low[used[i]])),
                (_, true) => Some((used[i], self.high[used[i]])),
                _ => None,
            })
            .collect();
        let before = self.at.clone();
        ends.iter().for_each(|(j, bound)| self.at[*j] = *bound);
        let within =
            |t: &Vec<f64>| kept.iter().zip(t).all(|(j, t)| *t > self.low[*j] && *t < self.high[*j]);
        match self.least(&kept).filter(within) {
            Some(trial) => (kept, trial),
            None => {
                self.at = before;
                (used, z)
            }
        }
    }

    /// Nothing in use; with a sum, the one column that alone comes nearest. Begun warm: all columns that are independent of one another, less those that come out beyond a bound,
    /// which are then held there.
    fn start(&mut self) -> (Vec<usize>, Vec<f64>) {
        if let Some(total) = self.total {
            let far = |j: usize| norm(&self.left(&[j], &[total]));
            let nearest = (0..self.columns.len()).min_by(|a, b| far(*a).total_cmp(&far(*b)));
            return (vec![nearest.unwrap_or(0)], vec![total]);
        }
        let rests = self.at.clone();
        let mut used: Vec<usize> = match self.warm {
            true => (0..self.columns.len())
                .filter(|j| self.low[*j] < self.high[*j] && norm(&self.columns[*j]) > 0.0)
                .collect(),
            false => Vec::new(),
        };
        while !used.is_empty() {
            let Some(z) = self.least(&used) else {
                // What depends on one another is moved from its rest one by one.
                self.at = rests;
                break;
            };
            let before = used.len();
            let kept: Vec<bool> = used.iter().zip(&z).map(|(j, z)| !self.meets(*j, *z)).collect();
            for ((j, z), _) in used.iter().zip(&z).zip(&kept).filter(|(_, kept)| !**kept) {
                self.at[*j] = z.clamp(self.low[*j], self.high[*j]);
            }
            let mut kept = kept.iter();
            used.retain(|_| kept.next().copied().unwrap_or(true));
            if used.len() == before {
                return (used, z);
            }
        }
        (Vec::new(), Vec::new())
    }

    fn report(&self, used: &[usize], z: &[f64], steps: usize) -> Solution {
        let p = self.columns.len();
        let correlations = self.correlations(used, z);
        let mut weights = self.at.clone();
        used.iter().zip(z).for_each(|(j, z)| weights[*j] = *z);
        let in_use: Vec<bool> = (0..p).map(|j| used.contains(&j)).collect();
        let gain = |j: usize| self.gain(j, correlations[j]);
        let violation = |j: usize| if in_use[j] { correlations[j].abs() } else { gain(j) };
        let kkt = (0..p).map(violation).fold(0.0, f64::max);
        let even: Vec<usize> = (0..p).filter(|j| in_use[*j] || gain(*j) > -EVEN).collect();
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

#[cfg(test)]
mod tests {
    use super::*;

    fn draws(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed;
        move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / (1_u64 << 31) as f64 - 0.5
        }
    }

    /// The largest violation of the conditions of Karush, Kuhn and Tucker, which only the minimum of a convex problem meets: correlations of columns with the residual.
    fn violation(columns: &[Vec<f64>], x: &[f64], a: &[f64], low: &[f64], high: &[f64]) -> f64 {
        let mut left = x.to_vec();
        for (column, a) in columns.iter().zip(a) {
            left.iter_mut().zip(column).for_each(|(l, s)| *l -= a * s);
        }
        let largest = columns.iter().zip(a).map(|(c, a)| norm(c) * a.abs()).fold(norm(x), f64::max);
        let one = |j: usize| {
            let slope =
                dot(&columns[j], &left) / (norm(&columns[j]) * largest).max(f64::MIN_POSITIVE);
            match (a[j] <= low[j], a[j] >= high[j]) {
                (true, true) => 0.0,
                (true, false) => slope.max(0.0),
                (false, true) => (-slope).max(0.0),
                (false, false) => slope.abs(),
            }
        };
        (0..columns.len()).map(one).fold(0.0, f64::max)
    }

    /// Truth: the conditions of the minimum on 2,000 drawn problems: more and fewer rows than columns, columns doubled, of zeros, and of lengths from 1e-120 to
    /// 1e120, bounds that are infinite, equal, or hold on both sides. Tolerance 1e-12 of correlations: rounding of up to 12 columns.
    #[test]
    fn weights_meet_the_conditions_of_the_minimum() {
        let mut draw = draws(1);
        let (mut at_low, mut at_high) = (0, 0);
        for round in 0..2000_usize {
            let (rows, p) = (2 + round % 23, 1 + round % 12);
            let wide = if round % 5 == 0 { 120.0 } else { 1.0 };
            let mut columns: Vec<Vec<f64>> = (0..p)
                .map(|_| {
                    let size = 10_f64.powf(2.0 * wide * draw());
                    (0..rows).map(|_| size * draw()).collect()
                })
                .collect();
            if p > 3 && round % 3 == 0 {
                columns[2] = columns[0].iter().map(|v| 2.0 * v).collect();
                columns[3] = vec![0.0; rows];
            }
            let x: Vec<f64> = (0..rows).map(|_| 3.0 * draw()).collect();
            let (mut low, mut high, mut rest) = (vec![], vec![], vec![]);
            for (j, column) in columns.iter().enumerate() {
                let unit = match norm(column) {
                    l if l > 0.0 => norm(&x) / l,
                    _ => 1.0,
                };
                let a = unit * draw();
                let b = match (j + round) % 7 {
                    0 => a,
                    1 => f64::INFINITY,
                    _ => a + unit * 0.5 * (draw() + 0.5),
                };
                low.push(if (j + round) % 11 == 0 { f64::NEG_INFINITY } else { a });
                high.push(b);
                rest.push(unit * draw());
            }
            let system = BoundedSystem::new(columns.clone(), false).unwrap();
            let region = Region::Between { low: &low, high: &high, rest: &rest };
            let found = system.solve(&x, &region).unwrap();
            for (j, a) in found.weights.iter().enumerate() {
                assert!(low[j] <= *a && *a <= high[j], "{round} {j}: {a}");
                at_low += usize::from(*a == low[j]);
                at_high += usize::from(*a == high[j]);
                if norm(&columns[j]) == 0.0 {
                    assert_eq!(
                        *a,
                        rest[j].clamp(low[j], high[j]),
                        "{round}: a column of zeros moved"
                    );
                }
            }
            let kkt = violation(&columns, &x, &found.weights, &low, &high);
            assert!(kkt < 1e-12 && found.kkt < 1e-12, "{round}: {kkt:e} {:e}", found.kkt);
        }
        assert!(at_low > 1000 && at_high > 1000, "{at_low} {at_high}");
    }

    /// Truth: by hand. The unbounded answer (3, −1) of the unit vectors is cut to its bounds; of two equal columns one takes what it may and the other the rest.
    #[test]
    fn bounds_of_small_systems_hold_as_by_hand() {
        let system = BoundedSystem::new(vec![vec![1.0, 0.0], vec![0.0, 1.0]], false).unwrap();
        let solved = |low: &[f64], high: &[f64]| {
            let region = Region::Between { low, high, rest: &[0.0; 2] };
            system.solve(&[3.0, -1.0], &region).unwrap()
        };
        let found = solved(&[0.0, 0.0], &[2.0, 9.0]);
        assert_eq!((found.weights, found.in_use), (vec![2.0, 0.0], vec![false, false]));
        assert_eq!(solved(&[f64::NEG_INFINITY; 2], &[f64::INFINITY; 2]).weights, [3.0, -1.0]);
        assert_eq!(system.solve(&[3.0, -1.0], &Region::NotNegative).unwrap().weights, [3.0, 0.0]);
        let sum = system.solve(&[3.0, -1.0], &Region::Sum(1.0)).unwrap();
        assert_eq!(sum.weights, [1.0, 0.0]);
        let twins = BoundedSystem::new(vec![vec![1.0, 1.0], vec![1.0, 1.0]], false).unwrap();
        let region = Region::Between { low: &[0.0; 2], high: &[1.0; 2], rest: &[0.5; 2] };
        let found = twins.solve(&[1.7, 1.7], &region).unwrap();
        assert!((found.weights.iter().sum::<f64>() - 1.7).abs() < 1e-15 && !found.unique);
        assert!(found.weights.iter().all(|w| (0.5..=1.0).contains(w)), "{:?}", found.weights);
    }

    #[test]
    fn systems_that_are_none_are_refused() {
        let system = BoundedSystem::new(vec![vec![1.0, 2.0]], false).unwrap();
        let region = |low, high| Region::Between { low, high, rest: &[0.0] };
        assert!(matches!(
            system.solve(&[1.0, 1.0], &region(&[2.0], &[1.0])),
            Err(BoundedError::Bounds { column: 0, .. })
        ));
        assert!(matches!(
            system.solve(&[1.0], &Region::NotNegative),
            Err(BoundedError::Length { .. })
        ));
        assert!(matches!(
            system.solve(&[1.0, 1.0], &Region::Sum(0.0)),
            Err(BoundedError::Sum { .. })
        ));
        assert!(matches!(
            system.solve(&[1.0, f64::NAN], &Region::NotNegative),
            Err(BoundedError::NotFinite { number: 1, .. })
        ));
    }
}
