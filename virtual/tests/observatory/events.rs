//! Photons through detectors.

use super::moments;
use sunglint_virtual::observatory::events::{Afterpulsing, DeadTime, Detector, PS};

const NS: i64 = 1000;
const MS: i64 = 1_000_000 * NS;

fn detector(dead_time: DeadTime) -> Detector {
    Detector { dead_time, ..Detector::IDEAL }
}

/// Counts in bins of `bin_ps` from tags.
fn binned(tags: &[i64], bin_ps: i64, bins: i64) -> Vec<f64> {
    let mut counts = vec![0.0; bins as usize];
    for tag in tags {
        counts[(tag / bin_ps) as usize] += 1.0;
    }
    counts
}

/// Mean and variance per second of a detector's counts in steady light.
fn played(detector: &Detector, rate_hz: f64, bin_ps: i64, bins: i64, seed: u64) -> (f64, f64) {
    let tags = detector.tags(seed, 0..bin_ps * bins, MS, |_| rate_hz);
    assert!(tags.is_sorted());
    let (mean, variance) = moments(&binned(&tags, bin_ps, bins));
    let bin_s = bin_ps as f64 / PS;
    (mean / bin_s, variance / bin_s)
}

/// Truth: renewal theory. Non-paralysable: mean n/(1+nτ), variance n/(1+nτ)³; paralysable: m = n e^(−nτ), m(1 − 2τm) (Müller, Nucl. Instr. Meth.
/// 112 (1973) 47). Of B bins the mean is known to √(V/TB) and the variance to √(2/B) of itself: five times that.
#[test]
fn counts_have_the_moments_of_their_detector() {
    for (x, seed) in [(0.01, 1), (0.3, 2), (1.0, 3), (3.0, 4)] {
        let (rate_hz, bin_ps, bins) = (1e6, 2 * MS, 1000);
        let dead_time_s = x / rate_hz;
        let paralysed = rate_hz * f64::exp(-x);
        let cases = [
            (
                DeadTime::NonParalysable { dead_time_s },
                rate_hz / (1.0 + x),
                rate_hz / (1.0 + x).powi(3),
            ),
            (
                DeadTime::Paralysable { dead_time_s },
                paralysed,
                paralysed * (1.0 - 2.0 * dead_time_s * paralysed),
            ),
        ];
        for (dead_time, mean_hz, variance_hz) in cases {
            let (mean, variance) = played(&detector(dead_time), rate_hz, bin_ps, bins, seed);
            let time_s = (bin_ps * bins) as f64 / PS;
            let mean_error = (variance_hz / time_s).sqrt();
            assert!((mean - mean_hz).abs() < 5.0 * mean_error, "{dead_time:?}: {mean} {mean_hz}");
            let relative = variance / variance_hz - 1.0;
            // The edges of a bin that is not infinitely long against the dead time: at most one sixth of a count.
            let edges = 0.2 / (variance_hz * bin_ps as f64 / PS);
            let allowed = 5.0 * (2.0 / bins as f64).sqrt() + edges;
            assert!(relative.abs() < allowed, "{dead_time:?}: {variance} {variance_hz}");
        }
    }
}

/// Truth: of gaps between counts of a non-paralysable detector none is below τ, and what is above is exponential: half of them below τ + ln 2/n,
/// three quarters below τ + ln 4/n. Binomial, five sigma.
#[test]
fn gaps_are_the_dead_time_and_an_exponential() {
    let (rate_hz, dead_time_s) = (2e6, 50e-9);
    let light = detector(DeadTime::NonParalysable { dead_time_s });
    let tags = light.tags(9, 0..500 * MS, MS, |_| rate_hz);
    let gaps: Vec<i64> = tags.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(gaps.iter().all(|gap| *gap >= 50 * NS));
    for part in [0.5_f64, 0.75, 0.99] {
        let below_s = dead_time_s - (1.0 - part).ln() / rate_hz;
        let found = gaps.iter().filter(|gap| (**gap as f64) < below_s * PS).count() as f64;
        let all = gaps.len() as f64;
        assert!((found / all - part).abs() < 5.0 * (part * (1.0 - part) / all).sqrt());
    }
}

/// Truth: after the dead time the hazard is n(1−e^(−u/r)), so that the mean gap beyond τ is ∫exp(−n(u−r(1−e^(−u/r))))du; with x = e^(−u/r)
/// and a = nr it is r Σ_k a^k/(a(a+1)…(a+k)), the series of the incomplete gamma function (DLMF 8.7.1). Five sigma of the mean of the gaps, whose scatter is below
/// their mean.
#[test]
fn a_detector_recovers_exponentially() {
    for (a, seed) in [(0.05, 1), (1.0, 2), (8.0, 3)] {
        let (rate_hz, dead_time_s) = (1e6, 0.2e-6);
        let recovery_s = a / rate_hz;
        let (mut sum, mut term) = (0.0, 1.0);
        for k in 0..200 {
            term *= if k == 0 { 1.0 / a } else { a / (a + f64::from(k)) };
            sum += term;
        }
        let gap_s = dead_time_s + recovery_s * sum;
        let tired = detector(DeadTime::ExponentialRecovery { dead_time_s, recovery_s });
        let counts = tired.tags(seed, 0..1000 * MS, MS, |_| rate_hz).len() as f64;
        let error = 5.0 / counts.sqrt();
        assert!((counts * gap_s - 1.0).abs() < error, "a = {a}: {counts} counts, {gap_s} s");
        let law = tired.moments(rate_hz).unwrap();
        assert!((law.mean_hz * gap_s - 1.0).abs() < 1e-7, "a = {a}: {law:?}");
    }
}

/// Truth: each of N pixels is a non-paralysable detector with its N-th of the light: n/(1+nτ/N) in all.
#[test]
fn pixels_share_the_light() {
    let (rate_hz, dead_time_s, pixels) = (5e7, 100e-9, 20);
    let many = detector(DeadTime::MultiPixel { pixels, dead_time_s });
    let counts = many.tags(3, 0..20 * MS, MS, |_| rate_hz).len() as f64;
    let expected = 0.02 * rate_hz / (1.0 + rate_hz * dead_time_s / 20.0);
    assert!((counts - expected).abs() < 5.0 * expected.sqrt(), "{counts} {expected}");
}

/// Truth: event-level simulations of an independent program (numpy) of 100 pixels that recover with 50 ns: 0.99952 of the photons at 1e6, 0.99506 at 1e7 and 0.95295 at 1e8 Hz fire; of 667 such pixels behind a comparator of 10, 20
/// and 30 ns 0.904, 0.819 and 0.741 are counted at 1e7 Hz. Tolerance: their noise (2e-3), and five sigma of ours.
#[test]
fn pulses_merge_behind_a_comparator() {
    for (pixels, pulse_s, rate_hz, published) in [
        (100, 0.0, 1e7, 0.99506),
        (100, 0.0, 1e8, 0.95295),
        (667, 10e-9, 1e7, 0.904),
        (667, 20e-9, 1e7, 0.819),
        (667, 30e-9, 1e7, 0.741),
    ] {
        let chip = detector(DeadTime::Comparator { pixels, recovery_s: 50e-9, pulse_s });
        let counts = chip.tags(5, 0..40 * MS, MS, |_| rate_hz).len() as f64;
        let found = counts / (0.04 * rate_hz);
        let noise = 5.0 * (found / (0.04 * rate_hz)).sqrt();
        assert!((found - published).abs() < 2e-3 + noise, "{pixels} {pulse_s}: {found}");
        let law = chip.moments(rate_hz).unwrap().mean_hz / rate_hz;
        assert!((law - published).abs() < 2e-3, "{pixels} {pulse_s}: {law}");
    }
}

/// Truth: a count with a follower of probability p, that one again: families of 1/(1−p) members on average with mean square (1+p)/(1−p)², so
/// that the rate is n/(1−p) and variance over mean (1+p)/(1−p). Families of 1 µs are short against 2 ms and rare against each other (1e-3).
#[test]
fn afterpulses_come_in_families() {
    let p = 0.1;
    let trap = Afterpulsing { probability: p, time_constant_s: 1e-6 };
    let echo = Detector { afterpulsing: Some(trap), ..Detector::IDEAL };
    let (rate_hz, bins) = (1e4, 20_000);
    let (mean, variance) = played(&echo, rate_hz, 2 * MS, bins, 5);
    let expected = rate_hz / (1.0 - p);
    assert!((mean / expected - 1.0).abs() < 5.0 * (1.3 / (40.0 * rate_hz)).sqrt() + 2e-3, "{mean}");
    let fano = variance / mean * (1.0 - p) / (1.0 + p);
    assert!((fano - 1.0).abs() < 5.0 * (2.0 / bins as f64).sqrt(), "{fano}");
}

/// Truth: the photons themselves. Counts that are drawn without photons have their mean and variance, for every kind of detector at nτ = 0.5 with
/// dark counts and afterpulses. The variances of 2000 bins each are known to 4.5 %, the means to √(V/B): five sigma of the difference.
#[test]
fn drawn_counts_are_those_of_the_photons() {
    let (rate_hz, bin_ps, bins) = (1e6, MS, 2000);
    let trap = Some(Afterpulsing { probability: 0.05, time_constant_s: 0.4e-6 });
    let kinds = [
        (DeadTime::None, trap),
        (DeadTime::NonParalysable { dead_time_s: 0.5e-6 }, trap),
        (DeadTime::Paralysable { dead_time_s: 0.5e-6 }, None),
        (DeadTime::ExponentialRecovery { dead_time_s: 0.2e-6, recovery_s: 0.3e-6 }, trap),
        (DeadTime::MultiPixel { pixels: 7, dead_time_s: 3e-6 }, trap),
        (DeadTime::Comparator { pixels: 100, recovery_s: 0.5e-6, pulse_s: 0.1e-6 }, None),
    ];
    for (dead_time, afterpulsing) in kinds {
        let kind = Detector { dead_time, dark_rate_hz: 2e4, afterpulsing };
        let tags = kind.tags(11, 0..bins * bin_ps, MS, |_| rate_hz);
        let (mean, variance) = moments(&binned(&tags, bin_ps, bins));
        let drawn: Vec<f64> = (0..bins)
            .map(|i| kind.counts(12, i, i * bin_ps..(i + 1) * bin_ps, &[rate_hz; 4]) as f64)
            .collect();
        let (drawn_mean, drawn_variance) = moments(&drawn);
        let mean_error = (2.0 * variance / bins as f64).sqrt();
        assert!((drawn_mean - mean).abs() < 5.0 * mean_error, "{kind:?}: {drawn_mean} {mean}");
        let relative = drawn_variance / variance - 1.0;
        assert!(relative.abs() < 5.0 * (4.0 / bins as f64).sqrt(), "{kind:?}: {relative}");
    }
}

/// Truth: the Poisson distribution. In weak light the bins are played, so that 0, 1, 2 … counts are as frequent as e^(−λ)λ^k/k!
/// (χ² with 6 degrees of freedom: 27.9 is passed with a probability of 1e-4).
#[test]
fn few_counts_are_poisson() {
    let lambda = 2.0_f64;
    let mut seen = [0.0; 7];
    for i in 0..20_000_i64 {
        let counts = Detector::IDEAL.counts(1, i, i * MS..(i + 1) * MS, &[2000.0]);
        seen[(counts as usize).min(6)] += 1.0;
    }
    let mut expected = [0.0; 7];
    let mut probability = (-lambda).exp();
    for (k, expected) in expected.iter_mut().take(6).enumerate() {
        *expected = 20_000.0 * probability;
        probability *= lambda / (k + 1) as f64;
    }
    expected[6] = 20_000.0 - expected.iter().sum::<f64>();
    let chi2: f64 = seen.iter().zip(expected).map(|(s, e)| (s - e).powi(2) / e).sum();
    assert!(chi2 < 27.9, "{chi2}");
}

/// Truth: each other. A span in pieces is the span, whatever the pieces: the detector's past is played long enough.
#[test]
fn pieces_are_the_whole() {
    let trap = Some(Afterpulsing { probability: 0.02, time_constant_s: 1e-6 });
    let glint = |t: f64| 1e5 + 3e6 * (-((t - 0.005) / 0.001).powi(2)).exp();
    for dead_time in [
        DeadTime::NonParalysable { dead_time_s: 1e-6 },
        DeadTime::Paralysable { dead_time_s: 0.3e-6 },
        DeadTime::ExponentialRecovery { dead_time_s: 0.5e-6, recovery_s: 0.5e-6 },
    ] {
        let light = Detector { dead_time, dark_rate_hz: 1e3, afterpulsing: trap };
        let whole = light.tags(4, -MS..10 * MS, MS / 10, glint);
        let mut pieces = Vec::new();
        for (from, to) in [(-MS, 1), (1, 4 * MS + 7), (4 * MS + 7, 10 * MS)] {
            pieces.extend(light.tags(4, from..to, MS / 10, glint));
        }
        assert_eq!(whole.len(), pieces.len());
        assert!(whole == pieces);
        assert!(whole != light.tags(5, -MS..10 * MS, MS / 10, glint));
    }
}
