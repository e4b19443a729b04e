//! `sunglint brdf ingest`: a spectrometer's files, direction by direction, as BRDF values.

use crate::output::{Console, OutputArgs};
use crate::progress::Bar;
use anyhow::Context as _;
use clap::Args;
use std::path::PathBuf;
use sunglint_formats::bsdf::TensorFile;
use sunglint_formats::{fred, zemax};
use sunglint_materials::exchange::Exchange;
use sunglint_materials::goniometer::folder;
use sunglint_materials::ingest::file::ingest_file;
use sunglint_materials::ingest::once;
use sunglint_materials::{exchange, read};
use sunglint_report::brdf::goniometer as show;
use sunglint_report::brdf::ingest::{
    MOST_IN_TEXT, product, rgl_text, table_product, table_text, text,
};

/// Arguments of `sunglint brdf ingest`.
#[derive(Debug, Args)]
pub struct IngestArgs {
    /// The folder of a run (`sunglint brdf run`); or which file is which direction and role (INGEST.toml); or a table of FRED, Zemax, ASTM, Scatterworks, or a file of the MERL, UTIA or RGL database, known by its content
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// The wavelength of a table that does not say it
    #[arg(long, value_name = "NM")]
    pub wavelength_nm: Option<f64>,
    /// Write the values for FRED, too
    #[arg(long, value_name = "FILE")]
    pub fred: Option<PathBuf>,
    /// Write the values for Zemax OpticStudio, too: directions must be a grid about the mirrored ray
    #[arg(long, value_name = "FILE")]
    pub zemax: Option<PathBuf>,
    /// Write the values as a tensor file of the RGL kind, too, which Mitsuba 3 reads: at its own directions, interpolated; a file of this kind is written as it is
    #[arg(long, value_name = "FILE")]
    pub rgl: Option<PathBuf>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

pub(super) fn run(args: &IngestArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    if args.file.is_dir() {
        return goniometer(args, console);
    }
    if is_table(&args.file) {
        return table(args, console);
    }
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

/// The folder of a run.
fn goniometer(args: &IngestArgs, console: Console) -> anyhow::Result<()> {
    if !folder::is_run(&args.file) {
        anyhow::bail!(
            "{}: this folder holds no run of a goniometer (bench.toml, readings.ecsv): `sunglint brdf run PLAN -o FOLDER/` makes one",
            args.file.display()
        );
    }
    let (found, inputs) = folder::ingest(&args.file)?;
    for warning in &found.warnings {
        console.warn(warning);
    }
    let product = show::product(&found, &inputs)?;
    args.out.finish(&product, &show::text(&found), console)
}

/// True where a file holds values and is no list of spectrometer's files.
fn is_table(path: &std::path::Path) -> bool {
    let is_toml = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    !is_toml && path.is_file()
}

fn table(args: &IngestArgs, console: Console) -> anyhow::Result<()> {
    let (samples, inputs) = read::samples(&args.file, args.wavelength_nm)?;
    let (samples, repeated) = once(samples);
    for warning in repeated.into_iter().chain(exchange::warnings(&samples)) {
        console.warn(&warning);
    }
    let mut others = Vec::new();
    if (args.fred.is_some() || args.zemax.is_some()) && samples.wavelength_nm.len() > 1 {
        anyhow::bail!(
            "{}: {} wavelengths, and FRED and Zemax take one: make a table of one",
            args.file.display(),
            samples.wavelength_nm.len()
        );
    }
    if let Some(path) = &args.fred {
        let text = fred::to_string(&exchange::to_fred(&samples, 0));
        others.push((path.clone(), text.into_bytes()));
    }
    if let Some(path) = &args.zemax {
        let made = exchange::to_zemax(&samples, 0);
        let made = made.with_context(|| args.file.display().to_string())?;
        for note in made.comments.iter().skip(1) {
            console.warn(&format!("{}: {note}", path.display()));
        }
        others.push((path.clone(), zemax::to_string(&made).into_bytes()));
    }
    let format = read::exchange_format(&args.file);
    if let Some(path) = &args.rgl {
        let bytes = match format {
            Some(Exchange::Rgl) => TensorFile::read(&args.file)?.to_bytes(),
            _ => {
                let made = exchange::to_rgl(&samples);
                let made = made.with_context(|| args.file.display().to_string())?;
                if let Some(text) = rgl_text(&made) {
                    console.warn(&format!("{}: {text}", path.display()));
                }
                made.file.to_bytes()
            }
        };
        let bytes = bytes.with_context(|| args.file.display().to_string())?;
        others.push((path.clone(), bytes));
    }
    let product = table_product(&samples, format, &inputs)?;
    args.out.finish_with(&product, others, &table_text(&samples, format), console)
}
