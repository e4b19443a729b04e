//! Samples put together into a material.

use crate::material::cases::{
    MATERIALS, OTHER, SIX, WAVELENGTHS_NM, coarse, density, density_beside, from_plan, glossy,
    glossy_whole, measured, of_rig, paint, spectrum, whole,
};
use glam::{DQuat, DVec3};
use rand::{RngExt as _, SeedableRng as _};
use std::f64::consts::PI;
use sunglint_materials::assemble::{AssembleError, AssembleOptions, assemble};
use sunglint_materials::plan::{PlanOptions, Rig};
use sunglint_materials::samples::{Samples, direction};
use sunglint_numerics::progress::{Progress, Silent};
use sunglint_simulator::surface::Material;
use sunglint_simulator::surface::measured::material;
use sunglint_testkit::fixture;

/// Geometries up to 88° of light and detector: a third around the mirrored direction, the others anywhere.
fn geometries(count: usize) -> Vec<(DVec3, DVec3)> {
    let mut rng = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(11);
    (0..count)
        .map(|k| {
            let theta_i: f64 = rng.random_range(0.0..88.0);
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

/// How far a file is from the law, by direction: (θ_i and θ_o up to 80°, up to 88°), where f cosθ exceeds 1e-3 of that in the mirrored direction.
fn errors(law: fn(DVec3, DVec3) -> f64, back: &Material) -> [Vec<f64>; 2] {
    let (mut up_to_80, mut all) = (Vec::new(), Vec::new());
    for (i, o) in geometries(9000) {
        let truth = law(i, o) * o.z;
        let mirrored = DVec3::new(-i.x, -i.y, i.z);
        if truth > 1e-3 * law(i, mirrored) * mirrored.z {
            let error = (back.brdf(550.0, i, o) * o.z / (truth * spectrum(550.0)) - 1.0).abs();
            all.push(error);
            if i.z.min(o.z) > 80_f64.to_radians().cos() {
                up_to_80.push(error);
            }
        }
    }
    [up_to_80, all]
}

const PARTS: [f64; 5] = [0.5, 0.9, 0.99, 0.999, 1.0];

/// Truth: the closed forms that the samples were made from, where f cosθ exceeds 1e-3 of that in the mirrored direction (its peak is no lower). By the project's evaluator; and
/// the same file's values by Mitsuba 3.9.1's plug-in `measured`, stored. Tolerance: the promised 1 % in every direction up to 80° of light and detector, and in 99.9 % of those up to 88°, 2.5 % in all of
/// them: the horizon lies two cells further. Against Mitsuba 1 % (single precision) of the value or of 1e-3 of the largest.
#[test]
fn three_materials_come_back() {
    let stored = std::fs::read_to_string(fixture("bsdf/assembled.csv")).unwrap();
    for (name, law) in MATERIALS {
        let made = whole(name);
        let back = material(name, "memory", &made.file).unwrap();
        let [mut near, mut all] = errors(law, &back);
        let (near, all) =
            (PARTS.map(|p| quantile(&mut near, p)), PARTS.map(|p| quantile(&mut all, p)));
        println!("{name} from {}: up to 80° {near:.5?}; to 88° {all:.5?}", made.used);
        assert!(near[0] < 1e-3 && near[4] < 1e-2, "{name}: {near:?}");
        assert!(all[3] < 1e-2 && all[4] < 2.5e-2, "{name}: {all:?}");
        assert!(made.coverage.iter().all(|c| c.largest_albedo <= 1.0 + 1e-3), "{name}");

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
        let by_mitsuba = PARTS.map(|p| quantile(&mut theirs, p));
        println!("{name}: evaluators apart {apart:.1e}; truth by Mitsuba {by_mitsuba:.5?}");
        assert!(apart < 1e-2, "{name}: {apart}");
        assert!(by_mitsuba[0] < 1e-3 && by_mitsuba[2] < 1e-2, "{name}: {by_mitsuba:?}");
        assert!(by_mitsuba[4] < 2.5e-2, "{name}: {by_mitsuba:?}");
    }
}

/// Truth: the closed form of a glossy paint; its assembled file's values by Mitsuba 3.9.1's plug-in `measured`, stored. Tolerance, as promised: 99 % of directions up to 80° within 5 %, spheres
/// within 1 % to phase 140°. Against Mitsuba 1 % of the value or of 1e-3 of the largest.
#[test]
fn glossy_paint_by_mitsuba() {
    let back = material("glossy", "memory", &glossy_whole().file).unwrap();
    let stored = std::fs::read_to_string(fixture("bsdf/assembled.csv")).unwrap();
    let rows = stored.lines().filter_map(|l| l.strip_prefix("glossy,"));
    let rows: Vec<Vec<f64>> =
        rows.map(|l| l.split(',').map(|v| v.parse().unwrap()).collect()).collect();
    assert!(rows.len() >= 300, "{}", rows.len());
    let largest = rows.iter().map(|r| r[7]).fold(0.0_f64, f64::max);
    let mut theirs = Vec::new();
    for row in &rows {
        let unit = |k: usize| DVec3::new(row[k], row[k + 1], row[k + 2]).normalize();
        let (i, o) = (unit(0), unit(3));
        let ours = back.brdf(550.0, i, o) * o.z;
        assert!((ours - row[7]).abs() / (row[7] + 1e-3 * largest) < 1e-2, "{ours} {}", row[7]);
        if i.z.min(o.z) > 80_f64.to_radians().cos() {
            theirs.push((row[7] / (glossy(i, o) * o.z * spectrum(550.0)) - 1.0).abs());
        }
    }
    let theirs = PARTS.map(|p| quantile(&mut theirs, p));
    println!("glossy, truth by Mitsuba: {theirs:.5?}");
    assert!(theirs[2] < 0.05, "{theirs:?}");
    // Spheres: the closed form in steps of half a degree.
    for deg in [10.0_f64, 30.0, 60.0, 90.0, 120.0, 140.0] {
        let mut sum = vec![0.0; back.spectra().len()];
        back.add_sphere_weights(deg.to_radians(), 1.0, &mut sum).unwrap();
        let truth = sphere_of(glossy, deg.to_radians()) * spectrum(550.0);
        let ours = back.times_spectra(550.0, &sum);
        println!("glossy sphere {deg}°: {:+.1e}", ours / truth - 1.0);
        assert!((ours / truth - 1.0).abs() < 1e-2, "{deg}: {ours} {truth}");
    }
}

/// Radiant intensity of a sphere of 1 m at a phase angle, over the irradiance.
fn sphere_of(law: fn(DVec3, DVec3) -> f64, phase: f64) -> f64 {
    let sun = DVec3::new(phase.sin(), 0.0, phase.cos());
    let (n, m) = (360_i32, 720_i32);
    let mut sum = 0.0;
    for a in 0..n {
        let theta = 0.5 * PI * (f64::from(a) + 0.5) / f64::from(n);
        for b in 0..m {
            let phi = 2.0 * PI * (f64::from(b) + 0.5) / f64::from(m);
            let normal = direction(theta.to_degrees(), phi.to_degrees());
            let (ci, co) = (normal.dot(sun), normal.z);
            if ci > 0.0 {
                let (x, y) = normal.any_orthonormal_pair();
                let into = |v: DVec3| DVec3::new(v.dot(x), v.dot(y), v.dot(normal));
                let solid = theta.sin() * 0.5 * PI / f64::from(n) * 2.0 * PI / f64::from(m);
                sum += law(into(sun), into(DVec3::Z)) * ci * co * solid;
            }
        }
    }
    sum
}

/// Truth: the closed form of GGX, as above. Tolerance: the promised 1 % in every direction up to 88° of light and detector: what files of the usual size lack there is their grid's, not the
/// measurements', which are the same (by Mitsuba 3.9.1, 40,000 directions: 0.66 % and 0.83 % at most).
#[test]
fn finer_grids_hold_a_hundredth_to_the_horizon() {
    let options = AssembleOptions { theta_i: 144, side: 257, ..AssembleOptions::default() };
    let (name, law) = MATERIALS[2];
    let made = from_plan(law, (16, 17), &options);
    let [_, mut all] = errors(law, &material(name, "memory", &made.file).unwrap());
    let all = PARTS.map(|p| quantile(&mut all, p));
    println!("{name}: to 88° {all:.5?}");
    assert!(all[4] < 1e-2, "{name}: {all:?}");
}

/// Truth: Mitsuba 3.9.1's pictures of a sphere of the same files under a collimated light from 10 to 150° aside, orthographic, 512 by 512 pixels of 256 rays, summed, stored. Tolerance:
/// the promised 0.5 %. And the Lambert sphere's closed form (Russell 1916), 0.5 %: what the file's grid loses.
#[test]
fn spheres_are_as_bright_as_mitsubas() {
    let stored = std::fs::read_to_string(fixture("bsdf/assembled_spheres.csv")).unwrap();
    for (name, _) in MATERIALS {
        let back = material(name, "memory", &whole(name).file).unwrap();
        let lines: Vec<_> =
            stored.lines().filter_map(|l| l.strip_prefix(&format!("{name},"))).collect();
        assert_eq!(lines.len(), 6, "{name}");
        for line in lines {
            let row: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
            let phase = row[0].to_radians();
            let mut sum = vec![0.0; back.spectra().len()];
            back.add_sphere_weights(phase, 1.0, &mut sum).unwrap();
            for (nm, theirs) in WAVELENGTHS_NM.iter().zip(&row[1..]) {
                let ours = back.times_spectra(*nm, &sum);
                println!("{name} {:3}° {nm}: {:+.1e}", row[0], ours / theirs - 1.0);
                assert!((ours / theirs - 1.0).abs() < 5e-3, "{name} {}: {ours} {theirs}", row[0]);
                if name == "lambert" {
                    let truth = 2.0 / (3.0 * PI) * (phase.sin() + (PI - phase) * phase.cos());
                    assert!((ours / (truth * spectrum(*nm)) - 1.0).abs() < 5e-3, "{}", row[0]);
                }
            }
        }
    }
}

/// Truth: a closed form that is not what values are compared with (its masking, and diffuse light that its NDF takes for microfacets). Tolerance, up to 80°: what a plan leaves between its
/// directions, nearly all where light and detector are beyond 65°: 3000 measurements 1 % in nine of ten directions and 12 % in 99 %, 26000 1.2 % in 99 %.
#[test]
fn what_the_ndf_does_not_say_comes_from_the_samples() {
    let (name, law) = OTHER;
    for (theta_i, side, most) in [(16, 17, [1e-3, 1e-2, 0.12]), (32, 33, [1e-3, 3e-3, 1.2e-2])] {
        let made = from_plan(law, (theta_i, side), &coarse());
        let [mut near, _] = errors(law, &material(name, "memory", &made.file).unwrap());
        let near = PARTS.map(|p| quantile(&mut near, p));
        println!("{name} from {}: up to 80° {near:.5?}, {:?}", made.used, made.base[1]);
        for (error, most) in near.iter().zip(most) {
            assert!(*error < most, "{theta_i} {side}: {near:?}");
        }
    }
}

/// Truth: the closed form (GGX 0.2, which the NDF describes well). A rig in one plane, phase angles of 30° and more, θ_i up to 55°: up to 50° of incidence it is off by less than 6 %
/// anywhere, at 70°, beyond what the rig reaches, by less than 10 %; and more than half of the cells there are said to be extrapolated.
#[test]
fn a_rig_in_one_plane_says_what_it_did_not_see() {
    let (name, law) = MATERIALS[2];
    let (ndf, made) = of_rig(name);
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
        assemble(&Samples::default(), ndf, &coarse(), &Silent),
        Err(AssembleError::TooFew { .. })
    ));
}

/// Ends the work before anything is done.
struct Ended;

impl Progress for Ended {
    fn advance(&self, _: u64) {
        panic!("a direction of incidence was done");
    }

    fn is_cancelled(&self) -> bool {
        true
    }
}

/// Truth: the closed forms of six materials, of which the NDF describes three, from a rig in one plane. Tolerance: the doubt that is stated holds the true error in 95 % of the extrapolated
/// directions of each where f cosθ exceeds 1e-3 of that in the mirrored direction, and says something: its median is below a factor of 1.5. (It misses the mirrored directions beyond 65°, where F rises.)
#[test]
fn the_doubt_of_what_is_extrapolated_holds_the_error() {
    let mut missed = Vec::new();
    for (name, law) in SIX {
        let (_, made) = of_rig(name);
        let back = material(name, "memory", &made.file).unwrap();
        let (mut held, mut all, mut doubts, mut off) = (0, 0, Vec::new(), Vec::new());
        for d in made.doubts.iter().filter(|d| d.extrapolated) {
            let (i, o) =
                (direction(d.theta_i_deg, d.phi_i_deg), direction(d.theta_o_deg, d.phi_o_deg));
            let mirrored = DVec3::new(-i.x, -i.y, i.z);
            if law(i, o) * o.z < 1e-3 * law(i, mirrored) * mirrored.z {
                continue;
            }
            let error = (back.brdf(550.0, i, o) / (law(i, o) * spectrum(550.0))).ln().abs();
            held += usize::from(error < d.ln_doubt);
            all += 1;
            doubts.push(d.ln_doubt);
            off.push(error);
        }
        let part = f64::from(held as u32) / f64::from(all as u32);
        let [doubt, most] = [0.5, 1.0].map(|p| quantile(&mut doubts, p));
        let off = [0.5, 0.95, 1.0].map(|p| quantile(&mut off, p));
        println!(
            "{name}: {part:.3} of {all} held; doubt {doubt:.3}, most {most:.3}; error 50, 95, 100 % {off:.4?}"
        );
        if all < 60 || part < 0.95 || doubt > 1.5_f64.ln() {
            missed.push(name);
        }
    }
    assert!(missed.is_empty(), "{missed:?}");
}

/// Truth: the closed form, before stray light (7e-4 /sr over cosθ_o) and a detector that stands 0.07° from where it is said to be were added to it. The values say that up to 1e-3 /sr may be left, and
/// zeros that are known to 0.07°. Tolerance: the doubt holds the error in 95 % of all directions down to 1e-4 of the mirrored peak. Of an instrument that says nothing it does not.
#[test]
fn what_an_instrument_leaves_is_in_the_doubt() {
    let (stray, aside) = (7e-4, 0.07_f64);
    let (name, law) = MATERIALS[1];
    let ndf = density(law);
    let plan = PlanOptions { theta_i: 8, ..PlanOptions::default() };
    let mut samples = measured(law, &ndf, &plan);
    let turn = DQuat::from_rotation_y(aside.to_radians());
    for row in &mut samples.rows {
        let (i, o) = row.directions();
        for (value, nm) in row.brdf_per_sr.iter_mut().zip(WAVELENGTHS_NM) {
            let there = turn * o;
            *value = if there.z > 0.0 { law(i, there) } else { 0.0 } * spectrum(nm) + stray / o.z;
        }
    }
    let options = AssembleOptions { theta_i: 8, side: 65, ..AssembleOptions::default() };
    let held = |samples: &Samples| {
        let made = assemble(samples, &ndf, &options, &Silent).unwrap();
        let back = material(name, "memory", &made.file).unwrap();
        let (mut held, mut all) = (0_u32, 0_u32);
        for d in &made.doubts {
            let (i, o) =
                (direction(d.theta_i_deg, d.phi_i_deg), direction(d.theta_o_deg, d.phi_o_deg));
            let mirrored = DVec3::new(-i.x, -i.y, i.z);
            if law(i, o) * o.z < 1e-4 * law(i, mirrored) * mirrored.z {
                continue;
            }
            let off = |nm: &f64| (back.brdf(*nm, i, o) / (law(i, o) * spectrum(*nm))).ln().abs();
            held += u32::from(WAVELENGTHS_NM.iter().all(|nm| off(nm) <= d.ln_doubt));
            all += 1;
        }
        let albedo = made.coverage.iter().map(|c| c.albedo_doubt).fold(f64::INFINITY, f64::min);
        println!("{held} of {all} held, albedo's doubt at least {albedo:.4}");
        (f64::from(held) / f64::from(all), all, albedo)
    };
    let (said_nothing, ..) = held(&samples);
    let instrument = serde_json::json!({
        "cone_half_angle_deg": 0.0, "signature": { "source_half_angle_deg": 0.0 },
        "stray_bound_per_sr": 1e-3, "zeros": { "sample_deg": [0.0, 0.0], "detector_deg": [0.0, aside] },
    });
    samples.meta.insert("instrument".into(), instrument);
    let (said, all, albedo) = held(&samples);
    assert!(all > 100 && said >= 0.95 && said_nothing < 0.85, "{said} {said_nothing} of {all}");
    // 2π times 1e-3, of an albedo of at most 0.8.
    assert!(albedo > 2.0 * PI * 1e-3 / 0.8, "{albedo}");
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
    let made = assemble(&samples, &ndf, &options, &Silent).unwrap();
    let ended = assemble(&samples, &ndf, &options, &Ended);
    assert!(matches!(ended, Err(AssembleError::Cancelled(_))));
    // Wavelength by wavelength 0.64, 0.88 and 1.28 of the light.
    let lowered = made.coverage.iter().filter(|c| c.lowered < 0.95).count();
    let over = made.coverage.iter().filter(|c| c.largest_albedo > 1.001).count();
    println!("{:?}", made.coverage);
    assert!(lowered > 0 && over == made.warnings.len(), "{lowered} {over} {:?}", made.warnings);
}

/// A value with an error of a part of it, by Box and Muller.
fn noisy(mut samples: Samples, noise: f64) -> Samples {
    let mut rng = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(7);
    for row in &mut samples.rows {
        let (u, v): (f64, f64) = (rng.random(), rng.random());
        let normal = (-2.0 * (1.0 - u).ln()).sqrt() * (2.0 * PI * v).cos();
        row.brdf_per_sr.iter_mut().for_each(|f| *f *= 1.0 + noise * normal);
    }
    samples
}

/// Truth: closed forms (Walter et al. 2007; Heitz 2014, height-correlated; Schlick 1994) of paints: a lobe over diffuse light, some 2,000 directions of a plan. Tolerance, as promised: α ± 3 %, 99 % of
/// directions up to 80° within 5 %, without noise and with 1 % (a plane through 24 neighbours of which the nearest count most leaves about the noise of one), the stated doubt holds the error
/// in 95 % of the directions, is never 0, and its median is at most 8 times the median error (a normal distribution has 2.9; what is left out has its own noise, which a mean of neighbours has not, and the file's
/// grid adds 1 %).
#[test]
fn glossy_paint_is_put_together() {
    type Law = fn(DVec3, DVec3) -> f64;
    let laws: [(&str, Law, f64); 2] = [("glossy", glossy, 0.15), ("paint", paint, 0.25)];
    for (name, law, alpha) in laws {
        let ndf = density_beside(law, true);
        let p = &ndf.profiles[0];
        println!("{name}: α {:?} {:?} F₀ {} {:?}", p.ggx, p.diffuse, ndf.f0, ndf.notes);
        assert!((p.ggx.alpha / alpha - 1.0).abs() < 0.03, "{:?}", p.ggx);
        let plan = PlanOptions { theta_i: 16, side: 17, ..PlanOptions::default() };
        for noise in [0.0, 0.01] {
            let of_noise;
            let made = if name == "glossy" && noise == 0.0 {
                glossy_whole()
            } else {
                let samples = noisy(measured(law, &ndf, &plan), noise);
                of_noise = assemble(&samples, &ndf, &AssembleOptions::default(), &Silent).unwrap();
                &of_noise
            };
            let back = material(name, "memory", &made.file).unwrap();
            let [mut near, mut all] = errors(law, &back);
            let (near, all) =
                (PARTS.map(|p| quantile(&mut near, p)), PARTS.map(|p| quantile(&mut all, p)));
            println!(
                "{name} {noise} from {}: up to 80° {near:.5?}; to 88° {all:.5?}; {:?}",
                made.used, made.base[1]
            );
            let (mut held, mut doubts, mut off) = (0, Vec::new(), Vec::new());
            for d in &made.doubts {
                let (i, o) =
                    (direction(d.theta_i_deg, d.phi_i_deg), direction(d.theta_o_deg, d.phi_o_deg));
                let error = (back.brdf(550.0, i, o) / (law(i, o) * spectrum(550.0))).ln().abs();
                held += usize::from(error <= d.ln_doubt);
                doubts.push(d.ln_doubt);
                off.push(error);
                assert!(d.ln_doubt > 0.0);
            }
            let count = doubts.len();
            let (doubt, off) = (quantile(&mut doubts, 0.5), quantile(&mut off, 0.5));
            println!("  doubt holds {held} of {count}, median {doubt:.4}, error {off:.4}");
            assert!(near[2] < 0.05, "{name} {noise}: {near:?}");
            assert!(held * 100 >= count * 95, "{held} of {count}");
            // The half of the directions is within a quarter of what 95 % are within; noise of the samples themselves is in what is left out, and averaged in the file.
            assert!(noise == 0.0 || doubt < 9.0 * off, "{doubt} {off}");
        }
    }
}
