//! `passes … -o NIGHT.toml`: a plan out of elements and instruments, as it stands, as `observe` reads it, and as its stars then come out.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::night::frames;
use crate::common::{DEVICES, Folder};
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_formats::session::Session;
use sunglint_formats::time::parse_utc;
use sunglint_testkit::fixture;

/// A small telescope with a monochrome camera behind a wheel.
const STATION: &str = r#"name = "small"
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
width_px = 160
height_px = 120
pixel_scale_arcsec = 2
gain_e_per_adu = 1
read_noise_e = 4
full_well_e = 60000
adc_bits = 16
dark_e_per_s = 0.01
[[channel]]
name = "v"
camera_plane = "L"
filter = "V"
transmission = 0.3
efficiency = "qe.csv"
[[channel]]
name = "r"
camera_plane = "L"
filter = "R"
transmission = 0.3
efficiency = "qe.csv"
"#;

fn command<'a>(tle: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let base = ["passes", "--tle", tle, "--from", "2024-08-12T17:00", "--to", "2024-08-13T05:00"];
    // Those whose elements are of that day.
    let of = ["--norad", "90002,90004,90006,90007", "--devices", "devices.toml"];
    [&base[..], &of, more].concat()
}

fn elements() -> String {
    fixture("passes/satellites.tle").display().to_string()
}

/// The visits of a plan as TOML has them.
fn visits(text: &str) -> Vec<toml::Table> {
    let table: toml::Table = text.parse().unwrap();
    let visits = table["visit"].as_array().unwrap().iter();
    visits.map(|visit| visit.as_table().unwrap().clone()).collect()
}

fn seconds(visit: &toml::Table) -> [f64; 2] {
    let begun = parse_utc("2024-08-12T00:00:00Z").unwrap();
    let time = |key: &str| {
        let text = visit.get(key)?.as_str()?;
        Some((parse_utc(text).unwrap() - begun).to_seconds())
    };
    let from = time("from").unwrap();
    let length = |key: &str| {
        visit.get(key).and_then(|v| v.as_float().or_else(|| v.as_integer().map(|i| i as f64)))
    };
    [from, time("to").unwrap_or_else(|| from + length("for_s").unwrap())]
}

/// Truth: the plan's own text, read by another TOML reader, and the list of passes without a plan: the brightest passes that do not overlap are there from their
/// beginning to their end; nothing overlaps; the telescope has its time to slew before each pass; six stars of three colours, none twice, each
/// followed by its sky, dark at both ends; the check of the plan has no error; the instruments' text is kept.
#[test]
fn a_night_is_planned_out_of_elements() {
    let folder = Folder::new("planned");
    std::fs::write(folder.path("devices.toml"), DEVICES).unwrap();
    let tle = elements();
    let json = folder.json(&command(&tle, &["-o", "night.toml", "--json", "-q"]));
    let (plan, listed) = (&json["plan"], json["passes"].as_array().unwrap());
    assert_eq!(plan["files"], serde_json::json!(["night.tle", "night.toml"]));
    let errors = plan["check"]["findings"].as_array().unwrap().iter();
    let errors: Vec<&Value> = errors.filter(|finding| finding["level"] == "error").collect();
    assert!(errors.is_empty(), "{errors:?}");
    let text = std::fs::read_to_string(folder.path("night.toml")).unwrap();
    assert!(text.contains(DEVICES.trim_end()), "{text}");
    let visits = visits(&text);
    let spans: Vec<[f64; 2]> = visits.iter().map(seconds).collect();
    for (pair, of) in spans.windows(2).zip(visits.windows(2)) {
        let way_s = if of[1].contains_key("tle") { 30.0 } else { 0.0 };
        assert!(pair[1][0] >= pair[0][1] + way_s - 1.0, "{of:?}");
    }
    let passes: Vec<&toml::Table> = visits.iter().filter(|v| v.contains_key("tle")).collect();
    assert_eq!(passes.len() + plan["left_out"].as_array().unwrap().len(), listed.len());
    assert!(passes.len() >= 2, "{text}");
    // The brightest of all is one of them.
    let v_mag = |pass: &&Value| pass["brightest"]["v_mag"].as_f64().unwrap();
    let brightest = listed.iter().min_by(|a, b| v_mag(a).total_cmp(&v_mag(b))).unwrap();
    let number = brightest["norad_id"].to_string();
    assert!(passes.iter().any(|visit| visit["object"].as_str() == Some(&number)), "{number}");
    for kind in ["dark", "sky"] {
        let count = visits.iter().filter(|v| v.get("off").and_then(|o| o.as_str()) == Some(kind));
        assert_eq!(count.count(), if kind == "dark" { 2 } else { 6 });
    }
    let mut names: Vec<&str> =
        visits.iter().filter_map(|visit| visit.get("star")?.as_str()).collect();
    assert_eq!(names.len(), 6);
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), 6, "a star twice");
    let colours: Vec<f64> =
        plan["visits"].as_array().unwrap().iter().filter_map(|v| v["bv_mag"].as_f64()).collect();
    assert!(
        colours.iter().any(|bv| *bv < 0.2) && colours.iter().any(|bv| *bv > 0.9),
        "{colours:?}"
    );
    // A second time nothing is overwritten.
    let again = folder.refused(1, &command(&tle, &["-o", "night.toml"]));
    assert!(again.contains("night.toml"), "{again}");
    let check = folder.run(&["observe", "night.toml", "--check"]);
    let said = String::from_utf8(check.stdout).unwrap();
    // Of 2024: its times are past, and that is all.
    let wrong: Vec<&str> = said.lines().filter(|line| line.starts_with("ERROR")).collect();
    assert!(wrong.iter().all(|l| l.contains("ago") || l.contains("elements are")), "{wrong:?}");
}

/// Instruments with a mount. Truth: by hand: half a turn at 2 °/s and 10 s are 100 s before each star, 10′ are 10.08 s before its sky; two passes stay as near as 30 s to each other; a time that is given counts; the
/// check of the plan names no visit that loses time on the way but the first, before which it is not known where the mount stands.
#[test]
fn a_mount_has_time_for_its_ways() {
    let folder = Folder::new("planned-mount");
    let mount = "[mount]\ndevice = \"indi-telescope:127.0.0.1:1/None\"\ncamera = \"cam\"\ntrust_clock = true\n";
    let devices = DEVICES.replace("\n[[counter]]", &format!("\n{mount}\n[[counter]]"));
    std::fs::write(folder.path("devices.toml"), devices).unwrap();
    let tle = elements();
    let gaps = |name: &str, more: &[&str]| {
        let json = folder.json(&command(&tle, &[&["-o", name, "--json", "-q"], more].concat()));
        let visits = visits(&std::fs::read_to_string(folder.path(name)).unwrap());
        let spans: Vec<[f64; 2]> = visits.iter().map(seconds).collect();
        let mut least = [f64::MAX; 3];
        for (pair, of) in spans.windows(2).zip(visits.windows(2)) {
            let is = |key: &str| of[1].contains_key(key);
            let sky = of[1].get("off").and_then(|off| off.as_str()) == Some("sky");
            let kind = [is("star"), sky, is("tle")].iter().position(|is| *is);
            if let Some(kind) = kind {
                least[kind] = least[kind].min(pair[1][0] - pair[0][1]);
            }
        }
        let findings = json["plan"]["check"]["findings"].as_array().unwrap().clone();
        let lost = |finding: &Value| finding["text"].as_str().unwrap().contains("the way there");
        (least, findings.into_iter().filter(lost).collect::<Vec<Value>>())
    };
    let ([star, sky, pass], lost) = gaps("night.toml", &[]);
    // The plan's times are whole seconds.
    assert!((99.0..102.0).contains(&star) && (9.0..=12.0).contains(&sky) && pass >= 29.0);
    let first = |finding: &Value| finding["text"].as_str().unwrap().contains("not known");
    assert!(lost.iter().all(first) && lost.len() <= 1, "{lost:?}");
    let ([star, ..], lost) = gaps("hasty.toml", &["--slew-s", "5"]);
    assert!((4.0..7.0).contains(&star), "{star}");
    assert!(lost.len() > 2, "{lost:?}");
}

/// Truth: the frames and counts of the virtual observatory, photon by photon: no pixel at the converter's end, no bin past its counter's saturation, in any star
/// that was chosen with the magnitudes from 0 on. With V 0 to 1 alone, at 0.5 s, the plan has no star and says what would saturate.
#[test]
fn planned_stars_saturate_nothing() {
    let folder = Folder::new("planned-stars");
    std::fs::write(folder.path("devices.toml"), DEVICES).unwrap();
    let tle = elements();
    let more = ["-o", "night.toml", "-q", "--star-s", "10", "--stars", "12", "--slew-s", "5"];
    folder.done(&command(&tle, &more));
    let text = std::fs::read_to_string(folder.path("night.toml")).unwrap();
    let mut own = DEVICES
        .replace("\"sim-camera\"", "\"virtual\"")
        .replace("\"sim-timetagger\"", "\"virtual\"");
    own = own.replace("interval_s = 2.0", "interval_s = 2.0\nwindow_px = [595, 419, 200, 200]");
    let mut night = own.replacen(
        "station",
        "from = \"2024-08-12T19:26:00Z\"\nvirtual = \"virtual.toml\"\nstation",
        1,
    );
    let visits = visits(&text);
    let stars: Vec<_> = visits.iter().filter(|visit| visit.contains_key("star")).collect();
    // The last pass ends with the night: no star fits behind it.
    assert_eq!(stars.len(), 11);
    // The first three, within a quarter of an hour: the night is rendered second by second.
    for visit in &stars[..3] {
        let _ = write!(night, "\n[[visit]]\n{}", toml::to_string(visit).unwrap());
    }
    std::fs::write(folder.path("virtual-night.toml"), night).unwrap();
    std::fs::write(folder.path("virtual.toml"), "seed = 3\n[seeing]\nfwhm_arcsec = 2.5\n").unwrap();
    folder.done(&["observe", "virtual-night.toml", "-o", "session"]);
    let session = Session::open(folder.path("session")).unwrap();
    let mut brightest = 0;
    for (_, frame) in frames(&session) {
        brightest = brightest.max(frame.pixels.iter().copied().max().unwrap());
        assert!(f64::from(brightest) < frame.saturation_adu.unwrap_or(65_535.0), "{brightest}");
    }
    assert!(brightest > 1000, "{brightest}: the stars are in the frames");
    let json = folder.json(&["reduce", "session", "-o", "out/", "--json", "-q"]);
    for visit in json["visits"].as_array().unwrap() {
        for channel in visit["channels"].as_array().unwrap() {
            let saturated = channel["flags"]["saturated"].as_u64().unwrap_or(0);
            assert_eq!(saturated, 0, "{} {channel}", visit["target"]);
        }
    }
    let more = ["-o", "bright.toml", "--star-mag=-2,0.6"];
    let output = folder.run(&command(&tle, &more));
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("would saturate") || said.contains("stands high enough"), "{said}");
}

/// A wheel's filters that the station names: each star is seen through all of them, a pass through the first; flats before the night in the twilight.
#[test]
fn filters_and_flats_are_planned() {
    let folder = Folder::new("planned-filters");
    std::fs::write(folder.path("station.toml"), STATION).unwrap();
    std::fs::write(folder.path("qe.csv"), "wavelength_nm,efficiency\n400,0.4\n900,0.4\n").unwrap();
    let devices = "station = \"station.toml\"\n[[camera]]\nname = \"cam\"\ndevice = \"sim-camera\"\nexposure_s = 0.5\ninterval_s = 4\n[[wheel]]\nname = \"wheel\"\ndevice = \"sim-wheel\"\nfilters = [\"Luminance\", \"V\", \"R\"]\n";
    std::fs::write(folder.path("devices.toml"), devices).unwrap();
    let tle = elements();
    folder.done(&command(&tle, &["-o", "night.toml", "--flats", "20000", "--star-mag", "3,6"]));
    let text = std::fs::read_to_string(folder.path("night.toml")).unwrap();
    let visits = visits(&text);
    let both = toml::Value::Array(vec!["V".into(), "R".into()]);
    for visit in &visits {
        if visit.contains_key("star") {
            assert_eq!(
                (
                    &visit["filters"],
                    visit["for_s"].as_float().or(visit["for_s"].as_integer().map(|i| i as f64))
                ),
                (&both, Some(120.0))
            );
        }
        if visit.contains_key("tle") {
            assert_eq!(visit["filter"].as_str(), Some("V"));
        }
    }
    let kinds: Vec<&str> = visits.iter().filter_map(|v| v.get("off")?.as_str()).collect();
    assert_eq!(&kinds[..2], ["flat", "bias"], "{kinds:?}");
    assert_eq!(visits[0]["filters"], both);
    // By hand: 20 frames, one each 4 s.
    let [from, to] = seconds(&visits[1]);
    assert_eq!(to - from, 81.0);
    // A wheel without names: said, with what to do.
    std::fs::write(
        folder.path("devices.toml"),
        devices.replace("filters = [\"Luminance\", \"V\", \"R\"]\n", ""),
    )
    .unwrap();
    let run = folder.run(&command(&tle, &["-o", "unnamed.toml"]));
    let said = String::from_utf8(run.stderr).unwrap();
    assert!(said.contains("wheel wheel names no filters") && said.contains("R, V"), "{said}");
    // Stuttgart, 12 August 2024: the Sun is at −2° at 18:51 UTC and at −7° at 19:25 (astropy, get_sun); the planner looks each minute.
    let [from, to] = seconds(&visits[0]);
    assert!((from - 67_860.0).abs() < 120.0 && (to - 69_900.0).abs() < 120.0, "{from} {to}");
}

/// Each is refused before anything is written, by name.
#[test]
fn what_makes_no_plan_is_said() {
    let folder = Folder::new("planned-wrong");
    let write = |name: &str, text: &str| std::fs::write(folder.path(name), text).unwrap();
    write("devices.toml", DEVICES);
    let tle = elements();
    let said =
        folder.refused(2, &["passes", "--tle", &tle, "--station", "ufo", "-o", "night.toml"]);
    assert!(said.contains("--devices"), "{said}");
    let said = folder.refused(2, &command(&tle, &[]));
    assert!(said.contains("-o NIGHT.toml"), "{said}");
    std::fs::create_dir(folder.path("other")).unwrap();
    let said = folder.refused(1, &command(&tle, &["-o", "other/night.toml"]));
    assert!(said.contains("beside devices.toml"), "{said}");
    let said = folder.refused(1, &command(&tle, &["-o", "night.toml", "--star-mag", "5"]));
    assert!(said.contains("--star-mag is 5"), "{said}");
    let said = folder.refused(1, &command(&tle, &["-o", "night.toml", "--brighter-than", "-9"]));
    assert!(said.contains("no pass to plan for"), "{said}");
    for key in ["from = \"2024-08-12T18:00:00Z\"", "for_s = 10"] {
        write("devices.toml", &format!("{key}\n{DEVICES}"));
        let said = folder.refused(1, &command(&tle, &["-o", "night.toml"]));
        assert!(said.contains("it comes with the plan"), "{said}");
    }
    assert!(!folder.path("night.toml").exists() && !folder.path("night.tle").exists());
}
