//! Samples put together into a material.

use crate::cases::{MATERIALS, WAVELENGTHS_NM, density, measured, spectrum, whole};
use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use sunglint_calibration::brdf::assemble::{AssembleError, AssembleOptions, assemble};
use sunglint_calibration::brdf::plan::{PlanOptions, Rig};
use sunglint_calibration::brdf::samples::{Samples, direction};
use sunglint_simulator::surface::measured::material;
use sunglint_testkit::fixture;

/// Geometries: a third around the mirrored direction, the others anywhere.
fn geometries(count: usize) -> Vec<(DVec3, DVec3)> {
    let mut rng = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(11);
    (0..count)
        .map(|k| {
            let theta_i: f64 = rng.random_range(0.0..80.0);
            let o = if k % 3 == 0 {
                let theta_o = (theta_i + rng.random_range(-15.0..15.0_f64)).clamp(0.0, 88.0);
                direction(theta_o, 180.0 + rng.random_range(-25.0..25.0))
            } else {
                direction(rng.random_range(0.0..88.0), rng.random_range(0.0..360.0))
            };
            (direction(theta_i, 0.0), o)
        })
        .collect()
}

fn quantile(errors: &mut [f64], part: f64) -> f64 {
    errors.sort_by(f64::total_cmp);
    errors[((errors.len() - 1) as f64 * part) as usize]
}

/// Truth: the closed forms that the samples were made from, where f cosθ exceeds 1e-3 of that in the mirrored direction. By the project's evaluator; and the same file's
/// values by Mitsuba 3.9.1's plug-in `measured`, stored. Tolerance: median 1e-3, 90 % 1 %; what is worse lies within a cell of the horizon or of a tail that the grid of 64 by 64
/// hardly resolves (largest up to θ_o = 80°: 25 %). Against Mitsuba 1 % (single precision) of the value or of 1e-3 of the largest.
#[test]
fn three_materials_come_back() {
    let stored = std::fs::read_to_string(fixture("bsdf/assembled.csv")).unwrap();
    for (name, law) in MATERIALS {
        let made = whole(law);
        let back = material(name, "memory", &made.file).unwrap();
        let (mut all, mut up_to_80) = (Vec::new(), Vec::new());
        for (i, o) in geometries(3000) {
            let truth = law(i, o) * o.z;
            let mirrored = DVec3::new(-i.x, -i.y, i.z);
            if truth > 1e-3 * law(i, mirrored) * mirrored.z {
                let value = back.brdf(550.0, i, o) * o.z;
                let error = (value / (truth * spectrum(550.0)) - 1.0).abs();
                all.push(error);
                if o.z > 80_f64.to_radians().cos() {
                    up_to_80.push(error);
                }
            }
        }
        let at = [0.5, 0.9, 0.95, 0.99].map(|p| quantile(&mut all, p));
        let near = [0.95, 0.99, 1.0].map(|p| quantile(&mut up_to_80, p));
        println!(
            "{name}: {} geometries, 50 90 95 99 %: {at:.5?}; up to 80°, 95 99 100 %: {near:.5?}",
            all.len()
        );
        assert!(at[0] < 1e-3 && at[1] < 1e-2 && near[2] < 0.25, "{name}: {at:?} {near:?}");
        assert!(made.coverage.iter().all(|c| c.largest_albedo <= 1.0), "{name}");

        let rows: Vec<Vec<f64>> = stored
            .lines()
            .filter_map(|l| l.strip_prefix(&format!("{name},")))
            .map(|l| l.split(',').map(|v| v.parse().unwrap()).collect())
            .collect();
        assert!(rows.len() >= 300, "{name}: {}", rows.len());
        let largest = rows.iter().flat_map(|r| &r[6..9]).fold(0.0_f64, |a, b| a.max(*b));
        let (mut apart, mut theirs) = (0.0_f64, Vec::new());
        for row in &rows {
            let unit = |k: usize| DVec3::new(row[k], row[k + 1], row[k + 2]).normalize();
            let (i, o) = (unit(0), unit(3));
            for (nm, value) in WAVELENGTHS_NM.iter().zip(&row[6..9]) {
                let ours = back.brdf(*nm, i, o) * o.z;
                apart = apart.max((ours - value).abs() / (value + 1e-3 * largest));
            }
            let (truth, mirrored) = (law(i, o) * o.z, DVec3::new(-i.x, -i.y, i.z));
            if truth > 1e-3 * law(i, mirrored) * mirrored.z {
                theirs.push((row[7] / (truth * spectrum(550.0)) - 1.0).abs());
            }
        }
        let by_mitsuba = [0.5, 0.9, 0.95, 0.99, 1.0].map(|p| quantile(&mut theirs, p));
        println!(
            "{name}: evaluators apart {apart:.1e}; truth by Mitsuba, 50 90 95 99 100 %: {by_mitsuba:.5?}"
        );
        assert!(apart < 1e-2, "{name}: {apart}");
        assert!(by_mitsuba[0] < 1e-3 && by_mitsuba[1] < 1e-2, "{name}: {by_mitsuba:?}");
    }
}

/// Truth: the closed form (GGX 0.2, which the NDF describes well). A rig in one plane, phase angles of 30° and more, θ_i up to 55°: up to 50° of incidence it is off by less than 6 %
/// anywhere, at 70°, beyond what the rig reaches, by less than 10 %; and more than half of the cells there are said to be extrapolated.
#[test]
fn a_rig_in_one_plane_says_what_it_did_not_see() {
    let (name, law) = MATERIALS[2];
    let ndf = density(law);
    let plan = PlanOptions { theta_i: 12, ..PlanOptions::of_rig(Rig::default()) };
    let samples = measured(law, &ndf, &plan);
    let made = assemble(&samples, &ndf, &AssembleOptions::default()).unwrap();
    let back = material(name, "memory", &made.file).unwrap();
    for (theta_i, most) in [(10.0, 0.06), (30.0, 0.06), (50.0, 0.06), (70.0, 0.1)] {
        for phi in [0.0, 60.0, 120.0, 180.0] {
            let off = (1..17).map(|k| {
                let (i, o) = (direction(theta_i, 0.0), direction(5.0 * f64::from(k), phi));
                (back.brdf(550.0, i, o) / (law(i, o) * spectrum(550.0))).ln().abs()
            });
            let mut off: Vec<f64> = off.collect();
            println!(
                "rig {theta_i} {phi}: median {:.4}, most {:.4}",
                quantile(&mut off, 0.5),
                quantile(&mut off, 1.0)
            );
            assert!(quantile(&mut off, 1.0) < most, "{theta_i} {phi}: {off:?}");
        }
    }
    let far = made.coverage.iter().find(|c| c.theta_i_deg > 68.0).unwrap();
    assert!(far.extrapolated_cells > 0.5 && far.extrapolated_albedo > 0.3, "{far:?}");
    assert!(matches!(
        assemble(&Samples::default(), &ndf, &AssembleOptions::default()),
        Err(AssembleError::TooFew { .. })
    ));
}

/// Truth: energy. Samples in the plane alone that are too bright are extrapolated to more than came: the extrapolated cells give way, the measured ones stay, and it is said.
#[test]
fn energy_is_kept_by_what_was_not_measured() {
    let (_, law) = MATERIALS[0];
    let ndf = density(law);
    let plan = PlanOptions { theta_i: 8, ..PlanOptions::of_rig(Rig::default()) };
    let mut samples = measured(law, &ndf, &plan);
    for value in samples.rows.iter_mut().flat_map(|r| &mut r.brdf_per_sr) {
        *value *= 1.6;
    }
    let options = AssembleOptions { theta_i: 8, side: 32, ..AssembleOptions::default() };
    let made = assemble(&samples, &ndf, &options).unwrap();
    // Wavelength by wavelength 0.64, 0.88 and 1.28 of the light.
    let lowered = made.coverage.iter().filter(|c| c.lowered < 0.95).count();
    let over = made.coverage.iter().filter(|c| c.largest_albedo > 1.001).count();
    println!("{:?}", made.coverage);
    assert!(lowered > 0 && over == made.warnings.len(), "{lowered} {over} {:?}", made.warnings);
}
