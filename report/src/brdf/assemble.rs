//! Measured values and densities as a material: text, summary, tables.

use crate::{json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_formats::text::counted;
use sunglint_formats::{Column, Table, Values};
use sunglint_materials::assemble::files::Assembly;
use sunglint_materials::assemble::{Assembled, Doubt};
use sunglint_materials::instrument::TableInstrument;
use sunglint_materials::plan::Planned;
use sunglint_numerics::order::median;
use sunglint_radiometry::light_curve::Input;

fn table_of(kind: &str, columns: Vec<Column>, inputs: &[Input]) -> Table {
    let meta = [("kind", json_of(&kind)), ("inputs", json_of(&inputs))];
    Table { meta: meta.into_iter().map(|(k, v)| (k.to_owned(), v)).collect(), columns }
}

/// Directions of a plan that were not measured.
pub fn missing_table(missing: &[Planned], inputs: &[Input]) -> Table {
    let degrees = |name: &str, of: &dyn Fn(&Planned) -> f64| {
        Column::f64(name, Some("deg"), missing.iter().map(of).collect())
    };
    let columns = vec![
        Column::i64("step", None, missing.iter().map(|p| p.step as i64).collect()),
        degrees("theta_i_deg", &|p| p.theta_i_deg),
        degrees("phi_i_deg", &|p| p.phi_i_deg),
        degrees("theta_o_deg", &|p| p.theta_o_deg),
        degrees("phi_o_deg", &|p| p.phi_o_deg),
    ];
    table_of("brdf_missing", columns, inputs)
}

/// Doubts about the material, direction by direction.
pub fn doubts(made: &Assembled, inputs: &[Input]) -> Table {
    let d = &made.doubts;
    let degrees = |name: &str, of: &dyn Fn(&Doubt) -> f64| {
        Column::f64(name, Some("deg"), d.iter().map(of).collect())
    };
    let columns = vec![
        degrees("theta_i_deg", &|d| d.theta_i_deg),
        degrees("phi_i_deg", &|d| d.phi_i_deg),
        degrees("theta_o_deg", &|d| d.theta_o_deg),
        degrees("phi_o_deg", &|d| d.phi_o_deg),
        Column {
            name: "extrapolated".into(),
            unit: None,
            description: None,
            values: Values::Bool(d.iter().map(|d| Some(d.extrapolated)).collect()),
        },
        Column::f64("ln_doubt", None, d.iter().map(|d| d.ln_doubt).collect())
            .described("f may be off by this factor's logarithm; 0 where it was measured"),
    ];
    table_of("brdf_doubts", columns, inputs)
}

/// Table of what is measured and what is extrapolated, by direction of the light.
pub fn table(made: &Assembled, inputs: &[Input]) -> Table {
    let c = &made.coverage;
    let number = |name: &str, unit: Option<&str>, of: &dyn Fn(usize) -> f64| {
        Column::f64(name, unit, (0..c.len()).map(of).collect())
    };
    let columns = vec![
        number("theta_i_deg", Some("deg"), &|k| c[k].theta_i_deg),
        number("phi_i_deg", Some("deg"), &|k| c[k].phi_i_deg),
        Column::i64("cells", None, c.iter().map(|c| c.cells as i64).collect()),
        number("extrapolated_cells", None, &|k| c[k].extrapolated_cells),
        number("albedo", None, &|k| c[k].albedo),
        number("extrapolated_albedo", None, &|k| c[k].extrapolated_albedo),
        number("albedo_doubt", None, &|k| c[k].albedo_doubt),
        number("largest_albedo", None, &|k| c[k].largest_albedo),
        number("lowered", None, &|k| c[k].lowered),
    ];
    table_of("brdf_coverage", columns, inputs)
}

#[derive(Serialize)]
struct CoverageJson {
    planned: usize,
    missing: usize,
    unplanned: usize,
}

#[derive(Serialize)]
struct SliceJson {
    theta_i_deg: f64,
    phi_i_deg: f64,
    cells: usize,
    extrapolated_cells: f64,
    albedo: f64,
    extrapolated_albedo: f64,
    largest_albedo: f64,
    albedo_doubt: f64,
    lowered: f64,
}

#[derive(Serialize)]
struct BaseJson {
    wavelength_nm: f64,
    specular: f64,
    diffuse: f64,
    rms_ln: f64,
}

#[derive(Serialize)]
struct AssembledJson<'a> {
    used: usize,
    unused: usize,
    coverage: Vec<SliceJson>,
    base: Vec<BaseJson>,
    instrument: &'a Option<TableInstrument>,
    warnings: &'a [String],
    inputs: &'a [Input],
    plan: Option<CoverageJson>,
}

/// Summary with its documented keys.
pub fn summary(found: &Assembly) -> Value {
    let Assembly { made, samples, inputs, .. } = found;
    let plan = found.plan.as_ref().map(|plan| CoverageJson {
        planned: plan.planned,
        missing: plan.missing.len(),
        unplanned: plan.unplanned,
    });
    let coverage: Vec<_> = made
        .coverage
        .iter()
        .map(|c| SliceJson {
            theta_i_deg: rounded(c.theta_i_deg),
            phi_i_deg: rounded(c.phi_i_deg),
            cells: c.cells,
            extrapolated_cells: rounded(c.extrapolated_cells),
            albedo: rounded(c.albedo),
            extrapolated_albedo: rounded(c.extrapolated_albedo),
            largest_albedo: rounded(c.largest_albedo),
            albedo_doubt: rounded(c.albedo_doubt),
            lowered: rounded(c.lowered),
        })
        .collect();
    let base: Vec<_> = samples
        .wavelength_nm
        .iter()
        .zip(&made.base)
        .map(|(nm, b)| BaseJson {
            wavelength_nm: *nm,
            specular: rounded(b.specular),
            diffuse: rounded(b.diffuse),
            rms_ln: rounded(b.rms),
        })
        .collect();
    json_of(&AssembledJson {
        used: made.used,
        unused: made.left_out,
        coverage,
        base,
        instrument: &made.instrument,
        warnings: &made.warnings,
        inputs,
        plan,
    })
}

/// The text.
pub fn text(made: &Assembled) -> String {
    let mut text = format!("{}\n", counted(made.used, "direction"));
    let worst = made.base.iter().map(|b| b.rms).fold(0.0, f64::max);
    let _ = writeln!(
        text,
        "what the NDF and a Lambert term say of them is off by a factor of {:.3} (rms)",
        worst.exp()
    );
    if let Some(it) = &made.instrument {
        let _ = writeln!(
            text,
            "of the instrument all values share {:.2} % (scale), which is in the doubts; {}",
            100.0 * it.scale_sigma,
            match it.blur_rad() {
                blur if blur > 0.0 => format!(
                    "its cone and source of {:.3}° are taken back, which is in the doubts, too",
                    blur.to_degrees()
                ),
                _ => "its cone and source are not known".to_owned(),
            }
        );
        let (left, zero) = (it.shared_per_sr(1.0), it.zero_sigma_deg);
        if left > 0.0 || zero > 0.0 {
            let _ = writeln!(
                text,
                "so are {left:.1e} /sr over cosθ_o that dark and stray light may leave, and zeros that are known to {zero:.4}°"
            );
        }
        for what in &it.missing {
            let _ = writeln!(text, "not measured: {what}");
        }
    }
    let _ = writeln!(
        text,
        "incidence   cells  extrapolated: of cells, of the albedo   albedo, off by up to"
    );
    let step = (made.coverage.len() / 12).max(1);
    for c in made.coverage.iter().step_by(step) {
        let azimuth = if c.phi_i_deg == 0.0 {
            String::new()
        } else {
            format!(", azimuth {:.1}°", c.phi_i_deg)
        };
        let lowered = if c.lowered < 1.0 {
            format!(", extrapolated ones lowered to {:.3} for energy", c.lowered)
        } else {
            String::new()
        };
        let _ = writeln!(
            text,
            "{:8.2}° {:7}  {:21.1} % {:14.1} %  {:7.4} {:8.1} %{azimuth}{lowered}",
            c.theta_i_deg,
            c.cells,
            100.0 * c.extrapolated_cells,
            100.0 * c.extrapolated_albedo,
            c.albedo,
            100.0 * c.albedo_doubt
        );
    }
    let beyond: Vec<&Doubt> = made.doubts.iter().filter(|d| d.extrapolated).collect();
    if let Some(worst) = beyond.iter().max_by(|a, b| a.ln_doubt.total_cmp(&b.ln_doubt)) {
        let half = median(beyond.iter().map(|d| d.ln_doubt)).unwrap_or(f64::NAN);
        let _ = writeln!(
            text,
            "{} of {} directions all around are extrapolated: half of them may be off by a factor of {:.2} or more, the worst by {:.2} (light at {:.0}°, seen from {:.0}°, azimuths {:.0}° apart)",
            beyond.len(),
            made.doubts.len(),
            half.exp(),
            worst.ln_doubt.exp(),
            worst.theta_i_deg,
            worst.theta_o_deg,
            (worst.phi_o_deg - worst.phi_i_deg).rem_euclid(360.0)
        );
    }
    text
}
