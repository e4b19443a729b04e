//! `sunglint brdf`: a sample on a goniometer, from retro-reflection to a measured material.

mod hemispheres;
mod ndf;
mod plan;

pub use ndf::NdfArgs;
pub use plan::PlanArgs;

use crate::output::{Console, OutputArgs};
use anyhow::Context as _;
use clap::Subcommand;
use serde_json::{Value, json};
use std::path::Path;
use sunglint_formats::Table;
use sunglint_simulator::pass::table::any;

/// The steps of a measurement, each with a table that the next one reads.
#[derive(Debug, Subcommand)]
pub enum BrdfCommand {
    /// The density of microfacet normals from retro-reflection against angle, with F0 and the best Beckmann and GGX roughness
    Ndf(NdfArgs),
    /// Where to measure a sample: incident elevations and outgoing directions by its microfacets
    Plan(PlanArgs),
}

impl BrdfCommand {
    /// Where its result goes.
    pub fn output(&self) -> &OutputArgs {
        match self {
            Self::Ndf(args) => &args.out,
            Self::Plan(args) => &args.out,
        }
    }
}

/// Does what is asked.
///
/// # Errors
/// A table that is not what it should be, and what the step refuses, with the reason.
pub fn run(command: &BrdfCommand, console: Console, seed: u64) -> anyhow::Result<()> {
    match command {
        BrdfCommand::Ndf(args) => ndf::run(args, console, seed),
        BrdfCommand::Plan(args) => plan::run(args, console),
    }
}

/// A table from a file, ECSV or plain columns, and what the result says of it.
fn table(path: &Path) -> anyhow::Result<(Table, Value)> {
    let bytes =
        std::fs::read(path).map_err(|e| sunglint_formats::FileError::io("read", path, e))?;
    let sha256 = crate::tables::sha256(&bytes);
    let text = String::from_utf8(bytes)
        .with_context(|| format!("{}: expected a table as UTF-8 text", path.display()))?;
    let inputs = json!([{ "file": path.display().to_string(), "sha256": sha256 }]);
    Ok((any(path, &text)?, inputs))
}
