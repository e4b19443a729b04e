//! `sunglint efficiency`: a detector's efficiency from a monochromator's light on a photodiode and on the detector.

use crate::output::{Console, OutputArgs};
use clap::Args;
use std::path::PathBuf;
use sunglint_calibration::efficiency::reduce_run;
use sunglint_report::efficiency as report;

/// Arguments of `sunglint efficiency`.
#[derive(Debug, Args)]
pub struct EfficiencyArgs {
    /// The sensor, the photodiodes, splitter and filters, and the tables of readings (docs/lab.md)
    #[arg(value_name = "RUN.toml")]
    pub plan: PathBuf,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Does what is asked.
///
/// # Errors
/// A file that cannot be read or says what cannot be, with line and key; readings that cannot be, with their numbers.
pub fn run(args: &EfficiencyArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let found = reduce_run(&args.plan)?;
    for warning in &found.warnings {
        console.warn(warning);
    }
    if !found.left_out_nm.is_empty() {
        console.warn(&format!(
            "{} of {} wavelengths are not in the curve for a station (no efficiency from 0 to 1)",
            found.left_out_nm.len(),
            found.efficiency.rows.len()
        ));
    }
    let curves: Vec<(PathBuf, Vec<u8>)> = (args.out.folders().output.iter())
        .map(|folder| (folder.join("efficiency.csv"), found.curve.clone().into_bytes()))
        .collect();
    args.out.finish_with(&report::product(&found), curves, &report::text(&found), console)
}
