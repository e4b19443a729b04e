//! `sunglint brdf ingest`: a spectrometer's files, direction by direction, as BRDF values.

use crate::output::{Console, OutputArgs};
use crate::progress::Bar;
use clap::Args;
use std::path::PathBuf;
use sunglint_materials::ingest::file::ingest_file;
use sunglint_report::brdf::ingest::{MOST_IN_TEXT, product, text};

/// Arguments of `sunglint brdf ingest`.
#[derive(Debug, Args)]
pub struct IngestArgs {
    /// Which file is which direction and role
    #[arg(value_name = "INGEST.toml")]
    pub file: PathBuf,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

pub(super) fn run(args: &IngestArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let bar = Bar::new(console);
    let found = ingest_file(&args.file, &bar)?;
    drop(bar);
    let samples = &found.ingested.samples;
    for warning in &found.ingested.warnings {
        console.warn(warning);
    }
    if found.dark > 0 {
        let all = samples.rows.len();
        console.warn(&format!("{} of {all} directions have no value above 0", found.dark));
    }
    let values = samples.rows.len() * samples.wavelength_nm.len();
    let product = product(&found)?;
    if values > MOST_IN_TEXT {
        console.warn(&format!("{values} values: too many for a text, a folder gets samples.fits"));
    }
    args.out.finish(&product, &text(&found), console)
}
