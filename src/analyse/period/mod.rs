//! `sunglint analyse period`: the period of a curve, from all channels together.

mod figure;
mod report;

use super::curves::{CurveArgs, Curves};
use super::path::bisectors;
use crate::output::{Console, OutputArgs, Usage};
use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget};
use std::path::PathBuf;
use std::time::Duration;
use sunglint_analysis::period::verdict::{Along, Outcome, verdict_along};
use sunglint_analysis::period::{
    Grid, Options, PeriodError, Verdict, lomb_scargle, pdm, spectrum, verdict, window,
};
use sunglint_analysis::series::Series;
use sunglint_analysis::synodic::Sidereal;
use sunglint_report::Product;

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
    /// Gaps longer than this part a curve into tracks, s: one period for all, with a curve of its own in each, and turns in the gaps are not counted [default: an hour where the whole needs more
    /// frequencies than can be looked at, else no gap parts it]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub gap: Option<f64>,
    /// The scene of the pass (PASS.toml): its orbit and station say how the body is seen from other and other directions, and how far the spin's period may be from the one that is seen
    #[arg(long, value_name = "FILE")]
    pub pass: Option<PathBuf>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// A gap that parts tracks where the whole is too long to be looked at, s: turns over it are not counted by anyone.
const GAP_S: f64 = 3600.0;
/// Rows of the table at most: every k-th frequency where the search has more.
const MOST_ROWS: usize = 20_000;
/// Frequencies to a resolution.
const OVERSAMPLING: f64 = 5.0;
/// Phase bins of the dispersion.
const BINS: usize = 20;

/// A channel's curves over the frequencies of the table.
struct Drawn {
    name: String,
    power: Vec<f64>,
    theta: Vec<f64>,
    /// Amplitudes of the Fourier spectrum where the sampling is regular: at frequencies of its own.
    fourier: Option<sunglint_analysis::period::Spectrum>,
}

/// What is told.
struct Answer {
    curves: Curves,
    series: Vec<Series>,
    verdict: Verdict,
    grid: Option<Grid>,
    drawn: Vec<Drawn>,
    window: Vec<f64>,
    sidereal: Option<Sidereal>,
    along: Option<Along>,
    warnings: Vec<String>,
    harmonics: usize,
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
    let curves = args.curves.read()?;
    let bar = ProgressBar::new_spinner().with_message("looking for periods");
    if console.quiet {
        bar.set_draw_target(ProgressDrawTarget::hidden());
    }
    bar.enable_steady_tick(Duration::from_millis(500));
    let options = Options { shortest_s: args.shortest, longest_s: args.longest };
    let (series, found, tracks) = ask(&curves, args.gap, &options)?;
    let mut warnings = curves.warnings.clone();
    if tracks > 1 {
        warnings.push(format!(
            "{tracks} tracks: turns between them are not counted, and one period is taken to hold in all (each track in a file of its own shows its own period)"
        ));
    }
    let mut answer = Answer {
        warnings,
        curves,
        series,
        grid: None,
        drawn: Vec::new(),
        window: Vec::new(),
        sidereal: None,
        along: None,
        harmonics: usize::from(args.harmonics),
        verdict: found,
    };
    if args.pass.is_some() && tracks > 1 {
        answer.warnings.push("the geometry of --pass is not used: it is that of one pass, and these are several tracks".into());
    }
    if let Some(path) = args.pass.as_ref().filter(|_| tracks == 1)
        && let Some(path) =
            bisectors(path, &args.curves.station, answer.curves.zero, &answer.series)?
    {
        bar.set_message("looking for a clock that goes with the body");
        answer.along = verdict_along(&answer.series, &options, &answer.verdict, &path)?;
        if let Some(along) = &answer.along {
            answer.verdict = along.verdict.clone();
            answer.series.clone_from(&along.series);
        }
        answer.sidereal = answer.drawn_verdict().best.map(|best| path.bounds(best.period_s));
    }
    bar.set_message("drawing the periodograms");
    answer.draw()?;
    bar.finish_and_clear();
    answer.warn();
    for warning in &answer.warnings {
        console.warn(warning);
    }
    let product = Product {
        name: "period".into(),
        table: answer.table(),
        figure: answer.figure(),
        json: answer.json(),
        ..Product::default()
    };
    args.out.finish(&product, &answer.text(), console)
}

/// The verdict on curves, or on their tracks: the series, the verdict, and how many tracks a file has at most.
fn ask(
    curves: &Curves,
    gap_s: Option<f64>,
    options: &Options,
) -> anyhow::Result<(Vec<Series>, Verdict, usize)> {
    if let Some(gap_s) = gap_s {
        let (series, tracks) = curves.tracks(gap_s)?;
        let found = verdict(&series, options)?;
        return Ok((series, found, tracks));
    }
    let series = curves.series()?;
    match verdict(&series, options) {
        Err(error @ PeriodError::TooMany { .. }) => {
            let (parted, tracks) = curves.tracks(GAP_S)?;
            if tracks == 1 {
                return Err(error.into());
            }
            let found = verdict(&parted, options)?;
            Ok((parted, found, tracks))
        }
        found => Ok((series, found?, 1)),
    }
}

impl Answer {
    /// Periodograms, dispersions and the window over the frequencies that were looked at.
    fn draw(&mut self) -> anyhow::Result<()> {
        let Some((shortest_s, longest_s)) = self.verdict.searched_s else { return Ok(()) };
        let span_s = self.series.iter().map(Series::span_s).fold(0.0, f64::max);
        let (first_hz, last_hz) = (1.0 / longest_s, 1.0 / shortest_s);
        let fine = 1.0 / (OVERSAMPLING * self.harmonics as f64 * span_s);
        let step_hz = fine.max((last_hz - first_hz) / MOST_ROWS as f64);
        if step_hz > 1.5 * fine {
            self.warnings.push(format!(
                "table and figure hold {MOST_ROWS} frequencies, one in {:.0}: narrow peaks may fall between them; the verdict saw all",
                step_hz / fine
            ));
        }
        let n = ((last_hz - first_hz) / step_hz).floor() as usize + 1;
        let grid = Grid { first_hz, step_hz, n };
        let periods: Vec<f64> = (0..n).map(|i| 1.0 / grid.frequency_hz(i)).collect();
        let left_out = |s: &Series| self.verdict.left_out.iter().any(|(name, _)| *name == s.name);
        let mut drawn = Vec::new();
        for series in self.series.iter().filter(|s| !left_out(s)) {
            let bins = BINS.min(series.len() / 3).max(2);
            drawn.push(Drawn {
                name: series.name.clone(),
                power: lomb_scargle(series, &grid, self.harmonics)?,
                theta: pdm(series, &periods, bins)?.iter().map(|d| d.theta).collect(),
                fourier: spectrum(series).ok().filter(|s| s.beside == 0),
            });
        }
        let longest = self.series.iter().max_by(|a, b| a.span_s().total_cmp(&b.span_s()));
        if let Some(series) = longest {
            let even = Series { weight: vec![1.0; series.len()], ..series.clone() };
            self.window = window(&even, &grid)?;
        }
        (self.grid, self.drawn) = (Some(grid), drawn);
        Ok(())
    }

    fn warn(&mut self) {
        for (name, error) in &self.verdict.left_out {
            let text = error.to_string();
            let named = text.starts_with(name.as_str());
            self.warnings.push(if named {
                format!("left out: {text}")
            } else {
                format!("left out: {name}: {text}")
            });
        }
        for series in &self.series {
            let odd = series.left_out;
            if odd.same_time > 0 {
                self.warnings.push(format!(
                    "{}: {} samples share their time with another: all are used",
                    series.name, odd.same_time
                ));
            }
            if !series.is_weighted && !series.is_empty() {
                self.warnings.push(format!(
                    "{}: an uncertainty is 0 or missing: all samples weigh the same",
                    series.name
                ));
            }
        }
        for drawn in &self.drawn {
            if let Some(fourier) = drawn.fourier.as_ref().filter(|f| f.missing > 0) {
                self.warnings.push(format!(
                    "{}: the Fourier spectrum takes {} missing samples for the mean",
                    drawn.name, fourier.missing
                ));
            }
        }
    }

    /// The period to fold on: the verdict's best, if it has one that was accepted.
    fn folds_on(&self) -> Option<f64> {
        let verdict = self.drawn_verdict();
        match &verdict.outcome {
            Outcome::One(_) | Outcome::Family(_) => verdict.best.map(|b| b.period_s),
            _ => None,
        }
    }

    /// The verdict in the time of the series, which may be a clock's.
    fn drawn_verdict(&self) -> &Verdict {
        self.along.as_ref().map_or(&self.verdict, |along| &along.in_clock)
    }
}
