//! `sunglint calibrate` and `apply`, on synthetic light curves: what `sunglint star` predicts, over a κ, with noise and with dimmed stars put in. The estimator itself is
//! held against independent nights in `calibration/tests/stars`; here the way through files and the program is.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod common;

use common::Folder;
use common::star_night::{KAPPA, curve, night};
use serde_json::{Value, json};

fn channel<'a>(night: &'a Value, name: &str) -> &'a Value {
    night["channels"].as_array().unwrap().iter().find(|c| c["channel"] == name).unwrap()
}

/// Truth: κ that was put in, 2 % of uniform scatter of each of seven clean stars: 0.44 % of their mean; four of that. Deneb's spectrum is a guess from the colour (a supergiant the library lacks): it may not decide. The two dimmed stars are named. Applied to
/// one of its own curves κ gives the prediction back, within that star's scatter of 2 %, and its magnitude is the catalogue's; the files are read by the program
/// itself, and the covariance is there.
#[test]
fn a_synthetic_night_is_calibrated_and_applied() {
    let folder = Folder::new("calibrate");
    night(&folder, "2020-11-18", 1.0);
    let arguments =
        ["calibrate", "2020-11-18", "--station", "ufo", "-o", "k.ecsv", "-o", "k.svg", "--json"];
    let found = folder.json(&arguments);
    let night = &found["nights"][0];
    assert_eq!((&night["night"], &night["stars"]), (&json!("2020-11-18"), &json!(9)), "{night}");
    assert_eq!(night["agreeing_stars"], 7, "{night}");
    for (name, kappa) in KAPPA {
        let k = channel(night, name)["kappa"].as_f64().unwrap();
        assert!((k / kappa - 1.0).abs() < 0.0175, "{name}: {k}");
    }
    let out: Vec<&str> = night["visits"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|v| v["agrees"] == false)
        .map(|v| v["star"].as_str().unwrap())
        .collect();
    assert_eq!(out.len(), 3, "{out:?}");
    assert!(
        std::fs::read_to_string(folder.path("k.svg")).unwrap().contains("spcm/g")
            || std::fs::read_to_string(folder.path("k.svg")).unwrap().contains("g/spcm")
    );
    let text = folder.done(&["calibrate", "2020-11-18", "--station", "ufo"]);
    assert!(text.contains("7 of 9 stars agree") && text.contains("too faint"), "{text}");

    let vega = "2020-11-18/00_vega.ecsv";
    let applied = folder.json(&[
        "apply",
        "k.ecsv",
        vega,
        "--station",
        "ufo",
        "--spectrum",
        "A0V",
        "--magnitudes",
        "V",
        "--photometry-out",
        "p.ecsv",
        "-o",
        "c.ecsv",
        "--json",
    ]);
    let g = channel(&applied, "g");
    assert_eq!(g["samples"], 10);
    let magnitude = channel(&applied["photometry"], "g")["magnitude_range"][0].as_f64().unwrap();
    assert!((magnitude - 0.03).abs() < 0.06, "{applied}");
    let written = std::fs::read_to_string(folder.path("c.ecsv")).unwrap();
    assert!(written.contains("calibrated") && written.contains("covariance_ln_kappa"), "{written}");
    assert!(std::fs::read_to_string(folder.path("p.ecsv")).unwrap().contains("g_mag"));
    // Twice is once too often, and another night is not this one.
    let error = folder.refused(1, &["apply", "k.ecsv", "c.ecsv", "--station", "ufo"]);
    assert!(error.contains("its rates are calibrated, expected linear"), "{error}");
    let error =
        folder.refused(1, &["apply", "k.ecsv", vega, "--station", "ufo", "--night", "2020-11-19"]);
    assert!(error.contains("the file has 2020-11-18"), "{error}");
    let error = folder.refused(1, &["apply", vega, vega, "--station", "ufo"]);
    assert!(error.contains("is this a file that `sunglint calibrate` wrote?"), "{error}");
}

/// Truth: two nights whose κ are 1 and 1.5 times those put in: the coefficient of variation is 0.25/1.25 = 20 %, to the tenth that the stars' scatter, the same
/// on both nights, leaves.
#[test]
fn two_synthetic_nights_vary() {
    let folder = Folder::new("calibrate-nights");
    night(&folder, "2020-11-18", 1.0);
    night(&folder, "2020-11-21", 1.5);
    let found =
        folder.json(&["calibrate", "2020-11-18", "2020-11-21", "--station", "ufo", "--json"]);
    assert_eq!(found["nights"].as_array().unwrap().len(), 2);
    for row in found["variation"].as_array().unwrap() {
        let coefficient = row["coefficient_of_variation"].as_f64().unwrap();
        assert!((coefficient - 0.2).abs() < 0.01, "{row}");
    }
}

#[test]
fn what_is_no_night_is_refused() {
    let folder = Folder::new("calibrate-refused");
    std::fs::create_dir_all(folder.path("2020-11-18")).unwrap();
    let empty = folder.refused(1, &["calibrate", "2020-11-18", "--station", "ufo"]);
    assert!(empty.contains("no visit to a star in 2020-11-18"), "{empty}");
    curve(&folder, "2020-11-18", 0, 1.0);
    let one = folder.refused(1, &["calibrate", "2020-11-18", "--station", "ufo"]);
    assert!(one.contains("1 star(s) can decide, 3 are needed"), "{one}");
    std::fs::write(folder.path("2020-11-18/session.toml"), "").unwrap();
    let session = folder.refused(1, &["calibrate", "2020-11-18", "--station", "ufo"]);
    assert!(session.contains("sunglint reduce"), "{session}");
}
