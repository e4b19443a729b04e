//! Least squares of harmonics with a free zero point a session, at one frequency and on a grid.
//!
//! The zero points are a diagonal block of the normal equations and are eliminated: with X the 2K columns of harmonics, w the weights, W_s = Σ_s w and
//! u_s = Σ_s w X, N = XᵀWX − Σ_s u_s u_sᵀ/W_s, and χ² falls by rᵀN⁻¹r with r = XᵀW(y − ȳ_s). XᵀWX needs only Σ w e^{2πijft}, j to 2K (products to sums).

use crate::period::FrequencyGrid;
use crate::period::lomb_scargle::{Cholesky, LANES, LEAST_PIVOT, lanes};
use crate::period::sums::{sums, sums_of_a_stretch, turns};
use std::f64::consts::TAU;
use std::ops::Range;
use sunglint_numerics::progress::{Cancelled, Progress};

/// Frequencies at a time, at least and at most: memory stays small.
const BLOCK: Range<usize> = 1 << 14..1 << 17;

/// Samples of all sessions on one clock.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    /// Times from the middle of the whole, s.
    pub time: Vec<f64>,
    /// Magnitudes.
    pub value: Vec<f64>,
    /// Number of samples that each row stands for.
    pub count: Vec<f64>,
    /// The rows of each session.
    pub sessions: Vec<Range<usize>>,
}

/// The values less the weighted mean of their session, times the weight.
struct Weighted<'a> {
    weight: &'a [f64],
    values: Vec<f64>,
    means: Vec<f64>,
    totals: Vec<f64>,
    total: f64,
    variation: f64,
}

impl<'a> Weighted<'a> {
    fn new(rows: &Rows, weight: &'a [f64]) -> Self {
        let mut values = vec![0.0; rows.value.len()];
        let (mut means, mut totals) = (Vec::new(), Vec::new());
        let (mut total, mut variation) = (0.0, 0.0);
        for session in &rows.sessions {
            let own = || weight[session.clone()].iter().zip(&rows.value[session.clone()]);
            let sum: f64 = own().map(|(w, _)| w).sum();
            let mean = own().map(|(w, y)| w * y).sum::<f64>() / sum;
            for ((to, w), y) in values[session.clone()]
                .iter_mut()
                .zip(&weight[session.clone()])
                .zip(&rows.value[session.clone()])
            {
                *to = w * (y - mean);
                variation += *to * (y - mean);
            }
            means.push(mean);
            totals.push(sum);
            total += sum;
        }
        Self { weight, values, means, totals, total, variation }
    }
}

/// A fit at one frequency.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    /// Sum of weighted squares that is left.
    pub chi2: f64,
    /// Coefficients [cos, sin] of the harmonics, from the first.
    pub(crate) harmonics: Vec<[f64; 2]>,
    /// Zero point of each session.
    pub zero: Vec<f64>,
}

/// Fills the lower half of XᵀWX from the sums C_j, j from 0 to 2K.
fn products<const L: usize>(matrix: &mut [[f64; L]], p: usize, sums: &[[[f64; L]; 2]]) {
    for i in 1..=p / 2 {
        for j in 1..=i {
            let ([cp, sp], [cm, sm]) = (&sums[i + j], &sums[i - j]);
            let at = |a: usize, b: usize| (2 * (i - 1) + a) * p + 2 * (j - 1) + b;
            matrix[at(0, 0)] = std::array::from_fn(|l| 0.5 * (cm[l] + cp[l]));
            matrix[at(1, 1)] = std::array::from_fn(|l| 0.5 * (cm[l] - cp[l]));
            matrix[at(1, 0)] = std::array::from_fn(|l| 0.5 * (sp[l] + sm[l]));
            matrix[at(0, 1)] = std::array::from_fn(|l| 0.5 * (sp[l] - sm[l]));
        }
    }
}

impl Rows {
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// From the first to the last row, s.
    pub fn span_s(&self) -> f64 {
        let (a, b) = self
            .time
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(*t), b.max(*t)));
        (b - a).max(0.0)
    }

    /// Fits harmonics and zero points at one frequency, directly.
    pub fn fit(&self, weight: &[f64], frequency_hz: f64, harmonics: usize) -> Fit {
        let data = Weighted::new(self, weight);
        let p = 2 * harmonics;
        let mut all = vec![[[0.0]; 2]; p + 1];
        all[0] = [[data.total], [0.0]];
        let mut right = vec![0.0; p];
        let mut own = vec![vec![0.0; p]; self.sessions.len()];
        for (session, own) in self.sessions.iter().zip(&mut own) {
            for i in session.clone() {
                let (sin, cos) = (TAU * turns(frequency_hz, self.time[i])).sin_cos();
                let (mut c, mut s) = (1.0, 0.0);
                let (w, y) = (weight[i], data.values[i]);
                for k in 1..=p {
                    (c, s) = (c * cos - s * sin, c * sin + s * cos);
                    all[k][0][0] += w * c;
                    all[k][1][0] += w * s;
                    if k <= harmonics {
                        own[2 * k - 2] += w * c;
                        own[2 * k - 1] += w * s;
                        right[2 * k - 2] += y * c;
                        right[2 * k - 1] += y * s;
                    }
                }
            }
        }
        let mut factor = Cholesky::<1>::new(p);
        products(&mut factor.matrix, p, &all);
        for (u, total) in own.iter().zip(&data.totals) {
            for i in 0..p {
                for j in 0..=i {
                    factor.matrix[i * p + j][0] -= u[i] * u[j] / total;
                }
            }
        }
        let [gain] = factor.solve(|i| [right[i]], LEAST_PIVOT * data.total);
        let x = factor.unknowns();
        let zero = own.iter().zip(&data.totals).zip(&data.means).map(|((u, total), mean)| {
            mean - u.iter().zip(&x).map(|(u, x)| u * x).sum::<f64>() / total
        });
        Fit {
            chi2: (data.variation - gain).max(0.0),
            zero: zero.collect(),
            harmonics: x.chunks_exact(2).map(|c| [c[0], c[1]]).collect(),
        }
    }

    /// Residuals of a fit, row by row.
    pub fn residuals(&self, fit: &Fit, frequency_hz: f64) -> Vec<f64> {
        let mut all = Vec::with_capacity(self.len());
        for (session, zero) in self.sessions.iter().zip(&fit.zero) {
            for i in session.clone() {
                let light = light(&fit.harmonics, turns(frequency_hz, self.time[i]));
                all.push(self.value[i] - zero - light);
            }
        }
        all
    }

    /// χ² at every frequency of a grid, for models of each of `orders` harmonics (rising; the last is the largest).
    ///
    /// # Errors
    /// An early end by whoever watches.
    pub fn scan(
        &self,
        weight: &[f64],
        orders: &[usize],
        grid: &FrequencyGrid,
        progress: &dyn Progress,
    ) -> Result<Vec<Vec<f64>>, Cancelled> {
        let data = Weighted::new(self, weight);
        let harmonics = orders.last().copied().unwrap_or(1);
        let p = 2 * harmonics;
        let triangle = p * (p + 1) / 2;
        let block = self.len().next_power_of_two().clamp(BLOCK.start, BLOCK.end);
        let mut found = vec![Vec::with_capacity(grid.n); orders.len()];
        let mut factor = Cholesky::<LANES>::new(p);
        let mut weights = vec![[[0.0; LANES]; 2]; p + 1];
        weights[0][0] = [data.total; LANES];
        let mut of_sessions = Vec::new();
        let mut u = vec![0.0; p];
        for first in (0..grid.n).step_by(block) {
            if progress.is_cancelled() {
                return Err(Cancelled);
            }
            let n = block.min(grid.n - first);
            let times = |k: usize| {
                let k = k as f64;
                FrequencyGrid {
                    first_hz: k * grid.frequency_hz(first),
                    step_hz: k * grid.step_hz,
                    n,
                }
            };
            // What the zero points take away, by frequency.
            of_sessions.clear();
            of_sessions.resize(n * triangle, 0.0);
            for (session, total) in self.sessions.iter().zip(&data.totals) {
                let (time, own) = (&self.time[session.clone()], &weight[session.clone()]);
                let by: Vec<_> =
                    (1..=harmonics).map(|k| sums_of_a_stretch(time, own, &times(k))).collect();
                let root = 1.0 / total.sqrt();
                for (f, row) in of_sessions.chunks_exact_mut(triangle).enumerate() {
                    for (k, s) in by.iter().enumerate() {
                        u[2 * k] = root * s.cos[f];
                        u[2 * k + 1] = root * s.sin[f];
                    }
                    let mut at = 0;
                    for i in 0..p {
                        let ui = u[i];
                        for (to, uj) in row[at..=at + i].iter_mut().zip(&u) {
                            *to += ui * uj;
                        }
                        at += i + 1;
                    }
                }
            }
            let (mut of_weights, mut of_values) = (Vec::new(), Vec::new());
            for k in 1..=p {
                if k <= harmonics {
                    let mut both = sums(&self.time, &[data.weight, &data.values], &times(k));
                    of_values.extend(both.pop());
                    of_weights.extend(both.pop());
                } else {
                    of_weights.extend(sums(&self.time, &[data.weight], &times(k)));
                }
            }
            for f in (0..n).step_by(LANES) {
                for (to, s) in weights[1..].iter_mut().zip(&of_weights) {
                    *to = [lanes(&s.cos, f), lanes(&s.sin, f)];
                }
                products(&mut factor.matrix, p, &weights);
                let count = LANES.min(n - f);
                let taken =
                    of_sessions[f * triangle..(f + count) * triangle].chunks_exact(triangle);
                for (l, taken) in taken.enumerate() {
                    let mut at = 0;
                    for i in 0..p {
                        let row = &mut factor.matrix[i * p..=i * p + i];
                        for (m, t) in row.iter_mut().zip(&taken[at..=at + i]) {
                            m[l] -= t;
                        }
                        at += i + 1;
                    }
                }
                let right = |i: usize| {
                    let s = &of_values[i / 2];
                    lanes(if i.is_multiple_of(2) { &s.cos } else { &s.sin }, f)
                };
                factor.solve(right, LEAST_PIVOT * data.total);
                // The unknowns stand in the order of the harmonics: the first ones alone are a smaller model.
                for l in 0..count {
                    let mut gain = 0.0;
                    let mut from = 0;
                    for (order, chi2) in orders.iter().zip(&mut found) {
                        let solution = &factor.solution[from..2 * order];
                        gain += solution.iter().map(|x| x[l] * x[l]).sum::<f64>();
                        from = 2 * order;
                        chi2.push((data.variation - gain).max(0.0));
                    }
                }
            }
            progress.advance(n as u64);
        }
        Ok(found)
    }
}

/// The model's light at a part of a turn, less its zero point.
pub(super) fn light(harmonics: &[[f64; 2]], turn: f64) -> f64 {
    let (sin, cos) = (TAU * turn).sin_cos();
    let (mut c, mut s) = (1.0, 0.0);
    let mut value = 0.0;
    for [a, b] in harmonics {
        (c, s) = (c * cos - s * sin, c * sin + s * cos);
        value += a * c + b * s;
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use sunglint_numerics::progress::Silent;

    /// Truth: the least squares with a column for every zero point, by singular values. Tolerance: 1e-8 of the variation (rounding of nearly dependent columns).
    #[test]
    fn eliminated_zero_points_are_fitted_ones() {
        let mut state = 7_u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let mut rows =
            Rows { time: Vec::new(), value: Vec::new(), count: Vec::new(), sessions: Vec::new() };
        for (from, n) in [(-90_000.0, 40), (-5_000.0, 31), (60_000.0, 27)] {
            let begin = rows.time.len();
            for i in 0..n {
                rows.time.push(from + 600.0 * (f64::from(i) + random()));
                rows.value.push(from * 1e-5 + random());
                rows.count.push(1.0);
            }
            rows.sessions.push(begin..rows.time.len());
        }
        let weight: Vec<f64> = (0..rows.len()).map(|_| 0.5 + random()).collect();
        let grid = FrequencyGrid { first_hz: 1.3e-5, step_hz: 3.1e-7, n: 200 };
        let found = rows.scan(&weight, &[2, 3], &grid, &Silent).unwrap();
        for (order, chi2) in [2_usize, 3].into_iter().zip(&found) {
            for i in (0..grid.n).step_by(23) {
                let f = grid.frequency_hz(i);
                let p = 2 * order + 3;
                let column = |row: usize, c: usize| {
                    let root = weight[row].sqrt();
                    let angle = TAU * f * rows.time[row] * (c / 2 + 1) as f64;
                    root * match c {
                        c if c >= 2 * order => {
                            f64::from(u8::from(rows.sessions[c - 2 * order].contains(&row)))
                        }
                        c if c % 2 == 0 => angle.cos(),
                        _ => angle.sin(),
                    }
                };
                let x = DMatrix::from_fn(rows.len(), p, column);
                let y = DVector::from_fn(rows.len(), |r, _| weight[r].sqrt() * rows.value[r]);
                let solution = x.clone().svd(true, true).solve(&y, 1e-12).unwrap();
                let truth = (&y - &x * &solution).norm_squared();
                assert!(
                    (chi2[i] - truth).abs() < 1e-8 * truth,
                    "{order} at {f}: {} {truth}",
                    chi2[i]
                );
                let direct = rows.fit(&weight, f, order);
                assert!((direct.chi2 - truth).abs() < 1e-8 * truth);
                let left: f64 =
                    rows.residuals(&direct, f).iter().zip(&weight).map(|(r, w)| w * r * r).sum();
                assert!((left - truth).abs() < 1e-8 * truth);
            }
        }
    }
}
