//! Cost of D on one core: power iteration alone, and a run of 151 angles with 200 resamplings.
//!
//! `cargo bench -p sunglint-calibration --bench ndf`

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run should stop")]

use divan::{Bencher, black_box};
use std::f64::consts::PI;
use sunglint_materials::ndf::{Anisotropic, Hemisphere, Isotropic, NdfOptions, extract, solve};
use sunglint_materials::table::{Reading, RetroFlags, RetroTable};

fn main() {
    divan::main();
}

/// f(ω, ω) of a GGX lobe with F₀ = 1 (Walter et al. 2007): D G₁/(4 cos²θ).
fn ggx(alpha_x: f64, alpha_y: f64, theta: f64, phi: f64) -> f64 {
    let tan2 = theta.tan().powi(2);
    let across = (phi.cos() / alpha_x).powi(2) + (phi.sin() / alpha_y).powi(2);
    let along = (phi.cos() * alpha_x).powi(2) + (phi.sin() * alpha_y).powi(2);
    let cos2 = theta.cos().powi(2);
    let density = 1.0 / (PI * alpha_x * alpha_y * (cos2 * (1.0 + tan2 * across)).powi(2));
    density * 2.0 / (1.0 + (1.0 + along * tan2).sqrt()) / (4.0 * cos2)
}

#[divan::bench]
fn nodes_128(bencher: Bencher) {
    bencher.bench_local(|| Isotropic::new(black_box(128)));
}

#[divan::bench(args = [0.005, 0.1, 0.6])]
fn nodes_and_power_iteration_128(bencher: Bencher, alpha: f64) {
    let theta = Isotropic::new(128).elevations.theta_rad;
    let f: Vec<f64> = theta.iter().map(|t| ggx(alpha, alpha, *t, 0.0)).collect();
    bencher.bench_local(|| solve(&Isotropic::new(128), black_box(&f)).unwrap().f0);
}

#[divan::bench(args = [0.005, 0.1, 0.6])]
fn power_iteration_128(bencher: Bencher, alpha: f64) {
    let over = Isotropic::new(128);
    let f: Vec<f64> =
        over.elevations.theta_rad.iter().map(|t| ggx(alpha, alpha, *t, 0.0)).collect();
    bencher.bench_local(|| solve(&over, black_box(&f)).unwrap().f0);
}

#[divan::bench]
fn power_iteration_32_by_64(bencher: Bencher) {
    let over = Anisotropic::new(32, 64);
    let mut f = Vec::with_capacity(over.cosines().len());
    for phi in &over.phi_rad {
        f.extend(over.elevations.theta_rad.iter().map(|t| ggx(0.1, 0.3, *t, *phi)));
    }
    bencher.bench_local(|| solve(&over, black_box(&f)).unwrap().f0);
}

#[divan::bench(args = [0, 200])]
fn a_run_of_151_angles(bencher: Bencher, resamplings: usize) {
    let reading = |k: i32| {
        let angle_deg = -10.0 + 0.5 * f64::from(k);
        let f_per_sr = ggx(0.3, 0.3, angle_deg.to_radians(), 0.0);
        let sigma_f_per_sr = 0.01 * f_per_sr;
        let flags = RetroFlags::empty();
        Reading { angle_deg, azimuth_deg: 0.0, f_per_sr, sigma_f_per_sr, flags }
    };
    let run = RetroTable { readings: (0..151).map(reading).collect(), ..RetroTable::default() };
    let options = NdfOptions { resamplings, ..NdfOptions::default() };
    bencher.bench_local(|| extract(black_box(&run), &options).unwrap().f0);
}
