//! What the photometry of a frame costs on one core, beside photutils and SEP on the same frame in the same run (where `.venv` has them).
//!
//! `cargo bench -p sunglint-calibration --bench photometry`

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run should stop")]

#[path = "../tests/photometry/render.rs"]
#[expect(dead_code, reason = "the tests use all of it")]
mod render;

use divan::{Bencher, black_box};
use render::{Exposure, Sky};
use sunglint_calibration::photometry::{
    Expected, FrameCalibration, FrameReducer, PhotometryOptions,
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

/// As in `tests/peers/apertures.py`.
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
    let ran = std::process::Command::new(python).arg(script).arg("time").arg(&path).status();
    std::fs::remove_file(&path).unwrap();
    if !ran.is_ok_and(|status| status.success()) {
        println!("no photutils and SEP in .venv (./test makes it)");
    }
    let sum = reducer().measure_at(&frame, PLACE, &Expected::default()).unwrap().planes[0];
    println!("sunglint: sum {:.1} ADU", sum.rate_adu_per_s);
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
