//! Observers at a point.

use super::scenes::*;
use glam::{DVec2, DVec3};
use std::f64::consts::PI;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::light::{Scene, View};
use sunglint_simulator::mesh::shapes::plate;
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};
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

/// f cosθ_i cosθ_o of a GGX lobe with Smith's separable masking (Walter et al. 2007), by hand; the normal is +z.
fn ggx(alpha: f64, i: DVec3, o: DVec3) -> f64 {
    let h = (i + o).normalize();
    let a2 = alpha * alpha;
    let d = a2 / (PI * (h.z * h.z * (a2 - 1.0) + 1.0).powi(2));
    let g = |c: f64| 2.0 / (1.0 + (1.0 + a2 * (1.0 / (c * c) - 1.0)).sqrt());
    0.25 * d * g(i.z) * g(o.z)
}

/// Truth: Simpson's rule over the plate with 129² points and the formula above. Glossy and diffuse plates from 20 m to 40,000 km, at and off the peak, with the light from before, from the side and from
/// behind: at the tolerance of 1e-6 the light is right to that of white paint or its own, and within what is stated; rounding is 1e-12.
#[test]
fn plates_are_integrals_at_any_range() {
    const N: usize = 128;
    let side = DVec2::new(0.7, 0.4);
    let suns = [DVec3::new(0.1, 0.0, 1.0), DVec3::new(0.6, 0.2, 0.8), DVec3::new(-1.0, 0.1, 0.12)];
    let tos = [DVec3::new(-0.1, 0.0, 1.0), DVec3::new(0.5, 0.3, 0.6), DVec3::new(1.0, 0.0, 0.1)];
    let mut few = 0;
    for alpha in [0.02, 0.1, 0.4, f64::INFINITY] {
        let mut one = target([(Shape::Mesh(plate(side, true, false)), DVec3::ZERO)]);
        if alpha.is_finite() {
            let lobe = Lobe::isotropic(Distribution::Ggx, alpha, Masking::Separable).unwrap();
            let all = Fresnel::constant(Spectrum::constant(1.0, 300.0, 1240.0).unwrap()).unwrap();
            one.materials[0] = Material::microfacet("m", lobe, all);
        }
        let scene = Scene::new(&one).unwrap();
        let mut evaluator = scene.evaluator();
        evaluator.set_near_tolerance(1e-6);
        for (sun, to) in suns.iter().flat_map(|s| tos.map(|t| (s.normalize(), t.normalize()))) {
            for range in [20.0, 300.0, 1e4, 1e6, 4e7] {
                let at = range * to;
                let value = |x: f64, y: f64| {
                    let rel = at - DVec3::new(x, y, 0.0);
                    let o = rel.normalize();
                    let f = if alpha.is_finite() { ggx(alpha, sun, o) } else { sun.z * o.z / PI };
                    f * at.length_squared() / rel.length_squared()
                };
                let mut truth = 0.0;
                for (i, j) in (0..=N).flat_map(|i| (0..=N).map(move |j| (i, j))) {
                    let weight = |k: usize| match k {
                        0 | N => 1.0,
                        k => 2.0 + 2.0 * (k % 2) as f64,
                    };
                    let place = |k: usize, side: f64| side * (k as f64 / N as f64 - 0.5);
                    truth += weight(i) * weight(j) * value(place(i, side.x), place(j, side.y));
                }
                truth *= side.x * side.y / (9.0 * (N * N) as f64);
                let mut out = vec![0.0; scene.weight_count()];
                let done = evaluator.direct(sun, View::At(at), &mut out).unwrap();
                let found: f64 = out.iter().sum();
                let off = (found - truth).abs();
                let what = format!("α {alpha}, {sun} {to} {range} m: {found:e} {truth:e}");
                let paint = 1e-4 * side.x * side.y / PI;
                assert!(off <= 1e-6 * truth.max(paint) + 1e-12 * truth, "{what}");
                assert!(off <= done.error * found + 1e-12 * truth, "{what}, stated {}", done.error);
                few += usize::from(done.error < 1e-12);
            }
        }
    }
    assert!(few > 60, "from far away little is stated: {few}");
}
