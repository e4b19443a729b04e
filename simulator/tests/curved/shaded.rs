//! Curved parts that shade and are shaded.

use super::rays::agree;
use super::*;
use glam::DVec2;
use std::f64::consts::PI;
use sunglint_simulator::mesh::shapes::{Side, cuboid, plate};

/// Truth: ∫ (1−x²)/2 over the part of the disc that an edge at x = c leaves, c − c³/3 (Lambert sphere, opposition). The ladder: the error
/// is below what is claimed at every tolerance, and falls with it.
#[test]
fn an_edge_over_a_sphere_is_refined() {
    for tolerance in [1e-2, 1e-3, 1e-4] {
        let (mut worst, mut claimed, mut cells) = (0.0_f64, 0.0_f64, 0);
        for seed in 0..2 {
            let rotation = turn(&mut rng(seed));
            for k in [1, 3, 5, 6, 9] {
                let c = -1.0 + 0.2 * f64::from(k) + 0.013;
                let sheet = Shape::Mesh(plate(DVec2::splat(10.0), true, true));
                let both = target(vec![
                    (Shape::Sphere { radius_m: 1.0 }, DQuat::IDENTITY, DVec3::ZERO),
                    (sheet, rotation, rotation * DVec3::new(c - 5.0, 0.0, 3.0)),
                ]);
                let sun = rotation * DVec3::Z;
                let (out, done) = evaluate(&both, sun, View::Distant(sun), tolerance);
                let truth = 0.5 * (2.0 / 3.0 - c + c.powi(3) / 3.0);
                let claim = done.error * out.iter().sum::<f64>();
                let off = (out[0] - truth).abs();
                assert!(off <= claim, "{tolerance} {c}: {off:.1e}, claimed {claim:.1e}");
                worst = worst.max(off / (2.0 / 3.0));
                claimed = claimed.max(claim / (2.0 / 3.0));
                cells = cells.max(done.refined);
            }
        }
        eprintln!(
            "edge over a sphere, tolerance {tolerance:.0e}: {worst:.1e} claimed {claimed:.1e}"
        );
        assert!(claimed <= 1.01 * tolerance && worst <= tolerance, "{tolerance}");
    }
}

/// Truth: a Lambert cylinder broadside with the Sun; a sheet before it leaves the azimuths beyond arcsin c, along all of it:
/// R L/π ∫ cos² = R L/(2π) [a + sin a cos a] from arcsin c to π/2. And a sheet across: a part of its length.
#[test]
fn a_cylinder_behind_a_straight_edge() {
    let (radius, length) = (0.5, 3.0);
    for tolerance in [1e-2, 1e-3, 1e-4] {
        let mut worst = 0.0_f64;
        for k in 1..10 {
            let c = -1.0 + 0.2 * f64::from(k) + 0.017;
            let sheet = || Shape::Mesh(plate(DVec2::splat(20.0), true, true));
            let quarter = DQuat::from_rotation_y(0.5 * PI);
            let along = target(vec![
                (frustum(radius, radius, length), DQuat::IDENTITY, DVec3::ZERO),
                (sheet(), quarter, DVec3::new(2.0, radius * c - 10.0, 0.0)),
            ]);
            let (out, done) = evaluate(&along, DVec3::X, View::Distant(DVec3::X), tolerance);
            let a = c.asin();
            let truth = radius * length / (2.0 * PI) * (0.5 * PI - a - a.sin() * a.cos());
            let claim = done.error * out.iter().sum::<f64>();
            let off = (out[0] - truth).abs();
            assert!(off <= claim + 1e-12, "{tolerance} {c}: {off:.1e}, claimed {claim:.1e}");
            worst = worst.max(off / (0.5 * radius * length));
            let across = target(vec![
                (frustum(radius, radius, length), DQuat::IDENTITY, DVec3::ZERO),
                (sheet(), quarter, DVec3::new(2.0, 0.0, 0.5 * length * c - 10.0)),
            ]);
            let (out, _) = evaluate(&across, DVec3::X, View::Distant(DVec3::X), tolerance);
            let truth = 0.5 * radius * 0.5 * length * (1.0 - c);
            assert!((out[0] - truth).abs() < 1e-12, "{c}: {} {truth}", out[0]);
        }
        eprintln!("edge over a cylinder, tolerance {tolerance:.0e}: {worst:.1e}");
        assert!(worst <= tolerance);
    }
}

/// Truth: the shadow of a round body on a sheet, in closed form: a disc's ellipse, a cylinder broadside 2 R L/cos, on its end a disc, a cone
/// from the side a triangle. A sheet of 100 m² in opposition shows 100 less the shadow, over π. Within what is claimed: 3e-5 of the body's radius squared.
#[test]
fn shadows_of_round_bodies() {
    let shade = |shape: Shape, rotation: DQuat, sun: DVec3| {
        let sheet = Shape::Mesh(plate(DVec2::splat(10.0), true, false));
        let both =
            target(vec![(sheet, DQuat::IDENTITY, DVec3::ZERO), (shape, rotation, 4.0 * sun)]);
        let (out, done) = evaluate(&both, sun, View::Distant(sun), 1e-4);
        let claim = done.error * out.iter().sum::<f64>();
        (100.0 - out[0] * PI / sun.z.powi(2), claim * PI)
    };
    let side = DQuat::from_rotation_x(0.5 * PI);
    let lean = DVec3::new(0.5, 0.0, 1.0).normalize();
    for (what, shape, rotation, sun, truth) in [
        ("cylinder", frustum(0.5, 0.5, 3.0), side, DVec3::Z, 3.0),
        ("cylinder's end", frustum(0.5, 0.5, 3.0), DQuat::IDENTITY, DVec3::Z, 0.25 * PI),
        ("slanting", frustum(0.5, 0.5, 3.0), side, lean, 3.0 / lean.z),
        ("cone", frustum(0.6, 0.0, 2.0), side, DVec3::Z, 1.2),
        ("cone from its tip", frustum(0.6, 0.0, 2.0), DQuat::IDENTITY, DVec3::Z, 0.36 * PI),
        ("dish", dish(1.0, 0.3, DishForm::Paraboloid, true, true), DQuat::IDENTITY, DVec3::Z, PI),
        (
            "dish from the side",
            dish(1.0, 0.6, DishForm::Paraboloid, true, true),
            side,
            DVec3::Z,
            4.0 / 3.0 * 0.6,
        ),
    ] {
        let (found, claim) = shade(shape, rotation, sun);
        let off = (found - truth).abs();
        eprintln!("shadow of a {what}: {:.1e}", off / truth);
        assert!(
            off < 1e-12 + claim && claim < 1e-3,
            "{what}: {found} {truth}, claimed {claim:.1e}"
        );
    }
}

/// Truth: rays at implicit surfaces. Round parts beside, before, behind and on one another and on a box; near and far observers.
#[test]
fn rays_at_round_bodies() {
    let boxed = Shape::Mesh(cuboid(DVec3::new(1.0, 1.2, 0.8), &Side::ALL));
    for seed in 0..8 {
        let mut rng = rng(seed);
        let form = DishForm::Paraboloid;
        let mut parts = vec![(boxed.clone(), turn(&mut rng), DVec3::ZERO)];
        let shapes = [
            frustum(0.4, 0.4, 1.6),
            Shape::Sphere { radius_m: 0.6 },
            dish(0.8, 0.4, form, true, true),
            frustum(0.7, 0.2, 0.9),
            frustum(0.5, 0.0, 1.1),
        ];
        for shape in shapes {
            let place = 1.4 * direction(&mut rng);
            parts.push((shape, turn(&mut rng), place));
        }
        let scene = target(parts);
        let sun = direction(&mut rng);
        let to = (sun + 0.9 * direction(&mut rng)).normalize();
        let view = if seed % 3 == 2 { View::At(6.0 * to) } else { View::Distant(to) };
        agree(&format!("seed {seed}"), &scene, sun, view, 40_000, seed);
    }
}
