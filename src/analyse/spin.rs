//! `sunglint analyse spin`: axis, sense, period and drift of a body over passes.

use super::curves::CurveArgs;
use crate::output::{Console, OutputArgs, Usage};
use crate::progress::Bar;
use anyhow::bail;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use sunglint_analysis::period::Options;
use sunglint_analysis::spin::{Body, SpinOptions, SpinPass, by_pass, find_spin};
use sunglint_numerics::progress::Progress as _;
use sunglint_report::spin::SpinReport;

/// Arguments of `sunglint analyse spin`.
#[derive(Debug, Args)]
pub struct SpinArgs {
    /// Which curves.
    #[command(flatten)]
    pub curves: CurveArgs,
    /// A scene (PASS.toml): its orbit and station say how the body is seen from other and other directions; target and attitude do not count
    #[arg(long, value_name = "FILE")]
    pub pass: PathBuf,
    /// The shortest period to look for in a pass, s [default: twice the samples' median step, or twice the exposure where that is longer]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub shortest: Option<f64>,
    /// The longest period to look for in a pass, s [default: half of the pass]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub longest: Option<f64>,
    /// Gaps longer than this part passes, s
    #[arg(long, value_name = "S", default_value_t = 600.0, allow_negative_numbers = true)]
    pub gap: f64,
    /// Standard deviation of the drift that is to be expected, as a share of the period a day
    #[arg(long, value_name = "SHARE", default_value_t = 1e-3, allow_negative_numbers = true)]
    pub drift: f64,
    /// Shape of the body, where it is known: `long` if it is a rocket's stage or otherwise long and tumbles across its length, so that it shows two maxima a turn
    #[arg(long, value_enum, default_value_t = BodyKind::Any)]
    pub body: BodyKind,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Knowledge of a body's shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BodyKind {
    /// Nothing
    Any,
    /// Long, tumbling across its length: two maxima a turn
    Long,
}

impl From<BodyKind> for Body {
    fn from(kind: BodyKind) -> Self {
        match kind {
            BodyKind::Any => Self::Any,
            BodyKind::Long => Self::Long,
        }
    }
}

pub(super) fn run(args: &SpinArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    args.out.check_names(&["spin.ecsv"])?;
    let numbers = [
        ("--shortest", args.shortest),
        ("--longest", args.longest),
        ("--gap", Some(args.gap)),
        ("--drift", Some(args.drift)),
    ];
    for (option, value) in numbers {
        if let Some(value) = value.filter(|v| !(v.is_finite() && *v > 0.0)) {
            return Err(Usage(format!("{option} is {value}, expected a number above 0")).into());
        }
    }
    let curves = args.curves.read()?;
    let mut warnings = curves.warnings.clone();
    let (pieces, _) = curves.tracks(args.gap)?;
    let mut seen = Vec::new();
    for (k, series) in by_pass(pieces, args.gap).into_iter().enumerate() {
        let name = format!("pass {}", k + 1);
        match args.curves.bisectors(&args.pass, curves.zero, &series)? {
            Some(path) => seen.push(SpinPass { name, series, path }),
            None => warnings.push(format!(
                "{name}: left out, it has fewer than two moments, or Sun and station stand opposite one another"
            )),
        }
    }
    if seen.is_empty() {
        bail!("no pass is left: see the warnings");
    }
    let options = SpinOptions {
        search: Options { shortest_s: args.shortest, longest_s: args.longest },
        drift_per_day: args.drift,
        body: args.body.into(),
    };
    let spinner = Bar::new(console);
    spinner.begin(&format!("looking for the spin over {} passes", seen.len()), None);
    let found = find_spin(&seen, &options)?;
    spinner.end();
    for warning in &warnings {
        console.warn(warning);
    }
    let report =
        SpinReport { found: &found, body: options.body, curves: &curves, warnings: &warnings };
    args.out.finish(&report.product(), &report.text(), console)
}
