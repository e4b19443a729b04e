//! `sunglint explain`: what a pass needs, and what error is left.

use crate::output::{Console, OutputArgs};
use crate::simulate::read;
use crate::station::StationArgs;
use anyhow::Context as _;
use clap::Args;
use std::path::PathBuf;
use sunglint_report::{Product, explain};
use sunglint_simulator::light::engine;
use sunglint_simulator::pass::Overrides;

/// Arguments of `sunglint explain`.
#[derive(Debug, Args)]
pub struct ExplainArgs {
    /// The scene: target, orbit, attitude, station, times (docs/pass.md)
    pub pass: PathBuf,
    /// Model what may change the light by more than this: `0.2%` or `0.002`, in place of the file's [default: 0.1%; of a table of single observations 1%]
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true, value_parser = tolerance)]
    pub tolerance: Option<f64>,
    /// Work that an epoch's light between surfaces may cost, in place of the file's [default: 0.01]
    #[arg(long, value_name = "CPU_S", allow_negative_numbers = true, value_parser = budget)]
    pub budget: Option<f64>,
    /// Which station, in place of the file's.
    #[command(flatten)]
    pub station: StationArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// A tolerance as people write it: `0.2%`, `0.2 %` or `0.002`.
pub fn tolerance(text: &str) -> Result<f64, String> {
    let (number, unit) = match text.trim().strip_suffix('%') {
        Some(number) => (number.trim(), 0.01),
        None => (text.trim(), 1.0),
    };
    let value: f64 = number.parse().map_err(|_| "expected a share such as 0.2% or 0.002")?;
    engine::check_tolerance(value * unit).map_err(|e| e.to_string())
}

/// A budget of an epoch as people write it, s: `0.01`, `1`.
pub fn budget(text: &str) -> Result<f64, String> {
    let seconds = text.trim().parse().map_err(|_| "expected CPU seconds such as 0.01 or 1")?;
    engine::check_budget(seconds).map_err(|e| e.to_string())
}

/// Says what a pass needs.
pub fn run(args: &ExplainArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let overrides =
        Overrides { tolerance: args.tolerance, budget_s: args.budget, ..Overrides::default() };
    let pass = read(&args.pass, &args.station, overrides)?;
    let explanation = pass.explain().with_context(|| args.pass.display().to_string())?;
    for warning in pass.warnings.iter().chain(&explanation.scene.warnings) {
        console.warn(warning);
    }
    let product = Product {
        name: format!("{}_needs", pass.name),
        table: explain::table(&pass, &explanation),
        json: explain::document(&pass, &explanation),
        ..Product::default()
    };
    args.out.finish(&product, &explain::text(&pass, &explanation), console)
}
