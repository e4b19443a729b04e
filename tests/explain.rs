//! `sunglint explain` and `--tolerance`, run as a person runs them.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::{Folder, SPHERE_PASS};

fn folder(name: &str) -> Folder {
    let folder = Folder::new(name);
    std::fs::write(folder.path("pass.toml"), SPHERE_PASS).unwrap();
    folder
}

#[test]
fn every_effect_is_listed_with_its_reason() {
    let folder = folder("explain");
    let text = folder.done(&["explain", "pass.toml"]);
    for part in [
        "what it needs at a tolerance of 0.10 %",
        "one convex closed body",
        "no surface sees another",
        "solar disc",
        "earthshine",
        "finite distance",
        "22 epochs, 22 of them",
        "left out in all",
    ] {
        assert!(text.contains(part), "`{part}` is not in {text}");
    }
    // The short form heads the summary of a simulation; both say the same.
    let summary = folder.done(&["simulate", "pass.toml", "--tolerance", "0.2%"]);
    assert!(summary.contains("what the scene needs, at a tolerance of 0.20 %"), "{summary}");
    let [explained, simulated] =
        ["explain", "simulate"].map(|command| folder.json(&[command, "pass.toml", "--json"]));
    assert_eq!(explained["needs"], simulated["needs"]);
    assert_eq!(explained["course"]["epochs"], 22);
    assert_eq!(explained["scene"]["convex"], true);
    folder.done(&["explain", "pass.toml", "-o", "needs.ecsv", "-q"]);
    let table = std::fs::read_to_string(folder.path("needs.ecsv")).unwrap();
    assert!(table.contains("inter-reflection"), "{table}");
}

/// `0.2 %` is 0.002; what is none is usage, exit code 2.
#[test]
fn a_tolerance_is_a_share_or_a_percentage() {
    let folder = folder("explain-tolerance");
    for (text, value) in [("0.2%", 0.002), ("0.2 %", 0.002), ("0.002", 0.002), ("1e-6", 1e-6)] {
        let json = folder.json(&["explain", "pass.toml", "--json", "--tolerance", text]);
        assert_eq!(json["tolerance"].as_f64().unwrap(), value, "{text}");
    }
    for command in ["explain", "simulate"] {
        for wrong in ["0", "-1", "200%", "nan", "much", "1e-12"] {
            let message = folder.refused(2, &[command, "pass.toml", "--tolerance", wrong]);
            assert!(message.contains("--tolerance") && message.contains("0.2"), "{message}");
        }
    }
    // The option takes the place of the file's key.
    let text = format!("tolerance = 0.01\n{SPHERE_PASS}");
    std::fs::write(folder.path("coarse.toml"), text).unwrap();
    let read = |arguments: &[&str]| folder.json(arguments)["tolerance"].as_f64().unwrap();
    assert_eq!(read(&["explain", "coarse.toml", "--json"]), 0.01);
    assert_eq!(read(&["explain", "coarse.toml", "--json", "--tolerance", "1%"]), 0.01);
    assert_eq!(read(&["explain", "coarse.toml", "--json", "--tolerance", "0.3%"]), 0.003);
}

/// Truth: by hand: after a dose of twice the scale 0.4 + 0.6 e^(−2) = 0.4812 of a white sphere's light is left, 0.794 mag less in all bands; and the material is named with it. What makes no sense is refused with its
/// line. Tolerance: the digits that JSON has.
#[test]
fn an_aged_material_is_named_and_sends_less() {
    let folder = folder("explain-aged");
    let sphere = "[[target.part]]\nname = \"ball\"\nshape = \"sphere\"\nradius_m = 0.5\nmaterial = \"paint\"\n\
                  [[target.material]]\nname = \"paint\"\nmodel = \"lambert\"\nreflectance = 0.8\n";
    let new = SPHERE_PASS
        .replace("[target]\nsphere = { radius_m = 0.5, material = \"white\" }\n", "")
        + sphere;
    let ageing = "[target.material.ageing]\ndose = 6\nleft = [0.4]\nscale = [3]\n";
    std::fs::write(folder.path("new.toml"), &new).unwrap();
    std::fs::write(folder.path("old.toml"), format!("{new}{ageing}")).unwrap();
    let [new_light, old_light] = ["new.toml", "old.toml"].map(|pass| {
        let json = folder.json(&["simulate", pass, "--json"]);
        json["v_above_air"]["brightest_mag"].as_f64().unwrap_or(f64::NAN)
    });
    let fainter = -2.5 * (0.4 + 0.6 * (-2.0_f64).exp()).log10();
    assert!((old_light - new_light - fainter).abs() < 2e-4, "{old_light} {new_light}");
    let json = folder.json(&["explain", "old.toml", "--json"]);
    assert_eq!(json["aged"][0]["material"], "paint");
    let text = folder.done(&["explain", "old.toml"]);
    assert!(text.contains("aged by a dose of 6, which leaves 48.1 %"), "{text}");
    assert!(folder.json(&["explain", "new.toml", "--json"])["aged"].as_array().unwrap().is_empty());
    for (wrong, field) in [
        ("dose = -1\nleft = [0.4]\nscale = [3]\n", "ageing"),
        ("dose = 1\nleft = [0.4, 0.5]\nscale = [3]\n", "ageing.left"),
        ("dose = 1\nleft = [0.4]\nscale = [3]\nalpha = 0.3\nalpha_scale = 1\n", "ageing.alpha"),
    ] {
        let text = format!("{new}[target.material.ageing]\n{wrong}");
        std::fs::write(folder.path("wrong.toml"), text).unwrap();
        let message = folder.refused(1, &["explain", "wrong.toml"]);
        assert!(message.contains(field) && message.contains("wrong.toml:"), "{message}");
    }
}

/// Truth: the sum, and the numbers of the curve that is written.
#[test]
fn the_stated_error_is_in_every_output() {
    let folder = folder("explain-stated");
    let json = folder.json(&["simulate", "pass.toml", "--json", "-o", "out/"]);
    let of = |need: &serde_json::Value| need["bound"].as_f64().unwrap_or(0.0);
    let needs = json["needs"].as_array().unwrap();
    let sum: f64 = needs.iter().filter(|n| n["modelled"] == false).map(of).sum();
    let explained = folder.json(&["explain", "pass.toml", "--json"]);
    assert!((explained["left_out"].as_f64().unwrap() / sum - 1.0).abs() < 1e-8, "{sum}");
    let text = std::fs::read_to_string(folder.path("out/pass.ecsv")).unwrap();
    let table = sunglint_formats::ecsv::read_str("c", &text).unwrap();
    let (rate, error) = (table.f64("g_rate_hz").unwrap(), table.f64("g_model_error_hz").unwrap());
    let mut shares: Vec<f64> =
        rate.iter().zip(error.iter()).filter(|(r, _)| **r > 0.0).map(|(r, e)| e / r).collect();
    shares.sort_by(f64::total_cmp);
    let said = &json["channels"][1]["stated_error"];
    let largest = said["largest_relative"].as_f64().unwrap();
    assert!((largest / shares.last().unwrap() - 1.0).abs() < 1e-8, "{said} {shares:?}");
    assert!(said["median_relative"].as_f64().unwrap() <= largest);
    let geometry = std::fs::read_to_string(folder.path("out/pass_geometry.ecsv")).unwrap();
    assert!(geometry.contains("v_model_error_mag"));
    let fits = std::fs::read(folder.path("out/pass_spectra.fits")).unwrap();
    let spectra =
        sunglint_radiometry::light_curve::SpectralLightCurve::from_fits("s", fits).unwrap();
    assert_eq!(spectra.model_errors.unwrap().dim(), spectra.values.dim());
}

/// Truth: the page's own example, on the table that stands in `fixtures/earth` (18 × 36 cells, two wavelengths), and the table of the page itself: `explain`, the summary and the JSON say which Earth it is; the light of a sphere differs from that over an even Earth, and beyond the wavelengths of the page's table a channel is flagged.
#[test]
fn the_earth_of_the_guide() {
    let folder = folder("explain-earth");
    let example = crate::common::page_toml("pass.md", "file = \"albedo.csv\"");
    std::fs::write(folder.path("earth.toml"), format!("{SPHERE_PASS}{example}")).unwrap();
    let fixture = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/earth/synthetic_10deg.csv");
    std::fs::copy(fixture, folder.path("albedo.csv")).unwrap();
    let text = folder.done(&["explain", "earth.toml"]);
    for part in ["18 × 36 cells", "2 wavelengths from 300 to 1240 nm", "the ± 20 %"] {
        let flat = text.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(flat.contains(part), "`{part}` is not in {text}");
    }
    let summary = folder.done(&["simulate", "earth.toml"]);
    assert!(summary.contains("  earth      a Lambert globe with the albedos of"), "{summary}");
    let [even, table] = ["pass.toml", "earth.toml"]
        .map(|pass| folder.json(&["simulate", pass, "--json", "-o", "out/", "--force"]));
    assert_eq!((&table["earth"]["rows"], &table["earth"]["columns"]), (&18.into(), &36.into()));
    assert_eq!(
        (&table["earth"]["uncertainty"], &even["earth"]["uncertainty"]),
        (&0.2.into(), &0.5.into())
    );
    assert!(even["earth"]["description"].as_str().unwrap().contains("albedo 0.30"));
    // At dusk the lit Earth is low: of the first sample in sight it adds some 1e-3, of which the table changes a few hundredths.
    let faintest = |json: &serde_json::Value| json["v_above_air"]["faintest_mag"].as_f64().unwrap();
    let change = (faintest(&even) - faintest(&table)).abs();
    assert!(change > 1e-6 && change < 1e-3, "{change}");
    // The table of the page, of which most cells have no value; a channel beyond 650 nm is flagged.
    let page =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/pass.md")).unwrap();
    let block = page.split("```\n# synthetic\n").nth(1).unwrap().split("```").next().unwrap();
    std::fs::write(folder.path("albedo.csv"), block).unwrap();
    let short = folder.json(&["simulate", "earth.toml", "--json", "-o", "out/", "--force"]);
    assert_eq!(short["earth"]["wavelength_nm"], serde_json::json!([450.0, 650.0]));
    let warned = short["warnings"].as_array().unwrap().iter();
    assert!(
        warned.filter(|w| w.as_str().unwrap().contains("earth.missing")).count() == 1,
        "{short}"
    );
    let uncovered = |json: &serde_json::Value| {
        let channels = json["channels"].as_array().unwrap().iter();
        channels.map(|c| c["uncovered_nm"].as_f64().unwrap()).fold(0.0, f64::max)
    };
    assert!(uncovered(&short) > 100.0 && uncovered(&table) == uncovered(&even), "{short}");
    let wrong = format!("{SPHERE_PASS}[earth]\nfile = \"albedo.csv\"\n");
    std::fs::write(folder.path("holes.toml"), wrong).unwrap();
    let message = folder.refused(1, &["simulate", "holes.toml"]);
    assert!(message.contains("albedo.csv") && message.contains("missing = 0.3"), "{message}");
}
