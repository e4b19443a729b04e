//! Lomb-Scargle periodograms: the share of the weighted variance that K harmonics and a mean explain (Lomb 1976, Scargle 1982; with the mean as a
//! parameter Zechmeister and Kürster 2009, A&A 496, 577; with harmonics Palmer 2009, ApJ 695, 496).

use super::sums::{Sums, sums};
use super::{FrequencyGrid, PeriodError};
use crate::series::Series;

/// The most harmonics of a model.
pub(super) const MOST_HARMONICS: usize = 32;
/// Frequencies at a time: memory stays small.
const BLOCK: usize = 1 << 16;
/// Frequencies that are solved side by side: each goes the same way as alone, and the processor does several at once.
pub(crate) const LANES: usize = 8;
/// A pivot below this share of its diagonal is rounding: what it stands for follows from the others, and is left out.
pub(crate) const LEAST_PIVOT: f64 = 1e-10;

/// The share of the weighted variance of `series` that a mean and `harmonics` harmonics explain, at every frequency of `grid`: 0 to 1.
/// It equals 1 − χ²/χ²₀ of the least-squares fit, whatever the sampling; at a frequency of 0, 0.
///
/// # Errors
/// A grid or a number of harmonics that cannot be; too few samples; constant values.
///
/// ```
/// use sunglint_analysis::period::{FrequencyGrid, lomb_scargle};
/// use sunglint_analysis::series::Series;
///
/// let time: Vec<f64> = (0..50).map(f64::from).collect();
/// let value: Vec<f64> = time.iter().map(|t| (std::f64::consts::TAU * 0.1 * t).sin()).collect();
/// let series = Series::new("sine", &time, &value, None)?;
/// let power = lomb_scargle(&series, &FrequencyGrid { first_hz: 0.08, step_hz: 0.02, n: 3 }, 1)?;
/// // A sine explains itself, and nothing at another whole number of turns in the span.
/// assert!((power[1] - 1.0).abs() < 1e-9 && power[2] < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn lomb_scargle(
    series: &Series,
    grid: &FrequencyGrid,
    harmonics: usize,
) -> Result<Vec<f64>, PeriodError> {
    grid.check()?;
    let centred = Centred::new(series, harmonics)?;
    let mut power = Vec::with_capacity(grid.n);
    for first in (0..grid.n).step_by(BLOCK) {
        let n = BLOCK.min(grid.n - first);
        let block = FrequencyGrid { first_hz: grid.frequency_hz(first), step_hz: grid.step_hz, n };
        centred.block(&block, harmonics, &mut power);
    }
    Ok(power)
}

/// The spectral window |Σ w e^{2πift}|²/(Σw)² of the sampling: 1 at frequency 0; peaks elsewhere make aliases.
///
/// # Errors
/// A grid that cannot be; no sample.
pub fn window(series: &Series, grid: &FrequencyGrid) -> Result<Vec<f64>, PeriodError> {
    grid.check()?;
    if series.is_empty() {
        return Err(PeriodError::Samples { name: series.name.clone(), samples: 0, harmonics: 0 });
    }
    let time = centred_times(series);
    let total: f64 = series.weight.iter().sum();
    let mut power = Vec::with_capacity(grid.n);
    for first in (0..grid.n).step_by(BLOCK) {
        let n = BLOCK.min(grid.n - first);
        let block = FrequencyGrid { first_hz: grid.frequency_hz(first), step_hz: grid.step_hz, n };
        let found = sums(&time, &[&series.weight], &block);
        let square = |(c, s): (&f64, &f64)| (c * c + s * s) / (total * total);
        power.extend(found[0].cos.iter().zip(&found[0].sin).map(square));
    }
    Ok(power)
}

/// Times from the middle of the span, where phases are smallest.
pub(super) fn centred_times(series: &Series) -> Vec<f64> {
    let first = series.time_s.first().copied().unwrap_or(0.0);
    let middle = first + 0.5 * series.span_s();
    series.time_s.iter().map(|t| t - middle).collect()
}

/// A series from its middle and its mean.
pub(super) struct Centred<'a> {
    pub time: Vec<f64>,
    pub weight: &'a [f64],
    /// Weight times value less the mean.
    pub weighted: Vec<f64>,
    /// Σ w.
    pub total: f64,
    /// Σ w (y − ȳ)².
    pub variation: f64,
}

impl<'a> Centred<'a> {
    pub fn new(series: &'a Series, harmonics: usize) -> Result<Self, PeriodError> {
        if !(1..=MOST_HARMONICS).contains(&harmonics) {
            return Err(PeriodError::Harmonics(harmonics));
        }
        let (name, samples) = (series.name.clone(), series.len());
        if samples <= 2 * harmonics + 1 {
            return Err(PeriodError::Samples { name, samples, harmonics });
        }
        let mean = series.mean();
        let about: Vec<f64> = series.value.iter().map(|v| v - mean).collect();
        let largest = about.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
        // The mean of equal values may differ from them by a rounding.
        if largest <= 1e-14 * mean.abs() || largest == 0.0 {
            return Err(PeriodError::Constant { name, samples, value: series.value[0] });
        }
        let weighted: Vec<f64> = about.iter().zip(&series.weight).map(|(v, w)| v * w).collect();
        let variation = weighted.iter().zip(&about).map(|(a, b)| a * b).sum();
        let total = series.weight.iter().sum();
        Ok(Self { time: centred_times(series), weight: &series.weight, weighted, total, variation })
    }

    fn block(&self, grid: &FrequencyGrid, harmonics: usize, power: &mut Vec<f64>) {
        let times = |k: usize| {
            let k = k as f64;
            FrequencyGrid { first_hz: k * grid.first_hz, step_hz: k * grid.step_hz, n: grid.n }
        };
        // By harmonic: of the weights up to twice the harmonics, of the weighted values up to them.
        let mut of_weights: Vec<Sums> = Vec::with_capacity(2 * harmonics);
        let mut of_values: Vec<Sums> = Vec::with_capacity(harmonics);
        for k in 1..=2 * harmonics {
            if k <= harmonics {
                let mut both = sums(&self.time, &[self.weight, &self.weighted], &times(k));
                of_values.extend(both.pop());
                of_weights.extend(both.pop());
            } else {
                of_weights.extend(sums(&self.time, &[self.weight], &times(k)));
            }
        }
        if harmonics == 1 {
            let (w, w2, y) = (&of_weights[0], &of_weights[1], &of_values[0]);
            power.extend((0..grid.n).map(|i| {
                self.one([w.cos[i], w.sin[i]], [w2.cos[i], w2.sin[i]], [y.cos[i], y.sin[i]])
            }));
            return;
        }
        let mut normal = Normal::<LANES>::new(harmonics);
        for first in (0..grid.n).step_by(LANES) {
            let count = LANES.min(grid.n - first);
            for (k, s) in of_weights.iter().enumerate() {
                normal.weights[k + 1] = [lanes(&s.cos, first), lanes(&s.sin, first)];
            }
            for (k, s) in of_values.iter().enumerate() {
                normal.values[k] = [lanes(&s.cos, first), lanes(&s.sin, first)];
            }
            let gains = normal.reduction(self.total);
            power.extend(gains[..count].iter().map(|gain| self.share(*gain)));
        }
    }

    /// Solves for one harmonic: the two equations that are left without the mean, in closed form.
    fn one(&self, [c, s]: [f64; 2], [c2, s2]: [f64; 2], [yc, ys]: [f64; 2]) -> f64 {
        let cc = 0.5 * (self.total + c2) - c * c / self.total;
        let ss = 0.5 * (self.total - c2) - s * s / self.total;
        let cs = 0.5 * s2 - c * s / self.total;
        // The larger pivot first.
        let (a, b, ya, yb) = if cc >= ss { (cc, ss, yc, ys) } else { (ss, cc, ys, yc) };
        if a <= LEAST_PIVOT * self.total {
            return 0.0;
        }
        let mut gain = ya * ya / a;
        let rest = b - cs * cs / a;
        if rest > LEAST_PIVOT * self.total {
            gain += (yb - cs * ya / a).powi(2) / rest;
        }
        self.share(gain)
    }

    pub fn share(&self, gain: f64) -> f64 {
        // Beyond these ends lies rounding alone.
        (gain / self.variation).clamp(0.0, 1.0)
    }
}

/// Values from the `first` on, one a lane; beyond the last, the last.
pub(crate) fn lanes<const L: usize>(values: &[f64], first: usize) -> [f64; L] {
    std::array::from_fn(|l| values[(first + l).min(values.len() - 1)])
}

/// Cholesky factors of L matrices side by side, which leave out what follows from the rest, for normal equations of any kind.
pub(crate) struct Cholesky<const L: usize> {
    /// Number of unknowns.
    p: usize,
    /// Matrix, row by row; the lower half counts, and becomes the factor.
    pub matrix: Vec<[f64; L]>,
    /// After [`Cholesky::solve`]: the factor's solution, for [`Cholesky::unknowns`].
    pub solution: Vec<[f64; L]>,
}

impl<const L: usize> Cholesky<L> {
    pub fn new(p: usize) -> Self {
        Self { p, matrix: vec![[0.0; L]; p * p], solution: vec![[0.0; L]; p] }
    }

    /// Factors the matrices, and returns by how much χ² falls. A pivot of `least` or less is left out.
    pub fn solve(&mut self, right: impl Fn(usize) -> [f64; L], least: f64) -> [f64; L] {
        let p = self.p;
        let mut gain = [0.0; L];
        for i in 0..p {
            let (above, row) = self.matrix.split_at_mut(i * p);
            for j in 0..i {
                let other = &above[j * p..=j * p + j];
                let dot = dot(&row[..j], &other[..j]);
                let (diagonal, at) = (&other[j], &mut row[j]);
                for l in 0..L {
                    let divided = (at[l] - dot[l]) / diagonal[l];
                    at[l] = if diagonal[l] > 0.0 { divided } else { 0.0 };
                }
            }
            let (square, known) = (dot(&row[..i], &row[..i]), dot(&row[..i], &self.solution[..i]));
            let (right, at, solved) = (right(i), &mut row[i], &mut self.solution[i]);
            for l in 0..L {
                let pivot = at[l] - square[l];
                let root = pivot.sqrt();
                let found = (right[l] - known[l]) / root;
                let is_kept = pivot > least;
                at[l] = if is_kept { root } else { 0.0 };
                solved[l] = if is_kept { found } else { 0.0 };
                gain[l] += solved[l] * solved[l];
            }
        }
        gain
    }
}

impl Cholesky<1> {
    /// The unknowns, after [`Cholesky::solve`].
    pub fn unknowns(&self) -> Vec<f64> {
        let p = self.p;
        let mut x: Vec<f64> = self.solution.iter().map(|x| x[0]).collect();
        for i in (0..p).rev() {
            let diagonal = self.matrix[i * p + i][0];
            if diagonal == 0.0 {
                x[i] = 0.0;
                continue;
            }
            for j in i + 1..p {
                x[i] -= self.matrix[j * p + i][0] * x[j];
            }
            x[i] /= diagonal;
        }
        x
    }
}

/// The sum of products, lane by lane.
fn dot<const L: usize>(a: &[[f64; L]], b: &[[f64; L]]) -> [f64; L] {
    let mut sum = [0.0; L];
    for (a, b) in a.iter().zip(b) {
        for l in 0..L {
            sum[l] += a[l] * b[l];
        }
    }
    sum
}

/// The normal equations of a mean and harmonics at L frequencies side by side.
pub(super) struct Normal<const L: usize> {
    harmonics: usize,
    /// Σ w cos kωt, Σ w sin kωt for k from 0 to twice the harmonics.
    pub weights: Vec<[[f64; L]; 2]>,
    /// Σ w y cos kωt, Σ w y sin kωt for k from 1.
    pub values: Vec<[[f64; L]; 2]>,
    factor: Cholesky<L>,
}

impl<const L: usize> Normal<L> {
    pub fn new(harmonics: usize) -> Self {
        let p = 2 * harmonics;
        Self {
            harmonics,
            weights: vec![[[0.0; L]; 2]; p + 1],
            values: vec![[[0.0; L]; 2]; harmonics],
            factor: Cholesky::new(p),
        }
    }

    /// Returns the amounts by which the fit lowers χ². The mean is eliminated, then Cholesky.
    pub fn reduction(&mut self, total: f64) -> [f64; L] {
        let p = 2 * self.harmonics;
        self.weights[0] = [[total; L], [0.0; L]];
        let matrix = &mut self.factor.matrix;
        for i in 1..=self.harmonics {
            for j in 1..=i {
                let of = |k: usize| &self.weights[k];
                let ([cp, sp], [cm, sm], [ci, si], [cj, sj]) = (of(i + j), of(i - j), of(i), of(j));
                let at = |a: usize, b: usize| (2 * (i - 1) + a) * p + 2 * (j - 1) + b;
                // In pairs: cos i cos j and sin i sin j, sin i cos j and cos i sin j.
                matrix[at(0, 0)] =
                    std::array::from_fn(|l| 0.5 * (cm[l] + cp[l]) - ci[l] * cj[l] / total);
                matrix[at(1, 1)] =
                    std::array::from_fn(|l| 0.5 * (cm[l] - cp[l]) - si[l] * sj[l] / total);
                matrix[at(1, 0)] =
                    std::array::from_fn(|l| 0.5 * (sp[l] + sm[l]) - si[l] * cj[l] / total);
                matrix[at(0, 1)] =
                    std::array::from_fn(|l| 0.5 * (sp[l] - sm[l]) - ci[l] * sj[l] / total);
            }
        }
        let values = &self.values;
        self.factor.solve(|i| values[i / 2][i % 2], LEAST_PIVOT * total)
    }
}

impl Normal<1> {
    /// The coefficients [cos, sin] of the harmonics, after [`Normal::reduction`], and the mean beside them.
    pub fn coefficients(&self, total: f64) -> (f64, Vec<[f64; 2]>) {
        let x = self.factor.unknowns();
        let pairs: Vec<[f64; 2]> = x.chunks_exact(2).map(|c| [c[0], c[1]]).collect();
        let shared: f64 = pairs
            .iter()
            .zip(&self.weights[1..])
            .map(|(c, [cos, sin])| c[0] * cos[0] + c[1] * sin[0])
            .sum();
        (-shared / total, pairs)
    }
}
