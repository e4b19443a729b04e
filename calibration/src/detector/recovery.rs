//! A detector that is deaf for a time after each count and then recovers exponentially.
//!
//! Krause and Walenta, arXiv 2507.10361: s after the dead time τ_d the efficiency is back to 1 − e^(−s/τ_r) of its own, so that counts are a renewal
//! process with the hazard n(1 − e^(−s/τ_r)) and the survival exp(−ns + a(1 − e^(−s/τ_r))), a = nτ_r. Expanded in powers of
//! 1 − e^(−s/τ_r) its moments are sums of positive terms (beta functions), which round to machine precision for all a:
//!
//! ```text
//! c_k = a^k/(a(a+1)…(a+k)),  H_k = Σ_{j≤k} 1/(a+j),  E[s] = τ_r Σ c_k,  E[s²] = 2 τ_r² Σ c_k H_k
//! ```
//!
//! The first sum is τ_r eᵃ a^(−a) γ(a, a). A lost event hinders nothing, whether it came in the dead time or in the recovery.

use super::law::{At, TRUSTED};

/// Dead time and time constant of the recovery (above 0), s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Recovery {
    pub dead_s: f64,
    pub recovery_s: f64,
}

/// Mean interval between counts, its derivatives by the rate, its variance.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Interval {
    mean_s: f64,
    /// dμ/dn, s².
    first_s2: f64,
    /// d²μ/dn², s³.
    second_s3: f64,
    variance_s2: f64,
}

/// nτ beyond which nothing is asked of the law: it is saturated long before.
const MOST: f64 = 1e4;

impl Recovery {
    /// The intervals of counts under a rate n (above 0), Hz.
    fn interval(&self, rate_hz: f64) -> Interval {
        let a = rate_hz * self.recovery_s;
        let mut c = 1.0 / a;
        let (mut h, mut g) = (c, c * c);
        let [mut sum, mut second_moment, mut first, mut second] = [0.0_f64; 4];
        for k in 0_u32.. {
            let k = f64::from(k);
            sum += c;
            second_moment += c * h;
            // d ln c_k/da, and its own derivative.
            let d = k / a - h;
            first += c * d;
            second += c * (d * d - k / (a * a) + g);
            let next = c * a / (a + k + 1.0);
            // The derivatives' terms carry another k²/a².
            if next * (1.0 + k * k / a).powi(2) < 1e-18 * sum && k > 3.0 {
                break;
            }
            c = next;
            h += 1.0 / (a + k + 1.0);
            g += (a + k + 1.0).powi(-2);
        }
        let tau = self.recovery_s;
        let mean = tau * sum;
        Interval {
            mean_s: self.dead_s + mean,
            first_s2: tau * tau * first,
            second_s3: tau.powi(3) * second,
            variance_s2: 2.0 * tau * tau * second_moment - mean * mean,
        }
    }

    /// The law at a measured rate; `None` where no rate up to 10⁴ per time constant counts as much.
    pub fn invert(&self, measured_hz: f64) -> Option<At> {
        let m = measured_hz;
        if m <= 0.0 {
            let memory_s = self.dead_s + self.recovery_s;
            return Some(At {
                rate_hz: 0.0,
                slope: 1.0,
                curvature_s: 2.0 * memory_s,
                fano: 1.0,
                slope_at_zero: 1.0,
                trusted: true,
            });
        }
        let alive = 1.0 - m * self.dead_s;
        let most = MOST / self.recovery_s;
        // The recovery only slows the detector further.
        let mut low = m / alive;
        if alive <= 0.0 || low >= most {
            return None;
        }
        let mut high = f64::INFINITY;
        let mut n = low;
        for _ in 0..200 {
            let at = self.interval(n);
            // ln m(n) is concave in ln n: Newton's steps in logarithms from below stay below, but for rounding.
            let excess = (1.0 / at.mean_s).ln() - m.ln();
            if excess > 0.0 {
                high = high.min(n);
            } else {
                low = low.max(n);
            }
            let step = -excess / (-n * at.first_s2 / at.mean_s);
            let next = n * step.exp();
            let inside = (low..=high).contains(&next);
            let next = if inside || high.is_infinite() { next } else { (low * high).sqrt() };
            if next >= most || next.is_nan() {
                return None;
            }
            let done = (next / n - 1.0).abs() < 1e-14;
            n = next;
            if done {
                break;
            }
        }
        let at = self.interval(n);
        let (first, second) = (
            -at.first_s2 / at.mean_s.powi(2),
            2.0 * at.first_s2.powi(2) / at.mean_s.powi(3) - at.second_s3 / at.mean_s.powi(2),
        );
        Some(At {
            rate_hz: n,
            slope: 1.0 / first,
            curvature_s: -second / first.powi(3),
            fano: at.variance_s2 / at.mean_s.powi(2),
            slope_at_zero: 1.0,
            trusted: n * self.dead_s.max(self.recovery_s) <= TRUSTED,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the moments as integrals of the survival function, by the midpoint rule in 4e5 steps over 60 mean intervals (error below 1e-7), and
    /// the derivatives as differences of such integrals.
    #[test]
    fn moments_are_those_of_the_survival_function() {
        let law = Recovery { dead_s: 1.0, recovery_s: 0.3 };
        let moments = |n: f64| {
            let end = 40.0 / n + 3.0 * (law.recovery_s / n).sqrt() * 10.0 + 10.0 * law.recovery_s;
            let steps = 400_000;
            let width = end / f64::from(steps);
            let (mut first, mut second) = (0.0, 0.0);
            for i in 0..steps {
                let s = (f64::from(i) + 0.5) * width;
                let recovered = -(-s / law.recovery_s).exp_m1();
                let survival = (-n * s + n * law.recovery_s * recovered).exp();
                first += survival * width;
                second += 2.0 * s * survival * width;
            }
            (law.dead_s + first, second - first * first)
        };
        for n in [1e-3, 0.1, 1.0, 3.0, 50.0, 2000.0] {
            let found = law.interval(n);
            let (mean, variance) = moments(n);
            assert!((found.mean_s / mean - 1.0).abs() < 1e-7, "{n}: {found:?} {mean}");
            assert!((found.variance_s2 / variance - 1.0).abs() < 1e-6, "{n}: {found:?} {variance}");
            let h = n * 1e-3;
            let (up, down) = (moments(n + h).0, moments(n - h).0);
            assert!((found.first_s2 / ((up - down) / (2.0 * h)) - 1.0).abs() < 1e-5, "{n}");
            let second = (up - 2.0 * mean + down) / (h * h);
            assert!((found.second_s3 / second - 1.0).abs() < 1e-3, "{n}: {found:?} {second}");
        }
    }

    /// Truth: the law itself, forwards; and no recovery worth the name is the plain dead time n = m/(1−mτ), to first order in τ_r less 2τ_r n.
    #[test]
    fn the_inverse_comes_back() {
        for (dead_s, recovery_s) in [(1.0, 0.2), (1.0, 5.0), (0.0, 1.0)] {
            let law = Recovery { dead_s, recovery_s };
            for n in [1e-9, 1e-3, 0.3, 3.0, 30.0, 900.0] {
                let at = law.invert(1.0 / law.interval(n).mean_s).unwrap();
                let amplified = at.slope * 1.0 / law.interval(n).mean_s / n;
                assert!((at.rate_hz / n - 1.0).abs() < 1e-13 * (1.0 + amplified), "{n}: {at:?}");
            }
        }
        let at = Recovery { dead_s: 1.0, recovery_s: 1e-9 }.invert(0.75).unwrap();
        assert!((at.rate_hz - 3.0).abs() < 1e-7 && (at.slope - 16.0).abs() < 1e-6, "{at:?}");
        assert!((at.fano - 1.0 / 16.0).abs() < 1e-6 && (at.curvature_s - 128.0).abs() < 1e-3);
        assert_eq!(Recovery { dead_s: 1.0, recovery_s: 0.1 }.invert(1.0), None);
    }
}
