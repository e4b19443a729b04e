//! A surface of several parts through measured values: text, tables, figure, JSON.

use crate::plot::{Axis, Figure, Panel, Series};
use crate::{Product, json_of, rounded};
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_formats::{Column, Table, Values};
use sunglint_materials::fit::LeftOut;
use sunglint_materials::fit::surface::colour::Coloured;
use sunglint_materials::fit::surface::{Number, SurfaceFit};
use sunglint_materials::samples::{Samples, direction, turned};
use sunglint_radiometry::light_curve::Input;

/// Recipes in the text.
const SHOWN: usize = 6;
/// Incidences in the figure.
const DRAWN: usize = 6;

/// All forms of the result. The JSON is the result.
///
/// # Errors
/// A result that is no JSON.
pub fn product(
    found: &SurfaceFit,
    measured: &Samples,
    inputs: &[Input],
) -> Result<Product, serde_json::Error> {
    let mut json = serde_json::to_value(found)?;
    shorten(&mut json);
    if let Value::Object(map) = &mut json {
        let warnings: Vec<String> = found.flaws.iter().map(ToString::to_string).collect();
        map.insert("warnings".into(), json_of(&warnings));
        map.insert("inputs".into(), json_of(&inputs));
    }
    let mut table = numbers(found);
    table.meta.insert("kind".into(), "brdf_fit".into());
    table.meta.insert("wavelength_nm".into(), json_of(&found.wavelength_nm));
    table.meta.insert("best".into(), json_of(&found.name));
    table.meta.insert("left_out".into(), json_of(&found.left_out));
    table.meta.insert("inputs".into(), json_of(&inputs));
    Ok(Product {
        name: "fit".into(),
        figure: Some(figure(found, measured)),
        json,
        table,
        others: vec![
            Product { name: "incidences".into(), table: incidences(found), ..Product::default() },
            Product {
                name: "residuals".into(),
                table: residuals(found, measured),
                ..Product::default()
            },
        ],
        ..Product::default()
    })
}

/// Numbers to the digits that they are worth.
fn shorten(value: &mut Value) {
    match value {
        Value::Number(n) if n.is_f64() => {
            if let Some(v) = n.as_f64() {
                *value = Value::from(rounded(v));
            }
        }
        Value::Array(all) => all.iter_mut().for_each(shorten),
        Value::Object(map) => map.values_mut().for_each(shorten),
        _ => {}
    }
}

fn key(number: &Number) -> String {
    number.lobe.map_or_else(|| number.name.to_owned(), |k| format!("lobe {k} {}", number.name))
}

fn text_column(name: &str, values: Vec<String>) -> Column {
    let values = Values::Text(values.into_iter().map(Some).collect());
    Column { name: name.into(), unit: None, description: None, values }
}

fn numbers(fit: &SurfaceFit) -> Table {
    let of = |f: &dyn Fn(&Number) -> f64| fit.numbers.iter().map(f).collect::<Vec<f64>>();
    let columns = vec![
        text_column("parameter", fit.numbers.iter().map(key).collect()),
        Column::f64("value", None, of(&|n| n.value)),
        Column::f64("least_95", None, of(&|n| n.interval.map_or(f64::NAN, |i| i.low))),
        Column::f64("most_95", None, of(&|n| n.interval.map_or(f64::NAN, |i| i.high))),
        Column {
            name: "at_bound".into(),
            unit: None,
            description: None,
            values: Values::Bool(fit.numbers.iter().map(|n| Some(n.at_bound)).collect()),
        },
    ];
    Table { columns, ..Table::default() }
}

fn incidences(fit: &SurfaceFit) -> Table {
    let all = &fit.incidences;
    let of = |f: &dyn Fn(&sunglint_materials::fit::surface::AtIncidence) -> f64| {
        all.iter().map(f).collect::<Vec<f64>>()
    };
    let columns = vec![
        Column::f64("theta_i_deg", Some("deg"), of(&|i| i.theta_i_deg)),
        Column::f64("rms_ln", None, of(&|i| i.rms_ln)),
        Column::f64("hemispherical_table", None, of(&|i| i.hemispherical_table)),
        Column::f64("hemispherical_ln_doubt", None, of(&|i| i.hemispherical_ln_doubt)),
        Column::f64("tis", None, of(&|i| i.tis.unwrap_or(f64::NAN)))
            .described("hemispherical reflectance that the file itself states"),
        Column::f64("hemispherical_ratio", None, of(&|i| i.hemispherical_ratio)),
        Column::f64(
            "peak_per_sr",
            Some("1 / sr"),
            of(&|i| i.peak.map_or(f64::NAN, |p| p.table_per_sr)),
        ),
        Column::f64("peak_ratio", None, of(&|i| i.peak.map_or(f64::NAN, |p| p.ratio))),
        Column::f64("albedo", None, of(&|i| i.albedo)),
        Column::f64("unseen_rms_ln", None, of(&|i| i.unseen.map_or(f64::NAN, |u| u.rms_ln))),
        Column::f64("unseen_inside", None, of(&|i| i.unseen.map_or(f64::NAN, |u| u.inside))),
    ];
    let meta = [("kind".to_owned(), "brdf_incidences".into())];
    Table { meta: meta.into_iter().collect(), columns }
}

fn residuals(fit: &SurfaceFit, samples: &Samples) -> Table {
    let rows: Vec<_> = fit.used.iter().map(|k| &samples.rows[*k]).collect();
    let column = samples.wavelength_nm.iter().position(|nm| *nm == fit.wavelength_nm).unwrap_or(0);
    let deg = |name: &str, of: &dyn Fn(&sunglint_materials::samples::Sample) -> f64| {
        Column::f64(name, Some("deg"), rows.iter().map(|r| of(r)).collect())
    };
    let columns = vec![
        deg("theta_i_deg", &|r| r.theta_i_deg),
        deg("phi_i_deg", &|r| r.phi_i_deg),
        deg("theta_o_deg", &|r| r.theta_o_deg),
        deg("phi_o_deg", &|r| r.phi_o_deg),
        Column::f64(
            "brdf_per_sr",
            Some("1 / sr"),
            rows.iter().map(|r| r.brdf_per_sr[column]).collect(),
        ),
        Column::f64("residual_ln", None, fit.residual.clone()),
    ];
    let meta = [
        ("kind".to_owned(), "brdf_residuals".into()),
        ("wavelength_nm".to_owned(), json_of(&fit.wavelength_nm)),
        ("law".to_owned(), json_of(&fit.name)),
    ];
    Table { meta: meta.into_iter().collect(), columns }
}

/// The colours of a surface's parts, as a table.
pub fn colour(colour: &Coloured) -> Product {
    let columns = vec![
        Column::f64("wavelength_nm", Some("nm"), colour.wavelength_nm.clone()),
        Column::f64("specular", None, colour.specular.clone())
            .described("reflectance of lobes and mirror over that at the wavelength of the fit"),
        Column::f64("diffuse", None, colour.diffuse.clone())
            .described("the same of the diffuse part"),
    ];
    let meta = [
        ("kind".to_owned(), "brdf_colour".into()),
        ("division".to_owned(), colour.division.to_string().into()),
        ("specular_share".to_owned(), Value::from(rounded(colour.specular_share))),
        ("most_apart_ln".to_owned(), Value::from(rounded(colour.most_apart_ln))),
    ];
    let table = Table { meta: meta.into_iter().collect(), columns };
    Product { name: "colour".into(), table, ..Product::default() }
}

/// The text, with the material as a scene takes it.
pub fn text(fit: &SurfaceFit, toml: &str) -> String {
    let mut text = String::new();
    let part = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.3}"));
    let doubt = |ln: f64, seen: Option<f64>| match seen {
        Some(_) => format!("{ln:.2}"),
        None => format!("{ln:.2} (nothing was measured there)"),
    };
    let _ = writeln!(
        text,
        "{} through {} values at {} nm, seen through {}° (detector) and {}° (source)",
        fit.name,
        fit.values,
        fit.wavelength_nm,
        (1e4 * fit.cone.detector_deg).round() / 1e4,
        (1e4 * fit.cone.source_deg).round() / 1e4
    );
    if let Some(it) = &fit.instrument {
        let _ = writeln!(
            text,
            "of the instrument all values share {:.2} % (scale) and {:.1e} /sr; both are in doubt and intervals",
            100.0 * it.scale_sigma,
            it.common_additive_per_sr
        );
        for what in &it.missing {
            let _ = writeln!(text, "not measured: {what}");
        }
    }
    if fit.left_out != LeftOut::default() {
        let _ = writeln!(text, "{}", fit.left_out);
    }
    let _ = writeln!(
        text,
        "residuals of ln f (rms): {:.3}; peak {}, wings {}, grazing {}",
        fit.rms_ln.all,
        part(fit.rms_ln.peak),
        part(fit.rms_ln.wings),
        part(fit.rms_ln.grazing)
    );
    let _ = writeln!(
        text,
        "doubt of ln f (95 %, from incidences left out): peak {}, wings {}, grazing {}\n",
        doubt(fit.doubt.peak_ln, fit.rms_ln.peak),
        doubt(fit.doubt.wings_ln, fit.rms_ln.wings),
        doubt(fit.doubt.grazing_ln, fit.rms_ln.grazing)
    );
    let _ = writeln!(
        text,
        "{:>9} {:>7} {:>7} {:>14} {:>8} {:>12} {:>6} {:>9}  left out: rms, inside",
        "incidence",
        "values",
        "rms",
        "hemispherical",
        "law/tab",
        "peak (1/sr)",
        "law/tab",
        "albedo"
    );
    for i in &fit.incidences {
        let (peak, ratio) = i.peak.map_or(("-".into(), "-".into()), |p| {
            (format!("{:.4}", p.table_per_sr), format!("{:.2}", p.ratio))
        });
        let unseen = i.unseen.map_or_else(String::new, |u| {
            let outer = if u.extrapolated { ", extrapolated" } else { "" };
            format!("{:.3}, {:.0} %{outer}", u.rms_ln, 100.0 * u.inside)
        });
        let known = |v: f64, text: String| if v.is_nan() { "-".to_owned() } else { text };
        let hemispherical = known(i.hemispherical_table, format!("{:.4}", i.hemispherical_table));
        let of_law = known(i.hemispherical_ratio, format!("{:.2}", i.hemispherical_ratio));
        let _ = writeln!(
            text,
            "{:>8}° {:>7} {:>7.3} {hemispherical:>14} {of_law:>8} {peak:>12} {ratio:>6} {:>9.4}  {unseen}",
            i.theta_i_deg, i.values, i.rms_ln, i.albedo
        );
    }
    let _ = writeln!(
        text,
        "\n{:<44} {:>10} {:>8} {:>9}  left out",
        "recipe", "parameters", "rms", "cost"
    );
    for t in fit.tried.iter().take(SHOWN) {
        let left = t.left_out.map_or_else(|| "-".to_owned(), |s| format!("{s:.4}"));
        let _ = writeln!(
            text,
            "{:<44} {:>10} {:>8.4} {:>9.4}  {left}",
            t.recipe, t.parameters, t.rms_ln, t.cost
        );
    }
    let _ = writeln!(text);
    for n in &fit.numbers {
        let interval = match n.interval {
            _ if n.at_bound => "at the end of its range".to_owned(),
            Some(i) => format!("{:.4e} to {:.4e} (95 %)", i.low, i.high),
            None => "not decided by the values".to_owned(),
        };
        let _ = writeln!(text, "  {:<22} {:<12.5e} {interval}", key(n), n.value);
    }
    let _ = write!(text, "\n{toml}");
    text
}

/// Values and law against the outgoing angle, and what is left.
fn figure(fit: &SurfaceFit, samples: &Samples) -> Figure {
    let column = samples.wavelength_nm.iter().position(|nm| *nm == fit.wavelength_nm).unwrap_or(0);
    let count = fit.incidences.len();
    let shown: Vec<f64> = if count > DRAWN {
        (0..DRAWN).map(|j| fit.incidences[j * (count - 1) / (DRAWN - 1)].theta_i_deg).collect()
    } else {
        fit.incidences.iter().map(|i| i.theta_i_deg).collect()
    };
    let (mut values, mut lines, mut left) = (Vec::new(), Vec::new(), Vec::new());
    for (j, theta) in shown.iter().enumerate() {
        let (mut dots, mut residual) = (Vec::new(), Vec::new());
        for (k, r) in fit.used.iter().zip(&fit.residual) {
            let row = &samples.rows[*k];
            if (row.theta_i_deg.abs() - theta).abs() > 1e-3 {
                continue;
            }
            let (i, o) = row.directions();
            let o = turned(i, o).1;
            let angle = o.x.hypot(o.y).atan2(o.z).to_degrees();
            let signed = if o.x > 0.0 { -angle } else { angle };
            if o.y.abs() < 2e-3 {
                dots.push((signed, row.brdf_per_sr[column]));
            }
            residual.push((signed, r.exp()));
        }
        let mut angles: Vec<f64> = (-170..=170).map(|k| 0.5 * f64::from(k)).collect();
        angles.extend(
            (-120..=120)
                .map(|k: i32| theta + f64::from(k.signum()) * 5e-3 * 1.06_f64.powi(k.abs())),
        );
        angles.retain(|a| a.abs() < 89.0);
        angles.sort_by(f64::total_cmp);
        let i = direction(*theta, 0.0);
        let seen = |a: &f64| (*a, fit.seen(i, direction(*a, 180.0), &fit.cone));
        values.push(Series::dots(format!("θᵢ = {theta}°"), j, dots));
        lines.push(Series::line(String::new(), j, angles.iter().map(seen).collect()));
        left.push(Series::dots(String::new(), j, residual));
    }
    values.retain(|s| !s.points.is_empty());
    let least = values.iter().flat_map(|s| &s.points).map(|p| p.1).fold(f64::INFINITY, f64::min);
    let all = lines.iter().chain(&values).flat_map(|s| &s.points).map(|p| p.1);
    let most = all.fold(0.0_f64, f64::max);
    let mut axis = Axis::log("f (sr⁻¹)");
    if least < most {
        axis = axis.from_to(0.3 * least, 3.0 * most);
    }
    values.extend(lines);
    let angle =
        || Axis::linear("outgoing angle (deg), the mirrored side positive").from_to(-90.0, 90.0);
    Figure {
        title: format!(
            "{} at {} nm: {:.3} rms in ln f",
            fit.name, fit.wavelength_nm, fit.rms_ln.all
        ),
        panels: vec![
            Panel::new(angle(), axis, values),
            Panel::new(angle(), Axis::log("measured over law"), left),
        ],
    }
}
