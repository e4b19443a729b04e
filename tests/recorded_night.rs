//! The recorded night of `fixtures/nights` through the program: checked, replayed, reduced, calibrated, applied.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::PathBuf;
use sunglint_formats::session::Session;
use sunglint_radiometry::light_curve::{Flags, LightCurve};

fn night() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("fixtures/nights/2020-11-18_synthetic")
}

fn curve(path: PathBuf) -> LightCurve {
    let table = sunglint_formats::ecsv::read(&path).unwrap();
    LightCurve::from_table(&path, &table).unwrap()
}

/// Truth: the recording itself. A replayed night holds the same bins and the same pixels, none lost, none doubled, and is whole.
#[test]
fn the_recorded_night_is_whole_and_replays_as_itself() {
    let folder = Folder::new("recorded-replay");
    let recorded = night();
    let recorded = recorded.to_str().unwrap();
    assert!(folder.done(&["session", "check", recorded]).contains("all of it is there"));
    folder.done(&["observe", "--replay", recorded, "--fast", "-o", "again"]);
    assert!(folder.done(&["session", "check", "again"]).contains("all of it is there"));
    let rows = |root: PathBuf| {
        let text = std::fs::read_to_string(root.join("counts/tagger.ecsv")).unwrap();
        let rows: Vec<String> =
            text.lines().filter(|l| !l.starts_with('#')).map(str::to_owned).collect();
        rows
    };
    let counts = rows(night());
    assert_eq!(counts.len(), 1 + 4180);
    assert_eq!(rows(folder.path("again")), counts);
    let frames = |root: PathBuf| {
        let session = Session::open(&root).unwrap();
        let files = session.frames("cam").unwrap();
        files.files.iter().map(|file| file.read().unwrap()).collect::<Vec<_>>()
    };
    let (first, again) = (frames(night()), frames(folder.path("again")));
    assert_eq!(first.len(), 105);
    for (a, b) in first.iter().zip(&again) {
        assert_eq!((a.start, a.exposure_s, &a.pixels), (b.start, b.exposure_s, &b.pixels));
    }
    assert_eq!(again.len(), first.len());
}

/// Truth: what the virtual observatory put in, which shares no formula with the reduction: κ of six channels (`truth.json`), and the satellite's rates
/// (`pass.ecsv`). κ of the camera stands for the light in an aperture of 2.5 widths, too: of a Moffat profile with β = 3, (1 + (2.5/0.98)²)⁻² = 1.8 % lies outside of it (Moffat 1969). Tolerance: κ within three of its stated uncertainties, which stars scattered by 1 % and their twinkling in 20 s make; the satellite's mean rate
/// over all samples within 3 % beside that: its own twinkling in 0.1 s (some 3 % each, 24 frames of the camera) is what is left.
#[test]
fn the_recorded_night_is_calibrated_to_what_was_put_in() {
    let folder = Folder::new("recorded-chain");
    let recorded = night();
    let session = recorded.to_str().unwrap();
    folder.done(&["reduce", session, "-o", "linear/"]);
    folder.done(&["calibrate", "linear", "--station", "ufo", "-o", "kappa.ecsv"]);
    let found = folder.json(&["calibrate", session, "--station", "ufo", "--json"]);
    let truth: Value =
        serde_json::from_slice(&std::fs::read(night().join("virtual/truth.json")).unwrap())
            .unwrap();
    let channels = found["nights"][0]["channels"].as_array().unwrap();
    let mut checked = BTreeMap::new();
    for channel in channels {
        let name = channel["channel"].as_str().unwrap();
        let (kappa, sigma) = (channel["kappa"].as_f64(), channel["relative_sigma"].as_f64());
        let (kappa, sigma) = (kappa.unwrap(), sigma.unwrap());
        let within = if ["r", "g", "b"].contains(&name) { 1.0 - 0.0178 } else { 1.0 };
        let off = kappa * within / truth["kappa"][name].as_f64().unwrap() - 1.0;
        eprintln!("{name}: kappa off by {:+.2} %, stated {:.2} %", 100.0 * off, 100.0 * sigma);
        assert!(off.abs() < 3.0 * sigma && sigma < 0.03, "{name}: {off} of {sigma}");
        checked.insert(name.to_owned(), sigma);
    }
    assert_eq!(checked.len(), 6, "{checked:?}");

    folder.done(&[
        "apply",
        "kappa.ecsv",
        "linear/box_wing_pass_1.ecsv",
        "--station",
        "ufo",
        "-o",
        "pass.ecsv",
    ]);
    let measured = curve(folder.path("pass.ecsv"));
    let predicted = curve(night().join("virtual/pass.ecsv"));
    let start = predicted.samples.time[0];
    let seconds = |curve: &LightCurve| -> Vec<f64> {
        curve.samples.time.iter().map(|t| (*t - start).to_seconds()).collect()
    };
    let (at, when) = (seconds(&predicted), seconds(&measured));
    for (name, sigma) in &checked {
        let put_in = &predicted.channel(name).unwrap().rate_hz;
        let channel = measured.channel(name).unwrap();
        let (mut sum, mut expected, mut used) = (0.0, 0.0, 0);
        for (i, t) in when.iter().enumerate() {
            let doubtful = Flags::SATURATED | Flags::FAST_GLINT | Flags::CROWDED | Flags::EDGE;
            if !channel.rate_hz[i].is_finite() || channel.flags[i].intersects(doubtful) {
                continue;
            }
            let after = at.partition_point(|s| s < t).clamp(1, at.len() - 1);
            let part = (t - at[after - 1]) / (at[after] - at[after - 1]);
            sum += channel.rate_hz[i];
            expected += put_in[after - 1] + part * (put_in[after] - put_in[after - 1]);
            used += 1;
        }
        let off = sum / expected - 1.0;
        eprintln!("{name}: {used} samples of the pass, off by {:+.2} %", 100.0 * off);
        assert!(used > 15 && off.abs() < 0.03 + 3.0 * sigma, "{name}: {off} of {used}");
    }
}
