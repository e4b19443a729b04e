//! `sunglint compare` and its page, run as a person runs them.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::{Folder, SPHERE_PASS};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;
use sunglint_formats::{Values, ecsv};
use sunglint_radiometry::light_curve::{Flags, LightCurve, RateKind};
use sunglint_testkit::{fixture, repository, shared, skip};

/// Ratio of measured to simulated light: put in.
const SCALE: f64 = 0.9;
/// The relative noise that is put in.
const NOISE: f64 = 0.02;

/// A number of mean 0 and variance 1 that looks like chance, the same every time.
fn chance(i: usize) -> f64 {
    12_f64.sqrt() * ((i as f64 + 1.0) * 0.754_877_666_246_692_8).fract() - 3_f64.sqrt()
}

fn write(path: &Path, curve: &LightCurve) {
    std::fs::write(path, ecsv::to_string(&curve.to_table().unwrap()).unwrap()).unwrap();
}

/// A folder with `pass.toml` (a step of so many seconds) and `measured.ecsv`: what the simulation says at its moments, times [`SCALE`], with noise that
/// its σ state, calibrated by a κ known to 1 %.
fn folder(name: &str, step_s: f64) -> (Folder, LightCurve) {
    let folder = Folder::new(name);
    let scene = SPHERE_PASS.replace("step_s = 20", &format!("step_s = {step_s}"));
    std::fs::write(folder.path("pass.toml"), scene).unwrap();
    folder.done(&["simulate", "pass.toml", "-o", "predicted.ecsv", "-q"]);
    let table = ecsv::read(folder.path("predicted.ecsv")).unwrap();
    let mut curve = LightCurve::from_table("predicted.ecsv", &table).unwrap();
    curve.kind = RateKind::Calibrated;
    for (c, channel) in curve.channels.iter_mut().enumerate() {
        channel.model_error_hz = None;
        for i in 0..channel.rate_hz.len() {
            let rate = SCALE * channel.rate_hz[i];
            channel.rate_hz[i] = rate * (1.0 + NOISE * chance(31 * i + 7 * c));
            channel.sigma_hz[i] = NOISE * rate;
        }
    }
    let rows: Vec<Value> = (curve.channels.iter())
        .map(|c| json!({"channel": c.name, "kappa": 2.0, "relative_sigma": 0.01, "interval": [1.96, 2.04]}))
        .collect();
    let covariance: Vec<Vec<f64>> =
        (0..6).map(|i| (0..6).map(|j| if i == j { 1e-4 } else { 0.5e-4 }).collect()).collect();
    let kappa = json!({"file": "kappa.ecsv", "sha256": "ab", "night": "2008-09-21", "station": "ufo", "air": "clean", "confidence": 0.95,
        "channels": rows, "covariance_ln_kappa": covariance, "note": "made up"});
    curve.other.insert("kappa".into(), kappa);
    write(&folder.path("measured.ecsv"), &curve);
    (folder, curve)
}

const COMPARE: [&str; 3] = ["compare", "measured.ecsv", "pass.toml"];

/// A curve of another satellite, and one in kHz. Truth: the numbers that are put in: the scene's orbit is that of 25544. With the same elements, and in Hz, nothing is said.
#[test]
fn another_object_or_unit_is_told() {
    let (folder, curve) = folder("compare-other", 20.0);
    let lines = |id: &str| {
        let line = |text: &str| {
            let sum: u32 =
                text.chars().map(|c| c.to_digit(10).unwrap_or(u32::from(c == '-'))).sum();
            format!("{text}{}", sum % 10)
        };
        let first = format!("1 {id}U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  292");
        let second = format!("2 {id}  51.6416 247.4627 0006703 130.5360 325.0288 15.7212539156353");
        json!({"name": "made up", "kind": "satellite", "tle": [line(&first), line(&second)]})
    };
    for (id, factor, told) in
        [("25544", 1.0, ""), ("99003", 1.0, "object 99003"), ("25544", 1e-4, "e-5 times")]
    {
        let mut curve = curve.clone();
        curve.other.insert("target".into(), lines(id));
        for channel in &mut curve.channels {
            channel.rate_hz.iter_mut().chain(&mut channel.sigma_hz).for_each(|v| *v *= factor);
        }
        write(&folder.path("measured.ecsv"), &curve);
        let warnings = folder.json(&[&COMPARE[..], &["--json"]].concat())["warnings"].to_string();
        let said = ["object 99003", "e-5 times"].map(|words| warnings.contains(words));
        assert_eq!(said, [told == "object 99003", told == "e-5 times"], "{warnings}");
    }
}

/// Times of another scale. Truth: the shift that is put in (GPS time less UTC is 14 s in 2008, Terrestrial Time 65.184 s, a clock 30 s slow; fewer seconds a smooth curve does not tell), found to 0.5 s or what is stated; nothing is said of right times, nor of a model that is
/// wrong: light that falls by a tenth a minute more than it should.
#[test]
fn times_of_another_scale_are_told() {
    let (folder, curve) = folder("compare-shift", 2.0);
    for (late_s, told) in [
        (0.0, ""),
        (14.0, "14.0 s earlier"),
        (65.184, "65.2 s earlier"),
        (-30.0, "30.0 s later"),
        (f64::NAN, ""),
    ] {
        let mut curve = curve.clone();
        let first = curve.samples.time[0];
        if late_s.is_nan() {
            let falls: Vec<f64> = curve
                .samples
                .time
                .iter()
                .map(|t| (-(*t - first).to_seconds() / 600.0).exp())
                .collect();
            for channel in &mut curve.channels {
                let both = channel.rate_hz.iter_mut().zip(&mut channel.sigma_hz);
                both.zip(&falls)
                    .for_each(|((rate, sigma), f)| (*rate, *sigma) = (*rate * f, *sigma * f));
            }
        } else {
            let times = curve.samples.time.iter_mut();
            times.for_each(|t| *t += hifitime::Duration::from_seconds(late_s));
        }
        write(&folder.path("measured.ecsv"), &curve);
        let warnings = folder.json(&[&COMPARE[..], &["--json"]].concat())["warnings"].to_string();
        let said = warnings.contains("agree much better");
        assert_eq!(said, !told.is_empty(), "{late_s}: {warnings}");
        let number = |text: &str| {
            let (before, _) = text.split_once(" s earlier").or(text.split_once(" s later"))?;
            before.rsplit(' ').next()?.parse::<f64>().ok()
        };
        if let Some(asked) = number(told) {
            let found = number(&warnings).unwrap();
            let stated =
                warnings.split_once(", ± ").and_then(|(_, rest)| rest.split_once(" s (scatter"));
            let stated: f64 = stated.unwrap().0.parse().unwrap();
            assert!((found - asked).abs() <= stated.max(0.5) && stated < 8.0, "{told}: {warnings}");
            assert!(warnings.contains(told.rsplit(' ').next().unwrap()), "{told}: {warnings}");
        }
        let named = ["GPS time", "Terrestrial Time"].map(|scale| warnings.contains(scale));
        assert_eq!(named, [late_s == 14.0, late_s == 65.184], "{warnings}");
    }
}

/// Truth: the scale, the noise and the covariance of κ that were put in. Tolerance: three of the stated uncertainties; 15 % of the noise.
#[test]
fn what_was_put_in_is_found() {
    let (folder, curve) = folder("compare-found", 2.0);
    // The camera is saturated where the sphere is near.
    let bad = Flags::HIDDEN | Flags::SATURATED | Flags::ECLIPSED;
    let good = |name: &str| {
        let flags = &curve.channel(name).unwrap().flags;
        flags.iter().filter(|f| !f.intersects(bad)).count()
    };
    let json = folder.json(&[&COMPARE[..], &["--json", "-o", "out/"]].concat());
    assert_eq!(json["station"]["name"], "ufo");
    assert_eq!(json["night"], "2008-09-21");
    let channels = json["channels"].as_array().unwrap();
    assert_eq!(channels.len(), 6);
    for channel in channels {
        let n = &channel["numbers"];
        let number = |key: &str| n[key].as_f64().unwrap_or_else(|| panic!("{key}: {channel}"));
        let sigma = number("scale_sigma").max(number("scale_sigma_blocks"));
        assert!((number("scale") - SCALE).abs() < 3.0 * sigma, "{channel}");
        assert!(sigma < 0.01, "{channel}");
        assert!((number("noise") / NOISE - 1.0).abs() < 1e-2);
        assert!((number("rms") / NOISE - 1.0).abs() < 0.15, "{channel}");
        let chi2 = n["chi2"]["data"].as_f64().unwrap();
        assert!((chi2 - 1.0).abs() < 0.3, "{channel}");
        assert!(n["chi2"]["unscaled"].as_f64().unwrap() > 10.0);
        assert_eq!(number("kappa_sigma"), 0.01);
        let name = channel["name"].as_str().unwrap();
        assert_eq!(channel["used"].as_u64().unwrap() as usize, good(name), "{name}");
        // What lies below the horizon is flagged in the measurement already.
        assert!(channel["left_out"]["hidden"].as_u64().unwrap() > 10);
        assert!(channel["by_phase"].as_array().unwrap().len() > 3);
    }
    for ratio in json["ratios"].as_array().unwrap() {
        assert!((ratio["scale"].as_f64().unwrap() - 1.0).abs() < 0.02, "{ratio}");
        // 1e-4 + 1e-4 − 2 · 0.5e-4.
        assert!((ratio["kappa_sigma"].as_f64().unwrap() - 0.01).abs() < 1e-9);
    }
    for file in ["ecsv", "png", "svg", "html"] {
        assert!(folder.path(&format!("out/pass_compared.{file}")).exists(), "{file}");
    }
    assert!(folder.path("out/pass_compared_residuals.png").exists());
    let table = ecsv::read(folder.path("out/pass_compared.ecsv")).unwrap();
    let used = table.column("spcm_used").unwrap();
    let Values::I64(used) = &used.values else { panic!("numbers") };
    assert_eq!(used.iter().filter(|u| **u == Some(1)).count(), good("spcm"));
    // The means over exposures of 0.1 s are the middles that were put in, but in the edge of the Earth's shadow, where nothing is compared: there the light bends
    // by 4 % s⁻², which is 2e-5 of it.
    let (m, s) = (table.f64("spcm_measured_hz").unwrap(), table.f64("spcm_simulated_hz").unwrap());
    let spcm = curve.channel("spcm").unwrap();
    for i in (0..m.len()).filter(|i| used[*i] == Some(1)) {
        let put_in = spcm.sigma_hz[i] / (NOISE * SCALE);
        assert!((s[i] / put_in - 1.0).abs() < 1e-5, "{i}: {} {put_in}", s[i]);
    }
    // Only what is asked for.
    let one = folder.json(&[&COMPARE[..], &["--json", "--channel", "g"]].concat());
    assert_eq!(one["channels"].as_array().unwrap().len(), 1);
    assert!(folder.refused(1, &[&COMPARE[..], &["-o", "out/"]].concat()).contains("--force"));
}

/// Truth: closed form. Of a sphere whose f is known to e^±0.2 in all directions the light is known to e^0.2 − 1, and so is the scale: noise of 2 % about the scaled simulation is far inside that, and the scale's own
/// uncertainty is what it is without. A fitted gain takes up all of it: its relative standard uncertainty by the material is (e^0.2 − 1)/1.96, and by nothing else as large. Tolerance 2 % (the doubt's integral over a sphere).
#[test]
fn the_doubt_of_a_material_is_carried_to_scale_and_fit() {
    let (folder, _) = folder("compare-doubt", 10.0);
    let without = folder.json(&[&COMPARE[..], &["--json", "--channel", "g"]].concat());
    assert!(without["doubtful_materials"].is_null());
    assert!(without["channels"][0]["numbers"]["material"].is_null());
    let rest = SPHERE_PASS.replace("step_s = 20", "step_s = 10");
    let rest = rest.split_once("[orbit]").unwrap().1;
    let target = "[[target.part]]\nname = \"ball\"\nshape = \"sphere\"\nradius_m = 0.5\nmaterial = \"known\"\n[[target.material]]\nname = \"known\"\nmodel = \"composite\"\nreflectance = 1.0\ndiffuse = { reflectance = 0.5 }\n[target.material.doubt]\npeak_ln = 0.2\nwings_ln = 0.2\ngrazing_ln = 0.2\n";
    std::fs::write(folder.path("pass.toml"), format!("{target}[orbit]{rest}")).unwrap();
    let json = folder.json(&[&COMPARE[..], &["--json", "--channel", "g", "-o", "out/"]].concat());
    assert_eq!(json["doubtful_materials"], json!(["known"]));
    let wanted = 0.2_f64.exp_m1();
    let n = &json["channels"][0]["numbers"];
    for key in ["median_relative", "largest_relative", "of_scale"] {
        let found = n["material"][key].as_f64().unwrap();
        assert!((found / wanted - 1.0).abs() < 0.02, "{key}: {found} {wanted}");
    }
    assert!(n["chi2"]["past_materials"].as_f64().unwrap() < 1e-3, "{n}");
    assert!(n["chi2"]["data"].as_f64().unwrap() > 0.5, "{n}");
    let relative = |json: &Value| {
        let n = &json["channels"][0]["numbers"];
        n["scale_sigma"].as_f64().unwrap() / n["scale"].as_f64().unwrap()
    };
    assert!((relative(&json) / relative(&without) - 1.0).abs() < 0.1, "{n}");
    let table = ecsv::read(folder.path("out/pass_compared.ecsv")).unwrap();
    let (half, light) = (table.f64("g_material_hz").unwrap(), table.f64("g_simulated_hz").unwrap());
    let lit: Vec<usize> = (0..light.len()).filter(|i| light[*i] > 0.0).collect();
    assert!(lit.len() > 10);
    for i in lit {
        assert!((half[i] / light[i] / wanted - 1.0).abs() < 0.02, "{i}: {}", half[i] / light[i]);
    }
    let fit = folder.json(&[
        "fit",
        "measured.ecsv",
        "pass.toml",
        "--free",
        "gain",
        "--channel",
        "g",
        "--json",
    ]);
    assert_eq!(fit["doubtful_materials"], json!(["known"]));
    let gain = &fit["fit"]["parameters"][0];
    let number = |key: &str| gain[key].as_f64().unwrap_or_else(|| panic!("{key}: {gain}"));
    let by_material = number("sigma_material") / number("value");
    assert!((by_material / (wanted / 1.96) - 1.0).abs() < 0.02, "{gain}");
    assert!(number("sigma") >= number("sigma_material") && number("sigma") < 0.2 * number("value"));
}

/// Truth: the same rows from the first to the last. Everything is the same to the last bit but the file's digest and the seconds that the simulation took.
#[test]
fn the_order_of_rows_does_not_matter() {
    let (folder, curve) = folder("compare-order", 20.0);
    write(&folder.path("measured.ecsv"), &curve);
    let sorted = folder.json(&[&COMPARE[..], &["--json"]].concat());
    let text = std::fs::read_to_string(folder.path("measured.ecsv")).unwrap();
    let first = text.lines().take_while(|line| line.starts_with('#')).count() + 1;
    let lines: Vec<&str> = text.lines().collect();
    let (head, rows) = lines.split_at(first);
    let half = |skipped| rows.iter().rev().skip(skipped).step_by(2).copied();
    let shuffled: Vec<&str> = half(0).chain(half(1)).collect();
    assert_eq!(shuffled.len(), rows.len());
    std::fs::write(folder.path("measured.ecsv"), [head, &shuffled].concat().join("\n")).unwrap();
    let found = folder.json(&[&COMPARE[..], &["--json"]].concat());
    for key in ["channels", "ratios"] {
        assert_eq!(found[key], sorted[key], "{key}");
    }
    // A row that stands there twice counts once, and is told.
    let doubled = [head, &shuffled, &rows[..7]].concat().join("\n");
    std::fs::write(folder.path("measured.ecsv"), doubled).unwrap();
    let found = folder.json(&[&COMPARE[..], &["--json"]].concat());
    for key in ["channels", "ratios"] {
        assert_eq!(found[key], sorted[key], "{key}");
    }
    let warnings = found["warnings"].as_array().unwrap();
    let is_told = |w: &serde_json::Value| w.as_str().unwrap().contains("7 samples stand there");
    assert!(warnings.iter().any(is_told), "{warnings:?}");
}

/// Exit code 1 and clear words, and nothing written.
#[test]
fn what_cannot_be_compared_is_refused() {
    let (folder, good) = folder("compare-refused", 20.0);
    let refused = |change: &dyn Fn(&mut LightCurve)| {
        let mut curve = good.clone();
        change(&mut curve);
        write(&folder.path("measured.ecsv"), &curve);
        folder.refused(1, &[&COMPARE[..], &["-o", "x.html"]].concat())
    };
    let message = refused(&|c| c.kind = RateKind::Linear);
    assert!(message.contains("its rates are linear, expected calibrated"), "{message}");
    assert!(message.contains("sunglint apply"), "{message}");
    let message = refused(&|c| c.kind = RateKind::Predicted);
    assert!(message.contains("a simulation is no measurement"), "{message}");
    let message = refused(&|c| {
        c.samples.time.iter_mut().for_each(|t| *t += 1.0 * hifitime::Unit::Day);
    });
    for part in ["2008-09-22T18:45:00", "2008-09-21T18:45:00", "18:52:", "do not meet"] {
        assert!(message.contains(part), "{part}: {message}");
    }
    let message = refused(&|c| c.channels[0].name = "ultraviolet".into());
    assert!(message.contains("`ultraviolet` is none of the station ufo"), "{message}");
    assert!(message.contains("spcm") && message.contains("--channel"), "{message}");
    let message = refused(&|c| {
        c.channels.iter_mut().for_each(|c| c.flags.fill(Flags::SATURATED | Flags::CROWDED));
    });
    assert!(message.contains("no sample is left") && message.contains("22 saturated"), "{message}");
    let message = refused(&|c| c.channels.truncate(0));
    assert!(message.contains("no sample is left"), "{message}");
    assert!(!folder.path("x.html").exists());
    write(&folder.path("measured.ecsv"), &good);
    let message = folder.refused(1, &[&COMPARE[..], &["--channel", "nir"]].concat());
    assert!(message.contains("no channel `nir`: it has r, g, b"), "{message}");
    folder.refused(2, &[&COMPARE[..], &["-o", "x.pdf"]].concat());
    folder.refused(1, &["simulate", "pass.toml", "-o", "x.html"]);
    // One channel of several without a sample is a warning; so is a part outside the scene's times.
    let mut curve = good.clone();
    curve.channels[1].flags.fill(Flags::OVERFLOW);
    write(&folder.path("measured.ecsv"), &curve);
    let output = folder.run(&[&COMPARE[..], &["-o", "y.html"]].concat());
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("g: nothing to compare, 22 left out"), "{said}");
    let scene = std::fs::read_to_string(folder.path("pass.toml")).unwrap();
    let shorter = scene.replace("to = 2008-09-21T18:52:00Z", "to = 2008-09-21T18:50:00Z");
    std::fs::write(folder.path("pass.toml"), shorter).unwrap();
    let output = folder.run(&COMPARE);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("of 22 rows lie outside the times of the scene"), "{said}");
}

/// Truth: the magnitudes are the simulated ones plus half a magnitude.
#[test]
fn magnitudes_are_compared_as_they_are_said_to_be() {
    let folder = Folder::new("compare-magnitudes");
    std::fs::write(folder.path("pass.toml"), SPHERE_PASS).unwrap();
    folder.done(&["simulate", "pass.toml", "-o", "out/", "-q"]);
    let geometry = ecsv::read(folder.path("out/pass_geometry.ecsv")).unwrap();
    let times = geometry.text("time_utc").unwrap();
    for (kind, column) in [
        ("apparent", "v_mag"),
        ("ground", "v_ground_mag"),
        ("1000km", "v_1000km_mag"),
        ("standard", "v_standard_mag"),
    ] {
        let v = geometry.f64(column).unwrap();
        let mut csv = "# made up\ntime_utc,v,error,note\n".to_owned();
        for (time, v) in times.iter().zip(v.iter()).filter(|(_, v)| v.is_finite()) {
            writeln!(csv, "{},{},0.05,x", time.as_deref().unwrap(), v + 0.5).unwrap();
        }
        std::fs::write(folder.path("m.csv"), csv).unwrap();
        let compare = ["compare", "m.csv", "pass.toml", "--column", "v", "--as", kind, "--json"];
        let json = folder.json(&[&compare[..], &["--sigma-column", "error"]].concat());
        let n = &json["channels"][0]["numbers"];
        let number = |key: &str| n[key].as_f64().unwrap();
        assert!((number("mean_mag") - 0.5).abs() < 1e-5, "{n}");
        assert!(number("scatter_mag") < 1e-5 && (number("rms_mag") - 0.5).abs() < 1e-5);
        // 0.05 mag are 4.6 % of the light: the table's noise is that.
        assert!((number("noise") - 0.05 * 0.4 * 10_f64.ln()).abs() < 1e-6, "{n}");
        assert!(n["chi2"]["data"].as_f64().unwrap() < 1e-6);
        // Half a magnitude is ten times its uncertainty.
        assert!((n["chi2"]["unscaled"].as_f64().unwrap() / 100.0 - 1.0).abs() < 1e-3);
    }
    folder.done(&["compare", "m.csv", "pass.toml", "--column", "v", "-o", "m.html", "-o", "m.svg"]);
    assert!(std::fs::read_to_string(folder.path("m.svg")).unwrap().contains("measured"));
    // `v` is a name that others use, and is found; another is not.
    folder.done(&["compare", "m.csv", "pass.toml"]);
    let named = std::fs::read_to_string(folder.path("m.csv")).unwrap().replace(",v,", ",seen,");
    std::fs::write(folder.path("seen.csv"), named).unwrap();
    let message = folder.refused(1, &["compare", "seen.csv", "pass.toml"]);
    assert!(
        message.contains("magnitude") && message.contains("time_utc, seen, error"),
        "{message}"
    );
}

/// Rows as others have them: words for no magnitude, several objects, other filters, uncertainties of 0. Truth: the simulated magnitudes plus half a magnitude, which is what is left.
#[test]
fn rows_that_are_no_magnitudes_of_the_target_do_not_count() {
    let folder = Folder::new("compare-rows");
    std::fs::write(folder.path("pass.toml"), SPHERE_PASS).unwrap();
    folder.done(&["simulate", "pass.toml", "-o", "out/", "-q"]);
    let geometry = ecsv::read(folder.path("out/pass_geometry.ecsv")).unwrap();
    let times = geometry.text("time_utc").unwrap();
    let v = geometry.f64("v_mag").unwrap();
    let mut csv = "# synthetic\ntime_utc,object,filter,magnitude,sigma_mag\n".to_owned();
    for (i, (time, v)) in times.iter().zip(v.iter()).filter(|(_, v)| v.is_finite()).enumerate() {
        let time = time.as_deref().unwrap();
        let sigma = if i % 10 == 3 { 0.0 } else { 0.05 };
        writeln!(csv, "{time},A,V,{},{sigma}", if i % 10 == 7 { 99.999 } else { v + 0.5 }).unwrap();
        writeln!(csv, "{time},A,B,{},0.05", v + 3.0).unwrap();
        writeln!(csv, "{time},B,V,{},0.05", v - 3.0).unwrap();
    }
    std::fs::write(folder.path("m.csv"), csv).unwrap();
    let said = folder.refused(1, &["compare", "m.csv", "pass.toml"]);
    assert!(said.contains("2 objects") && said.contains("--object"), "{said}");
    let output = folder.run(&["compare", "m.csv", "pass.toml", "--object", "A", "--json"]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("other filters than V are left out") && said.contains("`B`"), "{said}");
    assert!(said.contains("have no uncertainty above 0"), "{said}");
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    let numbers = &json["channels"][0]["numbers"];
    let number = |key: &str| numbers[key].as_f64().unwrap();
    assert!((number("mean_mag") - 0.5).abs() < 1e-5 && number("scatter_mag") < 1e-5, "{numbers}");
    assert!((number("scale") - 10_f64.powf(-0.2)).abs() < 1e-5, "{numbers}");
    let said = folder.refused(1, &["compare", "m.csv", "pass.toml", "--sigma-column", "error"]);
    assert!(said.contains("expected a column `error` of uncertainties"), "{said}");
}

/// Truth: Chromium: the page draws its charts, switches a channel, zooms, reads values, is no wider than its window, has no error and asks nothing of any network.
/// Six channels of 6,000 samples take less than 2 MB.
#[test]
fn the_page_works_in_a_browser() {
    let (folder, curve) = folder("compare-page", 0.07);
    assert!(curve.len() >= 6000, "{}", curve.len());
    folder.done(&[&COMPARE[..], &["-o", "page.html", "-q"]].concat());
    let page = folder.path("page.html");
    let size = std::fs::metadata(&page).unwrap().len();
    assert!(size < 2_000_000, "{size} bytes");
    let programs = ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"];
    let test = "the_page_works_in_a_browser";
    let Some(browser) = programs.iter().find(|p| Path::new(p).exists()) else {
        return skip(test, "no Chromium");
    };
    let script = repository().join("tests/peers/browser.py");
    let output = Command::new("python3")
        .args([&script, Path::new(browser), Path::new("check"), &page])
        .output();
    let output = output.unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    println!("{size} bytes, {found}");
    assert_eq!((&found["errors"], &found["asked"]), (&json!([]), &json!([])));
    assert_eq!(found["canvases"], 4);
    let read = found["read"].as_str().unwrap();
    assert!(
        read.contains("2008-09-21 18:4") && read.contains("spcm") && read.contains('±'),
        "{read}"
    );
    assert!(read.contains("phase angle"), "{read}");
    assert_eq!(found["checked"], false);
    let without = found["read_without"].as_str().unwrap();
    assert!(without.contains("spcm") && !without.contains("\u{a0}r "), "{without}");
    let ink = |key: &str| found[key].as_f64().unwrap();
    assert!(ink("ink") > 0.0 && ink("ink_without") < ink("ink"), "{found}");
    assert!(ink("ink_zoomed") != ink("ink_without"));
    assert!(found["off"].as_u64().unwrap() >= 3, "{found}");
    for done in ["zoomed", "moved", "whole_again"] {
        assert_eq!(found[done], true, "{done}: {found}");
    }
    assert!(found["width"].as_i64().unwrap() <= 0, "wider than the window: {found}");
}

/// One row of the geometry table of the two tracks.
struct Row {
    utc: String,
    range_km: f64,
    phase_deg: f64,
}

/// Two tracks of ONEWEB-0165 with a made-up box and panels in nadir attitude beside what MMT-9 measured. Truth: the geometry table beside the
/// measurements, which was propagated from elements by another program: range within 0.5 km and phase within 0.3°, as its own header says. The
/// residuals are printed, and nothing is claimed of them.
#[test]
fn oneweb_0165_beside_its_measurements() {
    let files = (shared("real/oneweb_0165_geometry.csv"), shared("real/oneweb_0165_mmt9.txt"));
    let (Some(geometry), Some(measured)) = files else {
        return skip("oneweb_0165_beside_its_measurements", "no shared/real beside the checkout");
    };
    let geometry = std::fs::read_to_string(geometry).unwrap();
    let measured = std::fs::read_to_string(measured).unwrap();
    let lines = |text: &str| -> Vec<Vec<String>> {
        let rows = text.lines().filter(|l| !l.starts_with('#') && !l.starts_with("utc"));
        rows.map(|l| l.split([',', ' ']).map(str::to_owned).collect()).collect()
    };
    let (places, magnitudes) = (lines(&geometry), lines(&measured));
    assert_eq!(places.len(), magnitudes.len());
    let folder = Folder::new("compare-oneweb");
    for (number, day) in [(1, "2024-02-28"), (2, "2024-04-30")] {
        let samples: Vec<usize> =
            (0..places.len()).filter(|i| places[*i][0].starts_with(day)).collect();
        // Every hundredth position and the last: they are rounded to 0.1 m. Light leaves the target before the first of them, and an exposure reaches beyond the
        // last, so that the samples begin with the second and end with the last but one.
        let mut ephemeris = "time_utc,x_km,y_km,z_km\n".to_owned();
        for (k, i) in samples.iter().enumerate() {
            if k % 100 == 0 || k + 1 == samples.len() {
                let p = &places[*i];
                writeln!(ephemeris, "{},{},{},{}", p[0], p[1], p[2], p[3]).unwrap();
            }
        }
        let mut curve = "time_utc,standard_magnitude,magnitude\n".to_owned();
        let mut rows = Vec::new();
        for i in &samples[1..samples.len() - 1] {
            let m = &magnitudes[*i];
            writeln!(curve, "{}T{},{},{}", m[0], m[1], m[2], m[3]).unwrap();
            let number = |column: usize| places[*i][column].parse::<f64>().unwrap();
            rows.push(Row {
                utc: places[*i][0].clone(),
                range_km: number(9),
                phase_deg: number(10),
            });
        }
        std::fs::write(folder.path("positions.csv"), ephemeris).unwrap();
        std::fs::write(folder.path("magnitudes.csv"), curve).unwrap();
        let pass = format!(
            "name = \"track{number}\"\n[target]\nbuilt_in = \"box_with_panels\"\n[ephemeris]\nfile = \"positions.csv\"\n[attitude]\nlaw = \"orbit\"\n\
             [station]\nfolder = \"{}\"\n[times]\nfile = \"magnitudes.csv\"\nexposure_s = 0.1\n",
            fixture("passes/mmt9").display()
        );
        std::fs::write(folder.path("pass.toml"), pass).unwrap();
        let text = folder.done(&["compare", "magnitudes.csv", "pass.toml", "-o", "out/"]);
        println!("{text}");
        assert!(text.contains("measured less simulated"), "{text}");
        let out = |name: &str| folder.path("out").join(format!("track{number}_compared{name}"));
        let table = ecsv::read(out(".ecsv")).unwrap();
        let (range, phase) = (table.f64("range_m").unwrap(), table.f64("phase_deg").unwrap());
        assert_eq!(range.len(), rows.len());
        for (i, row) in rows.iter().enumerate() {
            assert!((range[i] * 1e-3 - row.range_km).abs() < 0.5, "{}: {}", row.utc, range[i]);
            assert!((phase[i] - row.phase_deg).abs() < 0.3, "{}: {}", row.utc, phase[i]);
        }
        let Values::F64(v) = &table.column("magnitude_simulated_mag").unwrap().values else {
            panic!("numbers")
        };
        assert!(v.iter().all(|m| m.is_finite()), "a lit satellite has a magnitude");
        assert!(out(".png").exists() && out(".html").exists());
    }
}

/// The Sun's azimuth and altitude (radians) by the low-precision formulae of the Astronomical Almanac (page C5: 0.01°), at a site in degrees; days of UT from 2000-01-01 12h.
fn almanac_sun(days: f64, latitude_deg: f64, longitude_deg: f64) -> (f64, f64) {
    let g = (357.528 + 0.985_600_3 * days).to_radians();
    let l = (280.460 + 0.985_647_4 * days + 1.915 * g.sin() + 0.020 * (2.0 * g).sin()).to_radians();
    let e = (23.439 - 4e-7 * days).to_radians();
    let (ra, dec) = ((e.cos() * l.sin()).atan2(l.cos()), (e.sin() * l.sin()).asin());
    let sidereal = (280.460_618_37 + 360.985_647_366_29 * days + longitude_deg).to_radians();
    let (h, phi) = (sidereal - ra, latitude_deg.to_radians());
    let altitude = (phi.sin() * dec.sin() + phi.cos() * dec.cos() * h.cos()).asin();
    let azimuth =
        (-h.sin() * dec.cos()).atan2(dec.sin() * phi.cos() - dec.cos() * phi.sin() * h.cos());
    (azimuth, altitude)
}

/// Single magnitudes of many spheres, as another program would have them. Truth: van de Hulst's closed form of the diffuse sphere at the phase angle that the almanac's Sun makes; the
/// scatter that is left must be the almanac's 0.01° (2e-4 mag) and the magnitudes' last digit (3e-4 mag). The zero point is the Sun's V, -26.76 ± 0.02 (Willmer 2018; Torres 2010).
#[test]
fn single_magnitudes_of_many_bodies() {
    let folder = Folder::new("compare-single");
    let scene = "[target]\nsphere = { radius_m = 1.0, reflectance = 0.5 }\n[station]\nname = \"ufo\"\n\
                 [effects]\nearthshine = \"off\"\nmoonshine = \"off\"\n[times]\ntable = \"obs.csv\"\n";
    std::fs::write(folder.path("pass.toml"), scene).unwrap();
    let (latitude, longitude): (f64, f64) = (48.0, 9.0);
    let mut rows = Vec::new();
    for i in 0..400_usize {
        let days = 7_700.0 + (i / 2) as f64 * 1.37;
        let (sun_az, sun_alt) = almanac_sun(days, latitude, longitude);
        if !(-0.30..-0.1).contains(&sun_alt) {
            continue;
        }
        // Two bodies in each moment, on the Sun's side, high enough to stand in its light.
        let azimuth = sun_az + 0.9 * chance(i);
        let (altitude, range_km) = (0.9 + 0.2 * chance(i + 7), 2_000.0 + 300.0 * chance(i + 3));
        let to_sun = [sun_alt.cos() * sun_az.cos(), sun_alt.cos() * sun_az.sin(), sun_alt.sin()];
        let seen = [altitude.cos() * azimuth.cos(), altitude.cos() * azimuth.sin(), altitude.sin()];
        let cosine: f64 = -to_sun.iter().zip(seen).map(|(a, b)| a * b).sum::<f64>();
        let phase = cosine.acos();
        let lit = phase.sin() + (std::f64::consts::PI - phase) * phase.cos();
        let intensity = 0.5 * 2.0 / (3.0 * std::f64::consts::PI) * lit;
        let au = 1.000_14 - 0.016_71 * (357.528 + 0.985_600_3 * days).to_radians().cos();
        let magnitude = -26.76 - 2.5 * (intensity / (1e3 * range_km * au).powi(2)).log10();
        rows.push(format!(
            "{:.9},{:.6},{:.6},{range_km:.6},{latitude},{longitude},300,S{i},{magnitude:.3}",
            2_451_545.0 + days,
            azimuth.to_degrees(),
            altitude.to_degrees()
        ));
    }
    assert!(rows.len() > 40, "{}", rows.len());
    let header = "# synthetic\njd_utc,azimuth_deg,altitude_deg,range_km,site_lat_deg,site_lon_deg,site_height_m,object,magnitude";
    let with = |rows: &[String]| {
        std::fs::write(folder.path("obs.csv"), format!("{header}\n{}\n", rows.join("\n"))).unwrap();
        folder.json(&["compare", "obs.csv", "pass.toml", "--json"])
    };
    let found = with(&rows);
    let numbers = &found["channels"][0]["numbers"];
    let number = |key: &str| numbers[key].as_f64().unwrap_or_else(|| panic!("{key}: {numbers:#}"));
    assert!(number("scatter_mag") < 1.5e-3, "{numbers:#}");
    assert!(number("mean_mag").abs() < 0.03, "{numbers:#}");
    // Any order of the rows is the same table.
    rows.reverse();
    assert_eq!(with(&rows)["channels"], found["channels"]);
    // A measurement at another moment has no place.
    let odd = "# synthetic\njd_utc,magnitude\n2459300.5,5.0\n";
    std::fs::write(folder.path("odd.csv"), odd).unwrap();
    let said = folder.refused(1, &["compare", "odd.csv", "pass.toml"]);
    assert!(said.contains("no row within 1 ms"), "{said}");
    // The fit takes it too: V's scale is the reflectance.
    let fit = folder.json(&[
        "fit",
        "obs.csv",
        "pass.toml",
        "--free",
        "albedo",
        "--sigma-mag",
        "0.01",
        "--json",
    ]);
    let found = &fit["fit"]["parameters"][0];
    assert!(found["name"].as_str().is_some_and(|n| n.ends_with(".V")), "{found:#}");
    let albedo = found["value"].as_f64().unwrap();
    assert!((albedo / 0.5 - 1.0).abs() < 0.03, "{found:#}");
}
