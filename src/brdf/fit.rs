//! `sunglint brdf fit`: laws through measured values.

use crate::output::{Console, OutputArgs};
use anyhow::Context as _;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use sunglint_materials::fit::{FitOptions, Law, LobeKind, Rise, fit, to_toml};
use sunglint_materials::read;
use sunglint_report::brdf::fit::{product, text};
use sunglint_simulator::surface::ComplexIndex;

/// Arguments of `sunglint brdf fit`.
#[derive(Debug, Args)]
pub struct FitArgs {
    /// Measured values, ECSV, CSV or FITS: theta_i_deg, phi_i_deg, theta_o_deg, phi_o_deg, brdf_per_sr or brdf_532nm_per_sr and so on
    #[arg(value_name = "TABLE")]
    pub table: PathBuf,
    /// The wavelength: of a table that does not say it, or which of several
    #[arg(long, value_name = "NM")]
    pub wavelength_nm: Option<f64>,
    /// Values up to this are no measurements (a detector's floor)
    #[arg(long, value_name = "PER_SR")]
    pub floor_per_sr: Option<f64>,
    /// Only this law, with and without a Lambert term; may be given several times [default: all that the table allows]
    #[arg(long, value_name = "LAW")]
    pub law: Vec<LawName>,
    /// A material of the table of refractive indices, for Maxwell and Beard's law
    #[arg(long, value_name = "NAME")]
    pub refractive_index: Option<String>,
    /// Outliers count in full: squares in place of Student's distribution
    #[arg(long)]
    pub gaussian: bool,
    /// The name of the material that is written
    #[arg(long, value_name = "NAME", default_value = "fitted")]
    pub name: String,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// A law.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum LawName {
    /// The same in all directions
    Lambert,
    /// Phong's, modified
    Phong,
    /// A/(B + x^g)
    Abg,
    /// Ward's, with bounded albedo
    Ward,
    /// Cook–Torrance with Beckmann's slopes
    Beckmann,
    /// Cook–Torrance with GGX slopes
    Ggx,
    /// Maxwell–Beard
    MaxwellBeard,
}

impl LawName {
    fn kind(self) -> LobeKind {
        match self {
            Self::Lambert => LobeKind::Lambert,
            Self::Phong => LobeKind::Phong,
            Self::Abg => LobeKind::Abg,
            Self::Ward => LobeKind::Ward,
            Self::Beckmann => LobeKind::Beckmann,
            Self::Ggx => LobeKind::Ggx,
            Self::MaxwellBeard => LobeKind::MaxwellBeard,
        }
    }
}

pub(super) fn run(args: &FitArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    args.out.check_names(&["fit.ecsv", "residuals.ecsv"])?;
    let (measured, inputs) = read::samples(&args.table, args.wavelength_nm)?;
    let index = args.refractive_index.as_deref().map(ComplexIndex::named).transpose()?;
    let mut laws = Vec::new();
    if !args.law.is_empty() {
        let azimuths = measured.has_azimuths();
        let asked: Vec<LobeKind> = args.law.iter().map(|law| law.kind()).collect();
        // What the law needs, the fit says.
        laws = Law::all(azimuths, true, true);
        laws.retain(|law| asked.contains(&law.lobe));
    }
    let options = FitOptions {
        laws,
        wavelength_nm: args.wavelength_nm,
        floor_per_sr: args.floor_per_sr,
        gaussian: args.gaussian,
        index: index.clone(),
    };
    let found = fit(&measured, &options).with_context(|| args.table.display().to_string())?;
    for warning in &found.notes {
        console.warn(&warning.to_string());
    }
    let best = found.laws.first().context("no law was fitted")?;
    let rise = index.as_ref().map(|index| Rise::new(index, found.wavelength_nm)).transpose()?;
    let product = product(&found, best, &measured, rise.as_ref(), &inputs);
    let toml = to_toml(&found, best, &args.name, args.refractive_index.as_deref());
    let folders = args.out.folders().output;
    let files = folders.iter().map(|f| (f.join("material.toml"), toml.clone().into_bytes()));
    args.out.finish_with(&product, files.collect(), &text(&found, &toml), console)
}
