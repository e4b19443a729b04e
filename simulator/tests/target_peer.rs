//! Built-in targets against the scenes that the independent renderer is given.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use std::process::Command;
use sunglint_simulator::mesh::{Mesh, read};
use sunglint_simulator::target::Target;
use sunglint_testkit::{peer_python, shared, skip};

/// Our parts for each shape of the peer's scene, and its material.
type Shapes = [(&'static str, &'static [&'static str], &'static str)];

const BOX_WING: &Shapes = &[
    ("body_z", &["body_z"], "aluminium"),
    ("body_x_low", &["body_x_low"], "mli"),
    ("body_x_mid", &["body_x_mid"], "white"),
    ("body_x_top", &["body_x_top"], "aluminium"),
    ("body_y", &["body_y"], "white"),
    ("wing_cells", &["wing_plus_cells", "wing_minus_cells"], "solar"),
    ("wing_back", &["wing_plus_back", "wing_minus_back"], "white"),
];

const CORNER: &Shapes =
    &[("floor", &["floor"], "grey80"), ("wall", &["wall"], "grey80"), ("box", &["box"], "grey80")];

/// Truth: the scenes as `mitsuba_scenes.py export` writes them with numpy, by its own vector code: facet by facet, corner by corner, and the
/// material of each. Tolerances: 1e-8 m for the OBJ (nine digits of coordinates up to 2.6 m), 2e-7 m for the PLY (single precision).
#[test]
fn the_renderers_scenes_are_our_targets() {
    let test = "the_renderers_scenes_are_our_targets";
    let Some(script) = shared("peers/mitsuba_scenes.py") else {
        return skip(test, "no shared folder with the peer's scenes");
    };
    let Some(python) = peer_python(test, &["numpy"]) else { return };
    for (scene, shapes) in
        [("box_wing", BOX_WING), ("box_wing_diffuse", BOX_WING), ("corner", CORNER)]
    {
        let folder = tempfile::tempdir().unwrap();
        let output = Command::new(&python)
            .arg(&script)
            .args(["export", "--scene", scene, "--dir"])
            .arg(folder.path())
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = std::fs::read_to_string(folder.path().join("scene.json")).unwrap();
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        let theirs = json["shapes"].as_array().unwrap();
        let target = Target::built_in(scene).unwrap();
        assert_eq!(theirs.len(), shapes.len());
        let parts: usize = shapes.iter().map(|shape| shape.1.len()).sum();
        assert_eq!(parts, target.parts.len());
        for (json, (name, parts, material)) in theirs.iter().zip(shapes) {
            assert_eq!(json["name"], *name);
            let material = if scene == "box_wing_diffuse" { "grey80" } else { material };
            assert_eq!(json["material"], material);
            let ours: Vec<usize> = parts
                .iter()
                .map(|part| target.parts.iter().position(|p| p.name == *part).unwrap())
                .collect();
            for &part in &ours {
                let name = &target.materials[target.parts[part].material].name;
                assert_eq!(name.trim_end_matches("_cell"), material);
            }
            let meshes: Vec<Mesh> = ours.iter().map(|&part| target.part_mesh(part, &[])).collect();
            let ours = Mesh::merged(&meshes);
            for (extension, tolerance) in [("obj", 1e-8), ("ply", 2e-7)] {
                let file = folder.path().join(format!("{name}.{extension}"));
                let pieces = read(file).unwrap();
                let theirs = &pieces[0].mesh;
                assert_eq!((pieces.len(), theirs.triangles.len()), (1, ours.triangles.len()));
                for (a, b) in ours.faces().zip(theirs.faces()) {
                    for (a, b) in a.iter().zip(&b) {
                        assert!(a.distance(*b) < tolerance, "{scene} {name}.{extension}: {a} {b}");
                    }
                }
            }
        }
    }
}
