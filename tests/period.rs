//! `sunglint analyse`: a pass of a known spin, simulated and read; the page's commands; what is refused.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_testkit::{shared, skip};

const CENTRES_NM: [i32; 6] = [531, 639, 746, 854, 961, 1069];

/// Six Gaussian bands of σ = 26 nm, the first and last as the thesis names them (figure G.5: G-531/26, G-1069/26), the others evenly between.
fn station(folder: &Folder) {
    let mut text = String::from(
        "name = \"six_bands\"\n[site]\nlatitude_deg = 48.7826\nlongitude_deg = 9.1964\nheight_m = 400.0\n[telescope]\nprimary_diameter_m = 0.43\n\
         obstruction_diameter_m = 0.0\nfocal_length_m = 2.9\nmount = \"equatorial\"\n[air]\nprofile = \"midlatitude_winter\"\n",
    );
    for centre in CENTRES_NM {
        let mut curve = String::from("wavelength_nm,efficiency\n");
        for d in (-130..=130).step_by(5) {
            let value = 0.5 * (-0.5 * (f64::from(d) / 26.0).powi(2)).exp();
            let _ = writeln!(curve, "{},{value:.6}", centre + d);
        }
        std::fs::write(folder.path(&format!("g{centre}.csv")), curve).unwrap();
        let _ = write!(
            text,
            "[[channel]]\nname = \"g{centre}\"\nefficiency = \"g{centre}.csv\"\n[channel.counter]\ndead_time_model = \"none\"\nsaturation_hz = 1e9\ndark_rate_hz = 0.0\n"
        );
    }
    std::fs::write(folder.path("station.toml"), text).unwrap();
}

/// A pass like that of the thesis' figure J.3: a box with wings that turns about its polar axis once in 20 s, to a minute after 16:20. Twelve minutes are the whole; in the last six the bisector of Sun and
/// station moves by a quarter of a turn, and the glints with it.
fn pass(folder: &Folder, to_minute: u32) {
    let scene = r#"
name = "box_wing_pass"
[target]
built_in = "box_wing"
[orbit]
lines = [
  "SYNTHETIC DUSK",
  "1 99004U 20001A   20323.50000000  .00000000  00000-0  10000-4 0    19",
  "2 99004  98.6000 318.0000 0010000  90.0000  90.0000 14.27000000    13",
]
[attitude]
law = "spin"
axis_body = [0.0, 0.0, 1.0]
axis_gcrs = [-0.30, 0.10, 0.95]
period_s = 20.0
epoch_utc = "2020-11-18T16:20:00"
[times]
from = "2020-11-18T16:20:00"
to = "2020-11-18T16:TO:00"
step_s = 0.5
exposure_s = 0.1
"#;
    let scene = scene.replace("TO", &(20 + to_minute).to_string());
    std::fs::write(folder.path("pass.toml"), scene).unwrap();
}

/// Truth: the spin of the scene, 20 s, and the 20 s that the thesis reads from this pass by phase dispersion in all channels (figure 8.3). All twelve minutes: even time gives a family or a refusal in
/// most channels, and peaks of one harmonic that are parts of the period. Stretches on a clock that goes with the body give one period in every channel alone and in all together, and its
/// range holds the truth. Tolerance: 2 %, by which the bisector's turn (a quarter in 36 turns, and more about axes near it) may change the period; narrower is the range that is stated.
#[test]
fn the_whole_pass_gives_20_s_in_every_channel() {
    let folder = Folder::new("analyse-j3-whole");
    station(&folder);
    pass(&folder, 12);
    folder.done(&["simulate", "pass.toml", "--tolerance", "1%", "-o", "sim/", "-q"]);
    let period = ["analyse", "period", "sim/box_wing_pass.ecsv", "--json", "-q"];
    let mut fooled = 0;
    let channels = CENTRES_NM.iter().map(|c| vec!["--channel".to_owned(), format!("g{c}")]);
    for channel in std::iter::once(Vec::new()).chain(channels) {
        let options: Vec<&str> = channel.iter().map(String::as_str).collect();
        let along = folder.json(&[&period[..], &options, &["--pass", "pass.toml"]].concat());
        assert_eq!(along["verdict"], "one", "{options:?}: {along}");
        let number = |v: &Value| v.as_f64().unwrap();
        let found = number(&along["periods"][0]["period_s"]);
        assert!((found / 20.0 - 1.0).abs() < 0.02, "{options:?}: {found}");
        let range = &along["along"]["sidereal_s"];
        assert!(number(&range[0]) < 20.0 && number(&range[1]) > 20.0, "{options:?}: {range}");
        assert!(number(&range[1]) - number(&range[0]) < 1.0, "{options:?}: {range}");
        let peak = number(&along["peaks"][0]["period_s"]);
        fooled += usize::from((peak / 20.0 - 1.0).abs() > 0.05);
    }
    assert!(fooled >= 4, "the highest peak of one harmonic is right in {} of 7", 7 - fooled);
    // Without the geometry the whole is a family, which holds the truth (the synodic period differs by up to 2 %).
    let even = folder.json(&period);
    assert_eq!(even["verdict"], "family", "{even}");
    let members = even["periods"].as_array().unwrap();
    let is_20 = |m: &Value| (m["period_s"].as_f64().unwrap() / 20.0 - 1.0).abs() < 0.02;
    assert!(members.iter().any(is_20), "{even}");

    // Folded on the spin about its own axis the pass repeats better than folded on any of seven even times about it: less of the variance within phase bins is left.
    let left = |options: &[&str]| {
        let fold =
            ["analyse", "fold", "sim/box_wing_pass.ecsv", "--channel", "g854", "-q", "--force"];
        folder.done(&[&fold[..], &["--bins", "40", "-o", "folded.ecsv"], options].concat());
        let text = std::fs::read_to_string(folder.path("folded.ecsv")).unwrap();
        let table = sunglint_formats::ecsv::read_str("folded.ecsv", &text).unwrap();
        let (scatter, samples) = (table.f64("scatter_hz").unwrap(), table.f64("samples").unwrap());
        let sum = scatter.iter().zip(samples.iter()).filter(|(s, _)| s.is_finite());
        sum.map(|(s, n)| s * s * (n - 1.0)).sum::<f64>()
    };
    let even = (1985..=2015).step_by(5).map(|k| {
        let period = format!("{}", f64::from(k) / 100.0);
        left(&["--period", &period])
    });
    let even = even.fold(f64::INFINITY, f64::min);
    // The direction (-0.30, 0.10, 0.95).
    let axis = ["--pass", "pass.toml", "--axis", "161.565,71.589"];
    let turned = left(&[&["--period", "20"][..], &axis].concat());
    assert!(turned < even, "{turned} {even}");
    let wrong = folder
        .refused(2, &["analyse", "fold", "c", "--period", "20", "--pass", "p", "--axis", "1,95"]);
    assert!(wrong.contains("declination"), "{wrong}");
}

/// Truth: the spin of the scene, 20 s. What is seen is the synodic period, which the pass's own geometry lets differ: 20 s lies within the bounds that are printed. Every channel alone and
/// all together give it, though the highest peak of one harmonic is a fraction of it.
#[test]
fn a_spin_of_20_s_is_found_in_every_channel() {
    let folder = Folder::new("analyse-j3");
    station(&folder);
    pass(&folder, 6);
    folder.done(&["simulate", "pass.toml", "--tolerance", "1%", "-o", "sim/", "-q"]);
    let period = ["analyse", "period", "sim/box_wing_pass.ecsv", "--json", "-q"];
    let all = folder.json(&[&period[..], &["--pass", "pass.toml", "-o", "fig/"]].concat());
    let is_20 = |v: &Value| (v.as_f64().unwrap() / 20.0 - 1.0).abs() < 0.01;
    assert_eq!(all["verdict"], "one", "{all}");
    assert!(is_20(&all["periods"][0]["period_s"]), "{all}");
    let bound = &all["sidereal"]["from_to_s"];
    assert!(bound[0].as_f64().unwrap() < 20.0 && bound[1].as_f64().unwrap() > 20.0, "{bound}");
    assert!(bound[1].as_f64().unwrap() - bound[0].as_f64().unwrap() < 1.0, "{bound}");
    let mut fooled = 0;
    for centre in CENTRES_NM {
        let name = format!("g{centre}");
        let one = folder.json(&[&period[..], &["--channel", &name]].concat());
        assert_eq!(one["verdict"], "one", "{name}: {one}");
        assert!(is_20(&one["periods"][0]["period_s"]), "{name}: {one}");
        fooled += usize::from(!is_20(&one["peaks"][0]["period_s"]));
    }
    assert!(fooled >= 3, "the highest peak of one harmonic is right in {} channels", 6 - fooled);
    for file in ["period.ecsv", "period.png", "period.svg"] {
        assert!(folder.path(&format!("fig/{file}")).exists(), "{file}");
    }
    // Folded, and what is refused.
    let fold = ["analyze", "fold", "sim/box_wing_pass.ecsv", "--period", "20", "--json", "-q"];
    let folded = folder.json(&fold);
    assert_eq!(folded["channels"].as_array().unwrap().len(), 6);
    let curve = "sim/box_wing_pass.ecsv";
    let wrong = folder.refused(1, &["analyse", "fold", curve, "--period", "-2", "-q"]);
    assert!(wrong.contains("the period is -2 s"), "{wrong}");
    let wrong = folder.refused(1, &["analyse", "period", curve, "--channel", "g53", "-q"]);
    assert!(wrong.contains("the nearest are g531"), "{wrong}");
    folder.refused(2, &["analyse", "period", curve, "--shortest", "0", "-q"]);
    let wrong = folder.refused(1, &["analyse", "period", "pass.toml", "-q"]);
    assert!(wrong.contains("pass.toml"), "{wrong}");
}

/// A track as MMT-9 publishes them (synthetic): two unlike lobes a turn of 7.3 s at 10 Hz for two minutes, 0.05 mag of noise, a range that changes by a third. Truth: the period that was put in, within
/// 3 σ as stated, from the catalogue's text and from plain columns alike.
#[test]
fn published_magnitudes_have_periods_too() {
    let folder = Folder::new("period-magnitudes");
    let mut catalogue = String::from(
        "# synthetic\n# Date Time StdMag Mag Filter Penumbra Distance Phase Channel Track\n",
    );
    let mut columns = String::from("time_utc,magnitude,range_km,phase_deg\n");
    let mut state = 1_u64;
    let mut uniform = || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    for i in 0..1200 {
        let t = 0.1 * f64::from(i);
        let turn = std::f64::consts::TAU * t / 7.3;
        let lobe = |at: f64, width: f64| (width * ((turn - at).cos() - 1.0)).exp();
        let range_km = 900.0 + 300.0 * (t / 120.0).powi(2);
        let flux = (0.3 + lobe(1.0, 6.0) + 0.4 * lobe(4.0, 12.0)) / (range_km / 1000.0).powi(2);
        // The sum of twelve uniform numbers is normal enough: variance 1.
        let noise = 0.05 * ((0..12).map(|_| uniform()).sum::<f64>() - 6.0);
        let magnitude = 7.0 - 2.5 * flux.log10() + noise;
        let (minute, second) = ((t / 60.0) as u32, t % 60.0);
        let _ = writeln!(
            catalogue,
            "2024-02-28 16:{:02}:{second:09.6} {magnitude:.3} {magnitude:.5} Clear 0 {range_km:.3} 60.000 7 1",
            10 + minute
        );
        let _ = writeln!(
            columns,
            "2024-02-28T16:{:02}:{second:09.6}Z,{magnitude:.5},{range_km:.3},60",
            10 + minute
        );
    }
    std::fs::write(folder.path("track.txt"), catalogue).unwrap();
    std::fs::write(folder.path("track.csv"), columns).unwrap();
    for file in ["track.txt", "track.csv"] {
        let found = folder.json(&["analyse", "period", file, "--json"]);
        assert_eq!(found["verdict"], "one", "{file}: {found}");
        let best = &found["best"];
        let number = |key: &str| best[key].as_f64().unwrap();
        let pull = (number("period_s") - 7.3) / number("sigma_s");
        assert!(pull.abs() < 3.0 && number("sigma_s") < 0.02, "{file}: {best}");
        folder.done(&["analyse", "fold", file, "--period", "7.3", "-o", "folded.png", "--force"]);
    }
    let wrong = folder.run(&["analyse", "period", "track.csv", "--magnitude-column", "mag"]);
    let words = String::from_utf8_lossy(&wrong.stderr).into_owned();
    assert!(
        wrong.status.code() == Some(1) && words.contains("it has time_utc, magnitude"),
        "{words}"
    );
}

/// Two tracks of one body, 61 days apart in one file. Truth: the period that was put in, within 3 σ as stated; turns between the tracks are not counted, so that the uncertainty is that of two minutes, not
/// of two months: above 1e-4 s (two months would make it 1e-8 s).
#[test]
fn tracks_far_apart_share_a_period() {
    let folder = Folder::new("period-tracks");
    let mut columns = String::from("time_utc,magnitude\n");
    for (day, at_s) in [("2024-02-28", 0.0), ("2024-04-29", 3.21)] {
        for i in 0..1200_u32 {
            let t = 0.1 * f64::from(i);
            let turn = std::f64::consts::TAU * (t + at_s) / 7.3;
            let lobe = |at: f64, width: f64| (width * ((turn - at).cos() - 1.0)).exp();
            // The fraction of a product with an irrational number: even over 0 to 1, never the same.
            let ripple = (f64::from(i * i) * 0.618_033_988_75).fract() - 0.5;
            let magnitude =
                7.0 - 2.5 * (0.3 + lobe(1.0, 6.0) + 0.4 * lobe(4.0, 12.0)).log10() + 0.1 * ripple;
            let _ = writeln!(
                columns,
                "{day}T16:{:02}:{:09.6}Z,{magnitude:.5}",
                10 + (t / 60.0) as u32,
                t % 60.0
            );
        }
    }
    std::fs::write(folder.path("tracks.csv"), columns).unwrap();
    for options in [&[][..], &["--gap", "600"]] {
        let found =
            folder.json(&[&["analyse", "period", "tracks.csv", "--json"], options].concat());
        assert_eq!(found["verdict"], "one", "{found}");
        let number = |key: &str| found["best"][key].as_f64().unwrap();
        assert!(((number("period_s") - 7.3) / number("sigma_s")).abs() < 3.0, "{found}");
        assert!((1e-4..0.02).contains(&number("sigma_s")), "{found}");
        assert!(found["warnings"].to_string().contains("2 tracks"), "{found}");
    }
    folder.refused(2, &["analyse", "period", "tracks.csv", "--gap", "0"]);
}

/// The real ONEWEB-0165 (MMT-9), which holds its attitude: there is no one period. Truth: its operator's word.
#[test]
fn a_steady_satellite_has_no_period() {
    let Some(file) = shared("real/oneweb_0165_mmt9.txt") else {
        return skip("a_steady_satellite_has_no_period", "no shared/real beside the checkout");
    };
    let folder = Folder::new("period-steady");
    // Of two tracks two months apart nobody can count the turns between: each has a curve of its own.
    let both = folder.json(&["analyse", "period", file.to_str().unwrap(), "--json"]);
    let warnings = both["warnings"].to_string();
    assert!(both["verdict"] != "one" && warnings.contains("2 tracks"), "{both}");
    let text = std::fs::read_to_string(file).unwrap();
    let first = text.lines().filter(|l| l.starts_with('#') || l.starts_with("2024-02-28"));
    std::fs::write(folder.path("first.txt"), first.collect::<Vec<_>>().join("\n")).unwrap();
    let found = folder.json(&["analyse", "period", "first.txt", "--json"]);
    assert_ne!(found["verdict"], "one", "{found}");
}

/// Three nights of a body that turns in 5.3 h (synthetic), with zero points of their own: one file with a column `session`, and one file a night. Truth: the period that was put in, within 0.5 %. The rows backwards and mixed, one of
/// them twice: the same document, bit for bit.
#[test]
fn nights_with_zero_points_of_their_own_are_joined() {
    let folder = Folder::new("period-sessions");
    let mut rows = Vec::new();
    for (k, day) in [2_u32, 3, 7, 9].into_iter().enumerate() {
        for i in 0..90_u32 {
            let minute = 4 * i + 17 * k as u32;
            let t = 86_400.0 * f64::from(day) + 60.0 * f64::from(minute);
            let turn = std::f64::consts::TAU * t / (5.3 * 3600.0);
            let ripple = (f64::from(i * i) * 0.618_033_988_75).fract() - 0.5;
            let m = 11.0
                + 1.7 * k as f64
                + 0.2 * (2.0 * turn).sin()
                + 0.1 * (3.0 * turn).cos()
                + 0.03 * ripple;
            rows.push((
                k,
                format!(
                    "2024-03-{day:02}T{:02}:{:02}:00Z,{m:.4},{k},2.5",
                    minute / 60,
                    minute % 60
                ),
            ));
        }
    }
    rows.push(rows[5].clone());
    let head = "# synthetic\ntime_utc,magnitude,session,delta_au\n";
    let text = |rows: &[&(usize, String)]| {
        head.to_owned() + &rows.iter().map(|r| r.1.clone() + "\n").collect::<String>()
    };
    let forwards: Vec<&(usize, String)> = rows.iter().collect();
    let backwards: Vec<&(usize, String)> = rows.iter().rev().collect();
    // 361 is 19²: 100 has no common part with it.
    let mixed: Vec<&(usize, String)> =
        (0..rows.len()).map(|i| &rows[i * 100 % rows.len()]).collect();
    let mut found = Vec::new();
    for rows in [forwards, backwards, mixed] {
        std::fs::write(folder.path("nights.csv"), text(&rows)).unwrap();
        for options in [&[][..], &["--sessions", "apart"]] {
            let mut all = folder
                .json(&[&["analyse", "period", "nights.csv", "--json", "-q"], options].concat());
            all.as_object_mut().unwrap().remove("inputs");
            found.push(all);
        }
    }
    assert!(found[0] == found[2] && found[0] == found[4], "{} {}", found[0], found[4]);
    assert!(found[1] == found[3] && found[1] == found[5], "{} {}", found[1], found[5]);
    // Two harmonics: twice the period with the even harmonics alone is the same light, so a family may be left, the truth first.
    let members = found[0]["members"].as_array().unwrap().len();
    let expected = if members == 1 { "single" } else { "family" };
    assert!(members <= 3 && found[0]["verdict"] == expected, "{}", found[0]);
    let period = found[0]["members"][0]["period_s"].as_f64().unwrap();
    assert!((period / (5.3 * 3600.0) - 1.0).abs() < 5e-3, "{period}");
    assert_eq!(found[0]["light_time_removed"], true);
    let mut files = Vec::new();
    for k in 0..4 {
        let own: Vec<&(usize, String)> = rows.iter().filter(|r| r.0 == k).collect();
        let name = format!("night{k}.csv");
        std::fs::write(folder.path(&name), text(&own)).unwrap();
        files.push(name);
    }
    let files: Vec<&str> = files.iter().map(String::as_str).collect();
    let apart =
        folder.json(&[&["analyse", "period"], &files[..], &["--json", "-o", "fig/"]].concat());
    assert_eq!(apart["members"][0]["period_s"], found[0]["members"][0]["period_s"], "{apart}");
    assert!(folder.path("fig/period.png").exists());
    let whole = text(&rows.iter().collect::<Vec<_>>());
    let constant = whole.lines().map(|l| {
        let mut fields: Vec<&str> = l.split(',').collect();
        if l.starts_with('2') {
            fields[1] = "7";
        }
        fields.join(",") + "\n"
    });
    std::fs::write(folder.path("constant.csv"), constant.collect::<String>()).unwrap();
    let wrong = folder.refused(1, &["analyse", "period", "constant.csv", "-q"]);
    assert!(wrong.contains("360 rows of 7: constant light"), "{wrong}");
}

/// Six passes of a cylinder that tumbles (synthetic): simulated, and read.
///
/// Truth: the scene's spin, 21.7 s about an axis at 120°, +35°. Tolerance: the stated 95 % intervals of period and drift (there is none). A pass alone shows half of the period, as the ends of the cylinder are alike.
#[test]
fn a_tumbling_cylinder_over_six_passes() {
    let folder = Folder::new("analyse-spin");
    let names = crate::common::tumbling_stage(&folder, 6);
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let options = ["--pass", "stage.toml", "--station", "ufo", "--channel", "g"];
    let spin = |names: &[&str]| {
        folder.json(&[&["analyse", "spin", "-q"][..], names, &options, &["--json"]].concat())
    };
    let found = spin(&names);
    let number = |v: &Value| v.as_f64().unwrap();
    // The light of a cylinder of like ends repeats twice a turn; where the passes do not tell, both are given.
    let spins = found["spins"].as_array().unwrap();
    let near = |s: &&Value| (number(&s["period_s"]["value"]) / 21.7 - 1.0).abs() < 0.02;
    let right = spins.iter().find(near).unwrap_or_else(|| panic!("{found}"));
    assert_eq!(right["repeats"], 2, "{found}");
    let holds = |i: &Value, x: f64| number(&i["from"]) <= x && x <= number(&i["to"]);
    assert!(holds(&right["period_s"], 21.7) && holds(&right["drift_per_day"], 0.0), "{found}");
    assert!(found["passes"].as_array().unwrap().len() == 6 && found["reason"].is_null());
    // Its ends are alike, so that even harmonics have little: that it is long says nothing more.
    // Asked in another order, which changes no bit.
    let mut turned = names.clone();
    turned.reverse();
    let long = spin(&[&turned[..], &["--body", "long"]].concat());
    assert_eq!((&found["body"], &long["body"]), (&"any".into(), &"long".into()), "{long}");
    assert!(number(&long["even_share"]) < 0.5 && long["spins"] == found["spins"], "{long}");
    // Two passes are too few, and said to be.
    let few = spin(&names[..2]);
    assert_eq!(few["verdict"], "none");
    assert!(few["reason"].as_str().unwrap().contains("expected 3"), "{few}");
}
