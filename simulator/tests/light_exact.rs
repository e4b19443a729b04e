//! The light engine against independent exact sums, closed forms, and against the hand in hard cases.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::{DQuat, DVec2, DVec3};
use std::collections::HashMap;
use std::f64::consts::PI;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::light::{DirectionError, Scene, SceneError, View};
use sunglint_simulator::mesh::Mesh;
use sunglint_simulator::mesh::shapes::{Faceting, Side, cuboid, icosphere, plate};
use sunglint_simulator::surface::{Fresnel, Material};
use sunglint_simulator::target::{Part, Placement, Shape, Target};
use sunglint_testkit::fixture;

fn white(name: &str) -> Material {
    Material::lambert(name, Spectrum::constant(1.0, 300.0, 1240.0).unwrap()).unwrap()
}

/// Lambert parts, each with a material of its own.
fn target(parts: Vec<(Shape, DVec3)>) -> Target {
    let materials = (0..parts.len()).map(|k| white(&format!("m{k}"))).collect();
    let part = |(k, (shape, offset_m)): (usize, (Shape, DVec3))| Part {
        name: format!("p{k}"),
        shape,
        material: k,
        placement: Placement { offset_m, ..Placement::default() },
        hinge: None,
        tangent: DVec3::X,
    };
    Target {
        parts: parts.into_iter().enumerate().map(part).collect(),
        materials,
        ..Target::default()
    }
}

fn boxed(size: f64) -> Shape {
    Shape::Mesh(cuboid(DVec3::splat(size), &Side::ALL))
}

fn weights(target: &Target, sun: DVec3, view: View) -> Vec<f64> {
    let scene = Scene::new(target).unwrap();
    let mut out = vec![0.0; scene.weight_count()];
    scene.evaluator().direct(sun, view, &mut out).unwrap();
    out
}

/// Truth: `exact_direct` of the comparison script (independent, plain Python; fixtures/light). Tolerance 1e-9 of each material's sum, and
/// of the whole: its own snapping of heights below 1e-9 m.
#[test]
fn independent_exact_sums_of_27_views() {
    let text = std::fs::read_to_string(fixture("light/exact_sums.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let mut scenes: HashMap<String, Target> = HashMap::new();
    let mut worst = 0.0_f64;
    let vector = |v: &serde_json::Value| {
        DVec3::new(v[0].as_f64().unwrap(), v[1].as_f64().unwrap(), v[2].as_f64().unwrap())
    };
    for row in json["rows"].as_array().unwrap() {
        let name = row["scene"].as_str().unwrap();
        let target =
            scenes.entry(name.to_owned()).or_insert_with(|| Target::built_in(name).unwrap());
        let scene = Scene::new(target).unwrap();
        let mut out = vec![0.0; scene.weight_count()];
        let view = View::Distant(vector(&row["view"]));
        let done = scene.evaluator().direct(vector(&row["sun"]), view, &mut out).unwrap();
        let total: f64 = row["G"].as_object().unwrap().values().map(|g| g.as_f64().unwrap()).sum();
        for (material, g) in row["G"].as_object().unwrap() {
            let number = target
                .materials
                .iter()
                .position(|m| m.name.trim_end_matches("_cell") == material)
                .unwrap();
            let ours: f64 = out[scene.weights_of(number)].iter().sum();
            let error = (ours - g.as_f64().unwrap()).abs() / total.max(1e-3);
            worst = worst.max(error);
            assert!(error < 1e-9, "{row} {material}: {ours}");
        }
        assert!(done.error < 1e-9, "{done:?}");
    }
    eprintln!("worst difference {worst:.1e}");
    assert_eq!(json["rows"].as_array().unwrap().len(), 27);
}

fn at_phase(sun: DVec3, toward: DVec3, phase: f64) -> DVec3 {
    let across = (toward - toward.dot(sun) * sun).normalize();
    sun * phase.cos() + across * phase.sin()
}

/// Truth: 2/(3π) (sin γ + (π−γ) cos γ) R² (Russell 1916). 1e-9 (of the value) in closed form; a mesh of 20,480 triangles errs by its facets: stated
/// 1e-3 of the full sphere (measured and printed).
#[test]
fn lambert_spheres_in_closed_form_and_in_facets() {
    let ball = target(vec![(Shape::Sphere { radius_m: 1.5 }, DVec3::new(0.1, 0.2, 0.3))]);
    let mesh = Shape::Mesh(icosphere(1.5, 5, Faceting::SameArea));
    let mesh = target(vec![(mesh, DVec3::ZERO)]);
    let sun = DVec3::new(0.3, -0.5, 0.8).normalize();
    let mut worst = 0.0_f64;
    for phase_deg in [0.0, 1e-4, 10.0, 45.0, 90.0, 120.0, 150.0, 175.0, 179.0, 179.9_f64] {
        let phase = phase_deg.to_radians();
        let view = View::Distant(at_phase(sun, DVec3::X, phase));
        // Where both terms all but cancel, their series.
        let e = PI - phase;
        let lit = if e < 0.02 {
            e.powi(3) / 3.0 * (1.0 - e * e / 10.0)
        } else {
            phase.sin() + e * phase.cos()
        };
        let truth = 2.25 * 2.0 / (3.0 * PI) * lit;
        let closed = weights(&ball, sun, view)[0];
        assert!((closed / truth - 1.0).abs() < 1e-9, "{phase_deg}: {closed} {truth}");
        let facets = weights(&mesh, sun, view)[0];
        worst = worst.max((facets - truth).abs() / (2.25 * 2.0 / 3.0));
    }
    eprintln!("20,480 facets: {worst:.1e} of the full sphere");
    assert!(worst < 1e-3);
    let report = Scene::new(&mesh).unwrap();
    assert!(report.report().convex && report.report().no_occlusion);
}

/// Truth: by hand. A box lit and seen from above; another stands on it and covers a quarter; coplanar sides of both are one plane.
#[test]
fn touching_boxes_by_hand() {
    let both = target(vec![(boxed(2.0), DVec3::ZERO), (boxed(1.0), DVec3::new(0.5, 0.5, 1.5))]);
    let up = View::Distant(DVec3::Z);
    let w = weights(&both, DVec3::Z, up);
    assert!((w[0] - 3.0 / PI).abs() < 1e-12 && (w[1] - 1.0 / PI).abs() < 1e-12, "{w:?}");
    // Sun at 45° over −x: the small box's shadow falls beyond the edge; seen from above.
    let sun = DVec3::new(-1.0, 0.0, 1.0).normalize();
    let w = weights(&both, sun, up);
    assert!((w[0] - 3.0 / PI * sun.z).abs() < 1e-12, "{w:?}");
    // From +x the shadow, 1 m long and 1 m wide, lies on the large box.
    let sun = DVec3::new(1.0, 0.0, 1.0).normalize();
    let w = weights(&both, sun, up);
    assert!((w[0] - 2.0 / PI * sun.z).abs() < 1e-12, "{w:?}");
}

/// Truth: by hand. Light from behind, opposition, the Sun in a face's plane, an observer behind; all exact.
#[test]
fn directions_without_light() {
    let cube = target(vec![(boxed(1.0), DVec3::ZERO)]);
    let sheet = target(vec![(Shape::Mesh(plate(DVec2::ONE, true, false)), DVec3::ZERO)]);
    let far = View::Distant;
    assert_eq!(weights(&cube, DVec3::Z, far(-DVec3::Z)), [0.0]);
    assert_eq!(weights(&sheet, -DVec3::Z, far(DVec3::Z)), [0.0]);
    assert_eq!(weights(&sheet, -DVec3::Z, far(-DVec3::Z)), [0.0]);
    assert_eq!(weights(&sheet, DVec3::X, far(DVec3::Z)), [0.0]);
    assert!((weights(&sheet, DVec3::Z, far(DVec3::Z))[0] - 1.0 / PI).abs() < 1e-15);
    // Grazing to rounding: nothing but the cosine.
    for small in [1e-3, 1e-6, 1e-9, 1e-12] {
        let sun = DVec3::new(1.0, 0.0, small).normalize();
        let w = weights(&cube, sun, far(DVec3::Z))[0];
        assert!((w * PI / small - 1.0).abs() < 1e-3, "{small}: {w}");
    }
    let empty = weights(&Target::default(), DVec3::Z, far(DVec3::Z));
    assert!(empty.is_empty());
}

/// Truth: by hand. A plate of two sides and no thickness lights on both; an open sheet hides with its back.
#[test]
fn plates_without_thickness() {
    let both = target(vec![(Shape::Mesh(plate(DVec2::ONE, true, true)), DVec3::ZERO)]);
    for d in [DVec3::Z, -DVec3::Z] {
        assert!((weights(&both, d, View::Distant(d))[0] - 1.0 / PI).abs() < 1e-15);
    }
    let down = Mesh {
        triangles: plate(DVec2::ONE, true, false)
            .triangles
            .iter()
            .map(|t| [t[0], t[2], t[1]])
            .collect(),
        ..plate(DVec2::ONE, true, false)
    };
    let over = target(vec![
        (Shape::Mesh(plate(DVec2::splat(2.0), true, false)), DVec3::ZERO),
        (Shape::Mesh(down), DVec3::new(0.2, -0.3, 1.0)),
    ]);
    let w = weights(&over, DVec3::Z, View::Distant(DVec3::Z));
    assert!((w[0] - 3.0 / PI).abs() < 1e-12 && w[1] == 0.0, "{w:?}");
}

/// Truth: by hand. Two sheets in one plane that look the same way: what the later covers belongs to it, and nothing counts twice.
#[test]
fn coplanar_faces_count_once() {
    let sheet = |size| Shape::Mesh(plate(DVec2::splat(size), true, false));
    let both = target(vec![(sheet(2.0), DVec3::ZERO), (sheet(1.0), DVec3::new(0.25, 0.0, 0.0))]);
    let w = weights(&both, DVec3::Z, View::Distant(DVec3::Z));
    assert!((w[0] - 3.0 / PI).abs() < 1e-12 && (w[1] - 1.0 / PI).abs() < 1e-12, "{w:?}");
    let scene = Scene::new(&both).unwrap();
    assert!(
        scene.report().warnings.iter().any(|w| w.contains("1.000e0 m²")),
        "{:?}",
        scene.report()
    );
}

/// Truth: areas by hand. Slivers of 1e6:1 make up a square as two triangles do; millimetre boxes on a 10 m box.
#[test]
fn slivers_and_small_parts() {
    let n = 1000;
    let mut mesh = Mesh::default();
    for k in 0..=n {
        let x = f64::from(k) / f64::from(n) * 1e-3 - 0.5e-3;
        mesh.vertices.extend([DVec3::new(x, -0.5, 0.0), DVec3::new(x, 0.5, 0.0)]);
    }
    for k in 0..n as u32 {
        let a = 2 * k;
        mesh.triangles.extend([[a, a + 2, a + 3], [a, a + 3, a + 1]]);
    }
    let w =
        weights(&target(vec![(Shape::Mesh(mesh), DVec3::ZERO)]), DVec3::Z, View::Distant(DVec3::Z));
    assert!((w[0] * PI / 1e-3 - 1.0).abs() < 1e-12, "{w:?}");
    let small =
        target(vec![(boxed(10.0), DVec3::ZERO), (boxed(1e-3), DVec3::new(1.0, 2.0, 5.0005))]);
    let sun = DVec3::new(1.0, 0.0, 1.0).normalize();
    let w = weights(&small, sun, View::Distant(DVec3::Z));
    // Its foot and its shadow, 1 mm² each.
    assert!((w[0] * PI / sun.z - (100.0 - 2e-6)).abs() < 1e-11, "{w:?}");
    assert!((w[1] * PI / sun.z / 1e-6 - 1.0).abs() < 1e-9, "{w:?}");
}

/// Checks that inputs that cannot be evaluated are refused.
#[test]
fn refusals() {
    let cube = target(vec![(boxed(1.0), DVec3::ZERO)]);
    let scene = Scene::new(&cube).unwrap();
    let mut eye = scene.evaluator();
    let mut out = [0.0];
    for bad in [DVec3::NAN, DVec3::ZERO, DVec3::new(f64::INFINITY, 0.0, 0.0)] {
        let error = eye.direct(bad, View::Distant(DVec3::Z), &mut out);
        assert!(matches!(error, Err(DirectionError::NoDirection { .. })), "{bad}");
        assert!(eye.direct(DVec3::Z, View::At(bad), &mut out).is_err());
    }
    assert!(matches!(
        eye.direct(DVec3::Z, View::Distant(DVec3::Z), &mut []),
        Err(DirectionError::Room { .. })
    ));
    let mut mirror = cube.clone();
    let fresnel = Fresnel::constant(Spectrum::constant(0.9, 300.0, 1240.0).unwrap()).unwrap();
    mirror.materials[0] = Material::mirror("mirror", fresnel);
    assert!(matches!(Scene::new(&mirror), Err(SceneError::FlatMirror { .. })));
}

/// Truth: the distant limit, to which the answer from a point converges as 1/r or faster (thesis 5.8): each tenfold distance leaves a tenth.
#[test]
fn finite_distances_converge() {
    for name in ["box_wing", "corner"] {
        let target = Target::built_in(name).unwrap();
        let (sun, to) =
            (DVec3::new(0.7, 0.5, 0.4).normalize(), DVec3::new(0.8, -0.2, 0.5).normalize());
        let far: f64 = weights(&target, sun, View::Distant(to)).iter().sum();
        let mut last = f64::INFINITY;
        for range in [1e2, 1e3, 1e4, 1e5, 1e6] {
            let near: f64 = weights(&target, sun, View::At(to * range)).iter().sum();
            let error = (near / far - 1.0).abs();
            eprintln!("{name} at {range} m: {error:.1e}");
            assert!(
                error < 6.0 / range + 1e-10 && error < 0.2 * last + 1e-10,
                "{name} {range}: {error}"
            );
            last = error;
        }
    }
}

/// Truth: a sphere behind a large sheet is dark; before a small one that shades half of it the answer is half.
#[test]
fn spheres_in_shadow() {
    let ball = |z: f64| (Shape::Sphere { radius_m: 1.0 }, DVec3::new(0.0, 0.0, z));
    let sheet = |offset| (Shape::Mesh(plate(DVec2::splat(10.0), true, true)), offset);
    let up = View::Distant(DVec3::Z);
    let full = 2.0 / 3.0;
    let w = weights(&target(vec![ball(-3.0), sheet(DVec3::ZERO)]), DVec3::Z, up);
    assert!(w[0].abs() < 2e-3 * full, "{w:?}");
    let w = weights(&target(vec![ball(-3.0), sheet(DVec3::X * 5.0)]), DVec3::Z, up);
    assert!((w[0] / full - 0.5).abs() < 2e-3, "{w:?}");
    // On the sheet: the sheet loses the disc.
    let w = weights(&target(vec![ball(3.0), sheet(DVec3::ZERO)]), DVec3::Z, up);
    assert!((w[0] / full - 1.0).abs() < 2e-3 && (w[1] * PI - (100.0 - PI)).abs() < 1e-6, "{w:?}");
}

/// Truth: the law of physics that f_r(i, o) = f_r(o, i) makes W symmetric, and that nothing changes when all turn together.
#[test]
fn reciprocity_and_turning() {
    let corner = Target::built_in("corner").unwrap();
    let (sun, to) = (DVec3::new(0.7, 0.3, 0.6).normalize(), DVec3::new(0.5, -0.5, 0.7).normalize());
    let a = weights(&corner, sun, View::Distant(to));
    let b = weights(&corner, to, View::Distant(sun));
    assert!((a[0] - b[0]).abs() < 1e-12, "{a:?} {b:?}");
    let turn = DQuat::from_euler(glam::EulerRot::ZYX, 0.4, 1.1, -2.3);
    let mut turned = corner.clone();
    for part in &mut turned.parts {
        part.placement.rotation = turn * part.placement.rotation;
        part.placement.offset_m = turn * part.placement.offset_m;
    }
    let c = weights(&turned, turn * sun, View::Distant(turn * to));
    assert!((a[0] - c[0]).abs() < 1e-12, "{a:?} {c:?}");
    turned.parts.reverse();
    let d = weights(&turned, turn * sun, View::Distant(turn * to));
    assert!((a[0] - d[0]).abs() < 1e-12, "{a:?} {d:?}");
}
