//! Tables in and out.

use crate::ndf::truth::{Shape, Truth, noisy};
use sunglint_formats::ecsv;
use sunglint_materials::ndf::{NdfOptions, extract, from_table, to_table};
use sunglint_materials::table::{RetroFlags, RetroTable};

/// Truth: what was written.
#[test]
fn an_ndf_comes_back() {
    let run = noisy(&Truth::isotropic(Shape::Ggx, 0.2, 0.9).run(1.0, 0.3), 0.01, 1);
    let options = NdfOptions { resamplings: 20, ..NdfOptions::default() };
    let mut ndf = extract(&run, &options).unwrap();
    let text = ecsv::to_string(&to_table(&ndf)).unwrap();
    let back = from_table("ndf.ecsv", &ecsv::read_str("ndf.ecsv", &text).unwrap()).unwrap();
    ndf.notes.clear();
    let close =
        |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12 * b.abs());
    assert!(close(&back.theta_rad, &ndf.theta_rad) && back.density == ndf.density);
    assert_eq!(
        (back.f0, back.f0_sigma, back.f0_bound, back.flags, back.profiles, back.convergence),
        (
            ndf.f0,
            ndf.f0_sigma,
            ndf.f0_bound,
            ndf.flags.clone(),
            ndf.profiles.clone(),
            ndf.convergence
        )
    );
    let mut other = to_table(&ndf);
    other.meta.insert("kind".into(), "light_curve".into());
    let wrong = from_table("n.ecsv", &other).unwrap_err().to_string();
    assert!(wrong.contains("kind: found `light_curve`, expected `ndf`"), "{wrong}");
    let mut other = to_table(&ndf);
    other.columns[1].name = "e_per_sr".into();
    let wrong = from_table("n.ecsv", &other).unwrap_err().to_string();
    assert!(wrong.contains("d_per_sr: found no such column"), "{wrong}");
    let mut other = to_table(&ndf);
    other.columns[0] = sunglint_formats::Column::f64("theta_deg", None, vec![1.0; 128]);
    let wrong = from_table("n.ecsv", &other).unwrap_err().to_string();
    assert!(wrong.contains("elevations that increase"), "{wrong}");
}

const RUN: &str = "# %ECSV 1.0
# ---
# datatype:
# - {name: angle_deg, datatype: float64, unit: deg}
# - {name: f_per_sr, datatype: float64, unit: 1 / sr}
# - {name: sigma_f_per_sr, datatype: float64, unit: 1 / sr}
# - {name: flags, datatype: int64}
# meta: {kind: retro_reflection, wavelength_nm: 632.8, cone_half_angle_deg: 0.5, scale_sigma: 0.01, flag_bits: {over_range: 0, edge: 5}}
angle_deg f_per_sr sigma_f_per_sr flags
-1.0 2.0 0.1 0
0.0 nan nan 1
1.0 2.0 0.1 32
";

fn read(text: &str) -> Result<RetroTable, String> {
    let table = ecsv::read_str("run.ecsv", text).unwrap();
    RetroTable::from_table("run.ecsv", &table).map_err(|e| e.to_string())
}

/// Truth: by hand.
#[test]
fn a_run_from_its_file() {
    let run = read(RUN).unwrap();
    assert_eq!(run.wavelength_nm, Some(632.8));
    assert_eq!((run.cone_half_angle_deg, run.scale_sigma), (Some(0.5), 0.01));
    let flags: Vec<RetroFlags> = run.readings.iter().map(|r| r.flags).collect();
    assert_eq!(flags, [RetroFlags::empty(), RetroFlags::OVER_RANGE, RetroFlags::EDGE]);
    for (from, to, words) in [
        ("retro_reflection", "ndf", "run.ecsv: kind: found `ndf`, expected `retro_reflection`"),
        ("nan nan 1", "nan nan 0", "f_per_sr: found NaN in row 2, expected a number, or a flag"),
        ("-1.0 2.0 0.1 0", "-91.0 2.0 0.1 0", "angle_deg: found -91 in row 1, expected an angle"),
        ("2.0 0.1 0", "2.0 -0.1 0", "sigma_f_per_sr: found -0.1 in row 1"),
        ("2.0 0.1 32", "2.0 0.1 64", "flags: found 64 in row 3"),
        ("edge: 5", "egde: 5", "flag_bits: found the flag `egde`"),
        ("unit: 1 / sr", "unit: W", "f_per_sr: found the unit W"),
        ("wavelength_nm: 632.8", "wavelength_nm: -1", "wavelength_nm: found -1"),
    ] {
        let error = read(&RUN.replacen(from, to, 1)).unwrap_err();
        assert!(error.contains(words), "{error}");
    }
}

/// Truth: by hand. What a run states of cone, zero and laser; what makes no sense is refused by its key.
#[test]
fn a_run_states_its_rig() {
    let stated = "retro_reflection, cone_spread_deg: {along_deg: 0.17, across_deg: 0.1}, scale_sigma_by: {incident: 0.003, solid_angle: 0.01}, zero_deg: 0.7, zero_sigma_deg: 0.5, zero_origin: assumed";
    let text = RUN.replacen("retro_reflection", stated, 1);
    let run = read(&text).unwrap();
    let spread = run.cone_spread.unwrap();
    assert_eq!((spread.along_deg, spread.across_deg, run.cone_sigma), (0.17, 0.1, 0.01));
    let zero = run.zero.unwrap();
    assert_eq!((zero.angle_deg, zero.sigma_deg), (0.7, 0.5));
    assert_eq!(zero.origin, sunglint_materials::ndf::ZeroOrigin::Assumed);
    // Without times and the laser's part of the uncertainties its readings say nothing.
    assert_eq!(run.laser, None);
    let bare = read(RUN).unwrap();
    assert_eq!((bare.cone_spread, bare.zero, bare.cone_sigma), (None, None, 0.0));
    for (from, to, words) in [
        ("across_deg: 0.1", "across_deg: -0.1", "cone_spread_deg: found 0.17 and -0.1"),
        (", across_deg: 0.1", "", "cone_spread_deg: found {"),
        ("solid_angle: 0.01", "solid_angle: -0.01", "scale_sigma_by: found -0.01"),
        ("zero_deg: 0.7", "zero_deg: 97", "zero_deg: found 97"),
        ("zero_sigma_deg: 0.5", "zero_sigma_deg: -1", "zero_sigma_deg: found -1"),
        ("assumed", "guessed", "zero_origin: found \"guessed\""),
    ] {
        let error = read(&text.replacen(from, to, 1)).unwrap_err();
        assert!(error.contains(words), "{error}");
    }
}

/// Truth: by hand. Without metadata flags go by their names.
#[test]
fn a_run_as_plain_columns() {
    let text = "angle_deg,f_per_sr,flags\n0,1.5,\n1,,over_range\n2,0.7,edge outliers\n";
    let read = |text: &str| {
        let table = sunglint_formats::text_table::read_str("run.csv".as_ref(), text).unwrap();
        RetroTable::from_table("run.csv", &table).map_err(|e| e.to_string())
    };
    let run = read(text).unwrap();
    let flags: Vec<RetroFlags> = run.readings.iter().map(|r| r.flags).collect();
    let both = RetroFlags::EDGE | RetroFlags::OUTLIERS;
    assert_eq!(flags, [RetroFlags::empty(), RetroFlags::OVER_RANGE, both]);
    assert_eq!((run.readings[0].f_per_sr, run.readings[0].sigma_f_per_sr), (1.5, 0.0));
    let error = read(&text.replace("edge", "egde")).unwrap_err();
    assert!(
        error.contains("flags: found `egde` in row 3, expected names of flags: over_range"),
        "{error}"
    );
}

/// Angles in radians, as four decimals or in full, are refused; a narrow lobe scanned by hundredths of a degree is not.
#[test]
fn radians_are_not_degrees() {
    let table = |angles: &[f64]| {
        let text: String = angles.iter().map(|a| format!("{a},1\n")).collect();
        let header = "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: angle_deg, unit: deg, datatype: float64}\n# - {name: f_per_sr, unit: 1 / sr, datatype: float64}\n# delimiter: ','\nangle_deg,f_per_sr\n";
        let table = ecsv::read_str("t.ecsv", &format!("{header}{text}")).unwrap();
        RetroTable::from_table("t.ecsv", &table)
    };
    let degrees: Vec<f64> = (-20..=130).map(|k| 0.5 * f64::from(k)).collect();
    assert_eq!(table(&degrees).unwrap().readings.len(), 151);
    let full: Vec<f64> = degrees.iter().map(|a| a.to_radians()).collect();
    let cut: Vec<f64> = full.iter().map(|a| (a * 1e4).round() / 1e4).collect();
    for radians in [full, cut] {
        let said = table(&radians).unwrap_err().to_string();
        assert!(said.contains("-10.0° to 65.0°") && said.contains("degrees"), "{said}");
    }
    for step in [0.01, 0.02, 0.005] {
        let narrow: Vec<f64> = (-20..=70).map(|k| step * f64::from(k)).collect();
        assert!(table(&narrow).is_ok(), "{step}");
    }
}
