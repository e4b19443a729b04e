//! `sunglint analyse unmix` and `map` on simulated curves whose light is known in closed form.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::{Folder, SPHERE_PASS};
use std::f64::consts::PI;
use sunglint_formats::ecsv;

/// Intensity of a Lambert sphere of 0.5 m, m² sr⁻¹ at a reflectance of 1.
fn sphere(phase_deg: f64) -> f64 {
    let g = phase_deg.to_radians();
    0.25 * 2.0 / (3.0 * PI) * (g.sin() + (PI - g) * g.cos())
}

fn scene() -> String {
    format!(
        "{SPHERE_PASS}[attitude]\nlaw = \"spin\"\naxis_body = [0, 0, 1]\naxis_gcrs = [0, 0, 1]\nperiod_s = 50\nepoch_utc = 2008-09-21T18:45:00Z\n[effects]\nearthshine = \"off\"\nsolar_disc = \"off\"\n"
    )
}

fn table(folder: &Folder, file: &str) -> sunglint_formats::Table {
    ecsv::read_str(file, &std::fs::read_to_string(folder.path(file)).unwrap()).unwrap()
}

/// Truth: the Lambert sphere's closed form: its weight is R² 2/(3π)(sin γ + (π − γ) cos γ) at the curve's phase angles, through the air and at its range; there is nothing of the other materials.
/// Tolerance: 1e-5 of the weight, the tables of the air in simulation and unmixing.
#[test]
fn a_white_sphere_is_white() {
    let folder = Folder::new("unmix");
    std::fs::write(folder.path("pass.toml"), scene()).unwrap();
    folder.done(&["simulate", "pass.toml", "-o", "out/", "-q"]);
    let names: Vec<String> = std::fs::read_dir(folder.path("out"))
        .unwrap()
        .map(|f| f.unwrap().file_name().into_string().unwrap())
        .collect();
    let find = |end: &str| format!("out/{}", names.iter().find(|n| n.ends_with(end)).unwrap());
    let curve = {
        let is_curve = |n: &&String| {
            n.ends_with(".ecsv")
                && std::fs::read_to_string(folder.path(&format!("out/{n}")))
                    .unwrap()
                    .contains("_rate_hz")
        };
        format!("out/{}", names.iter().find(is_curve).unwrap())
    };
    let phases = table(&folder, &curve).f64("phase_deg").unwrap().to_vec();
    for (input, options) in [
        (curve.as_str(), &["--station", "ufo"][..]),
        (curve.as_str(), &["--pass", "pass.toml"]),
        (&find("_spectra.fits"), &[]),
    ] {
        let unmix = [
            "analyse",
            "unmix",
            input,
            "--endmembers",
            "white,solar_cell,mli",
            "--unweighted",
            "-o",
            "m.ecsv",
            "--force",
            "-q",
        ];
        // The air of the scene is the station's own.
        folder.done(&[&unmix[..], options].concat());
        let found = table(&folder, "m.ecsv");
        let weights = found.f64("white_weight").unwrap();
        let projected = found.f64("white_projected").unwrap();
        let others = found.f64("mli_weight").unwrap();
        let mut seen = 0;
        let all = weights.iter().zip(projected.iter()).zip(others.iter()).zip(&phases);
        for (((weight, projected), other), phase) in all {
            if weight.is_nan() {
                continue;
            }
            // White light of several alike endmembers: what is 0 to the bounds may be a little below it.
            assert!((projected / weight - 1.0).abs() < 1e-2, "{input}: {projected} {weight}");
            seen += 1;
            // Without the scene the Sun's distance is the Earth's: 3e-4.
            let tolerance = if options.first() == Some(&"--station") { 4e-4 } else { 3e-5 };
            assert!(
                (weight / sphere(*phase) - 1.0).abs() < tolerance,
                "{input}: {weight} {}",
                sphere(*phase)
            );
            assert!(*other < 1e-4 * weight);
        }
        assert!(seen > 5, "{input} {seen}");
    }
    // Figures, and all that a folder gets.
    folder.done(&[
        "analyse",
        "unmix",
        &curve,
        "--endmembers",
        "white,mli",
        "--station",
        "ufo",
        "-o",
        "f/",
        "-q",
    ]);
    assert!(
        ["materials.ecsv", "materials.png", "materials.svg"]
            .iter()
            .all(|f| folder.path("f").join(f).exists())
    );
    let summary = folder.json(&[
        "analyze",
        "unmix",
        &curve,
        "--endmembers",
        "white,mli",
        "--station",
        "ufo",
        "--json",
    ]);
    assert!(summary["endmembers"][0]["mean_share"].as_f64().unwrap() > 0.999);

    // What cannot be done is refused with its reason.
    let refused = |list: &str, code: i32| {
        folder
            .refused(code, &["analyse", "unmix", &curve, "--endmembers", list, "--station", "ufo"])
    };
    assert!(refused("white,whit", 1).contains("did you mean white"));
    assert!(refused("grey80,unit", 1).contains("one spectrum"));
    assert!(refused("white,white", 1).contains("given twice"));
    std::fs::write(folder.path("black.csv"), "wavelength_nm,soot,zero\n300,0.03,0\n1200,0.05,0\n")
        .unwrap();
    assert!(refused("black.csv", 1).contains("zero reflects nothing"));
    std::fs::write(folder.path("wide.csv"), "wavelength_nm,a,b,c,d,e,f,g\n300,.1,.2,.3,.4,.5,.6,.1\n500,.9,.2,.1,.5,.1,.2,.1\n700,.2,.9,.2,.1,.1,.3,.8\n900,.1,.1,.9,.3,.7,.2,.4\n1100,.3,.1,.2,.9,.2,.8,.6\n").unwrap();
    let many = folder.run(&[
        "analyse",
        "unmix",
        &curve,
        "--endmembers",
        "wide.csv",
        "--station",
        "ufo",
        "--json",
    ]);
    let words = String::from_utf8_lossy(&many.stderr);
    assert!(words.contains("6 channels for 7 endmembers"), "{words}");
    let text = std::fs::read_to_string(folder.path(&curve)).unwrap();
    std::fs::write(folder.path("linear.ecsv"), text.replace("predicted", "linear")).unwrap();
    let linear = ["analyse", "unmix", "linear.ecsv", "--endmembers", "white", "--station", "ufo"];
    assert!(folder.refused(1, &linear).contains("sunglint apply"));
}

/// Truth: the Lambert sphere's closed form again. Over all directions its map is R² f(γ) in every cell; a curve from the map of the mean phase angle errs by f(γ̄)/f(γ) − 1, nothing else; samples on the body
/// have the reflection factor ρ R² f(γ).
/// Tolerance: 1e-8 for maps; 3e-3 for the curve, whose map has the reflectance over a channel above the air, and for samples, whose reflectance over a channel is that through their own air; both change with
/// the zenith angle.
#[test]
fn a_sphere_is_the_same_all_over() {
    let folder = Folder::new("map");
    std::fs::write(folder.path("pass.toml"), scene()).unwrap();
    let map = ["analyse", "map", "pass.toml", "--step-deg", "15"];
    let at = folder.json(&[&map[..], &["--phase", "30", "--json"]].concat());
    let of = |summary: &serde_json::Value, quantity: &str, key: &str| {
        let maps = summary["maps"].as_array().unwrap().clone();
        let one = maps.iter().find(|m| m["quantity"] == quantity).unwrap();
        one[key].as_f64().unwrap()
    };
    assert!((of(&at, "weight", "largest") / sphere(30.0) - 1.0).abs() < 1e-8);
    assert_eq!((of(&at, "weight", "coverage"), of(&at, "weight", "empty_cells")), (1.0, 0.0));

    folder.done(&["simulate", "pass.toml", "-o", "c.ecsv", "-q"]);
    let curve = table(&folder, "c.ecsv");
    let phases = curve.f64("phase_deg").unwrap().to_vec();
    let track = folder.json(&[&map[..], &["--along", "-o", "t/", "--json"]].concat());
    let mean = track["phase_deg"].as_f64().unwrap();
    let found = table(&folder, "t/track.ecsv");
    let (direct, short) =
        (found.f64("g_direct_rate_hz").unwrap(), found.f64("g_map_rate_hz").unwrap());
    let mut errors = Vec::new();
    for i in 0..phases.len() {
        // In the Earth's shadow both are 0.
        if short[i].is_finite() && direct[i] > 0.0 {
            let truth = sphere(mean) / sphere(phases[i]);
            assert!(
                (short[i] / direct[i] / truth - 1.0).abs() < 3e-3,
                "{} {truth}",
                short[i] / direct[i]
            );
            errors.push((truth - 1.0).abs());
        }
    }
    errors.sort_by(f64::total_cmp);
    let said = track["shortcut"][0]["median_error"].as_f64().unwrap();
    let middle = errors[((errors.len() - 1) as f64 * 0.5).round() as usize];
    assert!((said - middle).abs() < 3e-3, "{said} {middle}");
    assert!(
        ["track.png", "body_map.fits", "body_map.png"]
            .iter()
            .all(|f| folder.path("t").join(f).exists())
    );

    let placed = folder.json(
        &[&map[..], &["--curve", "c.ecsv", "--endmembers", "white,mli", "-o", "s/", "--json"]]
            .concat(),
    );
    let found = table(&folder, "s/track.ecsv");
    let factors = found.f64("g_factor").unwrap();
    let first = (0..phases.len()).find(|i| factors[*i].is_finite()).unwrap();
    for i in 0..phases.len() {
        if factors[i].is_finite() {
            let ratio = factors[i] / factors[first] * sphere(phases[first]) / sphere(phases[i]);
            assert!((ratio - 1.0).abs() < 3e-3, "{ratio}");
        }
    }
    assert!(
        of(&placed, "factor", "filled_cells") >= 1.0 && of(&placed, "factor", "coverage") < 0.5
    );
    let filled = of(&placed, "factor", "filled_cells") + of(&placed, "factor", "empty_cells");
    assert_eq!(filled, 12.0 * 24.0);
    assert!((of(&placed, "share", "largest") - 1.0).abs() < 1e-4);

    // Without an attitude nothing has a place on the body; a map is no table.
    std::fs::write(folder.path("still.toml"), SPHERE_PASS).unwrap();
    assert!(folder.refused(1, &["analyse", "map", "still.toml"]).contains("no [attitude]"));
    assert!(
        folder.refused(2, &["analyse", "map", "pass.toml", "-o", "m.ecsv"]).contains("no table")
    );
    assert!(
        folder.refused(2, &["analyse", "map", "pass.toml", "--phase", "180"]).contains("--phase")
    );
    assert!(
        folder.refused(1, &["analyse", "map", "pass.toml", "--step-deg", "0"]).contains("0.1°")
    );
}

/// A cube of three colours on the demonstration's pass, turning about a tilted axis in 20 s.
fn cube(folder: &Folder) {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let demo = std::fs::read_to_string(root.join("fixtures/scenes/box_wing_dusk.toml")).unwrap();
    let colours = [
        ("rising", "[0.1, 0.3, 0.9]", "[\"+x\", \"+z\"]"),
        ("falling", "[0.8, 0.5, 0.2]", "[\"-x\", \"-y\"]"),
        ("humped", "[0.2, 0.7, 0.1]", "[\"+y\", \"-z\"]"),
    ];
    let mut target = String::from("name = \"cube\"\n");
    let mut table = String::from("wavelength_nm,rising,falling,humped\n");
    for (name, values, faces) in colours {
        target += &format!(
            "[[material]]\nname = \"{name}\"\nmodel = \"lambert\"\nreflectance_table = {{ wavelength_nm = [300, 700, 1200], reflectance = {values} }}\n\
             [[part]]\nname = \"{name}\"\nshape = \"box\"\nsize_m = [0.7, 0.7, 0.7]\nfaces = {faces}\nmaterial = \"{name}\"\n"
        );
    }
    for (nm, values) in [(300, "0.1,0.8,0.2"), (700, "0.3,0.5,0.7"), (1200, "0.9,0.2,0.1")] {
        table += &format!("{nm},{values}\n");
    }
    std::fs::write(folder.path("cube.toml"), target).unwrap();
    std::fs::write(folder.path("colours.csv"), table).unwrap();
    let scene = demo
        .replace("built_in = \"box_wing\"", "file = \"cube.toml\"")
        .replace("period_s = 120.0", "period_s = 20.0")
        .replace("axis_body = [0.0, 0.0, 1.0]", "axis_body = [0.3, 0.5, 0.8]")
        .replace("step_s = 0.5", "step_s = 0.7");
    let effects = "[effects]\nearthshine = \"off\"\nsolar_disc = \"off\"\nmoonshine = \"off\"\n";
    std::fs::write(folder.path("pass.toml"), format!("{scene}{effects}")).unwrap();
}

/// Truth: the three spectra that the cube was painted with, of which the program is told nothing: found, they differ from them in scale alone. Tolerance: 1e-4°, rounding; the bins of both are means
/// of the same tables. Then the file of what was found serves `unmix`, and leaves nothing over.
#[test]
fn colours_are_found_that_nobody_named() {
    let folder = Folder::new("endmembers");
    cube(&folder);
    folder.done(&["simulate", "pass.toml", "-o", "out/", "-q"]);
    let find = |end: &str| {
        let files = std::fs::read_dir(folder.path("out")).unwrap().flatten();
        let names = files.map(|f| f.file_name().into_string().unwrap());
        format!("out/{}", names.filter(|n| n.ends_with(end)).min().unwrap())
    };
    let spectra = find("_spectra.fits");
    let search = ["analyse", "endmembers", &spectra, "--against", "colours.csv", "--noise", "1e-9"];
    let found = folder.json(&[&search[..], &["--json"]].concat());
    let all = found["endmembers"].as_array().unwrap();
    let mut names: Vec<&str> = all.iter().map(|e| e["nearest"]["name"].as_str().unwrap()).collect();
    names.sort_unstable();
    assert_eq!(names, ["falling", "humped", "rising"], "{found}");
    for one in all {
        assert!(one["nearest"]["angle_deg"].as_f64().unwrap() < 1e-4, "{one}");
    }
    folder.done(&[&search[..], &["-o", "found.ecsv", "-o", "found.png", "-q"]].concat());
    let unmix = ["analyse", "unmix", &spectra, "--endmembers", "found.ecsv", "--json"];
    let unmixed = folder.json(&unmix);
    // The found spectra are means over bins, taken as points that lines join: 2e-3 at the tables' kinks.
    assert!(unmixed["median_residual_relative"].as_f64().unwrap() < 2e-3, "{unmixed}");

    // A curve whose noise is as large as its light, and a level that is none.
    let refused = folder.run(&["analyse", "endmembers", &spectra, "--noise", "1.5"]);
    assert_eq!(refused.status.code(), Some(1));
    let words = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(words.contains("expected a share from 0 to below 1"), "{words}");
}

/// Truth: the paint. Light that was made of three colours and is taken apart into them is no other's: the confusion is above 0.94 on every diagonal (thesis figure 8.4), from spectra and from six channels. With
/// two names exchanged in the file of colours the two are taken for one another, and the third is not; less than a tenth does not show it, where a sample has as much of one as of the other.
#[test]
fn what_is_taken_for_what_is_told() {
    let folder = Folder::new("confusion");
    cube(&folder);
    folder.done(&["simulate", "pass.toml", "-o", "out/", "-q"]);
    let names: Vec<String> = std::fs::read_dir(folder.path("out"))
        .unwrap()
        .map(|f| f.unwrap().file_name().into_string().unwrap())
        .collect();
    let spectra = names.iter().find(|n| n.ends_with("_spectra.fits")).unwrap();
    let rates = names.iter().filter(|n| n.ends_with(".ecsv"));
    let rates = rates.min_by_key(|n| n.len()).unwrap();
    let table = std::fs::read_to_string(folder.path("colours.csv")).unwrap();
    let exchanged = table.replace("rising,falling", "falling,rising");
    std::fs::write(folder.path("exchanged.csv"), exchanged).unwrap();
    let matrix = |input: &str, colours: &str| {
        let input = format!("out/{input}");
        let unmix = ["analyse", "unmix", &input, "--endmembers", colours, "--pass", "pass.toml"];
        let told = folder.json(&[&unmix[..], &["--confusion", "--json"]].concat());
        let told = told["confusion"].clone();
        assert_eq!(told["materials"].as_array().unwrap().len(), 3, "{told}");
        let number = |i: usize, j: usize| told["matrix"][i][j].as_f64().unwrap();
        let matrix: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| number(i, j)));
        (matrix, told["worst"].as_f64().unwrap())
    };
    for input in [spectra, rates] {
        let (found, worst) = matrix(input, "cube.toml");
        assert!((0..3).all(|i| found[i][i] > 0.94) && worst > 0.94, "{input}: {found:?}");
        let (found, worst) = matrix(input, "exchanged.csv");
        // The order is that of the file: falling, rising, humped.
        assert!(found[0][1] > 0.9 && found[1][0] > 0.9 && found[2][2] > 0.94, "{found:?}");
        assert!(worst < 0.1, "{worst}");
    }
    let input = format!("out/{rates}");
    let wrong = ["analyse", "unmix", &input, "--endmembers", "white", "--pass", "pass.toml"];
    let words = folder.refused(1, &[&wrong[..], &["--confusion"]].concat());
    assert!(words.contains("has no material white (it has rising"), "{words}");
    folder.refused(2, &["analyse", "unmix", &input, "--endmembers", "white", "--confusion"]);
}

/// Truth: the spin of the scene, 5 s: the measure is smallest near it. Tolerance: 0.3 %, the part by which the bisector's turn of a quarter in 96 turns changes the period; tried are 1 % to either side. The axis
/// is not told by one pass, and nothing is asserted of it.
#[test]
fn the_frame_of_a_spin_shows_its_period() {
    let folder = Folder::new("quality");
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let demo = std::fs::read_to_string(root.join("fixtures/scenes/box_wing_dusk.toml")).unwrap();
    let scene =
        demo.replace("period_s = 120.0", "period_s = 5.0").replace("step_s = 0.5", "step_s = 0.2");
    let effects = "[effects]\nearthshine = \"off\"\nsolar_disc = \"off\"\nmoonshine = \"off\"\ninter_reflection = \"off\"\n";
    std::fs::write(folder.path("pass.toml"), format!("{scene}{effects}")).unwrap();
    folder.done(&["simulate", "pass.toml", "-o", "c.ecsv", "-q"]);
    let map = ["analyse", "map", "pass.toml", "--curve", "c.ecsv", "--quality"];
    let options = ["--period", "5.01", "--axes-deg", "30", "-o", "q/", "--json"];
    let found = folder.json(&[&map[..], &options].concat());
    let best = &found["best"];
    let period = best["period_s"].as_f64().unwrap();
    assert!((period / 5.0 - 1.0).abs() < 3e-3, "{found}");
    assert!(best["theta"].as_f64().unwrap() < 0.3, "{found}");
    for file in ["spin_quality.fits", "spin_quality.png"] {
        assert!(folder.path("q").join(file).exists(), "{file}");
    }
    folder.refused(2, &["analyse", "map", "pass.toml", "--quality", "--period", "5"]);
    folder.refused(2, &map);
    folder.refused(2, &[&map[..], &["--period", "0"]].concat());
    let wide = [&map[..], &["--period", "5", "--within-percent", "60"]].concat();
    assert!(folder.refused(2, &wide).contains("expected 0 to 50"));
    // Nothing is visited twice in less than a turn.
    let long = folder.refused(1, &[&map[..], &["--period", "2000", "--axes-deg", "45"]].concat());
    assert!(long.contains("no cell of 5° is visited by two turns"), "{long}");
}
