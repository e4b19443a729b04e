//! Limb darkening.

use super::kit::law;
use sunglint_simulator::light::disc::profile::{
    PROFILES, brightness, exponent, factors, profiles, second_moments,
};

/// Truth: Hestroffer and Magnan (1998): the centre of the disc is (a + 2)/2 = 1.31, 1.25, 1.13 times its mean at 450, 550, 1000 nm, and the
/// exponents at the ends of both branches from their coefficients, as published.
#[test]
fn the_exponents_are_those_of_hestroffer_and_magnan() {
    for (nm, peak) in [(450.0, 1.31), (550.0, 1.25), (1000.0, 1.13)] {
        assert!((brightness(1.0, nm) - peak).abs() < 0.005, "{nm}");
        for mu in [0.1, 0.5, 0.9] {
            assert!((brightness(mu, nm) - law(mu, nm)).abs() < 1e-14);
        }
    }
    for (nm, a) in [(303.0, 0.948_4), (372.0, 0.678_5), (416.0, 0.678_9), (1100.0, 0.242_5)] {
        assert!((exponent(nm) - a).abs() < 1e-4, "{nm}: {}", exponent(nm));
    }
    // Held beyond 290 and 1300 nm.
    assert_eq!(exponent(1300.0), exponent(2500.0));
    assert_eq!(exponent(290.0), exponent(200.0));
}

/// Truth: the table of Neckel and Labs (1994, Solar Physics 153, 91): polynomials in μ fitted to measurements, and the ratio of mean and central
/// brightness. One parameter cannot do all: the mean keeps to it within 1.2 %, the disc within 2.5 % of the centre for μ ≥ 0.5, and
/// towards the limb the law is too dark, by 8 % of the centre at μ = 0.1.
#[test]
fn the_law_follows_measurements() {
    let table = [
        (303.327, [0.08011, 0.70695, 0.49910, -0.31080, -0.02177, 0.04642], 0.6826),
        (329.897, [0.09188, 0.92459, 0.19604, -0.39546, 0.23599, -0.05303], 0.7116),
        (427.930, [0.14249, 1.28796, -1.19564, 1.68603, -1.36658, 0.44572], 0.7495),
        (541.760, [0.26073, 1.27428, -1.30352, 1.47085, -0.96618, 0.26384], 0.8002),
        (669.400, [0.34685, 1.37539, -2.04425, 2.70493, -1.94290, 0.55999], 0.8360),
        (869.600, [0.45396, 1.25101, -2.02958, 2.75410, -2.02287, 0.59338], 0.8701),
        (1046.60, [0.49870, 1.21429, -2.06976, 2.80703, -2.05247, 0.60221], 0.8841),
    ];
    let (mut mean, mut inner, mut outer) = (0.0_f64, 0.0_f64, 0.0_f64);
    for (nm, coefficients, ratio) in table {
        mean = mean.max((1.0 / brightness(1.0, nm) / ratio - 1.0).abs());
        for k in 2..=20 {
            let mu = 0.05 * f64::from(k);
            let measured = coefficients.iter().rev().fold(0.0, |sum, c| sum * mu + c);
            let off = (brightness(mu, nm) / brightness(1.0, nm) - measured).abs();
            let worst = if k >= 10 { &mut inner } else { &mut outer };
            *worst = worst.max(off);
        }
    }
    eprintln!("against Neckel and Labs: mean {mean:.1e}, inner {inner:.1e}, outer {outer:.1e}");
    assert!(mean < 0.012 && inner < 0.025 && outer < 0.085);
}

/// Truth: the power law itself. The sum over profiles keeps to it within 1e-5 of the disc's light (mean of the difference over the disc), 6e-4 of
/// the mean brightness for μ above 0.01 and 2e-3 at the limb, at all wavelengths; its mean stays 1 to rounding.
#[test]
fn five_profiles_make_every_wavelength() {
    let (mut mean, mut inner, mut limb) = (0.0_f64, 0.0_f64, 0.0_f64);
    for nm in (290..=1300).step_by(5).map(f64::from) {
        let l = factors(nm);
        let sum = |mu: f64| -> f64 { profiles(mu).iter().zip(l).map(|(p, l)| p * l).sum() };
        let n = 2000;
        let mut off = 0.0;
        for k in 0..n {
            let mu = (f64::from(k) + 0.5) / f64::from(n);
            let difference = (sum(mu) - brightness(mu, nm)).abs();
            off += 2.0 * mu * difference / f64::from(n);
            if mu > 0.01 {
                inner = inner.max(difference);
            }
        }
        for k in 1..60 {
            let mu = 0.7_f64.powi(k);
            limb = limb.max((sum(mu) - brightness(mu, nm)).abs());
        }
        mean = mean.max(off);
    }
    eprintln!("profiles: {mean:.1e} on the average, {inner:.1e} within, {limb:.1e} at the limb");
    assert!(mean < 1e-5 && inner < 6e-4 && limb < 2e-3);
    // Means and second moments by the substitution μ = t³².
    let n = 20_000;
    let (mut means, mut moments) = ([0.0; PROFILES], [0.0; PROFILES]);
    for k in 0..n {
        let t = (f64::from(k) + 0.5) / f64::from(n);
        let mu = t.powi(4);
        let weight = 8.0 * t.powi(7) / f64::from(n);
        for (j, p) in profiles(mu).into_iter().enumerate() {
            means[j] += weight * p;
            moments[j] += weight * p * 0.5 * (1.0 - mu * mu);
        }
    }
    for j in 0..PROFILES {
        assert!((means[j] - f64::from(u8::from(j == 0))).abs() < 1e-7, "{means:?}");
        assert!((moments[j] - second_moments()[j]).abs() < 1e-7, "{moments:?}");
    }
}
