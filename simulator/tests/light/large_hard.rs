//! Hard cases of big meshes.

use super::large::hills;
use super::scenes::*;
use glam::{DVec2, DVec3};
use std::f64::consts::PI;
use sunglint_simulator::light::{Scene, SceneError, View};
use sunglint_simulator::mesh::Mesh;
use sunglint_simulator::mesh::shapes::{Side, cuboid, plate};
use sunglint_simulator::target::{Shape, Target};

/// A roof of `n` ridges 2 m long across 2 m, `height` high, of 4 n² triangles; no two of one slope lie in one plane.
fn roof(n: usize, height: f64) -> Mesh {
    let mut mesh = Mesh::default();
    let columns = 2 * n;
    for j in 0..=n {
        for i in 0..=columns {
            let (x, y) = (i as f64 / n as f64 - 1.0, 2.0 * j as f64 / n as f64 - 1.0);
            // A little bent along the ridge: facets of their own.
            let z = height * ((i % 2) as f64) * (1.0 + 1e-6 * y * y);
            mesh.vertices.push(DVec3::new(x, y, z));
        }
    }
    let at = |i: usize, j: usize| (j * (columns + 1) + i) as u32;
    for j in 0..n {
        for i in 0..columns {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

/// Sums at a tolerance and exactly: the values, their error, and whether points were taken.
fn both(target: &Target, sun: DVec3, to: DVec3, tolerance: f64) -> (f64, f64, f64, usize) {
    let scene = Scene::with_tolerance(target, tolerance).unwrap();
    let exact = Scene::new(target).unwrap();
    let (out, done) = evaluate(&scene, sun, View::Distant(to));
    let truth: f64 = evaluate(&exact, sun, View::Distant(to)).0.iter().sum();
    let total: f64 = out.iter().sum();
    (total, truth, done.error * total, done.samples)
}

fn covered(name: &str, (total, truth, error, samples): (f64, f64, f64, usize)) {
    assert!(samples > 0, "{name}: not sampled");
    assert!((total - truth).abs() <= error + 1e-12 * truth, "{name}: {total} {truth} ± {error}");
}

/// Truth: by hand. A saw-tooth roof of slope 1 and height h under a Sun at an elevation of ε < 45° across the ridges, seen from above: the lit part
/// of each bright slope is its upper sinε√2/sin(45° + ε) (by the sine rule in the triangle of valley, ridge and shadow). Tolerance: the error that the
/// engine states.
#[test]
fn ridges_shade_each_other() {
    let n = 40;
    let target = target([(Shape::Mesh(roof(n, 1.0 / n as f64)), DVec3::ZERO)]);
    let scene = Scene::with_tolerance(&target, 3e-3).unwrap();
    for degrees in [10.0_f64, 20.0, 30.0] {
        let e = degrees.to_radians();
        let sun = DVec3::new(-e.cos(), 0.0, e.sin());
        let (out, done) = evaluate(&scene, sun, View::Distant(DVec3::Z));
        // The foremost slope has nothing before it.
        let lit = 2.0_f64.sqrt() * e.sin() / (PI / 4.0 + e).sin();
        let share = (lit * (n as f64 - 1.0) + 1.0) / n as f64;
        let slope = 2.0_f64.sqrt() / 2.0;
        let area = 2.0 * 1.0 * 2.0_f64.sqrt() * share;
        let truth = area * slope * (e + PI / 4.0).sin() / PI;
        assert!(done.samples > 0, "{done:?}");
        let off = (out[0] - truth).abs();
        assert!(off <= done.error * truth + 1e-6 * truth, "{degrees}: {} {truth} {done:?}", out[0]);
    }
}

/// Truth: the same body at home; what is lost is the place's own rounding of 1e-9 m, of millimetre hills.
#[test]
fn far_away_in_millimetres() {
    let mut small = hills(4, 1);
    small.vertices.iter_mut().for_each(|v| *v *= 1e-3);
    let home = target([(Shape::Mesh(small.clone()), DVec3::ZERO)]);
    let mut far = home.clone();
    far.parts[0].placement.offset_m = DVec3::new(1e7, -2e6, 3e6);
    let (sun, to) = directions(&mut rng(1));
    let (_, truth, _, _) = both(&home, sun, to, 1e-2);
    let scene = Scene::with_tolerance(&far, 1e-2).unwrap();
    let (out, done) = evaluate(&scene, sun, View::Distant(to));
    // Corners nearer to each other than TOUCHING of 1e7 m, 1 mm, are one: what is left of such a body is said to be nothing, or near the truth.
    let total: f64 = out.iter().sum();
    assert!(total.is_finite() && total <= 1.5 * truth, "{total} {truth} {done:?}");
}

/// Truth: the exact sums. Slivers of 1 m × 1 µm by the thousand over a hilly body; a body seen edge-on and under a grazing Sun; a plate of 20 m under
/// 5,000 triangles of a centimetre; coincident plates of two materials among hills; boxes in boxes.
#[test]
fn slivers_edges_giants_and_coincidence() {
    let hilly = || (Shape::Mesh(hills(4, 1)), DVec3::ZERO);
    let mut slivers = Mesh::default();
    for k in 0..500 {
        let mut sliver = plate(DVec2::new(1.0, 1e-6), true, true);
        sliver.vertices.iter_mut().for_each(|v| *v += DVec3::Y * (f64::from(k) / 250.0 - 1.0));
        slivers = Mesh::merged([&slivers, &sliver]);
    }
    let sun = DVec3::new(0.3, 0.5, 0.8).normalize();
    let to = DVec3::new(-0.2, 0.1, 0.9).normalize();
    let with_slivers = target([hilly(), (Shape::Mesh(slivers), DVec3::Z * 1.6)]);
    covered("slivers", both(&with_slivers, sun, to, 1e-2));

    let edge_on = target([(Shape::Mesh(roof(40, 1e-3)), DVec3::ZERO)]);
    covered("edge-on", both(&edge_on, sun, DVec3::new(0.0, 1.0, 1e-3).normalize(), 5e-2));
    let none = both(&edge_on, DVec3::new(1.0, 0.0, -0.3).normalize(), to, 5e-2);
    assert!(none.0.abs() <= none.2 + 1e-12, "{none:?}");

    let mut tiny = hills(4, 2);
    tiny.vertices.iter_mut().for_each(|v| *v *= 0.01);
    let giant = target([
        (Shape::Mesh(plate(DVec2::splat(20.0), true, true)), DVec3::ZERO),
        (Shape::Mesh(tiny), DVec3::Z * 0.02),
    ]);
    covered("giant", both(&giant, sun, to, 1e-3));

    let sheet = || Shape::Mesh(plate(DVec2::splat(2.0), true, false));
    let coincident =
        target([hilly(), (sheet(), DVec3::Z * -1.5), (sheet(), DVec3::new(0.5, 0.5, -1.5))]);
    covered("coincident", both(&coincident, sun, to, 1e-2));

    let boxed = |size: f64| Shape::Mesh(cuboid(DVec3::splat(size), &Side::ALL));
    // Larger than the hills: nothing of them is seen.
    let inside = target([hilly(), (boxed(6.0), DVec3::ZERO)]);
    let scene = Scene::with_tolerance(&inside, 1e-2).unwrap();
    assert!(scene.report().buried > 5000, "{:?}", scene.report());
    let cavity = Mesh::merged([
        &hills(4, 1),
        &cuboid(DVec3::splat(6.0), &Side::ALL).flipped(),
        &cuboid(DVec3::splat(7.0), &Side::ALL),
    ]);
    let cavity = target([(Shape::Mesh(cavity), DVec3::ZERO)]);
    let (total, truth, error, _) = both(&cavity, sun, to, 1e-2);
    assert!((total - truth).abs() <= error + 1e-12 * truth, "{total} {truth} {error}");
}

/// Truth: what is said. Corners that are no numbers are refused, nothing reflects nothing.
#[test]
fn nothing_and_no_numbers() {
    let mut bad = hills(4, 1);
    bad.vertices[17].y = f64::NAN;
    let bad = target([(Shape::Mesh(bad), DVec3::ZERO)]);
    assert!(matches!(Scene::with_tolerance(&bad, 1e-2), Err(SceneError::NotFinite { .. })));
    let nothing = target([(Shape::Mesh(Mesh::default()), DVec3::ZERO)]);
    let scene = Scene::with_tolerance(&nothing, 1e-2).unwrap();
    assert_eq!(evaluate(&scene, DVec3::Z, View::Distant(DVec3::Z)).0, vec![0.0]);
}
