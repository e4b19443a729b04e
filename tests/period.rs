//! `sunglint analyse`: a pass of a known spin, simulated and read; the page's commands; what is refused.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod common;

use common::Folder;
use serde_json::Value;
use std::fmt::Write as _;

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

/// A pass like that of the thesis' figure J.3: a box with wings that turns about its polar axis once in 20 s; its first six minutes. (Later the bisector of Sun and
/// station moves by a quarter of a turn and the glints with it: over the whole pass the verdict is a family.)
fn pass(folder: &Folder) {
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
to = "2020-11-18T16:26:00"
step_s = 0.5
exposure_s = 0.1
"#;
    std::fs::write(folder.path("pass.toml"), scene).unwrap();
}

/// Truth: the spin of the scene, 20 s. What is seen is the synodic period, which the pass's own geometry lets differ: 20 s lies within the bounds that are printed. Every channel alone and
/// all together give it, though the highest peak of one harmonic is a fraction of it.
#[test]
fn a_spin_of_20_s_is_found_in_every_channel() {
    let folder = Folder::new("analyse-j3");
    station(&folder);
    pass(&folder);
    folder.done(&["simulate", "pass.toml", "-o", "sim/", "-q"]);
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
