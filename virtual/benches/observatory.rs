//! Cost of a virtual night: a frame of 200 × 200 pixels, a bin of 0.1 s of three counters, a second of tags.
//!
//! `cargo bench -p sunglint-simulator --bench observatory`

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run should stop")]

use divan::{Bencher, black_box};
use std::sync::Arc;
use std::time::Instant;
use sunglint_formats::time::parse_utc;
use sunglint_radiometry::sky::EarthOrientation;
use sunglint_radiometry::station::Station;
use sunglint_virtual::observatory::events::{DeadTime, Detector};
use sunglint_virtual::observatory::frame::Exposure;
use sunglint_virtual::observatory::night::Night;
use sunglint_virtual::observatory::options::{Options, PlanOptions};
use sunglint_virtual::observatory::plan::plan;
use sunglint_virtual::observatory::watch::Watch;

const WINDOW: Exposure =
    Exposure { origin_px: [595, 419], size_px: [200, 200], binning: [1, 1], exposure_s: 1.0 };
const PS: i64 = 1_000_000_000_000;

fn main() {
    let begun = Instant::now();
    let night = night(Some(3.0));
    println!("a plan of 120 stars and its light: {:.2} s", begun.elapsed().as_secs_f64());
    // A tenth of ten hours: 1,800 frames, 36,000 bins of three channels.
    let mut watch = Watch::new(night);
    let begun = Instant::now();
    for frame in 0..1800 {
        black_box(watch.frame(&WINDOW, 2.0 * f64::from(frame)));
    }
    let frames_s = begun.elapsed().as_secs_f64();
    let counters = watch.counters();
    let begun = Instant::now();
    for bin in 0..36_000 {
        black_box(watch.counts(&counters, bin * PS / 10..(bin + 1) * PS / 10));
    }
    let bins_s = begun.elapsed().as_secs_f64();
    println!(
        "an hour: frames {frames_s:.2} s ({:.2} ms each), bins {bins_s:.2} s ({:.1} us each)",
        frames_s / 1.8,
        bins_s / 0.036
    );
    divan::main();
}

fn night(moffat_beta: Option<f64>) -> Arc<Night> {
    let mut options = Options::default();
    options.seeing.moffat_beta = moffat_beta;
    let station = Station::built_in("ufo").unwrap().unwrap();
    let start = parse_utc("2020-11-18T17:00:00Z").unwrap();
    let orientation = EarthOrientation::embedded();
    let stars = PlanOptions { stars: 120, v_mag: [0.0, 5.0], ..PlanOptions::default() };
    let visits = plan(&stars, &station.site, start, orientation).unwrap();
    Arc::new(Night::new(options, &station, start, visits, orientation).unwrap())
}

/// A frame of a star, by its point spread's β (0: normal).
#[divan::bench(args = [0.0, 2.5, 3.0])]
fn frame(bencher: Bencher, beta: f64) {
    let mut watch = Watch::new(night((beta > 0.0).then_some(beta)));
    let mut start_s = 200.0;
    bencher.bench_local(|| {
        start_s += 1e-3;
        watch.frame(&WINDOW, start_s)
    });
}

/// 0.1 s of all counters.
#[divan::bench]
fn bin(bencher: Bencher) {
    let mut watch = Watch::new(night(None));
    let counters = watch.counters();
    let mut bin = 2000;
    bencher.bench_local(|| {
        bin += 1;
        watch.counts(&counters, bin * PS / 10..(bin + 1) * PS / 10)
    });
}

/// A tenth of a second of photons, one by one, 1 MHz.
#[divan::bench(args = ["none", "non-paralysable", "paralysable", "recovery", "pixels", "comparator"])]
fn photons(bencher: Bencher, kind: &str) {
    let dead_time_s = 1e-7;
    let dead_time = match kind {
        "non-paralysable" => DeadTime::NonParalysable { dead_time_s },
        "paralysable" => DeadTime::Paralysable { dead_time_s },
        "recovery" => DeadTime::ExponentialRecovery { dead_time_s, recovery_s: 1e-7 },
        "pixels" => DeadTime::MultiPixel { pixels: 1000, dead_time_s },
        "comparator" => DeadTime::Comparator { pixels: 400, recovery_s: 5e-8, pulse_s: 2e-8 },
        _ => DeadTime::None,
    };
    let detector = Detector { dead_time, ..Detector::IDEAL };
    bencher.bench_local(|| detector.tags(black_box(1), 0..PS / 10, PS / 1000, |_| 1e6));
}
