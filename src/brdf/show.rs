//! `sunglint brdf show` and `sunglint brdf compare`: what a material does, and how two differ.

use crate::output::{Console, OutputArgs};
use clap::Args;
use sunglint_materials::look::{self, Look};
use sunglint_report::brdf::show::{compared, product, text};

/// Arguments of `sunglint brdf show`.
#[derive(Debug, Args)]
#[allow(rustdoc::broken_intra_doc_links, reason = "a table of TOML is no link")]
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

pub(super) fn show(args: &ShowArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let (nm, phi_i_deg) = (args.wavelength_nm, args.phi_i_deg);
    let material = look::read(&args.file, nm)?;
    let look = Look::new(&material, &args.file, nm, phi_i_deg)?;
    for warning in &look.warnings {
        console.warn(warning);
    }
    let product = product(&material, &look, nm, phi_i_deg);
    args.out.finish(&product, &text(&material, &look, phi_i_deg), console)
}

pub(super) fn compare(args: &CompareArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let nm = args.wavelength_nm;
    let (a, b) = (look::read(&args.a, nm)?, look::read(&args.b, nm)?);
    for said in [&a, &b].into_iter().filter_map(|material| look::beyond(material, nm)) {
        console.warn(&said);
    }
    for (name, m) in [(&args.a, &a), (&args.b, &b)] {
        for note in m.notes() {
            console.warn(&format!("{name}: {note}"));
        }
    }
    let names = [args.a.as_str(), args.b.as_str()];
    let rows = look::compare([&a, &b], names, nm, args.phi_i_deg)?;
    let (product, text) = compared([&a, &b], names, &rows, nm);
    args.out.finish(&product, &text, console)
}
