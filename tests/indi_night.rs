//! A whole night on gear that nobody here made: INDI's server, camera, wheel and telescope, a sky of its own, and a computer whose clock says that it is evening.
//!
//! INDI's simulated camera draws the stars that a program `gsc` names about the place where the telescope points, its sky and its vignetting. The one here names the bright stars of the catalogue and one satellite.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use crate::common::indi::{CCD, IndiServer, TELESCOPE, WHEEL, faketime};
use serde_json::Value;
use std::collections::BTreeMap;
use std::os::unix::fs::PermissionsExt as _;
use std::process::{Command, Stdio};
use sunglint_formats::Frame;
use sunglint_formats::session::Session;
use sunglint_formats::time::parse_utc;
use sunglint_testkit::{fixture, live, peer_python, run_python, skip};

const STATION: &str = r#"name = "small"
description = "synthetic"
[site]
latitude_deg = 48.7822
longitude_deg = 9.1956
height_m = 355
horizon_deg = 10
[telescope]
primary_diameter_m = 0.1
obstruction_diameter_m = 0
focal_length_m = 0.5
mount = "equatorial"
[air]
profile = "us_standard"
[camera]
name = "mono"
width_px = 1280
height_px = 1024
pixel_scale_arcsec = 2.1455
gain_e_per_adu = 1
read_noise_e = 4
full_well_e = 60000
adc_bits = 16
dark_e_per_s = 0.01
[[channel]]
name = "red"
camera_plane = "L"
filter = "Red"
transmission = 0.3
efficiency = "qe.csv"
[[channel]]
name = "green"
camera_plane = "L"
filter = "Green"
transmission = 0.3
efficiency = "qe.csv"
[[channel]]
name = "blue"
camera_plane = "L"
filter = "Blue"
transmission = 0.3
efficiency = "qe.csv"
"#;

/// The frames do not correct the pointing: the camera turns its image over when the telescope changes the side of its pier, and from one start to another (`indi-bin` 1.9.9). The simulated telescope has no refraction.
fn devices(port: u16) -> String {
    format!(
        r#"station = "station.toml"
[[camera]]
name = "cam"
device = "indi-camera:127.0.0.1:{port}/CCD Simulator"
exposure_s = 0.2
rests_between_visits = true
[[wheel]]
name = "wheel"
device = "indi-wheel:127.0.0.1:{port}/Filter Simulator"
filters = ["Red", "Green", "Blue", "H_Alpha", "SII", "OIII", "LPR", "Luminance"]
[mount]
device = "indi-telescope:127.0.0.1:{port}/Telescope Simulator"
german = false
refraction = false
set_site = true
trust_clock = true
"#
    )
}

/// `gsc -c RA DEC -r MINUTES …`: a line for each star there, of the columns that the driver reads: the third to fifth are the place, an uncertainty and the magnitude.
const GSC: &str = r#"#!/bin/sh
awk -v r="$2" -v d="$3" -v q="$5" -v now="$(date +%s.%N)" '
function star(id, a, b, m, x) {
  x = a - r; if (x > 180) x -= 360; if (x < -180) x += 360
  x = x * cos(d / 57.29578)
  if (b - d < q / 60 && d - b < q / 60 && x < q / 60 && -x < q / 60)
    printf "%s %f %f 0.3 %f 0.1 0 0 A1 NO 0.1 3\n", id, a, b, m
}
FILENAME ~ /stars/ { split($0, f, ","); if (f[1] + 0 > 0) star("S" f[1], f[5], f[6], f[10]); next }
$1 <= now { t0 = $1; a0 = $2; d0 = $3; next }
t0 { w = (now - t0) / ($1 - t0); star("SAT", a0 + w * ($2 - a0), d0 + w * ($3 - d0), MAG); exit }
' "$GSC_FOLDER/stars.csv" "$GSC_FOLDER/satellite.txt"
"#;
/// Magnitude that the satellite is drawn with.
const SATELLITE_MAG: f64 = 5.5;

/// Places of a satellite, astrometric, five each second for 20 minutes, by Skyfield.
const SKYFIELD: &str = r#"
import sys, numpy as np
from skyfield.api import load, wgs84, EarthSatellite
ts = load.timescale(builtin=True)
first, second = sys.argv[1:3]
place = EarthSatellite(first, second, ts=ts) - wgs84.latlon(48.7822, 9.1956, 355)
since = np.arange(6000) / 5
ra, dec, _ = place.at(ts.utc(2024, 8, 12, 19, 20, since)).radec()
for s, a, d in zip(since, ra._degrees, dec.degrees):
    print(f"{1723490400 + s:.2f} {a:.6f} {d:.6f}")
"#;

/// The plan of the part in the suite: flats behind two filters, dark frames, one star.
const SHORT: &str = r#"
[[visit]]
off = "flat"
level_adu = 20000
exposure_s = 0.1
frames = 3
filters = ["Red", "Green"]
[[visit]]
off = "dark"
frames = 5
[[visit]]
star = "39 Cyg"
frames = 5
filters = ["Red", "Green"]
"#;

/// The night that `passes` plans, as a campaign: three stars in three filters, their sky, a satellite's pass, flats, bias and dark frames, 48 minutes and 15 GB; in the suite [`SHORT`]. Truth, all by others: the catalogue's magnitudes that INDI's
/// camera draws (two stars' rates differ as their magnitudes, a satellite of magnitude 5.5 as bright as one all along its pass by Skyfield's places; 3 %, of which its noise makes less than 1), rates that are the same behind each filter, as the camera sees none (2 %), the level of flats (3 %), and the kinds and filters that stand
/// in the driver's own headers.
#[test]
fn campaign_indi_night() {
    let test = "campaign_indi_night";
    let whole = std::env::var("SUNGLINT_CAMPAIGN").is_ok_and(|name| name == "indi_night");
    let Some(library) = faketime() else {
        return skip(test, "no libfaketime (Debian package libfaketime)");
    };
    let python = if whole {
        let Some(python) = peer_python(test, &["skyfield"]) else { return };
        Some(python)
    } else {
        None
    };
    live(test, &["indiserver", CCD, TELESCOPE, WHEEL], || {
        let folder = Folder::new("indi-night");
        let write = |name: &str, text: &str| std::fs::write(folder.path(name), text).unwrap();
        write("station.toml", STATION);
        write("qe.csv", "wavelength_nm,efficiency\n400,0\n500,0.5\n600,0.5\n700,0\n");
        folder.done(&["tables", "bright_stars", "-o", "stars.csv"]);
        write("satellite.txt", "");
        std::fs::create_dir(folder.path("bin")).unwrap();
        write("bin/gsc", &GSC.replace("MAG", &SATELLITE_MAG.to_string()));
        let executable = std::fs::Permissions::from_mode(0o755);
        std::fs::set_permissions(folder.path("bin/gsc"), executable).unwrap();

        let clock = |evening: &str| {
            let off_s = (parse_utc(evening).unwrap() - sunglint_drivers::clock::computer_utc())
                .to_seconds();
            vec![
                ("LD_PRELOAD", library.display().to_string()),
                ("FAKETIME", format!("{off_s:+.0}")),
                ("FAKETIME_DONT_FAKE_MONOTONIC", "1".to_owned()),
                ("DONT_FAKE_MONOTONIC", "1".to_owned()),
            ]
        };
        // The Sun stands at −2° and at −3°.
        let environment =
            clock(if whole { "2024-08-12T18:50:40Z" } else { "2024-08-12T18:57:00Z" });
        let path = format!("{}:{}", folder.path("bin").display(), std::env::var("PATH").unwrap());
        let mut of_server = environment.clone();
        of_server.push(("PATH", path));
        of_server.push(("GSC_FOLDER", folder.0.display().to_string()));
        let server = IndiServer::start_in(&[CCD, TELESCOPE, WHEEL], &of_server);
        for device in ["CCD", "Telescope", "Filter"] {
            server.set(&[&format!("{device} Simulator.CONNECTION.CONNECT=On")]);
        }
        server.set(&["CCD Simulator.SCOPE_INFO.FOCAL_LENGTH;APERTURE=500;100"]);
        // From the magnitude that saturates to the faintest one the light falls by its largest value, 65,000: by a hundred in five magnitudes where 12.032 lie between.
        server.set(&["CCD Simulator.SIMULATOR_SETTINGS.SIM_SKYGLOW;SIM_SATURATION;SIM_LIMITINGMAG=11;1;13.032"]);

        write("devices.toml", &devices(server.port));
        if let Some(python) = python {
            let elements = std::fs::read_to_string(fixture("passes/satellites.tle")).unwrap();
            let line =
                |n: &str| elements.lines().find(|line| line.starts_with(n)).unwrap().to_owned();
            let (first, second) = (line("1 90002"), line("2 90002"));
            write("satellites.tle", &format!("SATELLITE\n{first}\n{second}\n"));
            write("satellite.txt", &run_python(&python, SKYFIELD, &[&first, &second]));
            let text = folder.done(&[
                "passes",
                "--tle",
                "satellites.tle",
                "--from",
                "2024-08-12T18:40",
                "--to",
                "2024-08-12T19:58",
                "--diameter-m",
                "5",
                "--devices",
                "devices.toml",
                "--flats",
                "20000",
                "--stars",
                "3",
                "--star-s",
                "30",
                "--sky-s",
                "30",
                "--star-mag",
                "4,6",
                "-o",
                "night.toml",
            ]);
            assert!(text.contains("0 error") && !text.contains("of it are lost"), "{text}");
        } else {
            write("night.toml", &(devices(server.port) + SHORT));
        }
        let mut program = Command::new(env!("CARGO_BIN_EXE_sunglint"))
            .args(["observe", "night.toml", "-o", "s", "--anyway"])
            .current_dir(&folder.0)
            .envs(environment)
            .stdout(Stdio::null())
            .stderr(std::fs::File::create(folder.path("said")).unwrap())
            .spawn()
            .unwrap();
        let code = program.wait().unwrap().code();
        let said = std::fs::read_to_string(folder.path("said")).unwrap();
        assert_eq!(code, Some(0), "{said}");
        folder.done(&["session", "check", "s"]);

        let session = Session::open(folder.path("s")).unwrap();
        let files = session.frames("cam").unwrap().files;
        let frames: Vec<Frame> = files.iter().map(|file| file.read().unwrap()).collect();
        looks(&frames, whole);
        let reduced = folder.json(&["reduce", "s", "-o", "out/", "--json"]);
        rates(&reduced, whole);
    });
}

/// Kinds, filters and levels.
fn looks(frames: &[Frame], whole: bool) {
    let text = |frame: &Frame, key: &str| frame.header.text(key).unwrap_or("").trim().to_owned();
    let mut kinds: BTreeMap<String, usize> = BTreeMap::new();
    let mut flats: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for frame in frames {
        let kind = text(frame, "FRAME");
        *kinds.entry(kind.clone()).or_default() += 1;
        if kind == "Flat" {
            let mut values: Vec<u16> = frame.pixels.iter().copied().collect();
            values.sort_unstable();
            flats
                .entry(text(frame, "FILTER"))
                .or_default()
                .push(f64::from(values[values.len() / 2]));
        }
    }
    eprintln!("{kinds:?}, flats {flats:?}");
    let asked: &[&str] = if whole { &["Red", "Green", "Blue"] } else { &["Red", "Green"] };
    for filter in asked {
        let good = flats[*filter].iter().filter(|level| (**level / 20_000.0 - 1.0).abs() < 0.03);
        assert!(good.count() >= if whole { 8 } else { 2 }, "{filter}: {flats:?}");
    }
    assert!(kinds["Dark"] >= 5 && (!whole || kinds["Bias"] >= 20), "{kinds:?}");
}

/// Rates of the reduced night.
fn rates(reduced: &Value, whole: bool) {
    let stars = sunglint_radiometry::sky::Catalogue::embedded();
    // Rate of a star of magnitude 0, by visit and filter: the same for all.
    let mut of_zero: Vec<(String, String, f64)> = Vec::new();
    for visit in reduced["visits"].as_array().unwrap() {
        let target = visit["target"].as_str().unwrap();
        let magnitude =
            stars.find(target).ok().and_then(|star| star.v_mag).unwrap_or(SATELLITE_MAG);
        for channel in visit["channels"].as_array().unwrap() {
            let Some(rate) = channel["median_rate_hz"].as_f64() else { continue };
            let samples = channel["with_rate"].as_u64().unwrap();
            let name = channel["name"].as_str().unwrap().to_owned();
            eprintln!("{target} {name}: {rate:.0} ADU/s, {samples} samples");
            if samples >= 3 {
                of_zero.push((target.to_owned(), name, rate * 10_f64.powf(0.4 * magnitude)));
            }
        }
    }
    // Three stars through three filters, and the pass through one.
    assert_eq!(of_zero.len(), if whole { 10 } else { 2 }, "{of_zero:?}");
    let mean = of_zero.iter().map(|row| row.2).sum::<f64>() / of_zero.len() as f64;
    for (target, name, rate) in &of_zero {
        let limit = if whole { 0.03 } else { 0.02 };
        assert!((rate / mean - 1.0).abs() < limit, "{target} {name}: {rate} beside {mean}");
    }
}
