//! The documentation is true: its commands run, and the JSON keys that it lists are those that the program prints.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod common;

use common::{Folder, VEGA};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

fn read(page: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(page)).unwrap()
}

/// Every command of the README that begins with `sunglint` runs, in the order of the page, in a folder of its own.
#[test]
fn the_commands_of_the_readme_run() {
    let folder = Folder::new("readme");
    let readme = read("README.md");
    let commands: Vec<&str> = readme.lines().filter(|l| l.starts_with("sunglint ")).collect();
    assert!(commands.len() >= 8, "{commands:?}");
    let program = Path::new(env!("CARGO_BIN_EXE_sunglint")).parent().unwrap();
    let path = std::env::var("PATH").unwrap();
    for command in commands {
        // The completions go to the user's own folder.
        let command = command.replace("~/", "home/");
        let output = Command::new("sh")
            .args([
                "-e",
                "-c",
                &format!("mkdir -p home/.local/share/bash-completion/completions\n{command}"),
            ])
            .current_dir(&folder.0)
            .env("PATH", format!("{}:{path}", program.display()))
            .env_remove("SUNGLINT_STATION")
            .output()
            .unwrap();
        assert!(output.status.success(), "{command}: {}", String::from_utf8_lossy(&output.stderr));
    }
    assert!(folder.path("night.png").exists() && folder.path("man/sunglint-air.1").exists());
}

/// A pass of the elements that many texts print over the built-in station.
const SCENE: &str = r#"
target.built_in = "lambert_sphere"
orbit.lines = [
  "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
  "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
]
station.name = "ufo"
times.from = 2008-09-21T18:48:00Z
"#;

fn keys(value: &Value, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(map) => {
            for (key, value) in map {
                found.insert(key.clone());
                keys(value, found);
            }
        }
        Value::Array(list) => list.iter().for_each(|value| keys(value, found)),
        _ => {}
    }
}

#[test]
fn every_json_key_is_documented_and_every_documented_one_is_printed() {
    let folder = Folder::new("keys");
    let mut printed = BTreeSet::new();
    for command in [
        &["tables"][..],
        &[
            "air",
            "--station",
            "ufo",
            "-z",
            "60",
            "--components",
            "--aerosol",
            "0.1,1.3",
            "--from-nm",
            "500",
            "--to-nm",
            "600",
            "--step-nm",
            "50",
        ],
        &["star", "Vega", "--station", "ufo", "--at", "2020-11-18T18:00:00"],
        &["demo"],
    ] {
        keys(&folder.json(&[command, &["--json"]].concat()), &mut printed);
    }
    std::fs::write(folder.path("pass.toml"), SCENE).unwrap();
    std::fs::write(folder.path("m.csv"), "time_utc,magnitude\n2008-09-21T18:48:00Z,4.5\n").unwrap();
    keys(&folder.json(&["simulate", "pass.toml", "--json", "--beside", "m.csv"]), &mut printed);
    keys(&folder.json(&["explain", "pass.toml", "--json"]), &mut printed);
    for picture in [
        &["pass.toml", "--size-px", "32"][..],
        &["--model", "lambert_sphere", "--map", "--step-deg", "30"],
        &["--sphere"],
    ] {
        keys(&folder.json(&[&["picture", "--json"], picture].concat()), &mut printed);
    }
    let active = read("docs/active.md");
    let laser = active.split("```").nth(1).unwrap().strip_prefix("toml").unwrap();
    std::fs::write(folder.path("active.toml"), format!("{SCENE}{laser}")).unwrap();
    keys(&folder.json(&["simulate", "active.toml", "--active", "--json"]), &mut printed);
    folder.done(&[&VEGA[..], &["--spectrum-out", "s.json"]].concat());
    folder.done(&["bench", "--scene", "corner", "--seconds", "0.02", "-o", "b.json", "-q"]);
    for file in ["s.json", "b.json"] {
        let text = std::fs::read_to_string(folder.path(file)).unwrap();
        keys(&serde_json::from_str(&text).unwrap(), &mut printed);
    }
    // A set with a wrong checksum among others, and all three kinds of brightness.
    let elements = read("fixtures/passes/satellites.tle");
    let wrong = elements.replacen("15.50000000    13", "15.50000000    14", 1);
    std::fs::write(folder.path("some.tle"), wrong).unwrap();
    let passes = ["passes", "--tle", "some.tle", "--station", "ufo", "--json", "--name", "leo"];
    let window = ["--from", "2024-08-12T18:00", "--to", "2024-08-13T04:00"];
    for law in [&[][..], &["--standard-magnitude", "4"], &["--model", "box_wing"]] {
        keys(&folder.json(&[&passes[..], &window, law].concat()), &mut printed);
    }
    // Instruments: the simulated ones; a server that is not there.
    folder.done(&["devices", "record", "sim-wheel", "-o", "w.rec", "-q", "--", "check"]);
    for command in [
        &["list", "--drivers"][..],
        &["check", "sim-tmcl"],
        &["read", "sim-pm100"],
        &["read", "sim-camera"],
        &["read", "sim-tmcl"],
        &["read", "sim-wheel"],
        &["set", "sim-pm100", "range=AUTO"],
        &["move", "sim-wheel", "2"],
        &["replay", "w.rec"],
        &["udev"],
    ] {
        keys(&folder.json(&[&["devices"], command, &["--json"]].concat()), &mut printed);
    }
    let listed = folder.run(&["devices", "list", "--indi", "127.0.0.1:1", "--json"]);
    keys(&serde_json::from_slice(&listed.stdout).unwrap(), &mut printed);
    // A sample on a goniometer: a lobe that falls by 2 % a degree squared.
    let mut retro = String::from("angle_deg,f_per_sr,sigma_f_per_sr\n");
    for k in -10_i32..60 {
        let f = (-0.002 * f64::from(k * k)).exp();
        retro += &format!("{k},{f},{}\n", 0.01 * f);
    }
    std::fs::write(folder.path("retro.csv"), retro).unwrap();
    let ndf = ["brdf", "ndf", "retro.csv", "--resamplings", "3", "--json", "-o", "ndf.ecsv"];
    keys(&folder.json(&ndf), &mut printed);
    keys(
        &folder.json(&["brdf", "plan", "ndf.ecsv", "--rig", "--side", "9", "--json"]),
        &mut printed,
    );
    // Stars, and what they calibrate.
    common::star_night::night(&folder, "2020-11-18", 1.0);
    common::star_night::night(&folder, "2020-11-19", 1.0);
    let calibrate = ["calibrate", "2020-11-18", "2020-11-19", "--station", "ufo"];
    keys(&folder.json(&[&calibrate[..], &["--json", "-o", "k.ecsv"]].concat()), &mut printed);
    let apply = ["apply", "k.ecsv", "2020-11-18/00_vega.ecsv", "--station", "ufo", "--json"];
    keys(&folder.json(&[&apply[..], &["--magnitudes", "V"]].concat()), &mut printed);
    // A short night with simulated devices, and what is left of it when a line is cut.
    let night = "station = \"ufo\"\nfor_s = 3\n[[camera]]\nname = \"cam\"\ndevice = \"sim-camera\"\nexposure_s = 0.1\n\
                 [[counter]]\nname = \"tagger\"\ndevice = \"sim-timetagger\"\nchannels = { g = 1 }\nbin_s = 0.1\n";
    std::fs::write(folder.path("night.toml"), night).unwrap();
    let lines = folder.done(&["observe", "night.toml", "-o", "s", "--json", "--every", "0.2"]);
    for line in lines.lines() {
        keys(&serde_json::from_str(line).unwrap(), &mut printed);
    }
    let counts = folder.path("s/counts/tagger.ecsv");
    let whole = std::fs::read_to_string(&counts).unwrap();
    std::fs::write(counts, whole + "2020-").unwrap();
    let checked = folder.run(&["session", "check", "s", "--json"]);
    keys(&serde_json::from_slice(&checked.stdout).unwrap(), &mut printed);
    // A virtual night of a star, reduced and aligned.
    let night = "station = \"ufo\"\nfrom = \"2020-11-18T18:00:00Z\"\nvirtual = \"virtual.toml\"\n[[camera]]\nname = \"cam\"\ndevice = \"virtual\"\n\
                 exposure_s = 0.2\nwindow_px = [595, 419, 200, 200]\n[[counter]]\nname = \"tagger\"\ndevice = \"virtual\"\n\
                 channels = { spcm = 1 }\nbin_s = 0.1\n";
    let options = "[plan]\nstars = 1\nvisit_s = 20\nsky_s = 2\nslew_s = 1\ndark_s = 2\nv_mag = [2.5, 4]\n[pointing]\njitter_px = 6\njitter_time_s = 3\n";
    std::fs::write(folder.path("made_up.toml"), night).unwrap();
    std::fs::write(folder.path("virtual.toml"), options).unwrap();
    folder.done(&["observe", "made_up.toml", "-o", "v", "-q"]);
    keys(&folder.json(&["reduce", "v", "--json"]), &mut printed);
    keys(&folder.json(&["align", "v", "--json"]), &mut printed);
    // Rates are by the station's own channels, devices by their names.
    for channel in ["r", "g", "b", "id400", "spcm", "mppc", "cam", "tagger"] {
        printed.remove(channel);
    }
    let page = read("docs/json.md");
    let quoted: BTreeSet<String> = page.split('`').skip(1).step_by(2).map(str::to_owned).collect();
    // Flags are by their names, some of which are keys elsewhere.
    let flags: BTreeSet<String> = sunglint_radiometry::light_curve::Flags::all()
        .iter_names()
        .map(|(flag, _)| flag.to_lowercase())
        .collect();
    let undocumented: Vec<&String> =
        printed.difference(&quoted).filter(|key| !flags.contains(*key)).collect();
    assert!(undocumented.is_empty(), "not in docs/json.md: {undocumented:?}");
    let is_key = |word: &&String| {
        word.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
    };
    // An embedded station has no files.
    let titles = [
        "tables",
        "air",
        "star",
        "passes",
        "picture",
        "simulate",
        "explain",
        "bench",
        "demo",
        "null",
        "file",
        "brdf",
        "ndf",
        "plan",
        "devices",
        "calibrate",
        "apply",
        // Values of keys.
        "bootstrap",
        "student",
        "check",
        "read",
        "set",
        "move",
        // Where something is plugged in, a server answers, a photon counter counts.
        "bus",
        "path",
        "usb_id",
        "access",
        "addresses",
        "missed",
        "observe",
        "reduce",
        "align",
        // Values of keys.
        "status",
        "end",
        "opening",
        "running",
        "lost",
        "done",
        "stopped",
        "missing",
        "ok",
        "note",
        "failed",
        "read_back",
        "configured",
        "granted",
        "denied",
        "unknown",
        "exact",
        "icosphere",
        "pipeline",
        "stored",
        "none",
    ];
    let gone: Vec<&String> = quoted
        .difference(&printed)
        .filter(is_key)
        .filter(|w| !titles.contains(&w.as_str()))
        .collect();
    assert!(gone.is_empty(), "in docs/json.md, but never printed: {gone:?}");
}
