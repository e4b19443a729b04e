//! Benchmark of the exact direct light on one core: one epoch of the built-in scenes, with and without 188 bins, and of dense bodies.
//!
//! `cargo bench -p sunglint-simulator --bench light`

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run should stop")]

use divan::{Bencher, black_box};
use glam::DVec3;
use sunglint_simulator::light::{Parameter, Scene, View};
use sunglint_simulator::mesh::shapes::{Faceting, icosphere};
use sunglint_simulator::target::{Shape, Target};

fn main() {
    divan::main();
}

fn directions() -> (DVec3, DVec3) {
    (DVec3::new(0.70, 0.60, 0.25).normalize(), DVec3::new(0.6, -0.1, 0.3).normalize())
}

#[divan::bench(args = ["box_wing", "box_wing_diffuse", "corner", "hexagon", "lambert_sphere"])]
fn epoch(bencher: Bencher, name: &str) {
    let target = Target::built_in(name).unwrap();
    let scene = Scene::new(&target).unwrap();
    let (sun, to) = directions();
    let mut eye = scene.evaluator();
    let mut out = vec![0.0; scene.weight_count()];
    bencher.bench_local(|| {
        eye.direct(black_box(sun), View::Distant(black_box(to)), &mut out).unwrap();
        out[0]
    });
}

/// The same with its derivatives by three turns of the body.
#[divan::bench(args = ["box_wing", "box_wing_diffuse", "corner", "hexagon", "lambert_sphere"])]
fn epoch_and_attitude(bencher: Bencher, name: &str) {
    derive(bencher, name, &[DVec3::X, DVec3::Y, DVec3::Z].map(Parameter::Attitude));
}

/// The same with nine: turns, the Sun's and the observer's direction.
#[divan::bench(args = ["box_wing", "box_wing_diffuse", "corner"])]
fn epoch_and_nine(bencher: Bencher, name: &str) {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let all =
        [axes.map(Parameter::Attitude), axes.map(Parameter::Sun), axes.map(Parameter::Observer)];
    derive(bencher, name, all.as_flattened());
}

fn derive(bencher: Bencher, name: &str, parameters: &[Parameter]) {
    let target = Target::built_in(name).unwrap();
    let scene = Scene::new(&target).unwrap();
    let (sun, to) = directions();
    let mut eye = scene.evaluator();
    let (mut w, mut dw) =
        (vec![0.0; scene.weight_count()], vec![0.0; parameters.len() * scene.weight_count()]);
    bencher.bench_local(|| {
        let view = View::Distant(black_box(to));
        eye.direct_derivatives(black_box(sun), view, parameters, &mut w, &mut dw).unwrap();
        dw[0]
    });
}

#[divan::bench(args = ["box_wing", "corner"])]
fn epoch_188_bins(bencher: Bencher, name: &str) {
    let target = Target::built_in(name).unwrap();
    let scene = Scene::new(&target).unwrap();
    let (sun, to) = directions();
    let mut eye = scene.evaluator();
    let mut out = vec![0.0; scene.weight_count()];
    let spectra: Vec<Vec<f64>> = scene
        .spectra()
        .map(|s| (0..188).map(|k| s.at(302.5 + 5.0 * f64::from(k))).collect())
        .collect();
    let mut bins = vec![0.0; 188];
    bencher.bench_local(|| {
        eye.direct(black_box(sun), View::Distant(black_box(to)), &mut out).unwrap();
        bins.fill(0.0);
        for (w, spectrum) in out.iter().zip(&spectra) {
            bins.iter_mut().zip(spectrum).for_each(|(b, s)| *b += w * s);
        }
        bins[0]
    });
}

#[divan::bench]
fn sphere_of_81920_facets(bencher: Bencher) {
    let mut target = Target::built_in("lambert_sphere").unwrap();
    target.parts[0].shape = Shape::Mesh(icosphere(1.0, 6, Faceting::SameArea));
    let scene = Scene::new(&target).unwrap();
    let (sun, to) = directions();
    let mut eye = scene.evaluator();
    let mut out = vec![0.0; scene.weight_count()];
    bencher.bench_local(|| eye.direct(black_box(sun), View::Distant(to), &mut out).unwrap());
}
