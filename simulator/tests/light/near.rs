//! Observers at a point.

use super::scenes::*;
use glam::{DVec2, DVec3};
use sunglint_simulator::light::{Scene, View};
use sunglint_simulator::mesh::shapes::plate;
use sunglint_simulator::target::Shape;

/// Truth: rays to a point, 4 σ: random and concave bodies, from 3 m, and from within the ball about them (0.9 m) where the point lies
/// in no body.
#[test]
fn points_by_rays() {
    for seed in [0, 1, 2, 4, 5, 6] {
        let (sun, to) = directions(&mut rng(70_000 + seed));
        agree_with_rays(&scene(seed), sun, View::At(3.0 * to), 60_000, 4e-3, seed);
    }
    // Between the body and its small neighbours.
    let one = dense(20, 5);
    for seed in 0..4 {
        let (sun, to) = directions(&mut rng(80_000 + seed));
        let q = 2.2 * to;
        agree_with_rays(&one, sun, View::At(q), 40_000, 2e-2, seed);
    }
}

/// Truth: by hand. A sheet halfway between the eye and a plate hides four times its area; the eye looks at the plate's middle from 1 km,
/// so that the rest differs from its area by 1e-6.
#[test]
fn what_stands_between_hides_by_perspective() {
    let sheet = |size| Shape::Mesh(plate(DVec2::splat(size), true, true));
    let both = target([(sheet(2.0), DVec3::ZERO), (sheet(0.5), DVec3::Z * 500.0)]);
    let sun = DVec3::new(0.0, 0.6, 0.8);
    let w = weights(&both, sun, View::At(DVec3::Z * 1000.0));
    let expected = 3.0 * 0.8 / std::f64::consts::PI;
    assert!((w[0] / expected - 1.0).abs() < 2e-6, "{w:?}");
    // Behind the eye it hides nothing.
    let both = target([(sheet(2.0), DVec3::ZERO), (sheet(0.5), DVec3::Z * 1500.0)]);
    let w = weights(&both, sun, View::At(DVec3::Z * 1000.0));
    assert!((w[0] / (expected * 4.0 / 3.0) - 1.0).abs() < 2e-6, "{w:?}");
}

/// Truth: the distant view, to which random scenes and spheres converge: from range r the difference is at most c/r with one c.
#[test]
fn points_far_away_are_distant() {
    for seed in 0..8 {
        let mut one = scene(seed);
        if seed % 4 == 0 {
            add(&mut one, Shape::Sphere { radius_m: 0.4 }, Default::default());
        }
        let (sun, to) = directions(&mut rng(90_000 + seed));
        let scene = Scene::new(&one).unwrap();
        let far: f64 = evaluate(&scene, sun, View::Distant(to)).0.iter().sum();
        for range in [1e2, 1e3, 1e4, 1e5] {
            let near: f64 = evaluate(&scene, sun, View::At(range * to)).0.iter().sum();
            let off = (near - far).abs() / most(&one);
            assert!(off < 3.0 / range, "{seed} {range}: {off:.1e}");
        }
    }
}
