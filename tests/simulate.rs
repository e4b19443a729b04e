//! `sunglint simulate`, run as a person runs it.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod common;

use common::{Folder, SPHERE_PASS};
use std::fmt::Write as _;
use sunglint_formats::{Table, Values, ecsv};
use sunglint_radiometry::light_curve::{LightCurve, RateKind, SpectralLightCurve};
use sunglint_testkit::{fixture, shared, skip};

fn folder(name: &str) -> Folder {
    let folder = Folder::new(name);
    std::fs::write(folder.path("pass.toml"), SPHERE_PASS).unwrap();
    folder
}

/// Truth: what is written is read back by the schema's own readers, with as many samples as the times have.
#[test]
fn a_folder_gets_curve_geometry_spectra_and_figures() {
    let folder = folder("simulate-folder");
    let text = folder.done(&["simulate", "pass.toml", "-o", "out/"]);
    for part in
        ["object 25544 as sphere of 0.5 m from ufo", "V (Vega = 0.03)", "spcm", "not modelled"]
    {
        assert!(text.contains(part), "`{part}` is not in {text}");
    }
    let table =
        ecsv::read_str("c", &std::fs::read_to_string(folder.path("out/pass.ecsv")).unwrap());
    let curve = LightCurve::from_table("c", &table.unwrap()).unwrap();
    assert_eq!((curve.kind, curve.len(), curve.channels.len()), (RateKind::Predicted, 22, 6));
    assert_eq!(curve.provenance.inputs[0].file, "pass.toml");
    let fits = std::fs::read(folder.path("out/pass_spectra.fits")).unwrap();
    let spectra = SpectralLightCurve::from_fits("s", fits).unwrap();
    assert_eq!((spectra.values.dim(), spectra.unit.as_str()), ((22, 188), "W / (sr nm)"));
    let geometry = std::fs::read_to_string(folder.path("out/pass_geometry.ecsv")).unwrap();
    let geometry = ecsv::read_str("g", &geometry).unwrap();
    let length = |i: usize| {
        let axis = |a: &str| geometry.f64(&format!("sun_body_{a}")).unwrap()[i];
        axis("x").hypot(axis("y")).hypot(axis("z"))
    };
    assert!((0..22).all(|i| (length(i) - 1.0).abs() < 1e-12));
    for figure in ["pass.png", "pass.svg", "pass_spectra.png", "pass_spectra.svg"] {
        assert!(
            std::fs::metadata(folder.path("out").join(figure)).unwrap().len() > 5000,
            "{figure}"
        );
    }
    let svg = std::fs::read_to_string(folder.path("out/pass.svg")).unwrap();
    for words in ["below the horizon", "phase angle", "magnitude above the air"] {
        assert!(svg.contains(words), "{words}");
    }
    // Nothing is overwritten unless that is asked for.
    let message = folder.refused(1, &["simulate", "pass.toml", "-o", "out/"]);
    assert!(message.contains("is there already"), "{message}");
}

#[test]
fn each_extension_holds_what_it_says() {
    let folder = folder("simulate-extensions");
    folder.done(&["simulate", "pass.toml", "-o", "s.fits", "-o", "c.csv", "-o", "f.svg", "-q"]);
    let fits = std::fs::read(folder.path("s.fits")).unwrap();
    assert!(SpectralLightCurve::from_fits("s.fits", fits).is_ok());
    let csv = std::fs::read_to_string(folder.path("c.csv")).unwrap();
    assert!(csv.starts_with("time_utc,exposure_s,r_rate_hz"), "{}", &csv[..80]);
    let stdout = folder.done(&["simulate", "pass.toml", "-o", "-"]);
    assert!(LightCurve::from_table("-", &ecsv::read_str("-", &stdout).unwrap()).is_ok());
}

#[test]
fn options_take_the_place_of_the_file() {
    let folder = folder("simulate-options");
    let json = folder.json(&[
        "simulate",
        "pass.toml",
        "--json",
        "--from",
        "2008-09-21T18:48:00",
        "--to",
        "2008-09-21T18:48:10",
        "--step-s",
        "2",
    ]);
    assert_eq!((&json["epochs"], &json["bins"]), (&6.into(), &188.into()));
    assert_eq!(json["from_utc"], "2008-09-21T18:48:00.0Z");
    let site = fixture("passes/mmt9");
    let json =
        folder.json(&["simulate", "pass.toml", "--json", "--station", site.to_str().unwrap()]);
    assert_eq!(json["station"]["name"], "mmt9");
    assert_eq!(json["channels"].as_array().unwrap().len(), 1);
    // Without a station anywhere.
    std::fs::write(
        folder.path("none.toml"),
        SPHERE_PASS.replace("[station]\nname = \"ufo\"\n", ""),
    )
    .unwrap();
    let message = folder.refused(1, &["simulate", "none.toml"]);
    assert!(message.contains("no station") && message.contains("none.toml"), "{message}");
    folder.done(&["simulate", "none.toml", "--station", "ufo"]);
}

/// Truth: the bytes.
#[test]
fn results_do_not_depend_on_the_threads() {
    let folder = folder("simulate-threads");
    for threads in ["1", "2"] {
        let out = format!("{threads}/");
        folder.done(&["simulate", "pass.toml", "--threads", threads, "-o", &out, "-q"]);
    }
    for file in ["pass.ecsv", "pass_geometry.ecsv", "pass_spectra.fits", "pass.svg"] {
        let read = |threads: &str| std::fs::read(folder.path(threads).join(file)).unwrap();
        assert!(read("1") == read("2"), "{file}");
    }
}

/// Exit codes: 1 for what a file holds, 2 for how the program was called; warnings where the answer stands.
#[test]
fn what_goes_wrong_is_said() {
    let folder = folder("simulate-wrong");
    let write = |name: &str, text: String| std::fs::write(folder.path(name), text).unwrap();
    let stderr = |arguments: &[&str]| {
        let output = folder.run(arguments);
        assert_eq!(output.status.code(), Some(0), "{arguments:?}");
        String::from_utf8(output.stderr).unwrap()
    };
    let message = folder.refused(1, &["simulate", "gone.toml"]);
    assert!(message.contains("gone.toml"), "{message}");
    write("key.toml", SPHERE_PASS.replace("step_s", "step_ms"));
    let message = folder.refused(1, &["simulate", "key.toml"]);
    assert!(
        message.contains("key.toml:14: times.step_ms") && message.contains("`step_s`"),
        "{message}"
    );
    write("material.toml", SPHERE_PASS.replace("white", "whit"));
    let message = folder.refused(1, &["simulate", "material.toml"]);
    assert!(message.contains("did you mean \"white\"?"), "{message}");
    write("tle.toml", SPHERE_PASS.replace("2927", "2926"));
    let message = folder.refused(1, &["simulate", "tle.toml"]);
    assert!(message.contains("checksum"), "{message}");
    folder.refused(2, &["simulate", "pass.toml", "-o", "x.jpg"]);
    folder.refused(2, &["simulate", "pass.toml", "--step-s", "-1"]);
    folder.refused(2, &["simulate", "pass.toml", "--beside-column", "m"]);
    write("late.toml", SPHERE_PASS.replace("2008-09-21", "2009-09-21"));
    assert!(stderr(&["simulate", "late.toml"]).contains("days old"));
    write("hidden.toml", SPHERE_PASS.replace("T18:45", "T19:25").replace("T18:52", "T19:32"));
    let message = stderr(&["simulate", "hidden.toml"]);
    assert!(
        message.contains("never above the horizon") && message.contains("at its highest"),
        "{message}"
    );
    write("dark.toml", SPHERE_PASS.replace("T18:45", "T20:22").replace("T18:52", "T20:26"));
    let message = stderr(&["simulate", "dark.toml"]);
    assert!(message.contains("shadow all the time"), "{message}");
    let message = folder.refused(1, &["simulate", "dark.toml", "-o", "dark.png"]);
    assert!(message.contains("no light to draw"), "{message}");
    write(
        "sunless.toml",
        SPHERE_PASS.replace("\"white\" }", "\"white\" }\nbuilt_in = \"box_wing\""),
    );
    assert!(folder.refused(1, &["simulate", "sunless.toml"]).contains("target.built_in"));
    write(
        "body.toml",
        SPHERE_PASS.replace(
            "sphere = { radius_m = 0.5, material = \"white\" }",
            "built_in = \"box_wing\"",
        ),
    );
    assert!(stderr(&["simulate", "body.toml"]).contains("no [attitude] is given"));
}

/// A measured curve beside: residuals by hand for a curve that is the simulated one plus half a magnitude.
#[test]
fn residuals_are_measured_less_simulated() {
    let folder = folder("simulate-beside");
    folder.done(&["simulate", "pass.toml", "-o", "out/", "-q"]);
    let text = std::fs::read_to_string(folder.path("out/pass_geometry.ecsv")).unwrap();
    let geometry = ecsv::read_str("g", &text).unwrap();
    let (times, v) = (geometry.text("time_utc").unwrap(), geometry.f64("v_mag").unwrap());
    let mut csv = "# made up\ntime_utc,v,note\n".to_owned();
    for (time, v) in times.iter().zip(v.iter()) {
        writeln!(csv, "{},{},x", time.as_deref().unwrap(), v + 0.5).unwrap();
    }
    std::fs::write(folder.path("m.csv"), csv).unwrap();
    let json = folder.json(&[
        "simulate",
        "pass.toml",
        "--json",
        "--beside",
        "m.csv",
        "--beside-column",
        "v",
        "-o",
        "f.svg",
    ]);
    let found = &json["beside"]["residuals"][0];
    assert!((found["mean_mag"].as_f64().unwrap() - 0.5).abs() < 1e-12, "{found}");
    assert!(found["scatter_mag"].as_f64().unwrap() < 1e-12);
    assert!(std::fs::read_to_string(folder.path("f.svg")).unwrap().contains("measured"));
    let message = folder.refused(1, &["simulate", "pass.toml", "--beside", "m.csv"]);
    assert!(message.contains("magnitude") && message.contains("time_utc, v, note"), "{message}");
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
    let folder = Folder::new("simulate-oneweb");
    for (number, day) in [(1, "2024-02-28"), (2, "2024-04-30")] {
        let samples: Vec<usize> =
            (0..places.len()).filter(|i| places[*i][0].starts_with(day)).collect();
        // Every hundredth position and the last: they are rounded to 0.1 m. Light leaves the target before the first of them, so that the
        // samples begin with the second.
        let mut ephemeris = "time_utc,x_km,y_km,z_km\n".to_owned();
        for (k, i) in samples.iter().enumerate() {
            if k % 100 == 0 || k + 1 == samples.len() {
                let p = &places[*i];
                writeln!(ephemeris, "{},{},{},{}", p[0], p[1], p[2], p[3]).unwrap();
            }
        }
        let mut curve = "time_utc,standard_magnitude,magnitude\n".to_owned();
        let mut rows = Vec::new();
        for i in &samples[1..] {
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
        let text =
            folder.done(&["simulate", "pass.toml", "--beside", "magnitudes.csv", "-o", "out/"]);
        println!("{text}");
        assert!(text.contains("measured less simulated"), "{text}");
        let out = |name: &str| folder.path("out").join(format!("track{number}{name}"));
        let table: Table =
            ecsv::read_str("g", &std::fs::read_to_string(out("_geometry.ecsv")).unwrap()).unwrap();
        let (range, phase) = (table.f64("range_m").unwrap(), table.f64("phase_deg").unwrap());
        assert_eq!(range.len(), rows.len());
        for (i, row) in rows.iter().enumerate() {
            assert!((range[i] * 1e-3 - row.range_km).abs() < 0.5, "{}: {}", row.utc, range[i]);
            assert!((phase[i] - row.phase_deg).abs() < 0.3, "{}: {}", row.utc, phase[i]);
        }
        let Values::F64(v) = &table.column("v_mag").unwrap().values else { panic!("numbers") };
        assert!(v.iter().all(|m| m.is_finite()), "a lit satellite has a magnitude");
        assert!(out(".png").exists() && out("_spectra.png").exists());
    }
}
