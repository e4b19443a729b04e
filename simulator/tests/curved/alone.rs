//! Cylinders, cones and dishes alone: closed forms.

use super::*;
use glam::DVec2;
use std::f64::consts::{FRAC_PI_2, PI};
use sunglint_simulator::light::SceneError;
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking};

fn at_phase(phase: f64) -> DVec3 {
    DVec3::new(phase.cos(), phase.sin(), 0.0)
}

/// Truth: ∫ cos a cos(a − γ) da over what is lit and seen, R L/(2π) (sin γ + (π − γ) cos γ) for a white Lambert cylinder with Sun and observer
/// square to its axis. 1e-12: a trigonometric polynomial, for which the quadrature is exact to rounding.
#[test]
fn a_lambert_cylinder_broadside() {
    let cylinder = one(frustum(0.7, 0.7, 3.0));
    for phase_deg in [0.0, 1.0, 30.0, 90.0, 150.0, 179.0_f64] {
        let phase = phase_deg.to_radians();
        let found = evaluate(&cylinder, DVec3::X, View::Distant(at_phase(phase)), 1e-4);
        let truth = 0.7 * 3.0 / (2.0 * PI) * (phase.sin() + (PI - phase) * phase.cos());
        close(&format!("{phase_deg}°"), &found, truth, 1e-12 * truth + 1e-15);
    }
}

/// Truth: Sun and observer on the axis: the wall of a cone sends cos²/π times its area (all of it has one angle), an end 1/π of its own.
/// A frustum seen from its wide end shows nothing but that end. 1e-12.
#[test]
fn cones_along_their_axis() {
    let (low, high, height) = (1.2, 0.3, 2.0_f64);
    let cone = one(frustum(low, high, height));
    let slant = height.hypot(low - high);
    let wall = PI * (low + high) * slant * ((low - high) / slant).powi(2);
    let above = evaluate(&cone, DVec3::Z, View::Distant(DVec3::Z), 1e-4);
    close("above", &above, (wall + PI * high * high) / PI, 1e-12);
    let below = evaluate(&cone, -DVec3::Z, View::Distant(-DVec3::Z), 1e-4);
    close("below", &below, low * low, 1e-12);
}

/// Truth: a microfacet cylinder in opposition, square to its axis: R L ∫ D(a) G₁(a)² F/(4 cos² a) cos² a da by Simpson's rule with 200,000 steps from
/// the formulas of Walter et al. (2007) and Heitz (2014). 1e-8 of the value. The narrowest lobe is 6e-3 wide.
#[test]
fn a_beckmann_cylinder_in_opposition() {
    for alpha in [0.6, 0.2, 0.05, 0.006] {
        let lobe = Lobe::isotropic(Distribution::Beckmann, alpha, Masking::Separable).unwrap();
        let fresnel = Fresnel::constant(Spectrum::constant(1.0, 300.0, 1240.0).unwrap()).unwrap();
        let mut cylinder = one(frustum(1.0, 1.0, 2.0));
        cylinder.materials[0] = Material::microfacet("paint", lobe, fresnel);
        let erf = |x: f64| {
            // ∫ by Simpson; far out it is 1.
            let x = x.min(6.5);
            let h = x / 400.0;
            let f = |k: usize| (-(h * k as f64).powi(2)).exp();
            let sum: f64 = (1..400).map(|k| f(k) * if k % 2 == 1 { 4.0 } else { 2.0 }).sum();
            2.0 / PI.sqrt() * h / 3.0 * (f(0) + f(400) + sum)
        };
        let value = |a: f64| {
            let tan = a.tan();
            let d = (-(tan / alpha).powi(2)).exp() / (PI * alpha * alpha * a.cos().powi(4));
            if d < 1e-30 {
                return 0.0;
            }
            let x = 1.0 / (alpha * tan.abs().max(1e-12));
            let lambda = 0.5 * (erf(x) - 1.0) + (-x * x).exp() / (2.0 * x * PI.sqrt());
            d / (1.0 + lambda).powi(2) / 4.0
        };
        let (n, half) = (20_000, (8.0 * alpha).min(FRAC_PI_2 - 1e-9));
        let step = 2.0 * half / n as f64;
        let sum: f64 = (0..=n)
            .map(|k| {
                let weight = if k == 0 || k == n { 1.0 } else { [2.0, 4.0][k % 2] };
                weight * value(-half + step * k as f64)
            })
            .sum();
        let truth = 2.0 * sum * step / 3.0;
        let found = evaluate(&cylinder, DVec3::X, View::Distant(DVec3::X), 1e-4);
        let off = close(&format!("alpha {alpha}"), &found, truth, 1e-8 * truth);
        eprintln!("Beckmann cylinder, alpha {alpha}: {:.1e}", off / truth);
    }
}

/// Truth: a dish of focal length f with Sun and observer on its axis: ∫ 2 r/√(1 + r²/4f²) dr = 8 f² (√(1 + R²/4f²) − 1); the inside lit and
/// seen through the mouth, or the outside from behind. A spherical bowl: 2 (R³ − (R − d)³)/(3 R). 1e-9.
#[test]
fn dishes_along_their_axis() {
    let (radius, depth) = (1.5, 0.4_f64);
    let f = radius * radius / (4.0 * depth);
    let paraboloid = 8.0 * f * f * ((1.0 + (radius / (2.0 * f)).powi(2)).sqrt() - 1.0);
    let ball = 0.5 * (radius * radius / depth + depth);
    let cap = 2.0 / 3.0 * (ball.powi(3) - (ball - depth).powi(3)) / ball;
    for (form, truth) in [(DishForm::Paraboloid, paraboloid), (DishForm::Sphere, cap)] {
        let bowl = one(dish(radius, depth, form, true, true));
        for axis in [DVec3::Z, -DVec3::Z] {
            let found = evaluate(&bowl, axis, View::Distant(axis), 1e-4);
            close(&format!("{form:?} {axis}"), &found, truth, 1e-9);
        }
        let blind = one(dish(radius, depth, form, false, true));
        let (out, _) = evaluate(&blind, DVec3::Z, View::Distant(DVec3::Z), 1e-4);
        assert_eq!(out[0], 0.0);
    }
}

/// Truth: the light that a deep bowl takes in. Seen from inside under a slanting Sun its lit area, projected on the mouth, is that of the mouth,
/// whatever its depth: ∫ cosθ_i dA = π R² cos θ over the lit inside. The engine sees it with the observer on the axis only weighted by
/// cosθ_o; so the truth is a sum over a million points of the mouth's plane (midpoints in r² and azimuth), each traced along the Sun's direction to
/// the bowl. 1e-5.
#[test]
fn a_deep_dish_shades_itself() {
    let (radius, depth) = (1.0, 1.5);
    for sun_deg in [20.0, 50.0, 75.0_f64] {
        let sun = DVec3::new(sun_deg.to_radians().sin(), 0.0, sun_deg.to_radians().cos());
        let n = 1000;
        let mut truth = 0.0;
        for i in 0..n {
            for j in 0..n {
                let at = |k: usize| (k as f64 + 0.5) / n as f64;
                let p = radius * at(i).sqrt() * DVec2::from_angle(2.0 * PI * at(j));
                // p − s k with (p − s k)² = (R²/d) (d − s): the farther root.
                let (k, c) = (sun.truncate() / sun.z, radius * radius / depth);
                let (a, b) = (k.length_squared(), 2.0 * p.dot(k) - c);
                let q = p.length_squared() - radius * radius;
                let s = (b + (b * b - 4.0 * a * q).sqrt()) / (2.0 * a);
                let hit = p - s * k;
                let normal = DVec3::new(-2.0 * hit.x / c, -2.0 * hit.y / c, 1.0).normalize();
                // Each ray brings its cross-section, seen at the cosine of the observer's angle.
                truth += sun.z * normal.z;
            }
        }
        truth *= (radius / n as f64).powi(2);
        let bowl = one(dish(radius, depth, DishForm::Paraboloid, true, false));
        let found = evaluate(&bowl, sun, View::Distant(DVec3::Z), 1e-4);
        let sum = found.0[0];
        eprintln!("deep dish, Sun at {sun_deg}°: {:.1e}", (sum / truth - 1.0).abs());
        assert!((sum / truth - 1.0).abs() < 1e-5, "{sun_deg}: {sum} {truth}");
    }
}

/// Truth: reciprocity of a Lambert bowl, and independence of its place and turn. 1e-9 of the value.
#[test]
fn dishes_are_reciprocal_wherever_they_stand() {
    let mut rng = rng(3);
    for k in 0..40 {
        let form = if k % 2 == 0 { DishForm::Paraboloid } else { DishForm::Sphere };
        let shape = dish(1.0, 0.2 + 0.02 * f64::from(k), form, true, true);
        let (sun, to) = (direction(&mut rng), direction(&mut rng));
        let (there, _) = evaluate(&one(shape.clone()), sun, View::Distant(to), 1e-4);
        let rotation = turn(&mut rng);
        let moved = target(vec![(shape, rotation, 10.0 * direction(&mut rng))]);
        let (back, done) = evaluate(&moved, rotation * to, View::Distant(rotation * sun), 1e-4);
        let off = (there[0] - back[0]).abs();
        assert!(off <= 1e-9 * there[0].max(1e-3), "{k}: {} {}, {}", there[0], back[0], done.error);
    }
}

/// A mirror that is curved one way, and sizes that are none, are refused with what to do.
#[test]
fn what_cannot_be_is_refused() {
    let fresnel = Fresnel::constant(Spectrum::constant(1.0, 300.0, 1240.0).unwrap()).unwrap();
    let mut mirror = one(frustum(1.0, 1.0, 1.0));
    mirror.materials[0] = Material::mirror("mirror", fresnel);
    let error = Scene::new(&mirror).unwrap_err();
    assert!(matches!(error, SceneError::CurvedMirror { .. }), "{error}");
    assert!(error.to_string().contains("give it a roughness"), "{error}");
    for shape in [
        frustum(0.0, 0.0, 1.0),
        frustum(-1.0, 1.0, 1.0),
        frustum(1.0, 1.0, 0.0),
        frustum(1.0, f64::NAN, 1.0),
        dish(1.0, 0.0, DishForm::Paraboloid, true, true),
        dish(1.0, 1.1, DishForm::Sphere, true, true),
    ] {
        let error = Scene::new(&one(shape)).unwrap_err();
        assert!(matches!(error, SceneError::Size { .. }), "{error}");
    }
}
