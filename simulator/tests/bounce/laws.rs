//! Invariants that physics demands, and hard cases.

use super::scenes::*;
use glam::DVec3;
use std::f64::consts::{PI, TAU};
use sunglint_simulator::light::bounce::{Bounce, BounceError, BounceOptions};
use sunglint_simulator::light::{DirectionError, Effect as _, Lighting, Scene, View};
use sunglint_simulator::mesh::shapes::{Side, cuboid};
use sunglint_simulator::target::{Placement, Shape, Target};

fn options(tolerance: f64) -> BounceOptions {
    BounceOptions { tolerance, seed: 1, ..BounceOptions::default() }
}

/// Truth: energy. All that enters a white box without a lid leaves it: ∫ I dω = E A cosθ, by 400 directions in a spiral, to 1 % (patches and directions).
#[test]
fn a_white_box_gives_back_what_it_gets() {
    for depth in [0.3, 1.0] {
        let scene = Scene::new(&alone(open_box(depth), 1.0)).unwrap();
        let bounce = Bounce::new(&scene, &options(5e-3)).unwrap();
        let sun = DVec3::new(0.3, 0.2, 1.0).normalize();
        let n = 400;
        let (mut once, mut more) = (0.0, 0.0);
        for k in 0..n {
            let z = (k as f64 + 0.5) / n as f64;
            let (sin, cos) = (k as f64 * PI * (3.0 - 5.0_f64.sqrt())).sin_cos();
            let across = (1.0_f64 - z * z).sqrt();
            let view = View::Distant(DVec3::new(across * cos, across * sin, z));
            once += direct(&scene, sun, view) * TAU / n as f64;
            more += grey_light(&bounce, sun, view).0 * TAU / n as f64;
        }
        let truth = sun.z;
        eprintln!("depth {depth}: {once:.4} + {more:.4} of {truth:.4}; {}", bounce.need().why);
        assert!(((once + more) / truth - 1.0).abs() < 0.01, "{once} {more} {truth}");
    }
}

/// Truth: Helmholtz. Sun and observer may be swapped: to 1e-12 for patches, whose matrices are symmetric and whose closed forms do not know which end comes first; for
/// paths within what is claimed. Where patches miss the tolerance and the budget holds enough paths, these take their place, and claim less.
#[test]
fn sun_and_observer_may_be_swapped() {
    let corner = || Target::built_in("corner").unwrap();
    let mut rough = corner();
    rough.materials[0] = beckmann("satin", 0.3, 0.7);
    // Of so few paths none are better than patches.
    let few = BounceOptions { most_paths: 20_000, ..options(1e-2) };
    let many = BounceOptions { most_paths: 1_000_000, ..options(1e-2) };
    let mut claims = Vec::new();
    for (target, options, exact) in
        [(corner(), few, true), (corner(), many, false), (rough, options(1e-2), false)]
    {
        let scene = Scene::new(&target).unwrap();
        let bounce = Bounce::new(&scene, &options).unwrap();
        for (a, b) in [([0.7, 0.3, 0.6], [0.4, -0.4, 0.9]), ([1.0, 0.1, 0.2], [0.2, 0.1, 1.0])] {
            let (a, b) = (DVec3::from(a).normalize(), DVec3::from(b).normalize());
            let (one, error) = grey_light(&bounce, a, View::Distant(b));
            let (other, also) = grey_light(&bounce, b, View::Distant(a));
            let limit = if exact { 1e-12 * one } else { error + also };
            assert!(one > 0.0 && (one - other).abs() <= limit, "{one} {other} {limit}");
            claims.push((one, error));
        }
    }
    let ((patches, off), (paths, less)) = (claims[1], claims[3]);
    assert!(less < 0.8 * off && (paths - patches).abs() < off + less, "{claims:?}");
}

/// Truth: nothing is between the fronts of a convex body, and no light comes into a closed one. Both are left out with a bound of 0 or send nothing.
#[test]
fn convex_and_closed() {
    let convex = Scene::new(&alone(cuboid(DVec3::ONE, &Side::ALL), 1.0)).unwrap();
    let bounce = Bounce::new(&convex, &options(1e-6)).unwrap();
    assert!(!bounce.need().needed && bounce.need().bound == Some(0.0) && bounce.terms().is_empty());
    let mut hollow = cuboid(DVec3::ONE, &Side::ALL);
    hollow.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    let hollow = Scene::new(&alone(hollow, 1.0)).unwrap();
    let bounce = Bounce::new(&hollow, &options(1e-3)).unwrap();
    assert!(!bounce.need().needed, "{:?}", bounce.need());
    let empty = Scene::new(&Target::default()).unwrap();
    assert!(!Bounce::new(&empty, &options(1e-3)).unwrap().need().needed);
}

/// Truth: a dark or distant neighbour adds less than its bound, which is below the tolerance: it is left out and says why.
#[test]
fn what_is_small_is_left_out() {
    let mut target = Target::default();
    for (x, rho) in [(0.0, 0.9), (60.0, 0.9)] {
        let placement = Placement { offset_m: x * DVec3::X, ..Placement::default() };
        let mesh = cuboid(DVec3::ONE, &Side::ALL);
        add(&mut target, Shape::Mesh(mesh), grey("grey", rho), placement);
    }
    let scene = Scene::new(&target).unwrap();
    let bounce = Bounce::new(&scene, &options(1e-3)).unwrap();
    let need = bounce.need();
    assert!(!need.needed && need.bound.is_some_and(|b| b > 0.0 && b < 1e-3), "{need:?}");
    assert!(need.why.contains("hemisphere"), "{}", need.why);
    assert!(Bounce::new(&scene, &options(1e-5)).unwrap().need().bound.unwrap() > 0.0);
    for tolerance in [0.0, f64::NAN, 1.0] {
        assert!(matches!(Bounce::new(&scene, &options(tolerance)), Err(BounceError::Tolerance(_))));
    }
}

/// Truth: a body whose hinges stand at an angle is the same body without hinges at that angle. Paths (hinges) against patches (none): within what
/// both claim.
#[test]
fn a_turned_part_is_the_part_at_its_place() {
    let hinged = Target::built_in("box_with_panels").unwrap();
    let mut hinged = hinged.clone();
    for material in &mut hinged.materials {
        *material = grey("grey", 0.8);
    }
    let scene = Scene::new(&hinged).unwrap();
    let bounce = Bounce::new(&scene, &options(1e-2)).unwrap();
    assert!(!hinged.hinges.is_empty());
    for sun in [DVec3::new(0.5, 0.3, 0.8), DVec3::new(0.9, -0.2, -0.4)] {
        let sun = sun.normalize();
        let to = (sun + 0.5 * DVec3::new(0.3, -0.8, 0.5)).normalize();
        let angles = hinged.hinge_angles_rad(sun);
        let mut fixed = hinged.clone();
        for (k, part) in fixed.parts.iter_mut().enumerate() {
            let (rotation, offset_m) = hinged.part_to_body(k, &angles);
            part.placement = Placement { rotation, offset_m };
            part.hinge = None;
        }
        fixed.hinges.clear();
        let still = Scene::new(&fixed).unwrap();
        let view = View::Distant(to);
        let (a, ea) = grey_light(&bounce, sun, view);
        let still = Bounce::new(&still, &options(2e-3)).unwrap();
        let (b, eb) = grey_light(&still, sun, view);
        eprintln!("{a} ± {ea}, {b} ± {eb}");
        assert!((a - b).abs() <= ea + eb, "{a} ± {ea}, {b} ± {eb}");
    }
}

/// Truth: an observer a million metres away sees what one at infinity sees, to 1e-5; one near sees the same by paths and by patches, within what is claimed.
#[test]
fn observers_at_a_point() {
    let scene = Scene::new(&Target::built_in("corner").unwrap()).unwrap();
    let bounce = Bounce::new(&scene, &options(5e-3)).unwrap();
    let sun = DVec3::new(0.7, 0.3, 0.6).normalize();
    let to = DVec3::new(0.6, -0.4, 0.7).normalize();
    let (far, _) = grey_light(&bounce, sun, View::Distant(to));
    let (near, _) = grey_light(&bounce, sun, View::At(1e6 * to));
    assert!((near / far - 1.0).abs() < 1e-5, "{near} {far}");
    // A hinge that holds nothing of weight makes the engine take paths.
    let mut rough = Target::built_in("corner").unwrap();
    let ball = Placement { offset_m: DVec3::new(-50.0, 0.0, 0.0), ..Placement::default() };
    add(&mut rough, Shape::Sphere { radius_m: 0.01 }, grey("ball", 0.1), ball);
    let other = Scene::new(&rough).unwrap();
    let other = Bounce::new(&other, &options(5e-3)).unwrap();
    assert!(bounce.need().why.contains("patches"));
    for range in [3.0, 10.0] {
        let (a, ea) = grey_light(&bounce, sun, View::At(range * to));
        let (b, eb) = grey_light(&other, sun, View::At(range * to));
        eprintln!("{range} m: {a} ± {ea}, {b} ± {eb}; {}", other.need().why);
        assert!((a - b).abs() <= ea + eb, "{range}: {a} ± {ea}, {b} ± {eb}");
    }
}

/// Truth: none is needed. Slivers, faces that touch, Suns in a plate's plane: finite numbers, none below 0.
#[test]
fn hard_cases_stay_finite() {
    let mut target = Target::built_in("corner").unwrap();
    let sliver = cuboid(DVec3::new(1.0, 1e-6, 1e-6), &Side::ALL);
    let placement = Placement { offset_m: DVec3::new(0.5, -0.3, 5e-7), ..Placement::default() };
    add(&mut target, Shape::Mesh(sliver), grey("sliver", 1.0), placement);
    let scene = Scene::new(&target).unwrap();
    let bounce = Bounce::new(&scene, &options(1e-2)).unwrap();
    for sun in [DVec3::X, DVec3::Z, DVec3::new(1.0, 0.0, 1e-12), DVec3::new(1.0, 1.0, 1e-7)] {
        for to in [DVec3::Z, DVec3::Y, DVec3::new(1e-14, 0.3, 1.0), -sun] {
            let (weights, errors) = light(&bounce, sun, View::Distant(to));
            assert!(
                weights.iter().chain(&errors).all(|w| w.is_finite() && *w >= 0.0),
                "{sun} {to}"
            );
        }
    }
    let lighting = Lighting {
        sun_body: DVec3::ZERO,
        sun_radius_rad: 0.0,
        earth: None,
        moon: None,
        shadow: None,
        sunlit: 1.0,
        sunlit_error: 0.0,
        view: View::Distant(DVec3::X),
    };
    let n = bounce.terms().len();
    let (mut weights, mut errors) = (vec![0.0; n], vec![0.0; n]);
    let none = bounce.light().add(&lighting, &mut weights, &mut errors);
    assert!(matches!(none, Err(DirectionError::NoDirection { .. })));
    let room = bounce.light().add(&lighting, &mut weights[1..], &mut errors);
    assert!(matches!(room, Err(DirectionError::Room { .. })));
}

/// Truth: none is needed; the same seed gives the same numbers, whatever was asked before, and another seed's lie within what both claim.
#[test]
fn seeds() {
    let mut target = Target::built_in("corner").unwrap();
    target.materials[0] = beckmann("satin", 0.4, 0.8);
    let scene = Scene::new(&target).unwrap();
    let (sun, to) = (DVec3::new(0.7, 0.3, 0.6).normalize(), DVec3::new(0.4, -0.4, 0.9).normalize());
    let of = |seed: u32, before: bool| {
        let bounce = Bounce::new(
            &scene,
            &BounceOptions { tolerance: 1e-2, seed, ..BounceOptions::default() },
        )
        .unwrap();
        let mut light = bounce.light();
        let n = bounce.terms().len();
        let mut ask = |sun_body: DVec3| {
            let (mut w, mut e) = (vec![0.0; n], vec![0.0; n]);
            let view = View::Distant(to);
            let lighting = Lighting {
                sun_body,
                sun_radius_rad: 0.0,
                earth: None,
                moon: None,
                shadow: None,
                sunlit: 1.0,
                sunlit_error: 0.0,
                view,
            };
            light.add(&lighting, &mut w, &mut e).unwrap();
            (w[0], e[0])
        };
        if before {
            ask(DVec3::Z);
        }
        ask(sun)
    };
    assert_eq!(of(1, false), of(1, true));
    let ((a, ea), (b, eb)) = (of(1, false), of(2, false));
    assert!(a != b && (a - b).abs() <= ea + eb, "{a} ± {ea}, {b} ± {eb}");
}
