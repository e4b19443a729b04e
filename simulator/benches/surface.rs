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

/// A paint's coat at all angles, made once.
#[divan::bench]
fn blend_made(bencher: Bencher) {
    bencher.bench_local(paint);
}

#[divan::bench]
fn blend(bencher: Bencher) {
    run(bencher, &paint());
}

fn paint() -> Material {
    let lobe = Lobe::isotropic(Distribution::Beckmann, 0.2, Masking::Separable).unwrap();
    let reflectance = |value: f64| Spectrum::constant(value, 300.0, 1240.0).unwrap();
    let coat = Fresnel::schlick(reflectance(0.04)).unwrap();
    Material::blend("paint", reflectance(0.8), lobe, coat).unwrap()
}

/// A sphere of Beckmann microfacets at a phase angle of 70 degrees.
#[divan::bench(args = [0.05, 0.4])]
fn sphere(bencher: Bencher, alpha: f64) {
    let fresnel = Fresnel::constant(Spectrum::constant(0.9, 300.0, 1240.0).unwrap()).unwrap();
    let lobe = Lobe::isotropic(Distribution::Beckmann, alpha, Masking::Separable).unwrap();
    let material = Material::microfacet("m", lobe, fresnel);
    bencher.bench_local(|| material.add_sphere_weights(black_box(1.22), 1.0, &mut [0.0]).unwrap());
}
