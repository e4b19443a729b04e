//! Benchmark of turning counts into rates. `cargo bench -p sunglint-calibration --bench counts`
#![allow(missing_docs)]

use divan::{Bencher, counter::ItemsCount};
use hifitime::{Duration, Epoch};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::convert::Infallible;
use sunglint_calibration::alignment::{FieldPoint, FitOptions, fit_field};
use sunglint_calibration::counts::{
    Bin, CountChannel, Gate, OffOptions, OffTarget, Options, Reduction, Span, Spans, View,
};
use sunglint_calibration::detector::{FineBins, Linearity};
use sunglint_calibration::track::{Place, Track, TrackPoint};
use sunglint_formats::{CountFlags, CountRecord};
use sunglint_radiometry::station::{DeadTime, Fibre};

fn main() {
    divan::main();
}

const LAWS: [DeadTime; 3] = [
    DeadTime::NonParalysable { dead_time_s: 1e-6 },
    DeadTime::Paralysable { dead_time_s: 1e-6 },
    DeadTime::ExponentialRecovery { dead_time_s: 1e-6, recovery_s: 2.5e-7 },
];

/// A bin of 0.1 s at nτ = 0.3: closed, Lambert's function, and the solved renewal process.
#[divan::bench(args = [0, 1, 2])]
fn linearise(bencher: Bencher, law: usize) {
    let law = Linearity::new(&LAWS[law]).unwrap_or_else(|error| panic!("{error}"));
    bencher.counter(ItemsCount::new(1_usize)).bench(|| law.linearise(22_000, 0.1));
}

/// The tags of a bin of 0.1 s, 100,000 of them evenly spread, τ = 22 ns.
#[divan::bench]
fn linearise_tags(bencher: Bencher) {
    let law = Linearity::new(&DeadTime::NonParalysable { dead_time_s: 22e-9 });
    let law = law.unwrap_or_else(|error| panic!("{error}"));
    let tags: Vec<i64> = (0..100_000).map(|i| i * 1_000_000).collect();
    let fine = FineBins::default();
    bencher
        .counter(ItemsCount::new(tags.len()))
        .bench(|| law.linearise_tags(&tags, 0, 100_000_000_000, &fine));
}

/// Ten thousand bins on a target that frames follow, gated and divided by the coupling.
#[divan::bench]
fn reduce(bencher: Bencher) {
    let start = Epoch::from_gregorian_utc_at_midnight(2026, 11, 21);
    let at = |seconds: f64| start + Duration::from_seconds(seconds);
    let bins: Vec<Bin> = (0..10_000_i64)
        .map(|i| {
            Bin::from(CountRecord {
                start: at(0.1 * i as f64),
                start_ps: i * 100_000_000_000,
                length_ps: 100_000_000_000,
                counts: vec![20_000],
                missed: vec![0],
                flags: CountFlags::empty(),
            })
        })
        .collect();
    let place = Place { offset_px: [3.0, 4.0].into(), covariance_px2: [0.01, 0.01, 0.0] };
    let frame =
        |i| TrackPoint { time: at(2.0 * f64::from(i)), exposure_s: 0.5, place: Some(place) };
    let tracks = [Track { points: (0..501).map(frame).collect() }];
    let spans = Spans::new([Span { from: at(0.0), to: at(1000.0), view: View::Target(0) }]);
    let channels = [CountChannel {
        name: "spcm".into(),
        column: 0,
        linearity: Linearity::new(&LAWS[0]).unwrap_or_else(|error| panic!("{error}")),
        dark_rate_hz: 800.0,
        fibre: Some(Fibre { offset_px: [0.0; 2].into(), sigma_px: [14.0, 17.0].into() }),
    }];
    let Ok(off) =
        OffTarget::measure::<Infallible>(Vec::new(), &channels, &spans, &OffOptions::default());
    let options = Options { gate: Gate::default(), ..Options::default() };
    bencher.counter(ItemsCount::new(bins.len())).bench(|| {
        let bins = bins.iter().cloned().map(Ok::<_, Infallible>);
        Reduction::new(bins, &channels, &spans, &tracks, &off, options).count()
    });
}

/// A field of 300 points of three stars.
#[divan::bench(args = [false, true])]
fn fit(bencher: Bencher, robust: bool) {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    let mut uniform = || random.random::<f64>() - 0.5;
    let points: Vec<FieldPoint> = (0..300)
        .map(|i| {
            let (x, y) = (80.0 * uniform(), 80.0 * uniform());
            let rate = 1000.0 * (-0.5 * ((x / 14.0).powi(2) + (y / 17.0).powi(2))).exp();
            FieldPoint {
                offset_px: [x, y].into(),
                covariance_px2: [0.01, 0.01, 0.0],
                rate_hz: rate + 60.0 * uniform(),
                sigma_hz: 17.0,
                star: i % 3,
                between: None,
            }
        })
        .collect();
    let options = FitOptions { robust, ..FitOptions::default() };
    bencher.bench(|| fit_field(&points, &options));
}
