//! The exponential that a compiler can vectorise, and Lagrange weights.

/// e^−l for l of −300 or more, to a relative error below 1e−14; l above 700 counts as 700 (T = 1e−304, a normal number:
/// no denormal slows what follows).
///
/// x = −l is reduced to x = k ln 2 + r, |r| ≤ 0.3466, and e^r is its Taylor polynomial of degree 11, whose Lagrange
/// remainder is at most 0.3466¹²/12!·e^0.3466 = 9e−15. There is no branch, so a loop over slices is vectorised.
#[inline(always)]
pub(crate) fn exp_minus(l: f64) -> f64 {
    const LN2_HIGH: f64 = 0.693_147_180_369_123_8;
    const LN2_LOW: f64 = 1.908_214_929_270_587_7e-10;
    // Adding 1.5·2⁵² rounds to a whole number and leaves it in the low bits of the sum.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let x = -(if l < 700.0 { l } else { 700.0 });
    let rounded = x * std::f64::consts::LOG2_E + ROUND;
    let k = rounded - ROUND;
    let r = (x - k * LN2_HIGH) - k * LN2_LOW;
    // Estrin's pairing: short chains of dependent operations.
    let r2 = r * r;
    let r4 = r2 * r2;
    let p01 = 1.0 + r;
    let p23 = 1.0 / 2.0 + r * (1.0 / 6.0);
    let p45 = 1.0 / 24.0 + r * (1.0 / 120.0);
    let p67 = 1.0 / 720.0 + r * (1.0 / 5040.0);
    let p89 = 1.0 / 40_320.0 + r * (1.0 / 362_880.0);
    let pab = 1.0 / 3_628_800.0 + r * (1.0 / 39_916_800.0);
    let low = p01 + r2 * p23;
    let middle = p45 + r2 * p67;
    let high = p89 + r2 * pab;
    let power = f64::from_bits((rounded.to_bits() << 52).wrapping_add(1.0_f64.to_bits()));
    (low + r4 * (middle + r4 * high)) * power
}

/// Replaces every l by e^−l.
pub(crate) fn exp_minus_in_place(values: &mut [f64]) {
    for v in values {
        *v = exp_minus(*v);
    }
}

/// Number of nodes of one interpolation.
pub(crate) const STENCIL: usize = 6;

/// Lagrange weights for the nodes 0, 1, … 5 at `u`.
pub(crate) fn lagrange(u: f64) -> [f64; STENCIL] {
    // 1/Π_{j≠i}(i − j) for i = 0 … 5.
    const DENOMINATOR: [f64; STENCIL] =
        [-1.0 / 120.0, 1.0 / 24.0, -1.0 / 12.0, 1.0 / 12.0, -1.0 / 24.0, 1.0 / 120.0];
    let mut weights = DENOMINATOR;
    for (i, w) in weights.iter_mut().enumerate() {
        for j in 0..STENCIL {
            if j != i {
                *w *= u - j as f64;
            }
        }
    }
    weights
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_agrees_with_the_standard_library() {
        let mut worst = 0.0_f64;
        for i in -3_000..70_000 {
            let l = f64::from(i) * 0.009_999_7;
            let truth = (-l).exp();
            worst = worst.max((exp_minus(l) / truth - 1.0).abs());
        }
        assert!(worst < 1e-14, "worst relative error {worst:e}");
        assert_eq!(exp_minus(0.0), 1.0);
        assert!(exp_minus(1e6).is_normal() && exp_minus(f64::INFINITY) < 1e-303);
    }

    #[test]
    fn six_nodes_reproduce_a_polynomial_of_degree_five() {
        let f = |x: f64| 1.0 + x * (0.5 + x * (-0.25 + x * (0.125 + x * (-0.0625 + x * 0.03))));
        for i in 0..=50 {
            let u = f64::from(i) / 10.0;
            let sum: f64 = lagrange(u).iter().enumerate().map(|(i, w)| w * f(i as f64)).sum();
            assert!((sum - f(u)).abs() < 1e-12);
        }
    }
}
