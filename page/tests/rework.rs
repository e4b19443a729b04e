//! A recorded visit reduced again: asked of the source as the page asks, and held against the light that was put in.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use hifitime::Epoch;
use ndarray::Array2;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use sunglint_calibration::reduction::{Recipe, ReduceOptions, reduce};
use sunglint_calibration::timing::read_timings;
use sunglint_formats::session::{
    ClockState, Device, DeviceKind, Disk, FORMAT, Manifest, Session, SessionWriter, Target,
    TargetKind, What,
};
use sunglint_formats::time::parse_utc;
use sunglint_formats::{Frame, ecsv};
use sunglint_numerics::progress::Silent;
use sunglint_page::{Recording, Request, Source as _};
use sunglint_radiometry::station::Station;

const FRAMES: u64 = 1000;
const EXPOSURE_S: f64 = 0.1;
const SIDE: usize = 120;

fn at(s: f64) -> Epoch {
    parse_utc("2020-11-18T17:00:00Z").unwrap() + hifitime::Duration::from_seconds(s)
}

/// Where the target of a frame stands: it drifts to and fro by 12 px, past nothing.
fn target_px(number: u64) -> [f64; 2] {
    let turn = 0.02 * number as f64;
    [84.0 + 6.0 * turn.sin(), 80.0 + 6.0 * turn.cos()]
}

const LAMP: std::ops::Range<u64> = 500..505;
const STAR_ADU: f64 = 40_000.0;
const TARGET_ADU: f64 = 100_000.0;

/// A synthetic frame: flat sky with noise of ±8 ADU, and light above it, ADU at a column and row.
pub(crate) fn frame_of(number: u64, light: &dyn Fn(f64, f64) -> f64) -> Frame {
    let value = |(row, column): (usize, usize)| {
        let hash = ((number << 32) ^ ((row << 16) as u64) ^ column as u64)
            .wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let noise = (hash >> 60) as f64;
        (500.0 + noise + light(column as f64, row as f64)).min(65_535.0).round() as u16
    };
    Frame {
        pixels: Array2::from_shape_fn((SIDE, SIDE), value),
        origin: [636, 460],
        binning: [1, 1],
        bayer: None,
        start: at(0.2 * number as f64),
        exposure_s: EXPOSURE_S,
        gain_e_per_adu: Some(0.3),
        temperature_c: Some(-10.0),
        saturation_adu: Some(65_535.0),
        header: sunglint_formats::fits::Header::default(),
    }
}

/// The same with a star 6 px from the middle, the target further away, both 4 px wide; a lamp in five frames.
fn frame(number: u64, [tx, ty]: [f64; 2]) -> Frame {
    let norm = 4.0 * 2_f64.ln() / std::f64::consts::PI / 16.0;
    frame_of(number, &|column, row| {
        let point = |x: f64, y: f64, adu: f64| {
            let r2 = (column - x).powi(2) + (row - y).powi(2);
            adu * norm * (-4.0 * 2_f64.ln() * r2 / 16.0).exp()
        };
        let lamp = if LAMP.contains(&number) { point(tx + 3.0, ty, 5e5) } else { 0.0 };
        point(55.0, 56.0, STAR_ADU) + point(tx, ty, TARGET_ADU) + lamp
    })
}

/// A monochrome station, so that every pixel counts.
const STATION: &str = r#"name = "mono"
description = "synthetic"
[site]
latitude_deg = 48.7822
longitude_deg = 9.1956
height_m = 355
horizon_deg = 10
[telescope]
primary_diameter_m = 0.1
obstruction_diameter_m = 0
focal_length_m = 1
mount = "equatorial"
[air]
profile = "us_standard"
[camera]
name = "mono"
width_px = 1392
height_px = 1040
pixel_scale_arcsec = 2
gain_e_per_adu = 0.3
read_noise_e = 2
full_well_e = 60000
adc_bits = 16
dark_e_per_s = 0.01
[[channel]]
name = "v"
camera_plane = "L"
transmission = 0.3
efficiency = "qe.csv"
"#;

/// A session of frames 0.2 s apart with the target at these places.
fn session_of(root: &Path, count: u64, place_px: fn(u64) -> [f64; 2]) -> Session {
    session_with(root, count, &|number| frame(number, place_px(number)))
}

/// A session of such frames.
pub(crate) fn session_with(root: &Path, count: u64, frame: &dyn Fn(u64) -> Frame) -> Session {
    let none =
        || ClockState { method: "none".into(), synchronised: None, offset_s: None, error_s: None };
    let camera = Device {
        name: "cam".into(),
        kind: DeviceKind::Camera,
        address: "synthetic".into(),
        options: vec![],
        channels: vec![],
        inputs: vec![],
        raw_tags: false,
        exposure_s: EXPOSURE_S,
        interval_s: None,
        filter: None,
    };
    let mut files = Vec::new();
    let qe = "wavelength_nm,efficiency\n400,0.4\n900,0.4\n";
    for (name, text) in [("station/station.toml", STATION), ("station/qe.csv", qe)] {
        let sha256 = sunglint_formats::sha256(text.as_bytes());
        files.push((sunglint_formats::session::FileSum { path: name.into(), sha256 }, text));
    }
    let manifest = Manifest {
        format: FORMAT.into(),
        program: "a test".into(),
        station: "mono".into(),
        start_utc: at(0.0),
        clock: none(),
        devices: vec![camera],
        files: files.iter().map(|(sum, _)| sum.clone()).collect(),
    };
    let own: Vec<(String, Vec<u8>)> =
        files.iter().map(|(sum, text)| (sum.path.clone(), text.as_bytes().to_vec())).collect();
    let mut writer = SessionWriter::create(Arc::new(Disk), root, &manifest, &own).unwrap();
    let star = Target {
        name: "Vega".into(),
        target_kind: TargetKind::Star,
        on: true,
        ra_deg: Some(279.2347),
        dec_deg: Some(38.7837),
        tle: None,
        omm: None,
    };
    writer.event(at(0.0), What::Target(star));
    for number in 1..=count {
        assert!(writer.frame("cam", number, &frame(number)).unwrap().is_none());
    }
    assert_eq!(writer.finish(at(0.2 * count as f64 + 1.0), "done").lost, 0);
    Session::open(root).unwrap()
}

fn session(root: &Path) -> Session {
    session_of(root, FRAMES, target_px)
}

fn asked(recording: &Recording, path: &str, body: &Value) -> (u16, Vec<u8>) {
    let request = Request::new(true, path, "", body.to_string().into_bytes()).unwrap();
    let answer = recording.answer(&request);
    (answer.status, answer.body)
}

fn curve(recording: &Recording, recipe: &Value) -> Value {
    let (status, body) = asked(recording, "reduction", recipe);
    assert_eq!(status, 200, "{}", String::from_utf8_lossy(&body));
    serde_json::from_slice(&body).unwrap()
}

/// Mean rate over the frames that have one, and how many have none.
fn mean(curve: &Value) -> (f64, usize) {
    let rates = curve["channels"][0]["rate"].as_array().unwrap();
    let found: Vec<f64> = rates.iter().filter_map(Value::as_f64).collect();
    (found.iter().sum::<f64>() / found.len() as f64, rates.len() - found.len())
}

/// Truth: the light that was put into the frames (synthetic points, 4 px wide): 400 kADU/s of a star near the middle, 1 MADU/s of the target. An aperture of 6 px
/// leaves out 2^(−(2·6/4)²) = 0.2 %; the star's wings add nothing at 38 px. Within 0.5 %. Five frames with a lamp have ten times as much light: refused, they have no rate,
/// and the mean is the target's. The page's file is that of the library's `reduce` with the recipe that was saved, byte for byte.
#[test]
fn a_target_is_followed_from_where_somebody_saw_it() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("night");
    let session = session(&root);
    let recording = Recording::open(&root).unwrap();
    let mut recipe = json!({"target": "Vega", "visit": 1});
    let usual = curve(&recording, &recipe);
    let (star, _) = mean(&usual);
    assert!((star / (STAR_ADU / EXPOSURE_S) - 1.0).abs() < 0.02, "{star}");
    recipe["aperture_px"] = 6.0.into();
    // Seen in the middle of the visit: it is followed on and back.
    recipe["place"] =
        json!([{"camera": "cam", "frame": 400, "place_px": target_px(400).map(f64::round)}]);
    let followed = curve(&recording, &recipe);
    let (with_lamp, lost) = mean(&followed);
    println!("{FRAMES} frames in {:.2} s", followed["took_s"].as_f64().unwrap());
    let refused: Vec<u64> = LAMP.collect();
    recipe["refused"] = json!([{"camera": "cam", "frames": refused}]);
    let rescued = curve(&recording, &recipe);
    let (target, without) = mean(&rescued);
    let truth = TARGET_ADU / EXPOSURE_S;
    assert!(
        (target / truth - 1.0).abs() < 0.005,
        "{target} for {truth}, with the lamp {with_lamp}"
    );
    // A small aperture: the light that it leaves out is added and said, or it is said that it is not. Uncorrected: what a point catches within 3 px, to 2 % for the pixels' own width.
    let caught = 1.0 - 2_f64.powf(-2.25);
    let told = |curve: &Value| {
        let (rate, _) = mean(curve);
        let (notes, warnings) = (curve["notes"].to_string(), curve["warnings"].to_string());
        println!(
            "small aperture: {rate} for {truth}; {notes}; {warnings}; {}",
            curve["channels"][0]["flags"][0]
        );
        let corrected = notes.contains("aperture of 3.0 px set by hand");
        assert_ne!(corrected, warnings.contains("not corrected"), "{notes} {warnings}");
        let (expected, tolerance) = if corrected { (truth, 0.005) } else { (caught * truth, 0.02) };
        assert!((rate / expected - 1.0).abs() < tolerance, "{rate} for {expected}: {notes}");
        corrected
    };
    let mut small = recipe.clone();
    small["aperture_px"] = 3.0.into();
    assert!(told(&curve(&recording, &small)));
    // Four frames tell too little.
    let all_but_four: Vec<u64> = (1..=FRAMES).filter(|n| !(100..104).contains(n)).collect();
    small["refused"] = json!([{"camera": "cam", "frames": all_but_four}]);
    assert!(!told(&curve(&recording, &small)));
    assert_eq!(without, 5);
    assert!(with_lamp > 1.01 * truth || lost == 5, "{with_lamp}, {lost} lost");
    let track = rescued["track_px"].as_array().unwrap();
    assert_eq!(track.len() as u64, FRAMES - 5);
    let first = [0, 1].map(|i| track[0][i].as_f64().unwrap());
    let expected = [636.0, 460.0].map(|o: f64| o + 0.5);
    for i in 0..2 {
        let place = target_px(1)[i] + expected[i] - 0.5 * [1392.0, 1040.0][i];
        assert!((first[i] - place).abs() < 0.1, "{first:?} for {place}");
    }
    // The filters do what they say: nothing is as large as 5,000 px, and nothing stands out by 1e6 sigma.
    for (key, value) in [("area_px", json!([5000, 6000])), ("detect_sigma", json!(1e6))] {
        let mut none = recipe.clone();
        none[key] = value;
        let (_, without) = mean(&curve(&recording, &none));
        assert_eq!(without as u64, FRAMES, "{key}");
    }
    // A frame that is no frame of the visit is told of.
    let mut foreign = recipe.clone();
    foreign["refused"] = json!([{"camera": "cam", "frames": [99_999]}]);
    let warnings = curve(&recording, &foreign)["warnings"].to_string();
    assert!(warnings.contains("99999"), "{warnings}");
    // Ended from another page: the answer says so, and the next one comes.
    let recording = Arc::new(recording);
    let (other, slow) = (recording.clone(), recipe.clone());
    let under_way = std::thread::spawn(move || asked(&other, "reduction", &slow));
    while !under_way.is_finished() {
        assert_eq!(asked(&recording, "reduction/cancel", &json!({})).0, 200);
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let (status, body) = under_way.join().unwrap();
    let body = String::from_utf8(body).unwrap();
    assert!(status == 409 && body.contains("cancelled"), "{status} {body}");
    assert_eq!(curve(&recording, &recipe)["channels"], rescued["channels"]);
    for (bad, text) in [
        (json!({"target": "Vega", "visit": 2}), "there is no target Vega, visit 2"),
        (json!({"target": "Vega", "visit": 1, "aperture_px": -1}), "aperture_px"),
        (json!({"target": "Vega"}), "no target and visit"),
    ] {
        let (status, body) = asked(&recording, "reduction", &bad);
        let body = String::from_utf8(body).unwrap();
        assert!(status == 422 && body.contains(text), "{status} {body}");
    }
    assert_eq!(asked(&recording, "reduction", &json!({"colour": 1})).0, 400);
    // Saved, and reduced by the library with what was saved.
    let (status, body) =
        asked(&recording, "recipes", &json!({"name": "rescued", "recipe": recipe}));
    assert_eq!(status, 200, "{}", String::from_utf8_lossy(&body));
    let path = Recipe::path(&session, "rescued").unwrap();
    assert_eq!(path, root.join("reductions/rescued.toml"));
    let station = Station::of_session(&session).unwrap();
    let mut options = ReduceOptions::for_station(&station);
    Recipe::read(&path).unwrap().apply(&mut options);
    let mut night = reduce(&session, &station, &options, &Silent).unwrap();
    let visited = night.take(&session, &station).unwrap().unwrap();
    let text = ecsv::to_string(&visited.linear.to_table().unwrap()).unwrap();
    let (_, on_page) = asked(&recording, "reduction.ecsv", &recipe);
    assert!(text.as_bytes() == on_page);
    assert!(
        text.contains("by hand: target followed from 1 places, 5 frames refused"),
        "{}",
        &text[..2000]
    );
    // The session is as whole as before.
    assert!(session.check().unwrap().is_whole(), "{:?}", session.check().unwrap().findings);
    let again = asked(&recording, "recipes", &json!({"name": "rescued", "recipe": recipe}));
    assert_eq!(again.0, 409);
}

/// Truth: by hand: a camera that exposes 0.23 s later than it says: each sample of the page's curve is that much later, and its file is that of `reduce` with the same times, byte for byte.
#[test]
fn measured_times_are_taken_off_on_the_page() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("night");
    let session = session(&root);
    let recipe = json!({"target": "Vega", "visit": 1});
    let usual = curve(&Recording::open(&root).unwrap(), &recipe);
    let path = folder.path().join("timing.toml");
    let text = "format = 1\n[[camera]]\nname = \"cam\"\nclock = \"driver\"\nlatency_s = 0.23\nlatency_sigma_s = 0.002\n";
    std::fs::write(&path, text).unwrap();
    let timings = read_timings(&path).unwrap();
    let recording = Recording::open(&root).unwrap().timed(Some(timings.clone()));
    let timed = curve(&recording, &recipe);
    let times = |curve: &Value| -> Vec<f64> {
        let times = curve["channels"][0]["time_s"].as_array().unwrap();
        times.iter().map(|time| time.as_f64().unwrap()).collect()
    };
    let (before, after) = (times(&usual), times(&timed));
    assert_eq!((before.len(), after.len()), (1000, 1000));
    // To a nanosecond, of which times are.
    assert!(before.iter().zip(&after).all(|(a, b)| (b - a - 0.23).abs() < 2e-9));
    let notes = timed["notes"].to_string();
    assert!(notes.contains("its measured latency is taken off") && notes.contains("2.0e-3 s"));
    let station = Station::of_session(&session).unwrap();
    let mut options = ReduceOptions::for_station(&station);
    (options.target, options.visit) = (Some("Vega".into()), Some(1));
    options.frames.as_mut().unwrap().timings = Some(timings);
    let mut night = reduce(&session, &station, &options, &Silent).unwrap();
    let visited = night.take(&session, &station).unwrap().unwrap();
    let text = ecsv::to_string(&visited.linear.to_table().unwrap()).unwrap();
    let (_, on_page) = asked(&recording, "reduction.ecsv", &recipe);
    assert!(text.as_bytes() == on_page);
    // What repeats it names the times.
    let (status, saved) = asked(&recording, "recipes", &json!({"name": "timed", "recipe": recipe}));
    let saved: Value = serde_json::from_slice(&saved).unwrap();
    let repeat = saved["repeat"].as_str().unwrap();
    assert!(status == 200 && repeat.contains(&format!("--timing {} ", path.display())), "{saved}");
}

/// A target that moves by 2.5 px from frame to frame, to and fro past the star at 12 px: frames that are measured side by side expect it up to 17 px from where it is, nearer to the star. Truth: the places that
/// were put in, to 0.1 px (noise moves a centroid of so much light by a hundredth of that); the star is taken in no frame.
#[test]
fn a_fast_target_is_followed_past_a_star() {
    fn place_px(number: u64) -> [f64; 2] {
        let turn = number % 60;
        [18.0 + 2.5 * turn.min(60 - turn) as f64, 68.0]
    }
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("night");
    session_of(&root, 200, place_px);
    let recording = Recording::open(&root).unwrap();
    let place =
        |number: u64| json!({"camera": "cam", "frame": number, "place_px": place_px(number)});
    for first in [1, 78, 133] {
        let recipe =
            json!({"target": "Vega", "visit": 1, "aperture_px": 6.0, "place": [place(first)]});
        let followed = curve(&recording, &recipe);
        assert_eq!(mean(&followed).1, 0);
        let track = followed["track_px"].as_array().unwrap();
        assert_eq!(track.len(), 200);
        for (number, found) in (1..).zip(track) {
            let truth = place_px(number);
            for i in 0..2 {
                let place = truth[i] + [636.5, 460.5][i] - 0.5 * [1392.0, 1040.0][i];
                let found = found[i].as_f64().unwrap();
                assert!(
                    (found - place).abs() < 0.1,
                    "frame {number} from {first}: {found} for {place}"
                );
            }
        }
        // Frames that were in memory give what they gave.
        assert_eq!(curve(&recording, &recipe)["channels"], followed["channels"]);
    }
}
