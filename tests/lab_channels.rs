//! Runs with several channels through the program: a spectrometer, a monochromator, a person and files in a folder.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::{Folder, page_toml, program};
use crate::lab::distribution;
use std::f64::consts::PI;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use sunglint_formats::ecsv;

/// The commands of docs/lab-run.md for a spectrometer, as they stand, with its two files; 40 directions. Truth: Walter et al. 2007 in the lobe's peak, F/(4π α² cos²θ), the band's depth at 550 nm and the Lambert part's
/// power law. Tolerance 3 %: the cone's blur, bands of 25 nm over a band of σ 40 nm (0.8 %), noise.
#[test]
fn a_spectrometers_run_by_the_page() {
    let folder = distribution("lab-spectral-page");
    folder.done(&[
        "brdf",
        "plan",
        "lab/ndf.ecsv",
        "--measurements",
        "40",
        "-q",
        "--force",
        "-o",
        "lab/",
    ]);
    for (file, key) in [("colours.toml", "lamp_k"), ("spectral.toml", "virtual = \"colours.toml\"")]
    {
        std::fs::write(folder.path(file), page_toml("lab-run.md", key)).unwrap();
    }
    let page =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/lab-run.md")).unwrap();
    let commands: Vec<&str> = page
        .lines()
        .filter(|line| line.starts_with("sunglint brdf") && line.contains("spectral"))
        .filter_map(|line| line.strip_prefix("sunglint "))
        .collect();
    assert_eq!(commands.len(), 3, "{commands:?}");
    for command in commands {
        folder.done(&command.split_whitespace().collect::<Vec<_>>());
    }
    let samples = ecsv::read(folder.path("spectral-values/samples.ecsv")).unwrap();
    let column = |name: &str| samples.f64(name).unwrap().to_vec();
    let (i, o, phi) = (column("theta_i_deg"), column("theta_o_deg"), column("phi_o_deg"));
    let mut near = 0;
    for (nm, lobe) in [(550, 0.5), (700, 1.0 - 0.5 * (-0.5 * (150.0_f64 / 40.0).powi(2)).exp())] {
        let f = column(&format!("brdf_{nm}nm_per_sr"));
        let sigma = column(&format!("sigma_{nm}nm_per_sr"));
        for k in 0..f.len() {
            // Where G is 1 and the facet faces up.
            let mirrored = (i[k] - o[k]).abs() < 0.4 && (phi[k].abs() - 180.0).abs() < 0.5;
            if i[k] > 40.0 || !mirrored {
                continue;
            }
            near += 1;
            let cos = i[k].to_radians().cos();
            let truth = 0.5 * lobe / (4.0 * PI * 0.04 * cos * cos)
                + 0.3 * (f64::from(nm) / 632.8).powf(1.5) / PI;
            let off = (f[k] - truth).abs();
            assert!(off < 0.03 * truth + 4.0 * sigma[k], "{nm} nm, {} deg: {} {truth}", i[k], f[k]);
        }
    }
    assert!(near >= 2, "{near}");
    let shown = folder.json(&["brdf", "show", "surface.bsdf", "--wavelength-nm", "550", "--json"]);
    assert_eq!(shown["wavelength_nm"], 550.0);
    // Lobe and Lambert part together, at 30° where few cells are far from a measured one. Truth: F + ρ; 5 % for what little a lobe of 0.2 loses, and for the cells between.
    let albedo = shown["albedo"].as_array().unwrap();
    let albedo = albedo.iter().find(|at| at["theta_i_deg"] == 30.0).unwrap();
    let truth = 0.25 + 0.3 * (550.0 / 632.8_f64).powf(1.5);
    assert!((albedo["albedo"].as_f64().unwrap() / truth - 1.0).abs() < 0.05, "{albedo} {truth}");
    let made = folder.json(&["brdf", "ingest", "spectral/", "--json"]);
    let channels = made["instrument"]["channels"].as_array().unwrap();
    assert_eq!(channels.len(), 11);
    assert!(channels.iter().all(|channel| channel["unit"] == "ct / s"), "{channels:?}");
    assert!(made["instrument"]["incident_w"].is_null());
    // A law at one of the wavelengths. Truth: the sample's roughness.
    let fit = ["brdf", "fit", "spectral-values/samples.ecsv", "--wavelength-nm", "700"];
    let fitted = folder.json(&[&fit[..], &["--law", "ggx", "--json"]].concat());
    assert_eq!(fitted["wavelength_nm"], 700.0);
    let parameters = fitted["laws"][0]["parameters"].as_array().unwrap();
    let alpha = parameters.iter().find(|p| p["name"] == "alpha").unwrap();
    assert!((alpha["value"].as_f64().unwrap() / 0.2 - 1.0).abs() < 0.1, "{alpha}");
    // What the detector does not reach is refused.
    let wrong =
        "virtual = \"colours.toml\"\n[axis.azimuth]\n[spectrometer]\nchannels_nm = [[1500, 10]]\n";
    std::fs::write(folder.path("wrong.toml"), wrong).unwrap();
    let said = folder
        .refused(1, &["brdf", "run", "lab/plan.ecsv", "--bench", "wrong.toml", "-o", "wrong/"]);
    assert!(said.contains("1500 nm") && said.contains("holds no pixel"), "{said}");
    let wrong = "virtual = \"colours.toml\"\n[axis.azimuth]\n[monochromator]\nwavelengths_nm = [500, 5000]\n";
    std::fs::write(folder.path("wrong.toml"), wrong).unwrap();
    let said = folder
        .refused(1, &["brdf", "run", "lab/plan.ecsv", "--bench", "wrong.toml", "-o", "wrong/"]);
    assert!(said.contains("does not reach 5000 nm"), "{said}");
    assert!(!folder.path("wrong/readings.ecsv").exists(), "a refused bench leaves no run");
    // The benches of the page for real devices are benches.
    for (key, said) in
        [("device = \"ocean\"", "/dev/ttyACM0"), ("device = \"cm110:", "/dev/ttyACM0")]
    {
        std::fs::write(folder.path("real.toml"), page_toml("lab-run.md", key)).unwrap();
        let refused = folder
            .refused(1, &["brdf", "run", "lab/plan.ecsv", "--bench", "real.toml", "-o", "real/"]);
        assert!(refused.contains(said), "{refused}");
    }
}

fn run_in(folder: &Folder, arguments: &[&str]) -> Child {
    Command::new(program())
        .args(arguments)
        .current_dir(&folder.0)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Truth: the plan. Runs with a spectrometer and with a monochromator that are killed at eight moments and gone on with have every direction once, and what they had read before is still there.
#[test]
fn runs_of_channels_that_are_killed_lose_nothing() {
    let folder = distribution("lab-channels-killed");
    folder.done(&[
        "brdf",
        "plan",
        "lab/ndf.ecsv",
        "--measurements",
        "60",
        "-q",
        "--force",
        "-o",
        "lab/",
    ]);
    std::fs::write(folder.path("colours.toml"), page_toml("lab-run.md", "lamp_k")).unwrap();
    for (name, detector) in [
        (
            "spectral",
            "[spectrometer]\nchannels_nm = [[500, 20], [600, 20]]\nintegration_s = [0.0002, 0.02, 2]\n",
        ),
        ("mono", "[monochromator]\nwavelengths_nm = [500, 600]\n"),
    ] {
        let bench = format!("{name}.toml");
        let text = format!("virtual = \"colours.toml\"\n[axis.azimuth]\n{detector}");
        std::fs::write(folder.path(&bench), text).unwrap();
        let out = format!("{name}/");
        let readings = folder.path(&out).join("readings.ecsv");
        let lines =
            || std::fs::read(&readings).map_or(0, |b| b.iter().filter(|b| **b == b'\n').count());
        let run = ["brdf", "run", "lab/plan.ecsv", "-q", "-o", &out];
        let mut before = Vec::new();
        for kill in 1..=8 {
            let more: &[&str] = if kill == 1 { &["--bench", &bench] } else { &["--resume"] };
            let mut child = run_in(&folder, &[&run[..], more].concat());
            let (until, begun) = (lines() + 31 * kill, std::time::Instant::now());
            while lines() < until
                && begun.elapsed().as_secs() < 60
                && child.try_wait().unwrap().is_none()
            {
                std::thread::yield_now();
            }
            child.kill().unwrap();
            child.wait().unwrap();
            let now = std::fs::read(&readings).unwrap();
            assert!(now.starts_with(&before), "{name} {kill}: readings were lost or changed");
            let kept = now.iter().rposition(|b| *b == b'\n').unwrap() + 1;
            before = now[..kept].to_vec();
            if kill % 2 == 0 {
                // Half a line, as a power cut leaves one.
                let torn = [&before[..], b"2026-01-01T00:0"].concat();
                std::fs::write(&readings, torn).unwrap();
            }
        }
        let ran = folder.json(&[&run[..3], &["--resume", "-o", &out, "--json"]].concat());
        assert_eq!(ran["measured"], ran["directions"], "{ran}");
        assert!(std::fs::read(&readings).unwrap().starts_with(&before));
        let made = folder.json(&["brdf", "ingest", &out, "--json"]);
        assert_eq!((&made["left"], &made["directions"]), (&0.into(), &ran["directions"]));
        let table = ecsv::read(&readings).unwrap();
        assert!(table.rows() > 500);
    }
}

/// An instrument that writes a file for each spectrum that is asked for: light of a Lambert sample of reflectance 0.5 at short and 0.9 at long wavelengths, which the hands' own log places.
struct Ftir<'a> {
    folder: &'a Folder,
    number: u32,
}

/// Solid angle of the bench's usual stop, a disc of 10 mm at 500 mm.
fn solid_angle() -> f64 {
    2.0 * PI * (1.0 - 1.0 / (1.0 + 0.01_f64.powi(2)).sqrt())
}

impl Ftir<'_> {
    /// The last request to the hands with this beginning.
    fn last(&self, begin: &str) -> Option<String> {
        let asked = std::fs::read_to_string(self.folder.path("asked.txt")).unwrap();
        let found = asked.lines().rev().find_map(|line| line.strip_prefix(begin))?;
        Some(found.trim().to_owned())
    }

    fn write(&mut self, folder: &Path) {
        let deg = |axis: &str| self.last(&format!("turn {axis}")).unwrap().parse::<f64>().unwrap();
        let places = ["blocked", "through", "nothing", "sample"];
        let asked = std::fs::read_to_string(self.folder.path("asked.txt")).unwrap();
        let place = asked.lines().rev().find(|line| places.contains(line)).unwrap();
        let cos = deg("detector").to_radians().cos();
        let mut text = String::from("wavelength_nm,single_beam\n");
        for k in 0..=300 {
            let nm = 450.0 + f64::from(k);
            let reflectance = if nm < 600.0 { 0.5 } else { 0.9 };
            let lamp = 1000.0 + nm;
            let light = match place {
                "blocked" => 0.0,
                "through" => 1.0,
                "sample" => reflectance / PI * cos * solid_angle(),
                _ => panic!("{place}"),
            };
            let x = (f64::from(self.number) * 12.9898 + f64::from(k) * 78.233).sin() * 43_758.545_3;
            text += &format!("{nm},{}\n", 0.2 + lamp * (light + 1e-7 * (x - x.floor() - 0.5)));
        }
        std::fs::write(folder.join(format!("s{:04}.csv", self.number)), text).unwrap();
        self.number += 1;
    }
}

/// The bench of the page: a person (`--hands` here) turns the axes, an FTIR writes files into a folder. The run is killed in between; a file of another kind, and one that was there, are said and not taken.
/// Truth: Lambert's law for the instrument that writes the files, f = ρ/π; the scale within the 5 % that are stated where there is no signature, each value within 1 % (its tenth of a per cent of noise and the angles' zeros of 0.1°).
#[test]
fn a_person_and_an_ftir_by_the_page() {
    let folder = distribution("lab-ftir");
    let bench = page_toml("lab-run.md", "folder = \"inbox\"")
        .replace("complete_s = 2.0", "complete_s = 0.3");
    let bench = bench.replace("from_nm = 450, to_nm = 700", "from_nm = 500, to_nm = 700");
    std::fs::write(folder.path("hand.toml"), bench).unwrap();
    folder.done(&[
        "brdf",
        "plan",
        "lab/ndf.ecsv",
        "--bench",
        "hand.toml",
        "--measurements",
        "24",
        "-q",
        "-o",
        "few/",
    ]);
    std::fs::create_dir(folder.path("inbox")).unwrap();
    std::fs::write(folder.path("inbox/old.csv"), "wavelength_nm,y\n1,1\n").unwrap();
    std::fs::write(folder.path("hands"), "#!/bin/sh\necho \"$@\" >> asked.txt\n").unwrap();
    let mode = std::os::unix::fs::PermissionsExt::from_mode(0o755);
    std::fs::set_permissions(folder.path("hands"), mode).unwrap();
    let mut ftir = Ftir { folder: &folder, number: 0 };
    let run = ["brdf", "run", "few/plan.ecsv", "--hands", "./hands", "-o", "by-hand/"];
    let mut heard = String::new();
    for part in 0..2 {
        let more: &[&str] = if part == 0 { &["--bench", "hand.toml"] } else { &["--resume"] };
        let mut child = run_in(&folder, &[&run[..], more].concat());
        let mut waits = 0;
        for line in BufReader::new(child.stderr.take().unwrap()).lines() {
            let line = line.unwrap();
            heard += &format!("{line}\n");
            if !line.contains("waiting for a new file") || line.contains("not taken") {
                continue;
            }
            waits += 1;
            if part == 0 && waits == 8 {
                child.kill().unwrap();
                break;
            }
            if part == 1 && waits == 3 {
                let other = "wavelength_um,y\n1,1\n2,2\n3,1\n4,1\n";
                std::fs::write(folder.path("inbox/other.csv"), other).unwrap();
                std::thread::sleep(std::time::Duration::from_millis(1500));
            }
            ftir.write(&folder.path("inbox"));
        }
        let status = child.wait().unwrap();
        assert_eq!(status.success(), part == 1, "{heard}");
    }
    assert!(heard.contains("other.csv is not taken: it has 4 values"), "{heard}");
    assert!(!heard.contains("old.csv is not taken"), "{heard}");
    let asked = std::fs::read_to_string(folder.path("asked.txt")).unwrap();
    assert!(asked.contains("turn sample ") && asked.contains("turn detector "), "{asked}");
    assert!(
        asked
            .lines()
            .filter(|line| line.starts_with("turn"))
            .all(|line| { line.rsplit_once('.').is_some_and(|(_, digits)| digits.len() == 2) })
    );
    let table = ecsv::read(folder.path("by-hand/readings.ecsv")).unwrap();
    let mut names: Vec<String> =
        table.text("file").unwrap().iter().flatten().filter(|n| !n.is_empty()).cloned().collect();
    let all = names.len();
    names.sort();
    names.dedup();
    assert_eq!(names.len(), all, "a file was taken twice: {names:?}");
    assert!(std::fs::read_dir(folder.path("by-hand/spectra")).unwrap().count() >= all);
    let made = folder.json(&["brdf", "ingest", "by-hand/", "--json"]);
    assert_eq!((&made["left"], &made["directions"]), (&0.into(), &24.into()), "{made}");
    assert!(made["warnings"].to_string().contains("the signature"), "{}", made["warnings"]);
    folder.done(&["brdf", "ingest", "by-hand/", "-q", "-o", "by-hand-values/"]);
    let samples = ecsv::read(folder.path("by-hand-values/samples.ecsv")).unwrap();
    for (nm, reflectance) in [(550, 0.5), (650, 0.9)] {
        let f = samples.f64(&format!("brdf_{nm}nm_per_sr")).unwrap().to_vec();
        assert_eq!(f.len(), 24);
        for value in f {
            assert!((value * PI / reflectance - 1.0).abs() < 0.01, "{nm}: {value}");
        }
    }
    let said = folder
        .refused(1, &["brdf", "run", "few/plan.ecsv", "--bench", "hand.toml", "-o", "nobody/"]);
    assert!(said.contains("turn the sample to") && said.contains("--hands"), "{said}");
    let yes = ["brdf", "run", "few/plan.ecsv", "--bench", "hand.toml", "--yes", "-o", "yes/"];
    let said = folder.refused(2, &yes);
    assert!(said.contains("nobody would turn the axis `sample`"), "{said}");
}
