//! Intervals by resampling stars: what was measured of one star hangs together, stars do not.

use super::Options;
use super::gls::{Normal, Solution, solve};
use nalgebra::DMatrix;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use sunglint_numerics::order::quantile;

/// With fewer stars a resample often holds one star several times and little else: Student's t stands in.
pub(super) const FEWEST: usize = 8;

/// Student's t of 97.5 % by degrees of freedom, 1 to 7 (any table).
const T_975: [f64; 7] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365];

/// How an interval was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Studentised bootstrap over stars.
    Bootstrap,
    /// Student's t about the fit: too few stars for a bootstrap.
    Student,
    /// Student's t in channels that too few stars were measured in, the bootstrap in the others.
    Mixed,
}

/// Intervals of the first parameters of a fit, those of ln κ, as offsets below and above each. `by_choice` is the covariance by which stars agree,
/// beside that of those that do.
pub(super) fn intervals(
    stars: &[Normal],
    solution: &Solution,
    by_choice: &DMatrix<f64>,
    channels: usize,
    options: &Options,
) -> (Vec<(f64, f64)>, Method) {
    let confidence = options.confidence;
    let normal = normal_quantile(0.5 + 0.5 * confidence);
    let with_choice = |i: usize, half: f64| half.hypot(normal * by_choice[(i, i)].sqrt());
    let measured = |i: usize| stars.iter().filter(|star| star.a[(i, i)] > 0.0).count();
    let student = |i: usize| {
        let own = measured(i);
        // What a channel shares with the others more stars tell; what is its own takes one degree of them.
        let freedom = own.saturating_sub(usize::from(own == stars.len())).clamp(1, T_975.len());
        // Of another confidence the 95 % value scaled as the normal distribution's.
        let t = T_975[freedom - 1] * normal / 1.959_964;
        let half = with_choice(i, t * solution.covariance[(i, i)].sqrt());
        (half, half)
    };
    if stars.len() < FEWEST {
        return ((0..channels).map(student).collect(), Method::Student);
    }
    let spread = sandwich(&stars.iter().collect::<Vec<_>>(), solution);
    let mut draws: Vec<Vec<f64>> = vec![Vec::new(); channels];
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(options.seed);
    for _ in 0..options.resamples {
        let resample: Vec<&Normal> =
            (0..stars.len()).map(|_| &stars[rng.random_range(0..stars.len())]).collect();
        let Some(found) = solve(resample.iter().copied()) else { continue };
        let own = sandwich(&resample, &found);
        for (i, draws) in draws.iter_mut().enumerate() {
            let t = (found.parameters[i] - solution.parameters[i]) / own[i];
            if t.is_finite() {
                draws.push(t);
            }
        }
    }
    let tail = 0.5 * (1.0 - confidence);
    let interval = |(i, draws): (usize, &mut Vec<f64>)| {
        if measured(i) < FEWEST {
            return student(i);
        }
        draws.sort_by(f64::total_cmp);
        // The upper tail of the resamples says how far below the truth may lie.
        let (below, above) = (quantile(draws, 1.0 - tail), -quantile(draws, tail));
        (with_choice(i, below * spread[i]), with_choice(i, above * spread[i]))
    };
    // A channel that nobody measured has no interval.
    let few = (0..channels).any(|i| (1..FEWEST).contains(&measured(i)));
    let method = if few { Method::Mixed } else { Method::Bootstrap };
    (draws.iter_mut().enumerate().map(interval).collect(), method)
}

/// Standard deviations of the parameters from how the stars disagree, whatever their stated variances.
fn sandwich(stars: &[&Normal], solution: &Solution) -> Vec<f64> {
    let n = solution.parameters.len();
    let known = solution.parameters.map(|p| if p.is_finite() { p } else { 0.0 });
    let mut middle = DMatrix::<f64>::zeros(n, n);
    for star in stars {
        let score = &star.b - &star.a * &known;
        middle.ger(1.0, &score, &score, 1.0);
    }
    let count = stars.len() as f64;
    // A channel that nobody measured has no covariance, and must not take that of the others along.
    let bread = solution.covariance.map(|v| if v.is_finite() { v } else { 0.0 });
    let covariance = &bread * middle * &bread * (count / (count - 1.0));
    (0..n).map(|i| covariance[(i, i)].sqrt()).collect()
}

/// Quantile of the normal distribution, by bisection of the complementary error function.
fn normal_quantile(p: f64) -> f64 {
    let (mut low, mut high) = (-10.0, 10.0);
    for _ in 0..80 {
        let middle: f64 = 0.5 * (low + high);
        let below = 0.5 * libm::erfc(-middle / std::f64::consts::SQRT_2);
        if below < p { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: quantiles of the normal distribution, as any table has them: 1.959964 at 97.5 %, 1.644854 at 95 %. Tolerance: their digits.
    #[test]
    fn quantiles_of_the_normal_distribution() {
        assert!((normal_quantile(0.975) - 1.959_964).abs() < 1e-6);
        assert!((normal_quantile(0.95) - 1.644_854).abs() < 1e-6);
    }
}
