//! `sunglint brdf ndf`: the density of microfacet normals from retro-reflection.

use crate::output::{Console, OutputArgs};
use anyhow::Context as _;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use sunglint_materials::ndf::{NdfOptions, TailKind, extract};
use sunglint_materials::read;
use sunglint_materials::table::RetroTable;
use sunglint_report::brdf::ndf::{product, text};

/// Arguments of `sunglint brdf ndf`.
#[derive(Debug, Args)]
pub struct NdfArgs {
    /// Retro-reflection against angle, ECSV or CSV: angle_deg, f_per_sr, and where they are known sigma_f_per_sr, azimuth_deg, flags
    #[arg(value_name = "TABLE")]
    pub table: PathBuf,
    /// The stage's angle at normal incidence, where it is known; else found from both sides of the normal
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub zero_deg: Option<f64>,
    /// How far from the stage's zero the normal is looked for
    #[arg(long, value_name = "DEG", default_value_t = 5.0)]
    pub most_offset_deg: f64,
    /// Smooth by a running median over N readings (odd): it flattens peaks
    #[arg(long, value_name = "N")]
    pub median: Option<usize>,
    /// How the lobe goes on beyond the last angle [default: what follows the last readings best]
    #[arg(long, value_name = "KIND")]
    pub tail: Option<Tail>,
    /// Nodes in elevation [default: 128; 32 of an anisotropic sample]
    #[arg(long, value_name = "N")]
    pub elevations: Option<usize>,
    /// Nodes in azimuth of an anisotropic sample [default: 12 times the ratio of its roughnesses, at least 64]
    #[arg(long, value_name = "N")]
    pub azimuths: Option<usize>,
    /// Resamplings of the readings for the uncertainties
    #[arg(long, value_name = "N", default_value_t = 200)]
    pub resamplings: usize,
    /// Take all light for the microfacets': do not look for diffuse light
    #[arg(long)]
    pub no_diffuse: bool,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// A continuation beyond the last angle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Tail {
    /// A GGX lobe
    Ggx,
    /// A Beckmann lobe
    Beckmann,
    /// The logarithm straight on
    Exponential,
    /// Straight on
    Linear,
}

impl From<Tail> for TailKind {
    fn from(tail: Tail) -> Self {
        match tail {
            Tail::Ggx => Self::Ggx,
            Tail::Beckmann => Self::Beckmann,
            Tail::Exponential => Self::Exponential,
            Tail::Linear => Self::Linear,
        }
    }
}

pub(super) fn run(args: &NdfArgs, console: Console, seed: u64) -> anyhow::Result<()> {
    args.out.check()?;
    args.out.check_names(&["ndf.ecsv"])?;
    let (source, inputs) = read::table(&args.table)?;
    let run = RetroTable::from_table(&args.table, &source)?;
    let options = NdfOptions {
        elevations: args.elevations,
        azimuths: args.azimuths,
        median: args.median,
        zero_deg: args.zero_deg,
        most_offset_deg: args.most_offset_deg,
        tail: args.tail.map(Into::into),
        diffuse: !args.no_diffuse,
        resamplings: args.resamplings,
        seed,
    };
    let ndf = extract(&run, &options).with_context(|| args.table.display().to_string())?;
    let warnings: Vec<String> = ndf.notes.iter().map(ToString::to_string).collect();
    for warning in &warnings {
        console.warn(warning);
    }
    let product = product(&ndf, &run, &inputs, &warnings, &options);
    args.out.finish(&product, &text(&ndf, &run), console)
}
