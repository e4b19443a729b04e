//! Uncertainties where points err together: a place between two frames is wrong for all bins between them, and twinkling lasts.
//!
//! The covariance is A⁻¹BA⁻¹, A the curvature of the cost and B the long-run covariance of the scores ψ(r)·∂model/σ along each star's points in their
//! order (heteroscedasticity and autocorrelation consistent; Newey and West 1987), with the flat-top kernel and the empirical choice of
//! its width of Politis (2003): 2m lags, m the last before which the residuals' autocorrelation is beyond twice its standard error.

use nalgebra::{DMatrix, DVector};

/// Lags that are looked at, at most.
const MOST_LAGS: usize = 400;
/// Lags in a row without a significant autocorrelation after which there is none (Politis 2003, K_n for thousands of points).
const QUIET: usize = 5;

/// Each star's points, in their order.
pub(super) fn sequences(stars: &[usize], number: usize) -> Vec<Vec<usize>> {
    let mut sequences = vec![Vec::new(); number];
    for (point, star) in stars.iter().enumerate() {
        sequences[*star].push(point);
    }
    sequences
}

/// Over how many points the residuals are correlated: the last lag of those from 1 on whose autocorrelation is beyond twice what chance makes; 0 for none.
pub(super) fn reach(residuals: &[f64], sequences: &[Vec<usize>]) -> usize {
    let shortest = sequences.iter().map(Vec::len).max().unwrap_or(0);
    let most = (shortest / 4).min(MOST_LAGS);
    let variance: f64 = residuals.iter().map(|r| r * r).sum::<f64>() / residuals.len() as f64;
    if variance <= 0.0 || !variance.is_finite() {
        return 0;
    }
    let (mut last, mut quiet) = (0, 0);
    for lag in 1..=most {
        let (mut sum, mut pairs) = (0.0, 0.0);
        for sequence in sequences {
            for (a, b) in sequence.iter().zip(sequence.iter().skip(lag)) {
                sum += residuals[*a] * residuals[*b];
                pairs += 1.0;
            }
        }
        if pairs < 4.0 {
            break;
        }
        if sum / pairs / variance > 2.0 / f64::sqrt(pairs) {
            (last, quiet) = (lag, 0);
        } else {
            quiet += 1;
            if quiet == QUIET {
                break;
            }
        }
    }
    last
}

/// B, the covariance of the sum of all scores: `rows` are the sparse slopes of the points, `psi` their ψ(r).
pub(super) fn long_run(
    rows: &[Vec<(usize, f64)>],
    psi: &[f64],
    sequences: &[Vec<usize>],
    reach: usize,
    numbers: usize,
) -> DMatrix<f64> {
    let sum = |kernel: &dyn Fn(usize) -> f64| {
        let mut b = DMatrix::<f64>::zeros(numbers, numbers);
        let mut add = |i: usize, j: usize, weight: f64| {
            for (p, left) in &rows[i] {
                for (q, right) in &rows[j] {
                    b[(*p, *q)] += weight * psi[i] * psi[j] * left * right;
                }
            }
        };
        for sequence in sequences {
            for (k, i) in sequence.iter().enumerate() {
                add(*i, *i, 1.0);
                for (lag, j) in sequence.iter().skip(k + 1).take(2 * reach).enumerate() {
                    let weight = kernel(lag + 1);
                    add(*i, *j, weight);
                    add(*j, *i, weight);
                }
            }
        }
        b
    };
    let width = 2.0 * reach as f64;
    let flat_top = sum(&|lag| (2.0 * (1.0 - lag as f64 / (width + 1.0))).min(1.0));
    // The flat top may make a matrix that is no covariance; the triangle never does.
    let size = DVector::from_fn(numbers, |k, _| flat_top[(k, k)].max(0.0).sqrt());
    let scaled = DMatrix::from_fn(numbers, numbers, |i, j| {
        flat_top[(i, j)] / (size[i] * size[j]).max(f64::MIN_POSITIVE)
    });
    if scaled.symmetric_eigenvalues().min() > 0.0 {
        return flat_top;
    }
    sum(&|lag| 1.0 - lag as f64 / (width + 1.0))
}
