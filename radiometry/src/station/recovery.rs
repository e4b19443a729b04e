//! The intervals between counts of a detector that recovers exponentially after its dead time.

/// Mean (s) and variance (s²) of the interval between counts under a true rate above 0 Hz (Krause and Walenta, arXiv 2507.10361: the efficiency is back to
/// 1 − e^(−s/τ_r) of its own s after the dead time). With a = nτ_r the moments of s are sums of positive terms: τ_r Σ c_k and 2τ_r² Σ c_k H_k,
/// c_k = a^k/(a(a+1)…(a+k)), H_k = Σ_{j≤k} 1/(a+j); the first is τ_r eᵃ a^(−a) γ(a, a).
pub(super) fn interval(true_hz: f64, dead_time_s: f64, recovery_s: f64) -> (f64, f64) {
    let a = true_hz * recovery_s;
    // Without a recovery worth the name, and where it is all: the exponential's, and the sums' own limit, past any detector.
    if a < 1e-12 {
        return (dead_time_s + 1.0 / true_hz, true_hz.powi(-2));
    }
    let (mut term, mut harmonic) = (1.0 / a, 1.0 / a);
    let (mut mean, mut square, mut k) = (0.0, 0.0, 0.0);
    while term > 1e-17 * mean {
        mean += term;
        square += term * harmonic;
        k += 1.0;
        term *= a / (a + k);
        harmonic += 1.0 / (a + k);
    }
    let mean_s = recovery_s * mean;
    (dead_time_s + mean_s, 2.0 * recovery_s * recovery_s * square - mean_s * mean_s)
}

/// Rate at which pixels fire, Hz, that share a true rate and recover exponentially after each count of their own, and the variance of their number over its mean: the sum of as many independent
/// renewal processes of the interval above.
pub(super) fn fired(true_hz: f64, pixels: u32, recovery_s: f64) -> (f64, f64) {
    if true_hz <= 0.0 {
        return (0.0, 1.0);
    }
    let pixels = f64::from(pixels.max(1));
    let (mean_s, variance_s2) = interval(true_hz / pixels, 0.0, recovery_s);
    (pixels / mean_s, variance_s2 / (mean_s * mean_s))
}

#[cfg(test)]
mod tests {
    use crate::station::DeadTime;

    /// Truth: the survival exp(−ns + nτ_r(1−e^(−s/τ_r))) of the interval after the dead time, integrated by the midpoint rule (4e5 steps, error below 1e-7): mean, and
    /// σ_n = √(σ²/(μ³ t))/|dm/dn| by differences of such means.
    #[test]
    fn counts_are_those_of_the_renewal_process() {
        let (dead_time_s, recovery_s) = (1e-6, 3e-7);
        let law = DeadTime::ExponentialRecovery { dead_time_s, recovery_s };
        let moments = |n: f64| {
            let width = (40.0 / n + 20.0 * (recovery_s / n).sqrt() + 10.0 * recovery_s) / 4e5;
            let (mut first, mut second) = (0.0, 0.0);
            for i in 0..400_000 {
                let s = (f64::from(i) + 0.5) * width;
                let survival = (-n * s - n * recovery_s * (-s / recovery_s).exp_m1()).exp();
                first += survival * width;
                second += 2.0 * s * survival * width;
            }
            (dead_time_s + first, second - first * first)
        };
        for n in [1e3, 1e5, 1e6, 3e6, 3e7] {
            let (mean, variance) = moments(n);
            let counted = law.counted_hz(n).unwrap();
            assert!((counted * mean - 1.0).abs() < 1e-6, "{n}: {counted} {mean}");
            let slope = (1.0 / moments(n * 1.001).0 - 1.0 / moments(n * 0.999).0) / (0.002 * n);
            let sigma = (variance / mean.powi(3) / 0.1).sqrt() / slope;
            let found = law.sigma_hz(n, 0.1).unwrap();
            assert!((found / sigma - 1.0).abs() < 1e-4, "{n}: {found} {sigma}");
        }
        assert_eq!(law.counted_hz(0.0), Some(0.0));
        assert_eq!(law.sigma_hz(0.0, 0.1), Some(0.0));
    }
}
