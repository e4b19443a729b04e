//! Laws through measured values: text, summary, tables, figure.

use crate::plot::{Axis, Figure, Panel, Series};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_materials::fit::LeftOut;
use sunglint_materials::fit::surface::Flaw;
use sunglint_materials::fit::{Fit, LawFit, Rise, residual_table, to_table};
use sunglint_materials::samples::{Samples, direction, turned};
use sunglint_radiometry::light_curve::Input;

/// All forms of the result; `best` is the most likely law.
pub fn product(
    found: &Fit,
    best: &LawFit,
    measured: &Samples,
    rise: Option<&Rise>,
    inputs: &[Input],
) -> Product {
    let notes = found.notes.iter().map(ToString::to_string);
    let warnings: Vec<String> = notes.chain(found.flaws.iter().map(ToString::to_string)).collect();
    let mut table = to_table(found);
    table.meta.insert("inputs".into(), json_of(&inputs));
    Product {
        name: "fit".into(),
        figure: Some(figure(found, best, measured, rise)),
        json: summary(found, &warnings, inputs),
        table,
        others: vec![Product {
            name: "residuals".into(),
            table: residual_table(found, measured),
            ..Product::default()
        }],
        ..Product::default()
    }
}

/// The text, with the material as a scene takes it.
pub fn text(fit: &Fit, toml: &str) -> String {
    let mut text = String::new();
    let _ = writeln!(
        text,
        "{} values at {} nm; residuals of ln f, most likely law first",
        fit.used.len(),
        fit.wavelength_nm
    );
    let _ = writeln!(
        text,
        "{:<28} {:>8} {:>10} {:>10} {:>7}  largest albedo",
        "law", "rms", "AICc", "BIC", "weight"
    );
    for law in &fit.laws {
        let (deg, most) = largest(law);
        let held = if law.energy_held { ", held by energy" } else { "" };
        let known = |v: f64, text: String| if v.is_finite() { text } else { "-".to_owned() };
        let _ = writeln!(
            text,
            "{:<28} {:>8.4} {:>10} {:>10.1} {:>7}  {most:.4} at {deg}°{held}",
            law.law.name(),
            law.rms,
            known(law.aicc, format!("{:.1}", law.aicc)),
            law.bic,
            known(law.weight, format!("{:.3}", law.weight))
        );
    }
    if let Some(why) = no_criterion(fit) {
        let _ = writeln!(text, "- {why}");
    }
    if let Some(best) = fit.laws.first() {
        let _ = writeln!(text, "\n{}", best.law.name());
        for p in &best.parameters {
            let interval = match p.interval {
                Some((least, most)) => format!("{least:.5e} to {most:.5e} (95 %)"),
                None if p.at_bound => "at the end of its range".to_owned(),
                None => "not decided by the values".to_owned(),
            };
            let _ = writeln!(text, "  {:<12} {:<12.6e} {interval}", p.name, p.value);
        }
    }
    let _ = write!(text, "\n{toml}");
    text
}

/// Says why laws have no AICc, and perhaps none a weight.
fn no_criterion(fit: &Fit) -> Option<String> {
    let without = fit.laws.iter().filter(|law| !law.aicc.is_finite()).count();
    let order =
        if without == fit.laws.len() { ", and none has a weight: BIC orders them" } else { "" };
    (without > 0).then(|| {
        format!(
            "AICc is not defined for {without} of {}: {} values count as {:.1} that are independent, which must be two more than a law has parameters and its width{order}",
            fit.laws.len(),
            fit.used.len(),
            fit.independent
        )
    })
}

fn largest(law: &LawFit) -> (f64, f64) {
    law.albedo.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0.0, f64::NAN))
}

#[derive(Serialize)]
struct ParameterJson<'a> {
    name: &'a str,
    value: f64,
    sigma_ln: Option<f64>,
    interval: Option<[f64; 2]>,
    at_bound: bool,
}

#[derive(Serialize)]
struct LawJson<'a> {
    law: String,
    parameters: Vec<ParameterJson<'a>>,
    rms_ln: f64,
    width_ln: f64,
    correlation: f64,
    aicc: f64,
    bic: f64,
    weight: f64,
    largest_albedo: LargestAlbedo,
    energy_held: bool,
    faithful: bool,
    energy_to_deg: f64,
    converged: bool,
    above_zeros: Option<f64>,
}

#[derive(Serialize)]
struct LargestAlbedo {
    albedo: f64,
    theta_i_deg: f64,
}

#[derive(Serialize)]
struct FitJson<'a> {
    wavelength_nm: f64,
    values: usize,
    independent_values: f64,
    left_out: &'a LeftOut,
    flaws: &'a [Flaw],
    laws: Vec<LawJson<'a>>,
    no_criterion: Option<String>,
    warnings: &'a [String],
    inputs: &'a [Input],
}

fn summary(fit: &Fit, warnings: &[String], inputs: &[Input]) -> Value {
    let law = |law: &LawFit| {
        let parameters: Vec<_> = law
            .parameters
            .iter()
            .map(|p| ParameterJson {
                name: p.name,
                value: rounded(p.value),
                sigma_ln: p.sigma_ln.map(rounded),
                interval: p.interval.map(|(a, b)| [rounded(a), rounded(b)]),
                at_bound: p.at_bound,
            })
            .collect();
        let (theta_i_deg, most) = largest(law);
        LawJson {
            law: law.law.name(),
            parameters,
            rms_ln: rounded(law.rms),
            width_ln: rounded(law.width),
            correlation: rounded(law.correlation),
            aicc: rounded(law.aicc),
            bic: rounded(law.bic),
            weight: rounded(law.weight),
            largest_albedo: LargestAlbedo { albedo: rounded(most), theta_i_deg },
            energy_held: law.energy_held,
            faithful: law.is_faithful,
            energy_to_deg: law.energy_to_deg,
            converged: law.converged,
            above_zeros: law.above_zeros.map(rounded),
        }
    };
    json_of(&FitJson {
        wavelength_nm: fit.wavelength_nm,
        values: fit.used.len(),
        independent_values: rounded(fit.independent),
        left_out: &fit.left_out,
        flaws: &fit.flaws,
        laws: fit.laws.iter().map(law).collect(),
        no_criterion: no_criterion(fit),
        warnings,
        inputs,
    })
}

/// Angles of incidence that are drawn.
const MOST: usize = 6;

/// Values and law against the outgoing angle, and what is left.
fn figure(fit: &Fit, best: &LawFit, samples: &Samples, rise: Option<&Rise>) -> Figure {
    let column = samples.wavelength_nm.iter().position(|nm| *nm == fit.wavelength_nm).unwrap_or(0);
    let anisotropic = samples.has_azimuths();
    let mut incidences: Vec<(i64, i64)> = Vec::new();
    let key = |k: usize| {
        let row = &samples.rows[k];
        let phi = if anisotropic { (row.phi_i_deg * 1e3).round() as i64 } else { 0 };
        ((row.theta_i_deg.abs() * 1e3).round() as i64, phi)
    };
    for k in &fit.used {
        if !incidences.contains(&key(*k)) {
            incidences.push(key(*k));
        }
    }
    incidences.sort_unstable();
    let law = best.law.with(&best.values(), rise);
    let count = incidences.len();
    let shown: Vec<(i64, i64)> = if count > MOST {
        (0..MOST).map(|j| incidences[j * (count - 1) / (MOST - 1)]).collect()
    } else {
        incidences
    };
    let (mut values, mut lines, mut left) = (Vec::new(), Vec::new(), Vec::new());
    for (j, which) in shown.iter().enumerate() {
        let (mut dots, mut residual) = (Vec::new(), Vec::new());
        for (k, r) in fit.used.iter().zip(&best.residual) {
            if key(*k) != *which {
                continue;
            }
            let (i, o) = samples.rows[*k].directions();
            let (_, turned_o) = turned(i, o);
            let angle = turned_o.x.hypot(turned_o.y).atan2(turned_o.z).to_degrees();
            let signed = if turned_o.x > 0.0 { -angle } else { angle };
            if turned_o.y.abs() < 1e-3 {
                dots.push((signed, samples.rows[*k].brdf_per_sr[column]));
            }
            residual.push((signed, r.exp()));
        }
        let (theta, phi) = (which.0 as f64 / 1e3, which.1 as f64 / 1e3);
        let label = match anisotropic {
            true => format!("θᵢ = {theta}°, φᵢ = {phi}°"),
            false => format!("θᵢ = {theta}°"),
        };
        // Finer around the mirrored direction than lobes are wide.
        let mut angles: Vec<f64> = (-179..180).map(|k| 0.5 * f64::from(k)).collect();
        angles.extend(
            (-120..=120)
                .map(|k: i32| theta + f64::from(k.signum()) * 5e-3 * 1.06_f64.powi(k.abs())),
        );
        angles.retain(|a| a.abs() < 89.9);
        angles.sort_by(f64::total_cmp);
        let i = direction(theta, phi);
        let line = angles.iter().map(|a| (*a, law.brdf(i, direction(*a, phi + 180.0)))).collect();
        values.push(Series::dots(label, j, dots));
        lines.push(Series::line(String::new(), j, line));
        left.push(Series::dots(String::new(), j, residual));
    }
    let drawn = |s: &Series| s.points.iter().any(|p| p.1 > 0.0);
    let least = values.iter().flat_map(|s| &s.points).map(|p| p.1).fold(f64::INFINITY, f64::min);
    let all = lines.iter().chain(&values).flat_map(|s| &s.points).map(|p| p.1);
    let most = all.fold(0.0_f64, f64::max);
    let mut axis = Axis::log("f (sr⁻¹)");
    if least < most {
        axis = axis.from_to(0.3 * least, 3.0 * most);
    }
    values.retain(drawn);
    values.extend(lines);
    let angle =
        || Axis::linear("outgoing angle (deg), the mirrored side positive").from_to(-90.0, 90.0);
    Figure {
        title: format!(
            "{} at {} nm: {:.3} rms in ln f",
            best.law.name(),
            fit.wavelength_nm,
            best.rms
        ),
        panels: vec![
            Panel::new(angle(), axis, values),
            Panel::new(angle(), Axis::log("measured over law"), left),
        ],
    }
}
