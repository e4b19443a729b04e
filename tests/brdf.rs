//! `sunglint brdf`: from a table of retro-reflection to a plan, through files.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::{Folder, page_toml};
use std::fmt::Write as _;
use sunglint_formats::ecsv;

/// Retro-reflection of a GGX lobe with F₀ = 0.9 (Walter et al. 2007), the normal at 0.3°, 1 % uncertainty, as a table of a goniometer.
fn retro(alpha: f64) -> String {
    let mut text = String::from(
        "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: angle_deg, datatype: float64, unit: deg}\n# - {name: f_per_sr, datatype: float64, unit: 1 / sr}\n\
         # - {name: sigma_f_per_sr, datatype: float64, unit: 1 / sr}\n\
         # meta: {kind: retro_reflection, wavelength_nm: 632.8, cone_half_angle_deg: 0.5, scale_sigma: 0.02}\nangle_deg f_per_sr sigma_f_per_sr\n",
    );
    for k in 0..151 {
        let angle = -10.0 + 0.5 * f64::from(k);
        let theta = (angle - 0.3_f64).to_radians();
        let t2 = theta.tan().powi(2);
        let cos2 = theta.cos().powi(2);
        let d = 1.0 / (std::f64::consts::PI * (alpha * cos2 * (1.0 + t2 / alpha / alpha)).powi(2));
        let f = 0.9 * d * 2.0 / (1.0 + (1.0 + alpha * alpha * t2).sqrt()) / (4.0 * cos2);
        let _ = writeln!(text, "{angle} {f} {}", 0.01 * f);
    }
    text
}

/// Truth: the closed form that the table was made from. Tolerance 3e-3; F₀'s uncertainty is above the 2 % that all readings have in common.
#[test]
fn from_readings_to_a_plan() {
    let folder = Folder::new("brdf");
    std::fs::write(folder.path("retro.ecsv"), retro(0.1)).unwrap();
    let ndf = ["brdf", "ndf", "retro.ecsv", "--resamplings", "40", "--json", "-o", "lab/"];
    let json = folder.json(&ndf);
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    assert!((number(&json["f0"]) / 0.9 - 1.0).abs() < 3e-3, "{}", json["f0"]);
    assert!((0.018..0.025).contains(&number(&json["f0_sigma"])), "{}", json["f0_sigma"]);
    let profile = &json["profiles"][0];
    assert!((number(&profile["zero"]["angle_deg"]) - 0.3).abs() < 1e-3);
    assert!((number(&profile["fits"]["ggx"]["alpha"]) / 0.1 - 1.0).abs() < 3e-3);
    assert!(number(&profile["fits"]["beckmann"]["misfit"]) > 0.1);
    assert!((number(&json["smallest_alpha"]) - 0.25_f64.to_radians().tan()).abs() < 1e-6);
    for file in ["ndf.ecsv", "ndf.png", "ndf.svg"] {
        assert!(folder.path("lab").join(file).exists(), "{file}");
    }
    let table = ecsv::read(folder.path("lab/ndf.ecsv")).unwrap();
    assert_eq!((table.rows(), table.meta_text("kind")), (128, Some("ndf")));
    assert_eq!(table.meta["wavelength_nm"], 632.8);
    // The same seed, the same numbers, on one thread too; another seed, other uncertainties.
    let again = folder.json(&[
        "brdf",
        "ndf",
        "retro.ecsv",
        "--resamplings",
        "40",
        "--json",
        "--threads",
        "1",
    ]);
    assert_eq!(again, json);
    let other =
        folder.json(&["brdf", "ndf", "retro.ecsv", "--resamplings", "40", "--json", "--seed", "5"]);
    assert!(other["f0"] == json["f0"] && other["f0_sigma"] != json["f0_sigma"]);

    let plan =
        folder.json(&["brdf", "plan", "lab/ndf.ecsv", "--side", "8", "--json", "-o", "lab/"]);
    assert_eq!(plan["theta_i_deg"].as_array().unwrap().len(), 8);
    assert_eq!(plan["cells"], 8 * 64);
    let table = ecsv::read(folder.path("lab/plan.ecsv")).unwrap();
    assert_eq!((table.rows(), table.meta_text("kind")), (512, Some("brdf_plan")));
    let steps = table.i64("step").unwrap();
    let last = steps.iter().flatten().max().unwrap();
    assert_eq!(plan["steps"], *last);
    assert!(folder.path("lab/plan.png").exists());
    let text = folder.done(&["brdf", "plan", "lab/ndf.ecsv", "--rig", "--most-theta-i-deg", "50"]);
    assert!(text.contains("incidence  50.00°"), "{text}");
}

#[test]
fn what_is_refused_says_why() {
    let folder = Folder::new("brdf-refused");
    std::fs::write(folder.path("mirror.ecsv"), retro(0.002)).unwrap();
    let said = folder.refused(1, &["brdf", "ndf", "mirror.ecsv"]);
    assert!(said.contains("narrower than the step of 0.500° resolves"), "{said}");
    std::fs::write(folder.path("one.csv"), "angle_deg,f_per_sr\n0,1\n").unwrap();
    let said = folder.refused(1, &["brdf", "ndf", "one.csv"]);
    assert!(said.contains("one.csv: 1 angles with light: an NDF needs 8 or more"), "{said}");
    std::fs::write(folder.path("other.csv"), "angle,f_per_sr\n0,1\n").unwrap();
    let said = folder.refused(1, &["brdf", "ndf", "other.csv"]);
    assert!(said.contains("angle_deg: found no such column"), "{said}");
    for (text, word) in [
        ("a,b\n-10,0,0,123\n", "decimal comma"),
        ("a,b\n\"-10,0\",\"0,123\"\n", "decimal comma"),
        ("a;b\n-10,0;0,123\n", "a comma is in the numbers"),
        ("a;b\n1;2\n3,5;4\n", "a comma is in the numbers"),
        ("a;b\n1;2\n", "not by semicolons"),
        ("a,b\n1,2,x\n", "found 3 fields, expected 2"),
    ] {
        std::fs::write(folder.path("comma.csv"), text).unwrap();
        let said = folder.refused(1, &["brdf", "ndf", "comma.csv"]);
        assert!(said.contains("comma.csv:") && said.contains(word), "{text}: {said}");
        assert!(!text.contains('x') || !said.contains("decimal"), "{said}");
    }
    let said = folder.refused(1, &["brdf", "plan", "mirror.ecsv"]);
    assert!(said.contains("kind: found `retro_reflection`, expected `ndf`"), "{said}");
    folder.refused(2, &["brdf", "plan", "x.ecsv", "--mark-deg", "2"]);
    std::fs::write(folder.path("good.ecsv"), retro(0.2)).unwrap();
    let said = folder.refused(1, &["brdf", "ndf", "good.ecsv", "--median", "4"]);
    assert!(said.contains("median: found 4, expected an odd number"), "{said}");
    folder.done(&["brdf", "ndf", "good.ecsv", "--resamplings", "0", "-q", "-o", "n.ecsv"]);
    let said = folder.refused(2, &["brdf", "plan", "n.ecsv", "--quarter"]);
    assert!(said.contains("the sample is isotropic"), "{said}");
    let said = folder.refused(1, &["brdf", "plan", "n.ecsv", "--rig", "--side", "32"]);
    assert!(said.contains("side: found 32, expected an odd number"), "{said}");
}

/// f of a panel: GGX of 0.15 (Walter et al. 2007, separable masking) and Lambert light.
fn panel(nm: f64, [theta_i, theta_o, phi]: [f64; 3]) -> f64 {
    let unit = |theta: f64, phi: f64| {
        let ((y, x), (sin, cos)) = (phi.to_radians().sin_cos(), theta.to_radians().sin_cos());
        [sin * x, sin * y, cos]
    };
    let (i, o) = (unit(theta_i, 0.0), unit(theta_o, phi));
    let h = [i[0] + o[0], i[1] + o[1], i[2] + o[2]];
    let cos2 = h[2] * h[2] / h.iter().map(|v| v * v).sum::<f64>();
    let a2 = 0.15_f64 * 0.15;
    let d = a2 / (std::f64::consts::PI * (cos2 * (a2 - 1.0) + 1.0).powi(2));
    let g = |z: f64| 2.0 / (1.0 + (1.0 + a2 * (1.0 / (z * z) - 1.0)).sqrt());
    0.5 * d * g(i[2]) * g(o[2]) / (4.0 * i[2] * o[2]) + (0.1 + nm / 5000.0) / std::f64::consts::PI
}

const DIRECTIONS: usize = 104;

fn angles(k: usize) -> [f64; 3] {
    let phis = [180.0, 180.0, 150.0, 90.0, 0.0];
    [[0.0, 20.0, 40.0, 60.0][k % 4], 3.0 + 3.0 * ((k / 4) % 26) as f64, phis[(k / 7) % 5]]
}

/// The files of a measurement: a lamp, a mirror of 0.95, two detectors of which the second has a tenth more gain with the sample than with the mirror.
fn spectra(folder: &Folder) -> String {
    let lamp = |nm: f64| 100.0 + 0.1 * nm;
    let si = |light: &dyn Fn(f64) -> f64| {
        let row = |k: i32| {
            let nm = 400.0 + 2.0 * f64::from(k);
            format!("{nm},{}\n", 2.0 * light(nm) + 1.0)
        };
        format!("wavelength_nm,counts\n{}", (0..200).map(row).collect::<String>())
    };
    let ingaas = |light: &dyn Fn(f64) -> f64| {
        let (first, last, n) = (15_000.0, 10_000.0, 501);
        let mut text = format!(
            "##TITLE=x\n##JCAMP-DX=4.24\n##XUNITS=1/CM\n##YUNITS=ARBITRARY\n##FIRSTX={first}\n##LASTX={last}\n##NPOINTS={n}\n##XYDATA=(X++(Y..Y))\n"
        );
        for k in 0..n {
            let x = first - 10.0 * f64::from(k);
            let _ = writeln!(text, "{x} {}", light(1e7 / x));
        }
        text + "##END=\n"
    };
    let write = |name: &str, text: String| std::fs::write(folder.path(name), text).unwrap();
    write("si_reference.csv", si(&|nm| 0.95 * lamp(nm)));
    write("si_dark.csv", si(&|_| 0.0));
    write("ingaas_reference.dx", ingaas(&|nm| 0.95 * lamp(nm)));
    let mut more = String::new();
    for k in 0..DIRECTIONS {
        let at = angles(k);
        let signal = |nm: f64| 0.002 * at[1].to_radians().cos() * panel(nm, at) * lamp(nm);
        let name = if k == 0 { "a".to_owned() } else { format!("d{k}") };
        write(&format!("{name}_si.csv"), si(&signal));
        write(&format!("{name}_ingaas.dx"), ingaas(&|nm| 1.1 * signal(nm)));
        if k > 0 {
            let _ = writeln!(
                more,
                "[[direction]]\ntheta_i_deg = {}\nphi_i_deg = 0\ntheta_o_deg = {}\nphi_o_deg = {}\n\
                 files = {{ si = \"{name}_si.csv\", ingaas = \"{name}_ingaas.dx\" }}\ndark = {{ si = \"si_dark.csv\" }}",
                at[0], at[1], at[2]
            );
        }
    }
    more
}

/// Every command of the page runs, in its order, on files as the page describes them; `--force`, since it plans twice. Truth: the closed form that the spectra were made
/// from. Tolerance: values 1e-3 (linear between wavelengths); the law's parameters 2 %; the assembled material within 3 % of it where it was measured.
#[test]
fn the_page_of_the_lab_from_spectra_to_a_material() {
    let folder = Folder::new("lab");
    let page =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/lab.md")).unwrap();
    // The rig's sample has the roughness of the one whose spectra these are.
    let rig = page_toml("lab.md", "[mount]").replace("alpha = 0.1\n", "alpha = 0.15\n");
    assert!(rig.contains("0.15"));
    std::fs::write(folder.path("rig.toml"), rig).unwrap();
    std::fs::write(folder.path("run.toml"), page_toml("lab.md", "[scan]")).unwrap();
    let toml = page_toml("lab.md", "[[direction]]");
    // The page's one direction is the first.
    let toml = toml
        .replace("theta_i_deg = 30\n", "theta_i_deg = 0\n")
        .replace("theta_o_deg = 10\n", "theta_o_deg = 3\n");
    std::fs::write(folder.path("ingest.toml"), toml + &spectra(&folder)).unwrap();
    let commands: Vec<&str> = page.lines().filter_map(|l| l.strip_prefix("sunglint ")).collect();
    assert!(commands.len() >= 8, "{commands:?}");
    for command in commands {
        let words = command.split('#').next().unwrap().split_whitespace();
        let mut words: Vec<&str> = words.collect();
        if words.contains(&"-o") {
            words.push("--force");
        }
        if words.contains(&"ndf") {
            words.extend(["--resamplings", "5"]);
        }
        folder.done(&words);
    }
    for file in [
        "lab/samples.ecsv",
        "lab/fit.png",
        "lab/show.svg",
        "panel.bsdf",
        "panel.toml",
        "panel.coverage.ecsv",
        "panel.doubts.ecsv",
        "lab/material.toml",
        "lab/residuals.ecsv",
    ] {
        assert!(folder.path(file).exists(), "{file}");
    }
    let samples = ecsv::read(folder.path("lab/samples.ecsv")).unwrap();
    let f = samples.f64("brdf_600nm_per_sr").unwrap();
    for (k, f) in f.iter().enumerate() {
        assert!((f / panel(600.0, angles(k)) - 1.0).abs() < 1e-3, "{k}: {f}");
    }
    assert_eq!(samples.meta["polarisation"], "unpolarised");
    let ingest = folder.json(&["brdf", "ingest", "ingest.toml", "--json"]);
    let scale = ingest["seams"][3]["scale"].as_f64().unwrap();
    assert!((scale * 1.1 - 1.0).abs() < 2e-3, "{scale}");
    assert!(
        ingest["warnings"][0].as_str().unwrap().contains("ingaas was scaled by 0.909"),
        "{}",
        ingest["warnings"][0]
    );

    // Beyond its wavelengths nothing is known.
    let shown = folder.json(&["brdf", "show", "panel.bsdf", "--wavelength-nm", "2000", "--json"]);
    let said = shown["warnings"].to_string();
    assert!(said.contains("it is known from 450 to 900 nm, not at 2000 nm"), "{said}");

    // Its directions are not those of the plan: what is missing is counted and listed, what was not planned is used.
    let small = ["--side", "9", "--theta-i", "4", "--normals", "32", "--json"];
    let planned = ["brdf", "assemble", "lab/samples.ecsv", "lab/ndf.ecsv", "-o", "planned.bsdf"];
    let planned = [&planned[..], &["--plan", "lab/plan.ecsv"], &small].concat();
    let made = folder.json(&planned);
    let missing = ecsv::read(folder.path("planned.missing.ecsv")).unwrap().rows();
    assert!(missing > 10 && made["plan"]["missing"] == missing, "{missing} {}", made["plan"]);
    assert!(made["plan"]["planned"].as_u64().unwrap() >= missing as u64);
    let wrong = [&planned[..4], &["-o", "x.bsdf", "--plan", "lab/samples.ecsv"]].concat();
    let said = folder.refused(1, &wrong);
    assert!(said.contains("`brdf_samples`") && said.contains("sunglint brdf plan"), "{said}");

    let fit = ["brdf", "fit", "lab/samples.ecsv", "--wavelength-nm", "600", "--law", "ggx"];
    let fit = folder.json(&[&fit[..], &["--json"]].concat());
    assert_eq!(fit["laws"][0]["law"], "ggx+lambert");
    for (p, truth) in fit["laws"][0]["parameters"].as_array().unwrap().iter().zip([0.5, 0.15, 0.22])
    {
        assert!((p["value"].as_f64().unwrap() / truth - 1.0).abs() < 0.02, "{p}");
    }
    folder.refused(1, &["brdf", "fit", "lab/samples.ecsv"]);
    // The law as a material, and the assembled one, beside one another.
    let both = folder.json(&[
        "brdf",
        "compare",
        "panel.bsdf",
        "lab/material.toml",
        "--wavelength-nm",
        "550",
        "--json",
    ]);
    for row in both["ratios"].as_array().unwrap() {
        assert!((row["median_ratio"].as_f64().unwrap() - 1.0).abs() < 0.03, "{row}");
    }
    let show =
        folder.json(&["brdf", "show", "lab/samples.ecsv", "--wavelength-nm", "600", "--json"]);
    assert!(show["albedo"][0]["albedo"].as_f64().unwrap() > 0.5, "{show}");
}

#[test]
fn what_no_law_or_material_can_be_made_of_says_why() {
    let folder = Folder::new("lab-refused");
    let table = "theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,brdf_per_sr\n30,0,10,180,0.1\n30,0,20,180,0.2\n";
    std::fs::write(folder.path("t.csv"), table).unwrap();
    let said = folder.refused(1, &["brdf", "fit", "t.csv"]);
    assert!(said.contains("--wavelength-nm 532"), "{said}");
    let said = folder.refused(1, &["brdf", "fit", "t.csv", "--wavelength-nm", "532"]);
    assert!(said.contains("2 values of 2 can be used"), "{said}");
    std::fs::write(folder.path("x.0"), [0x0a, 0x0a, 0xfe, 0xfe, 0, 0]).unwrap();
    std::fs::write(
        folder.path("gap.csv"),
        "wavelength_nm,counts\n400,1\n401,1\n402,1\n403,1\n440,1\n441,1\n442,1\n",
    )
    .unwrap();
    let toml = |file: &str| {
        format!(
            "solid_angle_sr = 1e-3\nwavelength_nm = {{ from = 400, to = 410, step = 1 }}\n[reference]\nkind = \"mirror\"\nreflectance = 1\n\
             [[detector]]\nname = \"a\"\nrange_nm = [400, 410]\nreference = {file:?}\n[[direction]]\ntheta_i_deg = 0\nphi_i_deg = 0\ntheta_o_deg = 1\nphi_o_deg = 0\nfiles = {{ a = {file:?} }}\n"
        )
    };
    // In this place a reference: its light is 1 everywhere. Spectra without light, and wavenumbers in a column of wavelengths.
    let lines = |value: f64, at: &dyn Fn(f64) -> f64| {
        let line = |k: i32| format!("{},{value}\n", at(395.0 + f64::from(k)));
        "wavelength_nm,counts\n".to_owned() + &(0..21).map(line).collect::<String>()
    };
    std::fs::write(folder.path("light.csv"), lines(1.0, &|nm| nm)).unwrap();
    std::fs::write(folder.path("dark.csv"), lines(0.0, &|nm| nm)).unwrap();
    std::fs::write(folder.path("below.csv"), lines(-1.0, &|nm| nm)).unwrap();
    std::fs::write(folder.path("swapped.csv"), lines(1.0, &|nm| 1e7 / nm)).unwrap();
    for (file, expected) in [
        ("dark.csv", "no value is above 0"),
        ("below.csv", "no value is above 0"),
        ("swapped.csv", "holds wavenumbers"),
    ] {
        let text =
            toml(file).replace(&format!("reference = {file:?}"), "reference = \"light.csv\"");
        std::fs::write(folder.path("i.toml"), text).unwrap();
        let said = folder.refused(1, &["brdf", "ingest", "i.toml", "-o", "lab/"]);
        assert!(said.contains(expected), "{said}");
    }
    for (file, expected) in [
        ("x.0", "x.0: directory: found the end of the file after 6 bytes"),
        ("gap.csv", "gap.csv:6: found 440 after 403: a gap of 37 usual steps"),
    ] {
        std::fs::write(folder.path("i.toml"), toml(file)).unwrap();
        let said = folder.refused(1, &["brdf", "ingest", "i.toml"]);
        assert!(said.contains(expected), "{said}");
    }
    let said = folder.refused(2, &["brdf", "assemble", "t.csv", "n.ecsv", "-o", "x.txt"]);
    assert!(said.contains("expected a file .bsdf"), "{said}");
}

/// Truth: a Lambert surface (0.1 sr⁻¹) whose spectrum doubles from 532 to 700 nm has twice the diffuse reflectance there, π/10 · 2. Tolerance 1e-6: there is nothing to divide. A spectrum without a geometry, and one that
/// does not hold the fit's wavelength, are refused with what to do.
#[test]
fn a_spectrum_colours_the_fit() {
    let folder = Folder::new("brdf-colour");
    let mut table = String::from("theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,brdf_per_sr\n");
    for theta_i in [10, 40, 60] {
        for theta_o in (-75..=75).step_by(5) {
            let _ = writeln!(table, "{theta_i},0,{theta_o},180,0.1");
        }
    }
    std::fs::write(folder.path("t.csv"), table).unwrap();
    std::fs::write(folder.path("s.csv"), "wavelength_nm,signal\n500,3\n532,3\n700,6\n").unwrap();
    std::fs::write(folder.path("far.csv"), "wavelength_nm,signal\n600,3\n700,6\n").unwrap();
    let fit = ["brdf", "fit", "t.csv", "--wavelength-nm", "532", "--most-lobes", "1", "--spectrum"];
    let message = folder.refused(2, &[&fit[..], &["s.csv"]].concat());
    assert!(message.contains("--spectrum-at 30,0,0"), "{message}");
    let at = ["--spectrum-at", "30,0,0", "-o", "lab/"];
    let message = folder.refused(1, &[&fit[..], &["far.csv"], &at].concat());
    assert!(message.contains("from 600 to 700 nm"), "{message}");
    folder.done(&[&fit[..], &["s.csv"], &at].concat());
    let toml = std::fs::read_to_string(folder.path("lab/material.toml")).unwrap();
    assert!(toml.contains("# Colour: ") && toml.contains("reflectance_table"), "{toml}");
    let colour = ecsv::read(folder.path("lab/colour.ecsv")).unwrap();
    assert!((colour.f64("diffuse").unwrap()[2] - 2.0).abs() < 1e-6);
    let page = ["brdf", "page", "lab/material.toml", "--wavelength-nm", "532", "-o"];
    assert!(folder.refused(2, &[&page[..], &["page.txt"]].concat()).contains(".html"));
    folder.done(&[&page[..], &["page.html"]].concat());
    let html = std::fs::read_to_string(folder.path("page.html")).unwrap();
    for chart in ["cuts", "lobes", "hemispherical", "spectra", "ball", "boxwing"] {
        assert!(html.contains(&format!("data-chart=\"{chart}\"")), "{chart}");
    }
    // 0.1 sr⁻¹ is a tenth of π of a white surface, whose ball has 2/3 at full phase: nearly so at 5°.
    let ball = html.split_once("A ball of 1 m radius").unwrap().1;
    assert!(ball.contains("white Lambert surface"));
    let json =
        folder.json(&["brdf", "show", "lab/material.toml", "--wavelength-nm", "700", "--json"]);
    let albedo = json["albedo"][0]["albedo"].as_f64();
    let albedo = albedo.unwrap_or_else(|| panic!("{json}"));
    assert!((albedo / (0.2 * std::f64::consts::PI) - 1.0).abs() < 1e-4, "{albedo}");
}

/// A Zemax-like grid about the normal in CSV, up to 60° (synthetic: f = 0.1 /sr). Truth: an incidence is extrapolated where the table ends before it; what is measured is 0.1 π to 2 %.
#[test]
fn what_was_not_measured_is_marked() {
    let folder = Folder::new("brdf-marked");
    let mut table = "theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,brdf_per_sr\n".to_owned();
    for theta_i in [0, 20, 40, 60] {
        for theta_o in [0, 20, 40, 60, 80] {
            for phi in [0, 45, 90, 135, 180] {
                let _ = writeln!(table, "{theta_i},0,{theta_o},{phi},0.1");
            }
        }
    }
    std::fs::write(folder.path("flat.csv"), table).unwrap();
    let shown = folder.json(&["brdf", "show", "flat.csv", "--wavelength-nm", "532", "--json"]);
    for row in shown["albedo"].as_array().unwrap() {
        let theta_i_deg = row["theta_i_deg"].as_f64().unwrap();
        assert_eq!(row["extrapolated"].as_bool(), Some(theta_i_deg > 60.5), "{row}");
        if theta_i_deg <= 60.0 {
            let albedo = row["albedo"].as_f64().unwrap();
            assert!((albedo / (0.1 * std::f64::consts::PI) - 1.0).abs() < 0.02, "{row}");
        }
    }
}

/// A table of `values` at five incidences, in and out of the plane.
fn simple_table(folder: &Folder, name: &str, values: impl Fn(f64, f64, f64) -> f64) {
    let mut text = String::from("theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,brdf_550nm_per_sr\n");
    for i in [0.0, 20.0, 40.0, 60.0] {
        for o in [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0] {
            for phi in [0.0, 90.0, 180.0] {
                text += &format!("{i},0,{o},{phi},{}\n", values(i, o, phi));
            }
        }
    }
    std::fs::write(folder.path(name), text).unwrap();
}

/// Truth: no number comes out of a table without light, and a person is told so in words; nor does a table have a factor of 1e320 between swapped directions (0.1 there, 1e-320 back) that a person could use.
#[test]
fn nothing_says_nan_or_inf() {
    let folder = Folder::new("lab-no-light");
    simple_table(&folder, "dark.csv", |_, _, _| 0.0);
    simple_table(&folder, "faint.csv", |i, o, _| if i > o { 1e-320 } else { 0.1 });
    let bad = |text: &str| {
        text.split(|c: char| !c.is_alphabetic()).any(|w| ["NaN", "nan", "inf"].contains(&w))
    };
    for name in ["dark.csv", "faint.csv"] {
        let output = folder.run(&["brdf", "show", name, "--wavelength-nm", "550"]);
        for text in [output.stdout, output.stderr] {
            let text = String::from_utf8(text).unwrap();
            assert!(!bad(&text), "{name}: {text}");
        }
    }
    let show = ["brdf", "show", "dark.csv", "--wavelength-nm", "550"];
    assert!(folder.done(&show).contains("swapped directions cannot be compared"));
    let json = folder.json(&[&show[..], &["--json"]].concat());
    assert!(json["reciprocity"]["median_ln"].is_null(), "{json}");
    assert!(json["reciprocity"]["why"].as_str().unwrap().contains("no two"), "{json}");
    folder.done(&["brdf", "page", "dark.csv", "--wavelength-nm", "550", "-o", "dark.html"]);
    let page = std::fs::read_to_string(folder.path("dark.html")).unwrap();
    assert!(!page.contains("factor of NaN") && page.contains("reflects nothing"));
    let few = "theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,brdf_550nm_per_sr\n30,0,0,180,0.10\n30,0,15,180,0.11\n30,0,30,180,0.13\n30,0,45,180,0.12\n";
    std::fs::write(folder.path("few.csv"), few).unwrap();
    let fit = ["brdf", "fit", "few.csv", "--law", "lambert"];
    let text = folder.done(&fit);
    assert!(!bad(&text), "{text}");
    let json = folder.json(&[&fit[..], &["--json"]].concat());
    let why = json["no_criterion"].as_str();
    assert_eq!(why.is_some(), json["laws"][0]["aicc"].is_null(), "{json}");
}

/// Truth: a Lambert law has no peak, the table's is 20 times as bright: no material is written, which the exit code says; all else is. With `--accept` it is. Without a folder nothing was to be written.
#[test]
fn a_material_that_is_not_written_is_a_failure() {
    let folder = Folder::new("lab-not-written");
    simple_table(&folder, "gloss.csv", |i, o, phi| {
        let off = if phi == 180.0 { i - o } else { i + o };
        0.05 + (-(off / 8.0_f64).powi(2)).exp()
    });
    let fit = ["brdf", "fit", "gloss.csv", "--law", "lambert"];
    let output = folder.run(&[&fit[..], &["-o", "a/"]].concat());
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("no material.toml is written") && said.contains("--accept"), "{said}");
    assert!(folder.path("a/fit.ecsv").exists() && !folder.path("a/material.toml").exists());
    folder.done(&[&fit[..], &["-o", "b/", "--accept"]].concat());
    assert!(folder.path("b/material.toml").exists());
    folder.done(&fit);
}

/// Truth: by hand: columns of uncertainties that have another name than the documented one, and σ of some values alone, are said; the documented ones are used, which the fitted value shows: three values about 0.1 with σ of 0.001 and three about 0.2 with σ of 0.1 are a Lambert
/// surface of their common geometric mean with equal weights, and of less with σ.
#[test]
fn uncertainties_are_used_or_said_not_to_be() {
    let folder = Folder::new("lab-sigma");
    let table = |name: &str, column: &str, sigma: [&str; 2]| {
        let mut text =
            format!("theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,brdf_550nm_per_sr{column}\n");
        for (k, o) in [5, 20, 35, 50, 60, 70].into_iter().enumerate() {
            let (value, sigma) = if k % 2 == 0 { (0.1, sigma[0]) } else { (0.2, sigma[1]) };
            // Equal largest values would be a saturated detector.
            let value = value * (1.0 + 0.01 * k as f64);
            text += &format!("30,0,{o},90,{value}{sigma}\n");
        }
        std::fs::write(folder.path(name), text).unwrap();
    };
    table("plain.csv", "", ["", ""]);
    table("known.csv", ",sigma_550nm_per_sr", [",0.001", ",0.1"]);
    table("some.csv", ",sigma_550nm_per_sr", [",0.001", ",0"]);
    table("other.csv", ",unc_550", [",0.001", ",0.1"]);
    let fit = |name: &str| {
        let arguments = ["brdf", "fit", name, "--law", "lambert", "--gaussian", "--json"];
        let output = folder.run(&arguments);
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let value = json["laws"][0]["parameters"][0]["value"].as_f64().unwrap();
        (value, String::from_utf8(output.stderr).unwrap())
    };
    let (plain, said) = fit("plain.csv");
    let product: f64 = (0..6).map(|k| 1.0 + 0.01 * f64::from(k)).product();
    let mean = 0.02_f64.sqrt() * product.powf(1.0 / 6.0);
    assert!((plain / (mean * std::f64::consts::PI) - 1.0).abs() < 1e-3, "{plain}");
    assert!(!said.contains("σ") && !said.contains("sigma"), "{said}");
    let (known, said) = fit("known.csv");
    assert!(known < 0.9 * plain && !said.contains("sigma"), "{known} {plain} {said}");
    let (some, said) = fit("some.csv");
    assert!(some == plain && said.contains("σ is missing or 0 for 3 of 6 values"), "{said}");
    let (other, said) = fit("other.csv");
    assert!(other == plain && said.contains("unc_550 is not read"), "{said}");
}
