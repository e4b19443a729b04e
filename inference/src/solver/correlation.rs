//! Intervals that hold where residuals hang together in time: where a model is wrong for several samples at a time, and in all channels together.
//!
//! The variance of a sample's residual is s² (D + v vᵀ) of the stated noise, and that of an error of the model: a part of the light that wanders through a curve with a correlation time, partly the same in all channels.
//! The error's size, its time and the part that the channels share are not known. Each place of a grid of them (flat in the logarithms of size and time) counts by its restricted likelihood, which has lost as many degrees of
//! freedom as the fit has parameters (Patterson and Thompson 1971, Biometrika 58, 545). The estimates stay those of the fit. At each place of the grid their covariance is that of least squares whose errors have this
//! covariance (the "sandwich" A Ω Aᵀ); an interval has 95 % of the mixture of the normal distributions of all places, so that it is as wide as few correlation times in a pass make it.
//!
//! Two forms of wandering stand beside one another, of equal weight: exp(−t/τ), rough, and (1 + 2t/τ) exp(−2t/τ), smooth (Matérn, ν = 3/2). Both have the integral τ. Their likelihood is that of a Kalman filter, whose
//! cost goes with the number of samples.

use super::whiten::{PerSample, Whitener};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::Serialize;
use sunglint_numerics::basis::{Basis, norm};

/// Two-sided 95 % of a normal distribution.
const Z95: f64 = 1.959_963_984_540_054;
/// Twice the logarithm of the likelihood's ratio above which residuals hang together. Independent ones have more in 2 to 3 of 100 fits.
const SIGNIFICANT: f64 = 6.0;
/// Degrees of freedom below which nothing is looked for.
const FEW: usize = 10;
/// Parts of the error's variance that all channels share.
const SHARED: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];
/// Correlation times between half a step and a curve's length: factor from one to the next.
const TIMES: f64 = 2.0;
/// Variance of the error over that of the noise, in the mean over all samples: the least times the number of samples, the largest, and the factor from one to the next.
const SIZES: (f64, f64, f64) = (0.3, 300.0, 3.2);
/// Places with a logarithm of the likelihood that is lower by more than this are left out.
const FAINT: f64 = 7.0;
/// Places along a side of a grid that was narrowed.
const SIDE: usize = 9;
/// How often a grid is narrowed at most.
const NARROWED: usize = 4;
/// Places near the best of a grid which is narrow enough.
const ENOUGH: usize = 20;
/// The same as [`FAINT`] of a whole grid's best place, as long as grids are narrowed: the first ones step over what lies between their places.
const FAINT_GRID: [f64; NARROWED] = [40.0, 20.0, 10.0, FAINT];
/// Rows of which a likelihood is computed at most; of more, neighbours are joined.
const ROWS: usize = 1200;
/// Steps without a sample that end a block of neighbours.
const GAP: f64 = 3.0;
/// A column of which less than this stands upright on the others is their combination.
const PARALLEL: f64 = 1e-9;

/// Residuals that hang together: what is missing in the model lasts for a time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ResidualCorrelation {
    /// Correlation time of the model's error: the integral of its autocorrelation, s.
    pub time_s: f64,
    /// The same over the usual step between samples.
    pub samples: f64,
    /// Standard deviation of the model's error, as a part of the light.
    pub model_error: f64,
    /// Part of that error's variance which all channels share; 1 where there is one channel.
    pub in_common: f64,
    /// Twice the logarithm of the likelihood over that of independent residuals.
    pub log_likelihood_ratio: f64,
}

/// Form of the wandering.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Form {
    Rough,
    Smooth,
}

impl Form {
    /// Numbers that a wandering quantity keeps.
    fn size(self) -> usize {
        match self {
            Self::Rough => 1,
            Self::Smooth => 2,
        }
    }

    /// Factors by which they go on after a time, for a correlation time of 1, row by row: with unit matrices for their covariance where nothing is known of them.
    fn after(self, dt: f64) -> [f64; 4] {
        match self {
            Self::Rough => [(-dt).exp(), 0.0, 0.0, 0.0],
            Self::Smooth => {
                let a = 2.0 * dt;
                let e = (-a).exp();
                [(1.0 + a) * e, a * e, -a * e, (1.0 - a) * e]
            }
        }
    }
}

/// A moment of a curve: rows of whitened samples.
#[derive(Debug, Clone)]
struct Moment {
    /// Since the moment before of the same curve; `None` of a curve's first.
    dt: Option<f64>,
    first: usize,
    /// Rows of factors: what an error of 1 of all channels' light does to it, and of each channel's.
    rows: Vec<Vec<f64>>,
}

/// Curves as a fit left them.
pub(super) struct Residuals {
    moments: Vec<Moment>,
    /// Neighbours joined where there are many: what an error that stays the same over them does. All that is faster is in the variance of their rows.
    blocks: Vec<Moment>,
    channels: usize,
    /// Numbers of each row of the blocks: an orthonormal basis of what was fitted, and at last what is left.
    numbers: Vec<Vec<f64>>,
    /// Variance of single rows.
    variance: f64,
    /// Median step of the samples and of the blocks, longest curve, s.
    step_s: f64,
    block_s: f64,
    span_s: f64,
}

/// The median of the steps, s.
fn usual_step(moments: &[Moment]) -> Option<f64> {
    let steps = moments.iter().filter_map(|m| m.dt).filter(|dt| *dt > 0.0);
    sunglint_numerics::order::median(steps)
}

/// Joins `length` neighbours at a time, with the numbers of their rows: the part of them that an error of a channel's light, the same over the block, does something to. Rows stay independent and of the same variance.
fn joined(
    moments: &[Moment],
    numbers: &[Vec<f64>],
    length: usize,
    longest_s: f64,
) -> (Vec<Moment>, Vec<Vec<f64>>) {
    let (mut blocks, mut joined) = (Vec::<Moment>::new(), Vec::<Vec<f64>>::new());
    let (mut from, mut before_s) = (0, f64::NAN);
    while from < moments.len() {
        // Moments of the block since its first.
        let mut at_s = vec![0.0];
        while let Some(Moment { dt: Some(dt), .. }) = moments.get(from + at_s.len()) {
            if at_s.len() == length || *dt > longest_s {
                break;
            }
            at_s.push(at_s[at_s.len() - 1] + dt);
        }
        let of = &moments[from..from + at_s.len()];
        let middle_s = at_s.iter().sum::<f64>() / at_s.len() as f64;
        let dt = of[0].dt.map(|dt| before_s + dt + middle_s);
        before_s = at_s[at_s.len() - 1] - middle_s;
        let rows: Vec<(&Vec<f64>, &Vec<f64>)> = (of.iter())
            .flat_map(|m| m.rows.iter().enumerate().map(|(k, row)| (row, &numbers[m.first + k])))
            .collect();
        let sources = rows[0].0.len();
        let (mut basis, mut units) = (Basis::default(), Vec::<Vec<f64>>::new());
        for channel in 1..sources {
            let column: Vec<f64> = rows.iter().map(|(h, _)| h[channel]).collect();
            push(&mut basis, &mut units, column);
        }
        let along = |unit: &[f64], of: &dyn Fn(usize) -> f64| -> f64 {
            unit.iter().enumerate().map(|(k, u)| u * of(k)).sum()
        };
        let first = joined.len();
        let all = units
            .iter()
            .map(|u| (0..sources).map(|s| along(u, &|k| rows[k].0[s])).collect::<Vec<f64>>());
        let all = all.collect();
        let count = rows[0].1.len();
        joined.extend(
            units
                .iter()
                .map(|u| (0..count).map(|j| along(u, &|k| rows[k].1[j])).collect::<Vec<f64>>()),
        );
        blocks.push(Moment { dt, first, rows: all });
        from += at_s.len();
    }
    (blocks, joined)
}

/// Adds to orthonormal columns what stands upright on them.
fn push(basis: &mut Basis, columns: &mut Vec<Vec<f64>>, mut column: Vec<f64>) {
    let size = norm(&column);
    if !(size.is_finite() && size > 0.0) {
        return;
    }
    basis.project_out(&mut column);
    let left = norm(&column);
    if left > PARALLEL * size {
        column.iter_mut().for_each(|v| *v /= left);
        basis.push(&column, PARALLEL);
        columns.push(column);
    }
}

/// A place of the grid.
#[derive(Debug, Clone, Copy)]
struct Place {
    form: Form,
    shared: f64,
    /// Logarithm of the time, s.
    time: f64,
    /// Logarithm of the variance of the relative error over s².
    size: f64,
    /// Logarithm of the restricted likelihood, and of the weight of its cell.
    likelihood: f64,
    cell: f64,
    s2: f64,
}

/// Range of the logarithms of times and sizes, and its places.
#[derive(Debug, Clone)]
struct Grid {
    time: (f64, f64, usize),
    size: (f64, f64, usize),
}

impl Grid {
    fn at((low, high, count): (f64, f64, usize), k: usize) -> f64 {
        low + (high - low) * k as f64 / (count.max(2) - 1) as f64
    }

    fn step((low, high, count): (f64, f64, usize)) -> f64 {
        (high - low) / (count.max(2) - 1) as f64
    }
}

impl Residuals {
    /// Takes what is `left` of whitened rows, beside what was fitted: the rows of `pull`, and `nuisance`, columns that all samples of a channel have in common. `rates` are the model's. `None` where there is too little.
    pub fn new(
        whitener: &Whitener,
        time_s: &[Vec<f64>],
        rates: &PerSample,
        left: &DVector<f64>,
        pull: &DMatrix<f64>,
        nuisance: &[DVector<f64>],
    ) -> Option<Self> {
        let channels = rates.first()?.ncols();
        let rows = whitener.rows;
        let (mut basis, mut columns) = (Basis::default(), Vec::new());
        let fitted = pull.row_iter().map(|row| row.iter().take(rows).copied().collect::<Vec<_>>());
        let other = nuisance.iter().map(|column| column.iter().take(rows).copied().collect());
        for column in fitted.chain(other) {
            push(&mut basis, &mut columns, column);
        }
        let count = columns.len();
        if rows < count + FEW {
            return None;
        }
        let mut left: Vec<f64> = left.iter().take(rows).copied().collect();
        let numbers: Vec<Vec<f64>> = (0..rows)
            .map(|row| columns.iter().map(|c| c[row]).chain([left[row]]).collect())
            .collect();
        basis.project_out(&mut left);
        let variance = left.iter().map(|v| v * v).sum::<f64>() / (rows - count) as f64;
        let (mut moments, mut span_s) = (Vec::new(), 0.0_f64);
        let mut before: Option<(usize, f64)> = None;
        let mut first_s = 0.0;
        for epoch in &whitener.epochs {
            let now = *time_s.get(epoch.pass)?.get(epoch.epoch)?;
            let dt = before.filter(|(pass, _)| *pass == epoch.pass).map(|(_, s)| (now - s).abs());
            match dt {
                Some(_) => span_s = span_s.max((now - first_s).abs()),
                None => first_s = now,
            }
            before = Some((epoch.pass, now));
            let mut of = vec![vec![0.0; channels + 1]; epoch.channels.len()];
            let mut column = vec![0.0; epoch.channels.len()];
            for (k, c) in epoch.channels.iter().enumerate() {
                column.fill(0.0);
                column[k] = rates[epoch.pass][[epoch.epoch, *c]];
                epoch.apply(&mut column);
                for (row, v) in of.iter_mut().zip(&column) {
                    row[0] += v;
                    row[c + 1] = *v;
                }
            }
            moments.push(Moment { dt, first: epoch.row, rows: of });
        }
        let step_s = usual_step(&moments)?;
        let length = rows.div_ceil(ROWS);
        let (blocks, numbers) = match length {
            1 => (moments.clone(), numbers),
            length => joined(&moments, &numbers, length, GAP * step_s),
        };
        let block_s = usual_step(&blocks)?;
        let enough = span_s > 2.0 * block_s && numbers.len() >= count + FEW;
        let found = Self { moments, blocks, channels, numbers, variance, step_s, block_s, span_s };
        enough.then_some(found)
    }

    /// Wandering quantities that a part in common asks for, each with its part of the variance: 0 is what all channels share, then each channel's own.
    fn sources(&self, shared: f64) -> Vec<(usize, f64)> {
        let own = (1..=self.channels).map(|c| (c, 1.0 - shared));
        std::iter::once((0, shared)).chain(own).filter(|(_, part)| *part > 0.0).collect()
    }

    /// The parts in common that are looked at.
    fn shared(&self) -> &'static [f64] {
        if self.channels == 1 { &SHARED[4..] } else { &SHARED }
    }

    /// Restricted log likelihood, s² at its most likely, and s² there. `size` is the variance of the relative error over s².
    fn likelihood(&self, form: Form, time_s: f64, size: f64, shared: f64) -> Option<(f64, f64)> {
        let sources = self.sources(shared);
        let b = form.size();
        let n = b * sources.len();
        let count = self.numbers[0].len();
        // Covariance and means of what wanders, each of the numbers having its own mean.
        let (mut p, mut mean) = (vec![0.0; n * n], vec![0.0; n * count]);
        let mut gram = vec![0.0; count * count];
        let (mut ln_f, mut along, mut e) = (0.0, vec![0.0; n], vec![0.0; count]);
        let mut next = vec![0.0; n * n];
        for moment in &self.blocks {
            match moment.dt {
                None => {
                    p.fill(0.0);
                    mean.fill(0.0);
                    for (k, (_, part)) in sources.iter().enumerate() {
                        (0..b).for_each(|i| p[(b * k + i) * (n + 1)] = size * part);
                    }
                }
                Some(dt) => {
                    let f = form.after(dt / time_s);
                    if b == 1 {
                        mean.iter_mut().for_each(|v| *v *= f[0]);
                        p.iter_mut().for_each(|v| *v *= f[0] * f[0]);
                    } else {
                        for k in 0..sources.len() {
                            for j in 0..count {
                                let (x, y) =
                                    (mean[2 * k * count + j], mean[(2 * k + 1) * count + j]);
                                mean[2 * k * count + j] = f[0] * x + f[1] * y;
                                mean[(2 * k + 1) * count + j] = f[2] * x + f[3] * y;
                            }
                        }
                        // F P Fᵀ, block by block.
                        for k in 0..sources.len() {
                            for j in 0..n {
                                let (x, y) = (p[2 * k * n + j], p[(2 * k + 1) * n + j]);
                                next[2 * k * n + j] = f[0] * x + f[1] * y;
                                next[(2 * k + 1) * n + j] = f[2] * x + f[3] * y;
                            }
                        }
                        for i in 0..n {
                            for k in 0..sources.len() {
                                let (x, y) = (next[i * n + 2 * k], next[i * n + 2 * k + 1]);
                                p[i * n + 2 * k] = f[0] * x + f[1] * y;
                                p[i * n + 2 * k + 1] = f[2] * x + f[3] * y;
                            }
                        }
                    }
                    // What comes anew: I − F Fᵀ.
                    for (k, (_, part)) in sources.iter().enumerate() {
                        let variance = size * part;
                        let at = |i: usize, j: usize| (b * k + i) * n + b * k + j;
                        if b == 1 {
                            p[at(0, 0)] += variance * (1.0 - f[0] * f[0]);
                        } else {
                            p[at(0, 0)] += variance * (1.0 - f[0] * f[0] - f[1] * f[1]);
                            p[at(1, 1)] += variance * (1.0 - f[2] * f[2] - f[3] * f[3]);
                            let across = variance * (f[0] * f[2] + f[1] * f[3]);
                            p[at(0, 1)] -= across;
                            p[at(1, 0)] -= across;
                        }
                    }
                }
            }
            for (r, row) in moment.rows.iter().enumerate() {
                along.fill(0.0);
                for (k, (source, _)) in sources.iter().enumerate() {
                    let h = row[*source];
                    if h != 0.0 {
                        let of = &p[b * k * n..(b * k + 1) * n];
                        along.iter_mut().zip(of).for_each(|(a, p)| *a += h * p);
                    }
                }
                let mut f = 1.0;
                e.copy_from_slice(&self.numbers[moment.first + r]);
                for (k, (source, _)) in sources.iter().enumerate() {
                    let h = row[*source];
                    if h != 0.0 {
                        f += h * along[b * k];
                        let of = &mean[b * k * count..(b * k + 1) * count];
                        e.iter_mut().zip(of).for_each(|(e, m)| *e -= h * m);
                    }
                }
                ln_f += f.ln();
                for i in 0..n {
                    let gain = along[i] / f;
                    if gain != 0.0 {
                        let of = &mut p[i * n..(i + 1) * n];
                        of.iter_mut().zip(&along).for_each(|(p, a)| *p -= gain * a);
                        let of = &mut mean[i * count..(i + 1) * count];
                        of.iter_mut().zip(&e).for_each(|(m, e)| *m += gain * e);
                    }
                }
                for i in 0..count {
                    let part = e[i] / f;
                    let of = &mut gram[i * count..i * count + i + 1];
                    of.iter_mut().zip(&e).for_each(|(g, e)| *g += part * e);
                }
            }
        }
        // The last pivot of Cholesky's root is the sum of squares about the fit, the others the determinant.
        let full = DMatrix::from_fn(count, count, |i, j| gram[i.max(j) * count + i.min(j)]);
        let root = full.cholesky()?.unpack();
        let fitted = count - 1;
        let sum = root[(fitted, fitted)].powi(2);
        let determinant: f64 = (0..fitted).map(|k| 2.0 * root[(k, k)].ln()).sum();
        let freedom = (self.numbers.len() - fitted) as f64;
        let s2 = sum / freedom;
        let found = -0.5 * (ln_f + determinant + freedom * (s2.ln() + 1.0));
        found.is_finite().then_some((found, s2))
    }

    /// The mean square of what an error of all the light does to a row.
    fn leverage(&self) -> f64 {
        let all = self.blocks.iter().flat_map(|m| &m.rows);
        let sum: f64 = all.map(|row| row[1..].iter().map(|h| h * h).sum::<f64>()).sum();
        sum / self.numbers.len() as f64
    }

    fn of_grid(&self, form: Form, shared: f64, grid: &Grid) -> Vec<Place> {
        let cell = (Grid::step(grid.time) * Grid::step(grid.size)).ln();
        let count = grid.time.2 * grid.size.2;
        let one = |k: usize| {
            let time = Grid::at(grid.time, k / grid.size.2);
            let size = Grid::at(grid.size, k % grid.size.2);
            let (likelihood, s2) = self.likelihood(form, time.exp(), size.exp(), shared)?;
            Some(Place { form, shared, time, size, likelihood, cell, s2 })
        };
        (0..count).into_par_iter().filter_map(one).collect()
    }

    /// The places that count, and twice the logarithm of the best one's likelihood over that of independent residuals; `None` where they do not hang together.
    fn places(&self) -> Option<(Vec<Place>, f64)> {
        let (alone, s2) = self.likelihood(Form::Rough, self.step_s, 0.0, 1.0)?;
        // Blocks of independent samples have the variance of single ones.
        let freedom = (self.numbers.len() + 1 - self.numbers[0].len()) as f64;
        let over = s2 / self.variance;
        let alone = alone - 0.5 * freedom * (over - 1.0 - over.ln());
        let leverage = self.leverage();
        let counted = |low: f64, high: f64, factor: f64| {
            let count = ((high - low) / factor.ln()).ceil() as usize + 1;
            (low, high, count.max(3))
        };
        let (least, largest, factor) = SIZES;
        let coarse = Grid {
            time: counted((0.5 * self.block_s).ln(), self.span_s.ln(), TIMES),
            size: counted(
                (least / (leverage * self.numbers.len() as f64)).ln(),
                (largest / leverage).ln(),
                factor,
            ),
        };
        let best = |places: &[Place]| {
            places.iter().map(|p| p.likelihood).fold(f64::NEG_INFINITY, f64::max)
        };
        // Most data say nothing: that is seen by the two ends.
        let few = if self.channels == 1 { &SHARED[4..] } else { &[0.0, 1.0][..] };
        let mut known: Vec<(Form, f64, Vec<Place>)> = few
            .iter()
            .map(|shared| (Form::Rough, *shared, self.of_grid(Form::Rough, *shared, &coarse)))
            .collect();
        let first = known.iter().map(|(.., p)| best(p)).fold(f64::NEG_INFINITY, f64::max);
        // The best place lies between those of the coarse grid.
        if 2.0 * (first - alone) < 0.5 * SIGNIFICANT {
            return None;
        }
        for form in [Form::Rough, Form::Smooth] {
            for shared in self.shared() {
                if !known.iter().any(|(f, s, _)| *f == form && s == shared) {
                    known.push((form, *shared, self.of_grid(form, *shared, &coarse)));
                }
            }
        }
        let mut grids = vec![coarse; known.len()];
        for faint in FAINT_GRID {
            let most = known.iter().map(|(.., p)| best(p)).fold(f64::NEG_INFINITY, f64::max);
            let mut narrowed = false;
            for ((form, shared, places), grid) in known.iter_mut().zip(&mut grids) {
                let own = best(places);
                let near: Vec<&Place> =
                    places.iter().filter(|p| p.likelihood > own - FAINT).collect();
                if own < most - faint || near.len() >= ENOUGH {
                    continue;
                }
                let around = |of: &dyn Fn(&Place) -> f64, (low, high, count): (f64, f64, usize)| {
                    let step = Grid::step((low, high, count));
                    let ends = near.iter().map(|p| of(p));
                    let (a, b) = ends
                        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
                    ((a - step).max(low), (b + step).min(high), SIDE)
                };
                let finer = Grid {
                    time: around(&|p| p.time, grid.time),
                    size: around(&|p| p.size, grid.size),
                };
                *places = self.of_grid(*form, *shared, &finer);
                *grid = finer;
                narrowed = true;
            }
            if !narrowed {
                break;
            }
        }
        let mut all: Vec<Place> = known.into_iter().flat_map(|(.., p)| p).collect();
        let most = best(&all);
        let ratio = 2.0 * (most - alone);
        all.retain(|p| p.likelihood > most - FAINT);
        (ratio > SIGNIFICANT).then_some((all, ratio))
    }

    /// A K Aᵀ of some rows `a` for errors of variance 1 which all channels share, and for such of each channel alone.
    fn through(&self, form: Form, time_s: f64, a: &DMatrix<f64>) -> [DMatrix<f64>; 2] {
        let n = a.nrows();
        let sources = self.channels + 1;
        let mut sums = [DMatrix::zeros(n, n), DMatrix::zeros(n, n)];
        // What came before, of each source and row, with its slope.
        let (mut value, mut slope) = (vec![0.0; sources * n], vec![0.0; sources * n]);
        let mut now = vec![0.0; sources * n];
        for moment in &self.moments {
            match moment.dt {
                None => {
                    value.fill(0.0);
                    slope.fill(0.0);
                }
                Some(dt) => {
                    let f = form.after(dt / time_s);
                    for (x, y) in value.iter_mut().zip(&mut slope) {
                        (*x, *y) = (f[0] * *x + f[1] * *y, f[2] * *x + f[3] * *y);
                    }
                }
            }
            now.fill(0.0);
            for (r, row) in moment.rows.iter().enumerate() {
                for (s, h) in row.iter().enumerate().filter(|(_, h)| **h != 0.0) {
                    (0..n).for_each(|i| now[s * n + i] += h * a[(i, moment.first + r)]);
                }
            }
            for s in 0..sources {
                let sum = &mut sums[usize::from(s > 0)];
                let (u, f) = (&now[s * n..(s + 1) * n], &value[s * n..(s + 1) * n]);
                for i in 0..n {
                    for j in 0..n {
                        sum[(i, j)] += u[i] * u[j] + u[i] * f[j] + f[i] * u[j];
                    }
                }
            }
            value.iter_mut().zip(&now).for_each(|(x, u)| *x += u);
        }
        sums
    }

    /// Correlation of the residuals, and what it does to numbers that are linear in the rows, by the matrix `a`. `None` where residuals do not hang together.
    pub fn spread(&self, a: &DMatrix<f64>) -> Option<(ResidualCorrelation, Spread)> {
        let (places, log_likelihood_ratio) = self.places()?;
        let most = places.iter().map(|p| p.likelihood + p.cell).fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> =
            places.iter().map(|p| (p.likelihood + p.cell - most).exp()).collect();
        let sum: f64 = weights.iter().sum();
        let plain = a * a.transpose();
        // Many places differ in size alone.
        let key = |p: &Place| (p.form == Form::Smooth, p.time.to_bits());
        let mut times: Vec<(bool, u64)> = places.iter().map(key).collect();
        times.sort_unstable();
        times.dedup();
        let form = |smooth: bool| if smooth { Form::Smooth } else { Form::Rough };
        let through: Vec<[DMatrix<f64>; 2]> = times
            .par_iter()
            .map(|(smooth, time)| self.through(form(*smooth), f64::from_bits(*time).exp(), a))
            .collect();
        let one = |(p, weight): (&Place, &f64)| {
            let [common, own] = &through[times.partition_point(|t| *t < key(p))];
            let error = common * p.shared + own * (1.0 - p.shared);
            (weight / sum, (&plain + error * p.size.exp()) * p.s2)
        };
        let spread: Vec<(f64, DMatrix<f64>)> = places.iter().zip(&weights).map(one).collect();
        let mean = |of: &dyn Fn(&Place) -> f64| -> f64 {
            places.iter().zip(&weights).map(|(p, w)| of(p) * w).sum::<f64>() / sum
        };
        let time_s = mean(&|p| p.time).exp();
        let found = ResidualCorrelation {
            time_s,
            samples: time_s / self.step_s,
            model_error: (0.5 * mean(&|p| p.size + p.s2.ln())).exp(),
            in_common: mean(&|p| p.shared),
            log_likelihood_ratio,
        };
        Some((found, Spread { of: spread, plain }))
    }
}

/// Covariances that may be, each with its probability.
pub(super) struct Spread {
    of: Vec<(f64, DMatrix<f64>)>,
    /// A Aᵀ, of rows that are independent and of variance 1.
    pub plain: DMatrix<f64>,
}

impl Spread {
    /// The mean covariance.
    pub fn mean(&self) -> DMatrix<f64> {
        let n = self.plain.nrows();
        self.of.iter().fold(DMatrix::zeros(n, n), |sum, (weight, one)| sum + one * *weight)
    }

    /// Half of the interval that holds 95 % of a number's error, which has a variance `beside` of its own.
    pub fn half(&self, number: usize, beside: f64) -> f64 {
        let sigmas: Vec<(f64, f64)> = (self.of.iter())
            .map(|(weight, one)| (*weight, (one[(number, number)] + beside).max(0.0).sqrt()))
            .collect();
        let outside = |half: f64| -> f64 {
            let one = |(weight, sigma): &(f64, f64)| {
                weight * libm::erfc(half / (sigma * std::f64::consts::SQRT_2))
            };
            sigmas.iter().filter(|(_, sigma)| *sigma > 0.0).map(one).sum()
        };
        let (mut low, mut high) = (0.0, 20.0 * sigmas.iter().map(|(_, s)| *s).fold(0.0, f64::max));
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if outside(middle) > 0.05 { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    /// Half of the interval over what it is for independent rows of variance `scale`, not below 1.
    pub fn wider(&self, number: usize, scale: f64, beside: f64) -> f64 {
        let before = Z95 * (scale * self.plain[(number, number)] + beside).sqrt();
        let wider = self.half(number, beside) / before;
        if wider.is_finite() { wider.max(1.0) } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solver::Data;
    use ndarray::Array2;

    /// Two curves of three channels at uneven moments, one sample missing, scintillation in common.
    fn curves() -> (Whitener, Vec<Vec<f64>>, PerSample) {
        let rate = |p: usize, n: usize| {
            Array2::from_shape_fn((n, 3), |(i, c)| 80.0 + ((7 * i + 13 * c + 5 * p) % 23) as f64)
        };
        let rates = vec![rate(0, 9), rate(1, 6)];
        let mut data: Vec<Data> =
            rates.iter().map(|r| Data::new("a", r.clone(), r.map(|r| 0.02 * r + 1.0))).collect();
        data[0].used[[4, 1]] = false;
        for d in &mut data {
            d.common_variance.fill(0.015_f64.powi(2));
        }
        let times = vec![
            vec![0.0, 1.0, 2.1, 3.0, 4.5, 9.0, 10.0, 10.5, 11.0],
            vec![0.0, 0.7, 1.4, 2.0, 2.2, 7.0],
        ];
        (Whitener::new(&data, None, None), times, rates)
    }

    /// The covariance of whitened rows for errors of variance 1, row by row, by the closed forms of the autocorrelation; and of what all channels share.
    fn dense(
        whitener: &Whitener,
        times: &[Vec<f64>],
        rates: &PerSample,
        form: Form,
        time_s: f64,
        shared: f64,
    ) -> DMatrix<f64> {
        let mut places = Vec::new();
        let mut white = DMatrix::zeros(whitener.rows, whitener.rows);
        for epoch in &whitener.epochs {
            let count = epoch.channels.len();
            for (k, c) in epoch.channels.iter().enumerate() {
                places.push((epoch.pass, epoch.epoch, *c));
                let mut unit = vec![0.0; count];
                unit[k] = 1.0;
                epoch.apply(&mut unit);
                (0..count).for_each(|j| white[(epoch.row + j, epoch.row + k)] = unit[j]);
            }
        }
        let one = |a: usize, b: usize| {
            let ((p, i, c), (q, j, d)) = (places[a], places[b]);
            if p != q {
                return 0.0;
            }
            let lag = (times[p][i] - times[q][j]).abs() / time_s;
            let correlation = match form {
                Form::Rough => (-lag).exp(),
                Form::Smooth => (1.0 + 2.0 * lag) * (-2.0 * lag).exp(),
            };
            let part = if c == d { 1.0 } else { shared };
            part * correlation * rates[p][[i, c]] * rates[q][[j, d]]
        };
        let raw = DMatrix::from_fn(whitener.rows, whitener.rows, one);
        &white * raw * white.transpose()
    }

    /// Truth: the restricted likelihood and A K Aᵀ by dense matrices (nalgebra's LU and Cholesky) of the closed forms of both autocorrelations. Tolerance: 1e-9, rounding.
    #[test]
    fn likelihood_and_covariance_are_those_of_dense_matrices() {
        let (whitener, times, rates) = curves();
        let rows = whitener.rows;
        let chance = |k: usize| ((k as f64 * 0.754_877).fract() - 0.5) * 4.0;
        let left = DVector::from_fn(rows, |k, _| chance(k + 3));
        let pull = DMatrix::from_fn(2, rows, |i, k| 0.3 + (0.37 * ((i + 1) * k) as f64).sin());
        let found = Residuals::new(&whitener, &times, &rates, &left, &pull, &[]).unwrap();
        for form in [Form::Rough, Form::Smooth] {
            for (time_s, size, shared) in [(2.0, 3e-4, 0.5), (6.0, 2e-3, 1.0), (0.7, 1e-3, 0.0)] {
                let (own, s2) = found.likelihood(form, time_s, size, shared).unwrap();
                let k = dense(&whitener, &times, &rates, form, time_s, shared);
                let covariance = DMatrix::identity(rows, rows) + &k * size;
                let x = DMatrix::from_fn(rows, 2, |i, j| found.numbers[i][j]);
                let inverse = covariance.clone().try_inverse().unwrap();
                let normal = x.transpose() * &inverse * &x;
                let fitted =
                    normal.clone().try_inverse().unwrap() * x.transpose() * &inverse * &left;
                let off = &left - &x * fitted;
                let freedom = rows as f64 - 2.0;
                let truth_s2 = (off.transpose() * &inverse * &off)[0] / freedom;
                let truth = -0.5
                    * (covariance.determinant().ln()
                        + normal.determinant().ln()
                        + freedom * (truth_s2.ln() + 1.0));
                assert!((own - truth).abs() < 1e-9 * truth.abs().max(1.0), "{own} {truth}");
                assert!((s2 / truth_s2 - 1.0).abs() < 1e-9, "{s2} {truth_s2}");
                let [common, alone] = found.through(form, time_s, &pull);
                let through = common * shared + alone * (1.0 - shared);
                let truth = &pull * k * pull.transpose();
                assert!((&through - &truth).amax() < 1e-9 * truth.amax(), "{through} {truth}");
            }
        }
    }

    /// Truth: by hand. Four moments of two channels, each row of a channel doing as much to an error: a block of two has their sum over √2 in each channel, its leverage is √2 times as large, and its time is the middle; a gap ends a block.
    #[test]
    fn neighbours_are_joined_without_loss() {
        let moment = |dt: Option<f64>, first: usize| Moment {
            dt,
            first,
            rows: vec![vec![2.0, 2.0, 0.0], vec![3.0, 0.0, 3.0]],
        };
        let moments =
            [moment(None, 0), moment(Some(1.0), 2), moment(Some(1.0), 4), moment(Some(9.0), 6)];
        let numbers: Vec<Vec<f64>> = (0..8).map(|k| vec![f64::from(k)]).collect();
        let (blocks, found) = joined(&moments, &numbers, 2, 3.0);
        let root = 2_f64.sqrt();
        assert_eq!(blocks.iter().map(|b| b.dt).collect::<Vec<_>>(), [None, Some(1.5), Some(9.0)]);
        assert!(
            (found[0][0] - 2.0 / root).abs() < 1e-12 && (found[1][0] - 4.0 / root).abs() < 1e-12
        );
        assert!((blocks[0].rows[0][0] - 2.0 * root).abs() < 1e-12, "{blocks:?}");
        assert!(
            (blocks[0].rows[1][2] - 3.0 * root).abs() < 1e-12 && blocks[0].rows[1][1].abs() < 1e-12
        );
        assert_eq!((found[4][0], blocks[2].first), (6.0, 4));
    }

    /// Truth: closed form: of one normal distribution half an interval is 1.96 σ; of two of equal weight whose σ are 1 and 3 it is where erfc adds up to 0.1, found by hand: 4.9346 (P = 8e-7 and 0.1000).
    #[test]
    fn intervals_hold_95_percent_of_the_mixture() {
        let one = |weight, variance| (weight, DMatrix::from_element(1, 1, variance));
        let plain = DMatrix::identity(1, 1);
        let spread = Spread { of: vec![one(1.0, 4.0)], plain: plain.clone() };
        assert!((spread.half(0, 0.0) - 2.0 * Z95).abs() < 1e-9);
        assert!((spread.half(0, 5.0) - 3.0 * Z95).abs() < 1e-9);
        let spread = Spread { of: vec![one(0.5, 1.0), one(0.5, 9.0)], plain };
        assert!((spread.half(0, 0.0) - 4.9346).abs() < 1e-3, "{}", spread.half(0, 0.0));
        assert!((spread.mean()[0] - 5.0).abs() < 1e-12);
    }
}
