//! Curved surfaces against closed forms and against rays at implicit surfaces.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod alone;
mod bent;
mod rays;
mod shaded;

use glam::{DQuat, DVec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::light::{Direct, Scene, View};
use sunglint_simulator::surface::Material;
use sunglint_simulator::target::{Curved, DishForm, Part, Placement, Shape, Target};

type Rng = Xoshiro256PlusPlus;

fn rng(seed: u64) -> Rng {
    Rng::seed_from_u64(seed)
}

fn direction(rng: &mut Rng) -> DVec3 {
    loop {
        let v = DVec3::new(rng.random(), rng.random(), rng.random()) * 2.0 - 1.0;
        if (0.01..1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    }
}

fn turn(rng: &mut Rng) -> DQuat {
    DQuat::from_axis_angle(direction(rng), rng.random::<f64>() * 6.0)
}

fn white(name: &str) -> Material {
    Material::lambert(name, Spectrum::constant(1.0, 300.0, 1240.0).unwrap()).unwrap()
}

/// White Lambert parts, each with a material of its own.
fn target(parts: Vec<(Shape, DQuat, DVec3)>) -> Target {
    let mut target = Target::default();
    for (k, (shape, rotation, offset_m)) in parts.into_iter().enumerate() {
        target.materials.push(white(&format!("m{k}")));
        target.parts.push(Part {
            name: format!("p{k}"),
            shape,
            material: k,
            placement: Placement { rotation, offset_m },
            hinge: None,
            tangent: DVec3::X,
        });
    }
    target
}

fn one(shape: Shape) -> Target {
    target(vec![(shape, DQuat::IDENTITY, DVec3::ZERO)])
}

fn frustum(bottom_radius_m: f64, top_radius_m: f64, height_m: f64) -> Shape {
    Shape::Curved(Curved::Frustum { bottom_radius_m, top_radius_m, height_m })
}

fn dish(radius_m: f64, depth_m: f64, form: DishForm, inside: bool, outside: bool) -> Shape {
    Shape::Curved(Curved::Dish { radius_m, depth_m, form, inside, outside })
}

fn evaluate(target: &Target, sun: DVec3, view: View, tolerance: f64) -> (Vec<f64>, Direct) {
    let scene = Scene::new(target).unwrap();
    let mut out = vec![0.0; scene.weight_count()];
    let mut evaluator = scene.evaluator();
    evaluator.set_curved_tolerance(tolerance);
    let done = evaluator.direct(sun, view, &mut out).unwrap();
    (out, done)
}

/// Asserts that a sum is as near to the truth as it claims to be, and as `most`; gives the error.
fn close(what: &str, (out, done): &(Vec<f64>, Direct), truth: f64, most: f64) -> f64 {
    let sum: f64 = out.iter().sum();
    let (off, claim) = ((sum - truth).abs(), done.error * sum + 1e-14 * truth);
    assert!(off <= claim, "{what}: {sum}, truth {truth}: off by {off:.1e}, claimed {claim:.1e}");
    assert!(off <= most, "{what}: {sum}, truth {truth}: off by {off:.1e}, expected {most:.1e}");
    off
}
