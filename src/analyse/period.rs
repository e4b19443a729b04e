//! `sunglint analyse period`: the period of a curve, from all channels together.

use super::curves::CurveArgs;
use crate::output::{Console, OutputArgs, Usage};
use crate::progress::Bar;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use sunglint_analysis::curves::Curves;
use sunglint_analysis::period::{
    GEOMETRY_NOT_USED, Options, PERIOD_CHANGES, PeriodOptions, find_period,
};
use sunglint_analysis::series::Series;
use sunglint_analysis::sessions::{self, find_over_sessions};
use sunglint_report::period;

/// How several nights are taken together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum Nights {
    /// Joined where a column `session` or several files make them, and the body is not near: no range below a million kilometres, and without a range curves that last longer than the pass of a satellite
    #[default]
    Auto,
    /// With a zero point for each session and filter, and phase kept through the gaps
    Joined,
    /// Each with a curve of its own: turns between them are not counted
    Apart,
}

/// Arguments of `sunglint analyse period`.
#[derive(Debug, Args)]
pub struct PeriodArgs {
    /// Which curves.
    #[command(flatten)]
    pub curves: CurveArgs,
    /// The shortest period to look for, s [default: twice the samples' median step, or twice the exposure where that is longer]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub shortest: Option<f64>,
    /// The longest period to look for, s [default: half of the data's span]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub longest: Option<f64>,
    /// Harmonics of the periodogram in table and figure (the verdict chooses its own)
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=8))]
    pub harmonics: u8,
    /// Gaps longer than this part a curve into tracks, s: one period for all, with a curve of its own in each, and turns in the gaps are not counted [default: an hour for a near body, and where the whole needs more
    /// frequencies than can be looked at; else no gap parts it]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub gap: Option<f64>,
    /// How several sessions (a column `session`, several files) are taken together
    #[arg(long, value_enum, default_value_t)]
    pub sessions: Nights,
    /// The scene of the pass (PASS.toml): its orbit and station say how the body is seen from other and other directions, and how far the spin's period may be from the one that is seen
    #[arg(long, value_name = "FILE")]
    pub pass: Option<PathBuf>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

pub(super) fn run(args: &PeriodArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    args.out.check_names(&["period.ecsv"])?;
    let seconds = [("--shortest", args.shortest), ("--longest", args.longest), ("--gap", args.gap)];
    for (option, value) in seconds {
        if let Some(value) = value.filter(|v| !(v.is_finite() && *v > 0.0)) {
            return Err(Usage(format!("{option} is {value}, expected seconds above 0")).into());
        }
    }
    let joins = |curves: &Curves| match args.sessions {
        Nights::Joined => true,
        Nights::Apart => false,
        Nights::Auto => args.pass.is_none() && args.gap.is_none() && curves.are_sessions(),
    };
    let curves = args.curves.read_and(joins)?;
    if joins(&curves) {
        return over_sessions(args, curves, console);
    }
    let zero = curves.zero;
    let options = PeriodOptions {
        search: Options { shortest_s: args.shortest, longest_s: args.longest },
        gap_s: args.gap,
        harmonics: usize::from(args.harmonics),
    };
    let bisectors = args
        .pass
        .as_ref()
        .map(|scene| move |series: &[Series]| args.curves.bisectors(scene, zero, series));
    let geometry = bisectors.as_ref().map(|bisectors| bisectors as _);
    let spinner = Bar::new(console);
    let mut found = find_period::<anyhow::Error>(curves, &options, geometry, &spinner)?;
    spinner.end();
    for warning in &mut found.warnings {
        if warning == GEOMETRY_NOT_USED {
            *warning = "the geometry of --pass is not used: it is that of one pass, and these are several tracks (`analyse spin` takes passes together)".into();
        }
        if warning.starts_with(PERIOD_CHANGES) {
            warning.push_str(" (`analyse spin` takes passes together)");
        }
        console.warn(warning);
    }
    args.out.finish(&period::product(&found), &period::text(&found), console)
}

/// Looks for one period over all sessions.
fn over_sessions(args: &PeriodArgs, curves: Curves, console: Console) -> anyhow::Result<()> {
    for (option, given) in [("--pass", args.pass.is_some()), ("--gap", args.gap.is_some())] {
        if given {
            return Err(Usage(format!("{option} does not go with --sessions joined")).into());
        }
    }
    let options = sessions::Options::between(args.shortest, args.longest);
    let spinner = Bar::new(console);
    let found = find_over_sessions(curves, &options, &spinner)?;
    spinner.end();
    for warning in &found.found.warnings {
        console.warn(warning);
    }
    args.out.finish(&period::sessions::product(&found), &period::sessions::text(&found), console)
}
