//! Frames of other programs: `sunglint detect` and `sunglint reduce` on a folder that N.I.N.A. could have left (synthetic).

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use ndarray::Array2;
use std::path::Path;
use sunglint_formats::atomic::Overwrite;
use sunglint_formats::fits::{Header, Image, Pixels, Writer};
use sunglint_testkit::Campaign;

/// Light of the target, ADU in an exposure, and the exposure, s.
const LIGHT: f64 = 24_000.0;
const EXPOSURE_S: f64 = 10.0;
const SIGMA_PX: f64 = 1.4;
const SIZE: [usize; 2] = [420, 300];

/// Whole numbers that look like chance (the same everywhere): a normal variate by the sum of twelve even ones.
struct Chance(u64);

impl Chance {
    fn even(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / f64::from(1_u32 << 31)
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.even()).sum::<f64>() - 6.0
    }
}

fn point(frame: &mut Array2<f64>, [x, y]: [f64; 2], flux: f64) {
    let norm = flux / (std::f64::consts::TAU * SIGMA_PX * SIGMA_PX);
    for row in (y - 8.0).max(0.0) as usize..((y + 9.0) as usize).min(SIZE[1]) {
        for column in (x - 8.0).max(0.0) as usize..((x + 9.0) as usize).min(SIZE[0]) {
            let r2 = (column as f64 - x).powi(2) + (row as f64 - y).powi(2);
            frame[[row, column]] += norm * (-0.5 * r2 / (SIGMA_PX * SIGMA_PX)).exp();
        }
    }
}

fn write(path: &Path, frame: Array2<f64>, chance: &mut Chance, cards: &[(&str, &str)]) {
    let pixels = frame.mapv(|v| (v + 7.0 * chance.normal()).round().clamp(0.0, 65_535.0) as u16);
    let mut header = Header::default();
    header.set("SWCREATE", "N.I.N.A. 3.1.2.9001 (x64)", "synthetic");
    header.set("FILTER", "V", "");
    header.set("GAIN", 100_i64, "Sensor gain");
    header.set("EGAIN", 0.8, "[e-/ADU] Electrons per A/D unit");
    header.set("CCD-TEMP", -10.0, "");
    header.set("EXPTIME", EXPOSURE_S, "");
    for (keyword, value) in cards {
        match value.parse::<f64>() {
            Ok(number) => header.set(keyword, number, ""),
            Err(_) => header.set(keyword, *value, ""),
        }
    }
    let mut writer = Writer::new();
    writer.image(&Image { header, pixels: Pixels::U16(pixels.into_dyn()) }).unwrap();
    writer.write_file(path, Overwrite::Refuse).unwrap();
}

/// Makes six frames of a streak of 40 px that moves 4 px/s among 30 stars, some of them brighter; darks that fit and that do not; frames that cannot be used; a list of the stars about
/// right ascension 150° on the equator, 3.6″ a pixel, with a zero point of 20.
pub fn made_up(folder: &Path) {
    std::fs::create_dir_all(folder.join("darks")).unwrap();
    let mut chance = Chance(7);
    let stars: Vec<([f64; 2], f64)> = (0..30)
        .map(|i| {
            let place = [410.0 * chance.even() + 5.0, 290.0 * chance.even() + 5.0];
            (place, 2000.0 * 1.25_f64.powi(i))
        })
        .collect();
    let mut list = String::from("ra,dec,Vmag,Bmag\n");
    for (i, ([x, y], flux)) in stars.iter().enumerate() {
        let [east, north] = [210.0 - x, y - 150.0].map(|px| (px * 3.6 / 3600.0).to_radians());
        let (ra, dec) = (east.atan(), (north * east.atan().cos()).atan());
        let v = 20.0 - 2.5 * (flux / EXPOSURE_S).log10();
        let b = v + 0.5 + 0.1 * (i % 4) as f64;
        list += &format!("{},{},{v:.4},{b:.4}\n", 150.0 + ra.to_degrees(), dec.to_degrees());
    }
    std::fs::write(folder.join("stars.csv"), list).unwrap();
    for i in 0..6_u32 {
        let mut frame = Array2::from_elem((SIZE[1], SIZE[0]), 500.0);
        for (place, flux) in &stars {
            point(&mut frame, *place, *flux);
        }
        // 4 px/s along 30°, 12 s from one frame to the next.
        let (sin, cos) = 30_f64.to_radians().sin_cos();
        let start = [30.0 + 48.0 * cos * f64::from(i), 40.0 + 48.0 * sin * f64::from(i)];
        for step in 0..200 {
            let t = 40.0 * (f64::from(step) + 0.5) / 200.0;
            point(&mut frame, [start[0] + t * cos, start[1] + t * sin], LIGHT / 200.0);
        }
        let time = format!("2026-03-04T20:{:02}:{:02}.250", i * 12 / 60, i * 12 % 60);
        let cards = [("IMAGETYP", "LIGHT"), ("DATE-OBS", time.as_str())];
        write(&folder.join(format!("light_{i}.fits")), frame, &mut chance, &cards);
    }
    let flat = || Array2::from_elem((SIZE[1], SIZE[0]), 100.0);
    for i in 0..4 {
        let exposure = if i == 3 { "5" } else { "10" };
        let cards = [("IMAGETYP", "DARK"), ("EXPTIME", exposure)];
        write(&folder.join(format!("darks/dark_{i}.fits")), flat(), &mut chance, &cards);
    }
    write(&folder.join("timeless.fits"), flat(), &mut chance, &[("IMAGETYP", "LIGHT")]);
    std::fs::write(folder.join("torn.fits"), "SIMPLE  = ").unwrap();
}

/// Truth: what was drawn: a place in each frame, 2,400 ADU/s, 4 px/s; ten of the stars are brighter than the target. Tolerance: 3 % of the light (noise 1 %), 0.3 px.
#[test]
fn a_folder_of_another_program_becomes_a_light_curve() {
    let folder = Folder::new("others");
    made_up(&folder.path("night"));
    let result = folder.json(&["reduce", "night", "--along", "4", "--json", "-o", "curve.ecsv"]);
    let frames = result["frames"].as_array().unwrap();
    assert_eq!(frames.len(), 6);
    for (i, frame) in frames.iter().enumerate() {
        assert_eq!(frame["shape"], "streak", "{frame}");
        let rate = frame["rate_adu_per_s"].as_f64().unwrap();
        assert!((rate / 2400.0 - 1.0).abs() < 0.03, "{i}: {rate}");
        let length = frame["length_px"].as_f64().unwrap();
        assert!((length - 40.0).abs() < 1.0, "{i}: {length}");
        let (sin, cos) = 30_f64.to_radians().sin_cos();
        let at = 20.0 + 48.0 * i as f64;
        let truth = [30.0 + at * cos, 40.0 + at * sin];
        for axis in 0..2 {
            let place = frame["place_px"][axis].as_f64().unwrap();
            assert!((place - truth[axis]).abs() < 0.4, "{i}: {place} {}", truth[axis]);
        }
        // Even light: each quarter a quarter of the time and the same rate.
        let along = frame["along"].as_array().unwrap();
        assert_eq!(along.len(), 4);
        for part in along {
            let rate = part["rate_adu_per_s"].as_f64().unwrap();
            assert!((rate / 2400.0 - 1.0).abs() < 0.2, "{i}: {part}");
        }
    }
    // Middle of the exposure: 5 s after DATE-OBS; the first of four parts 1.25 s after it.
    assert_eq!(frames[0]["time_utc"], "2026-03-04T20:00:05.2500Z");
    let first = frames[0]["along_utc"][0].as_str().unwrap();
    assert!(first.starts_with("2026-03-04T20:00:01.50"), "{first}");
    let motion = &result["motion_px_per_s"];
    let speed = motion[0].as_f64().unwrap().hypot(motion[1].as_f64().unwrap());
    assert!((speed - 4.0).abs() < 0.05, "{speed}");
    let left = result["left_out"].to_string();
    for words in ["cannot be read", "without a time", "dark frames of another exposure"] {
        assert!(left.contains(words), "{left}");
    }
    assert_eq!(
        (&result["is_instrumental"], &result["stars"]),
        (&true.into(), &serde_json::Value::Null)
    );
    let curve = std::fs::read_to_string(folder.path("curve.ecsv")).unwrap();
    assert!(curve.contains("v_rate_hz") && curve.contains("no zero point"), "{curve}");
    let text = folder.done(&["reduce", "night"]);
    assert!(text.contains("3 dark") && text.contains("instrumental: no zero point"), "{text}");
    // With the list of its stars: 2,400 ADU/s at a zero point of 20 are 11.55 mag; the pattern of the stars is found without a coordinate in the headers.
    let mut with_stars = vec!["reduce", "night", "--catalogue", "night/stars.csv", "--json"];
    with_stars.extend(["--near", "150", "0", "--scale-arcsec", "3.6"]);
    for frame in folder.json(&with_stars)["frames"].as_array().unwrap() {
        let magnitude = frame["magnitude"].as_f64().unwrap();
        assert!((magnitude - 11.55).abs() < 0.06, "{frame}");
    }
    // A place that was given finds the same.
    let given = folder.json(&["reduce", "night", "--place-px", "47", "50", "--json"]);
    assert_eq!(given["frames"][5]["place_px"], frames[5]["place_px"]);
}

#[test]
fn a_frame_is_searched_and_drawn() {
    let folder = Folder::new("detect");
    made_up(&folder.path("night"));
    let found = folder.json(&[
        "detect",
        "night/light_2.fits",
        "--json",
        "-o",
        "marked.png",
        "-o",
        "marked.svg",
    ]);
    let frame = &found["frames"][0];
    let streaks = frame["streaks"].as_array().unwrap();
    assert_eq!(streaks.len(), 1, "{streaks:?}");
    assert!((streaks[0]["angle_deg"].as_f64().unwrap() - 30.0).abs() < 1.0, "{streaks:?}");
    assert!(frame["points"].as_array().unwrap().len() >= 25);
    assert_eq!(frame["program"], "N.I.N.A. 3.1.2.9001 (x64)");
    assert!(folder.path("marked.png").metadata().unwrap().len() > 10_000);
    assert!(folder.path("marked.svg").exists());
    let table = folder.done(&["detect", "night/light_2.fits", "-o", "-"]);
    assert!(table.contains("streak") && table.contains("point"), "{table}");
    folder.refused(2, &["detect"]);
    let nothing = folder.refused(1, &["detect", "night/torn.fits"]);
    assert!(nothing.contains("torn.fits"), "{nothing}");
    let wrong = folder.refused(1, &["detect", "night/light_2.fits", "--streak-sigma", "1"]);
    assert!(wrong.contains("streak_sigmas is 1, expected 5 or above"), "{wrong}");
}

/// A night for `tests/peers/star_frames.py`.
#[derive(Debug, Clone, Copy)]
struct Drawn<'a> {
    /// `sidereal` or `tracked`; coordinates in the headers (`header`, `shifted`, `none`); magnitude of the target.
    how: [&'a str; 3],
    frames: usize,
    seed: u64,
    /// Stars on five times the frame, and the program whose headers are imitated.
    stars: usize,
    program: Option<usize>,
}

impl<'a> Drawn<'a> {
    fn new(how: [&'a str; 3], frames: usize, seed: u64) -> Self {
        Self { how, frames, seed, stars: 260, program: None }
    }

    fn name(&self) -> String {
        format!("{}_{}_{}", self.how[0], self.how[1], self.seed)
    }
}

/// Result of a night that `tests/peers/star_frames.py` drew.
struct Night {
    /// Differences of magnitudes from the truth, their standard deviations, and the stars of the zero point.
    off: Vec<[f64; 3]>,
    /// Frames without a magnitude.
    without: usize,
    /// Largest distance of a place from the truth, arcsec.
    away: f64,
    list: String,
}

fn star_night(python: &Path, folder: &Folder, drawn: Drawn<'_>) -> Night {
    let script = sunglint_testkit::repository().join("tests/peers/star_frames.py");
    let name = drawn.name();
    let path = folder.path(&name);
    std::fs::create_dir_all(&path).unwrap();
    let [kind, coordinates, brightness] = drawn.how;
    let numbers = [drawn.frames.to_string(), drawn.seed.to_string()];
    let program = drawn.program.map(|p| p.to_string());
    let made = std::process::Command::new(python)
        .arg(&script)
        .arg(&path)
        .args([kind, coordinates, &numbers[0], &numbers[1], brightness])
        .arg(drawn.stars.to_string())
        .args(program)
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let list = format!("{name}/stars.csv");
    let curve = format!("{name}.ecsv");
    let result = folder.json(&["reduce", &name, "--catalogue", &list, "--json", "-o", &curve]);
    let truth = std::fs::read_to_string(path.join("truth.json")).unwrap();
    let truth: serde_json::Value = serde_json::from_str(&truth).unwrap();
    let mut night = Night { off: Vec::new(), without: 0, away: 0.0, list };
    let number = |v: &serde_json::Value| v.as_f64().unwrap_or(f64::NAN);
    let frames = result["frames"].as_array().unwrap();
    assert_eq!(frames.len(), truth.as_array().unwrap().len(), "{}", result["left_out"]);
    for (frame, truth) in frames.iter().zip(truth.as_array().unwrap()) {
        // By the clock of the headers, whose cards differ from program to program.
        let middle_s = number(&truth["middle_s"]);
        let middle = format!(
            "2026-03-04T20:{:02}:{:06.3}",
            (middle_s / 60.0).floor(),
            middle_s.rem_euclid(60.0)
        );
        let time = frame["time_utc"].as_str().unwrap();
        assert!(time.starts_with(&middle), "{time} {middle}");
        let magnitude = number(&frame["magnitude"]);
        if magnitude.is_nan() {
            assert!(!frame["remark"].as_str().unwrap().is_empty(), "{frame}");
            night.without += 1;
            continue;
        }
        // No magnitude without a zero point that is named.
        let band = &result["stars"]["bands"][0];
        assert_eq!((&band["column"], &band["system"]), (&"Vmag".into(), &"Vega".into()));
        let stars = number(&frame["zero_point"]["stars"]);
        assert!(stars >= 3.0 && number(&frame["zero_point"]["sigma_mag"]) > 0.0, "{frame}");
        let off = magnitude - number(&truth["magnitude"]);
        night.off.push([off, number(&frame["sigma_mag"]), stars]);
        let place = |k: usize| number(&frame["sky_deg"][k]) - number(&truth["sky"][k]);
        let dec = number(&truth["sky"][1]).to_radians();
        let ra = (place(0) + 180.0).rem_euclid(360.0) - 180.0;
        night.away = night.away.max(3600.0 * (ra * dec.cos()).hypot(place(1)));
    }
    night
}

/// The same frames by photutils, which is told where everything is: differences from the truth and their standard deviations.
fn by_photutils(python: &Path, folder: &Path) -> Vec<[f64; 2]> {
    let script = sunglint_testkit::repository().join("tests/peers/star_frames_photutils.py");
    let made = std::process::Command::new(python).arg(script).arg(folder).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let found: Vec<serde_json::Value> = serde_json::from_slice(&made.stdout).unwrap();
    let truth = std::fs::read_to_string(folder.join("truth.json")).unwrap();
    let truth: Vec<serde_json::Value> = serde_json::from_str(&truth).unwrap();
    let one = |(found, truth): (&serde_json::Value, &serde_json::Value)| {
        let off = found["magnitude"].as_f64()? - truth["magnitude"].as_f64()?;
        Some([off, found["sigma"].as_f64()?])
    };
    found.iter().zip(&truth).filter_map(one).collect()
}

fn middle(night: &Night) -> f64 {
    let mut off: Vec<f64> = night.off.iter().map(|o| o[0]).collect();
    off.sort_by(f64::total_cmp);
    off[off.len() / 2]
}

/// Truth: what `tests/peers/star_frames.py` drew with numpy and placed with astropy: magnitudes of the target, zero points, places on the sky; profiles with wings, clouds, a colour
/// term, stars that are off by 0.015 mag each.
///
/// Tolerance: 3.5 of the stated standard deviations; 0.06 mag for the middle (the target's colour, drawn with 0.2, shifts all of a night by 0.016 mag); 4″ (1.7 px) for places.
#[test]
fn stars_of_a_list_make_magnitudes() {
    let Some(python) =
        sunglint_testkit::peer_python("stars_of_a_list_make_magnitudes", &["astropy", "scipy"])
    else {
        return;
    };
    let folder = Folder::new("star_frames");
    let night = star_night(&python, &folder, Drawn::new(["sidereal", "header", "10"], 6, 5));
    assert_eq!((night.off.len(), night.without), (6, 0));
    assert!(night.off.iter().all(|[d, s, _]| d.abs() < 3.5 * s && *s < 0.15), "{:?}", night.off);
    assert!(middle(&night).abs() < 0.06 && night.away < 4.0, "{:?} {}", night.off, night.away);
    // What was written is a light curve of magnitudes to the others.
    let import = folder.done(&["import", "sidereal_header_5.ecsv"]);
    assert!(
        import.contains("6 rows") && import.contains("`magnitude` is the magnitude"),
        "{import}"
    );
    // A column that is not there; a list of another field.
    let frames = "sidereal_header_5";
    let error = folder
        .refused(1, &["reduce", frames, "--catalogue", &night.list, "--catalogue-mag", "Gmag"]);
    assert!(error.contains("Gmag") && error.contains("Vmag"), "{error}");
    std::fs::write(
        folder.path("elsewhere.csv"),
        "ra,dec,V\n10,20,9\n10.1,20,9.5\n10.2,20.1,10\n10.3,20.2,11\n10.4,20.1,12\n",
    )
    .unwrap();
    let elsewhere = folder.done(&["reduce", frames, "--catalogue", "elsewhere.csv"]);
    assert!(
        elsewhere.contains("no zero point: ") && elsewhere.contains("instrumental: no zero point"),
        "{elsewhere}"
    );
}

/// Truth: skyfield's propagation and topocentric place, astropy's Sun (`tests/peers/sights.py`). Tolerance: 0.01 deg (0.02 in azimuth), and 50 m beside 2.6e-5 of the range: skyfield's place is that of the same moment,
/// ours that when the light left, and a low satellite moves by v/c of the range meanwhile; magnitudes at 1,000 km by m - 5 lg(r/1000 km), worked out here. Columns of SCORE: those of its data format.
#[test]
fn elements_make_ranges_and_phases() {
    let Some(python) = sunglint_testkit::peer_python(
        "elements_make_ranges_and_phases",
        &["astropy", "scipy", "skyfield"],
    ) else {
        return;
    };
    let folder = Folder::new("sights");
    let night = star_night(&python, &folder, Drawn::new(["sidereal", "header", "10"], 4, 7));
    let elements = sunglint_testkit::repository().join("fixtures/passes/satellites.tle");
    let text = std::fs::read_to_string(&elements).unwrap();
    let number = text.lines().find_map(|l| l.strip_prefix("1 ")).unwrap()[..5].to_owned();
    let elements = elements.display().to_string();
    let reduce = ["reduce", "sidereal_header_7", "--catalogue", &night.list, "--station", "ufo"];
    let of = ["--elements", &elements, "--object", &number];
    let who = ["--observer", "a@example.org", "0000-0001-2345-6789", "0.4 m, CMOS"];
    let score = ["--score", "score.csv", "--json", "-o", "m.ecsv", "-q"];
    // The stars are made up: the satellite is elsewhere.
    let error = folder.refused(1, &[&reduce[..], &of, &who, &score].concat());
    assert!(error.contains("no SCORE file") && !folder.path("score.csv").exists(), "{error}");
    let result = folder.json(&[&reduce[..], &of, &who, &score, &["--anyway"]].concat());
    let site = &result["object"]["site"];
    let frames = result["frames"].as_array().unwrap();
    let number_of = |v: &serde_json::Value| v.as_f64().unwrap();
    let mut command = std::process::Command::new(&python);
    command
        .arg(sunglint_testkit::repository().join("tests/peers/sights.py"))
        .args([&elements, &number]);
    command.args((0..3).map(|k| site[k].to_string()));
    let made =
        command.args(frames.iter().map(|f| f["time_utc"].as_str().unwrap())).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let truth: Vec<[f64; 4]> = serde_json::from_slice(&made.stdout).unwrap();
    assert_eq!(truth.len(), 4);
    for (frame, [range_km, altitude, azimuth, phase]) in frames.iter().zip(&truth) {
        let sight = &frame["sight"];
        let near = |key: &str, truth: f64, within: f64| {
            let found = number_of(&sight[key]);
            assert!((found - truth).abs() < within, "{key}: {found}, skyfield {truth}");
        };
        near("range_km", *range_km, 0.05 + 2.6e-5 * range_km);
        near("altitude_deg", *altitude, 0.01);
        near("azimuth_deg", *azimuth, 0.02);
        near("phase_angle_deg", *phase, 0.01);
        let standard = number_of(&frame["magnitude"]) - 5.0 * (range_km / 1000.0).log10();
        assert!((number_of(&frame["magnitude_1000km"]) - standard).abs() < 1e-3);
    }
    let rate = (truth[1][0] - truth[0][0]).signum();
    assert_eq!(number_of(&frames[0]["sight"]["range_rate_km_s"]).signum(), rate);
    let written = std::fs::read_to_string(folder.path("score.csv")).unwrap();
    let mut lines = written.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    assert_eq!((header.len(), header[4], header[26]), (27, "apparent_magnitude", "mpc_code"));
    assert_eq!(lines.count(), 4);
    assert!(written.contains("0000-0001-2345-6789") && written.contains("a@example.org"));
    // No site, no such object, no magnitude.
    let bare = ["reduce", "sidereal_header_7", "--elements", &elements, "--object"];
    let error = folder.refused(1, &[&bare[..], &[&number]].concat());
    assert!(error.contains("--elements needs the place"), "{error}");
    let error = folder.refused(2, &[&bare[..], &["99999", "--station", "ufo"]].concat());
    assert!(error.contains("--object"), "{error}");
    folder.refused(2, &["reduce", "sidereal_header_7", "--score", "s.csv"]);
}

/// Columns: counts of a night, sums of magnitudes from the truth where five stars make the zero point, and the same by photutils.
const NIGHT: [&str; 11] = [
    "frames",
    "without",
    "beyond_two_sigmas",
    "with_five_stars",
    "sum_mag",
    "sum_distance_mag",
    "largest_distance_arcsec",
    "photutils_frames",
    "photutils_beyond_two_sigmas",
    "photutils_sum_mag",
    "photutils_sum_distance_mag",
];

/// Nights of ten frames as above, one program's headers a night (N.I.N.A., MaxIm DL, SharpCap, Ekos, ASIAIR in turn), every other one sidereal and tracked; coordinates in the headers, 25 px off, or none; in every
/// fourth pair of nights half of the stars. Clouds in a fifth of the frames.
///
/// Asked: 95 % within 2 standard deviations, no more than 0.02 mag of bias where five stars or more make the zero point. Tolerance: 92 % (the target's colour is one draw a night, so that there are
/// 50 independent parts). Beside them photutils in a page of Python, which is told all places.
#[test]
fn campaign_star_frames() {
    let Some(python) = sunglint_testkit::peer_python(
        "campaign_star_frames",
        &["astropy", "numpy", "photutils", "scipy"],
    ) else {
        return;
    };
    let mut campaign = Campaign::in_shards("star_frames", 50, 2, &NIGHT);
    let folder = Folder::new("star_frames_campaign");
    for seed in campaign.seeds() {
        let k = seed as usize;
        let coordinates = ["none", "header", "shifted"][k / 2 % 3];
        // Trails hide the pattern of the stars.
        let how = match k % 2 {
            0 => ["sidereal", coordinates, "9.5"],
            _ => ["tracked", if coordinates == "none" { "shifted" } else { coordinates }, "11"],
        };
        let stars = if k / 2 % 4 == 3 { 130 } else { 260 };
        let drawn = Drawn { stars, program: Some(k % 5), ..Drawn::new(how, 10, 300 + seed) };
        let night = star_night(&python, &folder, drawn);
        let peer = by_photutils(&python, &folder.path(&drawn.name()));
        println!("{seed}: {drawn:?} {:.3?} {} {:.2}", night.off, night.without, night.away);
        println!("    photutils: {peer:.3?}");
        // A night's frames are 13 MB.
        std::fs::remove_dir_all(folder.path(&drawn.name())).unwrap();
        let five: Vec<f64> = night.off.iter().filter(|o| o[2] >= 5.0).map(|o| o[0]).collect();
        let off: Vec<f64> = peer.iter().map(|o| o[0]).collect();
        let beyond = |off: f64, sigma: f64| f64::from(u8::from(off.abs() > 2.0 * sigma));
        let distance = |off: &[f64]| off.iter().map(|o| o.abs()).sum::<f64>();
        let row = [
            (night.off.len() + night.without) as f64,
            night.without as f64,
            night.off.iter().map(|o| beyond(o[0], o[1])).sum(),
            five.len() as f64,
            five.iter().sum(),
            distance(&five),
            night.away,
            peer.len() as f64,
            peer.iter().map(|o| beyond(o[0], o[1])).sum(),
            off.iter().sum(),
            distance(&off),
        ];
        campaign.keep(seed, &row);
    }
    let all: [f64; NIGHT.len()] = NIGHT.map(|name| campaign.column(name).iter().sum());
    let [
        frames,
        without,
        beyond,
        five,
        off,
        distance,
        _,
        peer,
        peer_beyond,
        peer_off,
        peer_distance,
    ] = all;
    let away = campaign.column("largest_distance_arcsec").into_iter().fold(0.0, f64::max);
    let (bias, peer_bias) = (off / five, peer_off / peer);
    println!(
        "{frames} frames, {without} without, {beyond} beyond 2 σ; bias {bias:+.4}, mean distance {:.4} of {five} with five stars; photutils: {peer} frames, {peer_beyond} beyond 2 σ, bias {peer_bias:+.4}, mean distance {:.4}",
        distance / five,
        peer_distance / peer
    );
    let whole = campaign.is_whole();
    campaign.largest("frames", frames);
    campaign.largest("without_a_magnitude", without);
    campaign.largest("beyond_two_sigmas", beyond);
    campaign.largest("with_five_stars", five);
    campaign.largest("largest_distance_arcsec", away);
    campaign.largest("photutils_frames", peer);
    campaign.largest("photutils_beyond_two_sigmas", peer_beyond);
    if std::env::var("SUNGLINT_CAMPAIGN").is_ok_and(|name| name == "star_frames") {
        // Means, which few nights may exceed by chance.
        campaign.largest("bias_mag", bias);
        campaign.largest("mean_distance_mag", distance / five);
        campaign.largest("photutils_bias_mag", peer_bias);
        campaign.largest("photutils_mean_distance_mag", peer_distance / peer);
    }
    campaign.finish();
    if whole {
        assert!(beyond <= 0.08 * (frames - without) && without <= 0.05 * frames);
        assert!(bias.abs() < 0.02, "{bias}");
    }
}

/// Truth: by construction. Frames without a gain are warned of, and a gain that is told makes σ larger (photon noise is no longer left out); frames of nothing end with 1 and the reason, and so does a list
/// that matches no frame, with a warning.
#[test]
fn what_is_missing_is_said() {
    let folder = Folder::new("missing");
    let mut chance = Chance(3);
    for k in 0..6 {
        for (name, light) in [("moving", LIGHT), ("nothing", 0.0)] {
            let mut frame = Array2::from_elem([SIZE[1], SIZE[0]], 400.0);
            point(&mut frame, [100.0 + 14.0 * f64::from(k), 150.0], light);
            for i in 0..9 {
                point(&mut frame, [40.0 * f64::from(i) + 22.0, 40.0 + 23.0 * f64::from(i)], light);
            }
            std::fs::create_dir_all(folder.path(name)).unwrap();
            let time = format!("2021-03-04T20:00:{:02}", 10 * k % 60);
            let cards = [("DATE-OBS", time.as_str()), ("EGAIN", "0")];
            write(&folder.path(name).join(format!("{k}.fits")), frame, &mut chance, &cards);
        }
    }
    let sigma = |extra: &[&str]| {
        let all = [&["reduce", "moving", "--json"], extra].concat();
        let output = folder.run(&all);
        let said = String::from_utf8(output.stderr).unwrap();
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        (json["frames"][2]["sigma_adu_per_s"].as_f64().unwrap(), said)
    };
    let (without, said) = sigma(&[]);
    assert!(said.contains("gain") && said.contains("photon noise"), "{said}");
    let (with, said) = sigma(&["--gain-e-per-adu", "0.8"]);
    assert!(!said.contains("photon noise"), "{said}");
    // √(24,000 ADU × 0.8) e⁻ in 10 s.
    let own = (LIGHT / 0.8).sqrt() / EXPOSURE_S;
    assert!((with / without.hypot(own) - 1.0).abs() < 0.05, "{with} {without} {own}");
    folder.refused(2, &["reduce", "moving", "--gain-e-per-adu", "0"]);
    let output = folder.run(&["reduce", "nothing", "-o", "n.ecsv"]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("none of 6 frames gave a rate"), "{said}");
    // A list of stars elsewhere.
    std::fs::write(folder.path("list.csv"), "ra,dec,Vmag\n10,20,8\n11,21,9\n12,20,7\n").unwrap();
    let output = folder.run(&["reduce", "moving", "--catalogue", "list.csv", "-o", "c.ecsv"]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("zero point") || said.contains("stars"), "{said}");
}

/// Folders of which nothing can be measured, and a file of two images (synthetic). Truth: what was written into them: the reason of the first file, the kinds of the frames, the image that is asked for.
#[test]
fn a_folder_of_nothing_says_why() {
    let folder = Folder::new("nothing");
    let write_to = |name: &str, images: &[(&str, Vec<usize>, u16)]| {
        let path = folder.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let mut writer = Writer::new();
        for (extension, shape, value) in images {
            let mut header = Header::default();
            header.set("DATE-OBS", "2026-03-04T20:00:00.250", "");
            header.set("EXPTIME", 2.0, "");
            if !extension.is_empty() {
                header.set("EXTNAME", *extension, "");
            }
            // Flats and covers would be constant: a step from pixel to pixel is a picture.
            let mut pixels = ndarray::ArrayD::from_elem(ndarray::IxDyn(shape), *value);
            pixels.iter_mut().enumerate().for_each(|(i, v)| *v += (i % 3) as u16);
            writer.image(&Image { header, pixels: Pixels::U16(pixels) }).unwrap();
        }
        writer.write_file(path, Overwrite::Refuse).unwrap();
    };
    write_to("cubes/a.fits", &[("", vec![5, 30, 40], 7)]);
    let cube = folder.refused(1, &["reduce", "cubes"]);
    for words in ["1 cannot be read", "cubes/a.fits", "a cube of 5 planes", "frames-of-others.md"] {
        assert!(cube.contains(words), "{cube}");
    }
    write_to("flats/flat_1.fits", &[("", vec![30, 40], 7)]);
    write_to("flats/flat_2.fits", &[("", vec![30, 40], 7)]);
    write_to("flats/bias_1.fits", &[("", vec![30, 40], 7)]);
    let flats = folder.refused(1, &["reduce", "flats"]);
    assert!(flats.contains("1 bias, 2 flat"), "{flats}");
    write_to(
        "two.fits",
        &[("MASK", vec![30, 40], 0), ("CHIP1", vec![30, 40], 100), ("CHIP2", vec![20, 50], 200)],
    );
    let size = |more: &[&str]| {
        let arguments = [&["detect", "two.fits", "--json"][..], more].concat();
        let frame = folder.json(&arguments)["frames"][0].clone();
        (frame["size_px"].clone(), frame["notes"].to_string())
    };
    let (usual, notes) = size(&[]);
    assert_eq!(usual, serde_json::json!([40, 30]));
    assert!(notes.contains("image 2 of 3") && notes.contains("CHIP2"), "{notes}");
    assert_eq!(size(&["--extension", "chip2"]).0, serde_json::json!([50, 20]));
    let missing = folder.refused(1, &["detect", "two.fits", "--extension", "CHIP3"]);
    assert!(missing.contains("CHIP3") && missing.contains("CHIP1"), "{missing}");
}

/// Frames without a picture (synthetic): all pixels NaN, all of one value. Truth: by construction. `detect` and `reduce` say which it is; with a good frame beside them that one is still found, and a folder of
/// nothing else ends with 1.
#[test]
fn frames_without_a_picture_are_told() {
    let folder = Folder::new("no-picture");
    std::fs::create_dir_all(folder.path("empty")).unwrap();
    for (name, value) in [("nan", f32::NAN), ("even", 1890.0)] {
        let mut header = Header::default();
        header.set("DATE-OBS", "2026-03-04T20:00:00.250", "");
        header.set("EXPTIME", 2.0, "");
        let pixels = Pixels::F32(Array2::from_elem([60, 80], value).into_dyn());
        let mut writer = Writer::new();
        writer.image(&Image { header, pixels }).unwrap();
        let path = folder.path("empty").join(format!("{name}.fits"));
        writer.write_file(path, Overwrite::Refuse).unwrap();
    }
    let nan = folder.refused(1, &["detect", "empty/nan.fits"]);
    assert!(nan.contains("nan.fits") && nan.contains("none of its 4800 pixels"), "{nan}");
    let even = folder.run(&["detect", "empty/even.fits"]);
    let said = String::from_utf8(even.stderr).unwrap();
    assert!(said.contains("all of its 4800 pixels") && said.contains("1890"), "{said}");
    let reduced = folder.refused(1, &["reduce", "empty"]);
    assert!(reduced.contains("2 without a picture"), "{reduced}");
    // One that is good, and both beside it.
    let mut frame = Array2::from_elem([SIZE[1], SIZE[0]], 400.0);
    point(&mut frame, [100.0, 150.0], LIGHT);
    let path = folder.path("empty").join("good.fits");
    write(&path, frame, &mut Chance(5), &[("DATE-OBS", "2021-03-04T20:00:00")]);
    let all = folder.json(&["detect", "empty", "--json"]);
    let frames = all["frames"].as_array().unwrap();
    assert_eq!(frames.len(), 2, "{all}");
    assert!(frames.iter().any(|f| f["points"].as_array().is_some_and(|p| p.len() == 1)), "{all}");
}

/// The origin of a folder's curves. Truth: SHA-256 of the frames' own SHA-256 by coreutils, as docs/frames-of-others.md says it is made; the numbers of the frames that were written; the command as it was typed,
/// without the place of the result.
#[test]
fn curves_of_a_folder_say_where_they_come_from() {
    let folder = Folder::new("origin");
    made_up(&folder.path("night"));
    folder.done(&[
        "reduce",
        "night",
        "--detect-sigma",
        "7",
        "-o",
        "out/",
        "--catalogue",
        "night/stars.csv",
        "--near",
        "150",
        "0",
        "--scale-arcsec",
        "3.6",
    ]);
    let files: Vec<String> = {
        let all = folder.json(&["reduce", "night", "--json"]);
        all["frames"]
            .as_array()
            .unwrap()
            .iter()
            .map(|f| f["file"].as_str().unwrap().to_owned())
            .collect()
    };
    let script = format!("sha256sum {} | cut -c1-64 | sha256sum | cut -c1-64", files.join(" "));
    let sum =
        std::process::Command::new("sh").args(["-c", &script]).current_dir(&folder.0).output();
    let sum = String::from_utf8(sum.unwrap().stdout).unwrap();
    for name in ["light_curve", "magnitudes"] {
        let table =
            sunglint_formats::ecsv::read(folder.path("out").join(format!("{name}.ecsv"))).unwrap();
        let origin = &table.meta["provenance"];
        assert_eq!(origin["frames"]["count"], files.len(), "{origin}");
        assert_eq!(origin["frames"]["first"], files[0].as_str());
        assert_eq!(origin["frames"]["last"], files[files.len() - 1].as_str());
        assert_eq!(origin["frames"]["sha256"], sum.trim());
        assert_eq!(
            origin["command"],
            "sunglint reduce night --detect-sigma 7 --catalogue night/stars.csv --near 150 0 --scale-arcsec 3.6"
        );
        let version = format!("sunglint {}", env!("CARGO_PKG_VERSION"));
        assert_eq!(origin["program"], version.as_str());
        assert_eq!(origin["inputs"][0]["file"], "night/stars.csv");
        assert!(origin["dark_frames"]["count"].as_u64().is_some_and(|n| n > 0), "{origin}");
    }
}
