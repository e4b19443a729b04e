//! `sunglint apply` against hand-worked numbers and synphot: a station above the air with a rectangular channel, κ = 1, and light whose rate, irradiance and
//! magnitude are known.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use serde_json::{Value, json};

/// 0.5 m across, efficiency 0.5 from 500 to 600 nm, 99 km high: no air is left (transmission 1 to 1e-4).
const STATION: &str = r#"
name = "box"
[site]
latitude_deg = 48.78
longitude_deg = 9.2
height_m = 99000.0
[telescope]
primary_diameter_m = 0.5
obstruction_diameter_m = 0.0
focal_length_m = 3.0
mount = "equatorial"
[air]
profile = "us_standard"
[[channel]]
name = "g"
efficiency = "box.csv"
[channel.counter]
dead_time_model = "none"
saturation_hz = 1e30
dark_rate_hz = 0.0
"#;
const BOX: &str = "wavelength_nm,efficiency\n499.99,0\n500,0.5\n600,0.5\n600.01,0\n";

/// Light by synphot 1.8.0 (`tests/peers/synphot_light.py`) on the Sun of ASTM G173 at 1 au and on CALSPEC's Vega: rate in the channel, Johnson V with Vega = 0.03,
/// AB magnitude, mean over V in W m⁻² nm⁻¹.
struct Light {
    rate_hz: f64,
    v_mag: f64,
    ab_mag: f64,
    irradiance: f64,
}
const SUN: Light = Light {
    rate_hz: 5.016_136_103_932_954e19,
    v_mag: -26.733_798_925_545_322,
    ab_mag: -26.762_077_161_675_126,
    irradiance: 1.837_355_458_787_178,
};
const VEGA: Light = Light {
    rate_hz: 978_776_824.516_214_4,
    v_mag: 0.03,
    ab_mag: 0.001_721_763_870_198_894_8,
    irradiance: 3.619_708_634_606_218e-11,
};

/// A calibration with κ = 1 on one night, as the program writes it.
fn calibration(folder: &Folder, night: &str, channel: &str, facts: Value) {
    let mut entry =
        json!({"night": night, "covariance_ln_kappa": {"channels": [channel], "values": [[1e-4]]}});
    entry.as_object_mut().unwrap().extend(facts.as_object().unwrap().clone());
    let names = [
        "kappa",
        "relative_sigma",
        "kappa_low",
        "kappa_high",
        "rms",
        "per_airmass",
        "per_airmass_sigma",
        "per_colour",
        "per_colour_sigma",
    ];
    let mut text = "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: night, datatype: string}\n# - {name: channel, datatype: string}\n\
                    # - {name: stars, datatype: int64}\n# - {name: visits, datatype: int64}\n".to_owned();
    text += &names.map(|n| format!("# - {{name: {n}, datatype: float64}}\n")).concat();
    let meta = json!({"calibration_version": 1, "station": "box", "air": "none", "confidence": 0.95, "nights": [entry]});
    text += &format!(
        "# meta: {meta}\n# schema: astropy-2.0\nnight channel stars visits {}\n",
        names.join(" ")
    );
    text += &format!("{night} {channel} 9 9 1.0 0.01 0.98 1.02 0.01 nan nan nan nan\n");
    std::fs::write(folder.path("k.ecsv"), text).unwrap();
}

/// A linear curve: each sample its rate, flags, zenith angle, and range and phase angle where they are asked for.
fn curve(folder: &Folder, samples: &[(f64, u32, f64, f64, f64)], with_range: bool) {
    let mut text = "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: time_utc, datatype: string}\n# - {name: exposure_s, datatype: float64}\n\
                    # - {name: g_rate_hz, datatype: float64}\n# - {name: g_sigma_hz, datatype: float64}\n# - {name: g_flags, datatype: int64}\n".to_owned();
    let more: &[&str] =
        if with_range { &["zenith_deg", "range_m", "phase_deg"] } else { &["zenith_deg"] };
    text +=
        &more.iter().map(|n| format!("# - {{name: {n}, datatype: float64}}\n")).collect::<String>();
    let meta = json!({"quantity": "linear", "flag_bits": {"saturated": 0, "gap": 1}, "target": {"name": "ball", "kind": "satellite"}});
    text += &format!(
        "# meta: {meta}\n# schema: astropy-2.0\ntime_utc exposure_s g_rate_hz g_sigma_hz g_flags {}\n",
        more.join(" ")
    );
    for (i, (rate, flags, zenith, range, phase)) in samples.iter().enumerate() {
        text += &format!("2020-11-18T18:00:{i:02} 1.0 {rate:e} {:e} {flags} {zenith}", 0.01 * rate);
        text += &if with_range { format!(" {range} {phase}\n") } else { "\n".to_owned() };
    }
    std::fs::write(folder.path("c.ecsv"), text).unwrap();
}

fn station(name: &str) -> Folder {
    let folder = Folder::new(name);
    std::fs::write(folder.path("station.toml"), STATION).unwrap();
    std::fs::write(folder.path("box.csv"), BOX).unwrap();
    calibration(&folder, "2020-11-18", "g", json!({}));
    folder
}

fn applied(folder: &Folder, more: &[&str]) -> Value {
    folder.json(&[&["apply", "k.ecsv", "c.ecsv", "--json"], more].concat())["photometry"].clone()
}

/// Smallest and largest.
fn range(photometry: &Value, key: &str) -> (f64, f64) {
    let pair = &photometry["channels"][0][key];
    (pair[0].as_f64().unwrap(), pair[1].as_f64().unwrap())
}

fn near(found: f64, truth: f64, tolerance: f64) {
    assert!((found - truth).abs() < tolerance, "{found}, expected {truth}");
}

/// Truth: synphot 1.8.0 and a sphere worked by hand: radius 0.5 m, albedo 0.8, E = E_sun · 2/3 · ρ r²/R² · (sin γ + (π − γ) cos γ)/π (Lambert's sphere), at
/// 650, 1,000 and 1,800 km and at phase angles of 50°, 90° and 120°. Its standard magnitude is the same everywhere by its own law:
/// −26.7338 − 2.5 lg(0.8 · 2/3 · 0.25/(π · 10¹²)) = 6.6967; by the illuminated fraction it is off by 2.5 lg((1 + cos γ)/(sin γ + (π − γ) cos γ)).
/// Tolerance: 2e-4 mag, for the last of the air and the slopes of the rectangle; the Sun's V besides within 0.04 of Willmer's −26.76 (2018), as
/// well as solar spectra agree.
#[test]
fn a_diffuse_sphere_has_its_magnitudes() {
    let folder = station("apply-sphere");
    let law = |gamma: f64| gamma.sin() + (std::f64::consts::PI - gamma) * gamma.cos();
    let share = |range_m: f64, deg: f64| {
        0.8 * 2.0 / 3.0 * 0.25 / range_m.powi(2) * law(deg.to_radians()) / std::f64::consts::PI
    };
    let places = [(650e3, 50.0, 0.0), (1e6, 90.0, 45.0), (1.8e6, 120.0, 70.0)];
    let samples = places.map(|(r, g, z)| (SUN.rate_hz * share(r, g), 0, z, r, g));
    curve(&folder, &samples, true);
    near(SUN.v_mag, -26.76, 0.04);
    let found = applied(&folder, &["--magnitudes", "V"]);
    let magnitude = |(r, g, _)| SUN.v_mag - 2.5 * share(r, g).log10();
    let (brightest, faintest) = range(&found, "magnitude_range");
    near(brightest, magnitude(places[0]), 2e-4);
    near(faintest, magnitude(places[2]), 2e-4);
    let (least, most) = range(&found, "irradiance_range_w_m2_nm");
    near(least / (SUN.irradiance * share(1.8e6, 120.0)), 1.0, 2e-4);
    near(most / (SUN.irradiance * share(650e3, 50.0)), 1.0, 2e-4);
    for end in
        [range(&found, "standard_magnitude_range").0, range(&found, "standard_magnitude_range").1]
    {
        near(end, 6.696_7, 3e-4);
    }
    let other = applied(&folder, &["--magnitudes", "V", "--phase-law", "illuminated"]);
    let (low, high) = range(&other, "standard_magnitude_range");
    let by_other = |deg: f64| {
        let gamma = deg.to_radians();
        6.696_7 + 2.5 * ((1.0 + gamma.cos()) / law(gamma)).log10()
    };
    near(low, by_other(50.0).min(by_other(120.0)), 3e-4);
    near(high, by_other(50.0).max(by_other(120.0)).max(6.696_7), 3e-4);
    assert_eq!(other["phase_law"], "illuminated fraction");
    // By the other count of magnitudes: sunlight's V and AB differ by what synphot says.
    let ab = applied(&folder, &["--magnitudes", "V", "--zero-point", "ab"]);
    near(range(&ab, "magnitude_range").0 - brightest, SUN.ab_mag - SUN.v_mag, 2e-4);
}

/// Truth: Vega's rate by synphot gives Vega's V, 0.03, and mean irradiance over V by synphot back, by CALSPEC's spectrum as a file; 2e-4. A hundred times less
/// light is 5 mag fainter. A sample that is flagged, of any brightness, and one without a number go into no mean and no range; they stay in the table.
#[test]
fn a_star_of_known_magnitude() {
    let folder = station("apply-vega");
    folder.done(&["tables", "vega", "-q", "-o", "vega.csv"]);
    let rate = VEGA.rate_hz;
    let samples = [(rate, 0), (rate / 100.0, 0), (1e3 * rate, 1), (f64::NAN, 2)];
    curve(&folder, &samples.map(|(rate, flags)| (rate, flags, 30.0, 0.0, 0.0)), false);
    let more = ["--spectrum", "vega.csv", "--magnitudes", "V", "--photometry-out", "p.ecsv"];
    let found = applied(&folder, &more);
    let (bright, faint) = range(&found, "magnitude_range");
    near(bright, VEGA.v_mag, 2e-4);
    near(faint, VEGA.v_mag + 5.0, 2e-4);
    near(range(&found, "irradiance_range_w_m2_nm").1 / VEGA.irradiance, 1.0, 2e-4);
    assert_eq!(found["channels"][0]["standard_magnitude_range"], Value::Null);
    let written = std::fs::read_to_string(folder.path("p.ecsv")).unwrap();
    assert!(written.contains("g_flags") && !written.contains("standard_mag,"), "{written}");
    assert_eq!(written.lines().filter(|l| l.starts_with("2020")).count(), 4);
    let ab = applied(&folder, &[&more[..4], &["--zero-point", "ab"]].concat());
    near(range(&ab, "magnitude_range").0, VEGA.ab_mag, 2e-4);
    let all = folder.json(&["apply", "k.ecsv", "c.ecsv", "--json"]);
    let g = &all["channels"][0];
    assert_eq!((&g["samples"], &all["target"]), (&json!(2), &json!("ball")));
    near(g["mean_rate_hz"].as_f64().unwrap() / rate, 0.505, 1e-6);
    let text = folder.done(&["apply", "k.ecsv", "c.ecsv", "--magnitudes", "V"]);
    assert!(text.contains("no standard magnitudes: the curve has no range_m"), "{text}");
}

/// The same numbers of synphot as it is installed here.
#[test]
fn synphot_says_so_still() {
    let python = sunglint_testkit::peer_python("apply_synphot", &["synphot"]);
    let Some(python) = python else { return };
    let folder = Folder::new("apply-synphot");
    for table in ["sun", "vega", "johnson_ubv"] {
        folder.done(&["tables", table, "-q", "-o", &format!("{table}.csv")]);
    }
    let here = folder.0.to_str().unwrap();
    let answer =
        sunglint_testkit::run_python(&python, include_str!("peers/synphot_light.py"), &[here]);
    let answer: Value = serde_json::from_str(&answer).unwrap();
    for (name, light) in [("sun", SUN), ("vega", VEGA)] {
        let found = |key: &str| answer[name][key].as_f64().unwrap();
        near(found("rate_hz") / light.rate_hz, 1.0, 1e-6);
        near(found("v_mag"), light.v_mag, 1e-6);
        near(found("ab_mag"), light.ab_mag, 1e-6);
        near(found("irradiance") / light.irradiance, 1.0, 1e-6);
    }
}

/// A calibration that does not fit is warned of or refused, with 1, and nothing is overwritten.
#[test]
fn what_does_not_fit_is_said() {
    let folder = station("apply-refused");
    curve(&folder, &[(VEGA.rate_hz, 0, 30.0, 0.0, 0.0)], false);
    let warned = |more: &[&str]| {
        let found = folder.json(&[&["apply", "k.ecsv", "c.ecsv", "--json"], more].concat());
        found["warnings"].to_string()
    };
    // Another night's calibration.
    calibration(&folder, "2020-11-20", "g", json!({}));
    let other = folder.refused(1, &["apply", "k.ecsv", "c.ecsv", "-o", "out.ecsv"]);
    assert!(
        other.contains("no calibration of the night of 2020-11-18: the file has 2020-11-20"),
        "{other}"
    );
    assert!(!folder.path("out.ecsv").exists());
    assert!(warned(&["--night", "2020-11-20"]).contains("kappa of that of 2020-11-20"));
    // Another station's: its files and its name.
    calibration(&folder, "2020-11-18", "g", json!({}));
    assert!(warned(&[]).contains("station's files are not those of the calibration"));
    std::fs::create_dir(folder.path("other")).unwrap();
    std::fs::write(folder.path("other/station.toml"), STATION.replace("\"box\"", "\"hill\""))
        .unwrap();
    std::fs::write(folder.path("other/box.csv"), BOX).unwrap();
    let hill = warned(&["--station", "other"]);
    assert!(hill.contains("the calibration is of the station box, this is hill"), "{hill}");
    let air = warned(&["--magnitudes", "V"]);
    assert!(air.contains("kappa was found with the air `none`"), "{air}");
    // A channel that only the curve has.
    calibration(&folder, "2020-11-18", "red", json!({}));
    let none = folder.refused(1, &["apply", "k.ecsv", "c.ecsv"]);
    assert!(none.contains("none of the curve's channels: there are red, here g"), "{none}");
    calibration(&folder, "2020-11-18", "g", json!({}));
    // A file that is there, a number that is none, a band and a spectrum that are none, photometry of nothing.
    std::fs::write(folder.path("there.ecsv"), "mine").unwrap();
    for option in ["-o", "--photometry-out"] {
        let refused = ["apply", "k.ecsv", "c.ecsv", "--magnitudes", "V", option, "there.ecsv"];
        folder.refused(1, &refused);
        assert_eq!(std::fs::read_to_string(folder.path("there.ecsv")).unwrap(), "mine");
    }
    folder.refused(1, &["apply", "k.ecsv", "c.ecsv", "--magnitudes", "Q"]);
    let spectrum = folder.refused(1, &["apply", "k.ecsv", "c.ecsv", "--spectrum", "bright"]);
    assert!(spectrum.contains("neither `sun`, nor a file, nor a star's type"), "{spectrum}");
    let nothing = folder.refused(1, &["apply", "k.ecsv", "c.ecsv", "--photometry-out", "p.ecsv"]);
    assert!(nothing.contains("needs --magnitudes BAND or --spectrum"), "{nothing}");
    curve(&folder, &[(f64::NAN, 0, 30.0, 0.0, 0.0)], false);
    let nan = folder.refused(1, &["apply", "k.ecsv", "c.ecsv"]);
    assert!(nan.contains("g_rate_hz, row 1: found NaN"), "{nan}");
    // Two samples, both past saturation: no number is invented, and nobody takes the result for one.
    curve(&folder, &[(1e6, 1, 30.0, 0.0, 0.0), (2e6, 3, 31.0, 0.0, 0.0)], false);
    let flagged = folder.refused(1, &["apply", "k.ecsv", "c.ecsv", "--magnitudes", "V"]);
    assert!(
        flagged.contains("none of the 2 samples") && flagged.contains("2 saturated"),
        "{flagged}"
    );
}

/// Truth: Ångström's law and a plane air: light through a depth τ (550 nm, exponent 0: grey) at the zenith is e^−τ of that above: with the depth that was fitted
/// with κ the magnitude is 2.5 lg e · τ = 0.2171 brighter for τ = 0.2 than with none. The column above 99 km is stated, not integrated. 1e-3.
#[test]
fn an_aerosol_that_was_fitted_with_kappa_goes_with_it() {
    let folder = station("apply-aerosol");
    curve(&folder, &[(VEGA.rate_hz, 0, 0.0, 0.0, 0.0)], false);
    let clear = range(&applied(&folder, &["--magnitudes", "V"]), "magnitude_range").0;
    calibration(
        &folder,
        "2020-11-18",
        "g",
        json!({"aerosol_depth": [0.2, 0.01], "aerosol_exponent": 0.0}),
    );
    let hazy = range(&applied(&folder, &["--magnitudes", "V"]), "magnitude_range").0;
    near(clear - hazy, 0.217_147, 1e-3);
    let asked = applied(&folder, &["--magnitudes", "V", "--aerosol", "none"]);
    near(range(&asked, "magnitude_range").0, clear, 1e-9);
}

/// The station comes from the curve's header. Truth: by construction: the file that the header names with its sum, where it is still that; a built-in one by its name; a name that nobody knows is refused with what to do, and
/// --station goes before all of them.
#[test]
fn the_header_names_the_station() {
    let folder = station("apply-header");
    curve(&folder, &[(VEGA.rate_hz, 0, 30.0, 0.0, 0.0)], false);
    std::fs::create_dir(folder.path("site")).unwrap();
    for file in ["station.toml", "box.csv"] {
        std::fs::rename(folder.path(file), folder.path("site").join(file)).unwrap();
    }
    let none = folder.refused(1, &["apply", "k.ecsv", "c.ecsv"]);
    assert!(none.contains("no station"), "{none}");
    let text = std::fs::read_to_string(folder.path("c.ecsv")).unwrap();
    let named = |station: &str| {
        let sum = sunglint_formats::sha256(STATION.as_bytes());
        let origin =
            json!({"station": station, "inputs": [{"file": "site/station.toml", "sha256": sum}]});
        let head = text.replacen("# meta: {", &format!("# meta: {{\"provenance\": {origin}, "), 1);
        std::fs::write(folder.path("c.ecsv"), head).unwrap();
        let out = folder.run(&["apply", "k.ecsv", "c.ecsv", "-o", "-"]);
        (out.status.code(), String::from_utf8(out.stderr).unwrap())
    };
    let (code, said) = named("box");
    assert!(code == Some(0) && said.contains("station box, as the curve's header says"), "{said}");
    let (code, said) = named("nowhere");
    assert!(
        code == Some(1) && said.contains("names the station nowhere") && said.contains("--station"),
        "{said}"
    );
    let other = folder.run(&["apply", "k.ecsv", "c.ecsv", "--station", "site", "-o", "-"]);
    let said = String::from_utf8(other.stderr).unwrap();
    assert!(other.status.success() && !said.contains("header"), "{said}");
    // A predicted curve of a built-in station is unmixed without a word about it.
    let folder = Folder::new("unmix-header");
    std::fs::write(folder.path("pass.toml"), crate::common::SPHERE_PASS).unwrap();
    folder.done(&["simulate", "pass.toml", "-o", "p.ecsv", "-q"]);
    let out = folder.run(&["analyse", "unmix", "p.ecsv", "--endmembers", "white"]);
    let said = String::from_utf8(out.stderr).unwrap();
    assert!(
        out.status.success() && said.contains("station ufo, as the curve's header says"),
        "{said}"
    );
}
