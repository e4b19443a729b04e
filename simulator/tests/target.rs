//! Targets: files, built-in ones, hinges, export.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::{DQuat, DVec3};
use std::f64::consts::{FRAC_PI_2, PI};
use std::fs;
use sunglint_simulator::mesh::{Mesh, read};
use sunglint_simulator::target::file::{TargetFile, target};
use sunglint_simulator::target::{Hinge, Shape, Target};
use sunglint_testkit::fixture;

/// `built_in` says `None` for names that it does not know, and for no others.
#[test]
fn every_built_in_target_is_read_without_a_warning() {
    for name in Target::built_in_names() {
        let text = Target::built_in_text(name).unwrap();
        let target = Target::parse(name, text).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((target.name.as_str(), &target.warnings[..]), (name, &[][..]));
        assert_eq!(Target::built_in(name).unwrap().parts.len(), target.parts.len());
        // All bodies are closed, though each of their materials has a part of its own.
        let closed = target.closed_triangles();
        assert!(closed.iter().flatten().all(|closed| *closed), "{name}");
    }
    assert!(Target::built_in("box_wings").is_none());
}

fn whole(target: &Target, angles_rad: &[f64]) -> Mesh {
    let meshes: Vec<Mesh> =
        (0..target.parts.len()).map(|part| target.part_mesh(part, angles_rad)).collect();
    Mesh::merged(&meshes)
}

/// Truth: volumes and areas of the boxes and prisms that the targets are made of, by hand. Tolerance: rounding.
#[test]
fn built_in_targets_have_the_volume_and_area_of_their_boxes() {
    let close = |name: &str, volume: f64, area: f64| {
        let mesh = whole(&Target::built_in(name).unwrap(), &[]);
        assert!((mesh.signed_volume_m3() - volume).abs() < 1e-13, "{name}");
        assert!((mesh.area_m2() - area).abs() < 1e-13, "{name}: {}", mesh.area_m2());
    };
    let cuboid = |x: f64, y: f64, z: f64| (x * y * z, 2.0 * (x * y + y * z + z * x));
    let (body, wing) = (cuboid(1.0, 1.0, 2.0), cuboid(0.02, 2.0, 1.2));
    close("box_wing", body.0 + 2.0 * wing.0, body.1 + 2.0 * wing.1);
    close("box_wing_diffuse", body.0 + 2.0 * wing.0, body.1 + 2.0 * wing.1);
    let (floor, wall, small) =
        (cuboid(1.0, 1.0, 0.02), cuboid(0.02, 1.0, 1.02), cuboid(0.3, 0.3, 0.3));
    close("corner", floor.0 + wall.0 + small.0, floor.1 + wall.1 + small.1);
    let body = cuboid(1.0, 1.0, 1.3);
    close("box_with_panels", body.0, body.1 + 4.0 * 0.9 * 1.7);
    // A hexagon of width w has the area √3/2 w² and the perimeter 2√3 w.
    let root3 = 3.0_f64.sqrt();
    let (base, around) = (root3 / 2.0 * 1.44, 2.0 * root3 * 1.2);
    let panel = cuboid(1.6, 1.0, 0.02);
    let (low, high, n, h) = (0.12_f64, 0.35_f64, 24.0, 0.3_f64);
    let half = PI / n;
    let polygon = |r: f64| n * r * r * half.sin() * half.cos();
    let slant = h.hypot((high - low) * half.cos());
    let dish = h / 3.0 * (polygon(low) + polygon(high) + n * low * high * half.sin() * half.cos());
    let dish_area = polygon(low) + polygon(high) + n * (low + high) * half.sin() * slant;
    close(
        "hexagon",
        base * 1.6 + 2.0 * panel.0 + dish,
        2.0 * base + around * 1.6 + 2.0 * panel.1 + dish_area,
    );
}

const WING: &str = r#"
name = "wing"
[[hinge]]
name = "boom"
point_m = [0, 0, 1]
axis = [0, 2, 0]
face = [1, 0, 1e-7]
range_deg = [-90, 45]

[[material]]
name = "paint"
model = "lambert"
reflectance = 0.5

[[part]]
name = "panel"
shape = "plate"
size_m = [2, 1]
faces = ["+z"]
material = "paint"
euler_zyx_deg = [0, 90, 0]
offset_m = [0, 3, 1.5]
tangent = [0, 5, 0]
hinge = "boom"
"#;

/// Truth: by hand. The panel's normal z turns by 90° about y to x; at the hinge's 90° it turns on to −z; its middle, half a metre above the
/// axis, moves from (0, 3, 1.5) to (0.5, 3, 1).
#[test]
fn parts_are_turned_then_moved_then_hinged() {
    let target = Target::parse("wing.toml", WING).unwrap();
    assert_eq!(target.materials[0].name, "paint");
    assert_eq!(target.hinges[0].axis, DVec3::Y);
    assert_eq!((target.hinges[0].face.y, target.parts[0].tangent), (0.0, DVec3::Y));
    let at = |angle: f64| {
        let mesh = target.part_mesh(0, &[angle]);
        (mesh.normal(0).unwrap(), mesh.centroid().unwrap())
    };
    let (normal, centre) = at(0.0);
    assert!(
        normal.distance(DVec3::X) < 1e-15 && centre.distance(DVec3::new(0.0, 3.0, 1.5)) < 1e-15
    );
    let (normal, centre) = at(FRAC_PI_2);
    assert!(normal.distance(DVec3::NEG_Z) < 1e-15, "{normal}");
    assert!(centre.distance(DVec3::new(0.5, 3.0, 1.0)) < 1e-15, "{centre}");

    // Intrinsic z, then the new y, then the newest x: the matrices Rz Ry Rx, written out.
    let [a, b, c] = [0.3_f64, -0.7, 1.9];
    let text = format!(
        "[[part]]\nname = \"p\"\nshape = \"plate\"\nsize_m = [1, 1]\nmaterial = \"white\"\neuler_zyx_deg = [{}, {}, {}]\n",
        a.to_degrees(),
        b.to_degrees(),
        c.to_degrees()
    );
    let placed = Target::parse("p.toml", text).unwrap();
    assert_eq!(placed.name, "p");
    let rotation = placed.parts[0].placement.rotation;
    let x = DVec3::new(a.cos() * b.cos(), a.sin() * b.cos(), -b.sin());
    let z = DVec3::new(
        a.cos() * b.sin() * c.cos() + a.sin() * c.sin(),
        a.sin() * b.sin() * c.cos() - a.cos() * c.sin(),
        b.cos() * c.cos(),
    );
    assert!((rotation * DVec3::X).distance(x) < 1e-15 && (rotation * DVec3::Z).distance(z) < 1e-15);
}

fn hinge(range_deg: Option<[f64; 2]>) -> Hinge {
    Hinge {
        name: "h".into(),
        point_m: DVec3::ZERO,
        axis: DVec3::Z,
        face: DVec3::X,
        range_rad: range_deg.map(|[a, b]| (a.to_radians(), b.to_radians())),
    }
}

/// Truth: by definition, from vectors alone: the wing's normal, projected on the plane across the axis, stands the offset past the Sun's projection; a parked wing stands
/// at its angle. Tolerance: rounding.
#[test]
fn a_wing_lags_shows_its_back_or_stands() {
    let with = |line: &str| WING.replace("range_deg = [-90, 45]", line);
    for offset in [-12.0_f64, 0.0, 40.0, 180.0] {
        let text = with(&format!("offset_deg = {offset}"));
        let target = Target::parse("wing.toml", text).unwrap();
        for k in 0..36 {
            let azimuth = f64::from(10 * k).to_radians();
            let sun = DVec3::new(azimuth.cos(), 0.4, azimuth.sin()).normalize();
            let normal = target.part_mesh(0, &target.hinge_angles_rad(sun)).normal(0).unwrap();
            let (flat, normal) =
                (DVec3::new(sun.x, 0.0, sun.z), DVec3::new(normal.x, 0.0, normal.z));
            let past = flat.cross(normal).y.atan2(flat.dot(normal)).to_degrees();
            let miss = (past - offset + 180.0).rem_euclid(360.0) - 180.0;
            assert!(miss.abs() < 1e-5, "{offset} {azimuth}: {past}");
        }
    }
    let parked = Target::parse("wing.toml", with("parked_deg = 30")).unwrap();
    for sun in [DVec3::X, DVec3::NEG_Z, DVec3::new(-0.6, 0.0, 0.8)] {
        assert!((parked.hinge_angles_rad(sun)[0].to_degrees() - 30.0).abs() < 1e-12);
    }
    let both = Target::parse("wing.toml", with("parked_deg = 30\noffset_deg = 1"));
    assert!(both.unwrap_err().to_string().contains("parked_deg"));
    let far = Target::parse("wing.toml", with("offset_deg = 1e9"));
    assert!(far.unwrap_err().to_string().contains("offset_deg"));
}

/// Truth: the best of a fine grid of angles in the range, by the cosine between face and Sun. Tolerance: the grid's 0.01°, as a cosine.
#[test]
fn a_hinge_faces_the_sun_as_well_as_it_can() {
    let ranges = [
        None,
        Some([-180.0, 180.0]),
        Some([-90.0, 45.0]),
        Some([100.0, 260.0]),
        Some([-360.0, -300.0]),
        Some([30.0, 30.0]),
        Some([-10.0, 359.0]),
    ];
    for range in ranges {
        let hinge = hinge(range);
        for k in 0..72 {
            let azimuth = f64::from(5 * k - 180).to_radians();
            let sun = DVec3::new(azimuth.cos(), azimuth.sin(), 0.7).normalize();
            let angle = hinge.angle_rad(sun);
            let facing = |angle: f64| {
                let face = DQuat::from_axis_angle(DVec3::Z, angle) * DVec3::X;
                face.dot(sun)
            };
            let [least, most] = range.unwrap_or([-180.0, 180.0]);
            assert!((least - 1e-9..=most + 1e-9).contains(&angle.to_degrees()), "{range:?}");
            let steps = ((most - least) / 0.01).round() as u32;
            let best = (0..=steps)
                .map(|i| facing((least + 0.01 * f64::from(i)).to_radians()))
                .fold(-1.0, f64::max);
            assert!(facing(angle) >= best - 1e-9, "{range:?} {azimuth}: {angle}");
            assert!(facing(angle) <= best + 2e-8, "{range:?} {azimuth}: {angle}");
        }
    }
    // On the axis all angles are as good: 0, or the end of the range that is nearer to it.
    assert_eq!(hinge(None).angle_rad(DVec3::Z), 0.0);
    assert_eq!(hinge(Some([-90.0, 45.0])).angle_rad(DVec3::NEG_Z), 0.0);
    assert_eq!(hinge(Some([30.0, 90.0])).angle_rad(DVec3::Z), 30_f64.to_radians());
    // Just beyond ±180° the free hinge is continuous as a direction.
    let near = |y: f64| hinge(None).angle_rad(DVec3::new(-1.0, y, 0.0).normalize());
    assert!((near(1e-9) - PI).abs() < 1e-8 && (near(-1e-9) + PI).abs() < 1e-8);
    let pair = hinge(Some([-180.0, 180.0]));
    assert!((pair.angle_rad(DVec3::NEG_X).abs() - PI).abs() < 1e-15);
    // A wing of a built-in target follows the Sun: its cells face it as far as the axis allows.
    let target = Target::built_in("box_with_panels").unwrap();
    let sun = DVec3::new(0.6, 0.3, -0.2).normalize();
    let angles = target.hinge_angles_rad(sun);
    for (part, mesh) in target.parts.iter().zip((0..).map(|p| target.part_mesh(p, &angles))).take(6)
    {
        if part.name.ends_with("cells") {
            let wanted = (sun - DVec3::Y * sun.y).normalize();
            assert!(mesh.normal(0).unwrap().distance(wanted) < 1e-14, "{}", part.name);
        }
    }
}

/// Returns the message that refuses a text which differs from [`WING`] in one place.
fn refusal(from: &str, to: &str) -> String {
    assert!(WING.contains(from), "{from}");
    Target::parse("a.toml", WING.replacen(from, to, 1)).expect_err(to).to_string()
}

#[test]
fn what_makes_no_sense_is_refused_with_line_and_key() {
    let mut others = Vec::new();
    for (from, to, answer) in [
        (
            "material = \"paint\"",
            "material = \"pain\"",
            "a.toml:20: part[0].material: found \"pain\", expected a [[material]] or built-in one: paint, ",
        ),
        ("material = \"paint\"", "material = \"pain\"", "(did you mean \"paint\"?)"),
        (
            "hinge = \"boom\"",
            "hinge = \"bom\"",
            "a.toml:24: part[0].hinge: found \"bom\", expected the name of a [[hinge]]: boom (did you mean \"boom\"?)",
        ),
        (
            "face = [1, 0, 1e-7]",
            "face = [1, 1, 0]",
            "a.toml:7: hinge[0].face: found an array of 3, expected a direction perpendicular to the axis (within 1e-6 rad) (it stands at 45.000000 degrees to the axis)",
        ),
        (
            "axis = [0, 2, 0]",
            "axis = [0, 0, 0]",
            "a.toml:6: hinge[0].axis: found an array of 3, expected a direction: not all three 0",
        ),
        (
            "[-90, 45]",
            "[45, -90]",
            "a.toml:8: hinge[0].range_deg: found an array of 2, expected [least, most]",
        ),
        ("[-90, 45]", "[-90, 400]", "a.toml:8: hinge[0].range_deg"),
        (
            "size_m = [2, 1]",
            "size_m = [2, 1, 1]",
            "part[0].size_m: found an array of 3, expected two edges [x, y]",
        ),
        (
            "size_m = [2, 1]",
            "size_m = [2, -1]",
            "a.toml:18: part[0].size_m[1]: found -1, expected a number above 0",
        ),
        (
            "size_m = [2, 1]",
            "size_m = [2, nan]",
            "a.toml:18: part[0].size_m[1]: found nan, expected a number above 0",
        ),
        ("size_m = [2, 1]", "", "part[0].size_m: found no such key, expected two edges [x, y]"),
        ("size_m = [2, 1]", "size_mm = [2, 1]", "did you mean `size_m`? 1 mm is 0.001 m"),
        (
            "faces = [\"+z\"]",
            "faces = [\"+x\"]",
            "a.toml:19: part[0].faces[0]: found \"+x\", expected a face: +z, -z",
        ),
        (
            "faces = [\"+z\"]",
            "faces = []",
            "part[0].faces: found an array of 0, expected at least one face",
        ),
        (
            "faces = [\"+z\"]",
            "faces = [\"+z\", \"+z\"]",
            "part[0].faces[1]: found \"+z\", expected each face once",
        ),
        (
            "tangent = [0, 5, 0]",
            "radius_m = 1",
            "part[0].radius_m: found 1, expected no radius_m: a plate does not use it (it belongs to sphere, cylinder, cone, prism, dish)",
        ),
        (
            "tangent = [0, 5, 0]",
            "quaternion = [1, 0, 0, 0]",
            "part[0].quaternion: found an array of 4, expected either quaternion or euler_zyx_deg, not both",
        ),
        (
            "euler_zyx_deg = [0, 90, 0]",
            "quaternion = [1, 0, 0, 1]",
            "expected a unit quaternion [w, x, y, z] (the quaternion has the length 1.414",
        ),
        ("shape = \"plate\"", "shape = \"ball\"", "a.toml:17: part[0].shape"),
        (
            "shape = \"plate\"\nsize_m = [2, 1]",
            "shape = \"mesh\"\nfile = \"no.obj\"",
            "a.toml:19: part[0].faces: found an array of 1, expected no faces",
        ),
        ("[[part]]", "[[piece]]", "a.toml:15: piece: found an unknown key"),
        (
            "name = \"wing\"",
            "file = \"other.toml\"",
            "a.toml:2: file: found \"other.toml\", expected [[part]] tables",
        ),
    ] {
        let found = refusal(from, to);
        if !found.contains(answer) {
            others.push(format!("{found}\n  not {answer}"));
        }
    }
    assert!(others.is_empty(), "{}", others.join("\n"));
    let twice = |what: &str, from: usize| {
        let table = &WING[WING.find(what).unwrap()..];
        let table = table[..table[2..].find("[[").map_or(table.len(), |end| end + 2)].to_owned();
        let error = Target::parse("a.toml", format!("{WING}\n{table}")).unwrap_err().to_string();
        assert!(
            error.contains(&format!("[1].name: found \"{}\"", ["boom", "paint", "panel"][from])),
            "{error}"
        );
        assert!(error.contains("a name that no other"), "{error}");
    };
    twice("[[hinge]]", 0);
    twice("[[material]]", 1);
    twice("[[part]]", 2);
    let error = Target::parse("a.toml", "name = \"nothing\"\n").unwrap_err().to_string();
    assert!(error.contains("at least one [[part]]"), "{error}");
    // A material or a hinge that nothing uses is a slip, and heard of.
    let idle = WING.replace("material = \"paint\"", "material = \"white\"");
    let idle = Target::parse("a.toml", idle.replace("hinge = \"boom\"", "")).unwrap();
    assert_eq!(
        idle.warnings,
        ["no part is made of the material paint", "the hinge boom moves no part"]
    );
}

fn part(keys: &str) -> String {
    format!("[[part]]\nname = \"p\"\nmaterial = \"white\"\n{keys}\n")
}

#[test]
fn shapes_of_parts_are_those_of_their_keys() {
    let shape = |keys: &str| Target::parse("a.toml", part(keys)).unwrap().parts.remove(0).shape;
    let mesh = |keys: &str| match shape(keys) {
        Shape::Mesh(mesh) => mesh,
        other => panic!("{other:?}"),
    };
    assert!(matches!(shape("shape = \"sphere\"\nradius_m = 2"), Shape::Sphere { radius_m: 2.0 }));
    let sphere =
        mesh("shape = \"sphere\"\nradius_m = 2\nsubdivisions = 3\nfaceting = \"same_area\"");
    assert!((sphere.area_m2() - 16.0 * PI).abs() < 1e-12 && sphere.triangles.len() == 1280);
    // Between opposite sides of a hexagon: 2 m along x.
    let prism = mesh("shape = \"prism\"\nwidth_m = 2\nheight_m = 1");
    assert!((prism.bounds().unwrap().size_m().x - 2.0).abs() < 1e-15);
    let cone =
        mesh("shape = \"cone\"\nradius_m = 1\nheight_m = 3\nfacets = 4\nfaces = [\"side2\"]");
    assert_eq!(cone.triangles.len(), 1);
    let tube = mesh("shape = \"cylinder\"\nradius_m = 1\nheight_m = 2\nfaces = [\"side\", \"+z\"]");
    assert_eq!(tube.triangles.len(), 64 * 2 + 62);
    let cylinder = mesh("shape = \"cylinder\"\nradius_m = 1\nheight_m = 2\nfacets = 64");
    assert_eq!(cylinder.triangles.len(), 64 * 2 + 2 * 62);
    for (keys, answer) in [
        (
            "shape = \"cone\"\nradius_m = 1\nheight_m = 3\nfaces = [\"+z\"]",
            "a face that has an area",
        ),
        ("shape = \"prism\"\nheight_m = 3", "radius_m or width_m"),
        (
            "shape = \"prism\"\nheight_m = 3\nradius_m = 1\nwidth_m = 1",
            "either radius_m or width_m",
        ),
        ("shape = \"prism\"\nheight_m = 3\nradius_m = 1\nsides = 2", "from 3 to 100000"),
        (
            "shape = \"prism\"\nheight_m = 3\nradius_m = 1\nfaces = [\"side6\"]",
            "a face: side, side0, side5, +z, -z",
        ),
        ("shape = \"cylinder\"\nheight_m = 3", "radius_m: a cylinder needs it"),
        ("shape = \"sphere\"\nradius_m = 1\nfaceting = \"inscribed\"", "also subdivisions"),
        ("shape = \"sphere\"\nradius_m = 1\nsubdivisions = 30", "at most 8"),
        ("shape = \"mesh\"", "file: a mesh needs it"),
        (
            "shape = \"mesh\"\nfile = \"no.obj\"",
            "a.toml:5: part[0].file: found \"no.obj\", expected a mesh that can be read",
        ),
    ] {
        let error = Target::parse("a.toml", part(keys)).expect_err(keys).to_string();
        assert!(error.contains(answer), "{error}\n{answer}");
    }
}

/// A mesh in millimetres, in groups, inward, loose: heard of, and mended only where the file asks for it.
#[test]
fn meshes_of_parts_are_examined_and_mended_on_request_only() {
    let folder = tempfile::tempdir().unwrap();
    fs::copy(fixture("meshes/prism.obj"), folder.path().join("prism.obj")).unwrap();
    let big = fs::read_to_string(fixture("meshes/prism.obj")).unwrap();
    let big: String = big
        .lines()
        .map(|line| match line.strip_prefix("v ") {
            Some(xyz) => {
                let mm = xyz.split(' ').map(|w| (1000.0 * w.parse::<f64>().unwrap()).to_string());
                format!("v {}\n", mm.collect::<Vec<_>>().join(" "))
            }
            None => format!("{line}\n"),
        })
        .collect();
    fs::write(folder.path().join("big.obj"), big).unwrap();
    let read = |keys: &str| {
        let file = folder.path().join("target.toml");
        fs::write(&file, part(&format!("shape = \"mesh\"\n{keys}"))).unwrap();
        Target::read(&file)
    };
    let fine = read("file = \"prism.obj\"").unwrap();
    assert!(fine.warnings.is_empty(), "{:?}", fine.warnings);
    let names: Vec<_> = fine.sources.iter().map(|s| s.0.file_name().unwrap()).collect();
    assert_eq!(names, ["target.toml", "prism.obj"]);
    assert!(fine.sources.iter().all(|source| source.1.len() == 64));

    let big = read("file = \"big.obj\"").unwrap();
    let warning = "it measures 2000.0 m, which looks like millimetres: give unit = \"mm\" (or unit = \"m\" if it is right)";
    assert!(big.warnings.len() == 1 && big.warnings[0].ends_with(warning), "{:?}", big.warnings);
    assert!(whole(&big, &[]).area_m2() > 1e7);
    let small = read("file = \"big.obj\"\nunit = \"mm\"").unwrap();
    assert!(small.warnings.is_empty() && (whole(&small, &[]).area_m2() - 22.0).abs() < 1e-12);
    assert!(read("file = \"big.obj\"\nunit = \"m\"").unwrap().warnings.is_empty());
    let half = read("file = \"big.obj\"\nunit = \"mm\"\nscale = 0.5").unwrap();
    assert!((whole(&half, &[]).signed_volume_m3() - 0.75).abs() < 1e-13);
    let inward = read("file = \"prism.obj\"\nflip = true").unwrap();
    assert!(inward.warnings[0].contains("1 closed pieces face inwards"), "{:?}", inward.warnings);
    assert!((whole(&inward, &[]).signed_volume_m3() + 6.0).abs() < 1e-13);

    let ends = read("file = \"prism.obj\"\ngroup = \"ends\"").unwrap();
    assert_eq!(whole(&ends, &[]).triangles.len(), 8);
    assert!(ends.warnings[0].contains("it is open: 12 edges"), "{:?}", ends.warnings);
    let error = |keys: &str| read(keys).expect_err(keys).to_string();
    let unknown = error("file = \"prism.obj\"\ngroup = \"wall\"");
    assert!(
        unknown.contains("empty, ends, metal, paint, prism, walls (did you mean \"walls\"?)"),
        "{unknown}"
    );
    let empty = error("file = \"prism.obj\"\ngroup = \"empty\"");
    assert!(empty.contains("with at least one triangle"), "{empty}");
    let weld = error("file = \"prism.obj\"\nweld_mm = 30");
    assert!(weld.contains("expected at most 20 mm, a hundredth of the mesh"), "{weld}");
    assert!(read("file = \"prism.obj\"\nweld_mm = 1").unwrap().warnings.is_empty());
    let unit = error("file = \"prism.obj\"\nunit = \"km\"");
    assert!(unit.contains("part[0].unit"), "{unit}");

    // Two groups as two parts close with each other, and nothing is said of either.
    let file = folder.path().join("target.toml");
    let two = ["ends", "walls"].map(|group| {
        format!("[[part]]\nname = \"{group}\"\nmaterial = \"white\"\nshape = \"mesh\"\nfile = \"prism.obj\"\ngroup = \"{group}\"\n")
    });
    fs::write(&file, two.concat()).unwrap();
    let target = Target::read(&file).unwrap();
    assert!(target.warnings.is_empty(), "{:?}", target.warnings);
    assert!(target.closed_triangles().iter().flatten().all(|closed| *closed));
    assert_eq!(target.sources.len(), 2);
}

/// A target within another file: by name, by file, or in place.
#[test]
fn a_table_of_another_file_may_hold_the_target() {
    #[derive(serde::Deserialize)]
    struct Pass {
        target: TargetFile,
    }
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("wing.toml"), WING).unwrap();
    let parse = |text: &str| {
        let path = folder.path().join("PASS.toml");
        let document = sunglint_formats::toml::Document::new(path, text).unwrap();
        let pass: Pass = document.parse().unwrap();
        target(&document, "target", &pass.target).map_err(|e| e.to_string())
    };
    assert_eq!(parse("[target]\nbuilt_in = \"corner\"\n").unwrap().parts.len(), 3);
    let named = parse("[target]\nfile = \"wing.toml\"\nname = \"mine\"\n").unwrap();
    assert_eq!((named.name.as_str(), named.sources.len()), ("mine", 1));
    let inline = "[target]\n[[target.part]]\nname = \"s\"\nshape = \"sphere\"\nradius_m = 1\nmaterial = \"white\"\n";
    assert_eq!(parse(inline).unwrap().parts.len(), 1);
    for (text, answer) in [
        (
            "[target]\n",
            "PASS.toml:1: target.part: found no such key, expected file, built_in, or at least one part",
        ),
        ("[target]\nbuilt_in = \"box_wings\"\n", "(did you mean \"box_wing\"?)"),
        (
            "[target]\nfile = \"a.toml\"\nbuilt_in = \"corner\"\n",
            "target.file: found \"a.toml\", expected either file or built_in",
        ),
        (
            "[target]\nfile = \"a.toml\"\n",
            "PASS.toml:2: target.file: found \"a.toml\", expected a target.toml that can be read",
        ),
        (&inline.replace("white", "wite"), "PASS.toml:6: target.part[0].material: found \"wite\""),
        (
            &inline.replace("[target]", "[target]\nbuilt_in = \"corner\""),
            "either built_in, or [[part]]",
        ),
    ] {
        let error = parse(text).expect_err(text);
        assert!(error.contains(answer), "{error}\n{answer}");
    }
}

/// Truth: what was written is what is read: names, and every coordinate to the last bit.
#[test]
fn an_exported_target_reads_back_the_same() {
    let folder = tempfile::tempdir().unwrap();
    for name in Target::built_in_names() {
        let target = Target::built_in(name).unwrap();
        let angles = vec![0.7; target.hinges.len()];
        let file = folder.path().join(format!("{name}.obj"));
        fs::write(&file, target.to_obj(&angles)).unwrap();
        let pieces: Vec<_> =
            read(&file).unwrap().into_iter().filter(|p| !p.mesh.triangles.is_empty()).collect();
        assert_eq!(pieces.len(), target.parts.len());
        for (k, (piece, part)) in pieces.iter().zip(&target.parts).enumerate() {
            let material = &target.materials[part.material].name;
            assert_eq!(piece.names, [part.name.clone(), material.clone()]);
            let ours: Vec<_> = target.part_mesh(k, &angles).faces().collect();
            assert_eq!(piece.mesh.faces().collect::<Vec<_>>(), ours, "{name}");
        }
    }
}

/// Lengths whose squares are no numbers would make infinite areas.
#[test]
fn lengths_beyond_all_bodies_are_refused() {
    for (shape, key) in [
        ("shape = \"box\"\nsize_m = [1e200, 1, 1]", "size_m"),
        ("shape = \"box\"\nsize_m = [1, 1, 1]\noffset_m = [1e300, 0, 0]", "offset_m"),
        ("shape = \"sphere\"\nradius_m = 1e160", "radius_m"),
        ("shape = \"prism\"\nheight_m = 1\nwidth_m = 1e160", "width_m"),
        ("shape = \"cone\"\nheight_m = 1\nradius_m = 1\ntop_radius_m = 1e160", "top_radius_m"),
    ] {
        let text = format!("[[part]]\nname = \"a\"\n{shape}\nmaterial = \"white\"\n");
        let error = Target::parse("t.toml", text).unwrap_err().to_string();
        assert!(error.contains(key) && error.contains("at most 1e15 m"), "{error}");
    }
}

/// Truth: by hand. The limit is 200 m; a part without a file has no unit to give.
#[test]
fn parts_written_in_millimetres_are_warned_of() {
    let target = |size: &str| {
        let text = format!(
            "[[part]]\nname = \"bus\"\nshape = \"box\"\nsize_m = {size}\nmaterial = \"white\"\n\
             [[part]]\nname = \"ball\"\nshape = \"sphere\"\nradius_m = 99.0\nmaterial = \"white\"\n"
        );
        Target::parse("t.toml", &text).unwrap()
    };
    assert_eq!(target("[1, 199, 1]").warnings, [""; 0]);
    let warnings = target("[1000, 1200, 900]").warnings;
    assert_eq!(warnings, ["the part bus measures 1200.0 m: are its sizes millimetres?"]);
}

/// Truth: docs/targets.md. Its example is a target, its table has every shape, its list every built-in target.
#[test]
fn the_page_about_targets_is_true() {
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/targets.md");
    let page = std::fs::read_to_string(page).unwrap();
    let example = page.split("```toml\n").nth(1).unwrap().split("```").next().unwrap();
    let target = Target::parse("target.toml", example).unwrap();
    assert_eq!((target.parts.len(), target.warnings.len()), (4, 0));
    for shape in ["box", "plate", "sphere", "cylinder", "cone", "dish", "prism", "mesh"] {
        assert!(page.contains(&format!("| `{shape}` |")), "{shape}");
    }
    for name in Target::built_in_names() {
        assert!(page.contains(&format!("`{name}`")), "{name}");
    }
}

/// Truth: closed forms of area and volume (256 corners: 1e-3), and the normals of a file come back: a cylinder, a cone and a dish written as OBJ,
/// read again as smooth meshes. The hinge moves them.
#[test]
fn round_shapes_are_written_with_normals() {
    let text = "[[part]]\nname = \"p\"\nmaterial = \"white\"\n";
    let dish = "shape = \"dish\"\nradius_m = 2\ndepth_m = 1\nfaces = [\"inside\"]\n";
    let of = |keys: &str| Target::parse("a.toml", format!("{text}{keys}")).unwrap();
    let c = 4.0_f64;
    // 2π ∫ r √(1 + 4r²/c²) dr with z = r²/c.
    let bowl = PI * c * c / 6.0 * ((1.0 + 4.0 * 4.0 / (c * c)).powf(1.5) - 1.0);
    for (keys, area) in [
        ("shape = \"cylinder\"\nradius_m = 0.5\nheight_m = 2\n", 2.5 * PI),
        ("shape = \"cone\"\nradius_m = 3\nheight_m = 4\n", 24.0 * PI),
        (dish, bowl),
        ("shape = \"sphere\"\nradius_m = 1\n", 4.0 * PI),
    ] {
        let target = of(keys);
        let mesh = target.part_mesh(0, &[]);
        assert!((mesh.area_m2() / area - 1.0).abs() < 1e-3, "{keys}: {}", mesh.area_m2());
        for (t, corners) in mesh.triangles.iter().enumerate() {
            let flat = mesh.normal(t).unwrap();
            // The tip of a cone has none of its own.
            assert!(corners.iter().all(|k| mesh.normals[*k as usize].dot(flat) > 0.99), "{keys}");
        }
        let folder = tempfile::tempdir().unwrap();
        let obj = folder.path().join("round.obj");
        std::fs::write(&obj, target.to_obj(&[])).unwrap();
        let path = obj.display();
        let back = of(&format!("shape = \"mesh\"\nfile = \"{path}\"\nsmooth = true\n"));
        let Shape::Mesh(read) = &back.parts[0].shape else { panic!("a mesh") };
        assert_eq!(read.normals.len(), read.vertices.len());
        assert!((read.area_m2() - mesh.area_m2()).abs() < 1e-9);
        let flat = of(&format!("shape = \"mesh\"\nfile = \"{path}\"\n"));
        let Shape::Mesh(read) = &flat.parts[0].shape else { panic!("a mesh") };
        assert!(read.normals.is_empty());
    }
}
