//! Fits as tables, and the chosen law as a material that a scene takes.

use super::{Fit, LawFit, LobeKind};
use crate::samples::Samples;
use serde_json::{Value, json};
use std::fmt::Write as _;
use sunglint_formats::toml::quoted;
use sunglint_formats::{Column, Meta, Table, Values};

fn text(name: &str, values: Vec<String>) -> Column {
    Column {
        name: name.into(),
        unit: None,
        description: None,
        values: Values::Text(values.into_iter().map(Some).collect()),
    }
}

/// A row for each parameter of each law, the most likely law first.
pub fn to_table(fit: &Fit) -> Table {
    let rows: Vec<_> =
        fit.laws.iter().flat_map(|law| law.parameters.iter().map(move |p| (law, p))).collect();
    let number = |name: &str, of: &dyn Fn(&(&LawFit, &super::Parameter)) -> f64| {
        Column::f64(name, None, rows.iter().map(of).collect())
    };
    let columns = vec![
        text("law", rows.iter().map(|(law, _)| law.law.name()).collect()),
        text("parameter", rows.iter().map(|(_, p)| p.name.to_owned()).collect()),
        number("value", &|(_, p)| p.value),
        number("least_95", &|(_, p)| p.interval.map_or(f64::NAN, |i| i.0)),
        number("most_95", &|(_, p)| p.interval.map_or(f64::NAN, |i| i.1)),
        Column {
            name: "at_bound".into(),
            unit: None,
            description: None,
            values: Values::Bool(rows.iter().map(|(_, p)| Some(p.at_bound)).collect()),
        },
        number("aicc", &|(law, _)| law.aicc),
        number("bic", &|(law, _)| law.bic),
        number("weight", &|(law, _)| law.weight),
        number("rms_ln", &|(law, _)| law.rms),
    ];
    let notes = fit.notes.iter().map(ToString::to_string);
    let notes: Vec<String> = notes.chain(fit.flaws.iter().map(ToString::to_string)).collect();
    let albedo = |law: &LawFit| -> Value {
        law.albedo.iter().map(|(deg, e)| json!({ "theta_i_deg": deg, "albedo": e })).collect()
    };
    let meta: Meta = [
        ("kind", json!("brdf_fit")),
        ("wavelength_nm", json!(fit.wavelength_nm)),
        ("values", json!(fit.used.len())),
        ("independent_values", json!(fit.independent)),
        ("left_out", json!(fit.left_out)),
        ("best", json!(fit.laws.first().map(|law| law.law.name()))),
        ("albedo", fit.laws.first().map_or(Value::Null, albedo)),
        ("notes", json!(notes)),
    ]
    .into_iter()
    .map(|(key, value)| (key.to_owned(), value))
    .collect();
    Table { meta, columns }
}

/// The values that were used with the best law's residuals (ln measured − ln law).
pub fn residual_table(fit: &Fit, samples: &Samples) -> Table {
    let rows: Vec<_> = fit.used.iter().map(|k| &samples.rows[*k]).collect();
    let column = samples.wavelength_nm.iter().position(|nm| *nm == fit.wavelength_nm);
    let column = column.unwrap_or(0);
    let deg = |name: &str, of: &dyn Fn(&crate::samples::Sample) -> f64| {
        Column::f64(name, Some("deg"), rows.iter().map(|r| of(r)).collect())
    };
    let measured: Vec<f64> = rows.iter().map(|r| r.brdf_per_sr[column]).collect();
    let mut columns = vec![
        deg("theta_i_deg", &|r| r.theta_i_deg),
        deg("phi_i_deg", &|r| r.phi_i_deg),
        deg("theta_o_deg", &|r| r.theta_o_deg),
        deg("phi_o_deg", &|r| r.phi_o_deg),
        Column::f64("brdf_per_sr", Some("1 / sr"), measured),
    ];
    if let Some(best) = fit.laws.first() {
        columns.push(Column::f64("residual_ln", None, best.residual.clone()));
    }
    let meta = [
        ("kind", json!("brdf_residuals")),
        ("wavelength_nm", json!(fit.wavelength_nm)),
        ("law", json!(fit.laws.first().map(|law| law.law.name()))),
    ];
    let meta = meta.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
    Table { meta, columns }
}

/// A law as `[[material]]` of a scene, grey: known at one wavelength. `index_name` is what Maxwell and Beard's law has as `refractive_index`.
pub fn to_toml(fit: &Fit, law: &LawFit, name: &str, index_name: Option<&str>) -> String {
    let p = law.values();
    let mut text = String::new();
    // A line each: none of them can end the comment.
    let flaws: String = fit
        .flaws
        .iter()
        .map(|f| format!("# {}\n", f.to_string().replace(char::is_control, " ")))
        .collect();
    let _ = writeln!(
        text,
        "# {} through {} values at {} nm, residuals of ln f {:.3} (rms); written by `sunglint brdf fit`.\n\
         # The reflectances are those of that wavelength.\n{flaws}[[material]]\nname = {}",
        law.law.name(),
        fit.used.len(),
        fit.wavelength_nm,
        law.rms,
        quoted(name)
    );
    let diffuse = law.parameters.iter().find(|p| p.name == "diffuse").map(|p| p.value);
    let under = |text: &mut String| {
        if let Some(value) = diffuse {
            let _ = writeln!(text, "diffuse = {{ reflectance = {value} }}");
        }
    };
    let alphas = |first: usize| {
        if law.law.anisotropic {
            format!("alpha_x = {}\nalpha_y = {}", p[first], p[first + 1])
        } else {
            format!("alpha = {}", p[first])
        }
    };
    match law.law.lobe {
        LobeKind::Lambert => {
            let _ = writeln!(text, "model = \"lambert\"\nreflectance = {}", p[0]);
        }
        LobeKind::Phong => {
            let _ =
                writeln!(text, "model = \"phong\"\nreflectance = {}\nexponent = {}", p[0], p[1]);
            under(&mut text);
        }
        LobeKind::Abg => {
            let _ = writeln!(
                text,
                "model = \"abg\"\na_per_sr = {}\nb = {}\ng = {}\nreflectance = 1.0",
                p[0], p[1], p[2]
            );
            under(&mut text);
        }
        LobeKind::Ward => {
            let _ = writeln!(text, "model = \"ward\"\nreflectance = {}\n{}", p[0], alphas(1));
            under(&mut text);
        }
        LobeKind::Beckmann | LobeKind::Ggx => {
            let kind = if law.law.lobe == LobeKind::Ggx { "ggx" } else { "beckmann" };
            let fresnel = if law.law.schlick { "schlick" } else { "constant" };
            let _ = writeln!(
                text,
                "model = \"cook_torrance\"\nreflectance = {}\nfresnel = \"{fresnel}\"",
                p[0]
            );
            under(&mut text);
            let _ = writeln!(
                text,
                "[[material.lobe]]\nshare = 1.0\ndistribution = \"{kind}\"\nmasking = \"separable\"\n{}",
                alphas(1)
            );
        }
        LobeKind::MaxwellBeard => {
            let _ = writeln!(
                text,
                "model = \"maxwell_beard\"\nbias_per_sr = {}\nsigma = {}\ntau_deg = {}\nomega_deg = {}\n\
                 refractive_index = {}\nvolume = {{ reflectance = {} }}",
                p[0],
                p[1],
                p[2],
                p[3],
                quoted(index_name.unwrap_or_default()),
                p[4]
            );
            under(&mut text);
        }
    }
    text
}
