//! `sunglint compare`: a measured pass beside the simulated one.
//!
//! The scene is simulated at the measured times, averaged over each exposure, and set beside: curves, residuals, ratios of the channels, what both claim of
//! their errors. Nothing is fitted but a scale for each channel, which is shown.

mod compared;
mod figure;
mod measured;
mod page;
mod summary;

pub use crate::curve_file::ComparedAs;
use compared::{Compared, Effort};
pub use measured::Quantity;
use measured::{Columns, Measured, MeasuredChannel};

use crate::explain;
use crate::output::{Console, OutputArgs};
use crate::simulate;
use crate::station::StationArgs;
use anyhow::Context as _;
use clap::Args;
use serde::Deserialize;
use serde_json::Value;
use std::path::PathBuf;
use sunglint_report::Product;
use sunglint_simulator::pass::Overrides;

/// Arguments of `sunglint compare`.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// What was measured: a calibrated light curve (`sunglint apply`), or ECSV or CSV with `time_utc` and a column of magnitudes
    pub measured: PathBuf,
    /// The scene: target, orbit, attitude, station, times (docs/pass.md)
    pub pass: PathBuf,
    /// Compare this channel; may be given several times [default: all that were measured]
    #[arg(long, value_name = "NAME")]
    pub channel: Vec<String>,
    /// Of a table of magnitudes: their column
    #[arg(long, value_name = "NAME", default_value = "magnitude")]
    pub column: String,
    /// Of a table of magnitudes: the column of their standard uncertainties
    #[arg(long, value_name = "NAME")]
    pub sigma_column: Option<String>,
    /// Of a table of magnitudes: what they are
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
            column: "magnitude".into(),
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

/// What the comparison that arguments ask for has to give, and its summary; says on stderr what a person should hear of.
pub(crate) fn compare(args: &CompareArgs, console: Console) -> anyhow::Result<(Product, String)> {
    let columns = Columns {
        magnitude: args.column.clone(),
        sigma: args.sigma_column.clone(),
        compared_as: args.compared_as.into(),
    };
    let mut measured = Measured::read(&args.measured, &columns)?;
    let overrides = Overrides { tolerance: args.tolerance, ..Overrides::default() };
    let scene = simulate::read(&args.pass, &args.station, overrides)?;
    measured.keep(&args.channel, &scene.station)?;
    let (pass, rows) = compared::at_measured_times(scene, &measured)?;
    let clock = simulate::Clock::new(pass.times.len(), console);
    let name = || args.pass.display().to_string();
    let simulation = pass.simulate(&|progress| clock.tell(progress)).with_context(name)?;
    let again = simulate::Clock::new(pass.times.len(), console);
    let (quantity, channels) = (measured.quantity, measured.channels.clone());
    let means = simulation
        .exposure_means(&|s| quantity.of(s, &channels), &|progress| again.tell(progress))
        .with_context(name)?;
    let effort = Effort { middles: clock.cost(), means: again.cost() };
    let compared = Compared::new(measured, &simulation, &means, rows, effort)?;
    for warning in &compared.warnings {
        console.warn(warning);
    }
    Ok((compared.product()?, compared.text()))
}

/// κ of the night, as a calibrated curve's metadata hold it.
#[derive(Debug, Clone, Deserialize)]
pub struct Kappa {
    /// What `sunglint calibrate` wrote.
    pub file: String,
    /// Its check sum.
    pub sha256: String,
    /// The night whose κ it is.
    pub night: String,
    /// The air that it was found with.
    pub air: String,
    /// Coverage of the intervals.
    pub confidence: f64,
    /// By channel.
    pub channels: Vec<KappaRow>,
    /// Covariance of ln κ, in the order of the channels.
    pub covariance_ln_kappa: Vec<Vec<f64>>,
}

/// κ of a channel.
#[derive(Debug, Clone, Deserialize)]
pub struct KappaRow {
    /// The channel.
    pub channel: String,
    /// Predicted = κ · measured.
    pub kappa: f64,
    /// Standard uncertainty of ln κ.
    pub relative_sigma: f64,
    /// Its interval.
    pub interval: [f64; 2],
}

impl Kappa {
    /// Of a file's metadata; `None` where they are of another kind: a curve from elsewhere may have a note of its own under this key.
    fn of(value: &Value) -> Option<Self> {
        let kappa: Self = serde_json::from_value(value.clone()).ok()?;
        let n = kappa.channels.len();
        let square = kappa.covariance_ln_kappa.len() == n
            && kappa.covariance_ln_kappa.iter().all(|row| row.len() == n);
        square.then_some(kappa)
    }

    /// κ of a channel.
    pub fn row(&self, channel: &str) -> Option<&KappaRow> {
        self.channels.iter().find(|row| row.channel == channel)
    }

    /// The relative uncertainty of the quotient of two channels' κ.
    pub fn ratio_sigma(&self, channel: &str, other: &str) -> Option<f64> {
        let place = |name: &str| self.channels.iter().position(|row| row.channel == name);
        let (a, b) = (place(channel)?, place(other)?);
        let c = &self.covariance_ln_kappa;
        Some((c[a][a] + c[b][b] - c[a][b] - c[b][a]).max(0.0).sqrt())
    }
}
