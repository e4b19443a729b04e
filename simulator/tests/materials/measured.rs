//! `.bsdf` files: against Mitsuba, against the laws that were written, refusals, coverage.

use crate::materials::cases::{self, WAVELENGTHS_NM};
use crate::materials::{direction, hemisphere};
use glam::DVec3;
use sunglint_formats::bsdf::{TensorData, TensorFile};
use sunglint_radiometry::quadrature::Product;
use sunglint_radiometry::spectrum::{Response, Spectrum};
use sunglint_simulator::surface::Material;
use sunglint_simulator::surface::measured::{WriteOptions, material, write};
use sunglint_testkit::fixture;

fn made(name: &str) -> Material {
    let files = cases::files();
    let (_, file) = files.iter().find(|(n, _)| *n == name).unwrap();
    material(name, "memory", file).unwrap()
}

/// Truth: Mitsuba 3.9.1's plug-in `measured` on the same files (240 geometries of each, to 88° and 89.5°), stored. Tolerance: 0.5 % of the value or 1e-5 of the
/// file's largest: Mitsuba computes in single precision. Its densities stand for the plug-in's sampling alone, ours have a fifth of a cosine's beside it.
#[test]
fn files_are_evaluated_as_mitsuba_does() {
    let text = std::fs::read_to_string(fixture("bsdf/mitsuba.csv")).unwrap();
    for (name, file) in cases::files() {
        let material = material(name, "memory", &file).unwrap();
        let rows: Vec<Vec<f64>> = text
            .lines()
            .filter_map(|l| l.strip_prefix(&format!("{name},")))
            .map(|l| l.split(',').map(|v| v.parse().unwrap()).collect())
            .collect();
        assert!(rows.len() >= 200, "{name}: {}", rows.len());
        let largest = rows.iter().flat_map(|r| &r[6..9]).fold(0.0_f64, |a, b| a.max(*b));
        let (mut worst, mut worst_density) = (0.0_f64, 0.0_f64);
        for row in &rows {
            let unit = |k: usize| DVec3::new(row[k], row[k + 1], row[k + 2]).normalize();
            let (i, o) = (unit(0), unit(3));
            for (nm, truth) in WAVELENGTHS_NM.iter().zip(&row[6..9]) {
                let value = material.brdf(*nm, i, o) * o.z;
                worst = worst.max((value - truth).abs() / (truth + 2e-3 * largest));
            }
            let density = material.sampling_density_per_sr(i, o);
            let truth = 0.8 * row[9] + 0.2 * o.z / std::f64::consts::PI;
            worst_density = worst_density.max((density - truth).abs() / (truth + 1e-2));
        }
        println!("{name}: {worst:.2e}, density {worst_density:.2e}");
        assert!(worst < 5e-3, "{name}: {worst}");
        assert!(worst_density < 1e-2, "{name}: {worst_density}");
    }
}

/// Truth: the law that was written. Tolerance: what 64 × 64 values and 24 elevations resolve, by the number of geometries within 0.5 and 2 %, where f is above 0.01 sr⁻¹.
#[test]
fn what_is_written_comes_back() {
    for (name, law) in cases::materials().into_iter().take(3) {
        let file = write(&law, &WriteOptions::at(vec![400.0, 800.0])).unwrap();
        let back = material(name, "memory", &file).unwrap();
        let mut errors = Vec::new();
        for theta_i in [5.0, 25.0, 47.0, 66.0, 78.0] {
            for theta_o in [2.0, 25.0, 44.0, 64.0, 75.0] {
                for phi in [0.0, 50.0, 110.0, 150.0, 175.0] {
                    let (i, o) = (direction(theta_i, 33.0), direction(theta_o, 33.0 + phi));
                    let truth = law.brdf(500.0, i, o);
                    if truth > 1e-2 {
                        let ratio = back.brdf(500.0, i, o) / truth;
                        errors.push((ratio - 1.0).abs());
                    }
                }
            }
        }
        errors.sort_by(f64::total_cmp);
        let at = |part: f64| errors[((errors.len() - 1) as f64 * part) as usize];
        println!(
            "{name}: {} median {:.1e} 90 % {:.1e} all {:.1e}",
            errors.len(),
            at(0.5),
            at(0.9),
            at(1.0)
        );
        assert!(at(0.5) < 5e-3 && at(0.9) < 2e-2, "{name}: {} {}", at(0.5), at(0.9));
    }
}

/// Truth: the albedo of what was written: ρ of a Lambert surface. Tolerance: 1 %, the grid's near the horizon.
#[test]
fn the_albedo_of_a_written_lambert_surface_is_its_reflectance() {
    let lambert = made("lambert");
    for theta in [0.0, 40.0, 75.0] {
        let albedo = lambert.albedo(550.0, direction(theta, 10.0)).unwrap();
        let truth = 0.2 + 0.7 * 250.0 / 700.0;
        assert!((albedo / truth - 1.0).abs() < 1e-2, "{theta}: {albedo} {truth}");
    }
    assert!(lambert.albedo_bound() < 1.0, "{}", lambert.albedo_bound());
}

/// Truth: a density integrates to 1 over the hemisphere, less what falls below the horizon. Tolerance: the midpoint rule on a bilinear density.
#[test]
fn a_file_draws_directions_with_the_density_that_it_says() {
    for name in ["ggx", "ward"] {
        let material = made(name);
        let i = direction(35.0, -20.0);
        let whole = hemisphere(700, |o| material.sampling_density_per_sr(i, o) / o.z);
        let mut hits = 0.0;
        let mut mean = 0.0;
        let n = 300;
        for a in 0..n {
            for b in 0..n {
                let u = [(f64::from(a) + 0.5) / f64::from(n), (f64::from(b) + 0.5) / f64::from(n)];
                if let Some(drawn) = material.sample(i, u) {
                    hits += 1.0;
                    let f = material.brdf(800.0, i, drawn.direction);
                    mean += f * drawn.direction.z / drawn.density_per_sr;
                }
            }
        }
        let all = f64::from(n * n);
        assert!((hits / all - whole).abs() < 5e-3, "{name}: {} {whole}", hits / all);
        let truth = hemisphere(700, |o| material.brdf(800.0, i, o));
        assert!((mean / all / truth - 1.0).abs() < 5e-3, "{name}: {} {truth}", mean / all);
    }
}

/// Truth: the file's first and last wavelength; a response of 100 nm beyond it is not covered for those.
#[test]
fn wavelengths_and_elevations_beyond_the_file_are_said() {
    let lambert = made("lambert");
    let response = Spectrum::<Response>::new(vec![700.0, 900.0], vec![1.0, 1.0]).unwrap();
    for rho in lambert.spectra() {
        let integral = Product::of(rho).times(&response).integral();
        assert!((integral.uncovered_nm - 100.0).abs() < 1e-9, "{}", integral.uncovered_nm);
    }
    // The file of numbers ends at 1.5 rad: 85.94°.
    let numbers = made("two_fold");
    let (inside, outside) = (direction(80.0, 10.0), direction(88.0, 10.0));
    assert!(numbers.covers(inside, DVec3::Z) && !numbers.covers(outside, DVec3::Z));
    let mut weights = vec![0.0; numbers.spectra().len()];
    numbers.add_weights(inside, DVec3::Z, 2.0, &mut weights);
    assert_eq!(weights[3].to_bits(), 0);
    numbers.add_weights(outside, DVec3::Z, 2.0, &mut weights);
    assert_eq!(weights[3], 2.0);
    let integral = Product::of(&numbers.spectra()[3]).times(&response).integral();
    assert_eq!((integral.value, integral.uncovered_nm), (0.0, 200.0));
    assert!(numbers.notes().iter().any(|n| n.contains("85.9")), "{:?}", numbers.notes());
}

fn field<'a>(file: &'a mut TensorFile, name: &str) -> &'a mut sunglint_formats::bsdf::Tensor {
    file.tensors.iter_mut().find(|t| t.name == name).unwrap()
}

#[test]
fn files_that_are_none_are_refused_with_the_field() {
    let refused = |change: &dyn Fn(&mut TensorFile), words: &[&str]| {
        let mut file = cases::two_fold();
        change(&mut file);
        let error = material("m", "x.bsdf", &file).unwrap_err().to_string();
        for word in words {
            assert!(error.contains(word), "{error} lacks {word}");
        }
    };
    let set = |name: &'static str, at: usize, value: f32| {
        move |file: &mut TensorFile| {
            if let TensorData::F32(values) = &mut field(file, name).data {
                values[at] = value;
            }
        }
    };
    refused(&set("spectra", 7, f32::NAN), &["spectra", "NaN", "place 7"]);
    refused(&set("vndf", 3, -1.0), &["vndf", "-1", "place 3"]);
    refused(&set("sigma", 2, 0.0), &["sigma", "place 2"]);
    refused(&set("theta_i", 1, 2.0), &["theta_i", "increase"]);
    refused(&set("theta_i", 3, 2.0), &["theta_i", "π/2"]);
    refused(&set("phi_i", 0, -2.6), &["phi_i", "azimuths from"]);
    refused(&|f| field(f, "spectra").shape = vec![5, 4, 3, 4, 9], &["spectra", "[5, 4, 3, 6, 6]"]);
    refused(&|f| f.tensors.retain(|t| t.name != "luminance"), &["luminance", "no such field"]);
    refused(&|f| field(f, "jacobian").data = TensorData::U8(vec![]), &["jacobian"]);
    let rgb = |f: &mut TensorFile| {
        f.tensors.retain(|t| t.name != "wavelengths");
        field(f, "spectra").name = "rgb".to_owned();
    };
    refused(&rgb, &["RGB", "_spec.bsdf"]);
    let zero = |f: &mut TensorFile| {
        if let TensorData::F32(values) = &mut field(f, "vndf").data {
            values[..48].fill(0.0);
        }
    };
    refused(&zero, &["vndf", "nothing but 0"]);
}
