//! `sunglint brdf show` and `sunglint brdf compare`: what a material does, and how two differ.

use super::samples;
use crate::output::{Console, OutputArgs};
use anyhow::Context as _;
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::Path;
use sunglint_formats::toml::Document;
use sunglint_formats::{Column, Table};
use sunglint_materials::samples::direction;
use sunglint_report::plot::{Axis, Figure, Panel, Series};
use sunglint_report::{Product, rounded};
use sunglint_simulator::surface::brdf_table::{self, Row};
use sunglint_simulator::surface::file::{MaterialFile, material};
use sunglint_simulator::surface::{Material, measured};

/// Angles of incidence that are shown, degrees.
const INCIDENCES: [f64; 6] = [0.0, 15.0, 30.0, 45.0, 60.0, 75.0];
/// Angles at which the hemispherical reflectance is asked, degrees.
const HEMISPHERE: [f64; 12] =
    [0.0, 15.0, 30.0, 40.0, 50.0, 60.0, 70.0, 75.0, 80.0, 84.0, 87.0, 89.0];

/// Arguments of `sunglint brdf show`.
#[derive(Debug, Args)]
pub struct ShowArgs {
    /// A material: .bsdf, a TOML with one [[material]] (or `FILE#NAME`), or a table of measured values
    #[arg(value_name = "FILE")]
    pub file: String,
    /// The wavelength
    #[arg(long, value_name = "NM")]
    pub wavelength_nm: f64,
    /// Azimuth of the light, of a material with a tangent
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    pub phi_i_deg: f64,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Arguments of `sunglint brdf compare`.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// A material, as `show` takes it
    #[arg(value_name = "A")]
    pub a: String,
    /// Another
    #[arg(value_name = "B")]
    pub b: String,
    /// The wavelength
    #[arg(long, value_name = "NM")]
    pub wavelength_nm: f64,
    /// Azimuth of the light, of a material with a tangent
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    pub phi_i_deg: f64,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

#[derive(Debug, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct MaterialsFile {
    material: Vec<MaterialFile>,
}

/// An angle of incidence with f by outgoing angle.
type Slice = (f64, Vec<(f64, f64)>);

/// A material from what a person names.
fn read(name: &str, wavelength_nm: f64) -> anyhow::Result<Material> {
    let (file, wanted) = match name.rsplit_once('#') {
        Some((file, wanted)) => (file, Some(wanted)),
        None => (name, None),
    };
    let path = Path::new(file);
    let is = |extension: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension));
    if is("bsdf") {
        return Ok(measured::read(file, path)?);
    }
    if is("toml") {
        let document = Document::read(path)?;
        let found: MaterialsFile = document.parse()?;
        let names: Vec<&str> = found.material.iter().map(|m| m.name.as_str()).collect();
        let at = match wanted {
            Some(wanted) => names.iter().position(|n| *n == wanted),
            None => Some(0).filter(|_| names.len() == 1),
        };
        let at = at.with_context(|| {
            format!("{file}: found the materials {}; say which: {file}#NAME", names.join(", "))
        })?;
        let key = format!("material[{at}]");
        return Ok(material(&document, &key, &found.material[at])?.0);
    }
    let (table, _) = samples(path, Some(wavelength_nm))?;
    let rows: Vec<Row> = table
        .rows
        .iter()
        .map(|r| Row {
            theta_i_deg: r.theta_i_deg,
            phi_i_deg: r.phi_i_deg,
            theta_o_deg: r.theta_o_deg,
            phi_o_deg: r.phi_o_deg,
            brdf_per_sr: r.brdf_per_sr.clone(),
        })
        .collect();
    Ok(brdf_table::material(file, &table.wavelength_nm, &rows, None)?)
}

/// What is to be said of a wavelength that a material's spectra do not reach.
fn beyond(material: &Material, nm: f64) -> Option<String> {
    let ranges = || material.spectra().iter().map(|s| s.range_nm());
    let from = ranges().map(|r| r.0).fold(f64::NEG_INFINITY, f64::max);
    let to = ranges().map(|r| r.1).fold(f64::INFINITY, f64::min);
    let is_within = nm >= from && nm <= to;
    (!is_within).then(|| {
        format!(
            "{}: it is known from {from} to {to} nm, not at {nm} nm: the nearest value is held",
            material.name
        )
    })
}

/// Outgoing angles of a slice: finer around the mirrored direction.
fn angles(theta_i: f64) -> Vec<f64> {
    let mut all: Vec<f64> = (-88..=88).map(f64::from).collect();
    all.extend(
        (-90..=90).map(|k: i32| theta_i + f64::from(k.signum()) * 0.01 * 1.07_f64.powi(k.abs())),
    );
    all.retain(|a| a.abs() <= 89.0);
    all.sort_by(f64::total_cmp);
    all
}

/// The typical and largest |ln f(i, o)/f(o, i)| over directions of both kinds.
fn reciprocity(material: &Material, nm: f64) -> (f64, f64) {
    let mut found = Vec::new();
    for (k, theta_i) in INCIDENCES.iter().enumerate() {
        for theta_o in INCIDENCES.iter().skip(k + 1) {
            for phi in [0.0, 45.0, 90.0, 135.0, 180.0] {
                let (i, o) = (direction(theta_i + 3.0, 0.0), direction(*theta_o + 3.0, phi));
                let (there, back) = (material.brdf(nm, i, o), material.brdf(nm, o, i));
                if there > 0.0 && back > 0.0 {
                    found.push((there / back).ln().abs());
                }
            }
        }
    }
    found.sort_by(f64::total_cmp);
    match found.len() {
        0 => (f64::NAN, f64::NAN),
        n => (found[n / 2], found[n - 1]),
    }
}

pub(super) fn show(args: &ShowArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let nm = args.wavelength_nm;
    let material = read(&args.file, nm)?;
    anyhow::ensure!(!material.is_mirror(), "{}: a perfect mirror has no values to show", args.file);
    let mut warnings: Vec<String> = material.notes().to_vec();
    warnings.extend(beyond(&material, nm));
    let mut albedo = Vec::new();
    for theta in HEMISPHERE {
        albedo.push((theta, material.albedo(nm, direction(theta, args.phi_i_deg))?));
    }
    for (theta, e) in albedo.iter().filter(|(_, e)| *e > 1.0 + 1e-3) {
        warnings.push(format!("it reflects {e:.4} of the light at {theta}° of incidence"));
    }
    let (typical, most) = reciprocity(&material, nm);
    for warning in &warnings {
        console.warn(warning);
    }
    let slice = |theta: f64| -> Vec<(f64, f64)> {
        let i = direction(theta, args.phi_i_deg);
        let of = |a: &f64| (*a, material.brdf(nm, i, direction(*a, args.phi_i_deg + 180.0)));
        angles(theta).iter().map(of).collect()
    };
    let slices: Vec<Slice> = INCIDENCES.iter().map(|t| (*t, slice(*t))).collect();
    let label = |t: &f64| format!("θᵢ = {t}°");
    let lines = |of: &dyn Fn(&(f64, f64)) -> f64| -> Vec<Series> {
        let line = |(k, (t, points)): (usize, &Slice)| {
            Series::line(label(t), k, points.iter().map(|p| (p.0, of(p))).collect())
        };
        slices.iter().enumerate().map(line).collect()
    };
    let peak = slices.iter().flat_map(|s| &s.1).map(|p| p.1).fold(0.0_f64, f64::max);
    let least =
        slices.iter().flat_map(|s| &s.1).map(|p| p.1).filter(|v| *v > 0.0).fold(peak, f64::min);
    let f_axis = Axis::log("f (sr⁻¹)").from_to(least.max(1e-9 * peak) * 0.5, 2.0 * peak.max(1e-12));
    let angle =
        || Axis::linear("outgoing angle (deg), the mirrored side positive").from_to(-90.0, 90.0);
    let hemisphere = vec![Series::line("", 0, albedo.clone()), Series::dots("", 0, albedo.clone())];
    let top = albedo.iter().map(|a| a.1).fold(0.0_f64, f64::max);
    let figure = Figure {
        title: format!("{} at {nm} nm", material.name),
        panels: vec![
            Panel::new(angle(), f_axis, lines(&|p| p.1)),
            Panel::new(angle(), Axis::linear("f cos θₒ over its largest"), normalised(&slices)),
            Panel::new(
                Axis::linear("angle of incidence (deg)").from_to(0.0, 90.0),
                Axis::linear("hemispherical reflectance").from_to(0.0, 1.05_f64.max(1.05 * top)),
                hemisphere,
            ),
        ],
    };
    let albedo_json: Vec<Value> =
        albedo.iter().map(|(t, e)| json!({ "theta_i_deg": t, "albedo": rounded(*e) })).collect();
    let summary = json!({
        "name": material.name, "description": material.describe(), "wavelength_nm": nm, "albedo": albedo_json,
        "reciprocity": { "median_ln": rounded(typical), "largest_ln": rounded(most) }, "warnings": warnings,
    });
    let mut text = format!("{}\n", material.describe());
    for (theta, e) in &albedo {
        let _ = writeln!(text, "{theta:4}° reflects {e:.5}");
    }
    let _ = writeln!(
        text,
        "swapped directions differ by a factor of {:.4} (median), {:.4} at most",
        typical.exp(),
        most.exp()
    );
    let all = || slices.iter().flat_map(|(t, points)| points.iter().map(move |p| (*t, *p)));
    let columns = vec![
        Column::f64("theta_i_deg", Some("deg"), all().map(|v| v.0).collect()),
        Column::f64("theta_o_deg", Some("deg"), all().map(|v| v.1.0).collect()),
        Column::f64("brdf_per_sr", Some("1 / sr"), all().map(|v| v.1.1).collect()),
    ];
    let meta = [
        ("kind", json!("brdf_slices")),
        ("wavelength_nm", json!(nm)),
        ("phi_i_deg", json!(args.phi_i_deg)),
    ];
    let meta = meta.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
    let product = Product {
        name: "show".into(),
        table: Table { meta, columns },
        figure: Some(figure),
        json: summary,
        ..Product::default()
    };
    args.out.finish(&product, &text, console)
}

/// Lobes: f cosθ_o of each slice over its largest.
fn normalised(slices: &[Slice]) -> Vec<Series> {
    let line = |(k, (_, points)): (usize, &Slice)| {
        let lit: Vec<(f64, f64)> =
            points.iter().map(|(a, f)| (*a, f * a.to_radians().cos())).collect();
        let most = lit.iter().map(|p| p.1).fold(f64::MIN_POSITIVE, f64::max);
        Series::line("", k, lit.iter().map(|p| (p.0, p.1 / most)).collect())
    };
    slices.iter().enumerate().map(line).collect()
}

/// Ratios at one angle of incidence.
struct Ratios {
    theta_i: f64,
    /// Angle and azimuth of the outgoing direction (from the light's), ratio b/a.
    all: Vec<(f64, f64, f64)>,
}

pub(super) fn compare(args: &CompareArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let nm = args.wavelength_nm;
    let (a, b) = (read(&args.a, nm)?, read(&args.b, nm)?);
    for said in [&a, &b].into_iter().filter_map(|material| beyond(material, nm)) {
        console.warn(&said);
    }
    for (name, m) in [(&args.a, &a), (&args.b, &b)] {
        anyhow::ensure!(!m.is_mirror(), "{name}: a perfect mirror has no values to compare");
        for note in m.notes() {
            console.warn(&format!("{name}: {note}"));
        }
    }
    let mut rows = Vec::new();
    for theta_i in INCIDENCES {
        let i = direction(theta_i, args.phi_i_deg);
        let mirrored = direction(theta_i, args.phi_i_deg + 180.0);
        let peak = a.brdf(nm, i, mirrored) * mirrored.z;
        let mut all = Vec::new();
        for phi in [0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 165.0, 175.0, 180.0] {
            for theta_o in angles(theta_i).into_iter().filter(|t| (0.0..=85.0).contains(t)) {
                let o = direction(theta_o, args.phi_i_deg + phi);
                let (f, g) = (a.brdf(nm, i, o), b.brdf(nm, i, o));
                if f > 0.0 && g > 0.0 && f * o.z > 1e-3 * peak {
                    all.push((theta_o, phi, g / f));
                }
            }
        }
        all.sort_by(|x, y| x.2.ln().abs().total_cmp(&y.2.ln().abs()));
        rows.push(Ratios { theta_i, all });
    }
    anyhow::ensure!(
        rows.iter().any(|r| !r.all.is_empty()),
        "the two have no direction in common in which both reflect"
    );
    let mut text = format!(
        "{} over {}, at {nm} nm, where f cosθ exceeds 1e-3 of that in the mirrored direction\n",
        args.b, args.a
    );
    let mut found = Vec::new();
    for row in rows.iter().filter(|r| !r.all.is_empty()) {
        let mut sorted: Vec<f64> = row.all.iter().map(|v| v.2).collect();
        sorted.sort_by(f64::total_cmp);
        let median = sorted[sorted.len() / 2];
        let (theta_o, phi, most) = row.all[row.all.len() - 1];
        let i = direction(row.theta_i, args.phi_i_deg);
        let (x, y) = (a.albedo(nm, i)?, b.albedo(nm, i)?);
        let _ = writeln!(
            text,
            "incidence {:4}°: median {median:.4}, farthest {most:.4} at θₒ = {theta_o:.2}°, azimuth {phi}° from the light's; hemispherical {:.4}",
            row.theta_i,
            y / x
        );
        found.push(json!({
            "theta_i_deg": row.theta_i, "median_ratio": rounded(median), "farthest_ratio": rounded(most),
            "theta_o_deg": rounded(theta_o), "phi_deg": phi, "albedo_ratio": rounded(y / x), "directions": row.all.len(),
        }));
    }
    let all = || rows.iter().flat_map(|r| r.all.iter().map(move |v| (r.theta_i, *v)));
    let columns = vec![
        Column::f64("theta_i_deg", Some("deg"), all().map(|v| v.0).collect()),
        Column::f64("theta_o_deg", Some("deg"), all().map(|v| v.1.0).collect()),
        Column::f64("phi_deg", Some("deg"), all().map(|v| v.1.1).collect()),
        Column::f64("ratio", None, all().map(|v| v.1.2).collect()),
    ];
    let dots = |(k, r): (usize, &Ratios)| {
        let at = |v: &(f64, f64, f64)| (if v.1 < 90.0 { -v.0 } else { v.0 }, v.2);
        Series::dots(format!("θᵢ = {}°", r.theta_i), k, r.all.iter().map(at).collect())
    };
    let figure = Figure {
        title: format!("{} over {} at {nm} nm", b.name, a.name),
        panels: vec![Panel::new(
            Axis::linear("outgoing angle (deg), negative on the light's side"),
            Axis::log("ratio"),
            rows.iter().enumerate().map(dots).collect(),
        )],
    };
    let meta = [("kind", json!("brdf_ratios")), ("wavelength_nm", json!(nm))];
    let product = Product {
        name: "compare".into(),
        table: Table { meta: meta.into_iter().map(|(k, v)| (k.to_owned(), v)).collect(), columns },
        figure: Some(figure),
        json: json!({ "wavelength_nm": nm, "ratios": found }),
        ..Product::default()
    };
    args.out.finish(&product, &text, console)
}
