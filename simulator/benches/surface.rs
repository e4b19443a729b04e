//! Benchmark of a reflection on one core.
//!
//! `cargo bench -p sunglint-simulator --bench surface`

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run should stop")]

use divan::{Bencher, black_box};
use glam::DVec3;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::surface::brdf_table::{self, Row};
use sunglint_simulator::surface::measured::{self, WriteOptions};
use sunglint_simulator::surface::{
    ComplexIndex, Distribution, Fresnel, Gloss, Lobe, Masking, Material, MaxwellBeard, WardForm,
};

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

fn flat(value: f64) -> Spectrum<sunglint_radiometry::spectrum::Reflectance> {
    Spectrum::constant(value, 300.0, 1240.0).unwrap()
}

#[divan::bench]
fn phong(bencher: Bencher) {
    let gloss = Gloss::Phong { exponent: 80.0 };
    run(bencher, &Material::glossy("m", gloss, flat(0.5), Some(flat(0.2))).unwrap());
}

#[divan::bench]
fn ward(bencher: Bencher) {
    let gloss = Gloss::Ward { alpha_x: 0.1, alpha_y: 0.2, form: WardForm::Bounded };
    run(bencher, &Material::glossy("m", gloss, flat(0.5), None).unwrap());
}

#[divan::bench]
fn abg(bencher: Bencher) {
    let gloss = Gloss::Abg { a_per_sr: 0.002, b: 1e-4, g: 1.8 };
    run(bencher, &Material::glossy("m", gloss, flat(1.0), None).unwrap());
}

#[divan::bench]
fn maxwell_beard(bencher: Bencher) {
    let numbers = MaxwellBeard { bias_per_sr: 0.005, sigma: 0.3, tau_deg: 15.0, omega_deg: 40.0 };
    let index = ComplexIndex::named("silicon").unwrap();
    run(bencher, &Material::maxwell_beard("m", numbers, &index, Some(flat(0.03)), None).unwrap());
}

/// A material of a `.bsdf` file, by its number of wavelengths.
#[divan::bench(args = [2, 32, 195])]
fn measured_file(bencher: Bencher, wavelengths: usize) {
    let nm = (0..wavelengths).map(|k| 360.0 + 3.3 * k as f64).collect();
    let options = WriteOptions { elevations: 8, normals: 32, side: 32, ..WriteOptions::at(nm) };
    let file =
        measured::write(&microfacet(Distribution::Ggx, Masking::Separable), &options).unwrap();
    run(bencher, &measured::material("m", "memory", &file).unwrap());
}

/// A table in the plane of incidence: 8 incidences, 177 angles.
#[divan::bench]
fn table_in_plane(bencher: Bencher) {
    let rows: Vec<Row> = (0..8)
        .flat_map(|j| {
            (-88..=88).map(move |k| Row {
                theta_i_deg: 5.0 + 10.0 * f64::from(j),
                phi_i_deg: 0.0,
                theta_o_deg: f64::from(k),
                phi_o_deg: 180.0,
                brdf_per_sr: vec![0.1 / (1.0 + (f64::from(k) - 5.0 - 10.0 * f64::from(j)).abs())],
            })
        })
        .collect();
    run(bencher, &brdf_table::material("m", &[532.0], &rows, None).unwrap());
}

/// A foil of a smooth metal and one of paint.
#[divan::bench(args = [0.05, 1.0])]
fn foil(bencher: Bencher, alpha: f64) {
    let lobe = Lobe::isotropic(Distribution::Beckmann, alpha, Masking::Separable).unwrap();
    let base = Material::microfacet("base", lobe, Fresnel::constant(flat(0.9)).unwrap());
    run(bencher, &Material::foil("m", base, 0.2, 0.2, Masking::Separable).unwrap());
}
