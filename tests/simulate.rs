//! `sunglint simulate`, run as a person runs it.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::{Folder, SPHERE_PASS};
use sunglint_formats::ecsv;
use sunglint_radiometry::light_curve::{LightCurve, RateKind, SpectralLightCurve};
use sunglint_testkit::fixture;

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

/// Truth: closed form. A surface whose f is known to e^±δ in all directions makes light that is known as well: e^δ − 1; and two bodies apart of as much light, of which one alone says how well it is known, half of
/// that. Tolerance: 1 % (the doubt's own integral over a sphere).
#[test]
fn the_doubt_of_a_material_reaches_the_rates() {
    let folder = Folder::new("simulate-material-doubt");
    let material = |name: &str, doubt: &str| {
        format!(
            "[[target.material]]\nname = \"{name}\"\nmodel = \"composite\"\nreflectance = 1.0\ndiffuse = {{ reflectance = 0.5 }}\n{doubt}"
        )
    };
    let doubt = "[target.material.doubt]\npeak_ln = 0.2\nwings_ln = 0.2\ngrazing_ln = 0.2\n";
    let part = |name: &str, material: &str, z: f64| {
        format!(
            "[[target.part]]\nname = \"{name}\"\nshape = \"sphere\"\nradius_m = 0.5\nmaterial = \"{material}\"\noffset_m = [0, {z}, 0]\n"
        )
    };
    let rest = SPHERE_PASS.split_once("[orbit]").unwrap().1;
    let scene = |target: &str| format!("{target}[orbit]{rest}");
    let one = format!("{}{}", part("a", "known", 0.0), material("known", doubt));
    let two = format!(
        "{}{}{}{}",
        part("a", "known", 0.0),
        part("b", "other", 40.0),
        material("known", doubt),
        material("other", "")
    );
    for (name, target, share) in [("one", one, 1.0), ("two", two, 0.5)] {
        let file = format!("{name}.toml");
        std::fs::write(folder.path(&file), scene(&target)).unwrap();
        let json = folder.json(&["simulate", &file, "--json"]);
        let wanted = share * 0.2_f64.exp_m1();
        for key in ["median_relative", "largest_relative"] {
            let found = json["material_error"][key].as_f64().unwrap();
            assert!((found / wanted - 1.0).abs() < 0.01, "{name} {key}: {found} {wanted}");
        }
        let out = format!("{name}/");
        let text = folder.done(&["simulate", &file, "-o", &out]);
        assert!(text.contains("the doubt of known"), "{text}");
        let table = std::fs::read_to_string(folder.path(&format!("{name}/{name}_geometry.ecsv")));
        let table = ecsv::read_str("g", &table.unwrap()).unwrap();
        let relative = table.f64("material_relative").unwrap();
        assert!(relative.iter().any(|r| (r / wanted - 1.0).abs() < 0.01), "{relative:?}");
    }
    std::fs::write(folder.path("pass.toml"), SPHERE_PASS).unwrap();
    let json = folder.json(&["simulate", "pass.toml", "--json"]);
    assert!(json["material_error"]["median_relative"].is_null());
}

/// A scene of some hundred epochs in two tracks, of a body with bounces, a doubted material, and refractive indices that are not known.
fn long_scene(folder: &Folder) -> &'static str {
    let material = "[[target.material]]\nname = \"known\"\nmodel = \"composite\"\nreflectance = 1.0\ndiffuse = { reflectance = 0.5 }\n\
        [target.material.doubt]\npeak_ln = 0.2\nwings_ln = 0.2\ngrazing_ln = 0.2\n";
    let part = |name: &str, y: f64| {
        format!(
            "[[target.part]]\nname = \"{name}\"\nshape = \"box\"\nsize_m = [1, 2, 1]\nmaterial = \"known\"\noffset_m = [0, {y}, 0]\n"
        )
    };
    let (_, rest) = SPHERE_PASS.split_once("[orbit]").unwrap();
    let (rest, _) = rest.split_once("[times]").unwrap();
    let scene = format!(
        "{}{}{material}[orbit]{rest}[times]\nfile = \"times.csv\"\n[attitude]\nlaw = \"spin\"\naxis_body = [0, 0, 1]\naxis_gcrs = [0.3, 0.5, 0.8]\n\
         period_s = 60.0\nepoch_utc = 2008-09-21T18:46:00Z\n",
        part("a", 0.0),
        part("b", 2.5)
    );
    std::fs::write(folder.path("pass.toml"), scene).unwrap();
    let mut times = String::from("# synthetic\ntime_utc,exposure_s\n");
    for i in 0..310 {
        // Some with a fraction of a second, so that texts have different widths; a gap of four minutes.
        let (second, half) =
            (i + if i < 120 { 0 } else { 240 }, if i % 3 == 0 { ".5" } else { "" });
        let (minute, second) = (45 + second / 60, second % 60);
        times += &format!("2008-09-21T18:{minute}:{second:02}{half}Z,0.25\n");
    }
    std::fs::write(folder.path("times.csv"), times).unwrap();
    "pass.toml"
}

/// Truth: the pass in one piece. In pieces of seven epochs it gives every file byte by byte, the same text, and the same JSON, but for the costs.
#[test]
fn results_do_not_depend_on_the_pieces() {
    let folder = Folder::new("simulate-pieces");
    let scene = long_scene(&folder);
    let run = |name: &str, pieces: &str| {
        let (out, csv, fits, json) = (
            format!("{name}/"),
            format!("{name}.csv"),
            format!("{name}.fits"),
            format!("{name}.json"),
        );
        let files = ["-o", &out, "-o", &csv, "-o", &fits, "-o", &json];
        let arguments = ["simulate", scene, "--polarisation", "--piece-epochs", pieces];
        let text = folder.done(&[&arguments[..], &files[..]].concat());
        let table = folder.done(&["simulate", scene, "--piece-epochs", pieces, "-o", "-"]);
        let text: Vec<String> =
            text.lines().filter(|l| !l.starts_with("cost: ")).map(str::to_owned).collect();
        (text, table)
    };
    let (one, many) = (run("one", "310"), run("many", "7"));
    assert_eq!(one, many);
    assert!(one.0.iter().any(|l| l.contains("in 2 tracks")), "{one:?}");
    assert!(one.0.iter().any(|l| l.starts_with("material: the doubt of known")), "{one:?}");
    let read = |path: String| std::fs::read(folder.path(&path)).unwrap();
    let mut files = vec![".csv".to_owned(), ".fits".to_owned()];
    for part in ["pass.ecsv", "pass_geometry.ecsv", "pass_spectra.fits"] {
        files.push(format!("/{part}"));
    }
    for part in ["pass.png", "pass.svg", "pass_spectra.png", "pass_spectra.svg"] {
        files.push(format!("/{part}"));
    }
    for file in &files {
        let (one, many) = (read(format!("one{file}")), read(format!("many{file}")));
        assert!(one.len() > 5000 && one == many, "{file} differs");
    }
    assert_eq!(std::fs::read_dir(folder.path("many")).unwrap().count(), files.len() - 2);
    assert_eq!(one.1.as_bytes(), read("one/pass.ecsv".into()));
    let json = |name: &str| -> serde_json::Value {
        let mut json: serde_json::Value =
            serde_json::from_slice(&read(format!("{name}.json"))).unwrap();
        json.as_object_mut().unwrap().remove("cost").unwrap();
        json
    };
    assert_eq!(json("one"), json("many"));
}

/// Truth: the bound. Without pieces these 40,000 epochs took 600 MiB, of which the program itself has 75.
#[cfg(target_os = "linux")]
#[test]
fn memory_does_not_grow_with_the_epochs() {
    let folder = folder("simulate-memory");
    let scene = SPHERE_PASS.replace("step_s = 20", "step_s = 0.0105");
    std::fs::write(folder.path("pass.toml"), scene).unwrap();
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_sunglint"))
        .args(["simulate", "pass.toml", "-q", "-o", "rates.ecsv", "-o", "spectra.fits"])
        .args(["--threads", "2"])
        .current_dir(folder.path(""))
        .spawn()
        .unwrap();
    let status = format!("/proc/{}/status", child.id());
    let mut most_kib = 0;
    let ended = loop {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let peak = text.lines().find_map(|l| l.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB"));
        most_kib = most_kib.max(peak.and_then(|kib| kib.parse::<u64>().ok()).unwrap_or(0));
        if let Some(ended) = child.try_wait().unwrap() {
            break ended;
        }
        std::thread::sleep(std::time::Duration::from_millis(5));
    };
    assert!(ended.success());
    let rows = std::fs::read_to_string(folder.path("rates.ecsv")).unwrap();
    assert!(rows.lines().count() > 40_000);
    assert!((1..300 << 10).contains(&most_kib), "{most_kib} KiB");
}

/// Truth: a folder that a failed run made is not there afterwards, nor is any part of a file.
#[test]
fn nothing_is_left_of_a_simulation_that_fails() {
    let folder = folder("simulate-nothing-left");
    std::fs::create_dir(folder.path("there")).unwrap();
    std::fs::write(folder.path("there/pass_geometry.ecsv"), "mine").unwrap();
    let message = folder.refused(1, &["simulate", "pass.toml", "-o", "there/"]);
    assert!(message.contains("pass_geometry.ecsv is there already"), "{message}");
    assert_eq!(std::fs::read_dir(folder.path("there")).unwrap().count(), 1);
    // The second of two places takes no file.
    folder.refused(1, &["simulate", "pass.toml", "-o", "new/deep/", "-o", "/proc/pass.ecsv"]);
    assert!(!folder.path("new").exists());
    // Without light the picture is that of the geometry.
    let dark = SPHERE_PASS.replace("18:45:00", "19:35:00").replace("18:52:00", "19:42:00");
    std::fs::write(folder.path("dark.toml"), dark).unwrap();
    folder.done(&["simulate", "dark.toml", "-o", "dark.png"]);
    assert!(folder.path("dark.png").exists());
}
