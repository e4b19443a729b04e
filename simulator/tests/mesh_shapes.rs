//! Built-in bodies against their closed forms, and what an examination finds.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::{DQuat, DVec2, DVec3};
use std::collections::HashSet;
use std::f64::consts::PI;
use sunglint_simulator::mesh::shapes::{
    Faceting, Side, Walls, corner_radius_m, cuboid, frustum, icosphere, plate,
};
use sunglint_simulator::mesh::{Fault, Mesh};

fn cube() -> Mesh {
    cuboid(DVec3::ONE, &Side::ALL)
}

/// Corners less edges plus faces, after corners in one place were made one.
fn euler_characteristic(mesh: &Mesh) -> i64 {
    let mesh = mesh.welded(1e-9);
    let mut edges = HashSet::new();
    for [a, b, c] in &mesh.triangles {
        for (p, q) in [(a, b), (b, c), (c, a)] {
            edges.insert((p.min(q), p.max(q)));
        }
    }
    let corners: HashSet<u32> = mesh.triangles.iter().flatten().copied().collect();
    corners.len() as i64 - edges.len() as i64 + mesh.triangles.len() as i64
}

fn assert_closed(mesh: &Mesh) {
    let report = mesh.examine();
    assert!(report.all_closed(), "{report:?}");
    assert_eq!((report.components.len(), &report.faults[..]), (1, &[][..]));
    assert_eq!(euler_characteristic(mesh), 2);
}

#[track_caller]
fn close(value: f64, truth: f64, relative: f64) {
    assert!((value - truth).abs() <= relative * truth.abs(), "{value} for {truth}");
}

/// Truth: closed forms of volume and area; 2 is the Euler characteristic of what is like a sphere. Tolerance: rounding of sums
/// of up to 64 terms.
#[test]
fn boxes_prisms_cylinders_and_cones_have_their_volume_and_area() {
    let mesh = cuboid(DVec3::new(1.0, 2.0, 3.0), &Side::ALL);
    assert_closed(&mesh);
    close(mesh.signed_volume_m3(), 6.0, 1e-15);
    close(mesh.area_m2(), 22.0, 1e-15);

    for n in [3, 6, 7, 64] {
        let (r, h) = (0.7, 1.3);
        let half = PI / n as f64;
        // The regular polygon of n corners on a circle, its sides, and the distance of those from the middle.
        let base = |r: f64| n as f64 * r * r * half.sin() * half.cos();
        let side = |r: f64| 2.0 * r * half.sin();
        let inner = |r: f64| r * half.cos();
        let prism = frustum(r, r, h, n, &Walls::default());
        assert_closed(&prism);
        close(prism.signed_volume_m3(), base(r) * h, 1e-14);
        close(prism.area_m2(), 2.0 * base(r) + n as f64 * side(r) * h, 1e-14);

        let s = 0.25;
        let slant = h.hypot(inner(r) - inner(s));
        for (low, high) in [(r, s), (s, r)] {
            let cone = frustum(low, high, h, n, &Walls::default());
            assert_closed(&cone);
            let volume = h / 3.0 * (base(r) + base(s) + (base(r) * base(s)).sqrt());
            close(cone.signed_volume_m3(), volume, 1e-14);
            let walls = n as f64 * 0.5 * (side(r) + side(s)) * slant;
            close(cone.area_m2(), base(r) + base(s) + walls, 1e-14);
        }
        for (low, high) in [(r, 0.0), (0.0, r)] {
            let tip = frustum(low, high, h, n, &Walls::default());
            assert_closed(&tip);
            close(tip.signed_volume_m3(), base(r) * h / 3.0, 1e-14);
            let walls = n as f64 * 0.5 * side(r) * h.hypot(inner(r));
            close(tip.area_m2(), base(r) + walls, 1e-14);
        }
        // The perimeter of a circle.
        let wide = corner_radius_m(r, n, Faceting::SameArea);
        close(n as f64 * side(wide), 2.0 * PI * r, 1e-14);
    }
    // Side 0 of a prism faces +x.
    let walls = Walls { top: false, bottom: false, sides: Some(vec![0]) };
    let side = frustum(1.0, 1.0, 1.0, 6, &walls);
    assert!(side.normal(0).unwrap().distance(DVec3::X) < 1e-15 && side.triangles.len() == 2);
}

/// Truth: 4πr² by construction where the area is kept; else the error of a triangle whose corners lie on the sphere, whose leading
/// term falls by 4 with each subdivision.
#[test]
fn spheres_are_closed_and_converge() {
    let mut last = 1.0;
    for n in 0..6 {
        let sphere = icosphere(2.0, n, Faceting::Inscribed);
        assert_eq!(sphere.triangles.len(), 20 * 4_usize.pow(n));
        assert_closed(&sphere);
        let error = 1.0 - sphere.area_m2() / (16.0 * PI);
        assert!(error > 0.0 && (n < 2 || (3.8..4.2).contains(&(last / error))), "{n}: {error}");
        last = error;
        let areas = (0..sphere.triangles.len()).map(|t| sphere.area_vector(t).length());
        let (least, most) = areas.fold((f64::MAX, 0.0_f64), |(a, b), x| (a.min(x), b.max(x)));
        assert!(most / least < 1.9, "{n}: {}", most / least);
        for t in 0..sphere.triangles.len() {
            let [a, b, c] = sphere.corners(t);
            assert!(sphere.normal(t).unwrap().dot(a + b + c) > 0.0);
        }
    }
    let same = icosphere(2.0, 3, Faceting::SameArea);
    close(same.area_m2(), 16.0 * PI, 1e-14);
}

#[test]
fn a_plate_is_two_faces_back_to_back() {
    let sheet = plate(DVec2::new(2.0, 3.0), true, true);
    assert_eq!(sheet.triangles.len(), 4);
    close(sheet.area_m2(), 12.0, 1e-15);
    assert_eq!(sheet.signed_volume_m3(), 0.0);
    let normals: Vec<DVec3> = (0..4).map(|t| sheet.normal(t).unwrap()).collect();
    assert_eq!(normals, [DVec3::Z, DVec3::Z, DVec3::NEG_Z, DVec3::NEG_Z]);
    let report = sheet.examine();
    assert!(report.all_closed() && report.faults.is_empty(), "{report:?}");
    let front = plate(DVec2::ONE, true, false).examine();
    assert!(!front.all_closed());
    assert!(matches!(&front.faults[..], [Fault::Open { found, length_m }]
        if found.count == 4 && (length_m - 4.0).abs() < 1e-15));
}

/// Truth: what a rigid motion, a factor and a mirror do to volume and area.
#[test]
fn meshes_are_moved_scaled_flipped_and_merged() {
    let body = frustum(1.0, 0.5, 2.0, 12, &Walls::default());
    let (volume, area) = (body.signed_volume_m3(), body.area_m2());
    let turn = DQuat::from_xyzw(0.1, -0.7, 0.3, 0.6).normalize();
    // Far away, single precision would lose it: the volume is taken about the middle.
    let moved = body.transformed(turn, DVec3::new(1e6, -2e6, 3e6));
    close(moved.signed_volume_m3(), volume, 1e-9);
    close(moved.area_m2(), area, 1e-9);
    close(body.scaled(3.0).signed_volume_m3(), 27.0 * volume, 1e-14);
    close(body.scaled(-3.0).signed_volume_m3(), 27.0 * volume, 1e-14);
    close(body.flipped().signed_volume_m3(), -volume, 1e-14);
    let far = body.transformed(turn, DVec3::splat(10.0));
    let both = Mesh::merged([&body, &far]);
    close(both.area_m2(), 2.0 * area, 1e-14);
    let report = both.examine();
    assert_eq!((report.components.len(), report.component_of(0)), (2, Some(0)));
    assert_eq!(report.component_of(body.triangles.len()), Some(1));
    close(report.components[1].signed_volume_m3, volume, 1e-12);
    assert_eq!(both.welded(1e-9).triangles.len(), both.triangles.len());
    assert!(Mesh::default().bounds().is_none() && Mesh::default().centroid().is_none());
    assert_eq!(Mesh::default().examine().faults, [Fault::Empty]);
}

fn faults(mesh: &Mesh) -> Vec<String> {
    mesh.examine().faults.iter().map(ToString::to_string).collect()
}

#[test]
fn each_fault_is_found_and_named() {
    let one = |mesh: &Mesh, text: &str| {
        let faults = faults(mesh);
        assert!(faults.len() == 1 && faults[0].contains(text), "{text}: {faults:?}");
    };
    one(&cube().flipped(), "1 closed pieces face inwards (first: triangle 0");
    one(
        &cube().scaled(1000.0),
        "it measures 1000.0 m, which looks like millimetres: give unit = \"mm\"",
    );
    one(&cube().scaled(1e-4), "it measures 1.00e-4 m");

    // A hollow body: the inner wall faces inwards by right.
    let hollow = Mesh::merged([&cube(), &cube().scaled(0.5).flipped()]);
    let report = hollow.examine();
    assert!(report.all_closed() && report.faults.is_empty(), "{:?}", report.faults);

    let mut open = cube();
    open.triangles.pop();
    one(&open, "it is open: 3 edges have a triangle on one side only");
    assert!(!open.examine().closed(0));
    // The length of the border: two edges of a cube and a diagonal.
    let Some(Fault::Open { length_m, .. }) = open.examine().faults.pop() else { panic!() };
    close(length_m, 2.0 + 2.0_f64.sqrt(), 1e-15);

    let mut twice = cube();
    let [a, b, c] = twice.triangles[4];
    twice.triangles.push([b, c, a]);
    let found = faults(&twice);
    assert!(found[0].contains("1 triangles are there twice (first: triangle 12"), "{found:?}");
    assert!(found[0].contains("the same as triangle 4"), "{found:?}");

    let mut turned = cube();
    let [a, b, c] = turned.triangles[0];
    turned.triangles[0] = [a, c, b];
    one(&turned, "3 edges have neighbours that face opposite ways");
    assert!(!turned.examine().closed(0));

    let mut bad = cube();
    bad.triangles[3][1] = 99;
    one(&bad, "1 triangles name corners that are not there (first: triangle 3)");
    let mut nan = cube();
    nan.vertices[0].x = f64::NAN;
    one(
        &nan,
        "2 triangles have coordinates that are not finite or beyond 1e15 m (first: triangle 0)",
    );

    // Two cubes that share an edge: four triangles on it (its two ends and their diagonals' sides). Each stays closed.
    let touching =
        Mesh::merged([&cube(), &cube().transformed(DQuat::IDENTITY, DVec3::new(1.0, 1.0, 0.0))]);
    one(&touching, "1 edges belong to three triangles or more");
    let report = touching.examine();
    assert!(report.all_closed() && report.components.len() == 2, "{report:?}");

    let mut loose = cube();
    loose.vertices[0] += 5e-9;
    one(&loose, "2 corners lie within 2.5e-7 m of another");
    assert!(loose.examine().all_closed());
    assert!(loose.welded(1e-7).examine().faults.is_empty());
    loose.vertices[0] += 1e-3;
    assert!(!loose.examine().all_closed());
}

/// Slivers: 10⁶ times as long as high is a needle with an area; no height at all is none.
#[test]
fn needles_and_triangles_without_area_are_told_apart() {
    let sliver = |height: f64| Mesh {
        vertices: vec![DVec3::ZERO, DVec3::X, DVec3::new(0.5, height, 0.0)],
        triangles: vec![[0, 1, 2]],
        ..Mesh::default()
    };
    let needle = sliver(1e-6).examine();
    assert!(matches!(needle.faults[0], Fault::Needle { worst, .. } if (worst - 1e6).abs() < 1.0));
    assert!(matches!(sliver(0.0).examine().faults[0], Fault::NoArea { .. }));
    assert!(matches!(sliver(1e-13).examine().faults[0], Fault::NoArea { .. }));
    assert!(!matches!(sliver(1e-3).examine().faults[0], Fault::Needle { .. }));
    // Two corners in one place hang on nothing, and do not open the body beside them.
    let mut extra = cube();
    extra.triangles.push([0, 0, 1]);
    let report = extra.examine();
    assert_eq!((report.component_of(12), report.closed(12), report.closed(0)), (None, false, true));
}

/// Two sheets of one plane, one half over the other: by hand, which of their triangles share area. Facing each other, or beside each other,
/// they are no fault; nor is a hair of 10⁻⁷ m that rounding may give two neighbours.
#[test]
fn faces_that_cover_each_other_in_one_plane_are_found() {
    let turn = DQuat::from_xyzw(0.4, -0.2, 0.8, 0.3).normalize();
    let beside = |x: f64, mesh: &Mesh| {
        let moved = mesh.transformed(DQuat::IDENTITY, DVec3::new(x, 0.0, 0.0));
        let both = Mesh::merged([&plate(DVec2::ONE, true, false), &moved]);
        both.transformed(turn, DVec3::splat(0.7)).examine()
    };
    let covered = |report: &sunglint_simulator::mesh::Report| {
        report.faults.iter().find_map(|fault| match fault {
            Fault::Overlap { found, other } => Some((found.count, found.triangle, *other)),
            _ => None,
        })
    };
    let front = plate(DVec2::ONE, true, false);
    // Of the four pairs all but one share area: the upper left of the first and the lower right of the second cannot meet.
    assert_eq!(covered(&beside(0.5, &front)), Some((3, 2, 0)));
    assert_eq!(covered(&beside(1.0, &front)), None);
    assert_eq!(covered(&beside(1.0 - 1e-7, &front)), None);
    assert_eq!(covered(&beside(0.5, &front.flipped())), None);
    assert_eq!(covered(&beside(0.5, &front.transformed(DQuat::IDENTITY, 1e-4 * DVec3::Z))), None);
}

/// A wall in strips beside a wall in one piece: edges meet within their length, and nothing is open.
#[test]
fn t_junctions_close_a_body() {
    let ends = cuboid(
        DVec3::new(1.0, 1.0, 2.0),
        &[Side::ALL[2], Side::ALL[3], Side::ALL[4], Side::ALL[5]],
    );
    let strip = |low: f64, high: f64| {
        cuboid(DVec3::new(1.0, 1.0, high - low), &Side::ALL[..2])
            .transformed(DQuat::IDENTITY, DVec3::new(0.0, 0.0, 0.5 * (low + high)))
    };
    let body = Mesh::merged([&ends, &strip(-1.0, -0.2), &strip(-0.2, 0.4), &strip(0.4, 1.0)]);
    let turned = body.transformed(DQuat::from_xyzw(0.4, -0.2, 0.8, 0.3).normalize(), DVec3::ONE);
    for mesh in [&body, &turned] {
        let report = mesh.examine();
        assert!(report.all_closed() && report.components.len() == 1, "{report:?}");
        close(report.components[0].signed_volume_m3, 2.0, 1e-14);
        // The long edges of the y walls, and those of the strips: 4 and 12.
        let [Fault::Joints { found }] = &report.faults[..] else { panic!("{:?}", report.faults) };
        assert_eq!(found.count, 16);
    }
    // In single precision too, where no corner lies on another's edge any more.
    let mut rounded = turned.clone();
    for corner in &mut rounded.vertices {
        *corner = corner.as_vec3().as_dvec3();
    }
    assert!(rounded.examine().all_closed(), "{:?}", rounded.examine());
    // Without its middle the body is open, and so is what hangs on it.
    let gap = Mesh::merged([&ends, &strip(-1.0, -0.2), &strip(0.4, 1.0)]);
    assert!(!gap.examine().all_closed());
    assert!((0..gap.triangles.len()).all(|t| !gap.examine().closed(t)));
}

/// Every edge of a soup is open, and a soup of many takes no more than a moment.
#[test]
fn a_soup_is_examined_too() {
    let mut soup = Mesh::default();
    for k in 0..40_000 {
        let at = DVec3::new(f64::from(k % 200), f64::from(k / 200), 0.0);
        let first = soup.vertices.len() as u32;
        soup.vertices.extend([at, at + 0.5 * DVec3::X, at + 0.5 * DVec3::Y]);
        soup.triangles.push([first, first + 1, first + 2]);
    }
    let report = soup.examine();
    assert_eq!(report.components.len(), 40_000);
    assert!(matches!(report.faults[0], Fault::Open { found, .. } if found.count == 120_000));
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(64))]

    /// Checks that the nature of a body does not depend on where it stands, in which order its triangles come, or where each of them begins.
    #[test]
    fn an_examination_does_not_depend_on_place_and_order(
        turn in proptest::array::uniform4(-1.0..1.0_f64),
        offset in proptest::array::uniform3(-5.0..5.0_f64),
        order in 0..1000_usize,
        kind in 0..4_usize,
    ) {
        let turn = DQuat::from_array(turn);
        proptest::prop_assume!(turn.length() > 0.1);
        let body = match kind {
            0 => cube(),
            1 => frustum(1.0, 0.5, 2.0, 9, &Walls { top: false, ..Walls::default() }),
            2 => Mesh::merged([&cube(), &icosphere(0.3, 2, Faceting::Inscribed)]),
            _ => Mesh::merged([&cube(), &plate(DVec2::new(3.0, 3.0), true, false)]),
        };
        let truth = body.examine();
        let mut moved = body.transformed(turn.normalize(), DVec3::from_array(offset));
        let count = moved.triangles.len();
        // A stride without a common factor with the count visits every triangle.
        let stride = (1..).map(|k| k + order).find(|s| gcd(*s, count) == 1).unwrap();
        moved.triangles = (0..count)
            .map(|k| {
                let mut t = moved.triangles[(k * stride) % count];
                t.rotate_left(k % 3);
                t
            })
            .collect();
        let found = moved.examine();
        proptest::prop_assert_eq!(found.components.len(), truth.components.len());
        for k in 0..count {
            let was = (k * stride) % count;
            proptest::prop_assert_eq!(found.closed(k), truth.closed(was));
        }
        let volume = |report: &sunglint_simulator::mesh::Report| -> f64 {
            report.components.iter().filter(|c| c.closed).map(|c| c.signed_volume_m3).sum()
        };
        proptest::prop_assert!((volume(&found) - volume(&truth)).abs() < 1e-12);
        proptest::prop_assert_eq!(found.faults.len(), truth.faults.len());
    }
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// Truth: the count of what was put there, and a limit of time that an examination by the square (pieces, or pairs of copies) or
/// the memory for it would exceed by a hundred.
#[test]
fn soups_copies_and_fans_are_examined_in_time() {
    let start = std::time::Instant::now();
    let mut soup = Mesh::default();
    for i in 0..60_000_u32 {
        let o = DVec3::new(f64::from(i % 250), f64::from(i / 250), 0.0) * 0.1;
        soup.vertices.extend([o, o + 0.05 * DVec3::X, o + 0.05 * DVec3::Y]);
        soup.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    assert_eq!(soup.examine().components.len(), 60_000);

    let vertices = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
    let copies = Mesh { vertices, triangles: vec![[0, 1, 2]; 5000], ..Mesh::default() };
    let faults = copies.examine().faults;
    let twice = |f: &Fault| matches!(f, Fault::Duplicate { found, .. } if found.count == 4999);
    assert!(faults.iter().any(twice), "{faults:?}");
    assert!(!faults.iter().any(|f| matches!(f, Fault::Overlap { .. })), "{faults:?}");

    // Edges along one line, each within the next.
    let mut fan = Mesh::default();
    for i in 0..6000_u32 {
        let x = 1.0 + 1e-4 * f64::from(i);
        let tip = DVec3::new(0.0, x.cos(), x.sin());
        fan.vertices.extend([DVec3::new(-x, 0.0, 0.0), DVec3::new(x, 0.0, 0.0), tip]);
        fan.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    assert!(!fan.examine().all_closed());
    assert!(start.elapsed().as_secs_f64() < 6.0, "{:?}", start.elapsed());
}
