//! `sunglint compare`: a measured pass beside the simulated one.
//!
//! [`sunglint_inference::compare`] compares, [`sunglint_report::compare`] shows it.

pub use crate::curve_file::{ComparedAs, TimeColumn};
use crate::explain;
use crate::output::{Console, OutputArgs};
use crate::progress::Bar;
use crate::simulate;
use crate::station::StationArgs;
use anyhow::anyhow;
use clap::Args;
use std::path::{Path, PathBuf};
use sunglint_formats::photometry::ColumnNames;
use sunglint_inference::compare::{
    CompareError, MagnitudeColumns, MeasuredPass, MissingColumn, at_measured_times,
};
use sunglint_report::{Product, compare as report};
use sunglint_simulator::pass::Overrides;

/// Arguments of `sunglint compare`.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// Measurement: a calibrated light curve (`sunglint apply`), or ECSV or CSV with `time_utc` and a column of magnitudes
    pub measured: PathBuf,
    /// The scene: target, orbit, attitude, station, times (docs/pass.md)
    pub pass: PathBuf,
    /// Compare this channel; may be given several times [default: all that were measured]
    #[arg(long, value_name = "NAME")]
    pub channel: Vec<String>,
    /// Which column has the times.
    #[command(flatten)]
    pub time: TimeColumn,
    /// Of a table of magnitudes: their column [default: magnitude, mag, V …]
    #[arg(long, value_name = "NAME")]
    pub column: Option<String>,
    /// Column of their standard uncertainties, in a table of magnitudes
    #[arg(long, value_name = "NAME")]
    pub sigma_column: Option<String>,
    /// Kind of the magnitudes, in a table of magnitudes
    #[arg(long = "as", value_enum, default_value_t)]
    pub compared_as: ComparedAs,
    /// Model what may change the light by more than this: `0.2%` or `0.002`, in place of the file's [default: 0.1%]
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true, value_parser = explain::tolerance)]
    pub tolerance: Option<f64>,
    /// Which station, in place of the file's.
    #[command(flatten)]
    pub station: StationArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

impl CompareArgs {
    /// All of a calibrated curve, with the scene's own station, into no file.
    pub(crate) fn of(measured: PathBuf, pass: PathBuf) -> Self {
        Self {
            measured,
            pass,
            channel: Vec::new(),
            time: TimeColumn::default(),
            column: None,
            sigma_column: None,
            compared_as: ComparedAs::default(),
            tolerance: None,
            station: StationArgs::default(),
            out: OutputArgs::default(),
        }
    }
}

/// Compares.
pub fn run(args: &CompareArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    let (product, text) = compare(args, console)?;
    args.out.finish(&product, &text, console)
}

/// Returns the product of the comparison that arguments ask for, and its summary; says on stderr what a person should hear of.
pub(crate) fn compare(args: &CompareArgs, console: Console) -> anyhow::Result<(Product, String)> {
    let mut names = ColumnNames::default();
    args.time.put_into(&mut names);
    names.magnitude.clone_from(&args.column);
    names.sigma.clone_from(&args.sigma_column);
    let columns = MagnitudeColumns { names, compared_as: args.compared_as.into() };
    let told = |error| told(error, &args.pass);
    let mut measured = MeasuredPass::read(&args.measured, &columns).map_err(told)?;
    let overrides = Overrides { tolerance: args.tolerance, ..Overrides::default() };
    let scene = simulate::read(&args.pass, &args.station, overrides)?;
    measured.keep(&args.channel, &scene.station).map_err(told)?;
    let scene = at_measured_times(scene, &measured).map_err(told)?;
    let bar = Bar::new(console);
    let compared = sunglint_inference::compare::compare(&scene, measured, &bar).map_err(told)?;
    bar.end();
    for warning in &compared.warnings {
        console.warn(warning);
    }
    Ok((report::product(&compared), report::text(&compared)))
}

/// The error with the option that may help.
fn told(error: CompareError, scene: &Path) -> anyhow::Error {
    match error {
        CompareError::NoColumn { column, error } => match column {
            MissingColumn::Magnitudes => error.with_hint("--column NAME").into(),
            MissingColumn::Sigma => error.with_hint("--sigma-column NAME").into(),
            _ => CompareError::NoColumn { column, error }.into(),
        },
        CompareError::NotOfTheStation { .. } => {
            anyhow!("{error}: give the station that measured it, or --channel for those to compare")
        }
        CompareError::Simulation(error) => {
            anyhow::Error::from(error).context(scene.display().to_string())
        }
        error => error.into(),
    }
}
