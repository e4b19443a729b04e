//! `sunglint fit`, run as a person runs it.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_formats::ecsv;
use sunglint_inference::measured::MeasuredCurve;
use sunglint_radiometry::light_curve::published::MagnitudeOptions;
use sunglint_radiometry::light_curve::{Flags, LightCurve, RateKind, Samples};
use sunglint_testkit::{fixture, shared, skip};

/// The scene of docs/fit.md.
fn page_scene() -> String {
    let page = include_str!("../docs/fit.md");
    let text = page.split("```toml\n").nth(1).unwrap();
    text.split("```").next().unwrap().to_owned()
}

fn folder(name: &str) -> Folder {
    let folder = Folder::new(name);
    std::fs::write(folder.path("sphere.toml"), page_scene()).unwrap();
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

/// Truth: the reflectance that the scene was simulated with, 0.5 in every channel, and the simulation of the fitted scene, which must be that of the first (the
/// fit's own truths, closed forms and another program, are in the calibration crate). Tolerance: albedos to 1e-4, the tables of the air; rates of the
/// fitted scene to 2e-3, as its spectrum matches bands.
#[test]
fn the_page_gives_back_what_was_put_in() {
    let folder = folder("fit-page");
    let page = include_str!("../docs/fit.md");
    let commands = page.lines().filter(|l| l.starts_with("sunglint "));
    let mut text = String::new();
    for command in commands {
        let words: Vec<&str> = command.split_whitespace().skip(1).collect();
        text += &folder.done(&words);
    }
    assert!(text.contains("converged") && text.contains("albedo.surface.spcm"), "{text}");
    for file in [
        "sphere_fit.ecsv",
        "sphere_fit.png",
        "sphere_fit.html",
        "sphere_fit_spectrum_surface.ecsv",
        "sphere.fitted.toml",
    ] {
        assert!(folder.path("found").join(file).exists(), "{file}");
    }
    let json = folder.json(&["fit", "measured.ecsv", "sphere.toml", "--json"]);
    let parameters = json["fit"]["parameters"].as_array().unwrap();
    assert_eq!(parameters.len(), 6);
    for p in parameters {
        let value = p["value"].as_f64().unwrap();
        assert!((value - 0.5).abs() < 1e-4, "{p}");
    }
    let (first, again) = (curve(&folder, "measured.ecsv"), curve(&folder, "again.ecsv"));
    for (a, b) in first.channels.iter().zip(&again.channels) {
        for (x, y) in a.rate_hz.iter().zip(&b.rate_hz).filter(|(x, _)| x.is_finite()) {
            assert!((x - y).abs() <= 2e-3 * x, "{}: {x} {y}", a.name);
        }
    }
}

/// Exit code 1 where something is wrong with the input, 2 with the command; the message says what to do.
#[test]
fn what_goes_wrong_is_said() {
    let folder = folder("fit-wrong");
    folder.done(&["simulate", "sphere.toml", "-o", "p.ecsv", "-q"]);
    let predicted = curve(&folder, "p.ecsv");
    let refused = |change: &dyn Fn(&mut LightCurve), more: &[&str]| {
        let mut curve = predicted.clone();
        curve.kind = RateKind::Calibrated;
        change(&mut curve);
        write(&folder, "m.ecsv", &curve);
        folder.refused(1, &[&["fit", "m.ecsv", "sphere.toml"], more].concat())
    };
    let message = refused(&|c| c.kind = RateKind::Linear, &[]);
    assert!(message.contains("linear") && message.contains("sunglint apply"), "{message}");
    let message = refused(&|c| c.channels[0].name = "violet".into(), &[]);
    assert!(message.contains("no channel `violet`") && message.contains("spcm"), "{message}");
    let flagged = |c: &mut LightCurve| {
        c.channels.iter_mut().for_each(|c| c.flags.fill(Flags::SATURATED));
    };
    let message = refused(&flagged, &[]);
    assert!(
        message.contains("flag saturated") && message.contains("every sample is flagged"),
        "{message}"
    );
    // Six hours later the satellite is somewhere else.
    let later = |c: &mut LightCurve| {
        c.samples.time.iter_mut().for_each(|t| *t += hifitime::Unit::Hour * 6);
    };
    let message = refused(&later, &[]);
    assert!(
        message.contains("no sample is left") && message.contains("below the horizon"),
        "{message}"
    );
    assert!(message.contains("same pass"), "{message}");
    // Channels without uncertainties: one is told, and none left is refused with what to do.
    let unsure = |c: &mut LightCurve| c.channels.iter_mut().for_each(|c| c.sigma_hz.fill(0.0));
    let message = refused(&unsure, &[]);
    assert!(message.contains("uncertainty 0") && message.contains("NAME_sigma_hz"), "{message}");
    let mut one = predicted.clone();
    one.kind = RateKind::Calibrated;
    let name = one.channels[0].name.clone();
    one.channels[0].sigma_hz.fill(0.0);
    write(&folder, "m.ecsv", &one);
    let told = folder.run(&["fit", "m.ecsv", "sphere.toml"]);
    let told = String::from_utf8(told.stderr).unwrap();
    assert!(
        told.contains(&format!("the channel {name} does not count"))
            && told.contains(&format!("{name}_sigma_hz")),
        "{told}"
    );
    let message = refused(&|_| (), &["--free", "material.surface.alfa"]);
    assert!(message.contains("nothing that can be fitted is called"), "{message}");
    assert!(
        message.contains("time_offset_s") && message.contains("part.sphere.radius_m"),
        "{message}"
    );
    let message = refused(&|_| (), &["--channel", "violet"]);
    assert!(message.contains("violet"), "{message}");
    folder.refused(2, &["fit", "sphere.toml", "m.ecsv"]);
    folder.refused(2, &["fit", "m.ecsv", "sphere.toml", "--free", "gain=2..1"]);
}

/// Truth: a shift of the clock by 0.4 s and an albedo of 0.3 that were put in, with a size that is given: the sphere's rates at moments 0.4 s later are those of the
/// simulation. Tolerance: 1 ms and 1e-3; the rates have no noise but rounding.
#[test]
fn a_clock_that_is_ahead_is_found() {
    let folder = folder("fit-clock");
    folder.done(&["simulate", "sphere.toml", "-o", "p.ecsv", "-q"]);
    let mut moved = curve(&folder, "p.ecsv");
    moved.kind = RateKind::Calibrated;
    moved.samples.time.iter_mut().for_each(|t| *t -= hifitime::Unit::Second * 0.4);
    write(&folder, "m.ecsv", &moved);
    let arguments = [
        "fit",
        "m.ecsv",
        "sphere.toml",
        "--free",
        "time_offset_s=-2..2",
        "--places",
        "4",
        "--starts",
        "1",
        "--loss",
        "squares",
        "--json",
    ];
    let json = folder.json(&arguments);
    let value = |name: &str| -> f64 {
        let all = json["fit"]["parameters"].as_array().unwrap();
        all.iter().find(|p| p["name"] == name).unwrap()["value"].as_f64().unwrap()
    };
    assert!((value("time_offset_s") - 0.4).abs() < 1e-3, "{}", value("time_offset_s"));
    assert!((value("albedo.surface.g") - 0.5).abs() < 1e-3);
}

/// A box of 1 × 1 × 1.3 m with two panels that follow the Sun, its z axis to the Earth. Of each side of the box, of the cells and of the panels' backs one half is diffuse and one glossy (GGX of
/// roughness 0.3; the sky's side and the backs are diffuse alone), so that how much of both there is, is solved for; turned about all axes by what is free.
fn oneweb_body() -> String {
    let mut text = "[target]\nname = \"box and two panels\"\n".to_owned();
    let mut materials: Vec<String> = Vec::new();
    let mut part = |name: &str, half: usize, own: String| {
        let gloss = half == 1 && !["sky", "backs"].contains(&name);
        let material = if gloss { format!("{name} gloss") } else { name.to_owned() };
        writeln!(text, "[[target.part]]\n{own}\nmaterial = \"{material}\"").unwrap();
        if !materials.contains(&material) {
            let model = match gloss {
                true => "\"microfacet\"\ndistribution = \"ggx\"\nalpha = 0.3",
                false => "\"lambert\"",
            };
            writeln!(
                text,
                "[[target.material]]\nname = \"{material}\"\nmodel = {model}\nreflectance = 0.3"
            )
            .unwrap();
            materials.push(material);
        }
    };
    for (name, face) in [
        ("ram", "+x"),
        ("wake", "-x"),
        ("north", "+y"),
        ("south", "-y"),
        ("earth", "+z"),
        ("sky", "-z"),
    ] {
        for (half, sign) in [0.25, -0.25].into_iter().enumerate() {
            let (size, offset) = match face {
                "+y" | "-y" => ("[0.5, 1, 1.3]", format!("[{sign}, 0, 0]")),
                _ => ("[1, 0.5, 1.3]", format!("[0, {sign}, 0]")),
            };
            let own = format!(
                "name = \"{name} {half}\"\nshape = \"box\"\nsize_m = {size}\noffset_m = {offset}\nfaces = [\"{face}\"]"
            );
            part(name, half, own);
        }
    }
    for (name, face) in [("cells", "+z"), ("backs", "-z")] {
        for side in [1.6, -1.6] {
            for (half, x) in [0.25, -0.25].into_iter().enumerate() {
                let own = format!(
                    "name = \"{name} {half} at {side}\"\nshape = \"plate\"\nsize_m = [0.5, 1.7]\nfaces = [\"{face}\"]\noffset_m = [{x}, {side}, 0]\nhinge = \"boom\""
                );
                part(name, half, own);
            }
        }
    }
    text += "[[target.hinge]]\nname = \"boom\"\npoint_m = [0, 0, 0]\naxis = [0, 1, 0]\nface = [0, 0, 1]\n\
        [attitude]\nlaw = \"orbit\"\neuler_zyx_deg = [0, 0, 0]\n[air]\nnone = true\n[effects]\ninter_reflection = \"off\"\n\
        [fit]\nfree = [\"albedo\", \"attitude.pitch_deg=-20..20\", \"attitude.roll_deg=-20..20\", \"attitude.yaw_deg=-20..20\"]\n";
    text
}

/// Two tracks of ONEWEB-0165 as MMT-9 published them, ten samples a second: the fit tells the tracks' own noise apart from what is left. docs/fit.md has the figures.
/// Truth: the tracks' white noise as it was found before this program (0.09 and 0.21 mag), ± 0.03; the diffuse sphere's residual, found for each track
/// alone in the same way (0.18 and 0.38 mag about its mean), ± 0.015. What the body leaves, with albedos from 0 to 1, is held against the noise: at most 1.3 times it, which no sphere reaches; and `compare` of the scene that the fit wrote finds
/// the same residuals to 1e-3. Light is
/// computed at few epochs: what that errs by is stated, below 3e-4.
#[test]
fn oneweb_0165_is_fitted() {
    let files = (shared("real/oneweb_0165_geometry.csv"), shared("real/oneweb_0165_mmt9.txt"));
    let (Some(geometry), Some(measured)) = files else {
        return skip("oneweb_0165_is_fitted", "no shared/real beside the checkout");
    };
    let folder = Folder::new("fit-oneweb");
    let inputs = oneweb(&folder, &geometry, &measured);
    let run = |scene: &str| -> Value {
        let mut arguments = vec!["fit".to_owned()];
        for (number, _) in [1, 2].iter().zip(&inputs) {
            let own = std::fs::read_to_string(folder.path(&format!("rest{number}.toml"))).unwrap();
            let name = format!("{scene}{number}.toml");
            let body = if scene == "sphere" {
                "[target]\nsphere = { radius_m = 1.0, reflectance = 0.5 }\n[air]\nnone = true\n[fit]\nfree = [\"albedo\"]\n".to_owned()
            } else {
                oneweb_body()
            };
            std::fs::write(folder.path(&name), own + &body).unwrap();
            arguments.extend([format!("track{number}.txt"), name]);
        }
        arguments
            .extend(["--json", "--places", "12", "--starts", "1", "-o", scene].map(str::to_owned));
        std::fs::create_dir_all(folder.path(scene)).unwrap();
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let output = folder.run(&arguments);
        println!("{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let tracks = |json: &Value| -> Vec<[f64; 3]> {
        let curves = json["curves"].as_array().unwrap();
        let all = curves.iter().flat_map(|c| c["tracks"].as_array().unwrap().clone());
        let keys = ["white_noise_mag", "rms_mag", "mean_mag"];
        all.map(|t| keys.map(|k| t[k].as_f64().unwrap())).collect()
    };
    let sphere = run("sphere");
    let body = run("box");
    let (of_sphere, of_body) = (tracks(&sphere), tracks(&body));
    println!("sphere {of_sphere:?}, body {of_body:?}");
    for p in body["fit"]["parameters"].as_array().unwrap() {
        println!("{} {} ± {} {}", p["name"], p["value"], p["sigma"], p["interval_95"]);
    }
    if let Ok(kept) = std::env::var("SUNGLINT_KEEP") {
        std::fs::create_dir_all(&kept).unwrap();
        for entry in std::fs::read_dir(folder.path("box")).unwrap().flatten() {
            std::fs::copy(entry.path(), std::path::Path::new(&kept).join(entry.file_name()))
                .unwrap();
        }
    }
    for (k, (noise, round)) in [(0.09, 0.18), (0.21, 0.38)].into_iter().enumerate() {
        let [white, rms, mean] = of_sphere[k];
        assert!((white - noise).abs() < 0.03, "{of_sphere:?}");
        let about_its_mean = (rms * rms - mean * mean).sqrt();
        assert!((about_its_mean - round).abs() < 0.015, "{of_sphere:?}");
        assert!(of_body[k][1] < 1.3 * of_body[k][0], "{of_body:?}");
        let (track, scene) =
            (format!("track{}.txt", k + 1), format!("box/box{}.fitted.toml", k + 1));
        let compared = folder.json(&["compare", &track, &scene, "--json"]);
        let left = compared["channels"][0]["numbers"]["rms_mag"].as_f64().unwrap();
        assert!((left - of_body[k][1]).abs() < 1e-3, "{left} {of_body:?}");
    }
    for p in body["fit"]["parameters"].as_array().unwrap() {
        let (name, value) = (p["name"].as_str().unwrap(), p["value"].as_f64().unwrap());
        assert!(!name.starts_with("albedo") || (0.0..=1.0).contains(&value), "{p}");
    }
    assert_eq!(body["fit"]["converged"], true);
    for curve in body["curves"].as_array().unwrap() {
        let thinned = &curve["thinned"];
        assert!(thinned["error"].as_f64().unwrap() < 3e-4, "{thinned}");
        let [few, all] = ["direct", "epochs"].map(|k| thinned[k].as_u64().unwrap());
        assert!(5 * few < all, "{thinned}");
    }
}

/// Writes each track as a file of MMT-9's format, and what a scene needs besides its body.
fn oneweb(folder: &Folder, geometry: &std::path::Path, measured: &std::path::Path) -> Vec<String> {
    let geometry = std::fs::read_to_string(geometry).unwrap();
    let measured = std::fs::read_to_string(measured).unwrap();
    let rows: Vec<Vec<&str>> = (geometry.lines())
        .filter(|l| !l.starts_with('#') && !l.starts_with("utc"))
        .map(|l| l.split(',').collect())
        .collect();
    let notes: String =
        measured.lines().filter(|l| l.starts_with('#')).map(|l| format!("{l}\n")).collect();
    let mut names = Vec::new();
    for (number, day) in [(1, "2024-02-28"), (2, "2024-04-30")] {
        let own: Vec<&Vec<&str>> = rows.iter().filter(|r| r[0].starts_with(day)).collect();
        let mut ephemeris = "time_utc,x_km,y_km,z_km\n".to_owned();
        for (k, row) in own.iter().enumerate() {
            // Positions are rounded to 0.1 m; light leaves before it is seen, so that samples begin with the second.
            if k % 100 == 0 || k + 1 == own.len() {
                writeln!(ephemeris, "{},{},{},{}", row[0], row[1], row[2], row[3]).unwrap();
            }
        }
        let lines: String = (measured.lines().filter(|l| l.starts_with(day)).skip(1))
            .map(|l| format!("{l}\n"))
            .collect();
        std::fs::write(folder.path(&format!("positions{number}.csv")), ephemeris).unwrap();
        std::fs::write(folder.path(&format!("track{number}.txt")), format!("{notes}{lines}"))
            .unwrap();
        let rest = format!(
            "[ephemeris]\nfile = \"positions{number}.csv\"\n[station]\nfolder = \"{}\"\n[times]\nfrom = {day}T00:00:00Z\n",
            fixture("passes/mmt9").display()
        );
        std::fs::write(folder.path(&format!("rest{number}.toml")), rest).unwrap();
        names.push(format!("track{number}.txt"));
    }
    names
}

/// Truth: the reflectance that the corner was simulated with, 0.8, whose light is up to a fifth from one wall by way of the other (the engine's own truths, Mitsuba
/// among them, are in the simulator). Tolerance 2e-3: rounds end when none moves an albedo by a tenth of its σ of 0.0115. Without that light the albedo comes out too high by
/// more than ten times as much, so that the test would see it.
#[test]
fn light_between_the_parts_is_no_brighter_wall() {
    let folder = Folder::new("fit-corner");
    let scene = include_str!("common/corner.toml");
    std::fs::write(folder.path("corner.toml"), scene).unwrap();
    let without = format!("{scene}[effects]\ninter_reflection = \"off\"\n");
    std::fs::write(folder.path("without.toml"), without).unwrap();
    folder.done(&["simulate", "corner.toml", "-o", "corner.ecsv", "-q"]);
    let fitted = |scene: &str| {
        let fit = ["fit", "corner.ecsv", scene, "--free", "albedo", "--loss", "squares", "--json"];
        folder.json(&fit)
    };
    let found = fitted("corner.toml");
    let bounces = &found["bounces"];
    assert!(bounces["rounds"].as_u64() > Some(1) && bounces["settled"] == true, "{bounces}");
    let albedos = |found: &Value| -> Vec<f64> {
        let parameters = found["fit"]["parameters"].as_array().unwrap();
        parameters.iter().map(|p| p["value"].as_f64().unwrap()).collect()
    };
    for albedo in albedos(&found) {
        assert!((albedo - 0.8).abs() < 2e-3, "{albedo}");
    }
    for albedo in albedos(&fitted("without.toml")) {
        assert!(albedo > 0.82, "{albedo}");
    }
}

/// Truth: by construction: without a step from a clock that is 1.5 s off nothing is reached, which a search that may step does. Exit
/// code 1; the words say what happened and what to do; what was reached is written, and says that it did not converge.
#[test]
fn what_did_not_converge_is_written_and_said() {
    let folder = folder("fit-short");
    folder.done(&["simulate", "sphere.toml", "-o", "p.ecsv", "-q"]);
    let mut moved = curve(&folder, "p.ecsv");
    moved.kind = RateKind::Calibrated;
    moved.samples.time.iter_mut().for_each(|t| *t -= hifitime::Unit::Second * 1.5);
    write(&folder, "m.ecsv", &moved);
    let fit = [
        "fit",
        "m.ecsv",
        "sphere.toml",
        "--free",
        "time_offset_s=-2..2",
        "--places",
        "0",
        "--starts",
        "0",
    ];
    let output = folder.run(&[&fit[..], &["--iterations", "0", "-o", "short/"]].concat());
    assert_eq!(output.status.code(), Some(1));
    let message = String::from_utf8_lossy(&output.stderr);
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("NOT CONVERGED"), "{said}");
    assert!(message.contains("did not converge") && message.contains("--iterations"), "{message}");
    for file in ["sphere_fit.ecsv", "sphere_fit.html", "sphere_fit.png", "sphere.fitted.toml"] {
        assert!(folder.path("short").join(file).exists(), "{file}");
    }
    let table = ecsv::read(folder.path("short").join("sphere_fit.ecsv")).unwrap();
    assert_eq!(table.meta["fit"]["converged"], false);
    let page = std::fs::read_to_string(folder.path("short").join("sphere_fit.html")).unwrap();
    assert!(page.contains("did NOT converge"));
    assert_eq!(folder.json(&[&fit[..], &["--json"]].concat())["fit"]["converged"], true);
}

/// A plate with a narrow lobe that turns once in 12 s and flashes for a tenth of a second.
const FLASHING: &str = r#"
[target]
name = "plate"
[[target.part]]
name = "plate"
shape = "plate"
size_m = [1, 1]
material = "metal"
[[target.material]]
name = "metal"
model = "microfacet"
distribution = "beckmann"
alpha = ALPHA
reflectance = 0.5
[orbit]
lines = [
  "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
  "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
]
[attitude]
law = "spin"
axis_body = [1, 0, 0]
axis_ra_dec_deg = [56.85, 0]
phase_deg = 0
period_s = PERIOD
epoch_utc = 2008-09-21T18:48:00Z
[effects]
earthshine = "off"
[station]
name = "ufo"
[times]
from = 2008-09-21T18:47:59.7525Z
to = 2008-09-21T18:48:24.7475Z
step_s = 0.005
exposure_s = 0.005
"#;

/// Truth: sums over a hundred moments in each exposure of half a second, in which the flash rises and falls; period, roughness and reflectance as they were put in,
/// without noise. Tolerance: two of the standard uncertainties that σ of 0.3 % gives (6e-5 s, 3e-5, 8e-4), rounded up, and residuals of a half of σ: the step of 5 ms
/// makes sums err by up to 1e-3 of a flash. The same curve with exposures of 1 ms, which is to say its middles, fits nothing.
#[test]
fn a_flash_within_an_exposure_is_fitted() {
    const EACH: usize = 100;
    let folder = folder("fit-flash");
    let scene =
        |alpha: &str, period: &str| FLASHING.replace("ALPHA", alpha).replace("PERIOD", period);
    std::fs::write(folder.path("truth.toml"), scene("0.05", "12")).unwrap();
    std::fs::write(folder.path("first.toml"), scene("0.06", "11.99")).unwrap();
    folder.done(&["simulate", "truth.toml", "-o", "fine.ecsv", "-q"]);
    let fine = curve(&folder, "fine.ecsv");
    let n = fine.len() / EACH;
    let mut binned = fine.clone();
    binned.kind = RateKind::Calibrated;
    let middle =
        |i: usize| fine.samples.time[i * EACH + EACH / 2] - 2.5 * hifitime::Unit::Millisecond;
    binned.samples = Samples::new((0..n).map(middle).collect(), 0.5);
    for channel in &mut binned.channels {
        let mean =
            |i: usize| channel.rate_hz[i * EACH..(i + 1) * EACH].iter().sum::<f64>() / EACH as f64;
        let rate: Vec<f64> = (0..n).map(mean).collect();
        let most = rate.iter().copied().fold(0.0, f64::max);
        channel.sigma_hz = rate.iter().map(|r| 3e-3 * r.max(1e-3 * most)).collect();
        channel.flags = vec![Flags::empty(); n];
        channel.model_error_hz = None;
        channel.rate_hz = rate;
    }
    write(&folder, "measured.ecsv", &binned);
    let mut short = binned.clone();
    short.samples.exposure_s.fill(1e-3);
    write(&folder, "middles.ecsv", &short);
    let fitted = |curve: &str| -> (f64, [f64; 3]) {
        let command = format!(
            "fit {curve} first.toml --free attitude.period_s=11.97..12.03 --free material.metal.alpha=0.03..0.1 --free albedo --channel spcm \
             --scintillation 0 --places 32 --starts 3 --loss squares --json"
        );
        // What fits nothing does not converge, says so, and is written.
        let output = folder.run(&command.split_whitespace().collect::<Vec<_>>());
        let json: Value = serde_json::from_slice(&output.stdout).unwrap();
        let all = json["fit"]["parameters"].as_array().unwrap();
        let of = |name: &str| {
            let own = all.iter().find(|p| p["name"] == name).unwrap();
            own["value"].as_f64().unwrap()
        };
        println!("{curve}: {} {}", json["fit"]["parameters"], json["curves"]);
        let names = ["attitude.period_s", "material.metal.alpha", "albedo.metal.spcm"];
        (json["fit"]["reduced_chi2"].as_f64().unwrap(), names.map(of))
    };
    let (misfit, [period_s, alpha, albedo]) = fitted("measured.ecsv");
    println!("reduced chi-square {misfit}");
    assert!(misfit < 0.3, "{misfit}");
    assert!((period_s - 12.0).abs() < 1e-4, "{period_s}");
    assert!((alpha - 0.05).abs() < 1e-4 && (albedo - 0.5).abs() < 2e-3, "{alpha} {albedo}");
    let (misfit, found) = fitted("middles.ecsv");
    println!("middles: reduced chi-square {misfit}, {found:?}");
    assert!(misfit > 100.0, "{misfit}");
}

/// Rates of the page's sphere, changed by a factor for each channel and by a clock that is ahead, as a measured curve.
fn changed(folder: &Folder, name: &str, factor: &dyn Fn(usize) -> f64, ahead_s: f64) {
    let mut moved = curve(folder, "p.ecsv");
    moved.kind = RateKind::Calibrated;
    moved.samples.time.iter_mut().for_each(|t| *t -= hifitime::Unit::Second * ahead_s);
    for (c, channel) in moved.channels.iter_mut().enumerate() {
        channel.rate_hz.iter_mut().for_each(|r| *r *= factor(c));
        channel.sigma_hz.iter_mut().for_each(|s| *s *= factor(c));
    }
    write(folder, name, &moved);
}

/// Truth: curves that are the simulation's, times factors and moved by a clock, which the fit explains wholly: `compare` of the scene that the fit wrote with the curve must find
/// the scale 1 and nothing left. Tolerance 1e-3, which the program promises; 2e-3 for the sphere's light itself in `the_page_gives_back_what_was_put_in`.
#[test]
fn the_fitted_scene_is_the_fit() {
    let folder = folder("fit-scene");
    folder.done(&["simulate", "sphere.toml", "-o", "p.ecsv", "-q"]);
    let grey = |_: usize| 0.8;
    type Case<'a> = (&'a str, &'a dyn Fn(usize) -> f64, f64, &'a [&'a str]);
    let rising = |c: usize| 0.7 + 0.1 * c as f64;
    let steps = |c: usize| if c.is_multiple_of(2) { 0.3 } else { 1.7 };
    let cases: [Case<'_>; 8] = [
        ("rising", &rising, 0.0, &["--free", "albedo"]),
        ("steps", &steps, 0.0, &["--free", "albedo"]),
        ("scale", &grey, 0.0, &["--free", "scale.surface"]),
        ("albedo", &grey, 0.0, &["--free", "albedo"]),
        ("gain", &grey, 0.0, &["--free", "gain"]),
        ("size", &grey, 0.0, &["--free", "size"]),
        ("clock", &grey, 0.4, &["--free", "time_offset_s=-2..2", "--free", "scale.surface"]),
        ("air", &grey, 0.0, &["--free", "extinction", "--free", "scale.surface"]),
    ];
    for (name, factor, ahead_s, free) in cases {
        let page = page_scene().replace("free = [\"albedo\"]", "free = []");
        std::fs::write(folder.path(&format!("{name}.toml")), page).unwrap();
        changed(&folder, "m.ecsv", factor, ahead_s);
        let scene = format!("{name}.toml");
        let mut fit = vec!["fit", "m.ecsv", &scene, "--loss", "squares", "--places", "4"];
        fit.extend(["--starts", "1", "--json", "-o", name]);
        fit.extend(free);
        std::fs::create_dir_all(folder.path(name)).unwrap();
        let found = folder.json(&fit);
        assert_eq!(found["scenes"][0]["same"], true, "{name}: {}", found["scenes"]);
        let written = format!("{name}/{name}.fitted.toml");
        let compared = folder.json(&["compare", "m.ecsv", &written, "--json"]);
        for channel in compared["channels"].as_array().unwrap() {
            let numbers = &channel["numbers"];
            let [scale, rms] = ["scale", "rms"].map(|k| numbers[k].as_f64().unwrap());
            assert!((scale - 1.0).abs() < 1e-3 && rms < 1e-3, "{name}: {channel}");
        }
    }
    // Two curves with a gain each: two scenes, each of its own curve.
    changed(&folder, "a.ecsv", &|_| 0.8, 0.0);
    changed(&folder, "b.ecsv", &|_| 1.2, 0.0);
    let fit = ["fit", "a.ecsv", "b.ecsv", "gain.toml", "--free", "gain", "--per-pass", "gain"];
    let fit: Vec<&str> = fit.into_iter().chain(["--json", "-o", "gain", "--force"]).collect();
    let found = folder.json(&fit);
    assert_eq!(found["scenes"].as_array().unwrap().len(), 2, "{}", found["scenes"]);
    for (file, curve) in [("gain", "a.ecsv"), ("gain_2", "b.ecsv")] {
        let compared =
            folder.json(&["compare", curve, &format!("gain/{file}.fitted.toml"), "--json"]);
        for channel in compared["channels"].as_array().unwrap() {
            let scale = channel["numbers"]["scale"].as_f64().unwrap();
            assert!((scale - 1.0).abs() < 1e-3, "{file}: {channel}");
        }
    }
}

/// Truth: two spheres that were simulated alike but for their reflectance, 0.5 and 0.25: the one predicts the other too bright, or too faint, by 2.5 lg 2 = 0.7526 mag.
/// Tolerance: 2e-3, as spectra match bands. Names that are none, and all curves at once, are refused.
#[test]
fn a_curve_that_is_left_out_is_predicted_by_the_others() {
    let folder = folder("fit-leave-out");
    let dark = page_scene().replace("reflectance = 0.5", "reflectance = 0.25");
    std::fs::write(folder.path("dark.toml"), dark).unwrap();
    folder.done(&["simulate", "sphere.toml", "-o", "bright.ecsv"]);
    folder.done(&["simulate", "dark.toml", "-o", "dark.ecsv"]);
    let fit = ["fit", "bright.ecsv", "dark.ecsv", "sphere.toml", "--leave-out"];
    let json = folder.json(&[&fit[..], &["each", "--json"]].concat());
    let predicted = json["predicted"].as_array().unwrap();
    assert_eq!(predicted.len(), 2);
    for (one, (name, sign)) in predicted.iter().zip([("bright.ecsv", -1.0), ("dark.ecsv", 1.0)]) {
        let curve = &one["curves"][0];
        assert_eq!(curve["name"], name);
        let [rms, mean] = ["rms_mag", "mean_mag"].map(|k| curve[k].as_f64().unwrap());
        let truth = 2.5 * 2_f64.log10();
        assert!((rms - truth).abs() < 2e-3 && (mean - sign * truth).abs() < 2e-3, "{curve}");
    }
    let text = folder.done(&[&fit[..], &["dark.ecsv"]].concat());
    assert!(text.contains("predicted by fits of the other curves"), "{text}");
    for (wrong, why) in
        [("none.ecsv", "no curve none.ecsv"), ("bright.ecsv,dark.ecsv", "no curve is left")]
    {
        let output = folder.run(&[&fit[..], &[wrong]].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(why), "{said}");
    }
}

/// A diffuse sphere and one small glossy plate that keep their sides to the Earth.
const GLINTING: &str = r#"
[[target.part]]
name = "ball"
shape = "sphere"
radius_m = 0.5
material = "paint"
[[target.part]]
name = "plate"
shape = "plate"
size_m = [0.05, 0.05]
faces = ["+z"]
offset_m = [0, 20, 0]
euler_zyx_deg = [0, 0, 0]
material = "gloss"
[[target.material]]
name = "paint"
model = "lambert"
reflectance = 0.3
[[target.material]]
name = "gloss"
model = "microfacet"
distribution = "ggx"
alpha = 0.1
reflectance = 0.3
[orbit]
lines = [
  "SYNTHETIC DUSK",
  "1 99004U 20001A   20323.50000000  .00000000  00000-0  10000-4 0    19",
  "2 99004  98.6000 318.0000 0010000  90.0000  90.0000 14.27000000    13",
]
[station]
name = "ufo"
[air]
none = true
[effects]
earthshine = "off"
inter_reflection = "off"
[attitude]
law = "orbit"
euler_zyx_deg = [0, 0, 0]
[times]
from = 2020-11-18T16:24:00Z
to = 2020-11-18T16:30:00Z
step_s = 0.5
exposure_s = 0.1
[fit]
free = ["albedo", "normal.plate", "material.gloss.alpha=0.02..0.3"]
"#;

/// Truth: the scene that the magnitudes were simulated from, with noise of 0.05 and 0.3 mag: an albedo of 0.3, exposures of 0.1 s, which the file does not say. A sphere three magnitudes brighter than any albedo makes it stands
/// at its bound, alone as its number is; an hour later the satellite is below the horizon, and no channel but V was measured. Tolerance: three standard errors.
#[test]
fn magnitudes_have_the_scenes_exposures_horizon_and_bounds() {
    let folder = Folder::new("fit-magnitudes");
    let scene = GLINTING.replace(
        "\"albedo\", \"normal.plate\", \"material.gloss.alpha=0.02..0.3\"",
        "\"albedo.paint\"",
    );
    std::fs::write(folder.path("ball.toml"), scene).unwrap();
    std::fs::create_dir_all(folder.path("of")).unwrap();
    folder.done(&["simulate", "ball.toml", "-o", "of/", "-q"]);
    let text = std::fs::read_to_string(folder.path("of/ball_geometry.ecsv")).unwrap();
    let table = ecsv::read_str("ball_geometry.ecsv", &text).unwrap();
    let v_mag = table.f64("v_mag").unwrap().to_vec();
    let times = text.lines().filter(|l| l.starts_with("2020"));
    let times: Vec<&str> = times.map(|l| l.split([' ', ',']).next().unwrap()).collect();
    let noisy = |name: &str, brighter: f64, hour: &str, noise: f64| {
        let mut lines = "# synthetic\ntime_utc,magnitude,sigma_mag\n".to_owned();
        // Twelve even numbers from 0 to 1 less 6: a standard deviation of 1. Numbers by Knuth's multiplier, the upper bits.
        let mut state = 1_u64;
        let mut even = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / 2_f64.powi(53)
        };
        for (time, mag) in times.iter().zip(&v_mag) {
            let chance = (0..12).map(|_| even()).sum::<f64>() - 6.0;
            let time = time.replace("T16:", hour);
            writeln!(lines, "{time},{:.5},{noise}", mag - brighter + noise * chance).unwrap();
        }
        std::fs::write(folder.path(name), lines).unwrap();
    };
    let write = |name: &str, brighter: f64, hour: &str| noisy(name, brighter, hour, 0.05);
    write("m.csv", 0.0, "T16:");
    let output = folder.run(&["fit", "m.csv", "ball.toml", "--json"]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("those of the scene are taken, 0.1 s"), "{said}");
    let fitted: Value = serde_json::from_slice(&output.stdout).unwrap();
    let albedo = &fitted["fit"]["parameters"][0];
    let (value, sigma) = (albedo["value"].as_f64().unwrap(), albedo["sigma"].as_f64().unwrap());
    assert!((value - 0.3).abs() < 3.0 * sigma && sigma < 0.002, "{value} {sigma}");
    let said = folder.refused(1, &["fit", "m.csv", "ball.toml", "--channel", "r"]);
    assert!(said.contains("no curve has the channel `r`"), "{said}");
    // Each uncertainty is the share of the light that the file says, whatever the sample's own light.
    let read = MeasuredCurve::read(&folder.path("m.csv"), &MagnitudeOptions::default()).unwrap();
    let share = 0.05 * 0.4 * std::f64::consts::LN_10;
    assert!(read.share.unwrap().iter().all(|s| (s / share - 1.0).abs() < 1e-9));
    // Noise of 0.3 mag makes the mean light 4 % more, which is no albedo; in magnitudes it is the noise that it is.
    noisy("wide.csv", 0.0, "T16:", 0.3);
    let wide = folder.json(&["fit", "wide.csv", "ball.toml", "--json", "-q"]);
    let albedo = &wide["fit"]["parameters"][0];
    let (value, sigma) = (albedo["value"].as_f64().unwrap(), albedo["sigma"].as_f64().unwrap());
    assert!((value - 0.3).abs() < 3.0 * sigma && sigma < 0.01, "{value} {sigma}");
    let compared = folder.json(&["compare", "wide.csv", "ball.toml", "--json", "-q"]);
    let numbers = &compared["channels"][0]["numbers"];
    let number = |key: &str| numbers[key].as_f64().unwrap();
    let n = compared["channels"][0]["used"].as_f64().unwrap();
    assert!((number("scale") - 1.0).abs() < 3.0 * number("scale_sigma"), "{numbers}");
    assert!((number("scale_sigma") * n.sqrt() / (6.0 * share) - 1.0).abs() < 0.05, "{numbers}");
    let chi2 = numbers["chi2"]["data"].as_f64().unwrap();
    assert!((chi2 - 1.0).abs() < 3.0 * (2.0 / n).sqrt(), "{numbers}");
    let said = folder.refused(1, &["fit", "m.csv", "m.csv", "ball.toml"]);
    assert!(said.contains("give them once"), "{said}");
    let said = folder.refused(1, &["fit", "m.csv", "ball.toml", "--sigma-mag", "0"]);
    assert!(said.contains("a noise of 0 mag"), "{said}");
    write("bright.csv", 3.0, "T16:");
    let bright = folder.json(&["fit", "bright.csv", "ball.toml", "--json", "-q"]);
    assert_eq!(bright["fit"]["parameters"][0]["at_bound"], "high", "{bright}");
    write("later.csv", 0.0, "T17:");
    let said = folder.refused(1, &["fit", "later.csv", "ball.toml"]);
    assert!(said.contains("below the horizon"), "{said}");
}

/// Truth: formulas of this test alone: magnitudes of a Lambert sphere (2/3 ρ r² Φ) and of a GGX plate (Walter 2007 with Smith's height-correlated masking, as Heitz 2014 writes them) over the sphere's, with noise of
/// 0.05 mag; the directions are those of `simulate`'s table of geometry. Normals are drawn beside the way of the mirrored direction. Tolerance: 0.3° along the way of the mirrored direction; 3° across it, where
/// a way that is nearly straight tells neither the side nor, since roughness and albedo make up for it, the distance; residuals of 1.1 times the noise. Without the search the same scene leaves more than twice that, so that the test would see it.
#[test]
fn the_normal_of_a_glint_is_found() {
    let folder = Folder::new("fit-normal");
    std::fs::create_dir_all(folder.path("of")).unwrap();
    let alone = GLINTING.replace("reflectance = 0.3\n[orbit]", "reflectance = 0\n[orbit]").replace(
        "\"albedo\", \"normal.plate\", \"material.gloss.alpha=0.02..0.3\"",
        "\"albedo.paint\"",
    );
    assert_ne!(alone, GLINTING);
    std::fs::write(folder.path("ball.toml"), alone).unwrap();
    std::fs::write(folder.path("body.toml"), GLINTING).unwrap();
    folder.done(&["simulate", "ball.toml", "-o", "of/", "-q"]);
    let text = std::fs::read_to_string(folder.path("of/ball_geometry.ecsv")).unwrap();
    let table = ecsv::read_str("ball_geometry.ecsv", &text).unwrap();
    let column = |name: &str| table.f64(name).unwrap().to_vec();
    let vectors = |name: &str| -> Vec<glam::DVec3> {
        let [x, y, z] = ["x", "y", "z"].map(|axis| column(&format!("{name}_body_{axis}")));
        (0..x.len()).map(|i| glam::DVec3::new(x[i], y[i], z[i])).collect()
    };
    let (sun, observer, v_mag) = (vectors("sun"), vectors("observer"), column("v_mag"));
    let times: Vec<String> = text
        .lines()
        .filter(|l| l.starts_with("2020"))
        .map(|l| l.split([' ', ',']).next().unwrap().to_owned())
        .collect();
    assert_eq!(times.len(), v_mag.len());
    let n = times.len();
    let (radius_m, white, area_m2) = (0.5_f64, 0.3_f64, 0.05_f64 * 0.05);
    let glint = |i: usize, normal: glam::DVec3, alpha: f64| -> f64 {
        let (s, o) = (sun[i].dot(normal), observer[i].dot(normal));
        if s <= 0.0 || o <= 0.0 {
            return 0.0;
        }
        let h = (sun[i] + observer[i]).normalize().dot(normal);
        let d =
            alpha * alpha / (std::f64::consts::PI * (h * h * (alpha * alpha - 1.0) + 1.0).powi(2));
        let lambda = |c: f64| 0.5 * ((1.0 + alpha * alpha * (1.0 / (c * c) - 1.0)).sqrt() - 1.0);
        d / (1.0 + lambda(s) + lambda(o)) / 4.0 * area_m2
    };
    let ball = |i: usize| -> f64 {
        let phase = sun[i].angle_between(observer[i]);
        2.0 / 3.0
            * white
            * radius_m.powi(2)
            * (phase.sin() + (std::f64::consts::PI - phase) * phase.cos())
            / std::f64::consts::PI
    };
    for (k, (share, alpha, albedo)) in
        [(0.3, 0.05, 0.6), (0.5, 0.1, 0.9), (0.65, 0.03, 0.25)].into_iter().enumerate()
    {
        let middle = (share * n as f64) as usize;
        let way = (sun[middle] + observer[middle]).normalize();
        let aside = way.cross(glam::DVec3::new(0.3, -0.5, 0.8)).normalize();
        let normal = (way + 0.5_f64.to_radians() * aside).normalize();
        let mut lines = "# synthetic\ntime_utc,magnitude,sigma_mag\n".to_owned();
        for i in 0..n {
            // Sums of twelve even numbers are nearly normal.
            let even =
                |j: usize| ((12 * (i + 1000 * k) + j) as f64 * 0.618_033_988_749_895).fract();
            let chance = (0..12).map(|j| ((even(j) * 7919.0).fract()) - 0.5).sum::<f64>();
            let more = -2.5 * (1.0 + albedo * glint(i, normal, alpha) / ball(i)).log10();
            writeln!(lines, "{},{:.5},0.05", times[i], v_mag[i] + more + 0.05 * chance).unwrap();
        }
        std::fs::write(folder.path("m.csv"), lines).unwrap();
        let fitted =
            folder.json(&["fit", "m.csv", "body.toml", "--places", "8", "--starts", "1", "--json"]);
        let value = |name: &str| -> f64 {
            let all = fitted["fit"]["parameters"].as_array().unwrap();
            all.iter().find(|p| p["name"] == name).unwrap()["value"].as_f64().unwrap()
        };
        let (azimuth, tilt) = (
            value("normal.plate.azimuth_deg").to_radians(),
            value("normal.plate.tilt_deg").to_radians(),
        );
        let found =
            glam::DVec3::new(azimuth.cos() * tilt.sin(), azimuth.sin() * tilt.sin(), tilt.cos());
        let apart = found.angle_between(normal).to_degrees();
        let chi2 = fitted["fit"]["reduced_chi2"].as_f64().unwrap();
        let (rough, white) = (value("material.gloss.alpha"), value("albedo.paint.V"));
        println!(
            "{k}: {apart:.3}°, alpha {rough} of {alpha}, gloss {} of {albedo}, paint {white}, chi-square {chi2}, {} simulations",
            value("albedo.gloss.V"),
            fitted["fit"]["evaluations"]
        );
        let next = (sun[middle + 1] + observer[middle + 1]).normalize();
        let along = (found - normal).dot((next - way).normalize()).to_degrees();
        assert!(along.abs() < 0.3 && apart < 3.0, "{along} {apart}");
        assert!((white / 0.3 - 1.0).abs() < 0.02, "{white}");
        assert!(chi2 < 1.21, "{chi2}");
        let blind = folder.json(&["fit", "m.csv", "ball.toml", "--json"]);
        assert!(
            blind["fit"]["reduced_chi2"].as_f64().unwrap() > 4.0,
            "{}",
            blind["fit"]["reduced_chi2"]
        );
    }
    // What cannot be searched for is refused, with what to do.
    for (change, free, says) in [
        (
            ("euler_zyx_deg = [0, 0, 0]\nmaterial", "material"),
            "normal.plate",
            "euler_zyx_deg = [0, 0, 0]",
        ),
        (("faces = [\"+z\"]", "faces = [\"+z\"]"), "normal.ball", "only a plate has one normal"),
        (("material = \"paint\"", "material = \"gloss\""), "normal.plate", "a material of its own"),
        (("faces", "faces"), "normal.plate=0..90", "no range"),
    ] {
        let text = GLINTING.replacen(change.0, change.1, 1).replace(
            "\"albedo\", \"normal.plate\", \"material.gloss.alpha=0.02..0.3\"",
            "\"albedo\"",
        );
        std::fs::write(folder.path("wrong.toml"), text).unwrap();
        let said = folder.refused(1, &["fit", "m.csv", "wrong.toml", "--free", free]);
        assert!(said.contains(says), "{said}");
    }
}
