//! `sunglint align`: the fields of the fibres on the camera image, from the stars of one or more sessions.

use crate::output::{Console, OutputArgs};
use crate::progress::Bar;
use crate::reduce::{FrameArgs, station};
use crate::station::StationArgs;
use anyhow::bail;
use clap::Args;
use std::path::PathBuf;
use sunglint_calibration::alignment::{AlignError, AlignOptions, CELL_PX, align, fibre_file};
use sunglint_formats::session::Session;
use sunglint_numerics::progress::Progress as _;
use sunglint_report::align as report;

/// Arguments of `sunglint align`.
#[derive(Debug, Args)]
pub struct AlignArgs {
    /// Sessions with stars that wandered over the fibres' fields
    #[arg(required = true, value_name = "SESSION")]
    pub sessions: Vec<PathBuf>,
    /// Side of a cell of the measured map, px
    #[arg(long, value_name = "PX", default_value_t = CELL_PX, allow_negative_numbers = true)]
    pub cell_px: f64,
    /// Let the field be turned against the frame
    #[arg(long)]
    pub rotation: bool,
    /// How frames are measured.
    #[command(flatten)]
    pub frames: FrameArgs,
    /// Which station.
    #[command(flatten)]
    pub station: StationArgs,
    /// Write the fields for `reduce --fibre`: a TOML file
    #[arg(long, value_name = "FILE")]
    pub fibre_out: Option<PathBuf>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Fits the fields.
///
/// # Errors
/// Sessions or options that cannot be used; no channel whose field could be fitted; a result that cannot be written.
pub fn run(args: &AlignArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    if !(args.cell_px.is_finite() && args.cell_px > 0.0) {
        bail!("--cell-px is {}, expected a length above 0", args.cell_px);
    }
    let first = Session::open(&args.sessions[0])?;
    let station = station(&args.station, &first)?;
    let options = AlignOptions {
        frames: args.frames.options(&station)?,
        cell_px: args.cell_px,
        rotation: args.rotation,
    };
    let progress = Bar::new(console);
    progress.begin("frames and bins", None);
    let found = align(&args.sessions, &station, &options, &progress);
    progress.end();
    let warnings = match &found {
        Ok(found) => &found.warnings[..],
        Err(AlignError::NoField { warnings, .. }) => warnings,
        Err(_) => &[],
    };
    for warning in warnings {
        console.warn(warning);
    }
    let found = found?;
    let mut others = Vec::new();
    if let Some(path) = &args.fibre_out {
        others.push((path.clone(), fibre_file(&found.fields).into_bytes()));
    }
    let product = report::product(&found, &station);
    args.out.finish_with(&product, others, &report::text(&found, &station), console)
}
