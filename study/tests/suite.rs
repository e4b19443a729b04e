//! All tests of this crate: one program, so that one is linked.

mod files;
mod runs;
mod schedulers;

use std::path::{Path, PathBuf};
use sunglint_study::{Stations, Study, StudyError};

/// Diffuse sphere over the station `ufo`, without earthlight, in steps of 20 s (synthetic).
pub const SCENE: &str = r#"
[target]
name = "sphere"
sphere = { radius_m = 1.0, reflectance = 0.3 }
[orbit]
lines = [
  "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
  "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
]
[effects]
earthshine = "off"
moonshine = "off"
[station]
name = "ufo"
[times]
from = 2008-09-21T18:47:00Z
to = 2008-09-21T18:49:00Z
step_s = 20.0
"#;

/// Two objects; the second set of the first is a day older (the example of Spacetrack Report 3, and the same orbit under another number: synthetic).
pub const ELEMENTS: &str = "\
ISS
1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927
2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537
OTHER
1 25545U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2928
2 25545  51.6416 247.4627 0006703 130.5360 300.0288 15.72125391563531
";

/// Folder with a scene, elements and a study.
pub fn folder(study: &str) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().expect("a folder");
    std::fs::write(dir.path().join("pass.toml"), SCENE).expect("written");
    std::fs::write(dir.path().join("elements.tle"), ELEMENTS).expect("written");
    let path = dir.path().join("study.toml");
    std::fs::write(&path, study).expect("written");
    (dir, path)
}

/// Reads a study without any station but the scene's.
pub fn read(path: &Path) -> Result<Study, StudyError> {
    Study::read(path, Stations::default())
}
