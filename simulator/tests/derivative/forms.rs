//! Closed forms.

use super::bodies::*;
use glam::{DQuat, DVec2, DVec3};
use std::f64::consts::{FRAC_1_PI, PI};
use sunglint_simulator::light::{Method, Parameter, Roughness, Scene, View};
use sunglint_simulator::surface::{Distribution, Masking};
use sunglint_simulator::target::{Placement, Target};

/// Truth: W = A/π (n·s)(n·e) with n turning as axis × n, of a leaning plate of 2 m². Rounding.
#[test]
fn tilted_plate() {
    for seed in 0..200 {
        let mut rng = rng(seed);
        let (sun, to) = directions(&mut rng);
        let rotation = DQuat::from_rotation_arc(DVec3::Z, direction(&mut rng));
        let n = rotation * DVec3::Z;
        let mut target = Target::default();
        let placement = Placement { rotation, offset_m: direction(&mut rng) };
        add(&mut target, sheet(DVec2::new(2.0, 1.0)), placement, white());
        let scene = Scene::new(&target).unwrap();
        let (_, dw, _, done) = derive(&scene, sun, View::Distant(to), &all());
        assert_eq!(done.method, Method::Forward);
        let (ci, co) = (n.dot(sun), n.dot(to));
        let seen = ci > 0.0 && co > 0.0;
        let k = if seen { 2.0 * FRAC_1_PI } else { 0.0 };
        let across = |d: DVec3, v: DVec3| v - v.dot(d) * d;
        for (j, axis) in AXES.into_iter().enumerate() {
            let m = axis.cross(n);
            let turn = k * (m.dot(sun) * co + ci * m.dot(to));
            let by_sun = k * n.dot(across(sun, axis)) * co;
            let by_view = k * ci * n.dot(across(to, axis));
            for (found, truth) in [(dw[j], turn), (dw[3 + j], by_sun), (dw[6 + j], by_view)] {
                assert!((found - truth).abs() < 1e-14, "{seed} {j}: {found} for {truth}");
            }
        }
    }
}

/// Truth: the shadow of a straight edge at height H over a plate of 1 m², the Sun at angle a from the plate's normal: what is lit begins
/// at x = X − H tan a, so W = (½ − X + H tan a) cos a cosθ_o/π, and dW/da by hand; the same with Sun and observer exchanged. Rounding.
#[test]
fn plate_half_shaded_by_an_edge() {
    for (height, edge, a) in
        [(1.0, 0.1, 0.2), (0.3, -0.2, -0.6), (2.0, 0.4, 0.25), (0.01, 0.0, 1.0)]
    {
        let mut target = Target::default();
        add(&mut target, sheet(DVec2::ONE), at(DVec3::ZERO), white());
        add(
            &mut target,
            sheet(DVec2::new(8.0, 8.0)),
            at(DVec3::new(edge - 4.0, 0.0, height)),
            white(),
        );
        let scene = Scene::new(&target).unwrap();
        // The other direction looks below the edge from farther on.
        let b = a + 0.3;
        let near = DVec3::new(f64::sin(a), 0.0, f64::cos(a));
        let far = DVec3::new(f64::sin(b), 0.1, f64::cos(b)).normalize();
        let lit = 0.5 - edge + height * a.tan();
        assert!(0.0 < lit && lit < 1.0);
        let truth = (height / a.cos() - lit * a.sin()) * far.z * FRAC_1_PI;
        let along = DVec3::new(a.cos(), 0.0, -a.sin());
        for (sun, to, parameter) in
            [(near, far, Parameter::Sun(along)), (far, near, Parameter::Observer(along))]
        {
            let (w, dw, errors, done) = derive(&scene, sun, View::Distant(to), &[parameter]);
            assert!((w[0] - lit * a.cos() * far.z * FRAC_1_PI).abs() < 1e-14);
            assert!((dw[0] - truth).abs() < 1e-12 * (1.0 + height), "{} for {truth}", dw[0]);
            assert!(errors[0] < 1e-11 && done.edges > 0);
        }
    }
}

/// Truth: dW/dγ = −2/(3π) (π − γ) sin γ of a white sphere of 1 m (from Russell 1916). Rounding of the angle.
#[test]
fn white_sphere() {
    let target = Target::built_in("lambert_sphere").unwrap();
    let scene = Scene::new(&target).unwrap();
    for phase in [1e-3, 0.3, 1.0, 2.0, 3.0] {
        let to = DVec3::new(f64::cos(phase), f64::sin(phase), 0.0);
        let along = DVec3::new(-to.y, to.x, 0.0);
        let parameters = [Parameter::Observer(along), Parameter::Attitude(DVec3::Z)];
        let (_, dw, ..) = derive(&scene, DVec3::X, View::Distant(to), &parameters);
        let truth = -2.0 / (3.0 * PI) * (PI - phase) * phase.sin();
        assert!((dw[0] - truth).abs() < 1e-12, "{} for {truth}", dw[0]);
        assert!(dw[1].abs() < 1e-12, "a sphere may turn: {}", dw[1]);
    }
}

/// Truth: a GGX plate seen and lit square has D = 1/(π α_x α_y), G = 1: W = A/(4π α_x α_y), and its derivatives by hand. Rounding.
#[test]
fn rough_plate_square() {
    let (x, y) = (0.2, 0.35);
    for masking in [Masking::Separable, Masking::HeightCorrelated] {
        for distribution in [Distribution::Ggx, Distribution::Beckmann] {
            let mut target = Target::default();
            let material = rough(distribution, x, y, masking, grey());
            add(&mut target, sheet(DVec2::ONE), at(DVec3::ZERO), material);
            let scene = Scene::new(&target).unwrap();
            let parameters = [Roughness::Along, Roughness::Across, Roughness::Alpha]
                .map(|of| Parameter::Roughness { material: 0, of });
            let (w, dw, ..) = derive(&scene, DVec3::Z, View::Distant(DVec3::Z), &parameters);
            let truth = 0.25 * FRAC_1_PI / (x * y);
            let rates = [-truth / x, -truth / y, -truth / x - truth / y];
            assert!((w[0] - truth).abs() < 1e-14);
            for (found, rate) in dw.iter().zip(rates) {
                assert!((found - rate).abs() < 1e-12, "{found} for {rate}");
            }
        }
    }
}

/// Truth: of a small plate at range r straight above it, W/|view|² = A/(π r²) to (size/r)²; so W does not change with the range, and with
/// a shift aside only in second order. Differences, 1e-6 of W per unit, and the error says so.
#[test]
fn observer_at_a_point() {
    let mut target = Target::default();
    add(&mut target, sheet(DVec2::splat(1e-3)), at(DVec3::ZERO), white());
    let scene = Scene::new(&target).unwrap();
    let parameters = [
        Parameter::Observer(DVec3::Z),
        Parameter::Observer(DVec3::X),
        Parameter::Attitude(DVec3::Y),
    ];
    let sun = DVec3::new(0.6, 0.0, 0.8);
    let (w, dw, errors, done) = derive(&scene, sun, View::At(50.0 * DVec3::Z), &parameters);
    assert_eq!(done.method, Method::Differences);
    // Turned about y by φ: cos(θ_i − φ) cos φ, the Sun at θ_i.
    let truth = [0.0, 0.0, 0.6 / 0.8 * w[0]];
    for ((found, truth), error) in dw.iter().zip(truth).zip(&errors) {
        assert!((found - truth).abs() < 1e-6 * w[0], "{found} for {truth}, W {}", w[0]);
        assert!((found - truth).abs() < error + 1e-9 * w[0], "{found} for {truth} ± {error}");
    }
}
