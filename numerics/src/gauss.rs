//! Gauss–Legendre nodes.

use std::f64::consts::PI;

/// Returns the n nodes on −1…1, increasing, and their weights 2/((1−x²)P′ₙ(x)²): exact for polynomials of degree 2n−1. Newton's iteration on the
/// Legendre polynomial (Abramowitz and Stegun 25.4.29).
///
/// ```
/// let nodes = sunglint_numerics::gauss::legendre(2);
/// assert!((nodes[1].0 - 3_f64.sqrt().recip()).abs() < 1e-15 && (nodes[1].1 - 1.0).abs() < 1e-15);
/// ```
pub fn legendre(n: usize) -> Vec<(f64, f64)> {
    let polynomial = |x: f64| {
        let (mut before, mut p) = (1.0, x);
        for j in 2..=n {
            let j = j as f64;
            (before, p) = (p, ((2.0 * j - 1.0) * x * p - (j - 1.0) * before) / j);
        }
        (p, n as f64 * (x * p - before) / (x * x - 1.0))
    };
    (0..n)
        .map(|j| {
            let mut x = -(PI * (j as f64 + 0.75) / (n as f64 + 0.5)).cos();
            // It converges within six rounds for every n below a thousand.
            for _ in 0..8 {
                let (p, slope) = polynomial(x);
                x -= p / slope;
            }
            let (_, slope) = polynomial(x);
            (x, 2.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: ∫ x^k dx over −1…1 is 2/(k+1) for even k, 0 for odd k; exact to degree 2n−1. Tolerance: rounding of n products.
    #[test]
    fn polynomials_are_integrated_exactly() {
        for n in [1, 2, 3, 8, 17, 56, 200] {
            let nodes = legendre(n);
            assert!(nodes.windows(2).all(|p| p[0].0 < p[1].0));
            for k in 0..(2 * n).min(60) as i32 {
                let sum: f64 = nodes.iter().map(|(x, w)| w * x.powi(k)).sum();
                let exact = if k % 2 == 0 { 2.0 / f64::from(k + 1) } else { 0.0 };
                assert!((sum - exact).abs() < 1e-13, "n {n}, degree {k}: {sum} for {exact}");
            }
        }
    }
}
