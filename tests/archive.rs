//! `sunglint archive`: the page's commands, curves that other commands read, refusals. What is found is tested in the crate `archive`.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::{Folder, SPHERE_PASS};

/// A calibrated pass of the sphere (synthetic): its simulation with other words.
fn nights(name: &str) -> Folder {
    let folder = Folder::new(name);
    let scene = SPHERE_PASS.replace("material = \"white\"", "reflectance = 0.3");
    std::fs::write(folder.path("sphere.toml"), &scene).unwrap();
    folder.done(&["simulate", "sphere.toml", "-o", "pass.ecsv", "-q"]);
    let text = std::fs::read_to_string(folder.path("pass.ecsv")).unwrap();
    let told = text.replace("quantity: \"predicted\"", "quantity: predicted");
    assert!(told.contains("quantity: predicted") && told.contains("spcm_rate_hz"), "{told}");
    let told = told.replace("quantity: predicted", "quantity: calibrated");
    let own = "target: \"object 25544 as sphere of 0.5 m\"";
    assert!(told.contains(own), "{told}");
    let told = told.replace(own, "target: \"NORAD 25544\"");
    std::fs::create_dir_all(folder.path("nights/one")).unwrap();
    std::fs::create_dir_all(folder.path("nights/two")).unwrap();
    std::fs::write(folder.path("nights/one/iss.ecsv"), &told).unwrap();
    // Another night, through V.
    let other = told.replace("spcm_", "V_").replace("2008-09-21T", "2008-09-23T");
    std::fs::write(folder.path("nights/two/iss.ecsv"), other).unwrap();
    folder
}

#[test]
fn the_commands_of_the_page_run() {
    let folder = nights("archive-page");
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/archive.md");
    let page = std::fs::read_to_string(page).unwrap();
    let mut ran = 0;
    let mut last = String::new();
    for command in page.lines().filter_map(|l| l.strip_prefix("sunglint ")) {
        last = folder.done(&command.split(' ').collect::<Vec<_>>());
        ran += 1;
    }
    assert_eq!(ran, 4);
    let paths: Vec<&str> = last.lines().collect();
    assert_eq!(paths, ["nights/one/iss.ecsv", "nights/two/iss.ecsv"]);
    assert!(folder.path("iss_v.ecsv").exists());
    let json = folder.json(&["archive", "nights", "--channel", "V", "--json"]);
    assert_eq!(json["index"]["read"], 0);
    assert_eq!(json["passes"].as_array().unwrap().len(), 1);
    assert_eq!(json["passes"][0]["norad_id"], 25544);
    // A simulation says in words whose it is.
    std::fs::rename(folder.path("pass.ecsv"), folder.path("nights/simulated.ecsv")).unwrap();
    let of_it = ["--object", "25544", "--kind", "predicted", "--channel", "spcm"];
    let json = folder.json(&[&["archive", "nights", "--json"], &of_it[..]].concat());
    assert_eq!(json["passes"][0]["file"], "simulated.ecsv", "{json}");
}

/// The joined curve feeds `fit`, which finds the gain that the light was made with: 1, within its own interval.
#[test]
fn a_joined_curve_is_fitted_and_analysed() {
    let folder = nights("archive-fit");
    let question = ["archive", "nights", "--object", "25544", "--channel", "spcm"];
    folder.done(&[&question[..], &["--curve-out", "one.ecsv", "-q"]].concat());
    let fitted = folder.json(&["fit", "one.ecsv", "sphere.toml", "--free", "gain", "--json", "-q"]);
    assert_eq!(fitted["fit"]["converged"], true, "{fitted}");
    let gain = fitted["fit"]["parameters"]
        .as_array()
        .unwrap()
        .iter()
        .find(|p| p["name"] == "gain")
        .unwrap();
    let value = gain["value"].as_f64().unwrap();
    assert!((value - 1.0).abs() < 1e-3, "{gain}");
    folder.done(&["analyse", "fold", "one.ecsv", "--period", "60", "-q", "-o", "folded.ecsv"]);
}

/// A folder whose name is not UTF-8: the lines of `--paths` open the files.
#[cfg(target_os = "linux")]
#[test]
fn paths_are_the_bytes_that_open_the_files() {
    use std::os::unix::ffi::OsStrExt as _;
    let folder = nights("archive-bytes");
    let name = std::ffi::OsStr::from_bytes(b"n\xe4chte");
    std::fs::rename(folder.path("nights"), folder.0.join(name)).unwrap();
    let output = std::process::Command::new(crate::common::program())
        .arg("archive")
        .arg(name)
        .arg("--paths")
        .current_dir(&folder.0)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let lines: Vec<&[u8]> =
        output.stdout.split(|b| *b == b'\n').filter(|l| !l.is_empty()).collect();
    assert_eq!(lines.len(), 2);
    for line in lines {
        assert!(folder.0.join(std::ffi::OsStr::from_bytes(line)).is_file(), "{line:?}");
    }
}

#[test]
fn mistakes_are_refused_and_damage_is_named() {
    let folder = nights("archive-refused");
    std::fs::write(folder.path("nights/torn.ecsv"), "# %ECSV 1.0\n# ---\n# datatype:\n").unwrap();
    let output = folder.run(&["archive", "nights"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("torn.ecsv is damaged and left out"), "{said}");
    for (code, arguments, word) in [
        (1, &["nowhere"][..], "no such folder"),
        (2, &["nights", "--phase-below", "200"], "--phase-below"),
        (2, &["nights", "--phase-above", "NaN"], "--phase-above"),
        (2, &["nights", "--from", "yesterday"], "--from"),
        (2, &["nights", "--curve-out", "a.csv"], ".ecsv"),
        (2, &["nights", "--paths", "--json"], "--paths"),
        (1, &["nights", "--object", "1", "--curve-out", "a.ecsv"], "no pass"),
    ] {
        let error = folder.refused(code, &[&["archive"], arguments].concat());
        assert!(error.contains(word), "{error}");
    }
    assert!(!folder.path("a.ecsv").exists());
}
