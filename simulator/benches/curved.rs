//! Benchmark of curved surfaces on one core: alone, and behind a straight edge at several tolerances.
//!
//! `cargo bench -p sunglint-simulator --bench curved`

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run should stop")]

use divan::{Bencher, black_box};
use glam::DVec3;
use sunglint_simulator::light::{Scene, View};
use sunglint_simulator::target::Target;

fn main() {
    divan::main();
}

const SHAPES: [&str; 4] = ["sphere", "cylinder", "cone", "dish"];
const TOLERANCES: [f64; 3] = [1e-2, 1e-3, 1e-4];

fn scene(shape: &str, material: &str, edge: bool) -> Scene {
    let size = match shape {
        "sphere" => "radius_m = 1",
        "dish" => "radius_m = 1\ndepth_m = 0.4",
        _ => "radius_m = 0.5\nheight_m = 2",
    };
    let mut text = format!(
        "[[part]]\nname = \"it\"\nshape = \"{shape}\"\n{size}\nmaterial = \"{material}\"\n"
    );
    if edge {
        text += "[[part]]\nname = \"edge\"\nshape = \"plate\"\nsize_m = [10, 10]\nmaterial = \"white\"\n";
        text += "offset_m = [-4.9, 0, 4]\n";
    }
    let rough = "[[material]]\nname = \"rough\"\nmodel = \"microfacet\"\ndistribution = \"ggx\"\nalpha = 0.2\nreflectance = 0.9\n";
    if material == "rough" {
        text += rough;
    }
    Scene::new(&Target::parse("bench.toml", text).unwrap()).unwrap()
}

fn run(bencher: Bencher, scene: &Scene, tolerance: f64) {
    let (sun, to) = (DVec3::new(0.3, 0.2, 1.0).normalize(), DVec3::new(0.4, -0.3, 1.0).normalize());
    let mut eye = scene.evaluator();
    eye.set_curved_tolerance(tolerance);
    let mut out = vec![0.0; scene.weight_count()];
    bencher.bench_local(|| {
        eye.direct(black_box(sun), View::Distant(black_box(to)), &mut out).unwrap().error
    });
}

#[divan::bench(args = SHAPES)]
fn alone(bencher: Bencher, shape: &str) {
    run(bencher, &scene(shape, "white", false), 1e-4);
}

#[divan::bench(args = SHAPES)]
fn alone_rough(bencher: Bencher, shape: &str) {
    run(bencher, &scene(shape, "rough", false), 1e-4);
}

#[divan::bench(args = TOLERANCES)]
fn sphere_behind_an_edge(bencher: Bencher, tolerance: f64) {
    run(bencher, &scene("sphere", "white", true), tolerance);
}

#[divan::bench(args = TOLERANCES)]
fn cylinder_behind_an_edge(bencher: Bencher, tolerance: f64) {
    run(bencher, &scene("cylinder", "white", true), tolerance);
}

#[divan::bench(args = TOLERANCES)]
fn dish_behind_an_edge(bencher: Bencher, tolerance: f64) {
    run(bencher, &scene("dish", "white", true), tolerance);
}
