//! `sunglint air` as a person asks it: that the text answers the question, what is refused and how, and that threads change nothing.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use sunglint_radiometry::air::{Air, Sampling, Zenith};
use sunglint_radiometry::station::Station;

/// The numbers after a label, of the first line that begins with it after a heading.
fn numbers_after(text: &str, heading: &str, label: &str) -> Vec<f64> {
    let rest = &text[text.find(heading).unwrap_or_else(|| panic!("no {heading}: {text}"))..];
    let line = rest.lines().find_map(|l| l.trim_start().strip_prefix(label));
    let line = line.unwrap_or_else(|| panic!("no {label}: {text}"));
    line.split_whitespace().map(|n| n.parse().unwrap()).collect()
}

/// Truth: the library asked for the same means.
#[test]
fn the_text_shows_the_wavelengths_that_were_asked_for() {
    let folder = Folder::new("air-text");
    let ask = |more: &[&str]| {
        folder.done(&[&["air", "--station", "ufo", "-z", "0,60"][..], more].concat())
    };
    let air = Air::new(&Station::built_in("ufo").unwrap().unwrap().air_options().unwrap()).unwrap();
    let text = ask(&["--from-nm", "560", "--to-nm", "600", "--step-nm", "20", "--components"]);
    assert_eq!(
        numbers_after(&text, "transmission (mean over 20 nm)", "zenith angle"),
        [560.0, 580.0, 600.0]
    );
    let means = Sampling::means(&[560.0, 580.0, 600.0], 10.0).unwrap();
    let truth = air.components(Zenith::True(60.0), &means).unwrap();
    let near = |shown: &[f64], truth: &[f64], tolerance: f64| {
        assert_eq!(shown.len(), truth.len());
        for (a, b) in shown.iter().zip(truth) {
            assert!((a - b).abs() < tolerance, "{shown:?}, {truth:?}");
        }
    };
    near(&numbers_after(&text, "transmission (mean", "60° true"), &truth.total, 6e-5);
    let of_60 = &text[text.find("60° true").unwrap()..];
    near(&numbers_after(of_60, "60° true", "ozone"), &truth.ozone, 6e-5);
    let magnitudes: Vec<f64> = truth.total.iter().map(|t| -2.5 * t.log10()).collect();
    near(
        &numbers_after(&text, "extinction of the total, magnitudes", "60° true"),
        &magnitudes,
        6e-4,
    );

    // More than a line holds: from the first to the last, evenly, and that is said.
    let text = ask(&["--from-nm", "400", "--to-nm", "500", "--points"]);
    let shown = numbers_after(
        &text,
        "transmission (value at the wavelength; 12 of the 101 wavelengths",
        "zenith angle",
    );
    assert_eq!((shown.len(), shown[0], shown[11]), (12, 400.0, 500.0));
    assert!(shown.windows(2).all(|p| (8.0..=10.0).contains(&(p[1] - p[0]))), "{shown:?}");
    let values = air.transmission(Zenith::True(0.0), &Sampling::points(&shown).unwrap()).unwrap();
    near(&numbers_after(&text, "transmission (value", "0° true"), &values, 6e-5);

    // What the model leaves out is said where it matters, and that the air is clean where it is.
    assert!(!text.contains("O2-O2") && text.contains("clean air (no aerosol)"), "{text}");
    let text = ask(&["--aerosol", "0.1,1.3"]);
    assert!(text.contains("O2-O2") && !text.contains("clean air"), "{text}");
    assert!(text.contains("aerosol τ(550 nm) 0.100, exponent 1.3"), "{text}");
    assert!(ask(&["--from-nm", "1000", "--to-nm", "1045"]).contains("O2-O2"));
}

/// Truth: trapezoids of 0.01 nm over the same curves; 1e-5 is their own error.
#[test]
fn channels_see_the_mean_over_their_sensitivity() {
    let folder = Folder::new("air-channels");
    let json = folder.json(&["air", "--station", "ufo", "-z", "60", "--json"]);
    let station = Station::built_in("ufo").unwrap().unwrap();
    let air = Air::new(&station.air_options().unwrap()).unwrap();
    let curve = air.spectrum(Zenith::True(60.0), (295.0, 1250.0)).unwrap();
    let rows = json["zenith"][0]["channels_for_flat_photons"].as_array().unwrap();
    assert_eq!(rows.len(), 6);
    for (row, channel) in rows.iter().zip(&station.channels) {
        assert_eq!(row["channel"], channel.name.as_str());
        let (mut through, mut all) = (0.0, 0.0);
        for i in 0..95_000 {
            let nm = 295.0 + 0.01 * (f64::from(i) + 0.5);
            let sensitivity = channel.sensitivity_at(nm);
            through += sensitivity * curve.at(nm);
            all += sensitivity;
        }
        let transmission = row["transmission"].as_f64().unwrap();
        assert!((transmission / (through / all) - 1.0).abs() < 1e-5, "{row}");
        let magnitudes = row["extinction_mag"].as_f64().unwrap();
        assert!((10_f64.powf(-0.4 * magnitudes) - transmission).abs() < 1e-6, "{row}");
    }
}

#[test]
fn the_document_names_the_aerosol_and_holds_no_noise() {
    let folder = Folder::new("air-json");
    let ask = |aerosol: &str| {
        folder.json(&[
            "air",
            "--station",
            "ufo",
            "-z",
            "0",
            "--step-nm",
            "100",
            "--aerosol",
            aerosol,
            "--json",
        ])
    };
    let json = ask("0.1,1.3");
    let aerosol = &json["aerosol"];
    assert_eq!(aerosol["model"], "angstrom");
    assert_eq!(aerosol["exponent"], 1.3);
    assert_eq!(aerosol["optical_depth_550_nm"], 0.1);
    // Exactly: 330 ppm, an air mass of 1 at the zenith.
    assert_eq!(json["columns"]["co2_ppm"], 330.0);
    assert_eq!(json["zenith"][0]["airmass"]["rayleigh"], 1.0);
    assert_eq!(ask("rural_23km")["aerosol"]["model"], "rural_23km");
    assert_eq!(ask("none")["aerosol"]["model"], "none");
}

#[test]
fn requests_are_checked_before_the_work_and_in_the_words_of_the_request() {
    let folder = Folder::new("air-refused");
    for (wrong, expected) in [
        (&["--from-nm", "100"][..], &["--from-nm 100 nm", "294.618 to 1249.500 nm"][..]),
        (&["--from-nm", "0.55"], &["--from-nm 0.55 nm", "micrometres?"]),
        (&["--to-nm", "1250"], &["--to-nm 1250 nm", "1249.500", "half a step", "--points"]),
        (&["--to-nm", "1251", "--points"], &["--to-nm 1251 nm", "294.118 to 1250.000 nm"]),
        (&["--from-nm", "-5"], &["--from-nm -5 nm"]),
        (&["--to-nm", "-5"], &["--to-nm -5 nm"]),
        (&["--from-nm", "600", "--to-nm", "500"], &["--from-nm 600 is above --to-nm 500"]),
        (&["--step-nm", "-1"], &["--step-nm -1: expected more than 0"]),
        (&["--step-nm", "2000"], &["--step-nm 2000", "955.882"]),
        (&["--from-nm", "nan"], &["--from-nm NaN"]),
        (&["--pressure-hpa", "-1"], &["pressure_hpa = -1", "0.1 to 1200"]),
        (&["--water-mm", "-1"], &["water_mm = -1", "0 to 150"]),
        (&["--co2-ppm", "-1"], &["co2_ppm = -1", "0 to 10 000"]),
        (&["--aerosol", "-0.1,1.3"], &["optical_depth = -0.1", "0 to 10"]),
        (&["--zenith", "30,30"], &["--zenith names 30° twice"]),
        // 1880001 wavelengths at 3 angles with the total and seven constituents: 4.5e7 values, which would be gigabytes.
        (
            &["--step-nm", "0.0005", "--zenith", "0,30,60", "--components"],
            &["1880001 wavelengths at 3 zenith angles", "4.512e7", "2e7", "larger --step-nm"],
        ),
        (&["--step-nm", "1e-300"], &["larger --step-nm"]),
    ] {
        let message = folder.refused(1, &[&["air", "--station", "ufo"][..], wrong].concat());
        for part in expected {
            assert!(message.contains(part), "{wrong:?}: no `{part}` in {message}");
        }
    }
    // Where only the step is given, the ends leave room for it: 294.118 and 1250 nm and half a step.
    let ends = |step: &str| {
        let json =
            folder.json(&["air", "--station", "ufo", "-z", "0", "--json", "--step-nm", step]);
        let nm: Vec<f64> = serde_json::from_value(json["wavelength_nm"].clone()).unwrap();
        (nm[0], nm[nm.len() - 1], nm.len())
    };
    assert_eq!(ends("0.5"), (300.0, 1240.0, 1881));
    assert_eq!(ends("20"), (305.0, 1225.0, 47));
    assert_eq!(ends("100"), (345.0, 1145.0, 9));
    assert_eq!(ends("955").2, 1);
    // The ends themselves can be had.
    for ends in [
        &["--from-nm", "294.618", "--to-nm", "1249.5"][..],
        &["--from-nm", "294.118", "--to-nm", "1250", "--points"],
        &["--from-nm", "550", "--to-nm", "550"],
        &["--from-nm", "772.05", "--to-nm", "772.06", "--step-nm", "955"],
    ] {
        let json =
            folder.json(&[&["air", "--station", "ufo", "-z", "0", "--json"][..], ends].concat());
        let last = json["wavelength_nm"].as_array().unwrap().last().unwrap().as_f64().unwrap();
        let asked: f64 = ends[3].parse().unwrap();
        assert!((asked - last).abs() < 1.0, "{ends:?}: {last}");
    }
}

#[test]
fn what_is_likely_in_another_unit_is_warned_of() {
    let folder = Folder::new("air-warned");
    let warning = |more: &[&str]| {
        let output = folder.run(&[&["air", "--station", "ufo", "-z", "0"][..], more].concat());
        assert_eq!(output.status.code(), Some(0), "{more:?}");
        String::from_utf8(output.stderr).unwrap()
    };
    assert_eq!(warning(&[]), "");
    let (inches, atm_cm) = (warning(&["--pressure-hpa", "29.9"]), warning(&["--ozone-du", "0.3"]));
    assert!(
        inches.contains("warning") && inches.contains("29.9") && inches.contains("mercury"),
        "{inches}"
    );
    assert!(atm_cm.contains("warning") && atm_cm.contains("multiply by 1000"), "{atm_cm}");
    assert!(warning(&["--aerosol", "0.1,5"]).contains("exponent of 5"));
    let high = ["--altitude-m", "2400", "--profile", "us_standard", "--pressure-hpa"];
    let on_a_mountain = |hpa: &str| {
        let output = folder.run(&[&["air", "-z", "0"][..], &high[..], &[hpa]].concat());
        String::from_utf8(output.stderr).unwrap()
    };
    assert!(on_a_mountain("1013").contains("sea level"));
    assert_eq!(on_a_mountain("757"), "");
    for fine in [
        &["--pressure-hpa", "975"][..],
        &["--ozone-du", "280"],
        &["--ozone-du", "0"],
        &["--aerosol", "0.1,-0.2"],
    ] {
        assert_eq!(warning(fine), "", "{fine:?}");
    }
    // More on demand, and nothing but errors with -q.
    let more = warning(&["-v"]);
    assert!(more.contains("station: ufo") && more.contains("midlatitude_winter"), "{more}");
    assert!(more.contains("941 wavelengths"), "{more}");
    assert_eq!(warning(&["-q", "--ozone-du", "0.3"]), "");
}

/// Truth: one thread.
#[test]
fn results_do_not_depend_on_the_threads() {
    let folder = Folder::new("air-threads");
    let zenith = (0..60).map(|z| z.to_string()).collect::<Vec<_>>().join(",");
    let with = |threads: &str, format: &[&str]| {
        let air = ["air", "--station", "ufo", "--components", "-z", &zenith, "--threads", threads];
        folder.done(&[&air[..], format].concat())
    };
    for format in [&["-o", "-"][..], &["--json"], &[]] {
        assert!(with("1", format) == with("4", format), "{format:?}");
    }
    // Nor does the error.
    let refused = |threads: &str| {
        folder.refused(1, &["air", "--station", "ufo", "-z", "0,91,92,93", "--threads", threads])
    };
    assert!(refused("1").contains("91"));
    assert_eq!(refused("1"), refused("4"));
    let told = folder.run(&["air", "--station", "ufo", "-z", "0", "-v", "--threads", "3"]);
    assert!(String::from_utf8_lossy(&told.stderr).contains("3 threads"));
}
