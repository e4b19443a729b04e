//! Dead time, recovery and afterpulses found in the intervals between counts of detectors simulated photon by photon.
#![allow(clippy::unwrap_used)]

use crate::events::{Detector, Events};
use sunglint_calibration::detector::{DeadTimeEstimate, IntervalError, IntervalHistogram};
use sunglint_numerics::measured::Measured;
use sunglint_radiometry::station::DeadTime;

/// Intervals of so many counts in bins of 20 ns up to 20 µs.
fn histogram(detector: Detector, rate_hz: f64, counts: usize, seed: u64) -> IntervalHistogram {
    let mut events = Events::new(detector, seed);
    let mut histogram = IntervalHistogram::new(20_000, 1000).unwrap();
    for _ in 0..counts {
        histogram.add((events.next(rate_hz, f64::INFINITY).unwrap() * 1e12) as i64);
    }
    histogram
}

fn near(found: Measured, truth: f64, sigmas: f64) {
    assert!(found.pull(truth).abs() <= sigmas, "{found}, truth {truth}");
}

/// Truth: the dead time and the light that the photons were drawn from. 4 σ each; the dead time to a tenth of a bin of 20 ns besides.
#[test]
fn a_plain_dead_time_is_found() {
    let found = histogram(Detector::NonParalysable(1e-6), 2e5, 200_000, 1).estimate().unwrap();
    let DeadTimeEstimate { dead_time_s, recovery_s, rate_hz, afterpulses, .. } = found.clone();
    println!("{found:?}");
    assert!(recovery_s.is_none() && !afterpulses.are_there(), "{found:?}");
    near(rate_hz, 2e5, 4.0);
    near(dead_time_s, 1e-6, 4.0);
    assert!((dead_time_s.value - 1e-6).abs() < 0.4e-9 * 5.0, "{found:?}");
    assert!(matches!(found.dead_time(), DeadTime::NonParalysable { .. }));
    let freedom = found.degrees_of_freedom as f64;
    assert!((found.deviance - freedom).abs() < 5.0 * (2.0 * freedom).sqrt(), "{found:?}");
}

/// Truth: what the photons were drawn from, over 60 seeds: the stated σ of rate, dead time and recovery covers 68 % (binomial, 3.5 σ), and the mean of each is
/// right to 4 of its own σ.
#[test]
fn a_recovery_is_found_with_its_uncertainty() {
    let truth = [3e5, 1e-6, 0.25e-6];
    let mut covered = [0.0_f64; 3];
    let mut pulls = [0.0_f64; 3];
    let seeds = 60;
    for seed in 0..seeds {
        let found =
            histogram(Detector::Recovering(1e-6, 0.25e-6), 3e5, 60_000, seed).estimate().unwrap();
        assert!(!found.afterpulses.are_there(), "{found:?}");
        let values = [found.rate_hz, found.dead_time_s, found.recovery_s.unwrap()];
        for (i, found) in values.into_iter().enumerate() {
            let pull = (found.value - truth[i]) / found.sigma;
            pulls[i] += pull;
            covered[i] += f64::from(pull.abs() <= 1.0);
        }
        assert!(matches!(found.dead_time(), DeadTime::ExponentialRecovery { .. }));
    }
    let n = seeds as f64;
    println!("pulls {pulls:?}, covered {covered:?}");
    for i in 0..3 {
        assert!((covered[i] / n - 0.683).abs() < 3.5 * (0.683 * 0.317 / n).sqrt(), "{covered:?}");
        assert!(pulls[i].abs() / n < 4.0 / n.sqrt(), "{pulls:?}");
    }
}

/// Truth: the chance of an afterpulse that was drawn, 3 % with a mean delay of 2 µs after the dead time, less the part (e^(−20 ns/2 µs), 2 %) that comes before
/// the search begins and the part that light hides: 10 %, and 4 σ.
#[test]
fn afterpulses_are_told_from_light() {
    let (rate_hz, dead_s, chance, delay_s) = (2e4, 1e-6, 0.03, 2e-6);
    let mut events = Events::new(Detector::NonParalysable(dead_s), 5);
    let mut histogram = IntervalHistogram::new(20_000, 1000).unwrap();
    let mut light_s = events.next(rate_hz, f64::INFINITY).unwrap();
    let (mut last_s, mut pulse_s) = (f64::NEG_INFINITY, f64::INFINITY);
    for _ in 0..400_000 {
        let time_s = light_s.min(pulse_s);
        if time_s == light_s {
            light_s = events.next(rate_hz, f64::INFINITY).unwrap();
        } else {
            pulse_s = f64::INFINITY;
        }
        if time_s - last_s < dead_s {
            continue;
        }
        last_s = time_s;
        histogram.add((time_s * 1e12) as i64);
        pulse_s = if events.uniform() < chance {
            time_s + dead_s - delay_s * (1.0 - events.uniform()).ln()
        } else {
            f64::INFINITY
        };
    }
    let found = histogram.estimate().unwrap();
    println!("{found:?}");
    assert!(found.afterpulses.are_there());
    let off = (found.afterpulses.probability - chance).abs();
    assert!(off < 0.1 * chance + 4.0 * found.afterpulses.sigma, "{found:?}");
}

#[test]
fn what_cannot_be_told_is_refused() {
    assert!(matches!(IntervalHistogram::new(0, 100), Err(IntervalError::Bins { .. })));
    assert!(matches!(IntervalHistogram::new(i64::MAX, 100), Err(IntervalError::Bins { .. })));
    let few = histogram(Detector::NonParalysable(1e-6), 2e5, 500, 1).estimate();
    assert!(matches!(few, Err(IntervalError::TooFew { found }) if found < 500));
    // Light without any dead time, and a dead time beyond half of the histogram.
    let none = histogram(Detector::Perfect, 2e5, 20_000, 1).estimate();
    assert!(matches!(none, Err(IntervalError::Range { .. })), "{none:?}");
    let long = histogram(Detector::NonParalysable(15e-6), 2e5, 20_000, 1).estimate();
    assert!(matches!(long, Err(IntervalError::Range { .. })), "{long:?}");
}

/// Truth: the intervals by hand: 3 and 4 in bins of 2 up to 20, 50 beyond; none across an interruption or back in time.
#[test]
fn intervals_are_counted() {
    let mut histogram = IntervalHistogram::new(2, 10).unwrap();
    for time in [0, 3, 7, 57] {
        histogram.add(time);
    }
    histogram.interrupt();
    for time in [58, 40, 41] {
        histogram.add(time);
    }
    assert_eq!(histogram.counts(), ([1, 1, 1, 0, 0, 0, 0, 0, 0, 0].as_slice(), 1));
}
