//! The way through a fit.

use super::estimate::{CHI95, Known, estimate};
use super::problem::{Problem, State};
use super::search::{self, Found, Held};
use super::whiten::{PerSample, Whitener};
use super::{
    Data, Estimate, Fit, FitError, FittedCurve, Free, IntervalMethod, Linear, Minimum, Model,
    ParameterKind, Search, Warning,
};
use nalgebra::DMatrix;
use ndarray::Array2;
use serde::{Deserialize, Serialize};
use sunglint_numerics::order::robust_sigma;

/// Rounds of weights that follow the model, at most.
const ROUNDS: usize = 15;
/// The same of a fit from which another begins.
const ROUNDS_OF_A_START: usize = 2;
/// Relative gain of χ² below which a descent ends that another one follows.
const COARSE: f64 = 1e-4;
/// Gain of χ², over the scale of the errors, below which the last descent ends where no profile of χ² is asked for: moves of all parameters together by less than a tenth of their σ.
const ENOUGH: f64 = 0.01;
/// Relative gain of χ² below which a descent ends whose place is compared with another's.
const EXACT: f64 = 1e-9;
/// Weights have settled where the model's rates change by less than this part of the noise.
const SETTLED: f64 = 0.01;
/// Minima nearer than this, in units of the box, are one.
const SAME: f64 = 1e-3;
/// Minima of a χ² that is more above the best are not worth a word (over the scale of the errors).
pub(crate) const WORTH: f64 = 25.0;
/// Iterations of a simplex for each parameter.
const SIMPLEX: u64 = 30;
/// The first size of a simplex, in units of the box.
const SIMPLEX_SIZE: f64 = 0.05;
/// How many of the simplices' ends are polished.
const POLISHED: usize = 3;
/// Sizes of simplices about the best minimum.
const SHAKEN: [f64; 3] = [0.02, 0.006, 0.002];
/// Iterations of the first descent from a start, which is for telling starts apart.
const FIRST: usize = 15;
/// Residuals above this reduced χ² are said to be large.
const POOR: f64 = 1.5;

/// How residuals count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Loss {
    /// By their squares: the best where noise is normal.
    Squares,
    /// Huber's: beyond 1.345 standard deviations linearly; 95 % as efficient where noise is normal.
    #[default]
    Huber,
    /// Student's t with four degrees of freedom: outliers count next to nothing.
    Student,
    /// Tukey's biweight: beyond 4.685 standard deviations not at all; and epochs that are off as a whole, all channels together, by more than four
    /// standard deviations are left out: clouds. Begun at what Huber's loss finds.
    Tukey,
}

const HUBER: f64 = 1.345;
const STUDENT: f64 = 4.0;
const TUKEY: f64 = 4.685;
/// Standard deviations of the factor common to an epoch's channels beyond which [`Loss::Tukey`] leaves the epoch out.
const CLOUD: f64 = 4.0;

impl Loss {
    /// ψ(u)/u, 1 at 0 and nowhere more.
    fn weight(self, u: f64) -> f64 {
        match self {
            Self::Squares => 1.0,
            Self::Huber if u.abs() <= HUBER => 1.0,
            Self::Huber => HUBER / u.abs(),
            Self::Student => STUDENT / (STUDENT + u * u),
            Self::Tukey => (1.0 - (u / TUKEY).powi(2)).max(0.0).powi(2),
        }
    }

    /// ψ'(u).
    fn slope(self, u: f64) -> f64 {
        match self {
            Self::Squares => 1.0,
            Self::Huber => f64::from(u8::from(u.abs() <= HUBER)),
            Self::Student => STUDENT * (STUDENT - u * u) / (STUDENT + u * u).powi(2),
            Self::Tukey => {
                let t = (u / TUKEY).powi(2);
                if t < 1.0 { (1.0 - t) * (1.0 - 5.0 * t) } else { 0.0 }
            }
        }
    }
}

/// Purpose of a fit, which decides what it may cost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Purpose {
    /// Values, uncertainties and intervals.
    #[default]
    Answer,
    /// Values and uncertainties; intervals by the covariance alone, where a profile would cost too much.
    Covariance,
    /// Values alone: they predict something.
    Values,
    /// A place from which another fit begins: two rounds of weights, one-sided differences.
    Start,
}

/// How a fit is made.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How residuals count.
    pub loss: Loss,
    /// Places that are looked at before the search; 0 searches from the start alone.
    pub places: usize,
    /// From how many of the best of them a search starts, the given start besides.
    pub starts: usize,
    /// The seed of the places.
    pub seed: u64,
    /// Largest number of steps of a descent. With 0 there is no descent: the search ends at the best place, and [`Fit::converged`] is false unless all parameters are linear.
    pub iterations: usize,
    /// Largest number of rounds in which simplices of three sizes look about the best minimum for a deeper one. A round that lowers χ² by less than 1 is the last.
    pub shakes: usize,
    /// Purpose of the fit.
    pub purpose: Purpose,
}

impl Default for Options {
    fn default() -> Self {
        let loss = Loss::default();
        Self {
            loss,
            places: 128,
            starts: 8,
            seed: 0,
            iterations: 60,
            shakes: 6,
            purpose: Purpose::Answer,
        }
    }
}

/// How far a fit is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Stage that the fit is at.
    pub stage: &'static str,
    /// How often the model was computed.
    pub evaluations: usize,
    /// The least sum of squares so far.
    pub chi2: f64,
}

/// Fits. Results depend on `options.seed`, not on the number of threads. A search that ends before it is at a minimum is no error:
/// [`Fit::converged`] is false, and what was reached is there.
///
/// # Errors
/// Input that makes no sense; no or too few samples; a start at which there is no model.
pub fn fit(
    data: &[Data],
    model: &mut dyn Model,
    free: &[Free],
    linear: &[Linear],
    options: &Options,
    progress: &mut dyn FnMut(Progress),
) -> Result<Fit, FitError> {
    let mut problem = Problem::new(data, model, free, linear)?;
    // By the measured rates, until the model's are near: what all samples of a night have in common must not be made good by shape or attitude.
    let measured: PerSample = data.iter().map(|curve| curve.rate.clone()).collect();
    problem.with_calibration(&measured, 1.0);
    // The last descents have limits of their own.
    problem.gain = (options.purpose != Purpose::Answer).then_some(COARSE);
    let most = options.iterations;
    let start = search::start(&problem);
    let first = problem.evaluate(&search::values(&problem, &start))?;
    let mut least = first.chi2;
    let mut tell = |stage, problem: &Problem, chi2: f64| {
        least = least.min(chi2);
        progress(Progress { stage, evaluations: problem.evaluations, chi2: least });
    };
    tell("start", &problem, first.chi2);

    let mut minima: Vec<Found> = Vec::new();
    if free.is_empty() {
        minima.push(Found { at: Vec::new(), chi2: first.chi2, converged: true });
    } else {
        let mut near = Vec::new();
        for place in starts(&mut problem, &start, options, &mut tell) {
            // Where there is no model on the way a simplex finds one.
            let found =
                match search::polish(&mut problem, &place, FIRST.min(most), false, Held::Local) {
                    Ok(found) => found,
                    Err(_) => {
                        let rounds = SIMPLEX * search::over_the_box(&problem) as u64;
                        search::simplex(&mut problem, &place, SIMPLEX_SIZE, rounds)?
                    }
                };
            tell("search", &problem, found.chi2);
            near.push(found);
        }
        near.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
        for (k, near) in near.iter().take(POLISHED).enumerate() {
            let mut found = search::polish(&mut problem, &near.at, most, false, Held::None)?;
            tell("search", &problem, found.chi2);
            if k == 0 && search::over_the_box(&problem) > 1 {
                found = shaken(&mut problem, found, options, &mut tell)?;
                if problem.free.iter().any(|f| f.search == Search::Near) {
                    let all = search::polish(&mut problem, &found.at, most, false, Held::None)?;
                    found = if all.chi2 <= found.chi2 { all } else { found };
                }
            }
            minima.push(found);
        }
        minima.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
        let mut distinct: Vec<Found> = Vec::new();
        for found in minima {
            if distinct.iter().all(|d| search::apart(&problem, &d.at, &found.at) > SAME) {
                distinct.push(found);
            }
        }
        minima = distinct;
    }

    // The noise by the model's rates, and what the loss makes of outliers, until both stand still.
    let mut best = minima[0].clone();
    if options.loss == Loss::Tukey {
        settle(&mut problem, &mut best, Loss::Huber, options, &mut tell)?;
    }
    let (mut state, mut settled) =
        settle(&mut problem, &mut best, options.loss, options, &mut tell)?;
    // By that noise another minimum may be the better one.
    let scale = (state.chi2 / freedom(&problem) as f64).max(1.0);
    let least = minima[0].chi2;
    minima.retain(|m| m.chi2 - least < 4.0 * WORTH * scale);
    let mut others: Vec<Found> = Vec::new();
    // Minima are told apart by where they are, so that all must be at the bottom. Values alone need the best one only.
    let told = matches!(options.purpose, Purpose::Answer | Purpose::Covariance);
    if told && minima.len() > 1 {
        problem.gain = Some(EXACT);
        if options.purpose == Purpose::Covariance {
            let converged = best.converged;
            best = search::polish(&mut problem, &best.at, most, true, Held::None)?;
            best.converged |= converged;
            state = problem.evaluate(&search::values(&problem, &best.at))?;
        }
    }
    for found in minima.iter().skip(1) {
        let found = search::polish(&mut problem, &found.at, most, told, Held::None)?;
        tell("other minima", &problem, found.chi2);
        let mut known = std::iter::once(&best).chain(&others);
        if known.all(|k| search::apart(&problem, &found.at, &k.at) > SAME) {
            others.push(found);
        }
    }
    problem.gain = (options.purpose != Purpose::Answer).then_some(COARSE);
    if let Some(k) = (0..others.len()).find(|k| others[*k].chi2 < state.chi2 - 1e-3) {
        others.push(std::mem::replace(&mut best, others[k].clone()));
        others.swap_remove(k);
        (state, settled) = settle(&mut problem, &mut best, options.loss, options, &mut tell)?;
    }
    let scale = (state.chi2 / freedom(&problem) as f64).max(1.0);
    if options.purpose != Purpose::Start && problem.keep_unconstrained(&state, scale * CHI95)? {
        (state, settled) = settle(&mut problem, &mut best, options.loss, options, &mut tell)?;
    }
    finish(problem, best, state, settled, others, options)
}

/// Simplices of several sizes about a minimum: where a body's edges and glints make the sum of squares rough, the next dent may be deeper.
fn shaken(
    problem: &mut Problem,
    mut best: Found,
    options: &Options,
    tell: &mut dyn FnMut(&'static str, &Problem, f64),
) -> Result<Found, FitError> {
    let rounds = SIMPLEX * search::over_the_box(problem) as u64 / 2;
    for _ in 0..options.shakes {
        let before = best.chi2;
        for size in SHAKEN {
            let near = search::simplex(problem, &best.at, size, rounds)?;
            if near.chi2 < best.chi2 - 0.1 {
                let found =
                    search::polish(problem, &near.at, options.iterations, false, Held::Local)?;
                tell("search", problem, found.chi2);
                if found.chi2 < best.chi2 {
                    best = found;
                }
            }
        }
        if best.chi2 > before - 1.0 {
            break;
        }
    }
    Ok(best)
}

/// Where searches start: the given place, and the best of some over the box.
fn starts(
    problem: &mut Problem,
    start: &[f64],
    options: &Options,
    tell: &mut dyn FnMut(&'static str, &Problem, f64),
) -> Vec<Vec<f64>> {
    let mut places: Vec<(f64, Vec<f64>)> = Vec::new();
    for place in search::places(problem, options.places, options.seed) {
        let chi2 = search::cost(problem, &place);
        tell("places", problem, chi2);
        places.push((chi2, place));
    }
    places.retain(|(chi2, _)| chi2.is_finite());
    places.sort_by(|a, b| a.0.total_cmp(&b.0));
    let drawn = places.into_iter().take(options.starts).map(|(_, place)| place);
    std::iter::once(start.to_vec()).chain(drawn).collect()
}

fn freedom(problem: &Problem) -> usize {
    let parameters = problem.free.len() + problem.linear.len();
    problem.rows().saturating_sub(parameters).max(1)
}

/// Largest number of rounds of weights that follow the model.
fn rounds(purpose: Purpose) -> usize {
    if purpose == Purpose::Start { ROUNDS_OF_A_START } else { ROUNDS }
}

/// Goes on from a minimum until noise and weights, which follow the model, stand still. Leaves the problem with them.
fn settle(
    problem: &mut Problem,
    best: &mut Found,
    loss: Loss,
    options: &Options,
    tell: &mut dyn FnMut(&'static str, &Problem, f64),
) -> Result<(State, bool), FitError> {
    let mut state = problem.evaluate(&search::values(problem, &best.at))?;
    // On the way to another fit the weights need not be the last word.
    let both = options.purpose == Purpose::Answer;
    for round in 0..rounds(options.purpose) {
        let (weights, centres) =
            weights(problem.data, &problem.calibrated(&state.rates), loss).unzip();
        let whitener = Whitener::new(problem.data, Some(&state.rates), weights.as_ref());
        if whitener.rows <= problem.free.len() + problem.linear.len() {
            // All but everything is an outlier: the noise before stays.
            return Ok((state, false));
        }
        // By the samples' scatter alone: a prior that the calibration's errors hold off is no noise of theirs.
        let scale = (problem.scatter(&state.rates) / freedom(problem) as f64).max(1.0);
        problem.whitener = whitener;
        problem.with_calibration(&state.rates, scale);
        problem.centres = centres;
        if matches!(options.purpose, Purpose::Covariance | Purpose::Values) {
            let scale = (state.chi2 / freedom(problem) as f64).max(1.0);
            problem.gain = Some(ENOUGH * scale / state.chi2.max(1.0));
        }
        if !problem.free.is_empty() {
            let converged = best.converged;
            *best = search::polish(problem, &best.at, options.iterations, both, Held::None)?;
            // What was at a minimum and cannot go lower is still there.
            best.converged |= converged && round > 0;
        }
        let next = problem.evaluate(&search::values(problem, &best.at))?;
        let moved = largest_change(problem.data, &state.rates, &next.rates);
        state = next;
        best.chi2 = state.chi2;
        tell("noise", problem, state.chi2);
        if moved < SETTLED {
            return Ok((state, true));
        }
    }
    Ok((state, false))
}

/// The largest change of a rate over its noise.
fn largest_change(data: &[Data], before: &PerSample, after: &PerSample) -> f64 {
    let mut largest = 0.0_f64;
    for (p, curve) in data.iter().enumerate() {
        for ((i, c), used) in curve.used.indexed_iter() {
            if *used {
                let change = (after[p][[i, c]] - before[p][[i, c]]).abs();
                largest = largest.max(change / noise(curve, i, c, after[p][[i, c]]));
            }
        }
    }
    largest
}

/// The standard deviation of a single sample, scintillation in it.
fn noise(curve: &Data, epoch: usize, channel: usize, model: f64) -> f64 {
    let own = curve.variance(epoch, channel, Some(model));
    (own + curve.common_variance[epoch] * model * model).sqrt()
}

/// Residuals over the noise of single samples; NaN where none counts.
fn pulls(data: &[Data], rates: &PerSample) -> PerSample {
    let one = |(curve, rates): (&Data, &Array2<f64>)| {
        Array2::from_shape_fn(rates.raw_dim(), |(i, c)| match curve.used[[i, c]] {
            true => (curve.rate[[i, c]] - rates[[i, c]]) / noise(curve, i, c, rates[[i, c]]),
            false => f64::NAN,
        })
    };
    data.iter().zip(rates).map(one).collect()
}

/// Residual of a sample as a loss judges it.
#[derive(Debug, Clone, Copy)]
struct Judged {
    /// Over the noise of single samples; NaN where it does not count.
    pull: f64,
    /// The same over what it is in light: below 1 where it is brighter than the model, above where it is fainter. 1 of what is no magnitude.
    bent: f64,
    /// Factor of its rate, from the mean of its noise to the median.
    centre: f64,
}

/// Residuals as a loss judges them: those of magnitudes in magnitudes, in which their noise is even. What stands for the noise in the mean, [`Data::in_the_mean`], holds for squares alone.
fn judged(data: &[Data], rates: &PerSample) -> Vec<Array2<Judged>> {
    let one = |(curve, rates): (&Data, &Array2<f64>)| {
        Array2::from_shape_fn(rates.raw_dim(), |(i, c)| {
            let (rate, model) = (curve.rate[[i, c]], rates[[i, c]]);
            let plain = |pull| Judged { pull, bent: 1.0, centre: 1.0 };
            match curve.log_variance(i, c) {
                _ if !curve.used[[i, c]] => plain(f64::NAN),
                Some(own) if model > 0.0 && rate > 0.0 => {
                    let centre = (0.5 * own).exp();
                    let off = centre * rate / model - 1.0;
                    let bent = if off == 0.0 { 1.0 } else { off.ln_1p() / off };
                    let pull = off.ln_1p() / (own + curve.common_variance[i]).sqrt();
                    Judged { pull, bent, centre }
                }
                _ => plain((rate - model) / noise(curve, i, c, model)),
            }
        })
    };
    data.iter().zip(rates).map(one).collect()
}

/// 1.4826 times the median of what is there, and no less than 1: where the noise is stated too small, all samples are no outliers.
fn spread(pulls: impl Iterator<Item = f64>) -> f64 {
    robust_sigma(pulls.filter(|p| p.is_finite())).map_or(1.0, |sigma| sigma.max(1.0))
}

/// Weights by the loss, 0 for what does not count, and factors of the rates that go with them; none for squares.
fn weights(data: &[Data], rates: &PerSample, loss: Loss) -> Option<(PerSample, PerSample)> {
    if loss == Loss::Squares {
        return None;
    }
    let judged = judged(data, rates);
    let width = spread(judged.iter().flatten().map(|j| j.pull));
    let weight = |j: &Judged| {
        if j.pull.is_finite() { j.bent * loss.weight(j.pull / width) } else { 0.0 }
    };
    let mut weights: PerSample = judged.iter().map(|all| all.map(weight)).collect();
    if loss == Loss::Tukey {
        let common = common_pulls(data, rates);
        let width = spread(common.iter().flatten().copied());
        for (weights, common) in weights.iter_mut().zip(&common) {
            for (i, pull) in common.iter().enumerate() {
                if pull.abs() > CLOUD * width {
                    weights.row_mut(i).fill(0.0);
                }
            }
        }
    }
    let centres = judged.iter().map(|all| all.map(|j| j.centre)).collect();
    Some((weights, centres))
}

/// The relative factor that an epoch's channels have in common, over its standard deviation: a column for each curve, NaN without a sample.
fn common_pulls(data: &[Data], rates: &PerSample) -> PerSample {
    let one = |(curve, rates): (&Data, &Array2<f64>)| {
        Array2::from_shape_fn((curve.epochs(), 1), |(i, _)| {
            let (mut weight, mut sum) = (0.0, 0.0);
            for c in (0..curve.channels()).filter(|c| curve.used[[i, *c]]) {
                let model = rates[[i, c]];
                let own = curve.variance(i, c, Some(model));
                weight += model * model / own;
                sum += model * (curve.rate[[i, c]] - model) / own;
            }
            sum / weight / (curve.common_variance[i] + weight.recip()).sqrt()
        })
    };
    data.iter().zip(rates).map(one).collect()
}

/// The mean of ψ' over residuals over the noise of single samples.
fn mean_slope(pulls: &[f64], loss: Loss) -> f64 {
    let spread = spread(pulls.iter().copied());
    pulls.iter().map(|p| loss.slope(p / spread)).sum::<f64>() / pulls.len() as f64
}

/// Σψ²/(n−p) over the square of the mean of ψ', of residuals over the noise of single samples.
fn m_factor(pulls: &[f64], loss: Loss, freedom: usize) -> f64 {
    let spread = spread(pulls.iter().copied());
    let all = || pulls.iter().map(|p| p / spread);
    let psi2: f64 = all().map(|u| (u * loss.weight(u)).powi(2)).sum();
    spread * spread * psi2 / freedom as f64 / mean_slope(pulls, loss).powi(2)
}

/// Whether two minima differ in nothing but parameters that the data do not determine, alone or in a combination that is named: they are one.
pub(super) fn same_but_for_what_is_open(
    free: &[Free],
    estimates: &[Estimate],
    warnings: &[Warning],
    a: &[f64],
    b: &[f64],
) -> bool {
    let named = |name: &String| {
        let open =
            |w: &Warning| matches!(w, Warning::Undetermined { names } if names.contains(name));
        warnings.iter().any(open)
    };
    let one = |f: &Free, a: f64, b: f64| {
        let apart = ((a - b) / (f.high - f.low)).abs();
        let apart = if f.wraps { apart.rem_euclid(1.0) } else { apart };
        if f.wraps { apart.min(1.0 - apart) } else { apart }
    };
    free.iter().zip(estimates).zip(a.iter().zip(b)).all(|((f, known), (a, b))| {
        known.interval_method == IntervalMethod::None || named(&f.name) || one(f, *a, *b) <= SAME
    })
}

/// Values without uncertainties.
fn values_alone(problem: &Problem, values: &[f64], state: &State) -> Known {
    let one = |name: &str, kind: ParameterKind, value: f64, prior| Estimate {
        name: name.to_owned(),
        kind,
        value,
        sigma: None,
        sigma_calibration: None,
        interval_95: [None, None],
        interval_method: IntervalMethod::None,
        sigma_material: None,
        at_bound: None,
        prior,
    };
    let searched = (problem.free.iter().zip(values))
        .map(|(f, v)| one(&f.name, ParameterKind::Nonlinear, *v, f.prior));
    let solved = (problem.linear.iter().zip(state.x.iter()))
        .map(|(l, x)| one(&l.name, ParameterKind::Linear, l.unit * x, l.prior));
    let estimates: Vec<Estimate> = searched.chain(solved).collect();
    let n = estimates.len();
    let covariance = DMatrix::from_element(n, n, f64::NAN);
    Known { estimates, covariance, response: None, warnings: Vec::new() }
}

fn finish(
    mut problem: Problem,
    best: Found,
    state: State,
    settled: bool,
    others: Vec<Found>,
    options: &Options,
) -> Result<Fit, FitError> {
    let loss = options.loss;
    let data = problem.data;
    let values = search::values(&problem, &best.at);
    let rates = problem.calibrated(&state.rates);
    let (weights, centres) = weights(data, &rates, loss).unzip();
    problem.centres = centres;
    // All samples alike from here on, but for those that the loss left out.
    let kept: Option<PerSample> = weights
        .as_ref()
        .map(|all| all.iter().map(|w| w.map(|w| f64::from(u8::from(*w > 0.0)))).collect());
    problem.whitener = Whitener::new(data, Some(&state.rates), kept.as_ref());
    let left = |problem: &Problem| {
        let mut residual = problem.whitened(&problem.left(&state.rates));
        problem.add_priors(&values, state.x.as_slice(), &mut residual);
        residual
    };
    problem.with_calibration(&state.rates, 1.0);
    let mut residual = left(&problem);
    let chi2 = residual.norm_squared();
    let degrees_of_freedom = freedom(&problem);
    let reduced_chi2 = chi2 / degrees_of_freedom as f64;
    let pulls = pulls(data, &state.rates);
    let mut slope = 1.0;
    let factor = match &kept {
        None => reduced_chi2,
        Some(kept) => {
            let judged = judged(data, &problem.calibrated(&state.rates));
            let each = judged.iter().flatten().zip(kept.iter().flatten());
            let counts = |(j, kept): (&Judged, &f64)| (*kept > 0.0).then_some(j.pull);
            let counted: Vec<f64> = each.filter_map(counts).collect();
            slope = mean_slope(&counted, loss);
            m_factor(&counted, loss, degrees_of_freedom)
        }
    };
    let scaled_by = factor.max(1.0);
    if problem.common.is_some() {
        problem.with_calibration(&state.rates, scaled_by);
        residual = left(&problem);
    }
    let alike = problem.evaluate(&values)?;
    let solution = State { x: state.x, residual, rates: state.rates, ..alike };
    let influence = {
        let mut left = problem.left(&solution.rates);
        for (left, weights) in left.iter_mut().zip(weights.iter().flatten()) {
            *left *= weights;
        }
        problem.whitened_alone(&left) / slope
    };
    let known = match options.purpose {
        Purpose::Answer => estimate(&mut problem, &values, &solution, scaled_by, true, &influence)?,
        Purpose::Covariance => {
            estimate(&mut problem, &values, &solution, scaled_by, false, &influence)?
        }
        Purpose::Values | Purpose::Start => values_alone(&problem, &values, &solution),
    };

    let mut warnings = Vec::new();
    if !settled {
        let rounds = rounds(options.purpose);
        let why = format!("noise and weights still followed the model after {rounds} rounds");
        warnings.push(Warning::NotConverged { why });
    } else if !best.converged {
        let why = format!(
            "no minimum was reached in {} iterations of the last descent",
            options.iterations
        );
        warnings.push(Warning::NotConverged { why });
    }
    if reduced_chi2 > POOR {
        warnings.push(Warning::PoorFit { reduced_chi2 });
    }
    let mut minima = vec![Minimum { values: values.clone(), chi2: best.chi2, delta_chi2: 0.0 }];
    let mut rest: Vec<Minimum> = others
        .iter()
        .map(|m| Minimum {
            values: search::values(&problem, &m.at),
            chi2: m.chi2,
            // Another is deeper by rounding alone: a deeper one would be the best.
            delta_chi2: ((m.chi2 - best.chi2) / scaled_by).max(0.0),
        })
        .filter(|m| m.delta_chi2 < WORTH)
        .filter(|m| {
            let (known, own) = (&known.estimates, &known.warnings);
            !same_but_for_what_is_open(problem.free, known, own, &m.values, &values)
        })
        .collect();
    rest.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
    for other in &rest {
        let names = problem.free.iter().map(|f| f.name.clone());
        let at = names.zip(other.values.iter().copied()).collect();
        warnings.push(Warning::OtherMinimum { delta_chi2: other.delta_chi2, at });
    }
    minima.extend(rest);
    warnings.extend(known.warnings);
    let n = known.covariance.nrows();
    let covariance = (0..n).map(|i| (0..n).map(|j| known.covariance[(i, j)]).collect()).collect();
    let one = |p: usize| FittedCurve {
        model: solution.rates[p].clone(),
        weight: Array2::from_shape_fn(pulls[p].raw_dim(), |at| match data[p].used[at] {
            true => weights.as_ref().map_or(1.0, |w| w[p][at]),
            false => 0.0,
        }),
        pull: pulls[p].clone(),
    };
    Ok(Fit {
        parameters: known.estimates,
        covariance,
        samples: problem.whitener.rows,
        chi2,
        degrees_of_freedom,
        reduced_chi2,
        scaled_by,
        correlation: None,
        loss,
        converged: settled && best.converged,
        minima,
        evaluations: problem.evaluations,
        warnings,
        curves: (0..data.len()).map(one).collect(),
        response: known.response,
    })
}
