//! Polynomials through positions, and through velocities where there are any.

use glam::DVec3;

/// Rows that one polynomial passes through where velocities are known: degree 7.
pub(super) const ROWS_WITH_VELOCITY: usize = 4;
/// And where they are not: degree 9.
pub(super) const ROWS_WITHOUT_VELOCITY: usize = 10;
/// Conditions that one polynomial meets at most.
const MOST: usize = 10;

/// A series of positions at increasing times, s and m.
#[derive(Debug, Clone, Copy)]
pub(super) struct Series<'a> {
    pub times_s: &'a [f64],
    pub positions_m: &'a [DVec3],
    /// Velocities, as many as positions, or none at all.
    pub velocities_m_s: &'a [DVec3],
}

impl Series<'_> {
    /// How many rows a polynomial takes here.
    pub fn rows(&self) -> usize {
        let wanted =
            if self.velocities_m_s.is_empty() { ROWS_WITHOUT_VELOCITY } else { ROWS_WITH_VELOCITY };
        wanted.min(self.times_s.len())
    }

    /// Position and velocity at a time, by the polynomial through the `rows` rows around it: as many before as after,
    /// at the ends of the table the first or the last ones.
    ///
    /// Newton's form with divided differences; a row whose velocity is known counts twice (Hermite).
    pub fn at(&self, time_s: f64, rows: usize) -> (DVec3, DVec3) {
        let after = self.times_s.partition_point(|t| *t <= time_s);
        let first = after.saturating_sub(rows.div_ceil(2)).min(self.times_s.len() - rows);
        let repeat = if self.velocities_m_s.is_empty() { 1 } else { 2 };
        let conditions = rows * repeat;
        // Times in units of the window, so that high orders neither overflow nor vanish.
        let origin = self.times_s[first];
        let span = (self.times_s[first + rows - 1] - origin).max(f64::MIN_POSITIVE);
        let span = if rows > 1 { span } else { 1.0 };
        let mut nodes = [0.0; MOST];
        let mut coefficients = [DVec3::ZERO; MOST];
        for i in 0..conditions {
            let row = first + i / repeat;
            nodes[i] = (self.times_s[row] - origin) / span;
            coefficients[i] = self.positions_m[row];
        }
        for order in 1..conditions {
            for i in (order..conditions).rev() {
                coefficients[i] = if order == 1 && repeat == 2 && i % 2 == 1 {
                    self.velocities_m_s[first + i / 2] * span
                } else {
                    (coefficients[i] - coefficients[i - 1]) / (nodes[i] - nodes[i - order])
                };
            }
        }
        let u = (time_s - origin) / span;
        let (mut position, mut slope) = (coefficients[conditions - 1], DVec3::ZERO);
        for i in (0..conditions - 1).rev() {
            slope = slope * (u - nodes[i]) + position;
            position = position * (u - nodes[i]) + coefficients[i];
        }
        (position, slope / span)
    }

    /// The largest difference, in the middle of any interval, from the polynomial through fewer rows: (m, the time).
    ///
    /// It is the error of that lower order, hence larger than the interpolation's own wherever the table is dense enough
    /// for the orders to converge.
    pub fn largest_error(&self) -> (f64, f64) {
        let rows = self.rows();
        let fewer = if self.velocities_m_s.is_empty() { rows - 2 } else { rows - 1 };
        let mut worst = (0.0, self.times_s[0]);
        for pair in self.times_s.windows(2) {
            let middle = 0.5 * (pair[0] + pair[1]);
            let difference = (self.at(middle, rows).0 - self.at(middle, fewer).0).length();
            if difference > worst.0 {
                worst = (difference, middle);
            }
        }
        worst
    }
}
