//! `sunglint elements` and `sunglint solve` as programs; the commands that take elements, with messages in place of two lines.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use ndarray::Array2;
use sunglint_formats::fits::{Fits, Header, Image, Pixels, Writer};
use sunglint_formats::wcs::Wcs;
use sunglint_radiometry::tables::BRIGHT_STARS;

/// CelesTrak's example of the format, twice, with a number that two lines cannot hold; the second a day older and 3 s along its track.
const OMM: &str = r#"[{"OBJECT_NAME": "ISS (ZARYA)", "OBJECT_ID": "1998-067A", "EPOCH": "2020-07-12T01:19:07.402656", "MEAN_MOTION": 15.49560532,
 "ECCENTRICITY": 0.0001771, "INCLINATION": 51.6435, "RA_OF_ASC_NODE": 225.4004, "ARG_OF_PERICENTER": 44.9625, "MEAN_ANOMALY": 5.1087, "EPHEMERIS_TYPE": 0,
 "CLASSIFICATION_TYPE": "U", "NORAD_CAT_ID": 123456789, "ELEMENT_SET_NO": 999, "REV_AT_EPOCH": 23587, "BSTAR": 0.0049645, "MEAN_MOTION_DOT": 0.00289036,
 "MEAN_MOTION_DDOT": 0}"#;

/// Two sets of one object, in `iss.json`.
pub fn write_elements(folder: &Folder) {
    let other = OMM.trim_start_matches('[').replace("01:19:07.402656", "01:19:10.402656");
    std::fs::write(folder.path("iss.json"), format!("{OMM},\n{other}]\n")).unwrap();
}

/// A synthetic frame of 25° from the embedded stars, in the direction of Orion, north 20° from up.
pub fn draw(folder: &Folder, name: &str) {
    const SIDE: usize = 800;
    let scale = 2.0 * 12.5_f64.to_radians().tan().to_degrees() / SIDE as f64;
    let (sin, cos) = 20_f64.to_radians().sin_cos();
    // East is to the left, rows go down.
    let matrix = [[-scale * cos, -scale * sin], [scale * sin, -scale * cos]];
    let wcs = Wcs::tangential([83.0, 0.0].into(), [399.5, 399.5].into(), matrix).unwrap();
    let table = BRIGHT_STARS.table();
    let column = |name: &str| table.f64(name).unwrap().into_owned();
    let (ra, dec, v) = (column("ra_deg"), column("dec_deg"), column("v"));
    let mut pixels = Array2::<f32>::zeros((SIDE, SIDE));
    // A pattern of noise that repeats nowhere near a star's width.
    let mut state = 12345_u32;
    for pixel in &mut pixels {
        let mut sum = 0.0;
        for _ in 0..4 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            sum += f64::from(state >> 8) / f64::from(1_u32 << 24) - 0.5;
        }
        *pixel = (500.0 + 10.0 * sum) as f32;
    }
    for ((ra, dec), v) in ra.iter().zip(&dec).zip(&v) {
        let Some(place) = wcs.pixel([*ra, *dec].into()) else { continue };
        let [x, y] = place.to_array();
        if !(0.0..800.0).contains(&x) || !(0.0..800.0).contains(&y) || (ra - 83.0).abs() > 40.0 {
            continue;
        }
        let light = 3e4 * 10_f64.powf(-0.4 * (v - 2.0));
        for row in (y as usize).saturating_sub(8)..((y as usize) + 9).min(SIDE) {
            for column in (x as usize).saturating_sub(8)..((x as usize) + 9).min(SIDE) {
                let r2 = (column as f64 - x).powi(2) + (row as f64 - y).powi(2);
                pixels[[row, column]] += (light / 8.0 * (-0.5 * r2 / 1.3).exp()) as f32;
            }
        }
    }
    let mut header = Header::default();
    header.set("DATE-OBS", "2000-01-01T12:00:00", "");
    header.set("EXPTIME", 1.0, "");
    header.set("OBJECT", "synthetic", "");
    header.set("ROWORDER", "TOP-DOWN", "");
    header.set("CHECKSUM", "synthetic", "");
    let mut writer = Writer::new();
    writer.image(&Image { header, pixels: Pixels::F32(pixels.into_dyn()) }).unwrap();
    std::fs::write(folder.path(name), writer.into_bytes()).unwrap();
}

/// Truth: the place at which the frame was drawn.
#[test]
fn a_frame_is_solved_and_its_header_told() {
    let folder = Folder::new("solve");
    draw(&folder, "orion.fits");
    let json = folder.json(&["solve", "orion.fits", "--json", "--write"]);
    let solved = &json["frames"][0]["solved"];
    let of = |key: &str, k: usize| solved[key][k].as_f64().unwrap();
    assert!((of("centre_deg", 0) - 83.0).abs() < 0.005, "{solved}");
    assert!(of("centre_deg", 1).abs() < 0.005, "{solved}");
    assert!((of("size_deg", 0) - 25.0).abs() < 0.02, "{solved}");
    // East is to the left of north as the rows go down, and north 20° from up.
    assert_eq!(
        (&solved["is_mirrored"], &json["frames"][0]["first_row"]),
        (&false.into(), &"top".into())
    );
    let up = solved["up_deg"].as_f64().unwrap();
    assert!((up - 20.0).abs() < 0.05 || (up - 340.0).abs() < 0.05, "{up}");
    let fits = Fits::read(folder.path("orion.fits")).unwrap();
    let header = fits.hdus()[0].header();
    assert_eq!((header.text("OBJECT"), header.text("CHECKSUM")), (Some("synthetic"), None));
    let middle = Wcs::from_header(header).unwrap().unwrap().sky([399.5, 399.5].into()).unwrap();
    let [ra, dec] = middle.to_array();
    assert!((ra - 83.0).abs() < 0.005 && dec.abs() < 0.005, "{ra} {dec}");
    // Without the card the first row is at the bottom, as viewers of FITS draw it: upside down, and mirrored.
    let mut bytes = std::fs::read(folder.path("orion.fits")).unwrap();
    let at = bytes.windows(8).position(|w| w == b"TOP-DOWN").unwrap();
    bytes[at..at + 8].copy_from_slice(b"UNKNOWN ");
    std::fs::write(folder.path("below.fits"), bytes).unwrap();
    let below = folder.json(&["solve", "below.fits", "--json"]);
    let drawn = &below["frames"][0]["solved"];
    assert_eq!(
        (&drawn["is_mirrored"], &below["frames"][0]["first_row"]),
        (&true.into(), &"bottom".into())
    );
    let turned = (drawn["up_deg"].as_f64().unwrap() - up).rem_euclid(360.0);
    assert!((turned - 180.0).abs() < 0.01, "{turned}");
    // A second time, from the header's own scale or not: the same place.
    let again = folder.json(&["solve", "orion.fits", "--json"]);
    assert_eq!(again["frames"][0]["solved"]["stars"], solved["stars"]);
    assert!(folder.refused(2, &["solve", "orion.fits", "--width-deg", "90"]).contains("0.2 to 45"));
    let error = folder.refused(1, &["solve", "orion.fits", "--width-deg", "3"]);
    assert!(error.contains("too few"), "{error}");
}

/// Truth: the two lines of the same numbers, and the time by which one set was shifted.
#[test]
fn messages_are_taken_where_elements_are() {
    let folder = Folder::new("elements");
    write_elements(&folder);
    let json = folder.json(&["elements", "iss.json", "--at", "2020-07-13", "--json"]);
    let object = &json["objects"][0];
    assert_eq!(
        (object["norad_id"].as_u64(), object["sets"].as_u64()),
        (Some(123_456_789), Some(2))
    );
    assert!((object["furthest"]["along_s"].as_f64().unwrap().abs() - 3.0).abs() < 0.05, "{object}");
    // Passes of a message, a rehearsal, a scene, a plan.
    let window =
        ["--from", "2020-07-12T00:00:00", "--to", "2020-07-13T00:00:00", "--station", "ufo"];
    let passes = folder.json(&[&["passes", "--tle", "iss.json", "--json"][..], &window].concat());
    assert!(!passes["passes"].as_array().unwrap().is_empty(), "{passes}");
    let track =
        ["track", "iss.json", "123456789", "--mount", "virtual", "--station", "ufo", "--dry-run"];
    folder.json(&[&track[..], &["--at", "2020-07-12T00:00:00", "--json"]].concat());
    let bad = OMM.replace("0.0001771", "1.0001771") + "]";
    std::fs::write(folder.path("bad.json"), bad).unwrap();
    let error = folder.refused(1, &["elements", "bad.json"]);
    assert!(error.contains("bad.json:2: ECCENTRICITY"), "{error}");
    assert!(folder.refused(2, &["elements", "iss.json", "--object", "5"]).contains("--object"));
    let copied = ["elements", "update", "--from", "iss.json", "-o", "copy.json"];
    folder.done(&copied);
    assert_eq!(
        std::fs::read(folder.path("copy.json")).unwrap(),
        std::fs::read(folder.path("iss.json")).unwrap()
    );
    // A line whose checksum is wrong (its last digit is 7, and 8 here) is named and not written; the others are.
    let lines = "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\n2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\n";
    let damaged = format!("GOOD\n{lines}BAD\n{}", lines.replace("563537", "563538"));
    std::fs::write(folder.path("some.tle"), damaged).unwrap();
    let update = folder.run(&["elements", "update", "--from", "some.tle", "-o", "kept.tle"]);
    let said = String::from_utf8(update.stderr).unwrap();
    assert!(update.status.success(), "{said}");
    assert!(said.contains("some.tle:6: checksum") && said.contains("1 sets, 1 refused"), "{said}");
    assert_eq!(std::fs::read_to_string(folder.path("kept.tle")).unwrap(), format!("GOOD\n{lines}"));
    // JSON stays JSON, digits for digits.
    let bad = OMM.replace("0.0001771", "1.0001771");
    let both = format!("{bad},\n{}]", OMM.trim_start_matches('['));
    std::fs::write(folder.path("some.json"), both).unwrap();
    folder.done(&["elements", "update", "--from", "some.json", "-o", "kept.json"]);
    let kept = std::fs::read_to_string(folder.path("kept.json")).unwrap();
    assert_eq!(kept.trim(), format!("[\n{}\n]", OMM.trim_start_matches('[').trim()));
    let nothing = ["elements", "update", "--from", "ftp://nowhere", "-o", "copy.json"];
    assert!(folder.refused(1, &nothing).contains("expected http"));
}
