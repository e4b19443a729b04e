//! `sunglint brdf assemble`: measured values and densities as a material.

use crate::output::{Console, OutputArgs, Usage};
use crate::progress::Bar;
use clap::Args;
use std::path::PathBuf;
use sunglint_formats::Table;
use sunglint_materials::assemble::files::{Assembly, AssemblyFiles, assemble_files};
use sunglint_report::brdf::assemble::{doubts, missing_table, summary, table, text};
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
    /// Side of the file's grid of values, best odd: the plane of incidence is then a row [default: 129, or 97, 65 or 33 where the file would take more than 256 MB]
    #[arg(long, value_name = "N")]
    pub side: Option<usize>,
    /// Nodes of the file's warps in elevation; in azimuth as many, of an isotropic sample four times as many
    #[arg(long, value_name = "N", default_value_t = 128)]
    pub normals: usize,
    /// Overwrite files that are there
    #[arg(long)]
    pub force: bool,
}

pub(super) fn run(args: &AssembleArgs, console: Console) -> anyhow::Result<()> {
    if args.output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("bsdf")) {
        let text = format!("-o {}: expected a file .bsdf", args.output.display());
        return Err(Usage(text).into());
    }
    let out = OutputArgs { output: vec![args.output.clone()], force: args.force };
    let beside = |extension: &str| args.output.with_extension(extension);
    let (coverage_file, toml_file) = (beside("coverage.ecsv"), beside("toml"));
    let (doubts_file, missing_file) = (beside("doubts.ecsv"), beside("missing.ecsv"));
    let planned_file = args.plan.as_ref().map(|_| &missing_file);
    let files = [&args.output, &coverage_file, &doubts_file, &toml_file].into_iter();
    out.check_targets(files.chain(planned_file).map(PathBuf::as_path))?;
    let files = AssemblyFiles {
        samples: args.samples.clone(),
        ndf: args.ndf.clone(),
        plan: args.plan.clone(),
        wavelength_nm: args.wavelength_nm,
        theta_i: args.theta_i,
        phi_i: args.phi_i,
        side: args.side,
        normals: args.normals,
    };
    let bar = Bar::new(console);
    let found = assemble_files(&files, &bar);
    drop(bar);
    let found = found?;
    let Assembly { made, inputs, .. } = &found;
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
        (coverage_file, text_of(&table(made, inputs))?),
        (doubts_file, text_of(&doubts(made, inputs))?),
    ];
    if let Some(plan) = &found.plan {
        files.push((missing_file, text_of(&missing_table(&plan.missing, inputs))?));
    }
    out.write_files(&files, console)?;
    if console.quiet && !console.json {
        return Ok(());
    }
    console.result(&text(made), &summary(&found))
}
