//! Benchmark of the photometry of a frame on one core, beside photutils and SEP on the same frame in the same run (where `.venv` has them).
//!
//! `cargo bench -p sunglint-calibration --bench photometry`

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run should stop")]

#[path = "../tests/photometry/render.rs"]
#[expect(dead_code, reason = "the tests use all of it")]
mod render;

use divan::{Bencher, black_box};
use render::{Exposure, Sky};
use sunglint_calibration::photometry::{
    Choice, Expected, FrameCalibration, FrameReducer, PhotometryOptions,
};
use sunglint_formats::atomic::Overwrite;
use sunglint_formats::frame::{Bayer, Frame};

fn main() {
    peers();
    divan::main();
}

fn star(bayer: Option<Bayer>) -> Frame {
    let mut exposure = Exposure::of(&Sky { bayer, ..Sky::new(200) }, 1);
    exposure.point(PLACE[0], PLACE[1], 5000.0);
    exposure.read()
}

/// Place of the aperture, as in `tests/peers/apertures.py`.
const PLACE: [f64; 2] = [100.3, 99.8];

fn reducer() -> FrameReducer {
    FrameReducer::new(PhotometryOptions::new([200, 200], 5.0), FrameCalibration::default()).unwrap()
}

fn peers() {
    let python = sunglint_testkit::repository().join(".venv/bin/python");
    let script = sunglint_testkit::repository().join("tests/peers/apertures.py");
    let path = std::env::temp_dir().join(format!("sunglint-bench-{}.fits", std::process::id()));
    let frame = star(None);
    frame.write_file(&path, Overwrite::Allow).unwrap();
    let peer =
        |verb: &str| std::process::Command::new(&python).arg(&script).arg(verb).arg(&path).status();
    let ran = peer("time");
    let whole = field();
    whole.write_file(&path, Overwrite::Allow).unwrap();
    let ran = ran.and_then(|_| peer("search"));
    std::fs::remove_file(&path).unwrap();
    if !ran.is_ok_and(|status| status.success()) {
        println!("no photutils and SEP in .venv (./test makes it)");
    }
    let sum = reducer().measure_at(&frame, PLACE, &Expected::default()).unwrap().planes[0];
    println!("sunglint: sum {:.1} ADU", sum.rate_adu_per_s);
    let mut searching = searching(Choice::Brightest);
    let found = searching.detect(&whole, &Expected::default()).unwrap();
    println!(
        "sunglint: {} sources of 1391 x 1039, {} of them points",
        found.candidates.len(),
        found.passed()
    );
    let followed = searching_nearest_off(&whole);
    println!("sunglint: the followed one is {followed:.0} px off the middle");
}

/// An aperture of 8 px with the clipped median of an annulus of 12 to 20 px, at a known place.
#[divan::bench]
fn aperture_at_a_known_place(bencher: Bencher) {
    let (frame, mut reducer) = (star(None), reducer());
    bencher.bench_local(|| {
        reducer.measure_at(black_box(&frame), PLACE, &Expected::default()).unwrap()
    });
}

/// The same for the three planes of a mosaic.
#[divan::bench]
fn mosaic_at_a_known_place(bencher: Bencher) {
    let (frame, mut reducer) = (star(Some(Bayer::Rggb)), reducer());
    bencher.bench_local(|| {
        reducer.measure_at(black_box(&frame), PLACE, &Expected::default()).unwrap()
    });
}

/// Detection in the whole frame of 200 × 200, centroid and aperture.
#[divan::bench]
fn found_and_measured(bencher: Bencher) {
    let (frame, mut reducer) = (star(None), reducer());
    bencher.bench_local(|| reducer.measure(black_box(&frame), &Expected::default()).unwrap());
}

/// A whole frame of 1391 × 1039 with 40 stars and 5 hot pixels.
fn field() -> Frame {
    let size = [1391, 1039];
    let mut exposure = Exposure::of(&Sky { size, ..Sky::new(1) }, 1);
    for i in 0..40 {
        let [x, y] = [(i * 337 + 100) % 1300, (i * 211 + 60) % 950];
        exposure.point(x as f64 + 40.3, y as f64 + 40.7, 800.0 * 1.1f64.powi(i));
    }
    for i in 0..5 {
        exposure.electrons[[100 + 150 * i, 300 + 99 * i]] += 3000.0;
    }
    exposure.read()
}

fn searching_nearest_off(frame: &Frame) -> f64 {
    let found = searching(Choice::Nearest).detect(frame, &Expected::default()).unwrap();
    let [x, y] = found.candidates[found.target.unwrap()].place_px.to_array();
    (x - 695.0).hypot(y - 519.0)
}

/// Makes a reducer for `field` with options that take the source nearest to the middle or the brightest.
fn searching(choice: Choice) -> FrameReducer {
    let mut options = PhotometryOptions::new([1391, 1039], 5.0);
    options.detection.choice = choice;
    FrameReducer::new(options, FrameCalibration::default()).unwrap()
}

/// All sources of a frame of 1391 × 1039: the brightest is wanted.
#[divan::bench]
fn whole_frame_searched(bencher: Bencher) {
    let (frame, mut reducer) = (field(), searching(Choice::Brightest));
    bencher.bench_local(|| reducer.detect(black_box(&frame), &Expected::default()).unwrap());
}

/// In the same frame the nearest to the middle, 90 px off as in the frame before: found and measured.
#[divan::bench]
fn followed_and_measured(bencher: Bencher) {
    let (frame, mut reducer) = (field(), searching(Choice::Nearest));
    bencher.bench_local(|| reducer.measure(black_box(&frame), &Expected::default()).unwrap());
}
