//! The search for the values that are not linear: places drawn over the box, from the best of them the steps of Levenberg and
//! Marquardt within bounds, about the best minimum simplices (argmin). In units of the box, so that all parameters are alike.

use super::problem::{Problem, State, Which};
use super::{FitError, Search};
use argmin::core::{CostFunction, Executor, State as _};
use argmin::solver::neldermead::NelderMead;
use nalgebra::DVector;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::cell::RefCell;
use sunglint_numerics::basis::Basis;
use sunglint_numerics::least_squares::{
    Bounded, Differences, Limits, Residuals, minimise_residuals,
};

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
    let drawn: Vec<usize> = everywhere(problem).collect();
    let n = drawn.len();
    let mut ratio = 2.0_f64;
    for _ in 0..64 {
        ratio = (1.0 + ratio).powf(1.0 / (n as f64 + 1.0));
    }
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let shift: Vec<f64> = (0..n).map(|_| random.random::<f64>()).collect();
    let begin = start(problem);
    let place = |i: usize| {
        let mut at = begin.clone();
        for (k, own) in drawn.iter().enumerate() {
            at[*own] = (shift[k] + i as f64 * ratio.powi(-(k as i32 + 1))).rem_euclid(1.0);
        }
        at
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

/// Number of parameters that are searched for over the box.
pub(super) fn over_the_box(problem: &Problem) -> usize {
    everywhere(problem).count()
}

fn everywhere(problem: &Problem) -> impl Iterator<Item = usize> {
    (0..problem.free.len()).filter(|k| problem.free[*k].search == Search::Everywhere)
}

/// A simplex (Nelder and Mead) of a size about a place, for some iterations. All others stay as they are.
pub(super) fn simplex(
    problem: &mut Problem,
    at: &[f64],
    size: f64,
    iterations: u64,
) -> Result<Found, FitError> {
    let mut corners = vec![at.to_vec()];
    for k in everywhere(problem) {
        let mut corner = at.to_vec();
        corner[k] += if corner[k] + size <= 1.0 { size } else { -size };
        corners.push(corner);
    }
    if corners.len() < 2 {
        return Err(FitError::Search { why: "there is no model where it starts".into() });
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
    /// The last place that was looked at, and the basis of the linear columns there once it was asked for.
    last: Option<(Vec<f64>, State, Option<Basis>)>,
}

impl Polish<'_, '_> {
    fn look(&mut self, at: &[f64]) -> Result<(), FitError> {
        if self.last.as_ref().is_none_or(|(last, ..)| last != at) {
            let values = values(self.problem, at);
            self.last = Some((at.to_vec(), self.problem.evaluate(&values)?, None));
        }
        Ok(())
    }
}

impl Residuals for Polish<'_, '_> {
    type Error = FitError;

    fn residuals(&mut self, at: &[f64]) -> Result<DVector<f64>, FitError> {
        self.look(at)?;
        Ok(self.last.as_ref().map_or_else(|| DVector::zeros(0), |(_, s, _)| s.residual.clone()))
    }

    /// Derivative by a parameter that multiplies rates, without evaluations: that of the rates, less its part in the space of the linear parameters' columns (Kaufman 1975). The full derivative of
    /// the residuals has a second term, which lies in that space. Residuals are perpendicular to it, so that the slope of χ², and with it the minimum, is the same without the term.
    fn derivative(&mut self, at: &[f64], number: usize) -> Result<Option<DVector<f64>>, FitError> {
        let own = values(self.problem, at);
        if !self.problem.multiplies(&own, number) {
            return Ok(None);
        }
        self.look(at)?;
        let Some((_, state, basis)) = &mut self.last else { return Ok(None) };
        let Some(mut slope) = self.problem.slope(&own, number, &state.rates) else {
            return Ok(None);
        };
        basis.get_or_insert_with(|| self.problem.in_use(state)).project_out(slope.as_mut_slice());
        let priors = (self.problem.whitener.rows..).zip(self.problem.priors());
        for (row, known) in priors.filter(|(_, known)| known.which == Which::Free(number)) {
            slope[row] += known.prior.sigma.recip();
        }
        let f = &self.problem.free[number];
        Ok(Some(-(f.high - f.low) * slope))
    }
}

/// Parameters that stay as they are on the way down.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Held {
    None,
    /// One, by its number.
    One(usize),
    /// The local ones: many of them follow the others closely, and ask for an evaluation each.
    Local,
}

/// Goes down to a minimum within the box; some parameters may be held. Differences are taken to both sides where `both` says so.
pub(super) fn polish(
    problem: &mut Problem,
    at: &[f64],
    iterations: usize,
    both: bool,
    held: Held,
) -> Result<Found, FitError> {
    if iterations == 0 {
        let chi2 = problem.evaluate(&values(problem, at))?.chi2;
        return Ok(Found { at: at.to_vec(), chi2, converged: false });
    }
    // Where all are local, nothing would be left.
    let searched = over_the_box(problem) > 0;
    let number = |(k, f): (usize, &super::Free)| {
        let (low, high) = if f.wraps { (f64::NEG_INFINITY, f64::INFINITY) } else { (0.0, 1.0) };
        let fixed = match held {
            Held::None => false,
            Held::One(one) => one == k,
            Held::Local => f.search == Search::Near && searched,
        } || f.search == Search::Nowhere;
        Bounded { low, high, step: f.step / (f.high - f.low), fixed }
    };
    let numbers: Vec<Bounded> = problem.free.iter().enumerate().map(number).collect();
    if problem.rows() < numbers.iter().filter(|n| !n.fixed).count() {
        return Err(FitError::Search { why: "fewer samples than parameters".into() });
    }
    let differences = if both { Differences::TwoSided } else { Differences::OneSided };
    // On the way a part of a million of χ² is far below anything that decides.
    let gain = problem.gain.unwrap_or(if both { 1e-9 } else { 1e-6 });
    let limits = Limits { steps: iterations, gain, step: 1e-8 };
    let mut model = Polish { problem, last: None };
    let found = minimise_residuals(&mut model, &numbers, at, differences, &limits)?;
    let chi2 = found.place.chi2();
    if !chi2.is_finite() {
        return Err(FitError::Search { why: "a residual is no number".into() });
    }
    Ok(Found { at: found.place.at, chi2, converged: found.converged })
}

/// How far apart two places are, in units of the box; angles the short way.
pub(super) fn apart(problem: &Problem, a: &[f64], b: &[f64]) -> f64 {
    let one = |((f, a), b): ((&super::Free, &f64), &f64)| {
        let d = (a - b).abs();
        if f.wraps { (d.rem_euclid(1.0)).min(1.0 - d.rem_euclid(1.0)) } else { d }
    };
    problem.free.iter().zip(a).zip(b).map(one).fold(0.0, f64::max)
}
