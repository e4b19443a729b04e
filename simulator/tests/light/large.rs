//! Big meshes at a tolerance.

use super::scenes::*;
use glam::{DQuat, DVec2, DVec3};
use rand::RngExt as _;
use sunglint_simulator::light::{Scene, SceneError, View};
use sunglint_simulator::mesh::Mesh;
use sunglint_simulator::mesh::shapes::{Faceting, Side, cuboid, icosphere, plate};
use sunglint_simulator::scenes::BenchScene;
use sunglint_simulator::target::{Placement, Shape, Target};

/// A body with hills and valleys that shade each other: 20 × 4ⁿ triangles.
pub fn hills(subdivisions: u32, seed: u64) -> Mesh {
    let mut mesh = icosphere(1.0, subdivisions, Faceting::SameArea);
    let mut rng = rng(seed);
    let waves: Vec<(DVec3, f64)> = (0..12)
        .map(|k| (direction(&mut rng) * (3.0 + f64::from(k)), rng.random::<f64>() * 6.0))
        .collect();
    for v in &mut mesh.vertices {
        let height: f64 = waves.iter().map(|(k, phase)| (k.dot(*v) + phase).sin()).sum();
        *v *= 1.0 + 0.05 * height;
    }
    mesh
}

/// Sheets of three corners anywhere, through each other.
fn cloud(count: usize, seed: u64) -> Mesh {
    let mut rng = rng(seed);
    let mut mesh = Mesh::default();
    for _ in 0..count {
        let (first, middle) = (mesh.vertices.len() as u32, direction(&mut rng));
        mesh.vertices.extend([(); 3].map(|()| middle + 0.03 * direction(&mut rng)));
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    mesh
}

fn bodies() -> Vec<(&'static str, Target)> {
    let hilly = target([(Shape::Mesh(hills(4, 1)), DVec3::ZERO)]);
    // Two that reach into each other, of two materials, over a plate.
    let pierced = target([
        (Shape::Mesh(hills(4, 2)), DVec3::ZERO),
        (Shape::Mesh(hills(3, 3)), DVec3::new(0.9, 0.3, 0.2)),
        (Shape::Mesh(plate(DVec2::splat(4.0), true, true)), DVec3::Z * -1.3),
    ]);
    let sheets = target([
        (Shape::Mesh(cloud(4000, 4)), DVec3::ZERO),
        (Shape::Mesh(cuboid(DVec3::ONE, &Side::ALL)), DVec3::ZERO),
    ]);
    // A wing that turns to the Sun, with bumps on it.
    let mut hinged = Target::built_in("box_wing_diffuse").unwrap();
    let hinge = hinged.parts.iter().find_map(|p| p.hinge);
    let first = hinged.parts.len();
    add(&mut hinged, Shape::Mesh(hills(4, 5)), Placement::default());
    add(
        &mut hinged,
        Shape::Mesh(hills(3, 6)),
        Placement { offset_m: DVec3::Y, ..Default::default() },
    );
    for (k, part) in hinged.parts.iter_mut().enumerate().skip(first) {
        part.material = k - first;
        part.hinge = if k == first { None } else { hinge };
    }
    vec![("hills", hilly), ("pierced", pierced), ("sheets", sheets), ("hinged", hinged)]
}

/// Truth: the exact sums of polygons, which have truths of their own (`light_exact`, `scenes`). The error of each weight and of their sum
/// covers what they are off by, in all of 240 evaluations; three standard deviations leave one in 370 outside where an error is normal, and ours
/// are estimated too large. The errors do not exceed the tolerance.
#[test]
fn errors_cover_what_sampling_is_off_by() {
    for (name, target) in bodies() {
        let exact = Scene::new(&target).unwrap();
        for tolerance in [3e-2, 1e-2, 3e-3] {
            let scene = Scene::with_tolerance(&target, tolerance).unwrap();
            let sampling = scene.report().sampling;
            assert!(sampling.is_some(), "{name} {:?}", scene.report());
            let mut eye = scene.evaluator();
            let mut out = vec![0.0; scene.weight_count()];
            let (mut most, mut squares, mut sampled) = (0.0_f64, 0.0, 0);
            for seed in 0..20 {
                let (sun, to) = directions(&mut rng(100 + seed));
                let (truth, _) = evaluate(&exact, sun, View::Distant(to));
                let done = eye.direct(sun, View::Distant(to), &mut out).unwrap();
                let total: f64 = truth.iter().sum();
                let off = (out.iter().sum::<f64>() - total).abs();
                assert!(done.samples == 0 || done.error <= tolerance, "{name} {done:?}");
                assert!(
                    off <= done.error * total + 1e-12,
                    "{name} {tolerance} {seed}: {off} {done:?}"
                );
                for ((w, truth), error) in out.iter().zip(&truth).zip(eye.errors()) {
                    let off = (w - truth).abs();
                    assert!(off <= error + 1e-12 * total, "{name} {seed}: {w} {truth} {error}");
                    most = most.max(off / (error + 1e-12 * total));
                }
                sampled += usize::from(done.samples > 0);
                squares += (off / total).powi(2) / 20.0;
            }
            eprintln!(
                "{name} {tolerance}: {sampled} of 20 sampled, rms {:.1e}, {most:.2} of an error at most, {sampling:?}",
                squares.sqrt()
            );
        }
    }
}

/// Truth: rays that share nothing with the engine. Tolerance: 4 standard errors of the rays and the engine's own error.
#[test]
fn a_hilly_body_by_rays() {
    let target = target([(Shape::Mesh(hills(4, 1)), DVec3::ZERO)]);
    let scene = Scene::with_tolerance(&target, 5e-3).unwrap();
    for seed in 0..3 {
        let (sun, to) = directions(&mut rng(seed));
        let (out, done) = evaluate(&scene, sun, View::Distant(to));
        let (w, variance) = rays(&target, sun, View::Distant(to), 20_000, seed)[0];
        assert!(done.samples > 0);
        let allowed = 4.0 * variance.sqrt() + done.error * w;
        assert!((out[0] - w).abs() <= allowed, "{} {w} {allowed}", out[0]);
    }
}

/// Truth: the stored sums of the comparison script for 115,244 triangles (`simulator/scenes`). The errors are within what is stated, and from the level on
/// that is meant for 2 ms below the 2.7e-3 for which the peer takes 8.7 ms (`benches/README.md`). In this one view chance helps the coarsest: what is to be
/// expected is in the next test.
#[test]
fn the_dense_satellite_at_a_tolerance() {
    let bench = BenchScene::new("dense_satellite").unwrap();
    let truth = bench.truth.as_ref().unwrap().grey_m2_sr;
    for tolerance in [5e-2, 3e-2, 3e-3] {
        let scene = Scene::with_tolerance(&bench.target, tolerance).unwrap();
        let (out, done) = evaluate(&scene, bench.sun_body, View::Distant(bench.view_body));
        let grey = scene.spectra().map(|s| sunglint_simulator::scenes::grey(s).unwrap());
        let ours: f64 = out.iter().zip(grey).map(|(w, g)| w * g).sum();
        assert!(done.samples > 0 && done.error <= tolerance);
        let off = (ours / truth - 1.0).abs();
        assert!(off <= done.error && off <= 2.7e-3, "{ours} {truth} {done:?}");
    }
}

/// Truth: the exact sums, which agree with the stored ones of another program to 1e-12 (`sunglint bench`). Of 48 evaluations, half about the view of the
/// peer's table and half from all sides, none is off by more than it states. About that view a third of what is stated, a standard deviation, is no
/// less than the root mean square of what they are off by; of 24 that is known to 15 %, and the allowance is two of these. In grey light, where the domes
/// weigh most, the mean error at 3e-2 is that for which the peer takes 8.7 ms, 2.7e-3, within the same allowance.
#[test]
fn the_dense_satellite_from_many_sides() {
    let bench = BenchScene::new("dense_satellite").unwrap();
    let exact = Scene::new(&bench.target).unwrap();
    let scene = Scene::with_tolerance(&bench.target, 3e-2).unwrap();
    let grey: Vec<f64> =
        scene.spectra().map(|s| sunglint_simulator::scenes::grey(s).unwrap()).collect();
    // In standard deviations of ΣW as stated, and relative, in grey light.
    let off = |sun: DVec3, to: DVec3| {
        let (truth, _) = evaluate(&exact, sun, View::Distant(to));
        let (out, done) = evaluate(&scene, sun, View::Distant(to));
        let off = out.iter().sum::<f64>() / truth.iter().sum::<f64>() - 1.0;
        assert!(done.samples > 0 && off.abs() <= done.error, "{sun} {to}: {off} {done:?}");
        let sum = |w: &[f64]| w.iter().zip(&grey).map(|(w, g)| w * g).sum::<f64>();
        [3.0 * off / done.error, sum(&out) / sum(&truth) - 1.0]
    };
    let mut rms = [0.0; 2];
    for seed in 0..24 {
        let mut rng = rng(400 + seed);
        let mut near = |d: DVec3| (d + 0.05 * direction(&mut rng)).normalize();
        let found = off(near(bench.sun_body), near(bench.view_body));
        (0..2).for_each(|k| rms[k] += found[k] * found[k] / 24.0);
        let (sun, to) = directions(&mut rng);
        off(sun, to);
    }
    let [sigmas, grey] = rms.map(f64::sqrt);
    eprintln!("{sigmas:.2} standard deviations, {grey:.1e} in grey light");
    assert!(sigmas <= 1.3 && grey <= 1.3 * 2.7e-3, "{sigmas} {grey}");
}

/// Truth: what is promised. The same numbers to the last bit whoever asks and whatever was asked before; small scenes, spheres, near observers and a
/// tolerance of 0 are exact.
#[test]
fn what_is_sampled_and_what_is_not() {
    let (_, pierced) = bodies().swap_remove(1);
    let scene = Scene::with_tolerance(&pierced, 1e-2).unwrap();
    let ask = |seeds: &[u64]| {
        let mut eye = scene.evaluator();
        let mut out = vec![0.0; scene.weight_count()];
        for seed in seeds {
            let (sun, to) = directions(&mut rng(*seed));
            eye.direct(sun, View::Distant(to), &mut out).unwrap();
        }
        (out, eye.errors().to_vec())
    };
    let alone = ask(&[3]);
    assert_eq!(alone, ask(&[1, 2, 3]));
    let threads: Vec<_> = std::thread::scope(|s| {
        [(); 3].map(|()| s.spawn(|| ask(&[5, 3]))).map(|t| t.join().unwrap()).into()
    });
    assert!(threads.iter().all(|t| *t == alone));

    let (sun, to) = directions(&mut rng(3));
    assert_eq!(evaluate(&scene, sun, View::At(50.0 * to)).1.samples, 0);
    let exact = Scene::with_tolerance(&pierced, 0.0).unwrap();
    assert!(exact.report().sampling.is_none() && exact.report().why_exact.is_none());
    assert_eq!(evaluate(&exact, sun, View::Distant(to)).1.samples, 0);
    let mut balls = pierced.clone();
    add(&mut balls, Shape::Sphere { radius_m: 0.2 }, Placement::default());
    for (target, why) in [
        (balls, "curved parts"),
        (Target::built_in("box_wing").unwrap(), "fewer than"),
        (
            target([(Shape::Mesh(icosphere(1.0, 4, Faceting::SameArea)), DVec3::ZERO)]),
            "nothing hides",
        ),
    ] {
        let scene = Scene::with_tolerance(&target, 1e-2).unwrap();
        let said = scene.report().why_exact.clone().unwrap();
        assert!(said.contains(why) && scene.report().sampling.is_none(), "{said}");
    }
    for tolerance in [-1e-3, f64::NAN, f64::INFINITY, 1.5] {
        let error = Scene::with_tolerance(&pierced, tolerance).unwrap_err();
        assert!(matches!(error, SceneError::Tolerance { .. }), "{error}");
    }
}

/// Truth: turning the whole body with both directions changes nothing; other points, so that both errors count.
#[test]
fn turned_as_a_whole() {
    let (_, pierced) = bodies().swap_remove(1);
    let mut rng = rng(7);
    let rotation: DQuat = turn(&mut rng);
    let (sun, to) = directions(&mut rng);
    let a = Scene::with_tolerance(&pierced, 1e-2).unwrap();
    let b = Scene::with_tolerance(&turned(&pierced, rotation, DVec3::ZERO), 1e-2).unwrap();
    let (a, b) = (
        evaluate(&a, sun, View::Distant(to)),
        evaluate(&b, rotation * sun, View::Distant(rotation * to)),
    );
    let (x, y): (f64, f64) = (a.0.iter().sum(), b.0.iter().sum());
    assert!((x - y).abs() <= a.1.error * x + b.1.error * y, "{x} {y}");
}
