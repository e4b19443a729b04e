//! Least squares by the steps of Levenberg and Marquardt, for all fits of the house.
//!
//! [`minimise`] needs a [`Descent`]: places, what they cost, and their normal equations. A model with derivatives, weights that follow it or steps on a curved
//! space writes its own. [`minimise_residuals`] takes [`Residuals`] of numbers within bounds and differentiates them numerically.
//!
//! The damping is Marquardt's (1963): a multiple of the normal matrix's diagonal, so that the units of the numbers do not matter. It falls to a fifth after a
//! step that lowers the cost and rises eightfold after one that does not.

use nalgebra::{DMatrix, DVector};

const FIRST_DAMPING: f64 = 1e-3;
const LEAST_DAMPING: f64 = 1e-12;
/// More damping than this moves nothing.
const MOST_DAMPING: f64 = 1e12;

/// Normal equations at a place.
#[derive(Debug, Clone, PartialEq)]
pub struct Normal {
    /// JᵀWJ, with J the derivatives of the model by the numbers and W the weights.
    pub matrix: DMatrix<f64>,
    /// JᵀWr, with r the data less the model: half of the cost's slope, downwards.
    pub downhill: DVector<f64>,
}

/// A sum of squares to go down on.
pub trait Descent {
    /// A place: its numbers, its cost, and what else belongs to it.
    type Place;
    /// Why there is no model at a place.
    type Error;

    /// The sum of squares at a place.
    fn cost(&self, place: &Self::Place) -> f64;

    /// The normal equations at a place. Weights that follow the model may be taken anew: the place then holds the cost by these.
    ///
    /// # Errors
    /// No model there.
    fn normal(&mut self, place: &mut Self::Place) -> Result<Normal, Self::Error>;

    /// The place a step away. A step that is too long may be shortened, in place.
    ///
    /// # Errors
    /// No model there.
    fn step(
        &mut self,
        from: &Self::Place,
        step: &mut DVector<f64>,
    ) -> Result<Self::Place, Self::Error>;

    /// Called once, at the place where a descent ended.
    ///
    /// # Errors
    /// No model there.
    fn arrive(&mut self, _place: &mut Self::Place) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Whether a number stays where it is: it is at a bound that `downhill` points beyond.
    fn is_held(&self, _place: &Self::Place, _number: usize, _downhill: f64) -> bool {
        false
    }
}

/// Conditions under which a descent ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Steps, at most.
    pub steps: usize,
    /// A step that lowers the cost by a smaller part of it is the last.
    pub gain: f64,
    /// A step that moves no number by more is the last.
    pub step: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { steps: 200, gain: 1e-10, step: 1e-10 }
    }
}

/// End of a descent.
#[derive(Debug, Clone, PartialEq)]
pub struct Minimum<P> {
    /// The place.
    pub place: P,
    /// True where it ended before it ran out of steps.
    pub converged: bool,
    /// Steps that lowered the cost.
    pub steps: usize,
}

/// Goes down from a place to the minimum near it.
///
/// # Errors
/// No model at the start, or at a place on the way.
pub fn minimise<D: Descent>(
    descent: &mut D,
    start: D::Place,
    limits: &Limits,
) -> Result<Minimum<D::Place>, D::Error> {
    let mut found = down(descent, start, limits)?;
    descent.arrive(&mut found.place)?;
    Ok(found)
}

fn down<D: Descent>(
    descent: &mut D,
    mut place: D::Place,
    limits: &Limits,
) -> Result<Minimum<D::Place>, D::Error> {
    let mut damping = FIRST_DAMPING;
    for steps in 0..limits.steps {
        let normal = descent.normal(&mut place)?;
        let cost = descent.cost(&place);
        let free: Vec<usize> = (0..normal.downhill.len())
            .filter(|i| !descent.is_held(&place, *i, normal.downhill[*i]))
            .collect();
        let (next, moved) = loop {
            if let Some(mut step) = damped(&normal, &free, damping) {
                let next = descent.step(&place, &mut step)?;
                if descent.cost(&next) < cost {
                    break (next, step.amax());
                }
                if step.amax() <= limits.step {
                    return Ok(Minimum { place, converged: true, steps });
                }
            }
            damping *= 8.0;
            // No way leads down.
            if damping > MOST_DAMPING || free.is_empty() {
                return Ok(Minimum { place, converged: true, steps });
            }
        };
        let gained = cost - descent.cost(&next);
        place = next;
        damping = (0.2 * damping).max(LEAST_DAMPING);
        if gained <= limits.gain * cost.abs() || moved <= limits.step {
            return Ok(Minimum { place, converged: true, steps: steps + 1 });
        }
    }
    Ok(Minimum { place, converged: false, steps: limits.steps })
}

/// The damped step of the free numbers; `None` where the equations have no solution yet.
fn damped(normal: &Normal, free: &[usize], damping: f64) -> Option<DVector<f64>> {
    let n = free.len();
    let largest = free.iter().fold(0.0_f64, |m, i| m.max(normal.matrix[(*i, *i)]));
    let mut matrix = DMatrix::from_fn(n, n, |a, b| normal.matrix[(free[a], free[b])]);
    for (a, i) in free.iter().enumerate() {
        // A number without effect stays where it is.
        matrix[(a, a)] += damping * normal.matrix[(*i, *i)].max(1e-12 * largest);
        if matrix[(a, a)] == 0.0 {
            matrix[(a, a)] = 1.0;
        }
    }
    let right = DVector::from_fn(n, |a, _| normal.downhill[free[a]]);
    let solved = matrix.cholesky()?.solve(&right);
    let mut step = DVector::zeros(normal.downhill.len());
    for (a, i) in free.iter().enumerate() {
        step[*i] = solved[a];
    }
    step.iter().all(|s| s.is_finite()).then_some(step)
}

/// A number of a model, within bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounded {
    /// Lower bound; −∞ for none.
    pub low: f64,
    /// Upper bound; ∞ for none.
    pub high: f64,
    /// The step of its numerical derivative.
    pub step: f64,
    /// True where it stays at its start.
    pub fixed: bool,
}

/// A model of numbers within bounds.
pub trait Residuals {
    /// Why there is no model.
    type Error;

    /// Returns the residuals at some numbers, each over its standard uncertainty: as many values each time.
    ///
    /// # Errors
    /// No model there.
    fn residuals(&mut self, at: &[f64]) -> Result<DVector<f64>, Self::Error>;

    /// Returns the derivative of the residuals by a number where it is known without differences. It is asked for at numbers whose residuals were the last that were asked for, or at others.
    ///
    /// # Errors
    /// No model there.
    fn derivative(
        &mut self,
        _at: &[f64],
        _number: usize,
    ) -> Result<Option<DVector<f64>>, Self::Error> {
        Ok(None)
    }
}

/// Method by which derivatives are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Differences {
    /// By a step to the side where there is room: one evaluation a number.
    OneSided,
    /// By a step to both sides, where there is room: two evaluations a number.
    TwoSided,
}

/// The numbers at the end of a descent.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// The numbers.
    pub at: Vec<f64>,
    /// Residuals there.
    pub residuals: DVector<f64>,
}

impl Fitted {
    /// The sum of squares.
    pub fn chi2(&self) -> f64 {
        self.residuals.norm_squared()
    }
}

struct Numerical<'a, R> {
    model: &'a mut R,
    numbers: &'a [Bounded],
    differences: Differences,
}

impl<R: Residuals> Numerical<'_, R> {
    fn derivatives(&mut self, place: &Fitted) -> Result<DMatrix<f64>, R::Error> {
        let (rows, count) = (place.residuals.len(), self.numbers.len());
        let mut jacobian = DMatrix::zeros(rows, count);
        // What is known comes first: the model still stands at this place then.
        let mut known = vec![false; count];
        for (k, known) in known.iter_mut().enumerate().filter(|(k, _)| !self.numbers[*k].fixed) {
            if let Some(slope) = self.model.derivative(&place.at, k)? {
                jacobian.set_column(k, &slope);
                *known = true;
            }
        }
        let asked = |(k, n): &(usize, &Bounded)| !n.fixed && !known[*k];
        for (k, number) in self.numbers.iter().enumerate().filter(asked) {
            let mut beside = |step: f64| -> Result<(f64, DVector<f64>), R::Error> {
                let mut at = place.at.clone();
                at[k] += step;
                // The step that was taken, after rounding.
                Ok((at[k] - place.at[k], self.model.residuals(&at)?))
            };
            let up = place.at[k] + number.step <= number.high;
            let down = place.at[k] - number.step >= number.low;
            let first = if up { number.step } else { -number.step };
            let (a, after) = beside(first)?;
            let slope = if self.differences == Differences::TwoSided && up && down {
                let (b, before) = beside(-first)?;
                (after - before) / (a - b)
            } else {
                (after - &place.residuals) / a
            };
            jacobian.set_column(k, &slope);
        }
        Ok(jacobian)
    }
}

impl<R: Residuals> Descent for Numerical<'_, R> {
    type Place = Fitted;
    type Error = R::Error;

    fn cost(&self, place: &Fitted) -> f64 {
        let chi2 = place.chi2();
        if chi2.is_nan() { f64::INFINITY } else { chi2 }
    }

    fn normal(&mut self, place: &mut Fitted) -> Result<Normal, R::Error> {
        let jacobian = self.derivatives(place)?;
        // The residuals' own derivatives are those of the model with the other sign.
        let downhill = -jacobian.tr_mul(&place.residuals);
        Ok(Normal { matrix: jacobian.tr_mul(&jacobian), downhill })
    }

    fn step(&mut self, from: &Fitted, step: &mut DVector<f64>) -> Result<Fitted, R::Error> {
        let mut at = from.at.clone();
        for (k, number) in self.numbers.iter().enumerate() {
            at[k] = (at[k] + step[k]).clamp(number.low, number.high);
            step[k] = at[k] - from.at[k];
        }
        let residuals = self.model.residuals(&at)?;
        Ok(Fitted { at, residuals })
    }

    fn is_held(&self, place: &Fitted, number: usize, downhill: f64) -> bool {
        let bounds = &self.numbers[number];
        let at = place.at[number];
        bounds.fixed
            || (at <= bounds.low && downhill < 0.0)
            || (at >= bounds.high && downhill > 0.0)
    }
}

/// Goes down to the minimum of a sum of squares within bounds, with numerical derivatives. A start outside of its bounds is brought to the nearest.
///
/// # Errors
/// No model at the start, or at a place on the way.
///
/// # Examples
/// A straight line through three points:
/// ```
/// use nalgebra::DVector;
/// use sunglint_numerics::least_squares::{Bounded, Differences, Limits, Residuals, minimise_residuals};
///
/// struct Line;
/// impl Residuals for Line {
///     type Error = std::convert::Infallible;
///     fn residuals(&mut self, at: &[f64]) -> Result<DVector<f64>, Self::Error> {
///         let points = [(0.0, 1.0), (1.0, 3.0), (2.0, 5.0)];
///         Ok(DVector::from_iterator(3, points.iter().map(|(x, y)| y - at[0] - at[1] * x)))
///     }
/// }
/// let free = Bounded { low: -10.0, high: 10.0, step: 1e-6, fixed: false };
/// let found = minimise_residuals(&mut Line, &[free, free], &[0.0, 0.0], Differences::OneSided, &Limits::default())?;
/// assert!((found.place.at[0] - 1.0).abs() < 1e-6 && (found.place.at[1] - 2.0).abs() < 1e-6);
/// # Ok::<(), std::convert::Infallible>(())
/// ```
///
/// ```
/// use nalgebra::DVector;
/// use sunglint_numerics::least_squares::{
///     Bounded, Differences, Limits, Residuals, minimise_residuals,
/// };
///
/// /// Rosenbrock's valley, with its minimum at (1, 1).
/// struct Valley;
/// impl Residuals for Valley {
///     type Error = std::convert::Infallible;
///     fn residuals(&mut self, x: &[f64]) -> Result<DVector<f64>, Self::Error> {
///         Ok(DVector::from_vec(vec![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]]))
///     }
/// }
/// let free = Bounded { low: -10.0, high: 10.0, step: 1e-7, fixed: false };
/// let limits = Limits { steps: 500, gain: 1e-14, step: 1e-12 };
/// let found =
///     minimise_residuals(&mut Valley, &[free; 2], &[-1.2, 1.0], Differences::TwoSided, &limits)?;
/// assert!(found.converged && found.place.at.iter().all(|x| (x - 1.0).abs() < 1e-6));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn minimise_residuals<R: Residuals>(
    model: &mut R,
    numbers: &[Bounded],
    start: &[f64],
    differences: Differences,
    limits: &Limits,
) -> Result<Minimum<Fitted>, R::Error> {
    let at: Vec<f64> = start.iter().zip(numbers).map(|(s, n)| s.clamp(n.low, n.high)).collect();
    let residuals = model.residuals(&at)?;
    let mut descent = Numerical { model, numbers, differences };
    minimise(&mut descent, Fitted { at, residuals }, limits)
}

/// The covariance of fitted numbers: the inverse of JᵀJ at the minimum, zeros for what was fixed; `None` where the numbers are not determined.
///
/// # Errors
/// No model beside the place.
pub fn covariance<R: Residuals>(
    model: &mut R,
    numbers: &[Bounded],
    place: &Fitted,
    differences: Differences,
) -> Result<Option<DMatrix<f64>>, R::Error> {
    let jacobian = Numerical { model, numbers, differences }.derivatives(place)?;
    let free: Vec<usize> = (0..numbers.len()).filter(|k| !numbers[*k].fixed).collect();
    let normal = jacobian.tr_mul(&jacobian);
    let part = DMatrix::from_fn(free.len(), free.len(), |a, b| normal[(free[a], free[b])]);
    let Some(inverse) = part.cholesky().map(|c| c.inverse()) else { return Ok(None) };
    let mut all = DMatrix::zeros(numbers.len(), numbers.len());
    for (a, i) in free.iter().enumerate() {
        for (b, j) in free.iter().enumerate() {
            all[(*i, *j)] = inverse[(a, b)];
        }
    }
    Ok(Some(all))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    struct Model<F>(F);

    impl<F: FnMut(&[f64]) -> Vec<f64>> Residuals for Model<F> {
        type Error = Infallible;
        fn residuals(&mut self, at: &[f64]) -> Result<DVector<f64>, Infallible> {
            Ok(DVector::from_vec((self.0)(at)))
        }
    }

    fn free(low: f64, high: f64) -> Bounded {
        Bounded { low, high, step: 1e-7, fixed: false }
    }

    fn fit(
        f: impl FnMut(&[f64]) -> Vec<f64>,
        numbers: &[Bounded],
        start: &[f64],
        both: Differences,
    ) -> Minimum<Fitted> {
        let limits = Limits { steps: 500, gain: 1e-14, step: 1e-12 };
        minimise_residuals(&mut Model(f), numbers, start, both, &limits).unwrap()
    }

    /// Truth: the minima of test functions of Moré, Garbow and Hillstrom (1981): Rosenbrock's (no. 1), Freudenstein and Roth's with its two minima
    /// (no. 2), Powell's singular one (no. 13, whose normal matrix has rank 2 at the minimum), Kowalik and Osborne's (no. 15). Tolerance: that of their printed digits.
    #[test]
    fn published_minima_are_found() {
        let open = [free(f64::NEG_INFINITY, f64::INFINITY); 4];
        let rosenbrock = |x: &[f64]| vec![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]];
        for both in [Differences::OneSided, Differences::TwoSided] {
            let found = fit(rosenbrock, &open[..2], &[-1.2, 1.0], both);
            assert!(found.converged && found.place.chi2() < 1e-12, "{found:?}");
        }
        let freudenstein = |x: &[f64]| {
            let (a, b) = (x[0], x[1]);
            vec![-13.0 + a + ((5.0 - b) * b - 2.0) * b, -29.0 + a + ((b + 1.0) * b - 14.0) * b]
        };
        let found = fit(freudenstein, &open[..2], &[0.5, -2.0], Differences::TwoSided);
        assert!((found.place.chi2() - 48.9842).abs() < 1e-4, "{found:?}");
        let powell = |x: &[f64]| {
            vec![
                x[0] + 10.0 * x[1],
                5_f64.sqrt() * (x[2] - x[3]),
                (x[1] - 2.0 * x[2]).powi(2),
                10_f64.sqrt() * (x[0] - x[3]).powi(2),
            ]
        };
        let found = fit(powell, &open, &[3.0, -1.0, 0.0, 1.0], Differences::TwoSided);
        assert!(found.place.chi2() < 1e-10, "{found:?}");
        let kowalik = |x: &[f64]| {
            let y = [
                0.1957, 0.1947, 0.1735, 0.1600, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235,
                0.0246,
            ];
            let u = [4.0, 2.0, 1.0, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625];
            (y.iter().zip(u))
                .map(|(y, u)| y - x[0] * (u * u + u * x[1]) / (u * u + u * x[2] + x[3]))
                .collect()
        };
        let found = fit(kowalik, &open, &[0.25, 0.39, 0.415, 0.39], Differences::TwoSided);
        assert!((found.place.chi2() - 3.07505e-4).abs() < 1e-9, "{found:?}");
    }

    /// Truth: by hand: (x − 3)² + (y + 1)² over 0 ≤ x, y ≤ 2 is least at (2, 0), where both bounds hold; with x fixed at 1, at (1, 0).
    #[test]
    fn bounds_hold_and_what_is_fixed_stays() {
        let bowl = |x: &[f64]| vec![x[0] - 3.0, x[1] + 1.0];
        let mut numbers = [free(0.0, 2.0); 2];
        let found = fit(bowl, &numbers, &[1.0, 1.0], Differences::OneSided);
        assert_eq!(found.place.at, [2.0, 0.0]);
        numbers[0].fixed = true;
        let found = fit(bowl, &numbers, &[1.0, 9.0], Differences::TwoSided);
        assert_eq!(found.place.at, [1.0, 0.0]);
    }

    /// Truth: Cov = (XᵀX)⁻¹ of a straight line through five points of unit uncertainty at x = −2 … 2: 1/5 and 1/10. Tolerance: the differences'.
    #[test]
    fn the_covariance_is_that_of_the_line() {
        let line = |x: &[f64]| (-2..=2).map(|k| 0.3 - x[0] - x[1] * f64::from(k)).collect();
        let numbers = [free(-9.0, 9.0); 2];
        let found = fit(line, &numbers, &[0.0, 0.0], Differences::OneSided);
        let cov = covariance(&mut Model(line), &numbers, &found.place, Differences::OneSided);
        let cov = cov.unwrap().unwrap();
        assert!((cov[(0, 0)] - 0.2).abs() < 1e-6 && (cov[(1, 1)] - 0.1).abs() < 1e-6, "{cov}");
    }

    /// Truth: none but that it ends: a number without effect, and residuals that are no numbers away from the start.
    #[test]
    fn what_is_not_determined_ends_all_the_same() {
        let found =
            fit(|x| vec![x[0] - 1.0], &[free(-9.0, 9.0); 2], &[0.0, 5.0], Differences::OneSided);
        assert!((found.place.at[0] - 1.0).abs() < 1e-9 && found.place.at[1] == 5.0);
        let cliff = |x: &[f64]| vec![if x[0] > 0.5 { f64::NAN } else { 1.0 - x[0] }];
        let found = fit(cliff, &[free(-9.0, 9.0)], &[0.0], Differences::OneSided);
        assert!(found.place.at[0] <= 0.5 && found.place.chi2() < 0.5, "{found:?}");
    }
}
