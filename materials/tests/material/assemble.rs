//! Samples put together into a material.

use crate::material::cases::{
    Known, MATERIALS, OTHER, WAVELENGTHS_NM, coarse, density, density_beside, from_plan, measured, paint, rising,
    spectrum, whole,
};
use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use std::f64::consts::PI;
use sunglint_materials::assemble::{AssembleError, AssembleOptions, assemble};
use sunglint_materials::plan::{PlanOptions, Rig};
use sunglint_materials::samples::{Samples, direction};
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

/// Truth: the closed forms, as above. Tolerance: the promised 1 % in every direction up to 88° of light and detector: what files of the usual size lack there is their grid's, not the
/// measurements', which are the same (by Mitsuba 3.9.1, 40,000 directions: 0.66 % and 0.83 % at most).
#[test]
fn finer_grids_hold_a_hundredth_to_the_horizon() {
    let options = AssembleOptions { theta_i: 144, side: 257, ..AssembleOptions::default() };
    for (name, law) in MATERIALS.into_iter().filter(|m| m.0 != "beckmann") {
        let made = from_plan(law, (16, 17), &options);
        let [_, mut all] = errors(law, &material(name, "memory", &made.file).unwrap());
        let all = PARTS.map(|p| quantile(&mut all, p));
        println!("{name}: to 88° {all:.5?}");
        assert!(all[4] < 1e-2, "{name}: {all:?}");
    }
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
    let ndf = density(law);
    let plan = PlanOptions { theta_i: 12, ..PlanOptions::of_rig(Rig::default()) };
    let samples = measured(law, &ndf, &plan);
    let made = assemble(&samples, &ndf, &coarse()).unwrap();
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
        assemble(&Samples::default(), &ndf, &coarse()),
        Err(AssembleError::TooFew { .. })
    ));
}

/// Truth: the closed forms of six materials, of which the NDF describes three, from a rig in one plane. Tolerance: the doubt that is stated holds the true error in 95 % of the extrapolated
/// directions of each where f cosθ exceeds 1e-3 of that in the mirrored direction, and says something: its median is below a factor of 1.5. (It misses the mirrored directions beyond 65°, where F rises.)
#[test]
fn the_doubt_of_what_is_extrapolated_holds_the_error() {
    let more: [Known; 3] = [OTHER, ("paint", paint), ("rising", rising)];
    let mut missed = Vec::new();
    for (name, law) in MATERIALS.into_iter().chain(more) {
        let ndf = density(law);
        let plan = PlanOptions { theta_i: 12, ..PlanOptions::of_rig(Rig::default()) };
        let samples = measured(law, &ndf, &plan);
        let made = assemble(&samples, &ndf, &coarse()).unwrap();
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

/// GGX of 0.15 with F₀ = 0.04 (Schlick) over 0.6/π.
fn glossy(i: DVec3, o: DVec3) -> f64 {
    let a2: f64 = 0.0225;
    let h = (i + o).normalize();
    let d = a2 / (PI * (h.z * h.z * (a2 - 1.0) + 1.0).powi(2));
    let lambda = |v: DVec3| 0.5 * ((1.0 + a2 * (1.0 / (v.z * v.z) - 1.0)).sqrt() - 1.0);
    let f = 0.04 + 0.96 * (1.0 - i.dot(h)).powi(5);
    f * d / (1.0 + lambda(i) + lambda(o)) / (4.0 * i.z * o.z) + 0.6 / PI
}

#[test]
fn glossy_paint_is_put_together() {
    let ndf = density_beside(glossy, std::env::var("NODIFF").is_err());
    let p = &ndf.profiles[0];
    println!("α {:?} {:?} F₀ {} {:?}", p.ggx, p.diffuse, ndf.f0, ndf.notes);
    let plan = PlanOptions { theta_i: 16, side: 17, ..PlanOptions::default() };
    let samples = measured(glossy, &ndf, &plan);
    let made = assemble(&samples, &ndf, &AssembleOptions::default()).unwrap();
    let back = material("glossy", "memory", &made.file).unwrap();
    let [mut near, mut all] = errors(glossy, &back);
    let (near, all) = (PARTS.map(|p| quantile(&mut near, p)), PARTS.map(|p| quantile(&mut all, p)));
    println!(
        "glossy from {}: up to 80° {near:.5?}; to 88° {all:.5?}; {:?}",
        made.used, made.base[1]
    );
    let mut worst: Vec<(f64, f64, f64, f64, f64)> = geometries(9000).into_iter().filter(|(i, o)| i.z.min(o.z) > 80_f64.to_radians().cos()).map(|(i, o)| {
        let e = (back.brdf(550.0, i, o) / (glossy(i, o) * spectrum(550.0))).ln();
        let h = (i + o).normalize();
        (e, i.z.acos().to_degrees(), o.z.acos().to_degrees(), o.y.atan2(o.x).to_degrees(), h.z.min(1.0).acos().to_degrees())
    }).collect();
    worst.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
    for w in worst.iter().take(25) { println!("{w:.3?}"); }
    let (mut held, mut count, mut doubts) = (0, 0, Vec::new());
    for d in &made.doubts {
        let (i, o) = (direction(d.theta_i_deg, d.phi_i_deg), direction(d.theta_o_deg, d.phi_o_deg));
        let error = (back.brdf(550.0, i, o) / (glossy(i, o) * spectrum(550.0))).ln().abs();
        held += usize::from(error <= d.ln_doubt);
        count += 1;
        doubts.push(d.ln_doubt);
        assert!(d.ln_doubt > 0.0);
    }
    let doubt = quantile(&mut doubts, 0.5);
    println!("doubt holds {held} of {count}, median {doubt:.4}");
    assert!((p.ggx.alpha / 0.15 - 1.0).abs() < 0.03, "{:?}", p.ggx);
    assert!(near[2] < 0.05, "{near:?}");
    assert!(held * 100 >= count * 95, "{held} of {count}");
}
