//! Mesh files: one body in every format, what other readers make of it, and what must be refused.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::DVec3;
use std::path::{Path, PathBuf};
use sunglint_simulator::mesh::{Mesh, NamedMesh, read};
use sunglint_testkit::fixture;

const FILES: [&str; 9] = [
    "prism.obj",
    "prism_text.ply",
    "prism_little.ply",
    "prism_big.ply",
    "prism_binary.stl",
    "prism_text.stl",
    "prism_beside.gltf",
    "prism_inside.gltf",
    "prism.glb",
];

fn path(name: &str) -> PathBuf {
    fixture(&format!("meshes/{name}"))
}

fn whole(pieces: &[NamedMesh]) -> Mesh {
    Mesh::merged(pieces.iter().map(|piece| &piece.mesh))
}

/// The corners of all triangles, each triangle from its least corner on, sorted: what two readers of one file must agree on.
fn soup(triangles: impl IntoIterator<Item = [DVec3; 3]>) -> Vec<[[f64; 3]; 3]> {
    let turned = |t: [DVec3; 3]| {
        let t = t.map(|c| (c + DVec3::ZERO).to_array());
        let turns = [[t[0], t[1], t[2]], [t[1], t[2], t[0]], [t[2], t[0], t[1]]];
        turns.into_iter().min_by(|a, b| a.partial_cmp(b).unwrap()).unwrap()
    };
    let mut all: Vec<_> = triangles.into_iter().map(turned).collect();
    all.sort_by(|a, b| a.partial_cmp(b).unwrap());
    all
}

/// Truth: the closed forms of an L-shaped prism, volume 6, area 22, centroid by hand: the L's perimeter of 8 has its centroid at 0.875
/// (x and y alike), its area at 5/6; so (16·0.875 + 6·5/6)/22. Tolerance: rounding.
#[test]
fn every_format_gives_the_same_body() {
    for name in FILES {
        let pieces = read(path(name)).unwrap_or_else(|e| panic!("{e}"));
        let mesh = whole(&pieces);
        assert!((mesh.signed_volume_m3() - 6.0).abs() < 1e-14, "{name}");
        assert!((mesh.area_m2() - 22.0).abs() < 1e-14, "{name}");
        let across = (16.0 * 0.875 + 6.0 * (5.0 / 6.0)) / 22.0;
        let centroid = DVec3::new(across, across, 1.0);
        assert!(mesh.centroid().unwrap().distance(centroid) < 1e-14, "{name}");
        let report = mesh.examine();
        assert!(report.all_closed() && report.components.len() == 1, "{name}: {report:?}");
        assert!(report.faults.is_empty(), "{name}: {:?}", report.faults);
        let bounds = mesh.bounds().unwrap();
        assert_eq!((bounds.least, bounds.most), (DVec3::ZERO, DVec3::splat(2.0)), "{name}");
    }
}

#[test]
fn pieces_keep_their_names() {
    let names = |file: &str| -> Vec<Vec<String>> {
        read(path(file)).unwrap().into_iter().map(|piece| piece.names).collect()
    };
    let obj = names("prism.obj");
    // The object alone, before its first group, is there and empty; so is the last group.
    assert_eq!(obj[1], ["ends", "prism"]);
    assert!(obj.contains(&vec!["ends".into(), "prism".into(), "metal".into()]));
    assert!(obj.contains(&vec!["walls".into(), "prism".into(), "paint".into()]));
    assert!(obj.contains(&vec!["empty".into(), "prism".into(), "paint".into()]));
    assert_eq!(names("prism_text.stl"), [["ends"], ["walls"]]);
    assert_eq!(names("prism.glb"), [["ends", "metal"], ["walls", "paint"]]);
}

/// Truth: `stl_io` 0.11 (triangles in single precision), `gltf` 1.4 (corners before the nodes' transformations), `ply-rs-bw` 4 and
/// `tobj` 4 (corners and polygons). The coordinates of the body are exact in single precision, so that nothing may differ.
#[test]
fn other_readers_agree() {
    let corner = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
    for name in ["prism_binary.stl", "prism_text.stl"] {
        let mut file = std::fs::File::open(path(name)).unwrap();
        let theirs: Vec<[DVec3; 3]> = stl_io::create_stl_reader(&mut file)
            .unwrap()
            .map_while(Result::ok)
            .map(|t| t.vertices.map(|v| corner(v.0)))
            .collect();
        let pieces = read(path(name)).unwrap();
        // Theirs stops after the first solid of a text.
        let ours = if theirs.len() < 20 { pieces[0].mesh.clone() } else { whole(&pieces) };
        assert_eq!(soup(ours.faces()), soup(theirs), "{name}");
    }

    let file = gltf::Gltf::open(path("prism.glb")).unwrap();
    let mut theirs = Vec::new();
    for primitive in file.document.meshes().flat_map(|mesh| mesh.primitives()) {
        let reader = primitive.reader(|_| file.blob.as_deref());
        let points: Vec<DVec3> =
            reader.read_positions().unwrap().map(|p| 2.0 * corner(p)).collect();
        let order: Vec<usize> =
            reader.read_indices().unwrap().into_u32().map(|i| i as usize).collect();
        theirs.extend(order.chunks(3).map(|t| [points[t[0]], points[t[1]], points[t[2]]]));
    }
    assert_eq!(soup(whole(&read(path("prism.glb")).unwrap()).faces()), soup(theirs));

    for name in ["prism_text.ply", "prism_little.ply", "prism_big.ply"] {
        use ply_rs_bw::ply::Property;
        let mut file = std::io::BufReader::new(std::fs::File::open(path(name)).unwrap());
        let parser = ply_rs_bw::parser::Parser::<ply_rs_bw::ply::DefaultElement>::new();
        let ply = parser.read_ply(&mut file).unwrap();
        let number = |p: &Property| match *p {
            Property::Float(x) => f64::from(x),
            Property::Double(x) => x,
            _ => panic!("{p:?}"),
        };
        let theirs: Vec<DVec3> = ply.payload["vertex"]
            .iter()
            .map(|v| DVec3::from_array(["x", "y", "z"].map(|axis| number(&v[axis]))))
            .collect();
        let ours = whole(&read(path(name)).unwrap());
        assert_eq!(ours.vertices, theirs, "{name}");
        // A polygon of n corners is n − 2 triangles.
        let corners: usize = ply.payload["face"]
            .iter()
            .map(|f| match &f["vertex_indices"] {
                Property::ListInt(list) => list.len(),
                Property::ListUInt(list) => list.len(),
                other => panic!("{other:?}"),
            })
            .sum();
        assert_eq!(ours.triangles.len(), corners - 2 * ply.payload["face"].len(), "{name}");
    }

    let options = tobj::LoadOptions::default();
    // A continued line is one that it does not know.
    let text = std::fs::read_to_string(path("prism.obj")).unwrap().replace("\\\r\n", " ");
    let no_materials = |_: &Path| Err(tobj::LoadError::GenericFailure);
    let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, no_materials).unwrap();
    let faces = |mesh: &tobj::Mesh| mesh.face_arities.iter().map(|n| *n as usize - 2).sum();
    let theirs: Vec<(String, usize)> =
        models.iter().map(|m| (m.name.clone(), faces(&m.mesh))).filter(|m| m.1 > 0).collect();
    let pieces = read(path("prism.obj")).unwrap();
    let ours: Vec<(String, usize)> = pieces
        .iter()
        .map(|p| (p.names[0].clone(), p.mesh.triangles.len()))
        .filter(|p| p.1 > 0)
        .collect();
    assert_eq!(ours, theirs);
}

/// Returns the message that refuses a file of this text or these bytes.
fn refusal(name: &str, bytes: impl AsRef<[u8]>) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    let error = read(&path).expect_err(name).to_string();
    error.replace(&format!("{}/", folder.path().display()), "")
}

#[test]
fn obj_files_that_make_no_sense_are_refused_with_the_line() {
    let three = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    for (text, answer) in [
        ("v 0 0 nan\nf 1 1 1\n", "a.obj:1: v: found `nan`, expected three finite coordinates"),
        ("v 0 0\nf 1 1 1\n", "a.obj:1: v: found `nothing`, expected three finite coordinates"),
        ("v 1e999 0 0\n", "a.obj:1: v: found `1e999`, expected three finite coordinates"),
        ("v 0 0 0 2\n", "a.obj:1: v: found the weight `2`, expected no weight, or 1"),
        (
            &format!("{three}f 1 2 4\n"),
            "a.obj:4: f: found `4`, expected a vertex from 1 to 3 (or -3 to -1), so far",
        ),
        (
            &format!("{three}f 1 2 -4\n"),
            "a.obj:4: f: found `-4`, expected a vertex from 1 to 3 (or -3 to -1), so far",
        ),
        (
            &format!("{three}f 0 1 2\n"),
            "a.obj:4: f: found `0`, expected a vertex from 1 to 3 (or -3 to -1), so far",
        ),
        (
            &format!("{three}f 1 2 99999999999999999999\n"),
            "a.obj:4: f: found `99999999999999999999`, expected a vertex from 1 to 3 (or -3 to -1), so far",
        ),
        (
            &format!("{three}f 1 2\n"),
            "a.obj:4: f: found 2 corners, expected at least three corners",
        ),
        (&format!("{three}g only names\n"), "a.obj: found no face, expected at least one triangle"),
        ("", "a.obj: found no face, expected at least one triangle"),
        (
            "cstype bezier\n",
            "a.obj:1: keyword: found `cstype`, expected v, vn, vt, f, g, o, usemtl (polygons; no curves or free-form surfaces)",
        ),
        (
            "v 0 0 0\nv 2 2 0\nv 2 0 0\nv 0 1 0\nf 1 2 3 4\n",
            "a.obj:5: found a face whose outline crosses itself, expected a simple polygon (let the modelling program export triangles)",
        ),
    ] {
        assert_eq!(refusal("a.obj", text), answer);
    }
    assert!(refusal("a.obj", b"v 0 0 \xff\n").contains("a.obj:1: found the byte 0xff"));
}

#[test]
fn ply_files_that_lie_are_refused() {
    let text = std::fs::read_to_string(path("prism_text.ply")).unwrap();
    let lie = |from: &str, to: &str| refusal("a.ply", text.replacen(from, to, 1));
    let many = lie("element vertex 12", "element vertex 4000000000000");
    assert!(many.contains("element vertex: found 4000000000000 of them in"), "{many}");
    assert!(lie("element vertex 12", "element vertex -1").contains("a.ply:4:"));
    let more = lie("element vertex 12", "element vertex 13");
    assert!(more.contains("found"), "{more}");
    let fewer = lie("element face 8", "element face 7");
    assert!(fewer.contains("expected the end of the file, by its header"), "{fewer}");
    let far = lie("6 6 7 8 9 10 11", "6 6 7 8 9 10 12");
    assert_eq!(far, "a.ply:24: face 0: found 12, expected a vertex from 0 to 11");
    let nan = lie("0 0 0 7", "nan 0 0 7");
    assert_eq!(nan, "a.ply:12: vertex 0: found [NaN, 0, 0], expected finite coordinates");
    assert!(lie("double z", "double w").contains("expected a vertex with x, y, z"));
    assert!(lie("vertex_indices", "vertices").contains("one list vertex_indices"));
    assert!(lie("end_header", "").contains("a.ply:"));
    assert!(refusal("a.ply", "").contains("end_header"));

    let bytes = std::fs::read(path("prism_big.ply")).unwrap();
    let cut = refusal("a.ply", &bytes[..bytes.len() - 40]);
    assert!(cut.contains("expected the numbers that the header promises"), "{cut}");
    let longer = refusal("a.ply", [&bytes[..], b"more"].concat());
    assert!(longer.contains("found 4 bytes more"), "{longer}");
}

#[test]
fn stl_files_that_lie_are_refused() {
    let bytes = std::fs::read(path("prism_binary.stl")).unwrap();
    let mut lie = bytes.clone();
    lie[83] = 0xff;
    let answer = refusal("a.stl", &lie);
    assert!(answer.contains("found 1084 bytes, expected 213909505084 bytes"), "{answer}");
    assert!(refusal("a.stl", &bytes[..500]).contains("it may be cut off"));
    assert!(refusal("a.stl", &bytes[5..50]).contains("found 45 bytes, expected an STL of 84"));
    assert!(refusal("a.stl", &bytes[..50]).contains("found `the end of the file`"));
    let mut nan = bytes.clone();
    nan[84 + 50 + 12..84 + 50 + 16].copy_from_slice(&f32::NAN.to_le_bytes());
    assert_eq!(
        refusal("a.stl", &nan),
        "a.stl: triangle 1: found [NaN, 0, 2], expected finite coordinates"
    );
    let none = [&[0_u8; 84][..]].concat();
    assert_eq!(refusal("a.stl", &none), "a.stl: found no face, expected at least one triangle");

    let text = std::fs::read_to_string(path("prism_text.stl")).unwrap();
    let answer = refusal("a.stl", text.replacen("endloop", "", 1));
    assert_eq!(answer, "a.stl:8: found `endfacet`, expected endloop");
    let answer = refusal("a.stl", text.replacen("0.000000e+00 0.000000e+00", "0 x", 1));
    assert!(answer.contains("expected vertex with three finite coordinates"), "{answer}");
    let answer = refusal("a.stl", &text[..text.len() - 20]);
    assert!(answer.contains("expected"), "{answer}");
}

#[test]
fn gltf_files_that_lie_are_refused() {
    let text = std::fs::read_to_string(path("prism_inside.gltf")).unwrap();
    let lie = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        refusal("a.gltf", text.replacen(from, to, 1))
    };
    let answer = lie("\"count\": 12", "\"count\": 4000000000");
    assert!(answer.contains("accessors[0]: found 4000000000 elements every 12 bytes"), "{answer}");
    assert!(lie("\"byteLength\": 144", "\"byteLength\": 14400").contains("of a buffer of 228"));
    assert!(lie("\"bufferView\": 1", "\"bufferView\": 7").contains("accessors[1]"));
    assert!(lie("\"mesh\": 1", "\"mesh\": 9").contains("nodes[2].mesh: found 9"));
    let answer = lie("\"name\": \"walls\",", "\"name\": \"walls\", \"children\": [0],");
    assert!(answer.contains("nodes[0]: found a node that is there twice"), "{answer}");
    assert!(lie("\"version\": \"2.0\"", "\"version\": \"1.0\"").contains("asset.version"));
    let draco = "\"extensionsRequired\": [\"KHR_draco_mesh_compression\"], \"scene\"";
    assert!(lie("\"scene\"", draco).contains("export without compression"));
    assert!(lie("\"scene\": 0", "\"scene\": 3").contains("expected one of 1 scenes"));
    assert!(lie(";base64,", ";base64,*").contains("no base64"));
    let elsewhere = lie("data:application/octet-stream;base64,", "http://a.b/");
    assert!(elsewhere.contains("expected a file beside it"), "{elsewhere}");
    assert!(lie("5126", "5120").contains("expected VEC3 of component type 5126"));
    assert!(lie("{", "").contains("what is no glTF, expected glTF 2.0"));

    let bytes = std::fs::read(path("prism.glb")).unwrap();
    assert!(refusal("a.glb", &bytes[..600]).contains("found 600 bytes, expected 1340 bytes"));
    assert!(refusal("a.glb", b"glTF").contains("cut off"));
    assert!(refusal("a.gltf", b"{}").contains("asset.version"));
}

#[test]
fn only_known_extensions_and_plain_files_are_read() {
    let answer = refusal("a.fbx", "");
    assert_eq!(
        answer,
        "a.fbx: found the extension `fbx`, expected a mesh: obj, ply, stl, gltf or glb"
    );
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("a.obj")).unwrap();
    assert!(read(folder.path().join("a.obj")).unwrap_err().to_string().contains("a folder"));
    assert!(read(Path::new("nowhere.stl")).unwrap_err().to_string().contains("cannot read"));
}

/// 10,000 files with random bytes changed, cut out, doubled or cut off: an answer, no panic, no endless loop; and whatever is read
/// can be examined.
#[test]
fn mutated_files_never_panic() {
    use rand::{RngExt as _, SeedableRng as _};
    let mut rng = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(3);
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(path("prism buffer.bin"), folder.path().join("prism buffer.bin")).unwrap();
    let originals = FILES.map(|name| (name, std::fs::read(path(name)).unwrap()));
    let (mut good, mut bad) = (0, 0);
    for number in 0..10_000 {
        let (name, original) = &originals[rng.random_range(0..originals.len())];
        let mut bytes = original.clone();
        for _ in 0..rng.random_range(1..4) {
            let at = rng.random_range(0..bytes.len());
            match rng.random_range(0..6) {
                0 => bytes[at] = rng.random(),
                1 => bytes[at] ^= 1 << rng.random_range(0..8),
                2 => bytes[at] = b"0123456789-.e \n/{}[]\""[rng.random_range(0..21)],
                3 => bytes.truncate(at.max(1)),
                4 => {
                    let end = (at + rng.random_range(1..20)).min(bytes.len());
                    let piece = bytes[at..end].to_vec();
                    bytes.splice(at..at, piece);
                }
                _ => {
                    let end = (at + rng.random_range(1..20)).min(bytes.len() - 1);
                    bytes.drain(at.min(end)..end);
                }
            }
        }
        // A name of its own: some file systems wait for the disk where a file is written over.
        let file = folder.path().join(format!("{number}_{name}"));
        std::fs::write(&file, &bytes).unwrap();
        let result = read(&file);
        std::fs::remove_file(&file).unwrap();
        match result {
            Ok(pieces) => {
                good += 1;
                let mesh = whole(&pieces);
                let report = mesh.examine();
                assert!(!report.components.is_empty() || !report.faults.is_empty());
            }
            Err(_) => bad += 1,
        }
    }
    // Both happen, else nothing was tested.
    assert!(good > 500 && bad > 500, "{good} read, {bad} refused");
}

/// A few groups before many materials: the names of the pieces would take the square of the file.
#[test]
fn names_of_pieces_stay_within_a_multiple_of_the_file() {
    let groups: String = (0..2000).map(|i| format!(" g{i}")).collect();
    let faces: String = (0..2000).map(|i| format!("usemtl m{i}\nf 1 2 3\n")).collect();
    let text = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\ng{groups}\n{faces}");
    assert!(refusal("many_names.obj", text).contains("a few groups, objects and materials"));
}

#[cfg(unix)]
#[test]
fn a_device_is_no_mesh() {
    let name = std::env::temp_dir().join(format!("sunglint-zero-{}.stl", std::process::id()));
    std::os::unix::fs::symlink("/dev/null", &name).unwrap();
    let error = read(&name).unwrap_err().to_string();
    std::fs::remove_file(&name).unwrap();
    assert!(error.contains("an ordinary file"), "{error}");
}

/// Truth: the files, by hand. A vertex with two normals becomes two; those without one have 0; a node that stretches leaves normals across
/// their surface: x/4 along x, that of (1, 0, 1) turned to (1/4, 0, 1).
#[test]
fn normals_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let file = folder.path().join(name);
        std::fs::write(&file, bytes).unwrap();
        file
    };
    let obj =
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvn 0 0 2\nvn 1 0 1\nf 1//1 2//1 3//1\nf 2//2 4 3//1\n";
    let pieces = read(write("a.obj", obj.as_bytes())).unwrap();
    let mesh = &pieces[0].mesh;
    assert_eq!((mesh.vertices.len(), mesh.normals.len()), (5, 5));
    assert_eq!(mesh.normals[0], DVec3::Z);
    assert_eq!(mesh.normals[3], DVec3::new(1.0, 0.0, 1.0).normalize());
    assert_eq!(mesh.normals[4], DVec3::ZERO);
    assert!(read(write("b.obj", obj.replace("2//2", "2//3").as_bytes())).is_err());
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property float nx\nproperty float ny\nproperty float nz\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n0 0 0 0 0 2\n1 0 0 0 0 1\n0 1 0 1 0 0\n3 0 1 2\n";
    let pieces = read(write("a.ply", ply.as_bytes())).unwrap();
    assert_eq!(pieces[0].mesh.normals, [DVec3::Z, DVec3::Z, DVec3::X]);
    let numbers: [f32; 18] = [
        0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, // positions
        0.0, 0.0, 1.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0,
    ];
    let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
    write("a.bin", &bytes);
    let gltf = r#"{"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],
        "nodes":[{"mesh":0,"scale":[4,1,1]}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0,"NORMAL":1}}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},
                     {"bufferView":1,"componentType":5126,"count":3,"type":"VEC3"}],
        "bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":36}],
        "buffers":[{"uri":"a.bin","byteLength":72}]}"#;
    let mesh = &read(write("a.gltf", gltf.as_bytes())).unwrap()[0].mesh;
    assert!(mesh.normals[1].distance(DVec3::new(0.25, 0.0, 1.0).normalize()) < 1e-7);
    assert_eq!(mesh.normals[0], DVec3::Z);
}
