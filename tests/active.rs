//! `sunglint simulate --active`, the whole program.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use std::f64::consts::PI;
use sunglint_formats::crd::{self, Record};
use sunglint_formats::ecsv;
use sunglint_formats::fits::Fits;

/// The space debris laser of the thesis, table A.1, above no air.
const PASS: &str = r#"
[target]
sphere = { radius_m = 0.5, reflectance = 0.4 }
[orbit]
lines = [
  "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
  "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
]
[station]
name = "ufo"
[times]
from = 2008-09-21T18:45:00Z
to = 2008-09-21T18:52:00Z
step_s = 20
[air]
none = true
"#;
const LASER: &str = r#"
[[laser]]
name = "debris"
wavelength_nm = 1064
linewidth_nm = 1
pulse_energy_mj = 140
pulse_length_ns = 7
repetition_rate_hz = 200
divergence_arcsec = 5
beam_radius_m = 0.06
receiver = "id400"
"#;

/// A curve of the built-in station at a wavelength, between its rows.
fn curve_at(file: &str, nm: f64) -> f64 {
    let path = format!("{}/radiometry/stations/ufo/{file}", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(path).unwrap();
    let rows: Vec<(f64, f64)> = text
        .lines()
        .filter_map(|l| l.split_once(','))
        .filter_map(|(x, y)| Some((x.parse().ok()?, y.parse().ok()?)))
        .collect();
    let after = rows.iter().position(|r| r.0 > nm).unwrap();
    let (a, b) = (rows[after - 1], rows[after]);
    a.1 + (nm - a.0) / (b.0 - a.0) * (b.1 - a.1)
}

/// Truth: closed form, written out: a diffuse sphere at phase angle 0 has W = 2ρR²/3, so n̄ = Q/(πw²) · W · Aηλ/(hc r²) with w = r tan(β/2) + R₀, A of 43 cm less
/// 20.86 cm, η of the station's curves by hand; detection 1 − e^(−n̄); the mean rate n̄ · 200 Hz (1e-6: the table's digits). The image of bins holds all of it.
#[test]
fn photons_of_a_sphere() {
    let folder = Folder::new("active-sphere");
    std::fs::write(folder.path("pass.toml"), format!("{PASS}{LASER}")).unwrap();
    folder.done(&[
        "simulate",
        "pass.toml",
        "--active",
        "-o",
        "a.ecsv",
        "-o",
        "a.fits",
        "-o",
        "a.png",
        "-q",
    ]);
    let text = std::fs::read_to_string(folder.path("a.ecsv")).unwrap();
    let table = ecsv::read_str("a.ecsv", &text).unwrap();
    let column = |name: &str| table.f64(name).unwrap().into_owned();
    let (photons, range_m) = (column("debris_photons_per_shot"), column("range_m"));
    let efficiency =
        curve_at("optics_id400.csv", 1064.0) * curve_at("efficiency_id400.csv", 1064.0);
    let area = PI / 4.0 * (0.43_f64.powi(2) - 0.2086_f64.powi(2));
    let mut visible = 0;
    for (i, found) in photons.iter().enumerate() {
        if found.is_nan() {
            continue;
        }
        visible += 1;
        let r = range_m[i];
        let w = r * (2.5_f64 / 3600.0).to_radians().tan() + 0.06;
        let returned = 0.140 / (PI * w * w) * (2.0 / 3.0 * 0.4 * 0.25) / (r * r);
        let n = returned * area * efficiency * 1064e-9 / (6.626_070_15e-34 * 299_792_458.0);
        assert!((found / n - 1.0).abs() < 1e-6, "{found} {n}");
        assert!(
            (column("debris_detection_probability")[i] / (1.0 - (-n).exp()) - 1.0).abs() < 1e-6
        );
        assert!((column("debris_rate_hz")[i] / (200.0 * n) - 1.0).abs() < 1e-6);
        assert!((column("debris_spot_radius_m")[i] / w - 1.0).abs() < 1e-9);
        // Of a Lambert sphere seen from where it is lit: R ∫ u · 3u² du = 3/4 R in front of its middle.
        assert!((column("debris_mean_offset_m")[i] + 0.375).abs() < 3e-3);
    }
    assert!(visible > 5, "{visible}");
    let fits = Fits::read(folder.path("a.fits")).unwrap();
    let image = fits.image(0).unwrap().pixels.to_f64();
    assert_eq!(image.shape(), [200, photons.len()]);
    for (i, n) in photons.iter().enumerate().filter(|(_, n)| n.is_finite()) {
        let sum: f64 = (0..200).map(|bin| image[[bin, i]]).sum();
        assert!((sum / n - 1.0).abs() < 1e-9);
    }
}

/// Truth: a laser 150 km to the north of the telescope. The triangle of the two and the target: its third side is the distance between the sites, by the ellipsoid's radius of
/// curvature along the meridian and the chord (2e-4; the ground moves by 4 m while light is on its way). With that angle a Lambert sphere's phase function, and ranges,
/// written out: n̄ = Q/(πw²) (2ρR²/3π)(sin γ + (π − γ) cos γ) · Aηλ/(hc r²) (1e-5: the digits of the table). A site that is the telescope's own gives what none gives (2e-5:
/// the ground moves by 4 m).
#[test]
fn a_laser_at_another_site() {
    let folder = Folder::new("active-apart");
    let site = |latitude: f64| {
        format!(
            "site = {{ latitude_deg = {latitude}, longitude_deg = 9.196416666666667, height_m = 399 }}\n"
        )
    };
    let run = |name: &str, more: &str| {
        std::fs::write(folder.path("pass.toml"), format!("{PASS}{LASER}{more}")).unwrap();
        folder.done(&["simulate", "pass.toml", "--active", "-o", name, "-q"]);
        ecsv::read_str(name, &std::fs::read_to_string(folder.path(name)).unwrap()).unwrap()
    };
    let beside = run("beside.ecsv", "");
    let own = run("own.ecsv", &site(48.78238888888889));
    let apart = run("apart.ecsv", &site(48.78238888888889 + 1.35));
    let column =
        |table: &sunglint_formats::Table, name: &str| table.f64(name).unwrap().into_owned();
    assert!(beside.f64("debris_apart_deg").is_err());
    let efficiency =
        curve_at("optics_id400.csv", 1064.0) * curve_at("efficiency_id400.csv", 1064.0);
    let area = PI / 4.0 * (0.43_f64.powi(2) - 0.2086_f64.powi(2));
    // WGS 84 at 49.457°: M = a (1 − e²)/(1 − e² sin²φ)^{3/2}.
    let (e2, sin) = (6.694_379_990_14e-3_f64, 49.4574_f64.to_radians().sin());
    let meridian = 6_378_137.0 * (1.0 - e2) / (1.0 - e2 * sin * sin).powf(1.5) + 399.0;
    let baseline = 2.0 * meridian * (0.5 * 1.35_f64.to_radians()).sin();
    let mut visible = 0;
    let photons = column(&apart, "debris_photons_per_shot");
    for (i, found) in photons.iter().enumerate().filter(|(_, n)| n.is_finite()) {
        visible += 1;
        let down = column(&apart, "range_m")[i];
        let spot = column(&apart, "debris_spot_radius_m")[i];
        let up = (spot - 0.06) / (2.5_f64 / 3600.0).to_radians().tan();
        let phase = column(&apart, "debris_apart_deg")[i].to_radians();
        let third = (up * up + down * down - 2.0 * up * down * phase.cos()).sqrt();
        assert!((third / baseline - 1.0).abs() < 2e-4, "{third} {baseline}");
        let w = 2.0 * 0.4 * 0.25 / (3.0 * PI) * (phase.sin() + (PI - phase) * phase.cos());
        let returned = 0.140 / (PI * spot * spot) * w / (down * down);
        let n = returned * area * efficiency * 1064e-9 / (6.626_070_15e-34 * 299_792_458.0);
        assert!((found / n - 1.0).abs() < 1e-5, "{found} {n}");
        let (a, b) = (
            column(&own, "debris_photons_per_shot")[i],
            column(&beside, "debris_photons_per_shot")[i],
        );
        assert!((a / b - 1.0).abs() < 2e-5, "{a} {b}");
    }
    assert!(visible > 5, "{visible}");
    std::fs::write(folder.path("pass.toml"), format!("{PASS}{LASER}{}", site(91.0))).unwrap();
    let message = folder.refused(1, &["simulate", "pass.toml", "--active"]);
    assert!(message.contains("latitude_deg"), "{message}");
}

/// Truth: by reasoning: walls at right angles send light to each other: the corner's photons are more than those that are scattered once, by as much as is said, and none where the effect is switched off.
#[test]
fn photons_that_are_scattered_twice_are_counted() {
    let folder = Folder::new("active-bounces");
    let scene =
        PASS.replace("sphere = { radius_m = 0.5, reflectance = 0.4 }", "built_in = \"corner\"");
    let run = |more: &str| {
        std::fs::write(folder.path("pass.toml"), format!("{scene}{more}{LASER}")).unwrap();
        let json = folder.json(&["simulate", "pass.toml", "--active", "--json"]);
        let laser = json["active"]["lasers"][0].clone();
        let best = |key: &str| laser["best"][key].as_f64().unwrap();
        let both = [best("photons_per_shot"), best("bounced_photons_per_shot")];
        (both, best("bounced_error"), laser["bounces"].clone())
    };
    let ([all, bounced], error, said) = run("");
    let ([once, none], zero, left) = run("[effects]\ninter_reflection = \"off\"\n");
    // The tolerance is of all photons, 0.1 %.
    assert!(bounced > 0.0 && error <= 7.01e-4 * all, "{all} {bounced} {error}");
    assert!(((all - bounced) / once - 1.0).abs() < 1e-9 && (none, zero) == (0.0, 0.0));
    assert_eq!((said["traced"].as_bool(), left["traced"].as_bool()), (Some(true), Some(false)));
    assert!(said["largest_share"].as_f64().unwrap() >= 0.99 * bounced / all, "{said}");
}

/// Truth: thesis fig. 3.5 as corrected, sunlight over laser light within a pulse: 1.6e-5 at 1,000 km and 2.0e-2 at 36,000 km, of 0.66 W m⁻² nm⁻¹ and air of 0.97. The table of
/// sunlight here has 0.65 and the standard air without aerosol 0.987: 6 %. Earthshine on a nadir facet at 550 km over the subsolar point is 0.252 of sunlight (the
/// thesis' D.1 with the Sun's angle at each point of the cap, by an independent integration): 2 %.
#[test]
fn sunlight_over_laser_light() {
    let folder = Folder::new("active-ratio");
    let pass = format!("{}{LASER}", PASS.replace("[air]\nnone = true\n", ""));
    std::fs::write(folder.path("pass.toml"), pass).unwrap();
    let json = folder.json(&["simulate", "pass.toml", "--active", "--json"]);
    let laser = &json["active"]["lasers"][0];
    let at = |km: f64, key: &str| {
        let rows = laser["by_altitude"].as_array().unwrap();
        rows.iter().find(|r| r["altitude_km"] == km).unwrap()[key].as_f64().unwrap()
    };
    assert!((at(1000.0, "sun_ratio") / 1.6e-5 - 1.0).abs() < 0.06, "{laser}");
    assert!((at(36_000.0, "sun_ratio") / 2.0e-2 - 1.0).abs() < 0.06, "{laser}");
    let earth = at(550.0, "earth_ratio") / at(550.0, "sun_ratio");
    assert!((earth / 0.252 - 1.0).abs() < 0.02, "{earth}");
    // The light curve is there beside it.
    assert!(json["channels"].as_array().is_some(), "{json}");
}

/// Truth: by hand: on the axis a Gaussian beam of the same 1/e² radius has twice a top hat's fluence; a sphere of 0.5 m in a spot of 9 m and more sees 1 % less at most.
#[test]
fn several_lasers_and_a_gaussian_beam() {
    let folder = Folder::new("active-several");
    let second = LASER
        .replace("debris", "other")
        .replace("beam_radius_m", "beam = \"gaussian\"\nbeam_radius_m");
    std::fs::write(folder.path("pass.toml"), format!("{PASS}{LASER}{second}")).unwrap();
    let json = folder.json(&["simulate", "pass.toml", "--active", "--json"]);
    let photons =
        |k: usize| json["active"]["lasers"][k]["best"]["photons_per_shot"].as_f64().unwrap();
    let ratio = photons(1) / photons(0);
    assert!(ratio < 2.0 && ratio > 1.98, "{ratio}");
    let one = folder.json(&["simulate", "pass.toml", "--active", "--laser", "other", "--json"]);
    assert_eq!(one["active"]["lasers"].as_array().unwrap().len(), 1);
    assert_eq!(one["active"]["lasers"][0]["laser"], "other");
}

#[test]
fn what_cannot_be_is_said() {
    let folder = Folder::new("active-errors");
    let write = |text: String| std::fs::write(folder.path("pass.toml"), text).unwrap();
    let refused = |says: &str, more: &[&str]| {
        let command = [&["simulate", "pass.toml", "--active"], more].concat();
        let message = folder.refused(1, &command);
        assert!(message.contains(says), "{says}: {message}");
    };
    write(PASS.into());
    refused("the station ufo has no laser: give [[laser]]", &[]);
    let message = folder.refused(2, &["simulate", "pass.toml", "--laser", "debris"]);
    assert!(message.contains("--active"), "{message}");
    write(format!("{PASS}{LASER}"));
    refused("did you mean debris?", &["--laser", "debri"]);
    write(format!("{PASS}{}", LASER.replace("id400", "id40")));
    refused("laser[0].receiver", &[]);
    write(format!("{PASS}{}", LASER.replace("id400", "b")));
    refused("counts nothing at 1064 nm", &[]);
    write(format!("{PASS}{LASER}{LASER}"));
    refused("a name that no other laser has", &[]);
    write(format!(
        "{PASS}{}",
        LASER.replace("1064", "99999").replace("receiver = \"id400\"\n", "")
    ));
    refused("no counter of ufo counts at 99999 nm", &[]);
    write(format!("{PASS}{}beam = \"flat\"\n", LASER));
    refused("top_hat", &[]);
    write(format!("{PASS}{}", LASER.replace("divergence_arcsec = 5", "divergence_arcsec = 5000")));
    refused("below 3600 arcsec", &[]);
}

/// The commands of docs/active.md run with the tables that it shows.
#[test]
fn the_commands_of_the_page_run() {
    let folder = Folder::new("active-page");
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/active.md");
    let page = std::fs::read_to_string(page).unwrap();
    std::fs::create_dir(folder.path("sunglint-demo")).unwrap();
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/rehearsal/demo/pass.toml");
    std::fs::copy(scene, folder.path("sunglint-demo/pass.toml")).unwrap();
    let laser = page.split("```").nth(1).unwrap().strip_prefix("toml").unwrap();
    let scene = folder.path("sunglint-demo/pass.toml");
    let text = std::fs::read_to_string(&scene).unwrap() + laser;
    // As fast as a test should be.
    std::fs::write(&scene, text.replace("step_s = 0.5", "step_s = 5.0")).unwrap();
    let cubes = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/thesis/lageos.toml");
    let mut tables = page.split("```").filter_map(|block| block.strip_prefix("toml\n"));
    let ranging = tables.find(|block| block.contains("[laser.ranging]")).unwrap();
    let cubes = std::fs::read_to_string(cubes).unwrap();
    std::fs::write(folder.path("lageos.toml"), format!("{cubes}\n{ranging}")).unwrap();
    for command in page.lines().filter_map(|l| l.strip_prefix("sunglint ")) {
        folder.done(&command.split(' ').collect::<Vec<_>>());
    }
    for name in ["box_wing_pass_active.ecsv", "box_wing_pass_ranging.fits", "box_wing_pass.ecsv"] {
        assert!(folder.path("returns").join(name).exists(), "{name}");
    }
    // Truth of LAGEOS: the ILRS list's 15 Mm² (20 %: this is one pass and no mean over attitudes), velocity aberration of 33.2 to 38.2 µrad, and a centre of mass 242 mm (single photons) to 251 mm (leading edge) behind the returns.
    let text = std::fs::read_to_string(folder.path("returns/lageos_active.ecsv")).unwrap();
    let table = ecsv::read_str("lageos_active.ecsv", &text).unwrap();
    let column = |name: &str| table.f64(name).unwrap().into_owned();
    let (offset, zenith) = (column("green_mean_offset_m"), column("zenith_deg"));
    let (sigma, urad) = (column("green_cross_section_m2"), column("green_aberration_urad"));
    let seen: Vec<usize> =
        (0..offset.len()).filter(|k| offset[*k].is_finite() && zenith[*k] < 79.0).collect();
    let mean = |of: &[f64]| seen.iter().map(|k| of[*k]).sum::<f64>() / seen.len() as f64;
    assert!(seen.len() > 10, "{}", seen.len());
    assert!((mean(&sigma) / 15e6 - 1.0).abs() < 0.2, "{}", mean(&sigma));
    assert!((-0.251..-0.242).contains(&mean(&offset)), "{}", mean(&offset));
    assert!(seen.iter().all(|k| (33.0..38.3).contains(&urad[*k])), "{urad:?}");
}

/// A station of the shop and a laser that delivers range data: pulses so strong that each shot returns, and so short that a return is where the body is.
const RANGING: &str = r#"
[[laser]]
name = "slr"
wavelength_nm = 1064
linewidth_nm = 1
pulse_energy_mj = 1e12
pulse_length_ns = 1e-3
repetition_rate_hz = 10
divergence_arcsec = 5
beam_radius_m = 0.06
receiver = "id400"
[laser.ranging]
station = "SHOP"
pad = 7839
system = 34
occupancy = 2
network = "TEST"
ilrs_id = 1234567
normal_point_s = 15
gate_ns = 10
"#;

/// Where the site of the built-in station is in the axes of the ITRS, m: WGS 84 (a = 6,378,137 m, 1/f = 298.257223563), written out.
fn site_itrs_m(latitude_deg: f64, longitude_deg: f64, height_m: f64) -> [f64; 3] {
    let (a, f) = (6_378_137.0, 1.0 / 298.257_223_563);
    let e2 = f * (2.0 - f);
    let ((s, c), (sl, cl)) =
        (latitude_deg.to_radians().sin_cos(), longitude_deg.to_radians().sin_cos());
    let n = a / (1.0 - e2 * s * s).sqrt();
    [(n + height_m) * c * cl, (n + height_m) * c * sl, (n * (1.0 - e2) + height_m) * s]
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Truth: a target that moves at 5 km/s along a straight line of the turning Earth, given as a CPF. Light meets it at t + τ/2 and is on its way for τ = 2ρ(t + τ/2)/c, ρ the distance from the
/// station (WGS 84, by hand): the Earth's rotation makes one way longer and the other as much shorter. What is left of it is (ωr/c)² of τ, (7e-7)² to (1e-5)²; τ is 0.01 s, and the targets' radius is 1 mm (7e-12 s): 2e-11 s.
/// Normal points: 30 s make two of 15 s, with nearly 150 returns each, whose trend is none.
#[test]
fn range_data_of_a_cpf() {
    let folder = Folder::new("active-crd");
    let site = site_itrs_m(48.782_388_888_888_89, 9.196_416_666_666_667, 399.0);
    let up = site.map(|x| x / distance(site, [0.0; 3]));
    // Across the vertical.
    let norm = up[0].hypot(up[1]);
    let east = [-up[1] / norm, up[0] / norm, 0.0];
    let place = |t: f64| -> [f64; 3] {
        std::array::from_fn(|i| site[i] + 1.5e6 * up[i] + 5e3 * (t - 300.0) * east[i])
    };
    // 2020-11-18 is MJD 59171; 0 s of `place` is 16:30:00 (59,400 s).
    let mut cpf = String::from(
        "H1 CPF 2 TST 2020 11 18 12 32301 1 straight none\nH2 1234567 1155 99999 2020 11 18 16 30 0 2020 11 18 16 40 0 10 1 1 0 0 0 1\nH9\n",
    );
    for k in 0..=60 {
        let [x, y, z] = place(10.0 * f64::from(k));
        cpf += &format!("10 0 59171 {}.000000 0 {x:.6} {y:.6} {z:.6}\n", 59_400 + 10 * k);
    }
    cpf += "99\n";
    std::fs::write(folder.path("straight.cpf"), cpf).unwrap();
    let scene = format!(
        "[target]\nsphere = {{ radius_m = 0.001, reflectance = 0.4 }}\n[ephemeris]\nfile = \"straight.cpf\"\n[station]\nname = \"ufo\"\n[times]\nfrom = 2020-11-18T16:34:00Z\nto = 2020-11-18T16:34:30Z\nstep_s = 5\n[air]\nnone = true\n{RANGING}"
    );
    std::fs::write(folder.path("pass.toml"), &scene).unwrap();
    let all =
        ["simulate", "pass.toml", "--active", "-o", "a.crd", "-o", "a.frd", "-o", "a.npt", "-q"];
    folder.done(&all);
    let read = |name: &str| crd::read(folder.path(name)).unwrap();
    let both = read("a.crd");
    let records: Vec<&Record> = both.lines.iter().map(|l| &l.record).collect();
    assert!(both.lines.iter().all(|l| l.rest.is_empty()));
    assert!(matches!(records[0], Record::Other(line) if line.starts_with("00 SIMULATED")));
    let station =
        records.iter().find_map(|r| if let Record::Station(s) = r { Some(s) } else { None });
    let station = station.unwrap();
    assert_eq!((station.name.as_str(), station.numbers), ("SHOP", [7839, 34, 2, 7]));
    let target =
        records.iter().find_map(|r| if let Record::Target(t) = r { Some(t) } else { None });
    assert_eq!(target.unwrap().numbers, [Some(1_234_567), None, None]);
    let sessions: Vec<_> = records
        .iter()
        .filter_map(|r| if let Record::Session(s) = r { Some(s) } else { None })
        .collect();
    assert_eq!((sessions.len(), sessions[0].data, sessions[1].data), (2, 0, 1));
    assert_eq!(sessions[0].from[..5], [2020, 11, 18, 16, 33]);
    assert_eq!(sessions[0].flags, [0, 1, 0, 0, 1, 0, 2, 0]);
    let shots: Vec<_> = records
        .iter()
        .filter_map(|r| if let Record::Shot(s) = r { Some(s) } else { None })
        .collect();
    assert!((298..=301).contains(&shots.len()), "{}", shots.len());
    let c = 299_792_458.0;
    let flight = |sent_s: f64| {
        let mut flight_s = 0.0;
        for _ in 0..6 {
            flight_s = 2.0 * distance(place(sent_s - 59_400.0 + 0.5 * flight_s), site) / c;
        }
        flight_s
    };
    let data: Vec<_> = shots.iter().filter(|s| s.flags[1] == 2).collect();
    assert!(data.len() > 290, "{}", data.len());
    for shot in &data {
        let apart = shot.flight_s - flight(shot.second_s);
        assert!(apart.abs() < 2e-11, "{apart:e} at {}", shot.second_s);
        assert_eq!((shot.flags[0], shot.configuration.as_str()), (2, "std"));
    }
    // Without the light's time on its way they would be 5 km/s × 2e-5 off in time: far more.
    let still = 2.0 * distance(place(data[0].second_s - 59_400.0), site) / c;
    assert!((data[0].flight_s - still).abs() > 1e-9);

    let points: Vec<_> = records
        .iter()
        .filter_map(|r| if let Record::NormalPoint(p) = r { Some(p) } else { None })
        .collect();
    // The first shot leaves 10 ms before 16:34, so that a bin of one may be in front.
    assert_eq!(points.len(), 2);
    for point in &points {
        let near = data.iter().find(|s| s.second_s == point.second_s).unwrap();
        assert!((near.flight_s - point.flight_s).abs() < 1e-11);
        assert!((140..=150).contains(&point.shots), "{}", point.shots);
        assert_eq!((point.bin_s, point.event), (Some(15.0), 2));
        // Of the body of 7 ps across and a pulse of 1 ps.
        assert!(point.statistics[0].unwrap() < 7.0);
        assert!((90.0..=100.0).contains(&point.statistics[4].unwrap()));
    }
    // The other files have their parts; the same seed gives the same bytes, another does not.
    let count = |name: &str| {
        let file = read(name);
        let of = |kind: fn(&Record) -> bool| file.lines.iter().filter(|l| kind(&l.record)).count();
        [of(|r| matches!(r, Record::Shot(_))), of(|r| matches!(r, Record::NormalPoint(_)))]
    };
    assert_eq!((count("a.frd"), count("a.npt")), ([shots.len(), 0], [0, 2]));
    folder.done(&["simulate", "pass.toml", "--active", "-o", "b.crd", "-q"]);
    folder.done(&["simulate", "pass.toml", "--active", "--seed", "1", "-o", "c.crd", "-q"]);
    let text = |name: &str| std::fs::read_to_string(folder.path(name)).unwrap();
    assert_eq!(text("a.crd"), text("b.crd"));
    assert_ne!(text("a.crd"), text("c.crd"));

    // What nobody said, and what does not go together.
    let cut = scene.split("[laser.ranging]").next().unwrap();
    std::fs::write(folder.path("bare.toml"), cut).unwrap();
    let error = folder.refused(1, &["simulate", "bare.toml", "--active", "-o", "d.crd"]);
    assert!(error.contains("give laser slr a table [laser.ranging]"), "{error}");
    let error = folder.refused(2, &["simulate", "pass.toml", "-o", "d.crd"]);
    assert!(error.contains("range data need --active"), "{error}");
    std::fs::write(folder.path("name.toml"), scene.replace("SHOP", "THE SHOP")).unwrap();
    let error = folder.refused(1, &["simulate", "name.toml", "--active", "-o", "d.crd"]);
    assert!(error.contains("name.toml:") && error.contains("laser[0].ranging.station"), "{error}");
    assert!(!folder.path("d.crd").exists());
}
