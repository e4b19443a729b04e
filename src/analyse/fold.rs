//! `sunglint analyse fold`: samples by their phase in a period.

use super::curves::CurveArgs;
use super::path::bisectors;
use crate::output::{Console, OutputArgs};
use crate::star::when;
use anyhow::{Context as _, bail};
use clap::Args;
use hifitime::Epoch;
use serde_json::json;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use sunglint_analysis::fold::{Folded, Folding, fold};
use sunglint_analysis::map::Spin;
use sunglint_analysis::series::Series;
use sunglint_analysis::synodic::Turn;
use sunglint_formats::time::format_utc_shortest;
use sunglint_formats::{Column, Table};
use sunglint_report::plot::{Axis, Figure, Heat, Panel, Series as Drawn};
use sunglint_report::{Product, rounded};

/// Arguments of `sunglint analyse fold`.
#[derive(Debug, Args)]
pub struct FoldArgs {
    /// Which curves.
    #[command(flatten)]
    pub curves: CurveArgs,
    /// The period, s
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub period: f64,
    /// Its standard uncertainty, s
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub period_sigma: Option<f64>,
    /// The moment of phase 0 [default: the first sample]
    #[arg(long, value_name = "TIME")]
    pub epoch: Option<String>,
    /// The scene of the pass (PASS.toml), for --axis: its orbit and station
    #[arg(long, value_name = "FILE", requires = "axis")]
    pub pass: Option<PathBuf>,
    /// Right ascension and declination of the spin axis, degrees: phases then count turns of the body under the bisector of Sun and station, and --period is that of the spin (sidereal; turns are
    /// right-handed about the axis)
    #[arg(long, value_name = "RA,DEC", value_parser = axis, requires = "pass", allow_hyphen_values = true)]
    pub axis: Option<(f64, f64)>,
    /// Stretches of phase
    #[arg(long, value_name = "N", default_value_t = 50)]
    pub bins: usize,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// A slip of the phases by more than this smears a folded curve.
const MOST_SLIP: f64 = 0.1;

/// With fewer turns nothing was seen to repeat.
const LEAST_TURNS: f64 = 2.0;
/// Series that are drawn turn by turn.
const DRAWN: usize = 6;
/// Rows of such a panel.
const MOST_ROWS: usize = 400;
/// Colours reach so many decades below the largest rate.
const DECADES: f64 = 2.0;

pub(super) fn run(args: &FoldArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let curves = args.curves.read()?;
    let epoch = match &args.epoch {
        Some(text) => when(text).context("--epoch")?,
        None => curves.zero,
    };
    let folding = Folding {
        period_s: args.period,
        period_sigma_s: args.period_sigma,
        epoch_s: (epoch - curves.zero).to_seconds(),
        bins: args.bins,
    };
    let mut series = curves.series()?;
    let mut folding = folding;
    let mut folded = Vec::new();
    let mut warnings = curves.warnings.clone();
    if let (Some(pass), Some(axis)) = (&args.pass, args.axis) {
        let turn = turn(args, pass, axis, curves.zero, &series)?;
        let clocked = |s: &Series| {
            let clocked = turn.clocked(s, 1.0 / args.period);
            clocked.with_context(|| format!("about this axis the bisector of Sun and station turns faster than once in {} s: the body has no phase", args.period))
        };
        folding.epoch_s -= turn.at(folding.epoch_s) * args.period;
        series = series.iter().map(clocked).collect::<anyhow::Result<_>>()?;
    }
    for series in &series {
        if series.is_empty() {
            warnings.push(format!(
                "{}: no sample without a flag that changes its rate: left out",
                series.name
            ));
            continue;
        }
        folded.push((series, fold(series, &folding)?));
    }
    if folded.is_empty() {
        bail!("there is no sample to fold: {}", warnings.join("; "));
    }
    let turns = folded.iter().map(|(_, f)| f.turns).fold(0.0, f64::max);
    if turns < LEAST_TURNS {
        warnings.push(format!("the data cover {turns:.2} turns of {} s: a curve that repeats is seen over {LEAST_TURNS} or more", args.period));
    }
    let slip = folded.iter().filter_map(|(_, f)| f.slip).fold(0.0, f64::max);
    if slip > MOST_SLIP {
        warnings.push(format!("the period's uncertainty lets first and last phase slip by {slip:.2} of a turn: the folded curve is smeared"));
    }
    for warning in &warnings {
        console.warn(warning);
    }
    let product = Product {
        name: "folded".into(),
        table: table(&folded),
        figure: Some(figure(&folded, args)),
        json: json!({
            "period_s": rounded(args.period),
            "period_sigma_s": args.period_sigma.map(rounded),
            "axis": args.axis.map(|(ra, dec)| json!({ "ra_deg": rounded(ra), "dec_deg": rounded(dec) })),
            "epoch_utc": format_utc_shortest(epoch),
            "bins": args.bins,
            "channels": folded.iter().map(|(s, f)| json!({
                "name": s.name,
                "samples": s.len(),
                "flagged": s.left_out.flagged,
                "turns": rounded(f.turns),
                "slip_turns": f.slip.map(rounded),
            })).collect::<Vec<_>>(),
            "warnings": warnings,
            "removed": curves.removed,
            "inputs": curves.inputs_json(),
        }),
        ..Product::default()
    };
    args.out.finish(&product, &text(&folded, args, &format_utc_shortest(epoch)), console)
}

/// Two angles, degrees.
fn axis(text: &str) -> Result<(f64, f64), String> {
    let wrong = || {
        format!("expected a right ascension and a declination, degrees, as 83.6,22.0, found {text}")
    };
    let (ra, dec) = text.split_once(',').ok_or_else(wrong)?;
    let number = |t: &str| t.trim().parse::<f64>().map_err(|_| wrong());
    let (ra_deg, dec_deg) = (number(ra)?, number(dec)?);
    if !(ra_deg.is_finite() && (-90.0..=90.0).contains(&dec_deg)) {
        return Err(wrong());
    }
    Ok((ra_deg, dec_deg))
}

/// The turn of the bisector about the axis that was given.
fn turn(
    args: &FoldArgs,
    pass: &Path,
    (ra_deg, dec_deg): (f64, f64),
    zero: Epoch,
    series: &[Series],
) -> anyhow::Result<Turn> {
    if !(args.period.is_finite() && args.period > 0.0) {
        bail!("the period is {} s, expected a time above 0", args.period);
    }
    let path = bisectors(pass, &args.curves.station, zero, series)?;
    let path =
        path.context("the samples are too few to know how the bisector of Sun and station moves")?;
    path.turned(Spin::of(ra_deg, dec_deg, args.period).axis)
        .context("the axis meets the bisector of Sun and station: about it nothing turns")
}

fn text(folded: &[(&Series, Folded)], args: &FoldArgs, epoch: &str) -> String {
    let mut text =
        format!("folded on {} s from {epoch}, {} phase bins\n\n", args.period, args.bins);
    let _ = writeln!(
        text,
        "  channel          samples     turns     lowest mean    highest mean  at phase"
    );
    for (series, f) in folded {
        let filled = || f.bins.iter().filter(|b| b.samples > 0);
        let high = filled().max_by(|a, b| a.mean.total_cmp(&b.mean));
        let low = filled().min_by(|a, b| a.mean.total_cmp(&b.mean));
        let (Some(high), Some(low)) = (high, low) else { continue };
        let _ = writeln!(
            text,
            "  {:<14} {:>9} {:>9.2} {:>12.5e} Hz {:>12.5e} Hz {:>9.3}",
            series.name,
            series.len(),
            f.turns,
            low.mean,
            high.mean,
            high.phase
        );
    }
    text
}

fn table(folded: &[(&Series, Folded)]) -> Table {
    let rows = || folded.iter().flat_map(|(s, f)| f.bins.iter().map(move |bin| (s, bin)));
    let columns = vec![
        Column::text("channel", rows().map(|(s, _)| s.name.clone()).collect()),
        Column::f64("phase", None, rows().map(|(_, b)| b.phase).collect()),
        Column::f64("mean_hz", Some("Hz"), rows().map(|(_, b)| b.mean).collect()),
        Column::f64("sigma_hz", Some("Hz"), rows().map(|(_, b)| b.sigma).collect()),
        Column::f64("scatter_hz", Some("Hz"), rows().map(|(_, b)| b.scatter).collect()),
        Column::i64("samples", None, rows().map(|(_, b)| b.samples as i64).collect()),
    ];
    Table { columns, ..Table::default() }
}

/// The means of all channels in one panel, relative to each one's own mean, and below it turn by turn.
fn figure(folded: &[(&Series, Folded)], args: &FoldArgs) -> Figure {
    let lines = folded.iter().enumerate().map(|(k, (series, f))| {
        let mean = series.value.iter().sum::<f64>() / series.len() as f64;
        let filled = f.bins.iter().filter(|b| b.samples > 0);
        let points = filled.map(|b| (b.phase, b.mean / mean)).collect();
        Drawn::line(series.name.clone(), k, points)
    });
    let lines = lines.collect();
    let panel = Panel::new(
        Axis::linear("phase (turns)").from_to(0.0, 1.0),
        Axis::linear("rate over its mean"),
        lines,
    );
    let mut panels = vec![panel];
    panels.extend(folded.iter().take(DRAWN).filter_map(|(s, f)| turn_by_turn(s, f)));
    Figure { title: format!("Folded on {} s", args.period), panels }
}

/// Light over phase, turns above one another: what moves from turn to turn is seen to move (thesis figure 7.5a). Nothing with fewer than two turns.
fn turn_by_turn(series: &Series, folded: &Folded) -> Option<Panel> {
    let (first, last) = (*folded.turn.iter().min()?, *folded.turn.iter().max()?);
    let turns = usize::try_from(last - first).ok()? + 1;
    if turns < 2 {
        return None;
    }
    // Several turns to a row where there are too many to be seen, and no more phases than a turn has samples.
    let per_row = turns.div_ceil(MOST_ROWS);
    let rows = turns.div_ceil(per_row);
    let columns = (series.len() / rows).clamp(8, folded.bins.len().max(8));
    let mean = series.value.iter().sum::<f64>() / series.len() as f64;
    let mut sums = vec![(0.0, 0.0); rows * columns];
    for ((phase, turn), value) in folded.phase.iter().zip(&folded.turn).zip(&series.value) {
        let column = ((phase * columns as f64) as usize).min(columns - 1);
        let row = usize::try_from(turn - first).ok()? / per_row;
        let sum = &mut sums[column * rows + row];
        *sum = (sum.0 + value / mean, sum.1 + 1.0);
    }
    let heat = Heat {
        x_edges: (0..=columns).map(|c| c as f64 / columns as f64).collect(),
        y_edges: (0..=rows).map(|r| (first + (r * per_row) as i64) as f64).collect(),
        values: sums
            .into_iter()
            .map(|(sum, n)| if sum > 0.0 { sum / n } else { f64::NAN })
            .collect(),
        label: vec![series.name.clone(), "rate over".into(), "its mean".into()],
        decades: Some(DECADES),
    };
    let (x, y) = (Axis::linear("phase (turns)"), Axis::linear("turn"));
    heat.has_light().then(|| Panel { heat: Some(heat), ..Panel::new(x, y, vec![]) })
}
