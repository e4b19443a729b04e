//! Readers of outside data that have no `fuzz/` of their own: meshes, plans of a night, scenes, targets, manifests.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use sunglint_formats::session::Manifest;
use sunglint_observatory::Plan;
use sunglint_simulator::mesh;
use sunglint_simulator::pass::PassFile;
use sunglint_simulator::target::Target;
use sunglint_testkit::Fuzz;

/// A file of that ending with these bytes, for readers that open files themselves.
fn file(ending: &str, bytes: &[u8]) -> PathBuf {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| tempfile::tempdir().unwrap());
    let path = folder.path().join(format!("x.{ending}"));
    std::fs::write(&path, bytes).unwrap();
    path
}

/// Meshes of every kind: no panic; coordinates are finite and there is a triangle.
fn meshes(bytes: &[u8]) {
    for ending in ["obj", "ply", "stl", "glb", "gltf"] {
        if let Ok(pieces) = mesh::read(file(ending, bytes)) {
            assert!(!pieces.is_empty());
        }
    }
}

fn plan(bytes: &[u8]) {
    let _ = Plan::read(&file("toml", bytes)).map_err(|error| error.to_string());
}

fn scene(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let _ = PassFile::parse(Path::new("x.toml"), &text).map_err(|error| error.to_string());
    let _ = Target::parse(Path::new("x.toml"), text).map_err(|error| error.to_string());
}

fn manifest(bytes: &[u8]) {
    let _ = Manifest::read(file("manifest.toml", bytes)).map_err(|error| error.to_string());
}

/// Name of a target, further folders of seeds, and the target.
type Reader = (&'static str, &'static [&'static str], fn(&[u8]));

/// Truth: what each target itself holds: no panic. In a run of the suite a fixed number of inputs, in the campaign for a time.
#[test]
fn campaign_fuzz() {
    let scenes: &'static [&'static str] = &["fixtures/scenes", "fixtures/thesis"];
    let targets: [Reader; 4] = [
        ("meshes", &["fixtures/meshes"], meshes),
        ("plan", &[], plan),
        ("scene", scenes, scene),
        ("manifest", &[], manifest),
    ];
    for (name, folders, target) in targets {
        let fuzz = folders.iter().fold(Fuzz::of(name), |fuzz, folder| fuzz.with(folder));
        fuzz.run(target);
    }
}
