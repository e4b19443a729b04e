//! `sunglint import`: what a light curve of another program says, and the same as ECSV, TDM or ALCDEF.

use crate::curve_file::TimeColumn;
use crate::output::{Console, OutputArgs};
use anyhow::Context as _;
use clap::Args;
use std::path::PathBuf;
use sunglint_formats::photometry::{self, ColumnNames, ImportError, ObjectRows, write};
use sunglint_report::import::Summary;

/// Arguments of `sunglint import`.
#[derive(Debug, Args)]
pub struct ImportArgs {
    /// A file of magnitudes or fluxes: MMT-9 text, ALCDEF, TDM, EOSSA, or a table (ECSV, CSV, FITS, VOTable)
    pub file: PathBuf,
    /// Which column has the times.
    #[command(flatten)]
    pub time: TimeColumn,
    /// The column of magnitudes [default: magnitude, mag, V … or flux]
    #[arg(long, value_name = "NAME")]
    pub magnitude_column: Option<String>,
    /// The column of their standard uncertainties [default: sigma_mag, mag_err …]
    #[arg(long, value_name = "NAME")]
    pub sigma_column: Option<String>,
    /// The object whose rows are taken, of a table of several
    #[arg(long, value_name = "NAME")]
    pub object: Option<String>,
    /// Write a CCSDS tracking data message (KVN) as well
    #[arg(long, value_name = "FILE")]
    pub tdm: Option<PathBuf>,
    /// Write ALCDEF as well
    #[arg(long, value_name = "FILE")]
    pub alcdef: Option<PathBuf>,
    /// Target of what is written, in place of the file's
    #[arg(long, value_name = "NAME")]
    pub target: Option<String>,
    /// Of TDM and ALCDEF: who writes
    #[arg(long, value_name = "NAME", default_value = "UNKNOWN")]
    pub originator: String,
    /// Of TDM and ALCDEF: the site or its sensor
    #[arg(long, value_name = "NAME", default_value = "UNKNOWN")]
    pub site: String,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Imports.
///
/// # Errors
/// A file that cannot be understood; results that cannot be written.
pub fn run(args: &ImportArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    let exchanged: Vec<&PathBuf> = args.tdm.iter().chain(&args.alcdef).collect();
    args.out.check_targets(exchanged.iter().map(|p| p.as_path()))?;
    let mut names = ColumnNames::default();
    args.time.put_into(&mut names);
    names.magnitude.clone_from(&args.magnitude_column);
    names.sigma.clone_from(&args.sigma_column);
    let bytes = sunglint_formats::read::bytes(&args.file)?;
    let rows = args.object.clone().map_or(ObjectRows::One, ObjectRows::Of);
    let mut import =
        photometry::import(&args.file, bytes, &names, &rows).map_err(|error| match error {
            ImportError::Objects { .. } => anyhow::anyhow!("{error} (--object NAME)"),
            error => error.into(),
        })?;
    if let Some(target) = &args.target {
        import.samples.target.clone_from(target);
    }
    let mut sender = write::Sender::default();
    sender.originator.clone_from(&args.originator);
    sender.site.clone_from(&args.site);
    let mut others = Vec::new();
    if let Some(path) = &args.tdm {
        let text = write::tdm(&import.samples, &sender).context("--tdm")?;
        others.push((path.clone(), text.into_bytes()));
    }
    if let Some(path) = &args.alcdef {
        let text = write::alcdef(&import.samples, &sender).context("--alcdef")?;
        others.push((path.clone(), text.into_bytes()));
    }
    let summary = Summary::new(&import);
    for warning in &summary.warnings {
        console.warn(warning);
    }
    let stem = args.file.file_stem().unwrap_or_default().to_string_lossy();
    let product = summary.product(&stem, &import)?;
    args.out.finish_with(&product, others, &summary.text(&args.file), console)
}
