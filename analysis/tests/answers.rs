//! Curves on which a single answer was wrong: tumbling bodies near small ratios of their periods, glints that wander, and folded turns with like halves. All are synthetic, and the truth is what was put in.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use rand::SeedableRng as _;
use rand_distr::{Distribution as _, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus as Random;
use std::f64::consts::TAU;
use sunglint_analysis::period::verdict::Outcome;
use sunglint_analysis::period::{Options, Verdict, verdict};
use sunglint_analysis::series::Series;

/// The verdict on a light with noise of a standard deviation, at even times.
fn asked(
    light: impl Fn(f64) -> f64,
    (step_s, samples, exposure_s): (f64, u32, f64),
    (sigma, seed): (f64, u64),
) -> Verdict {
    let mut random = Random::seed_from_u64(seed);
    let time: Vec<f64> = (0..samples).map(|i| step_s * f64::from(i)).collect();
    let noisy = |t: &f64| {
        let off: f64 = StandardNormal.sample(&mut random);
        light(*t) + sigma * off
    };
    let value: Vec<f64> = time.iter().map(noisy).collect();
    let mut series = Series::new("c", &time, &value, None).unwrap();
    series.exposure_s = exposure_s;
    verdict(&[series], &Options::default()).unwrap()
}

fn holds(found: &Verdict, period_s: f64) -> bool {
    let near = |p: f64| (p / period_s - 1.0).abs() < 0.01;
    match &found.outcome {
        Outcome::One(e) => near(e.period_s),
        Outcome::Two(a, b) => near(a.period_s) || near(b.period_s),
        Outcome::Family(all) => all.iter().any(|m| near(m.estimate.period_s)),
        _ => false,
    }
}

/// Truth: the two periods that were put in, near 2 : 1, 5 : 3, 3 : 2 and 5 : 2, each with two harmonics, seen for 300 s. No single period is told, and two, or a family with both (to 1 %), or a refusal are. Tolerance of the two: 1 %, as they lie 1.6 % and more from the ratio, but for 24 and 12.1 s (0.8 %).
#[test]
fn tumblers_near_a_small_ratio_are_no_single_period() {
    let all = [(20.0, 9.836), (24.0, 12.1), (15.0, 9.15), (18.0, 11.7), (20.0, 8.13), (17.1, 30.7)];
    for (k, (a, b)) in all.into_iter().enumerate() {
        let light = |t: f64| {
            let (p, q) = (TAU * t / a, TAU * t / b + 1.0);
            10.0 + 0.4 * p.sin()
                + 0.1 * (2.0 * p + 0.7).sin()
                + 0.3 * q.sin()
                + 0.1 * (2.0 * q).cos()
        };
        let found = asked(light, (0.5, 600, 0.0), (0.03, 50 + k as u64));
        let outcome = &found.outcome;
        assert!(!matches!(outcome, Outcome::One(_)), "{a} {b}: {outcome:?}");
        let refused = matches!(outcome, Outcome::NotEnough(_));
        assert!(refused || holds(&found, a) && holds(&found, b), "{a} {b}: {outcome:?}");
    }
}

/// Truth: the period that was put in, 19.3 s; the light is that of a glint that wanders by a fifth of a turn while it comes and goes over 22 turns. The answer holds the period within two standard deviations, as the wander is 1.3 of those that are presumed. A body of the same
/// glint that stays has an uncertainty a hundred times smaller.
#[test]
fn a_glint_that_wanders_is_in_the_uncertainty() {
    let glint = |turn: f64| (60.0 * ((TAU * turn).cos() - 1.0)).exp();
    let sampling = (0.35, 1200, 0.0);
    for seed in 0..3 {
        let wanders = |t: f64| {
            let along = t / 420.0;
            let seen = (-0.5 * ((along - 0.45) / 0.25).powi(2)).exp();
            5.0 + 1.5 * seen * glint(t / 19.3 + 0.2 * (along - 0.5))
                + 0.1 * (TAU * t / 19.3 + 1.0).sin()
        };
        let found = asked(wanders, sampling, (0.03, seed));
        let best = found.best.unwrap();
        let turns = (best.period_s / 19.3).round().max(1.0);
        let off = (best.period_s / turns - 19.3).abs();
        assert!(off < 2.0 * best.sigma_s / turns, "{best:?}");
        assert!(found.drift_turns > 0.05, "{}", found.drift_turns);
        let stays = asked(|t| 5.0 + 1.5 * glint(t / 19.3), sampling, (0.03, seed));
        let steady = stays.best.unwrap();
        assert!(steady.sigma_s < 0.01 * best.sigma_s, "{steady:?} {best:?}");
        assert!((steady.period_s - 19.3).abs() < 4.0 * steady.sigma_s, "{steady:?}");
    }
}

/// Truth: periods that were put in. The light of two like halves is seen at the folded half of the turn, so the turn is the double of a folded period and belongs to the family.
#[test]
fn doubles_of_folded_periods_are_in_the_family() {
    for (step_s, period_s) in [(2.0, 6.4189), (2.0, 3.33), (1.0, 2.617)] {
        let light = |t: f64| {
            let turn = TAU * t / period_s;
            10.0 + (2.0 * turn).sin() + 0.02 * (turn + 0.4).sin()
        };
        let found = asked(light, (step_s, 400, 0.05 * step_s), (0.4, 8));
        assert!(holds(&found, period_s), "{period_s}: {:?}", found.outcome);
    }
}
