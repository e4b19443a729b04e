//! `sunglint analyse attitude`, run as a person runs it.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::{Folder, SPHERE_PASS, page_toml, same_light};
use std::fmt::Write as _;
use sunglint_formats::ecsv;
use sunglint_radiometry::light_curve::{Flags, LightCurve, RateKind};

fn folder(name: &str) -> Folder {
    let folder = Folder::new(name);
    std::fs::write(folder.path("pass.toml"), page_toml("reading-attitude.md", "axis_body"))
        .unwrap();
    folder
}

fn curve(folder: &Folder, name: &str) -> LightCurve {
    let text = std::fs::read_to_string(folder.path(name)).unwrap();
    LightCurve::from_table(name, &ecsv::read_str(name, &text).unwrap()).unwrap()
}

fn write(folder: &Folder, name: &str, curve: &LightCurve) {
    let text = ecsv::to_string(&curve.to_table().unwrap()).unwrap();
    std::fs::write(folder.path(name), text).unwrap();
}

/// The angle between an axis and the page's, degrees.
fn off_deg(ra_deg: f64, dec_deg: f64) -> f64 {
    let to = |ra: f64, dec: f64| {
        let (ra, dec) = (ra.to_radians(), dec.to_radians());
        glam::DVec3::new(dec.cos() * ra.cos(), dec.cos() * ra.sin(), dec.sin())
    };
    to(ra_deg, dec_deg).angle_between(to(200.0, 35.0)).to_degrees()
}

/// Truth: the spin of the page's scene, with which its curve was simulated. Tolerance: 0.5° and 1e-3 of the period: no noise was added, and what is held of light between the parts is known to a hundredth
/// of all light. The scene that is written gives the curve back.
#[test]
fn the_page_finds_what_was_put_in() {
    let folder = folder("attitude-page");
    let page = include_str!("../docs/reading-attitude.md");
    let mut text = String::new();
    for command in page.lines().filter(|l| l.starts_with("sunglint ")) {
        let words: Vec<&str> = command.split_whitespace().skip(1).collect();
        text += &folder.done(&words);
    }
    assert!(text.contains("attitude of pass: one"), "{text}");
    // What is there is met before the search, not after it.
    let again = ["analyse", "attitude", "nothing.ecsv", "pass.toml", "-o"];
    assert!(folder.refused(1, &[&again[..], &["found/"]].concat()).contains("is there already"));
    for file in [
        "attitude.ecsv",
        "attitude.png",
        "attitude_curve.ecsv",
        "attitude_curve.png",
        "pass.attitude.toml",
    ] {
        assert!(folder.path("found").join(file).exists(), "{file}");
    }
    let found = std::fs::read_to_string(folder.path("found/attitude.ecsv")).unwrap();
    let found = ecsv::read_str("attitude.ecsv", &found).unwrap();
    let first = |name: &str| found.f64(name).unwrap()[0];
    assert!(off_deg(first("ra_deg"), first("dec_deg")) < 0.5, "{text}");
    assert!((first("period_s") / 70.0 - 1.0).abs() < 1e-3, "{text}");
    let (a, b) = (curve(&folder, "measured.ecsv"), curve(&folder, "again.ecsv"));
    let mut off: Vec<f64> = Vec::new();
    for (a, b) in a.channels.iter().zip(&b.channels) {
        let pairs = a.rate_hz.iter().zip(&b.rate_hz).filter(|(x, _)| **x > 0.0);
        off.extend(pairs.map(|(x, y)| (y / x - 1.0).abs()));
    }
    off.sort_by(f64::total_cmp);
    assert!(off.len() > 500 && off[off.len() / 2] < 0.02, "{}", off[off.len() / 2]);
}

/// Truth: the page's spin again, of which the axis and the period are told: the phase is found in one channel with every third sample, a gap in the middle, samples that are no numbers, and brightness that is
/// free (all rates were multiplied by 0.7). Tolerance: 1° of phase, 0.03 of the factor.
#[test]
fn gaps_lost_samples_and_a_free_brightness_do_not_stop_it() {
    let folder = folder("attitude-gaps");
    folder.done(&["simulate", "pass.toml", "-o", "p.ecsv", "-q"]);
    let mut made = curve(&folder, "p.ecsv");
    made.kind = RateKind::Calibrated;
    for channel in &mut made.channels {
        for i in 0..channel.rate_hz.len() {
            channel.rate_hz[i] *= 0.7;
            channel.sigma_hz[i] *= 0.7;
            if i % 3 > 0 || (40..70).contains(&i) {
                channel.flags[i] |= Flags::SATURATED;
            }
            if i % 15 == 0 {
                channel.rate_hz[i] = f64::NAN;
                channel.flags[i] |= Flags::GAP;
            }
        }
    }
    write(&folder, "m.ecsv", &made);
    let options = ["--known", "axis,period", "--scale", "grey", "--channel", "g", "--json"];
    let json =
        folder.json(&[&["analyse", "attitude", "m.ecsv", "pass.toml"][..], &options].concat());
    assert_eq!(json["verdict"], "one", "{json}");
    let best = &json["minima"][0];
    let phase = best["phase_deg"].as_f64().unwrap();
    assert!((phase - 40.0).abs() < 1.0, "{best}");
    let factor = best["brightness"][0]["value"].as_f64().unwrap();
    assert!((factor / 0.7 - 1.0).abs() < 0.03, "{best}");
    assert_eq!(best["ra_deg"].as_f64().unwrap().round(), 200.0);
    assert!(best["axis_sigma_deg"].is_null() && best["period_sigma_s"].is_null());
    let lost = json["curves"][0]["left_out"].as_array().unwrap();
    assert!(lost.iter().any(|l| l["why"].as_str().unwrap().contains("saturated")), "{json}");
}

/// Truth: the page's spin, seen in magnitudes that the simulation itself states at 1,000 km, of which the axis is told: phase and period are found from one band of a table with columns of its own. Tolerance: 1° and
/// 1e-3 of the period, as for rates with all channels. Read as what they are not, the same numbers have no attitude, and the answer says so.
#[test]
fn tables_of_magnitudes_are_read_as_they_are_said_to_be() {
    let folder = folder("attitude-magnitudes");
    folder.done(&["simulate", "pass.toml", "-o", "out/", "-q"]);
    let geometry = ecsv::read(folder.path("out/turning_geometry.ecsv")).unwrap();
    let v = geometry.f64("v_1000km_mag").unwrap();
    let range = geometry.f64("range_m").unwrap();
    let mut csv = "# made up\ntime_utc,v,range_m\n".to_owned();
    let rows = geometry.text("time_utc").unwrap().iter().zip(v.iter().zip(range.iter()));
    for (time, (v, range)) in rows.filter(|(_, (v, _))| v.is_finite()) {
        writeln!(csv, "{},{v},{range}", time.as_deref().unwrap()).unwrap();
    }
    std::fs::write(folder.path("m.csv"), csv).unwrap();
    let found = |kind: &str| {
        let attitude = ["analyse", "attitude", "m.csv", "pass.toml", "--magnitude-column", "v"];
        let more = ["--magnitudes-as", kind, "--sigma-mag", "0.02", "--known", "axis"];
        // With room for half and twice the period.
        let rest = ["--period", "30..150", "--scale", "grey", "--json"];
        folder.json(&[&attitude[..], &more, &rest].concat())
    };
    let json = found("1000km");
    let best = &json["minima"][0];
    let number = |key: &str| best[key].as_f64().unwrap();
    assert!((number("phase_deg") - 40.0).abs() < 1.0, "{best}");
    assert!((number("period_s") / 70.0 - 1.0).abs() < 1e-3, "{best}");
    assert!((best["brightness"][0]["value"].as_f64().unwrap() - 1.0).abs() < 0.03, "{best}");
    assert_eq!(json["channels"][0], "V");
    // Taken as apparent the light does not fall with the square of the distance, and no attitude makes up for that.
    assert_eq!(found("apparent")["verdict"], "undetermined");
    let named = std::fs::read_to_string(folder.path("m.csv")).unwrap().replace(",v,", ",seen,");
    std::fs::write(folder.path("seen.csv"), named).unwrap();
    let message = folder.refused(1, &["analyse", "attitude", "seen.csv", "pass.toml"]);
    assert!(message.contains("--magnitude-column"), "{message}");
}

/// Truth: the page's spin, of which the axis is told. What is left of the curve are its first and last twentieth; every sample twice, with the times backwards. Tolerance: 1° of phase in the middle of the data's
/// own uncertainty, 1e-3 of the period, or the reason why not.
#[test]
fn a_gap_double_times_and_times_backwards() {
    let folder = folder("attitude-hard");
    folder.done(&["simulate", "pass.toml", "-o", "p.ecsv", "-q"]);
    let mut predicted = curve(&folder, "p.ecsv");
    predicted.kind = RateKind::Calibrated;
    let n = predicted.len();
    let rows = |order: &[usize]| {
        let mut made = predicted.clone();
        let pick = |values: &[f64]| order.iter().map(|i| values[*i]).collect::<Vec<f64>>();
        made.samples.time = order.iter().map(|i| predicted.samples.time[*i]).collect();
        made.samples.exposure_s = pick(&predicted.samples.exposure_s);
        made.samples.range_m = predicted.samples.range_m.as_deref().map(pick);
        made.samples.phase_deg = predicted.samples.phase_deg.as_deref().map(pick);
        made.samples.zenith_deg = predicted.samples.zenith_deg.as_deref().map(pick);
        for channel in &mut made.channels {
            channel.rate_hz = pick(&channel.rate_hz);
            channel.sigma_hz = pick(&channel.sigma_hz);
            channel.flags = order.iter().map(|i| channel.flags[*i]).collect();
            channel.model_error_hz = channel.model_error_hz.as_deref().map(pick);
        }
        made
    };
    // With room for half and twice the period.
    let options = ["--known", "axis", "--period", "30..150", "--json"];
    let attitude = [&["analyse", "attitude", "m.ecsv", "pass.toml"][..], &options].concat();
    let right = |made: &LightCurve| {
        write(&folder, "m.ecsv", made);
        let json = folder.json(&attitude);
        let best = &json["minima"][0];
        let number = |key: &str| best[key].as_f64().unwrap();
        assert_eq!(json["verdict"], "one", "{json}");
        assert!((number("phase_deg") - 40.0).abs() < 1.0, "{best}");
        assert!((number("period_s") / 70.0 - 1.0).abs() < 1e-3, "{best}");
    };
    let ends: Vec<usize> = (0..n / 20).chain(n - n / 20..n).collect();
    right(&rows(&ends));
    let twice: Vec<usize> = (0..n).flat_map(|i| [i, i]).collect();
    right(&rows(&twice));
    let backwards: Vec<usize> = (0..n).rev().collect();
    right(&rows(&backwards));
    // A gap, every third moment twice, then the same rows in another order: the same answer to the last bit.
    let kept = (0..n).filter(|i| !(n / 3..n / 2).contains(i));
    let sorted: Vec<usize> = kept.flat_map(|i| vec![i; 1 + usize::from(i % 3 == 0)]).collect();
    // 7919 is a prime that is no part of the number of rows: it visits all.
    assert!(!sorted.len().is_multiple_of(7919));
    let shuffled: Vec<usize> =
        (0..sorted.len()).map(|i| sorted[(i * 7919 + 13) % sorted.len()]).collect();
    let answers = [&sorted, &shuffled].map(|order| {
        write(&folder, "m.ecsv", &rows(order));
        same_light(folder.json(&attitude))
    });
    assert_eq!(answers[0]["verdict"], "one");
    assert_eq!(answers[0], answers[1]);
}

/// Exit code 1 where something is wrong with the input, 2 with the command; the message says what to do.
#[test]
fn what_cannot_be_found_is_said() {
    let folder = folder("attitude-wrong");
    folder.done(&["simulate", "pass.toml", "-o", "p.ecsv", "-q"]);
    let predicted = curve(&folder, "p.ecsv");
    let refused = |code: i32, change: &dyn Fn(&mut LightCurve), more: &[&str]| {
        let mut curve = predicted.clone();
        curve.kind = RateKind::Calibrated;
        change(&mut curve);
        write(&folder, "m.ecsv", &curve);
        let all = [&["analyse", "attitude", "m.ecsv", "pass.toml"], more].concat();
        folder.refused(code, &all)
    };
    let few = |c: &mut LightCurve| {
        for channel in &mut c.channels {
            channel.flags[3..].fill(Flags::SATURATED);
        }
    };
    let message = refused(1, &few, &[]);
    assert!(message.contains("3 epochs") && message.contains("at least 8"), "{message}");
    // A body that sends the same all the time: what range and air do is left.
    let flat = std::fs::read_to_string(folder.path("pass.toml")).unwrap();
    let sphere =
        flat.replace("built_in = \"box_wing\"", "sphere = { radius_m = 1, material = \"white\" }");
    std::fs::write(folder.path("sphere.toml"), sphere).unwrap();
    folder.done(&["simulate", "sphere.toml", "-o", "s.ecsv", "-q"]);
    let message = folder.refused(1, &["analyse", "attitude", "s.ecsv", "sphere.toml"]);
    assert!(
        message.contains("however it is turned") || message.contains("no attitude can be told"),
        "{message}"
    );
    let message = refused(1, &|c| c.kind = RateKind::Linear, &[]);
    assert!(message.contains("sunglint apply"), "{message}");
    let message = refused(2, &|_| (), &["--period", "9..2"]);
    assert!(message.contains("LO..HI"), "{message}");
    let message = refused(2, &|_| (), &["--known", "axis,phase,period"]);
    assert!(message.contains("nothing to look for"), "{message}");
    let message = refused(2, &|_| (), &["--known", "period", "--sense", "left"]);
    assert!(message.contains("neither --period nor --sense"), "{message}");
    let message = refused(1, &|_| (), &["--channel", "violet"]);
    assert!(message.contains("violet"), "{message}");
    let message = refused(1, &|_| (), &["--period", "0.001.."]);
    assert!(message.contains("narrower bounds"), "{message}");
    std::fs::write(folder.path("c.json"), "{}").unwrap();
    let message = refused(1, &|_| (), &["--checkpoint", "c.json"]);
    assert!(message.contains("no checkpoint") && message.contains("--force"), "{message}");
    std::fs::write(folder.path("c.json"), "{\"of\":1,\"times\":1,\"wide\":[],\"closer\":[]}")
        .unwrap();
    let message = refused(1, &|_| (), &["--checkpoint", "c.json"]);
    assert!(message.contains("another search"), "{message}");
    // No spin, no axis in the body.
    std::fs::write(folder.path("still.toml"), SPHERE_PASS).unwrap();
    folder.done(&["simulate", "still.toml", "-o", "t.ecsv", "-q"]);
    let message = folder.refused(1, &["analyse", "attitude", "t.ecsv", "still.toml"]);
    assert!(message.contains("axis_body"), "{message}");
    folder.refused(2, &["analyse", "attitude", "pass.toml", "p.ecsv"]);
}

/// Truth: the spin that the curve was simulated with, about z once in 20 s. The pass enters the Earth's penumbra at its end: those samples do not count, and the colours of the half hidden Sun are no spectra of the
/// search. Tolerance: 1e-3 of the period, as without a shadow.
#[test]
fn samples_in_the_penumbra_do_not_stop_it() {
    let folder = Folder::new("attitude-penumbra");
    let scene = r#"
target.built_in = "box_wing"
station.name = "ufo"
[orbit]
lines = [
  "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
  "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
]
[times]
from = 2008-09-21T18:45:00Z
to = 2008-09-21T18:52:00Z
[attitude]
law = "spin"
axis_body = [0, 0, 1]
axis_gcrs = [0, 0, 1]
period_s = 20
epoch_utc = 2008-09-21T18:45:00Z
"#;
    std::fs::write(folder.path("box.toml"), scene).unwrap();
    folder.done(&["simulate", "box.toml", "--step-s", "1", "-o", "box.ecsv", "-q"]);
    // Without such samples the test would say nothing.
    let simulated = curve(&folder, "box.ecsv");
    let spcm = simulated.channels.iter().find(|c| c.name == "spcm").unwrap();
    assert!(spcm.flags.iter().any(|f| f.contains(Flags::ECLIPSED)));
    let found = folder.json(&[
        "analyse",
        "attitude",
        "box.ecsv",
        "box.toml",
        "--channel",
        "spcm",
        "--period",
        "19..21",
        "--axes",
        "20",
        "--json",
    ]);
    let period_s = found["minima"][0]["period_s"].as_f64().unwrap();
    assert!((period_s / 20.0 - 1.0).abs() < 1e-3, "{found}");
}
