//! `sunglint analyse`: what a light curve says about a body.

mod attitude;
mod curves;
mod endmembers;
mod fold;
mod given;
mod map;
mod period;
mod spin;
mod unmix;

pub use attitude::{AttitudeArgs, bounds};
pub use endmembers::EndmembersArgs;
pub use fold::FoldArgs;
pub use map::MapArgs;
pub use period::PeriodArgs;
pub use spin::SpinArgs;
pub use unmix::UnmixArgs;

use crate::output::{Console, OutputArgs};
use clap::Subcommand;

/// Analysis of a light curve.
#[derive(Debug, Subcommand)]
pub enum AnalyseCommand {
    /// The period of a curve, from all channels together: one, a family of which the data cannot choose, or not enough data
    Period(Box<PeriodArgs>),
    /// The spin behind the apparent periods of several passes: sidereal period, axis, sense and drift, with their intervals
    Spin(Box<SpinArgs>),
    /// Samples by their phase in a period: the mean of every stretch of phase, and its uncertainty
    Fold(Box<FoldArgs>),
    /// How much of the light comes from which material, sample by sample
    Unmix(Box<UnmixArgs>),
    /// The spectra that a curve is made of, nobody having said which (ATGP)
    Endmembers(Box<EndmembersArgs>),
    /// Samples on the body's frame: reflection, materials, ranges; a curve from a map
    Map(Box<MapArgs>),
    /// The spin axis, period and phase of a body of known shape: by simulating every attitude; one answer, or all that the data do not tell apart
    Attitude(Box<AttitudeArgs>),
}

impl AnalyseCommand {
    /// Where its result goes.
    pub fn output(&self) -> &OutputArgs {
        match self {
            Self::Period(args) => &args.out,
            Self::Spin(args) => &args.out,
            Self::Fold(args) => &args.out,
            Self::Unmix(args) => &args.out,
            Self::Endmembers(args) => &args.out,
            Self::Map(args) => &args.out,
            Self::Attitude(args) => &args.out,
        }
    }
}

/// Does what is asked.
///
/// # Errors
/// A curve that is not what it should be, and what the step refuses, with the reason.
pub fn run(command: &AnalyseCommand, seed: u64, console: Console) -> anyhow::Result<()> {
    match command {
        AnalyseCommand::Period(args) => period::run(args, console),
        AnalyseCommand::Spin(args) => spin::run(args, console),
        AnalyseCommand::Fold(args) => fold::run(args, console),
        AnalyseCommand::Unmix(args) => unmix::run(args, console),
        AnalyseCommand::Endmembers(args) => endmembers::run(args, console),
        AnalyseCommand::Map(args) => map::run(args, console),
        AnalyseCommand::Attitude(args) => attitude::run(args, seed, console),
    }
}
