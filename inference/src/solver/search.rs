//! The search for the values that are not linear: places drawn over the box, from the best of them a bounded
//! Levenberg–Marquardt (rmpfit), about the best minimum simplices (argmin). In units of the box, so that all parameters are alike.

use super::FitError;
use super::problem::{Problem, State};
use argmin::core::{CostFunction, Executor, State as _};
use argmin::solver::neldermead::NelderMead;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use rmpfit::{MPConfig, MPError, MPFitter, MPPar, MPResult, MPSide, MPSuccess};
use std::cell::RefCell;

/// How far outside of the box a simplex may look: there the sum grows by its own size times the square of the distance.
const WALL: f64 = 100.0;

/// A place in the box, and the sum of squares there.
#[derive(Debug, Clone)]
pub(super) struct Found {
    pub at: Vec<f64>,
    pub chi2: f64,
    pub converged: bool,
}

/// From units of the box to values.
pub(super) fn values(problem: &Problem, at: &[f64]) -> Vec<f64> {
    let of = |(f, z): (&super::Free, &f64)| {
        let z = if f.wraps { z.rem_euclid(1.0) } else { z.clamp(0.0, 1.0) };
        f.low + z * (f.high - f.low)
    };
    problem.free.iter().zip(at).map(of).collect()
}

/// Where the search starts.
pub(super) fn start(problem: &Problem) -> Vec<f64> {
    problem.free.iter().map(|f| (f.start - f.low) / (f.high - f.low)).collect()
}

/// Places over the box: the multiples of an irrational vector (the generalised golden ratio: Roberts 2018), shifted by the seed.
pub(super) fn places(problem: &Problem, count: usize, seed: u64) -> Vec<Vec<f64>> {
    let n = problem.free.len();
    let mut ratio = 2.0_f64;
    for _ in 0..64 {
        ratio = (1.0 + ratio).powf(1.0 / (n as f64 + 1.0));
    }
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let shift: Vec<f64> = (0..n).map(|_| random.random::<f64>()).collect();
    let place = |i: usize| {
        (0..n)
            .map(|k| (shift[k] + i as f64 * ratio.powi(-(k as i32 + 1))).rem_euclid(1.0))
            .collect()
    };
    (1..=count).map(place).collect()
}

/// The sum of squares at a place; infinite where there is no model.
pub(super) fn cost(problem: &mut Problem, at: &[f64]) -> f64 {
    let outside: f64 = (problem.free.iter().zip(at))
        .filter(|(f, _)| !f.wraps)
        .map(|(_, z)| (z - z.clamp(0.0, 1.0)).powi(2))
        .sum();
    let values = values(problem, at);
    match problem.evaluate(&values) {
        Ok(state) => state.chi2 * (1.0 + WALL * outside),
        Err(_) => f64::INFINITY,
    }
}

struct Simplex<'a, 'b> {
    problem: RefCell<&'a mut Problem<'b>>,
}

impl CostFunction for Simplex<'_, '_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, at: &Self::Param) -> Result<f64, argmin::core::Error> {
        let cost = cost(&mut self.problem.borrow_mut(), at);
        // A simplex compares: infinity is larger than all, but its mean is none.
        Ok(cost.min(1e300))
    }
}

/// A simplex (Nelder and Mead) of a size about a place, for some iterations.
pub(super) fn simplex(
    problem: &mut Problem,
    at: &[f64],
    size: f64,
    iterations: u64,
) -> Result<Found, FitError> {
    let mut corners = vec![at.to_vec()];
    for k in 0..at.len() {
        let mut corner = at.to_vec();
        corner[k] += if corner[k] + size <= 1.0 { size } else { -size };
        corners.push(corner);
    }
    let search = |why: argmin::core::Error| FitError::Search { why: why.to_string() };
    let solver = NelderMead::new(corners).with_sd_tolerance(1e-3).map_err(search)?;
    let simplex = Simplex { problem: RefCell::new(problem) };
    let run = Executor::new(simplex, solver)
        .configure(|state| state.max_iters(iterations))
        .timer(false)
        .ctrlc(false)
        .run()
        .map_err(search)?;
    let (best, chi2) = (run.state().get_best_param(), run.state().get_best_cost());
    Ok(match best {
        Some(best) => Found { at: best.clone(), chi2, converged: false },
        None => Found { at: at.to_vec(), chi2: f64::INFINITY, converged: false },
    })
}

struct Polish<'a, 'b> {
    problem: &'a mut Problem<'b>,
    parameters: Vec<MPPar>,
    config: MPConfig,
    error: Option<FitError>,
}

impl MPFitter for Polish<'_, '_> {
    fn eval(&mut self, at: &[f64], deviates: &mut [f64]) -> MPResult<()> {
        let values = values(self.problem, at);
        match self.problem.evaluate(&values) {
            Ok(State { residual, .. }) => {
                deviates.copy_from_slice(residual.as_slice());
                Ok(())
            }
            Err(error) => {
                self.error = Some(error);
                Err(MPError::Eval)
            }
        }
    }

    fn number_of_points(&self) -> usize {
        self.problem.whitener.rows
    }

    fn config(&self) -> &MPConfig {
        &self.config
    }

    fn parameters(&self) -> &[MPPar] {
        &self.parameters
    }
}

/// Goes down to a minimum within the box; one of the parameters may be held. Differences are taken to both sides where `both` says so.
pub(super) fn polish(
    problem: &mut Problem,
    at: &[f64],
    iterations: usize,
    both: bool,
    held: Option<usize>,
) -> Result<Found, FitError> {
    if iterations == 0 {
        let chi2 = problem.evaluate(&values(problem, at))?.chi2;
        return Ok(Found { at: at.to_vec(), chi2, converged: false });
    }
    let parameter = |(k, f): (usize, &super::Free)| {
        let mut p = MPPar::new();
        p.fixed = held == Some(k);
        (p.limited_low, p.limited_up) = (!f.wraps, !f.wraps);
        (p.limit_low, p.limit_up) = (0.0, 1.0);
        p.step = f.step / (f.high - f.low);
        p.side = if both { MPSide::Both } else { MPSide::Auto };
        p
    };
    let parameters = problem.free.iter().enumerate().map(parameter).collect();
    let config = MPConfig {
        max_iter: iterations,
        ftol: 1e-9,
        xtol: 1e-8,
        gtol: 1e-9,
        step_factor: 1.0,
        ..MPConfig::new()
    };
    let mut at: Vec<f64> = (problem.free.iter().zip(at))
        .map(|(f, z)| if f.wraps { *z } else { z.clamp(0.0, 1.0) })
        .collect();
    let mut polish = Polish { problem, parameters, config, error: None };
    match polish.mpfit(&mut at) {
        Ok(status) => {
            let converged = !matches!(status.success, MPSuccess::NotDone | MPSuccess::MaxIter);
            Ok(Found { at, chi2: status.best_norm, converged })
        }
        Err(error) => Err(polish.error.take().unwrap_or_else(|| {
            let why = match error {
                MPError::Nan => "a residual is no number",
                MPError::DoF => "fewer samples than parameters",
                MPError::InitBounds | MPError::Bounds => "the bounds exclude the start",
                _ => "the least-squares solver refused its input",
            };
            FitError::Search { why: why.into() }
        })),
    }
}

/// How far apart two places are, in units of the box; angles the short way.
pub(super) fn apart(problem: &Problem, a: &[f64], b: &[f64]) -> f64 {
    let one = |((f, a), b): ((&super::Free, &f64), &f64)| {
        let d = (a - b).abs();
        if f.wraps { (d.rem_euclid(1.0)).min(1.0 - d.rem_euclid(1.0)) } else { d }
    };
    problem.free.iter().zip(a).zip(b).map(one).fold(0.0, f64::max)
}
