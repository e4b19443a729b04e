//! `sunglint pointing`: a model from a table of places, and what takes it.

#![allow(clippy::unwrap_used, reason = "a test says what it expects")]

use crate::common::Folder;
use std::fmt::Write as _;

/// Places of an equatorial mount over the sky: the reading is 600″ and −300″ beside where the frame looks.
fn places(names: [&str; 4]) -> String {
    let mut text = format!("{},pier\n", names.join(","));
    for k in 0..16 {
        let [hour_angle, dec] = [-70.0 + 9.0 * f64::from(k), -5.0 + 12.0 * f64::from(k % 6)];
        let _ = writeln!(
            text,
            "{:.6},{:.6},{hour_angle:.6},{dec:.6},",
            hour_angle + 600.0 / 3600.0,
            dec - 300.0 / 3600.0
        );
    }
    text
}

/// Truth: the two zero points that were put in, within 1″; all other terms are 0 within 2″. The model's file is taken by `track`, and refused where a file is none. What is no table of places is refused with the column that is
/// missing, angles that are mixed up with the number of the place.
#[test]
fn a_table_of_places_makes_a_model() {
    let folder = Folder::new("pointing");
    let names = ["shown_hour_angle_deg", "shown_dec_deg", "seen_hour_angle_deg", "seen_dec_deg"];
    std::fs::write(folder.path("places.csv"), places(names)).unwrap();
    let common = ["pointing", "places.csv", "--station", "ufo"];
    let json = folder
        .json(&[&common[..], &["--model-out", "model.toml", "-o", "made/", "--json"]].concat());
    assert_eq!((json["axes"].as_str(), json["used"].as_u64()), (Some("equatorial"), Some(16)));
    for term in json["terms"].as_array().unwrap() {
        let value = term["arcsec"].as_f64().unwrap();
        let (wanted, most) = match term["name"].as_str().unwrap() {
            "first_zero" => (600.0, 1.0),
            "second_zero" => (-300.0, 1.0),
            _ => (0.0, 2.0),
        };
        assert!((value - wanted).abs() < most, "{term}");
    }
    assert!(json["before_arcsec"].as_f64().unwrap() > 300.0);
    assert!(json["rms_arcsec"].as_f64().unwrap() < 1.0, "{json}");
    for made in ["made/pointing.ecsv", "made/pointing.png", "model.toml"] {
        assert!(folder.path(made).exists(), "{made}");
    }
    // The table that it writes is one that it reads.
    let again = folder.json(&["pointing", "made/pointing.ecsv", "--station", "ufo", "--json"]);
    assert_eq!(again["used"], json["used"]);
    let text = folder.done(&common);
    assert!(text.contains("zero point of the hour angle"), "{text}");

    std::fs::write(folder.path("short.csv"), places(names).replace("seen_dec_deg", "dec")).unwrap();
    let error = folder.refused(1, &["pointing", "short.csv", "--station", "ufo"]);
    assert!(error.contains("seen_dec_deg") && error.contains("short.csv"), "{error}");
    let side = places(names).replacen(",\n", ",north\n", 1);
    std::fs::write(folder.path("side.csv"), side).unwrap();
    let error = folder.refused(1, &["pointing", "side.csv", "--station", "ufo"]);
    assert!(error.contains("pier") && error.contains("north"), "{error}");
    let mixed = [names[2], names[3], names[1], names[0]];
    std::fs::write(folder.path("mixed.csv"), places(mixed)).unwrap();
    let error = folder.refused(1, &["pointing", "mixed.csv", "--station", "ufo"]);
    assert!(error.contains("place 1"), "{error}");
    let error = folder.refused(2, &["pointing"]);
    assert!(error.contains("<FILE>"), "{error}");
}
