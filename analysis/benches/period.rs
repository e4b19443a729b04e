//! Cost of a periodogram on one core. The job of the peers: 2,600 samples, 50,000 frequencies; `benches/periods.py` times them and states all errors.
//!
//! `cargo bench -p sunglint-analysis --bench period`

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run should stop")]

use divan::{Bencher, black_box};
use std::f64::consts::TAU;
use sunglint_analysis::period::{FrequencyGrid, Options, lomb_scargle, pdm, verdict};
use sunglint_analysis::series::Series;

fn main() {
    divan::main();
}

/// Irregular samples of two harmonics over 1,000 s with noise of a linear congruential generator.
fn series(n: usize) -> Series {
    let mut state = 1_u64;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let time: Vec<f64> = (0..n).map(|_| 1000.0 * random()).collect();
    let value: Vec<f64> = time
        .iter()
        .map(|t| {
            10.0 + (TAU * t / 20.0).sin() + 0.5 * (2.0 * TAU * t / 20.0).cos() + random() - 0.5
        })
        .collect();
    let sigma = vec![0.3; n];
    Series::new("bench", &time, &value, Some(&sigma)).unwrap()
}

const GRID: FrequencyGrid = FrequencyGrid { first_hz: 0.01, step_hz: 1e-4, n: 50_000 };

#[divan::bench(args = [1, 2, 4])]
fn lomb_scargle_2600_by_50000(bencher: Bencher, harmonics: usize) {
    let series = series(2600);
    bencher.bench_local(|| lomb_scargle(black_box(&series), &GRID, harmonics).unwrap());
}

#[divan::bench]
fn pdm_2600_by_5500(bencher: Bencher) {
    let series = series(2600);
    let periods: Vec<f64> = (0..5500).map(|k| 5.0 + 0.01 * f64::from(k)).collect();
    bencher.bench_local(|| pdm(black_box(&series), &periods, 20).unwrap());
}

#[divan::bench]
fn verdict_2600(bencher: Bencher) {
    let series = [series(2600)];
    bencher.bench_local(|| verdict(black_box(&series), &Options::default()).unwrap());
}
