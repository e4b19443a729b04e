//! What a reflection costs on one core.
//!
//! `cargo bench -p sunglint-simulator --bench surface`

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run should stop")]

use divan::{Bencher, black_box};
use glam::DVec3;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::surface::{ComplexIndex, Distribution, Fresnel, Lobe, Masking, Material};

fn main() {
    divan::main();
}

fn directions() -> Vec<(DVec3, DVec3)> {
    let direction = |theta: f64, phi: f64| {
        DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    };
    (0..1000)
        .map(|j| {
            let t = f64::from(j) / 1000.0;
            (direction(0.2 + 1.2 * t, 0.3), direction(0.1 + 1.3 * (7.3 * t).fract(), 3.0 + 5.0 * t))
        })
        .collect()
}

fn run(bencher: Bencher, material: &Material) {
    let directions = directions();
    let mut sum = vec![0.0; material.spectra().len()];
    bencher.counter(directions.len()).bench_local(|| {
        for &(i, o) in black_box(&directions) {
            material.add_weights(i, o, 1.0, &mut sum);
        }
        sum[0]
    });
}

fn microfacet(distribution: Distribution, masking: Masking) -> Material {
    let fresnel = Fresnel::constant(Spectrum::constant(0.9, 300.0, 1240.0).unwrap()).unwrap();
    Material::microfacet("m", Lobe::isotropic(distribution, 0.4, masking).unwrap(), fresnel)
}

#[divan::bench]
fn lambert(bencher: Bencher) {
    run(bencher, &Material::built_in("white").unwrap());
}

#[divan::bench(args = [Masking::Separable, Masking::HeightCorrelated])]
fn beckmann(bencher: Bencher, masking: Masking) {
    run(bencher, &microfacet(Distribution::Beckmann, masking));
}

#[divan::bench(args = [Masking::Separable, Masking::HeightCorrelated])]
fn ggx(bencher: Bencher, masking: Masking) {
    run(bencher, &microfacet(Distribution::Ggx, masking));
}

#[divan::bench]
fn conductor(bencher: Bencher) {
    run(bencher, &Material::built_in("aluminium_nk").unwrap());
}

/// The interpolation of n + ik over angles and wavelengths, made once.
#[divan::bench]
fn conductor_made(bencher: Bencher) {
    let index = ComplexIndex::named("aluminium").unwrap();
    bencher.bench_local(|| Fresnel::conductor(&index).unwrap());
}
