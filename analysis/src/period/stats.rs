//! Tails of the distributions that tests need.

use libm::lgamma;

/// Enough for every argument that a test here can have: the continued fractions converge in about √(a) rounds.
const ROUNDS: usize = 10_000;
const TINY: f64 = 1e-300;

/// The upper tail of χ² with any number of degrees of freedom: P(X > x).
pub fn chi2_survival(x: f64, degrees: f64) -> f64 {
    gamma_survival(0.5 * degrees, 0.5 * x)
}

/// The regularised upper incomplete gamma function Q(a, x), by its series or its continued fraction (Lentz).
fn gamma_survival(a: f64, x: f64) -> f64 {
    if x.is_nan() || a.is_nan() || a <= 0.0 {
        return f64::NAN;
    }
    if x <= 0.0 {
        return 1.0;
    }
    let scale = a * x.ln() - x - lgamma(a);
    if x < a + 1.0 {
        let (mut term, mut sum) = (1.0 / a, 1.0 / a);
        for k in 1..ROUNDS {
            term *= x / (a + k as f64);
            sum += term;
            if term < sum * 1e-16 {
                break;
            }
        }
        return (1.0 - sum * scale.exp()).clamp(0.0, 1.0);
    }
    let mut b = x + 1.0 - a;
    let mut c = 1.0 / TINY;
    let mut d = 1.0 / b;
    let mut h = d;
    for k in 1..ROUNDS {
        let k = k as f64;
        let a_k = -k * (k - a);
        b += 2.0;
        d = 1.0 / nonzero(a_k * d + b);
        c = nonzero(b + a_k / c);
        let by = d * c;
        h *= by;
        if (by - 1.0).abs() < 1e-15 {
            break;
        }
    }
    (scale.exp() * h).clamp(0.0, 1.0)
}

fn nonzero(x: f64) -> f64 {
    if x.abs() < TINY { TINY } else { x }
}

/// The upper tail of the F distribution: P(X > x).
pub fn f_survival(x: f64, numerator: f64, denominator: f64) -> f64 {
    if x.is_nan() || x <= 0.0 {
        return if x.is_nan() { x } else { 1.0 };
    }
    beta_share(0.5 * denominator, 0.5 * numerator, denominator / (denominator + numerator * x))
}

/// The regularised incomplete beta function I_x(a, b), by its continued fraction (Lentz).
fn beta_share(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    if x >= 1.0 {
        return 1.0;
    }
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - beta_share(b, a, 1.0 - x);
    }
    let scale = a * x.ln() + b * (-x).ln_1p() + lgamma(a + b) - lgamma(a) - lgamma(b);
    let mut c = 1.0;
    let mut d = 1.0 / nonzero(1.0 - (a + b) * x / (a + 1.0));
    let mut h = d;
    for m in 1..ROUNDS {
        let m = m as f64;
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        d = 1.0 / nonzero(1.0 + even * d);
        c = nonzero(1.0 + even / c);
        h *= d * c;
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        d = 1.0 / nonzero(1.0 + odd * d);
        c = nonzero(1.0 + odd / c);
        let by = d * c;
        h *= by;
        if (by - 1.0).abs() < 1e-15 {
            break;
        }
    }
    (scale.exp() * h / a).clamp(0.0, 1.0)
}

/// One p-value from several independent ones, by Fisher's sum, of which the share `independent` is (Brown 1975, with one mean correlation).
pub fn fisher(p: impl IntoIterator<Item = f64>, independent: f64) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for p in p {
        sum -= 2.0 * p.max(TINY).ln();
        n += 1.0;
    }
    if n == 0.0 { 1.0 } else { chi2_survival(sum * independent, 2.0 * n * independent) }
}
