//! F₀ and D from retro-reflection on the nodes.
//!
//! With the masking of retro-reflection, G₁ = cosθ/σ, f(ω, ω) = F₀ D G₁/(4 cos²θ) says F₀ D(ω) = 4 f(ω, ω) cosθ σ(ω): D is the Perron vector of a
//! kernel that is nowhere negative, F₀ its eigenvalue. F₀ is no reflectance of a surface that is not made of mirrors: it may exceed 1.

use super::nodes::Hemisphere;
use super::{Convergence, NdfError};

/// More iterations than a lobe needs: GGX with a roughness of 0.6 takes 19.
const MOST_ITERATIONS: usize = 500;
/// Tolerance of the remainder K v − F₀ v, as a part of F₀.
const TOLERANCE: f64 = 1e-13;

/// The density of normals on the nodes.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// F₀.
    pub f0: f64,
    /// D, sr⁻¹, with ∫ D cosθ dω = 1.
    pub density: Vec<f64>,
    /// σ, the projected area: 1 towards the normal.
    pub sigma: Vec<f64>,
    /// How the iteration went.
    pub convergence: Convergence,
}

/// Power iteration on retro-reflection `f` \[sr⁻¹\] on the nodes of `over`.
///
/// # Errors
/// [`NdfError::Values`] where `f` is not finite, negative or 0 everywhere or is not as long as there are nodes, [`NdfError::NotConverged`].
pub fn solve(over: &impl Hemisphere, f: &[f64]) -> Result<Solution, NdfError> {
    let n = over.cosines().len();
    if f.len() != n {
        return Err(NdfError::Values(format!("{} values for {n} nodes", f.len())));
    }
    if let Some(at) = f.iter().position(|f| !f.is_finite() || *f < 0.0) {
        return Err(NdfError::Values(format!("{} sr⁻¹ at node {at}", f[at])));
    }
    let factor: Vec<f64> = f.iter().zip(over.cosines()).map(|(f, c)| 4.0 * f * c).collect();
    let mut density = factor.clone();
    let whole = over.projected(&density);
    if !(whole > 0.0 && whole.is_finite()) {
        return Err(NdfError::Values("0 at every node".into()));
    }
    density.iter_mut().for_each(|d| *d /= whole);
    let mut sigma = vec![0.0; n];
    let (mut f0, mut residual, mut iterations) = (0.0, f64::INFINITY, 0);
    while iterations < MOST_ITERATIONS {
        iterations += 1;
        over.area(&density, &mut sigma);
        // F₀ is the projected area of K v, as that of v is 1.
        let (mut left, mut size) = (0.0, 0.0);
        let next: Vec<f64> = factor.iter().zip(&sigma).map(|(c, s)| c * s).collect();
        f0 = over.projected(&next);
        for (d, next) in density.iter_mut().zip(&next) {
            left += (next - f0 * *d).powi(2);
            size += *d * *d;
            *d = next / f0;
        }
        residual = (left / size).sqrt();
        if residual <= TOLERANCE * f0 {
            break;
        }
    }
    over.area(&density, &mut sigma);
    let eigenvalue_gap = gap(over, &factor, (&density, &sigma), f0);
    let convergence = Convergence { residual, iterations, eigenvalue_gap };
    // Rounding may stop it before the tolerance does.
    if residual.is_nan() || residual > 1e3 * TOLERANCE * f0 {
        return Err(NdfError::NotConverged { residual, iterations, eigenvalue_gap });
    }
    Ok(Solution { f0, density, sigma, convergence })
}

/// 1 − |λ₂|/λ₁: the kernel diag(c) A diag(w), with A symmetric, on what is orthogonal to its left eigenvector w v/c = w σ/F₀.
fn gap(over: &impl Hemisphere, factor: &[f64], (density, sigma): (&[f64], &[f64]), f0: f64) -> f64 {
    let left: Vec<f64> = sigma.iter().zip(over.weights()).map(|(s, w)| s * w).collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let whole = dot(&left, density);
    let orthogonal = |x: &mut [f64]| {
        let share = dot(&left, x) / whole;
        x.iter_mut().zip(density).for_each(|(x, d)| *x -= share * d);
    };
    // Anything that is not the density itself: it in a ring, negative beyond.
    let mut x: Vec<f64> =
        density.iter().zip(over.cosines()).map(|(d, c)| d * (c * c - 0.5)).collect();
    let mut sigma = vec![0.0; x.len()];
    let mut second = 0.0;
    for _ in 0..40 {
        orthogonal(&mut x);
        let size = dot(&x, &x).sqrt();
        // What is left of a lobe so narrow that the kernel has but one eigenvalue is rounding.
        if size.is_nan() || size <= 1e-14 * f0 {
            return 1.0;
        }
        x.iter_mut().for_each(|x| *x /= size);
        over.area(&x, &mut sigma);
        x.iter_mut().zip(factor.iter().zip(&sigma)).for_each(|(x, (c, s))| *x = c * s);
        let now = dot(&x, &x).sqrt();
        let settled = (now - second).abs() <= 1e-4 * now;
        second = now;
        if settled {
            break;
        }
    }
    1.0 - second / f0
}
