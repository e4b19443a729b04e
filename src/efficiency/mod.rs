//! `sunglint efficiency`: a detector's efficiency from a monochromator's light on a photodiode and on the detector, and its dead time from steps of light.

mod linearity;
mod open;
mod run;

use crate::output::{Console, OutputArgs};
use anyhow::bail;
use clap::{Args, Subcommand};
use std::path::PathBuf;
use sunglint_calibration::efficiency::{EfficiencyRun, reduce_run};
use sunglint_formats::text::counted;
use sunglint_report::Product;
use sunglint_report::efficiency as report;

/// Arguments of `sunglint efficiency`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct EfficiencyArgs {
    /// What is measured; without, the tables that RUN.toml names are reduced
    #[command(subcommand)]
    pub action: Option<Action>,
    /// The sensor, the photodiodes, splitter and filters, and the tables of readings (docs/lab.md)
    #[arg(value_name = "RUN.toml", required = true)]
    pub plan: Option<PathBuf>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Rigs that are driven.
#[derive(Debug, Subcommand)]
pub enum Action {
    /// Drive monochromator, photodiode and sensor through a plan, and make the efficiency of what they read
    Run(run::RunArgs),
    /// Drive steps of light, or two sources alone and together, and find the detector's dead time in the counts
    Linearity(linearity::LinearityArgs),
}

impl EfficiencyArgs {
    /// Where the result goes.
    pub fn output(&self) -> &OutputArgs {
        match &self.action {
            None => &self.out,
            Some(Action::Run(args)) => &args.out,
            Some(Action::Linearity(args)) => &args.out,
        }
    }
}

/// Does what is asked.
///
/// # Errors
/// A file that cannot be read or says what cannot be, with line and key; readings that cannot be, with their numbers; devices that fail.
pub fn run(args: &EfficiencyArgs, console: Console) -> anyhow::Result<()> {
    match (&args.action, &args.plan) {
        (Some(Action::Run(args)), _) => run::run(args, console),
        (Some(Action::Linearity(args)), _) => linearity::run(args, console),
        (None, Some(plan)) => {
            args.out.check()?;
            let found = reduce_run(plan)?;
            finish(&args.out, &found, report::product(&found), &report::text(&found), console)
        }
        (None, None) => Ok(()),
    }
}

/// Shows and writes an efficiency.
fn finish(
    out: &OutputArgs,
    found: &EfficiencyRun,
    product: Product,
    text: &str,
    console: Console,
) -> anyhow::Result<()> {
    for warning in &found.warnings {
        console.warn(warning);
    }
    if !found.left_out_nm.is_empty() {
        console.warn(&format!(
            "{} of {} are not in the curve for a station (no efficiency from 0 to 1)",
            found.left_out_nm.len(),
            counted(found.efficiency.rows.len(), "wavelength")
        ));
    }
    let curves: Vec<(PathBuf, Vec<u8>)> = (out.folders().output.iter())
        .map(|folder| (folder.join("efficiency.csv"), found.curve.clone().into_bytes()))
        .collect();
    out.finish_with(&product, curves, text, console)?;
    let all = found.efficiency.rows.len();
    if found.left_out_nm.len() == all {
        bail!(
            "no efficiency: none of {} has one from 0 to 1, and the curve for a station is empty; the flags of the table say why ({})",
            counted(all, "wavelength"),
            flags_of(found)
        );
    }
    Ok(())
}

/// The flags of all wavelengths together.
fn flags_of(found: &EfficiencyRun) -> String {
    let all = found.efficiency.rows.iter().flat_map(|row| row.flags.iter_names());
    let names: std::collections::BTreeSet<String> =
        all.map(|(name, _)| name.to_lowercase()).collect();
    match names.is_empty() {
        true => "none".to_owned(),
        false => names.into_iter().collect::<Vec<_>>().join(", "),
    }
}
