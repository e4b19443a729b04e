//! Cost of the engine's effects, for `benches/effects.py`: one JSON line for each tolerance.
//!
//! `cargo run --release -p sunglint-simulator --example effects -- SCENE SECONDS [FILE.bsdf]` with SCENE one of `corner_all_orders`, `box_wing_all_orders`,
//! `box_wing_disc`, `bsdf_sphere` and `collimated_box_wing` (what the disc is beside).
#![allow(clippy::unwrap_used, reason = "an example that cannot measure should stop")]

use glam::{DQuat, DVec3};
use std::hint::black_box;
use std::time::Instant;
use sunglint_simulator::light::engine::{Switch, Switches};
use sunglint_simulator::light::{Course, Engine, Globe, Lighting, Options, View};
use sunglint_simulator::scenes::BenchScene;
use sunglint_simulator::target::Target;

const TOLERANCES: [f64; 4] = [1e-2, 2e-3, 1e-3, 1e-4];
/// Directions in turn, this far apart, radians.
const DIRECTIONS: usize = 61;
const TURN_RAD: f64 = 1e-3;
/// The peer's Sun, radians.
const SUN_RAD: f64 = 4.653_0e-3;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let (name, seconds) = (arguments[1].as_str(), arguments[2].parse::<f64>().unwrap());
    let off = Switches::OFF;
    let orders = Switches { inter_reflection: Switch::Auto, ..off };
    let (base, switches) = match name {
        "corner_all_orders" => ("corner", orders),
        "box_wing_all_orders" => ("box_wing_diffuse", orders),
        "box_wing_disc" => ("box_wing", Switches { solar_disc: Switch::On, ..off }),
        "collimated_box_wing" => ("box_wing", off),
        "bsdf_sphere" => ("lambert_sphere", off),
        other => panic!("no scene {other}"),
    };
    let scene = BenchScene::new(base).unwrap();
    let target = match arguments.get(3) {
        Some(file) => Target::parse("sphere.toml", sphere(file)).unwrap(),
        None => scene.target.clone(),
    };
    for tolerance in TOLERANCES {
        measure(
            name,
            &scene,
            &target,
            &Options { tolerance, switches, ..Options::default() },
            seconds,
        );
    }
}

fn sphere(file: &str) -> String {
    format!(
        "[[part]]\nname = \"s\"\nshape = \"sphere\"\nradius_m = 1\nmaterial = \"m\"\n[[material]]\nname = \"m\"\nmodel = \"measured\"\nfile = \"{file}\"\n"
    )
}

fn lighting(sun_body: DVec3, to: DVec3) -> Lighting {
    let earth = Globe {
        toward: -to,
        distance_m: 1e15,
        radius_m: 6.4e6,
        sun: sun_body,
        to_ground: glam::DQuat::IDENTITY,
    };
    Lighting {
        sun_body,
        sun_radius_rad: SUN_RAD,
        earth: Some(earth),
        moon: None,
        shadow: None,
        sunlit: 1.0,
        sunlit_error: 0.0,
        view: View::Distant(to),
    }
}

fn measure(name: &str, scene: &BenchScene, target: &Target, options: &Options, seconds: f64) {
    let course = Course {
        epochs: 1,
        range_m: 1e12,
        earthshine: 0.0,
        phase_rad: scene.sun_body.angle_between(scene.view_body),
        sun_radius_rad: SUN_RAD,
        shadow: false,
        ..Course::default()
    };
    let start = Instant::now();
    let engine = Engine::new(target, options, &course).unwrap();
    let prepare_s = start.elapsed().as_secs_f64();
    // What a spectrum is: at 550 nm of a measured material, in the mean over the bins' range of all others.
    let grey: Vec<f64> = engine
        .terms()
        .iter()
        .map(|t| match name {
            "bsdf_sphere" => t.spectrum.at(550.0),
            _ => (0..940).map(|k| t.spectrum.at(300.5 + f64::from(k))).sum::<f64>() / 940.0,
        })
        .collect();
    let count = engine.terms().len();
    let lit = engine.lit_terms();
    let (mut weights, mut errors) = (vec![0.0; count], vec![0.0; count]);
    let mut worker = engine.worker();
    let mut epoch = |sun: DVec3, to: DVec3| {
        worker.light(&lighting(sun, to), &mut weights, &mut errors).unwrap();
        let sum = |row: &[f64]| row.iter().zip(&grey).map(|(w, g)| w * g).sum::<f64>();
        // Behind the terms that have light stands what is switched off.
        (sum(&weights), sum(&errors[..lit]))
    };
    let (value, stated) = epoch(scene.sun_body, scene.view_body);
    let turned = |k: usize, v: DVec3, s: f64| {
        let axis = DVec3::new((k as f64 + s).sin(), (1.7 * k as f64).cos(), (2.9 * k as f64).sin());
        DQuat::from_axis_angle(axis.normalize(), TURN_RAD) * v
    };
    let directions: Vec<(DVec3, DVec3)> = (0..DIRECTIONS)
        .map(|k| (turned(k, scene.sun_body, 0.0), turned(k, scene.view_body, 1.0)))
        .collect();
    let (start, mut stretches, mut number) = (Instant::now(), Vec::new(), 0);
    while start.elapsed().as_secs_f64() < seconds || stretches.len() < 5 {
        let (stretch, mut epochs) = (Instant::now(), 0);
        while stretch.elapsed().as_secs_f64() < 1e-3 {
            let (sun, to) = directions[number % DIRECTIONS];
            black_box(epoch(black_box(sun), black_box(to)));
            (number, epochs) = (number + 1, epochs + 1);
        }
        stretches.push(stretch.elapsed().as_secs_f64() / f64::from(epochs));
    }
    stretches.sort_by(f64::total_cmp);
    let median = stretches[stretches.len() / 2];
    println!(
        "{{\"scene\": \"{name}\", \"tolerance\": {:e}, \"seconds_per_epoch\": {median:e}, \"value\": {value:.12e}, \"stated\": {stated:.3e}, \"prepare_s\": {prepare_s:.3e}}}",
        options.tolerance
    );
}
