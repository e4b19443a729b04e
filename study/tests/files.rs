//! Contents and faults of a `STUDY.toml`.

use crate::{folder, read};

#[test]
fn a_grid_for_two_objects_is_counted() {
    let (_dir, path) = folder(
        r#"
[study]
scene = "pass.toml"
tasks_a_shard = 5
[[parameter]]
key = "target.sphere.radius_m"
from = 1.0
to = 2.0
steps = 3
[[parameter]]
key = "target.sphere.reflectance"
values = [0.1, 0.2]
[passes]
elements = ["elements.tle"]
from = 2008-09-21T17:00:00Z
to = 2008-09-21T20:00:00Z
step_s = 10.0
"#,
    );
    let study = read(&path).expect("a study");
    assert_eq!((study.points.len(), study.tasks(), study.shards()), (6, 12, 3));
    assert_eq!(study.shard(2), 10..12);
    assert_eq!(study.task(3), (1, 1));
    assert_eq!(study.describe(1), "target.sphere.radius_m = 1.0, target.sphere.reflectance = 0.2");
}

#[test]
fn a_table_of_points_is_read() {
    let (dir, path) = folder("[study]\nscene = \"pass.toml\"\ntable = \"points.csv\"\n");
    let points = "target.sphere.radius_m,target.name\n1.0,small\n2.5,large\n";
    std::fs::write(dir.path().join("points.csv"), points).expect("written");
    let study = read(&path).expect("a study");
    assert_eq!(study.points.len(), 2);
    assert_eq!(study.describe(1), "target.sphere.radius_m = 2.5, target.name = large");
}

#[test]
fn the_identity_follows_every_file() {
    let text = "[study]\nscene = \"pass.toml\"\n[passes]\nelements = [\"elements.tle\"]\nfrom = 2008-09-21T17:00:00Z\nto = 2008-09-21T20:00:00Z\nstep_s = 10.0\n";
    let (dir, path) = folder(text);
    let id = read(&path).expect("a study").id;
    assert_eq!(id, read(&path).expect("a study").id);
    let changed = crate::ELEMENTS.replace("OTHER", "ANOTHER");
    std::fs::write(dir.path().join("elements.tle"), changed).expect("written");
    let with_elements = read(&path).expect("a study").id;
    assert_ne!(id, with_elements);
    std::fs::write(dir.path().join("pass.toml"), crate::SCENE.replace("0.3", "0.4"))
        .expect("written");
    assert_ne!(with_elements, read(&path).expect("a study").id);
}

/// Each mistake is refused with its place before anything is made.
#[test]
fn mistakes_are_named_before_the_work_begins() {
    let parameter = |text: &str| format!("[study]\nscene = \"pass.toml\"\n[[parameter]]\n{text}\n");
    let passes = |text: &str| {
        format!(
            "[study]\nscene = \"pass.toml\"\n[passes]\nelements = [\"elements.tle\"]\nfrom = 2008-09-21T17:00:00Z\nto = 2008-09-21T20:00:00Z\nstep_s = 10.0\n{text}\n"
        )
    };
    for (text, wanted) in [
        ("[study]\nscene = \"missing.toml\"\n".to_owned(), "missing.toml"),
        ("[study]\nscene = \"pass.toml\"\nkept = []\n".to_owned(), "kept"),
        (
            "[study]\nscene = \"pass.toml\"\ndesign = \"sobol\"\n".to_owned(),
            "[[parameter]]s to sample",
        ),
        ("[study]\nscene = \"pass.toml\"\npoints = 3\n".to_owned(), "latin or sobol"),
        ("[study]\nscene = \"pass.toml\"\ntasks_a_shard = 0\n".to_owned(), "tasks_a_shard"),
        (parameter("key = \"target.sphere.radius_m\""), "either values, or from and to"),
        (parameter("key = \"target.sphere.radius_m\"\nvalues = []"), "at least one value"),
        (
            parameter("key = \"target.sphere.radius_m\"\nvalues = [1.0]\nfrom = 0\nto = 1"),
            "not both",
        ),
        (
            parameter("key = \"target.sphere.radius_m\"\nfrom = 0.0\nto = 1.0\nsteps = 0"),
            "number of values",
        ),
        (
            parameter(
                "key = \"target.sphere.radius_m\"\nfrom = 0.0\nto = 1.0\nsteps = 2\nscale = \"log\"",
            ),
            "above 0",
        ),
        // The scene is asked for its own words.
        (parameter("key = \"target.sphere.radius\"\nvalues = [1.0]"), "radius"),
        (parameter("key = \"target.sphere.radius_m\"\nvalues = [-1.0]"), "radius_m"),
        (parameter("key = \"target.sphere\"\nvalues = [-1.0]"), "sphere"),
        (
            parameter("key = \"a.b\"\nvalues = [1]\n[[parameter]]\nkey = \"a.b\"\nvalues = [2]"),
            "no other [[parameter]]",
        ),
        (passes("norad_id = [5]"), "is not among"),
        (passes("min_altitude_deg = 91.0"), "-90 to 90"),
    ] {
        let (_dir, path) = folder(&text);
        let error = read(&path).expect_err(&text).to_string();
        assert!(error.contains(wanted), "{text}\n{error}");
    }
}
