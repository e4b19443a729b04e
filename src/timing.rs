//! `sunglint timing`: when a camera exposes, by a lamp that flashes into it and into a counter.

use crate::output::{Console, OutputArgs, Usage};
use crate::progress::Bar;
use clap::Args;
use std::path::PathBuf;
use sunglint_calibration::timing::{TimingOptions, measure, timing_file};
use sunglint_numerics::progress::Progress as _;
use sunglint_report::timing as report;

/// Largest range that is searched, s.
const MOST_S: f64 = 60.0;

/// Arguments of `sunglint timing`.
#[derive(Debug, Args)]
pub struct TimingArgs {
    /// Sessions in which a lamp flashed into the camera and a counter, at unequal intervals
    #[arg(required = true, value_name = "SESSION")]
    pub sessions: Vec<PathBuf>,
    /// Which camera [default: all]
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Which channel of a counter saw the lamp [default: the surest]
    #[arg(long, value_name = "NAME")]
    pub channel: Option<String>,
    /// Largest latency that is looked for, either way, s [default: what the frames say that it may be, else 2]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub most_s: Option<f64>,
    /// Write the times for `reduce --timing`: a TOML file
    #[arg(long, value_name = "FILE")]
    pub timing_out: Option<PathBuf>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Measures the times.
///
/// # Errors
/// Sessions or options that cannot be used; no camera whose latency could be measured; a result that cannot be written.
pub fn run(args: &TimingArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    if let Some(most_s) = args.most_s.filter(|most_s| !(1e-3..=MOST_S).contains(most_s)) {
        return Err(Usage(format!("--most-s is {most_s}, expected 0.001 to {MOST_S} s")).into());
    }
    let options = TimingOptions {
        camera: args.camera.clone(),
        channel: args.channel.clone(),
        most_s: args.most_s,
    };
    let progress = Bar::new(console);
    progress.begin("frames", None);
    let found = measure(&args.sessions, &options, &progress);
    progress.end();
    let found = found?;
    for warning in &found.warnings {
        console.warn(warning);
    }
    let mut others = Vec::new();
    if let Some(path) = &args.timing_out {
        let timings: Vec<_> = found.found.iter().map(|found| &found.timing).collect();
        others.push((path.clone(), timing_file(&timings).into_bytes()));
    }
    args.out.finish_with(&report::product(&found), others, &report::text(&found), console)
}
