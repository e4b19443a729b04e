//! An anisotropic sample from retro-reflection to a material.

use crate::material::cases::{measured, spectrum};
use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use std::f64::consts::PI;
use sunglint_materials::assemble::{AssembleOptions, assemble};
use sunglint_materials::ndf::{Ndf, NdfOptions, extract};
use sunglint_materials::plan::PlanOptions;
use sunglint_materials::samples::direction;
use sunglint_materials::table::{Reading, RetroFlags, RetroTable};
use sunglint_numerics::progress::Silent;
use sunglint_simulator::surface::measured::material;

/// Along and across the tangent.
const ALPHA: [f64; 2] = [0.1, 0.3];

/// tan²θ/α² of a direction.
fn spread(v: DVec3) -> f64 {
    ((v.x / ALPHA[0]).powi(2) + (v.y / ALPHA[1]).powi(2)) / (v.z * v.z)
}

/// α² in a direction's azimuth, times tan²θ.
fn alpha2_tan2(v: DVec3) -> f64 {
    ((v.x * ALPHA[0]).powi(2) + (v.y * ALPHA[1]).powi(2)) / (v.z * v.z)
}

fn beckmann(m: DVec3) -> f64 {
    (-spread(m)).exp() / (PI * ALPHA[0] * ALPHA[1] * m.z.powi(4))
}

fn ggx(m: DVec3) -> f64 {
    1.0 / (PI * ALPHA[0] * ALPHA[1] * m.z.powi(4) * (1.0 + spread(m)).powi(2))
}

fn lambda_ggx(v: DVec3) -> f64 {
    0.5 * ((1.0 + alpha2_tan2(v)).sqrt() - 1.0)
}

/// By Walter et al. (2007), eq. 15, a rational function good to 0.35 %.
fn lambda_beckmann(v: DVec3) -> f64 {
    let a = 1.0 / alpha2_tan2(v).max(1e-20).sqrt();
    if a < 1.6 { (1.0 - 1.259 * a + 0.396 * a * a) / (3.535 * a + 2.181 * a * a) } else { 0.0 }
}

/// Heitz (2014), eq. 102: masked together in retro-reflection, by azimuth elsewhere.
fn law(i: DVec3, o: DVec3, d: fn(DVec3) -> f64, lambda: fn(DVec3) -> f64) -> f64 {
    let (a, b) = (lambda(i), lambda(o));
    let (p, q) = (i.truncate(), o.truncate());
    let apart = if p.length() * q.length() > 1e-12 { p.angle_to(q).abs() } else { 0.5 * PI };
    let independent = 4.41 * apart / (4.41 * apart + 1.0);
    d((i + o).normalize()) / (1.0 + a.max(b) + independent * a.min(b)) / (4.0 * i.z * o.z)
}

fn of_ggx(i: DVec3, o: DVec3) -> f64 {
    law(i, o, ggx, lambda_ggx)
}

fn of_beckmann(i: DVec3, o: DVec3) -> f64 {
    law(i, o, beckmann, lambda_beckmann)
}

/// Retro-reflection every degree to 88° in planes by 7.5°.
fn density(law: fn(DVec3, DVec3) -> f64) -> Ndf {
    let plane = |k: i32| {
        (-10..=88).map(move |angle| {
            let (angle_deg, azimuth_deg) = (f64::from(angle), 7.5 * f64::from(k));
            let v = direction(angle_deg, azimuth_deg);
            let f_per_sr = law(v, v);
            let flags = RetroFlags::empty();
            Reading { angle_deg, azimuth_deg, f_per_sr, sigma_f_per_sr: 0.0, flags }
        })
    };
    let mut readings: Vec<Reading> = (0..24).flat_map(plane).collect();
    readings.retain(|r| r.f_per_sr > 1e-200);
    let run = RetroTable { readings, wavelength_nm: Some(550.0), ..RetroTable::default() };
    let options = NdfOptions { resamplings: 0, zero_deg: Some(0.0), ..NdfOptions::default() };
    extract(&run, &options).unwrap()
}

/// Geometries up to 80° of light and detector, half of them around the mirrored direction.
fn geometries(count: usize) -> Vec<(DVec3, DVec3)> {
    let mut rng = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(5);
    (0..count)
        .map(|k| {
            let (theta, phi) = (rng.random_range(0.0..80.0), rng.random_range(-180.0..180.0));
            let o = if k % 2 == 0 {
                let theta_o = (theta + rng.random_range(-15.0..15.0_f64)).clamp(0.0, 80.0);
                direction(theta_o, phi + 180.0 + rng.random_range(-25.0..25.0))
            } else {
                direction(rng.random_range(0.0..80.0), rng.random_range(-180.0..180.0))
            };
            (direction(theta, phi), o)
        })
        .collect()
}

/// Truth: the closed forms of GGX and Beckmann lobes of 0.1 along and 0.3 across, from retro-reflection by azimuth over a plan (of half the circle, and of a quarter of it, which is then
/// mirrored) to a file. Tolerance: D 1e-3 where it was measured and exceeds 1e-3 of its peak. The file, where f cosθ exceeds 1e-3 of that in the mirrored direction, is no promise but what
/// so coarse a grid leaves (half of all directions 0.1 %, nine in ten 1.2 %, 99 % 8 %): between its azimuths, 22.5° apart, the horizon turns with the light. 17 azimuths, 24 elevations and 41 by 41
/// values, too long for the suite: 0.06 %, 1.3 %, 4 %.
#[test]
fn an_anisotropic_sample_comes_back() {
    type Of = fn(DVec3, DVec3) -> f64;
    for (name, f, d, phi_i, quarter) in [
        ("ggx", of_ggx as Of, ggx as fn(DVec3) -> f64, 9, false),
        ("beckmann", of_beckmann, beckmann, 5, true),
    ] {
        let ndf = density(f);
        let (peak, mut off) = (d(DVec3::Z), 0.0_f64);
        for (p, phi) in ndf.phi_rad.iter().enumerate() {
            for (t, theta) in ndf.theta_rad.iter().enumerate() {
                let truth = d(direction(theta.to_degrees(), phi.to_degrees()));
                let found = ndf.density[p * ndf.theta_rad.len() + t];
                if truth > 1e-3 * peak && theta.to_degrees() < 88.0 {
                    off = off.max((found / truth - 1.0).abs());
                }
            }
        }
        assert!(off < 1e-3, "{name}: {off}");
        let options =
            PlanOptions { phi_i, theta_i: 8, side: 13, quarter, ..PlanOptions::default() };
        let samples = measured(f, &ndf, &options);
        let options =
            AssembleOptions { phi_i: 9, theta_i: 16, side: 25, normals: 128, mirrored: quarter };
        let made = assemble(&samples, &ndf, &options, &Silent).unwrap();
        let beyond = made.coverage.iter().map(|c| c.extrapolated_albedo).sum::<f64>()
            / made.coverage.len() as f64;
        let back = material(name, "memory", &made.file).unwrap();
        let mut errors = Vec::new();
        for (i, o) in geometries(6000) {
            let mirrored = DVec3::new(-i.x, -i.y, i.z);
            if f(i, o) * o.z > 1e-3 * f(i, mirrored) * i.z {
                errors.push((back.brdf(550.0, i, o) / (f(i, o) * spectrum(550.0)) - 1.0).abs());
            }
        }
        errors.sort_by(f64::total_cmp);
        let at = [0.5, 0.9, 0.99, 1.0].map(|p| errors[((errors.len() - 1) as f64 * p) as usize]);
        println!(
            "{name}: D {off:.1e}; {} directions; {at:.5?}; extrapolated {beyond:.3}",
            made.used
        );
        assert!(at[0] < 1e-3 && at[1] < 1.2e-2 && at[2] < 8e-2, "{name}: {at:?}");
        assert!(beyond < 0.3, "{name}: {beyond}");
    }
}
