//! Plans of few measurements against the usual plan, on the virtual goniometer: stated doubts and true errors of the assembled materials.
//!
//! Truth: the virtual sample's closed form (Walter et al. 2007, eqs. 33, 34; Ashikhmin, Premože and Shirley 2000), of which the NDF knows retro-reflection alone; what values are compared with is masked
//! otherwise. Noise, drift and zeros are the virtual goniometer's.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::goniometer::whole;
use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::TAU;
use sunglint_formats::toml::Document;
use sunglint_materials::assemble::{AssembleOptions, Assembled, assemble};
use sunglint_materials::goniometer::bench::Bench;
use sunglint_materials::goniometer::budget::{Budget, within_budget};
use sunglint_materials::ndf::{Ndf, NdfOptions, extract};
use sunglint_materials::plan::{Plan, PlanOptions, Planned, plan};
use sunglint_materials::samples::{Samples, direction};
use sunglint_materials::table::{Reading, RetroFlags, RetroTable};
use sunglint_numerics::progress::Silent;
use sunglint_simulator::surface::measured::material;
use sunglint_testkit::Campaign;
use sunglint_virtual::goniometer::light::Bench as Light;
use sunglint_virtual::goniometer::options::Options;

/// The roughnesses of bare metal: the first three were looked at while the choice was made.
const ALPHAS: [f64; 10] = [0.07, 0.15, 0.3, 0.05, 0.1, 0.2, 0.4, 0.06, 0.12, 0.35];

fn bench() -> Bench {
    let text = "virtual = \"goniometer.toml\"\n[axis.azimuth]\n";
    Bench::new(&Document::new("bench.toml", text).unwrap(), Some("")).unwrap()
}

fn metal(alpha: f64, seed: u64) -> Options {
    let mut options = Options { seed, ..Options::default() };
    (options.sample.alpha, options.sample.reflectance) = (alpha, 0.8);
    // A per cent for each direction, of five readings.
    (options.lamp.noise, options.lamp.drift_per_h) = (0.022, 0.01);
    (options.zero.sample_deg, options.zero.detector_deg) = (0.05, -0.03);
    // One ray instead of 121: each of 15,000 readings takes a hundredth of the time.
    (options.beam.spread_in_deg, options.beam.spread_out_deg) = (0.0, 0.0);
    options
}

/// A normal distribution's value (Box and Muller).
fn normal(rng: &mut Xoshiro256PlusPlus) -> f64 {
    let (u, v): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (TAU * v).cos()
}

/// The NDF of retro-reflection every half degree to 70°, each value of ten readings.
fn density(light: &Light, seed: u64) -> Ndf {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(1000 + seed);
    let reading = |k: i32| {
        let angle_deg = 0.5 * f64::from(k);
        let v = direction(angle_deg.abs(), 0.0);
        let noise = 1.0 + 0.003 * normal(&mut rng);
        let f_per_sr = light.radiance(v, v) / v.z * noise;
        let flags = RetroFlags::empty();
        Reading { angle_deg, azimuth_deg: 0.0, f_per_sr, sigma_f_per_sr: 0.0, flags }
    };
    let readings = (-20..=140).map(reading).collect();
    let run = RetroTable { readings, wavelength_nm: Some(632.8), ..RetroTable::default() };
    let options = NdfOptions { resamplings: 0, ..NdfOptions::default() };
    extract(&run, &options).unwrap()
}

/// Pairs of directions up to 80°: half of the normals as the lobe has them, half of the directions anywhere where f cosθ exceeds a thousandth of that in the mirrored direction.
fn pairs(light: &Light, alpha: f64, count: usize) -> Vec<(DVec3, DVec3)> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(77);
    let least = 80_f64.to_radians().cos();
    let mut found = Vec::new();
    while found.len() < count {
        let any = |rng: &mut Xoshiro256PlusPlus| {
            let z: f64 = rng.random_range(least..1.0);
            let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
            let across = (1.0 - z * z).sqrt();
            DVec3::new(across * cos, across * sin, z)
        };
        let i = any(&mut rng);
        let o = if found.len() % 2 == 0 {
            let v: f64 = rng.random();
            let slope = alpha * (v / (1.0 - v)).sqrt();
            let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
            let h = DVec3::new(slope * cos, slope * sin, 1.0).normalize();
            2.0 * i.dot(h) * h - i
        } else {
            any(&mut rng)
        };
        let mirrored = DVec3::new(-i.x, -i.y, i.z);
        if o.z > least && light.radiance(i, o) > 1e-3 * light.radiance(i, mirrored) {
            found.push((i, o));
        }
    }
    found
}

fn quantile(values: &mut [f64], part: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * part) as usize]
}

/// Doubts and errors of a material.
#[derive(Debug, Clone, Copy)]
struct Judged {
    measured: usize,
    /// Half and nine tenths of the stated doubts up to 80° are below, ln f.
    doubt: [f64; 2],
    /// Error of ln f at pairs of directions, rms, and what 95 % of them are below.
    error: [f64; 2],
    /// The part of the stated doubts that holds the error.
    held: f64,
}

fn judged(light: &Light, alpha: f64, samples: &Samples, made: &Assembled) -> Judged {
    let back = material("metal", "memory", &made.file).unwrap();
    let off = |i: DVec3, o: DVec3| (back.brdf(632.8, i, o) * o.z / light.radiance(i, o)).ln().abs();
    let mut error: Vec<f64> = pairs(light, alpha, 3000).iter().map(|(i, o)| off(*i, *o)).collect();
    let rms = (error.iter().map(|e| e * e).sum::<f64>() / error.len() as f64).sqrt();
    let (mut doubts, mut held) = (Vec::new(), 0);
    for d in made.doubts.iter().filter(|d| d.theta_i_deg <= 80.0 && d.theta_o_deg <= 80.0) {
        let (i, o) = (direction(d.theta_i_deg, d.phi_i_deg), direction(d.theta_o_deg, d.phi_o_deg));
        let mirrored = DVec3::new(-i.x, -i.y, i.z);
        if light.radiance(i, o) > 1e-3 * light.radiance(i, mirrored) {
            doubts.push(d.ln_doubt);
            held += usize::from(off(i, o) <= d.ln_doubt);
        }
    }
    let held = held as f64 / doubts.len() as f64;
    Judged {
        measured: samples.rows.len(),
        doubt: [0.5, 0.9].map(|p| quantile(&mut doubts, p)),
        error: [rms, quantile(&mut error, 0.95)],
        held,
    }
}

/// A material by a run on the virtual goniometer.
fn run(options: &Options, ndf: &Ndf, planned: &[Planned]) -> (Samples, Assembled) {
    let (_, _, found) = whole(&bench(), options, planned);
    let size = AssembleOptions { theta_i: 40, side: 65, normals: 96, ..AssembleOptions::default() };
    let made = assemble(&found.samples, ndf, &size, &Silent).unwrap();
    (found.samples, made)
}

fn chosen(ndf: &Ndf, count: usize) -> Plan {
    let pool = plan(ndf, &PlanOptions::to_choose_from(85.0)).unwrap();
    within_budget(&pool, ndf, &bench(), Budget::Directions(count), &Silent).unwrap()
}

/// Both sides of the plane of incidence, and all azimuths under light along the normal: as isotropic samples were measured before.
fn both_sides(made: &Plan) -> Vec<Planned> {
    let mut all: Vec<Planned> = Vec::new();
    let mut seen = std::collections::HashSet::new();
    for cell in made.cells.iter().filter(|c| c.step.is_some()) {
        let theta = made.theta_i_rad[cell.index[1]];
        let o = cell.outgoing;
        let key = |v: f64| (v * 1e5).round() as i64;
        if !seen.insert((cell.index[1], key(o.x), key(o.y))) {
            continue;
        }
        all.push(Planned {
            step: all.len() + 1,
            theta_i_deg: theta.to_degrees(),
            phi_i_deg: 0.0,
            theta_o_deg: o.truncate().length().atan2(o.z).to_degrees(),
            phi_o_deg: o.y.atan2(o.x).to_degrees(),
        });
    }
    all
}

/// Bare metal of ten roughnesses, two seeds each. Promises: 200 measurements that were chosen have at most three times the stated doubt of the 2,400 of the usual plan that the bench reaches (noise alone would give
/// 3.5), and from α = 0.1 on at most three times the true error; of narrower lobes in the middle of the cases (at most six times was found). Their doubt holds the error in 95 % of the directions over all.
#[test]
fn campaign_budget() {
    const COLUMNS: [&str; 14] = [
        "alpha",
        "usual",
        "usual_doubt",
        "usual_doubt_90",
        "usual_error",
        "usual_error_95",
        "usual_held",
        "few",
        "few_doubt",
        "few_doubt_90",
        "few_error",
        "few_error_95",
        "few_held",
        "cpu_s",
    ];
    let mut campaign = Campaign::in_shards("budget", 20, 1, &COLUMNS);
    for seed in campaign.seeds() {
        let begun = sunglint_testkit::cpu_s();
        let alpha = ALPHAS[(seed % 10) as usize];
        let options = metal(alpha, 100 + seed);
        let light = Light::new(options.clone()).unwrap();
        let ndf = density(&light, seed);
        let judge = |planned: &[Planned]| {
            let (samples, made) = run(&options, &ndf, planned);
            judged(&light, alpha, &samples, &made)
        };
        let usual = judge(&plan(&ndf, &PlanOptions::default()).unwrap().planned());
        let few = judge(&chosen(&ndf, 200).planned());
        eprintln!("{alpha}: {usual:.4?}\n      {few:.4?}");
        let row = |j: &Judged| {
            [j.measured as f64, j.doubt[0], j.doubt[1], j.error[0], j.error[1], j.held]
        };
        let cpu_s = sunglint_testkit::cpu_s() - begun;
        let rows = [&[alpha][..], &row(&usual), &row(&few), &[cpu_s]].concat();
        campaign.keep(seed, &rows);
    }
    let column = |name: &str| campaign.column(name);
    let ratios = |name: &str| -> Vec<f64> {
        let (few, usual) = (column(&format!("few_{name}")), column(&format!("usual_{name}")));
        few.iter().zip(&usual).map(|(few, usual)| few / usual).collect()
    };
    let most = |ratios: &[f64]| ratios.iter().copied().fold(0.0, f64::max);
    let names = ["doubt", "doubt_90", "error", "error_95"];
    let [doubt, doubt_90, error, error_95] = names.map(|name| most(&ratios(name)));
    let of_alpha: Vec<(f64, f64)> = column("alpha").into_iter().zip(ratios("error")).collect();
    let held = column("few_held");
    let held = held.iter().sum::<f64>() / held.len() as f64;
    eprintln!(
        "at most: doubt {doubt:.2} {doubt_90:.2}, error {error:.2} {error_95:.2}; held {held:.3}"
    );
    assert!(column("few").iter().all(|n| *n == 200.0));
    let least = if campaign.is_whole() { 0.95 } else { 0.9 };
    campaign.largest("doubt_over_usual", doubt);
    campaign.largest("doubt_90_over_usual", doubt_90);
    campaign.largest("error_over_usual", error);
    campaign.largest("error_95_over_usual", error_95);
    campaign.finish();
    assert!(doubt <= 3.0 && doubt_90 <= 3.0, "{doubt} {doubt_90}");
    let (mut narrow, mut wide) = (Vec::new(), Vec::new());
    for (alpha, ratio) in of_alpha {
        if alpha < 0.1 { narrow.push(ratio) } else { wide.push(ratio) }
    }
    assert!(most(&wide) <= 3.0 && quantile(&mut narrow, 0.5) <= 3.0, "{wide:?} {narrow:?}");
    assert!(held >= least, "{held}");
}

/// An isotropic sample on one side of the plane of incidence. Promises: at most 55 % of the directions of both sides, at a stated doubt that is at most 5 % larger and a true error at most 25 % (half of the noise's squares would be 41 %).
#[test]
fn one_side_says_what_both_say() {
    let options = metal(0.15, 7);
    let light = Light::new(options.clone()).unwrap();
    let ndf = density(&light, 7);
    let size = PlanOptions { theta_i: 6, side: 16, ..PlanOptions::default() };
    let one = plan(&ndf, &size).unwrap();
    let both = both_sides(&one);
    let judge = |planned: &[Planned]| {
        let (samples, made) = run(&options, &ndf, planned);
        judged(&light, 0.15, &samples, &made)
    };
    let (few, many) = (judge(&one.planned()), judge(&both));
    eprintln!("{few:.4?}\n{many:.4?}");
    assert!(few.measured as f64 <= 0.55 * many.measured as f64, "{few:?} {many:?}");
    assert!(few.doubt[0] <= 1.05 * many.doubt[0], "{few:?} {many:?}");
    assert!(few.error[0] <= 1.25 * many.error[0], "{few:?} {many:?}");
}
