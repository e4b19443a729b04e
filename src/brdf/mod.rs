//! `sunglint brdf`: a sample on a goniometer, from retro-reflection to a measured material.

mod assemble;
mod fit;
mod hemispheres;
mod ingest;
mod ndf;
mod plan;
pub mod retro;
mod show;
mod spectra;

pub use assemble::AssembleArgs;
pub use fit::FitArgs;
pub use ingest::IngestArgs;
pub use ndf::NdfArgs;
pub use plan::PlanArgs;
pub use retro::RetroArgs;
pub use show::{CompareArgs, ShowArgs};

use crate::output::{Console, OutputArgs};
use anyhow::Context as _;
use clap::Subcommand;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use std::path::Path;
use sunglint_formats::Table;
use sunglint_formats::text_table::read_str as any;
use sunglint_materials::samples::Samples;

/// The steps of a measurement, each with a table that the next one reads.
#[derive(Debug, Subcommand)]
pub enum BrdfCommand {
    /// Retro-reflection against angle, from a stage and a power meter (real ones, or a virtual rig)
    Retro(RetroArgs),
    /// The density of microfacet normals from retro-reflection against angle, with F0 and the best Beckmann and GGX roughness
    Ndf(NdfArgs),
    /// Where to measure a sample: incident elevations and outgoing directions by its microfacets
    Plan(PlanArgs),
    /// A spectrometer's files, direction by direction, as BRDF values: dark and reference, detectors joined, reciprocity checked
    Ingest(IngestArgs),
    /// Laws with few parameters through measured values: Lambert, Phong, ABg, Ward, Cook–Torrance, Maxwell–Beard
    Fit(FitArgs),
    /// Measured values and NDF as a material: a .bsdf file, what of it is extrapolated, and the TOML that a scene takes
    Assemble(AssembleArgs),
    /// What a material does: slices, lobes, hemispherical reflectance, reciprocity
    Show(ShowArgs),
    /// How two materials differ, by direction
    Compare(CompareArgs),
}

impl BrdfCommand {
    /// Where its result goes, for what has the usual choice.
    pub fn output(&self) -> Option<&OutputArgs> {
        match self {
            Self::Retro(args) => Some(&args.out),
            Self::Ndf(args) => Some(&args.out),
            Self::Plan(args) => Some(&args.out),
            Self::Ingest(args) => Some(&args.out),
            Self::Fit(args) => Some(&args.out),
            Self::Show(args) => Some(&args.out),
            Self::Compare(args) => Some(&args.out),
            Self::Assemble(_) => None,
        }
    }
}

/// Does what is asked.
///
/// # Errors
/// A table that is not what it should be, and what the step refuses, with the reason.
pub fn run(command: &BrdfCommand, console: Console, seed: u64) -> anyhow::Result<()> {
    match command {
        BrdfCommand::Retro(args) => retro::run(args, console),
        BrdfCommand::Ndf(args) => ndf::run(args, console, seed),
        BrdfCommand::Plan(args) => plan::run(args, console),
        BrdfCommand::Ingest(args) => ingest::run(args, console),
        BrdfCommand::Fit(args) => fit::run(args, console),
        BrdfCommand::Assemble(args) => assemble::run(args, console),
        BrdfCommand::Show(args) => show::show(args, console),
        BrdfCommand::Compare(args) => show::compare(args, console),
    }
}

/// A progress bar on stderr; none where that is no terminal or nothing is to be said.
fn progress(count: u64, what: &'static str, console: Console) -> ProgressBar {
    if console.quiet {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(count);
    if let Ok(style) = ProgressStyle::with_template("{msg} {bar:40} {pos}/{len}") {
        bar.set_style(style);
    }
    bar.with_message(what)
}

/// Measured values from a file, ECSV, FITS or plain columns, and what the result says of it. `wavelength_nm` is that of a table that does not say it.
fn samples(path: &Path, wavelength_nm: Option<f64>) -> anyhow::Result<(Samples, Value)> {
    let is_fits = |e: &std::ffi::OsStr| ["fits", "fit"].iter().any(|f| e.eq_ignore_ascii_case(f));
    if path.extension().is_some_and(is_fits) {
        let bytes = sunglint_formats::read::bytes(path)?;
        let sha256 = sunglint_formats::sha256(&bytes);
        let fits = sunglint_formats::fits::Fits::from_bytes(path, bytes)?;
        let inputs = json!([{ "file": path.display().to_string(), "sha256": sha256 }]);
        return Ok((Samples::from_fits(&fits)?, inputs));
    }
    let (table, inputs) = table(path)?;
    Ok((Samples::from_table(path, &table, wavelength_nm)?, inputs))
}

/// A table from a file, ECSV or plain columns, and what the result says of it.
fn table(path: &Path) -> anyhow::Result<(Table, Value)> {
    let bytes =
        std::fs::read(path).map_err(|e| sunglint_formats::FileError::io("read", path, e))?;
    let sha256 = sunglint_formats::sha256(&bytes);
    let text = String::from_utf8(bytes)
        .with_context(|| format!("{}: expected a table as UTF-8 text", path.display()))?;
    let inputs = json!([{ "file": path.display().to_string(), "sha256": sha256 }]);
    Ok((any(path, &text)?, inputs))
}
