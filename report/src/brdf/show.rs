//! Properties of a material, and the difference of two: text, summary, table, figure.

use crate::plot::{Axis, Figure, Panel, Series};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_formats::{Column, Table};
use sunglint_materials::look::{Look, Ratios, Slice};
use sunglint_materials::samples::direction;
use sunglint_numerics::order::median;
use sunglint_simulator::surface::Material;

#[derive(Serialize)]
struct AlbedoJson {
    theta_i_deg: f64,
    albedo: f64,
    extrapolated: bool,
}

#[derive(Serialize)]
struct ShownJson<'a> {
    name: &'a str,
    description: String,
    wavelength_nm: f64,
    albedo: Vec<AlbedoJson>,
    reciprocity: ReciprocityJson<'a>,
    warnings: &'a [String],
}

#[derive(Serialize)]
struct ReciprocityJson<'a> {
    median_ln: f64,
    largest_ln: f64,
    why: Option<&'a str>,
}

/// All forms of what a material does.
pub fn product(material: &Material, look: &Look, nm: f64, phi_i_deg: f64) -> Product {
    let Look { albedo, slices, reciprocity: (typical, most), .. } = look;
    let (typical, most) = (*typical, *most);
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
            Panel::new(angle(), Axis::linear("f cos θₒ over its largest"), normalised(slices)),
            Panel::new(
                Axis::linear("angle of incidence (deg)").from_to(0.0, 90.0),
                Axis::linear("hemispherical reflectance").from_to(0.0, 1.05_f64.max(1.05 * top)),
                hemisphere,
            ),
        ],
    };
    let albedo_json: Vec<_> = albedo
        .iter()
        .map(|(t, e)| {
            let extrapolated = is_extrapolated(material, *t, phi_i_deg);
            AlbedoJson { theta_i_deg: *t, albedo: rounded(*e), extrapolated }
        })
        .collect();
    let why = (!typical.is_finite()).then_some(NO_RECIPROCITY);
    let summary = json_of(&ShownJson {
        name: &material.name,
        description: material.describe(),
        wavelength_nm: nm,
        albedo: albedo_json,
        reciprocity: ReciprocityJson {
            median_ln: rounded(typical),
            largest_ln: rounded(most),
            why,
        },
        warnings: &look.warnings,
    });
    let all = || slices.iter().flat_map(|(t, points)| points.iter().map(move |p| (*t, *p)));
    let mut columns = vec![
        Column::f64("theta_i_deg", Some("deg"), all().map(|v| v.0).collect()),
        Column::f64("theta_o_deg", Some("deg"), all().map(|v| v.1.0).collect()),
        Column::f64("brdf_per_sr", Some("1 / sr"), all().map(|v| v.1.1).collect()),
    ];
    let doubt = |(theta, (angle, _)): (f64, (f64, f64))| {
        material.ln_doubt(direction(theta, phi_i_deg), direction(angle, phi_i_deg + 180.0))
    };
    let doubts: Vec<Option<f64>> = all().map(doubt).collect();
    if doubts.iter().any(Option::is_some) {
        let values = doubts.iter().map(|d| d.unwrap_or(f64::NAN)).collect();
        let column = Column::f64("ln_doubt", None, values);
        columns.push(column.described("half-width of the 95 % interval of ln f"));
    }
    let meta = [
        ("kind", "brdf_slices".into()),
        ("wavelength_nm", json_of(&nm)),
        ("phi_i_deg", json_of(&phi_i_deg)),
    ];
    let meta = meta.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
    Product {
        name: "show".into(),
        table: Table { meta, columns },
        figure: Some(figure),
        json: summary,
        ..Product::default()
    }
}

/// Whether a material does not know its mirrored direction at an incidence: it was not measured there, and what it reflects is a guess.
pub(super) fn is_extrapolated(material: &Material, theta_i_deg: f64, phi_i_deg: f64) -> bool {
    let (i, o) = (direction(theta_i_deg, phi_i_deg), direction(theta_i_deg, phi_i_deg + 180.0));
    !material.covers(i, o)
}

/// Said in the place of how swapped directions differ.
pub(super) const NO_RECIPROCITY: &str =
    "swapped directions cannot be compared: no two of them reflect both ways";

/// Returns the properties of a material as text.
pub fn text(material: &Material, look: &Look, phi_i_deg: f64) -> String {
    let Look { albedo, reciprocity: (typical, most), .. } = look;
    let mut text = format!("{}\n", material.describe());
    for (theta, e) in albedo {
        let guess = match is_extrapolated(material, *theta, phi_i_deg) {
            true => " (extrapolated: it was not measured there)",
            false => "",
        };
        let _ = writeln!(text, "{theta:4}° reflects {e:.5}{guess}");
    }
    let _ = match typical.is_finite() && most.is_finite() {
        true => writeln!(
            text,
            "swapped directions differ by a factor of {:.4} (median), {:.4} at most",
            typical.exp(),
            most.exp()
        ),
        false => writeln!(text, "{NO_RECIPROCITY}"),
    };
    text
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

#[derive(Serialize)]
struct RatioJson {
    theta_i_deg: f64,
    median_ratio: f64,
    farthest_ratio: f64,
    theta_o_deg: f64,
    phi_deg: f64,
    albedo_ratio: f64,
    directions: usize,
}

#[derive(Serialize)]
struct RatiosJson {
    wavelength_nm: f64,
    ratios: Vec<RatioJson>,
}

/// All forms of how two materials differ, and the text; `names` are those that a person gave.
pub fn compared(
    [a, b]: [&Material; 2],
    names: [&str; 2],
    rows: &[Ratios],
    nm: f64,
) -> (Product, String) {
    let mut text = format!(
        "{} over {}, at {nm} nm, where f cosθ exceeds 1e-3 of that in the mirrored direction\n",
        names[1], names[0]
    );
    let mut found = Vec::new();
    for row in rows.iter().filter(|r| !r.all.is_empty()) {
        let median = median(row.all.iter().map(|v| v.2)).unwrap_or(f64::NAN);
        let (theta_o, phi, most) = row.all[row.all.len() - 1];
        let _ = writeln!(
            text,
            "incidence {:4}°: median {median:.4}, farthest {most:.4} at θₒ = {theta_o:.2}°, azimuth {phi}° from the light's; hemispherical {:.4}",
            row.theta_i, row.albedo
        );
        found.push(RatioJson {
            theta_i_deg: row.theta_i,
            median_ratio: rounded(median),
            farthest_ratio: rounded(most),
            theta_o_deg: rounded(theta_o),
            phi_deg: phi,
            albedo_ratio: rounded(row.albedo),
            directions: row.all.len(),
        });
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
    let meta = [("kind", "brdf_ratios".into()), ("wavelength_nm", json_of(&nm))];
    let product = Product {
        name: "compare".into(),
        table: Table { meta: meta.into_iter().map(|(k, v)| (k.to_owned(), v)).collect(), columns },
        figure: Some(figure),
        json: json_of(&RatiosJson { wavelength_nm: nm, ratios: found }),
        ..Product::default()
    };
    (product, text)
}
