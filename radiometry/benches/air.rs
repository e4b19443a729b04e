//! Cost of the air on one core: 6000 zenith angles × 941 wavelengths with the table's build, and one exact angle.
//!
//! `cargo bench -p sunglint-radiometry --bench air`

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run should stop")]

use divan::{Bencher, black_box};
use sunglint_radiometry::air::{Air, AirOptions, AirTable, Profile, Sampling, Zenith};

fn main() {
    let table = AirTable::new(&air(), &means(), AirTable::TOLERANCE).unwrap();
    println!(
        "interpolation error of the table: {:.1e} in transmission, {} nodes",
        table.interpolation_error(),
        table.nodes()
    );
    divan::main();
}

fn air() -> Air {
    let options =
        AirOptions { altitude_m: 399.0, ..AirOptions::new(Profile::midlatitude_winter()) };
    Air::new(&options).unwrap()
}

fn wavelengths() -> Vec<f64> {
    (300..=1240).map(f64::from).collect()
}

fn means() -> Sampling {
    Sampling::means(&wavelengths(), 0.5).unwrap()
}

/// A pass: from the horizon up and down again.
fn angles(zenith: fn(f64) -> Zenith) -> Vec<Zenith> {
    (0..6000).map(|i| zenith((f64::from(i) - 3000.0).abs() * 0.03)).collect()
}

/// Means over 1 nm; the table is built anew each time.
#[divan::bench]
fn pass_6000_by_941_apparent(bencher: Bencher) {
    let (air, sampling, zeniths) = (air(), means(), angles(Zenith::Apparent));
    let mut out = vec![0.0; zeniths.len() * sampling.len()];
    bencher.bench_local(|| {
        let table = AirTable::new(&air, &sampling, AirTable::TOLERANCE).unwrap();
        table.transmissions_into(black_box(&zeniths), &mut out).unwrap();
    });
}

/// The same by true zenith angles, each of which is inverted.
#[divan::bench]
fn pass_6000_by_941_true(bencher: Bencher) {
    let (air, sampling, zeniths) = (air(), means(), angles(Zenith::True));
    let mut out = vec![0.0; zeniths.len() * sampling.len()];
    bencher.bench_local(|| {
        let table = AirTable::new(&air, &sampling, AirTable::TOLERANCE).unwrap();
        table.transmissions_into(black_box(&zeniths), &mut out).unwrap();
    });
}

#[divan::bench]
fn table_build(bencher: Bencher) {
    let (air, sampling) = (air(), means());
    bencher.bench_local(|| AirTable::new(&air, &sampling, AirTable::TOLERANCE).unwrap());
}

#[divan::bench]
fn air_build(bencher: Bencher) {
    bencher.bench_local(air);
}

#[divan::bench]
fn one_path(bencher: Bencher) {
    let air = air();
    bencher.bench_local(|| air.path(black_box(Zenith::Apparent(75.0))).unwrap());
}

#[divan::bench]
fn one_exact_angle_941_means(bencher: Bencher) {
    let (air, sampling) = (air(), means());
    bencher.bench_local(|| air.transmission(black_box(Zenith::Apparent(75.0)), &sampling).unwrap());
}

#[divan::bench]
fn one_exact_angle_941_points(bencher: Bencher) {
    let (air, sampling) = (air(), Sampling::points(&wavelengths()).unwrap());
    bencher.bench_local(|| air.transmission(black_box(Zenith::Apparent(75.0)), &sampling).unwrap());
}
