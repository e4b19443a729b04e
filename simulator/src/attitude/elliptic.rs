//! Jacobi's elliptic functions for the tumbling of a rigid body, by the complementary parameter k'² = 1 − k², so that nothing is lost
//! where k is nearly 1 (a body that turns over).

use std::f64::consts::FRAC_PI_2;

/// Steps of the arithmetic–geometric mean that any k'² of at least 1e-28 needs, and one to spare.
const MOST_STEPS: usize = 10;

/// A modulus with the arithmetic–geometric means that its functions descend by (Abramowitz and Stegun 16.4, 17.6).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Modulus {
    complement: f64,
    quarter: f64,
    scale: f64,
    steps: usize,
    /// c/a and b/a of the steps 1 to `steps`.
    ratios: [(f64, f64); MOST_STEPS],
}

impl Modulus {
    /// Returns the modulus for a complementary parameter k'², above 0 and at most 1.
    pub fn of_complement(complement: f64) -> Self {
        let (mut a, mut b) = (1.0, complement.sqrt());
        let mut ratios = [(0.0, 1.0); MOST_STEPS];
        let mut steps = 0;
        while steps < MOST_STEPS && a - b > 2e-16 * a {
            let (mean, c) = (0.5 * (a + b), 0.5 * (a - b));
            b = (a * b).sqrt();
            a = mean;
            ratios[steps] = (c / a, b / a);
            steps += 1;
        }
        let scale = a * 2_f64.powi(steps as i32);
        Self { complement, quarter: FRAC_PI_2 / a, scale, steps, ratios }
    }

    /// The quarter period K.
    pub fn quarter(&self) -> f64 {
        self.quarter
    }

    /// sn, cn and dn of an argument; give it within a few periods, since its own rounding is not undone.
    pub fn sn_cn_dn(&self, u: f64) -> (f64, f64, f64) {
        let mut amplitude = self.scale * u;
        for &(c, b) in self.ratios[..self.steps].iter().rev() {
            let (sin, cos) = amplitude.sin_cos();
            // sin(2φ' − φ) = (c/a) sin φ; the cosine is kept as a sum of squares, where an arc sine would lose half the digits.
            amplitude = 0.5 * (amplitude + (c * sin).atan2(cos.hypot(b * sin)));
        }
        let (sn, cn) = amplitude.sin_cos();
        (sn, cn, (cn * cn + self.complement * sn * sn).sqrt())
    }

    /// The argument in (−2K, 2K] at which sn and cn have these values.
    pub fn argument(&self, sn: f64, cn: f64) -> f64 {
        let norm = sn.hypot(cn);
        let (sn, cn) = (sn / norm, cn / norm);
        let within = sn * carlson_rf(cn * cn, cn * cn + self.complement * sn * sn, 1.0);
        if cn >= 0.0 { within } else { (2.0 * self.quarter).copysign(sn) - within }
    }
}

/// Carlson's symmetric integral of the first kind, R_F(x, y, z) = ½ ∫₀^∞ dt / √((t+x)(t+y)(t+z)), by duplication and its
/// series to the seventh order (DLMF 19.36.1 and 19.36.2).
fn carlson_rf(x: f64, y: f64, z: f64) -> f64 {
    let (mut x, mut y, mut z) = (x, y, z);
    loop {
        let mean = (x + y + z) / 3.0;
        let (dx, dy) = (1.0 - x / mean, 1.0 - y / mean);
        let dz = -dx - dy;
        // The first term that is left out is of the eighth order.
        if dx.abs().max(dy.abs()).max(dz.abs()) < 5e-3 {
            let e2 = dx * dy - dz * dz;
            let e3 = dx * dy * dz;
            let series = 1.0 - e2 / 10.0 + e3 / 14.0 + e2 * e2 / 24.0
                - 3.0 * e2 * e3 / 44.0
                - 5.0 * e2.powi(3) / 208.0
                + 3.0 * e3 * e3 / 104.0
                + e2 * e2 * e3 / 16.0;
            return series / mean.sqrt();
        }
        let lambda = (x * y).sqrt() + (y * z).sqrt() + (z * x).sqrt();
        (x, y, z) = (0.25 * (x + lambda), 0.25 * (y + lambda), 0.25 * (z + lambda));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: Gauss' lemniscate constant, K(k² = ½) = Γ(¼)²/(4√π) = 1.854 074 677 301 371 9 (DLMF 19.20, 23.15); K(0) = π/2;
    /// K → ln(4/k') as k' → 0 (DLMF 19.12.1). Rounding alone.
    #[test]
    fn quarter_periods() {
        assert!((Modulus::of_complement(0.5).quarter() - 1.854_074_677_301_371_9).abs() < 1e-15);
        assert_eq!(Modulus::of_complement(1.0).quarter(), FRAC_PI_2);
        let k = Modulus::of_complement(1e-28).quarter();
        assert!((k - (4e14_f64).ln()).abs() < 2e-14, "{k}");
    }

    /// Truth: circular functions at k = 0; hyperbolic ones at k → 1, where sn differs from tanh by less than k'² (DLMF 22.10);
    /// values at K/2 (DLMF 22.5.2): sn² = 1/(1+k'), cn² = k'/(1+k'), dn² = k'. Rounding alone.
    #[test]
    fn limits_and_half_quarter_periods() {
        let circle = Modulus::of_complement(1.0);
        let line = Modulus::of_complement(1e-28);
        for i in -40..=40 {
            let u = 0.37 * f64::from(i);
            let (sn, cn, dn) = circle.sn_cn_dn(u);
            assert!((sn - u.sin()).abs() < 4e-15 && (cn - u.cos()).abs() < 4e-15, "{u}");
            assert!((dn - 1.0).abs() < 1e-15, "{u}");
            let (sn, cn, dn) = line.sn_cn_dn(u);
            assert!((sn - u.tanh()).abs() < 3e-15, "{u}: {sn}");
            assert!((cn - 1.0 / u.cosh()).abs() < 3e-15 && (dn - 1.0 / u.cosh()).abs() < 3e-15);
        }
        for complement in [0.999, 0.5, 1e-3, 1e-9, 1e-20] {
            let modulus = Modulus::of_complement(complement);
            let k1 = complement.sqrt();
            let (sn, cn, dn) = modulus.sn_cn_dn(0.5 * modulus.quarter());
            assert!((sn * sn - 1.0 / (1.0 + k1)).abs() < 4e-15, "{complement}");
            assert!((cn * cn - k1 / (1.0 + k1)).abs() < 4e-15, "{complement}");
            assert!((dn * dn - k1).abs() < 4e-15, "{complement}");
        }
    }

    /// Truth: the definition, F(am u) = u, by another algorithm (Carlson's duplication against Landen's descent).
    #[test]
    fn the_argument_comes_back() {
        for complement in [1.0, 0.7, 0.1, 1e-4, 1e-10] {
            let modulus = Modulus::of_complement(complement);
            for i in -19..=20 {
                let u = modulus.quarter() * f64::from(i) / 10.0;
                let (sn, cn, dn) = modulus.sn_cn_dn(u);
                let back = modulus.argument(sn, cn);
                // An error of 1e-16 in sn and cn is one of 1e-16/dn in u.
                assert!(
                    (back - u).abs() < 2e-15 * (1.0 + u.abs() + 1.0 / dn),
                    "{complement} {u} {back}"
                );
            }
        }
    }
}
