//! Parts that turn to the Sun.

use super::scenes::*;
use glam::{DQuat, DVec3};
use sunglint_simulator::light::{Scene, View};
use sunglint_simulator::mesh::shapes::{Side, cuboid};
use sunglint_simulator::target::{Hinge, Placement, Shape, Target};

fn boxed(size: DVec3) -> Shape {
    Shape::Mesh(cuboid(size, &Side::ALL))
}

/// A body, and two wings about one axis with a box on one of them, near enough to shade the body and to be shaded; a mast before all.
fn winged() -> Target {
    let at = |offset_m| Placement { offset_m, ..Placement::default() };
    let mut target = target([(boxed(DVec3::new(1.0, 1.0, 2.0)), DVec3::ZERO)]);
    let tilt = DQuat::from_rotation_y(0.3);
    add(&mut target, boxed(DVec3::new(0.02, 2.0, 1.2)), at(DVec3::new(0.1, 1.6, 0.2)));
    add(&mut target, boxed(DVec3::new(0.02, 2.0, 1.2)), at(DVec3::new(0.1, -1.6, 0.2)));
    let leaning = Placement { rotation: tilt, offset_m: DVec3::new(0.3, 1.0, 0.3) };
    add(&mut target, boxed(DVec3::splat(0.3)), leaning);
    add(&mut target, boxed(DVec3::new(0.1, 0.1, 2.0)), at(DVec3::new(1.0, 0.8, 0.4)));
    target.hinges.push(Hinge {
        name: "wings".into(),
        point_m: DVec3::new(0.1, 0.0, 0.2),
        axis: DVec3::Y,
        face: DVec3::X,
        range_rad: None,
    });
    (1..=3).for_each(|k| target.parts[k].hinge = Some(0));
    target
}

/// The same built at an angle, without a hinge.
fn built_at(target: &Target, angle: f64) -> Target {
    let mut still = target.clone();
    let hinge = still.hinges.remove(0);
    for part in still.parts.iter_mut().filter(|p| p.hinge.is_some()) {
        part.hinge = None;
        part.placement.offset_m = hinge.point(angle, part.placement.offset_m);
        part.placement.rotation =
            DQuat::from_axis_angle(hinge.axis, angle) * part.placement.rotation;
    }
    still
}

/// Truth: the body built statically at the angle that the hinge's definition gives. 1e-13 of the most, each part, 100 Suns; each time
/// something hinged is shaded or shades.
#[test]
fn hinged_is_as_built() {
    let target = winged();
    let scene = Scene::new(&target).unwrap();
    let index = Scene::with_most_pairs(&target, 0).unwrap();
    let mut eye = scene.evaluator();
    let mut worst = 0.0_f64;
    let mut shaded = 0;
    for seed in 0..100 {
        let (sun, to) = directions(&mut rng(seed));
        let still = built_at(&target, target.hinges[0].angle_rad(sun));
        let far = [View::Distant(to)];
        let views =
            if seed % 10 == 0 { [far[0], View::At(6.0 * to)].to_vec() } else { far.to_vec() };
        for view in views {
            let mut out = vec![0.0; scene.weight_count()];
            let done = eye.direct(sun, view, &mut out).unwrap();
            shaded += done.shadowed;
            let limit = if matches!(view, View::At(_)) { 1e-10 } else { 1e-13 };
            for other in [weights(&still, sun, view), evaluate(&index, sun, view).0] {
                for (a, b) in out.iter().zip(&other) {
                    worst = worst.max((a - b).abs() / most(&target));
                    assert!((a - b).abs() < limit * most(&target), "{seed}: {out:?} {other:?}");
                }
            }
        }
    }
    eprintln!("hinged against built: {worst:.1e}, {shaded} facets shaded");
    assert!(shaded > 100);
}

/// Truth: a fresh evaluator. One that has looked at other Suns before gives the very same bits.
#[test]
fn evaluators_do_not_remember() {
    let target = winged();
    for scene in [Scene::new(&target).unwrap(), Scene::with_most_pairs(&target, 0).unwrap()] {
        let mut old = scene.evaluator();
        let mut out = vec![0.0; scene.weight_count()];
        // Also the Sun on the axis and at the angle 0.
        let mut suns: Vec<DVec3> = (0..20).map(|k| directions(&mut rng(k)).0).collect();
        suns.extend([DVec3::X, DVec3::Y, -DVec3::Y, -DVec3::X]);
        for k in 0..200 {
            let sun = suns[(k * 7 + k / 5) % suns.len()];
            let view = View::Distant((sun + DVec3::new(0.3, 0.2, -0.4)).normalize());
            old.direct(sun, view, &mut out).unwrap();
            assert_eq!(out, evaluate(&scene, sun, view).0, "{k}");
        }
    }
}

/// Truth: rays through the body as built.
#[test]
fn hinged_by_rays() {
    let target = winged();
    for seed in [3, 8] {
        let (sun, to) = directions(&mut rng(seed));
        let still = built_at(&target, target.hinges[0].angle_rad(sun));
        let scene = Scene::new(&target).unwrap();
        let out = evaluate(&scene, sun, View::Distant(to)).0;
        for (ours, (w, s)) in out.iter().zip(rays(&still, sun, View::Distant(to), 60_000, seed)) {
            assert!((ours - w).abs() < 4.0 * s + 2e-3, "{seed}: {ours} for {w} ± {s}");
        }
    }
}

/// Truth: by hand. Two plates, the upper on a hinge, that come to lie in one plane and touch along an edge, or overlap by half. Touching they
/// count both; overlapping they count twice where they overlap, which is said of hinges in the module's text: known, not hidden.
#[test]
fn plates_in_one_plane_by_a_hinge() {
    use glam::DVec2;
    use sunglint_simulator::mesh::shapes::plate;
    let sheet = || Shape::Mesh(plate(DVec2::ONE, true, false));
    let w = |along: f64| {
        let mut both = target([(sheet(), DVec3::ZERO), (sheet(), DVec3::new(along, 0.0, 0.0))]);
        both.parts[1].hinge = Some(0);
        both.hinges.push(Hinge {
            name: "h".into(),
            point_m: DVec3::ZERO,
            axis: DVec3::X,
            face: DVec3::Z,
            range_rad: None,
        });
        weights(&both, DVec3::Z, View::Distant(DVec3::Z)).iter().sum::<f64>() * std::f64::consts::PI
    };
    assert!((w(1.0) - 2.0).abs() < 1e-12);
    assert!((w(0.5) - 2.0).abs() < 1e-12);
}
