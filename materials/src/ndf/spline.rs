//! Cubic splines that are even about 0, through readings of both sides of the normal.
//!
//! The readings of the two sides interleave, and two that are close together must not decide a slope: the spline has its knots where one side has its
//! readings, and goes through all of them by least squares. Where only one side was measured that is interpolation.

use nalgebra::{DMatrix, DVector};

/// Where a spline may bend: knots at x ≥ 0, mirrored at 0.
#[derive(Debug, Clone)]
pub(super) struct Knots {
    x: Vec<f64>,
    /// Second derivatives at the knots, per value at the knots.
    bend: DMatrix<f64>,
}

/// A spline.
#[derive(Debug, Clone)]
pub(super) struct EvenSpline<'a> {
    knots: &'a Knots,
    y: DVector<f64>,
    second: DVector<f64>,
}

impl Knots {
    /// At increasing places, the first at 0 or above; `None` with less than 3.
    ///
    /// About 0 the spline is even: s′(x₀) = x₀ s″(x₀), as of a parabola between −x₀ and x₀. At the last knot s″ is as at the one before.
    pub fn new(x: Vec<f64>) -> Option<Self> {
        let n = x.len();
        if n < 3 {
            return None;
        }
        // Rows: what the second derivatives obey, and what of the values they do.
        let (mut lower, mut middle, mut upper) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let mut right = DMatrix::zeros(n, n);
        let h = |k: usize| x[k + 1] - x[k];
        (middle[0], upper[0]) = (x[0] + h(0) / 3.0, h(0) / 6.0);
        (right[(0, 0)], right[(0, 1)]) = (-1.0 / h(0), 1.0 / h(0));
        for k in 1..n - 1 {
            (lower[k], middle[k], upper[k]) = (h(k - 1) / 6.0, (h(k - 1) + h(k)) / 3.0, h(k) / 6.0);
            right[(k, k - 1)] = 1.0 / h(k - 1);
            right[(k, k)] = -1.0 / h(k - 1) - 1.0 / h(k);
            right[(k, k + 1)] = 1.0 / h(k);
        }
        (lower[n - 1], middle[n - 1]) = (-1.0, 1.0);
        for k in 1..n {
            let share = lower[k] / middle[k - 1];
            middle[k] -= share * upper[k - 1];
            for column in 0..n {
                let above = right[(k - 1, column)];
                right[(k, column)] -= share * above;
            }
        }
        for k in (0..n).rev() {
            for column in 0..n {
                let below = if k + 1 < n { upper[k] * right[(k + 1, column)] } else { 0.0 };
                right[(k, column)] = (right[(k, column)] - below) / middle[k];
            }
        }
        Some(Self { x, bend: right })
    }

    /// The last knot.
    pub fn end(&self) -> f64 {
        self.x[self.x.len() - 1]
    }

    /// The interval of a place and the weights of its ends' values and second derivatives; beyond the last knot straight on.
    fn basis(&self, x: f64) -> (usize, [f64; 4]) {
        let (n, x) = (self.x.len(), x.abs());
        if x <= self.x[0] {
            // The parabola about 0.
            return (0, [1.0, 0.0, 0.5 * (x * x - self.x[0] * self.x[0]), 0.0]);
        }
        let k = self.x.partition_point(|knot| *knot <= x).clamp(1, n - 1) - 1;
        let h = self.x[k + 1] - self.x[k];
        let b = (x - self.x[k]) / h;
        let a = 1.0 - b;
        if b > 1.0 {
            // s′ at the last knot is the chord's slope + h (s″ before + 2 s″ there)/6.
            let beyond = (b - 1.0) * h * h / 6.0;
            return (k, [a, b, beyond, 2.0 * beyond]);
        }
        (k, [a, b, (a * a * a - a) * h * h / 6.0, (b * b * b - b) * h * h / 6.0])
    }

    /// The row of a place: what each knot's value adds there.
    fn row(&self, x: f64, row: &mut [f64]) {
        let (k, [a, b, c, d]) = self.basis(x);
        for (column, value) in row.iter_mut().enumerate() {
            *value = c * self.bend[(k, column)] + d * self.bend[(k + 1, column)];
        }
        row[k] += a;
        row[k + 1] += b;
    }

    /// The spline through readings (place, value, weight above 0) by least squares; `None` where they do not decide it.
    pub fn through(&self, readings: &[(f64, f64, f64)]) -> Option<EvenSpline<'_>> {
        let n = self.x.len();
        let mut rows = DMatrix::zeros(n, readings.len());
        let mut right = DVector::zeros(readings.len());
        let mut row = vec![0.0; n];
        for (at, (x, value, weight)) in readings.iter().enumerate() {
            self.row(*x, &mut row);
            let root = weight.sqrt();
            rows.column_mut(at).iter_mut().zip(&row).for_each(|(to, from)| *to = root * from);
            right[at] = root * value;
        }
        let mut normal = &rows * rows.transpose();
        // A knot amid a few readings may be all but free: so little holds it that no digit of a reading changes.
        let largest = normal.diagonal().max();
        for k in 0..n {
            normal[(k, k)] += 1e-14 * largest;
        }
        let y = normal.cholesky()?.solve(&(rows * right));
        y.iter().all(|y| y.is_finite()).then(|| self.with(y))
    }

    /// The spline with these values at the knots.
    fn with(&self, y: DVector<f64>) -> EvenSpline<'_> {
        let second = &self.bend * &y;
        EvenSpline { knots: self, y, second }
    }
}

impl EvenSpline<'_> {
    pub fn at(&self, x: f64) -> f64 {
        let (k, [a, b, c, d]) = self.knots.basis(x);
        a * self.y[k] + b * self.y[k + 1] + c * self.second[k] + d * self.second[k + 1]
    }
}

/// Knots for readings at places of both signs, sorted: the places of whichever side is finer, none closer to the next than three quarters of its own side's
/// spacing.
pub(super) fn knots_of(places: &[f64]) -> Vec<f64> {
    // Each with the distance to the one before it on its own side.
    let mut marks: Vec<(f64, f64)> = Vec::with_capacity(places.len());
    for (k, x) in places.iter().enumerate() {
        let apart = |other: Option<&f64>| other.map(|o| (x - o).abs()).filter(|d| *d > 1e-9);
        let before = k.checked_sub(1).and_then(|b| places.get(b));
        let inner = if *x >= 0.0 { before } else { places.get(k + 1) };
        let outer = if *x >= 0.0 { places.get(k + 1) } else { before };
        marks.push((x.abs(), apart(inner).or(apart(outer)).unwrap_or(0.0)));
    }
    marks.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut knots: Vec<f64> = Vec::new();
    for (x, spacing) in marks {
        if knots.last().is_none_or(|last| x - last >= (0.75 * spacing).max(1e-6)) {
            knots.push(x);
        }
    }
    knots
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the cosine, and that a cubic spline errs by 5/384 h⁴ f⁗ between knots a step h apart (de Boor 1978); the side at the end, where the
    /// second derivative is held, by h² f‴/10 or so, is left out.
    #[test]
    fn a_cosine_from_both_sides() {
        let h = 0.1;
        let places: Vec<f64> = (0..60).map(|k| -1.03 + h * f64::from(k)).collect();
        let knots = Knots::new(knots_of(&places)).unwrap();
        let readings: Vec<_> = places.iter().map(|x| (*x, x.cos(), 1.0)).collect();
        let spline = knots.through(&readings).unwrap();
        for k in 0..400 {
            let x = 0.01 * f64::from(k);
            assert!((spline.at(x) - x.cos()).abs() < 2.0 * 5.0 / 384.0 * h.powi(4), "{x}");
            assert_eq!(spline.at(x), spline.at(-x));
        }
        assert!((spline.at(4.9 + 0.2) - 5.1_f64.cos()).abs() < 0.1);
    }

    /// Truth: by hand.
    #[test]
    fn knots_are_those_of_one_side() {
        let places: Vec<f64> = (0..13).map(|k| -2.2 + 0.5 * f64::from(k)).collect();
        let knots = knots_of(&places);
        // 0.2 (left), 0.3, 0.7, 0.8 …: the left side's and, after it has ended, the right side's.
        let expected = [0.2, 0.7, 1.2, 1.7, 2.2, 2.8, 3.3, 3.8];
        assert_eq!(knots.len(), expected.len(), "{knots:?}");
        assert!(knots.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{knots:?}");
    }
}
