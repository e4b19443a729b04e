//! `sunglint brdf assemble`: measured values and densities as a material.

use super::{ndf, samples};
use crate::output::{Console, OutputArgs, Usage};
use anyhow::Context as _;
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::PathBuf;
use sunglint_formats::{Column, Table, Values};
use sunglint_materials::assemble::{AssembleOptions, Assembled, Doubt, assemble};
use sunglint_materials::plan::{Planned, missing, planned};
use sunglint_materials::samples::Samples;
use sunglint_report::{Product, rounded};
use sunglint_simulator::surface::measured;

/// Arguments of `sunglint brdf assemble`.
#[derive(Debug, Args)]
pub struct AssembleArgs {
    /// Measured values, as `sunglint brdf ingest` writes them
    #[arg(value_name = "SAMPLES")]
    pub samples: PathBuf,
    /// The sample's NDF, as `sunglint brdf ndf` writes it
    #[arg(value_name = "NDF")]
    pub ndf: PathBuf,
    /// Where the material goes: a file `.bsdf`, beside which its TOML is written
    #[arg(short, long, value_name = "FILE.bsdf")]
    pub output: PathBuf,
    /// The wavelength of a table that does not say it
    #[arg(long, value_name = "NM")]
    pub wavelength_nm: Option<f64>,
    /// The material's name [default: that of the file]
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// The plan of these measurements, as `sunglint brdf plan` writes it: what of it is missing is said, and of a plan with --quarter the other quarters are mirrored
    #[arg(long, value_name = "PLAN")]
    pub plan: Option<PathBuf>,
    /// Incident elevations of the file
    #[arg(long, value_name = "N", default_value_t = 72)]
    pub theta_i: usize,
    /// Incident azimuths of the file, of an anisotropic sample
    #[arg(long, value_name = "N", default_value_t = 17)]
    pub phi_i: usize,
    /// Side of the file's grid of values, best odd: the plane of incidence is then a row [default: 129, or 97, 65 or 33 where all values would take more than 256 MB]
    #[arg(long, value_name = "N")]
    pub side: Option<usize>,
    /// Nodes of the file's warps in elevation; in azimuth as many, of an isotropic sample four times as many
    #[arg(long, value_name = "N", default_value_t = 128)]
    pub normals: usize,
    /// Overwrite files that are there
    #[arg(long)]
    pub force: bool,
}

/// Sides of grids of values, finest first.
const SIDES: [usize; 4] = [129, 97, 65, 33];
/// What all values of a file take at most where nobody says their side, bytes.
const MOST_BYTES: usize = 256_000_000;

/// What so many grids of values take, bytes.
fn bytes(grids: usize, side: usize) -> usize {
    grids.saturating_mul(side * side * size_of::<f32>())
}

/// The finest side with which so many grids of values stay within [`MOST_BYTES`]; the coarsest where none does.
fn usual_side(grids: usize) -> usize {
    let fits = |side: &usize| bytes(grids, *side) <= MOST_BYTES;
    SIDES.into_iter().find(fits).unwrap_or(SIDES[SIDES.len() - 1])
}

pub(super) fn run(args: &AssembleArgs, console: Console) -> anyhow::Result<()> {
    if args.output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("bsdf")) {
        let text = format!("-o {}: expected a file .bsdf", args.output.display());
        return Err(Usage(text).into());
    }
    let out = OutputArgs { output: Vec::new(), force: args.force };
    let beside = |extension: &str| args.output.with_extension(extension);
    let (coverage_file, toml_file) = (beside("coverage.ecsv"), beside("toml"));
    let (doubts_file, missing_file) = (beside("doubts.ecsv"), beside("missing.ecsv"));
    let planned_file = args.plan.as_ref().map(|_| &missing_file);
    let files = [&args.output, &coverage_file, &doubts_file, &toml_file].into_iter();
    out.check_targets(files.chain(planned_file).map(PathBuf::as_path))?;
    let (measured, inputs) = samples(&args.samples, args.wavelength_nm)?;
    let (density, _, others) = ndf::read(&args.ndf)?;
    let plan = match &args.plan {
        Some(path) => {
            let (table, input) = super::table(path)?;
            let (steps, quarter) = planned(path, &table)?;
            Some((check(&steps, &measured, density.is_isotropic(), console), quarter, input))
        }
        None => None,
    };
    let of_plan = plan.as_ref().map(|(_, _, input)| input.clone()).unwrap_or_default();
    let inputs: Vec<Value> =
        [inputs, others, of_plan].iter().filter_map(Value::as_array).flatten().cloned().collect();
    let azimuths = if density.is_isotropic() { 1 } else { args.phi_i };
    let grids = measured.wavelength_nm.len() * args.theta_i * azimuths;
    let side = args.side.unwrap_or_else(|| usual_side(grids));
    if args.side.is_none() && side < SIDES[0] {
        console.warn(&format!(
            "the file has {grids} grids of values: each is of {side} by {side} instead of {} by {}, so that they take {} MB; --side says otherwise",
            SIDES[0], SIDES[0], bytes(grids, side) / 1_000_000
        ));
    }
    let options = AssembleOptions {
        theta_i: args.theta_i,
        phi_i: args.phi_i,
        side,
        normals: args.normals,
        mirrored: plan.as_ref().is_some_and(|(_, quarter, _)| *quarter),
    };
    let bar = super::progress(1, "assembling", console);
    bar.enable_steady_tick(std::time::Duration::from_millis(200));
    let made = assemble(&measured, &density, &options);
    bar.finish_and_clear();
    let made = made.with_context(|| args.samples.display().to_string())?;
    for warning in &made.warnings {
        console.warn(warning);
    }
    let stem = args.output.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let name = args.name.clone().unwrap_or(stem);
    // What was written has to be a material.
    let material = measured::material(&name, &args.output, &made.file)?;
    for note in material.notes() {
        console.warn(note);
    }
    let file = args.output.file_name().unwrap_or_default().to_string_lossy();
    let toml = format!("[[material]]\nname = {name:?}\nmodel = \"measured\"\nfile = {file:?}\n");
    let text_of = |table: &Table| sunglint_formats::ecsv::to_string(table).map(String::into_bytes);
    let mut files = vec![
        (args.output.clone(), made.file.to_bytes()?),
        (toml_file, toml.into_bytes()),
        (coverage_file, text_of(&table(&made, &inputs))?),
        (doubts_file, text_of(&doubts(&made, &inputs))?),
    ];
    if let Some((planned, ..)) = &plan {
        files.push((missing_file, text_of(&missing_table(&planned.missing, &inputs))?));
    }
    out.write_files(&files, console)?;
    let mut json = summary(&made, &measured.wavelength_nm, &inputs);
    json["plan"] = plan.as_ref().map_or(Value::Null, |(planned, ..)| {
        json!({ "planned": planned.all, "missing": planned.missing.len(), "unplanned": planned.others })
    });
    let product = Product { json, ..Product::default() };
    if console.quiet && !console.json {
        return Ok(());
    }
    console.result(&text(&made), &product.json)
}

/// How far a direction may lie from the one that was planned, degrees.
const NEAR_DEG: f64 = 0.5;

/// What became of a plan.
struct Checked {
    all: usize,
    missing: Vec<Planned>,
    others: usize,
}

fn check(steps: &[Planned], samples: &Samples, isotropic: bool, console: Console) -> Checked {
    let (missing, others) = missing(steps, samples, isotropic, NEAR_DEG);
    if let Some(first) = missing.first() {
        console.warn(&format!(
            "{} of {} planned directions have no value above 0 within {NEAR_DEG}°; the first is step {}: light at {:.2}°, azimuth {:.2}°, detector at {:.2}°, azimuth {:.2}°",
            missing.len(),
            steps.len(),
            first.step,
            first.theta_i_deg,
            first.phi_i_deg,
            first.theta_o_deg,
            first.phi_o_deg
        ));
    }
    if others > 0 {
        console.warn(&format!(
            "{others} directions were measured that were not planned: they are used"
        ));
    }
    Checked { all: steps.len(), missing, others }
}

fn table_of(kind: &str, columns: Vec<Column>, inputs: &[Value]) -> Table {
    let meta = [("kind", json!(kind)), ("inputs", json!(inputs))];
    Table { meta: meta.into_iter().map(|(k, v)| (k.to_owned(), v)).collect(), columns }
}

fn missing_table(missing: &[Planned], inputs: &[Value]) -> Table {
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

fn doubts(made: &Assembled, inputs: &[Value]) -> Table {
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

fn table(made: &Assembled, inputs: &[Value]) -> Table {
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

fn summary(made: &Assembled, nm: &[f64], inputs: &[Value]) -> Value {
    let coverage: Vec<Value> = made
        .coverage
        .iter()
        .map(|c| {
            json!({
                "theta_i_deg": rounded(c.theta_i_deg), "phi_i_deg": rounded(c.phi_i_deg), "cells": c.cells,
                "extrapolated_cells": rounded(c.extrapolated_cells), "albedo": rounded(c.albedo),
                "extrapolated_albedo": rounded(c.extrapolated_albedo), "largest_albedo": rounded(c.largest_albedo),
                "albedo_doubt": rounded(c.albedo_doubt), "lowered": rounded(c.lowered),
            })
        })
        .collect();
    let base: Vec<Value> = nm
        .iter()
        .zip(&made.base)
        .map(|(nm, b)| json!({ "wavelength_nm": nm, "specular": rounded(b.specular), "diffuse": rounded(b.diffuse), "rms_ln": rounded(b.rms) }))
        .collect();
    json!({
        "used": made.used, "unused": made.left_out, "coverage": coverage, "base": base,
        "warnings": made.warnings, "inputs": inputs,
    })
}

fn text(made: &Assembled) -> String {
    let mut text = format!("{} directions\n", made.used);
    let worst = made.base.iter().map(|b| b.rms).fold(0.0, f64::max);
    let _ = writeln!(
        text,
        "what the NDF and a Lambert term say of them is off by a factor of {:.3} (rms)",
        worst.exp()
    );
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
        let mut all: Vec<f64> = beyond.iter().map(|d| d.ln_doubt).collect();
        all.sort_by(f64::total_cmp);
        let _ = writeln!(
            text,
            "{} of {} directions all around are extrapolated: half of them may be off by a factor of {:.2} or more, the worst by {:.2} (light at {:.0}°, seen from {:.0}°, azimuths {:.0}° apart)",
            beyond.len(),
            made.doubts.len(),
            all[all.len() / 2].exp(),
            worst.ln_doubt.exp(),
            worst.theta_i_deg,
            worst.theta_o_deg,
            (worst.phi_o_deg - worst.phi_i_deg).rem_euclid(360.0)
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::usual_side;

    /// Truth: by hand: 72 grids of 129² values of four bytes are 4.8 MB; 195 wavelengths of them 934 MB, with 97² 528 MB, with 65² 237 MB.
    #[test]
    fn many_wavelengths_have_coarser_grids() {
        assert_eq!(usual_side(72), 129);
        assert_eq!(usual_side(72 * 195), 65);
        assert_eq!(usual_side(72 * 17 * 3), 129);
        assert_eq!(usual_side(usize::MAX), 33);
    }
}
