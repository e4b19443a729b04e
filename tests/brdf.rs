//! `sunglint brdf`: from a table of retro-reflection to a plan, through files.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod common;

use common::Folder;
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
