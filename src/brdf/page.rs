//! `sunglint brdf page`: a material as one HTML file.

use crate::output::{Console, OutputArgs, Usage};
use clap::Args;
use serde::Serialize;
use std::path::PathBuf;
use sunglint_materials::look::{self, Look};
use sunglint_report::brdf::page::{Bodies, page};

/// Arguments of `sunglint brdf page`.
#[derive(Debug, Args)]
#[allow(rustdoc::broken_intra_doc_links, reason = "a table of TOML is no link")]
pub struct PageArgs {
    /// A material: .bsdf, a TOML with one [[material]] (or `FILE#NAME`), or a table of measured values
    #[arg(value_name = "FILE")]
    pub file: String,
    /// Where the page goes: a file .html
    #[arg(short, long, value_name = "FILE.html")]
    pub output: PathBuf,
    /// The wavelength
    #[arg(long, value_name = "NM")]
    pub wavelength_nm: f64,
    /// Azimuth of the light, of a material with a tangent
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    pub phi_i_deg: f64,
    /// Overwrite a file that is there
    #[arg(long)]
    pub force: bool,
}

#[derive(Serialize)]
struct Shown<'a> {
    name: &'a str,
    wavelength_nm: f64,
}

pub(super) fn run(args: &PageArgs, console: Console) -> anyhow::Result<()> {
    if args.output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("html")) {
        let text = format!("-o {}: expected a file .html", args.output.display());
        return Err(Usage(text).into());
    }
    let out = OutputArgs { output: vec![args.output.clone()], force: args.force };
    out.check_targets([args.output.as_path()])?;
    let (nm, phi_i_deg) = (args.wavelength_nm, args.phi_i_deg);
    let material = look::read(&args.file, nm)?;
    let look = Look::new(&material, &args.file, nm, phi_i_deg)?;
    for warning in &look.warnings {
        console.warn(warning);
    }
    let bodies =
        Bodies { ball: look::ball(&material, nm)?, box_wing: look::box_wing(&material, nm) };
    let html = page(&material, &look, &bodies, nm, phi_i_deg);
    out.write_files(&[(args.output.clone(), html.into_bytes())], console)?;
    if console.quiet && !console.json {
        return Ok(());
    }
    let text = format!("{}\n", material.describe());
    console.result(&text, &Shown { name: &material.name, wavelength_nm: nm })
}
