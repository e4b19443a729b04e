//! `sunglint analyse fold`: samples by their phase in a period.

use super::curves::CurveArgs;
use crate::output::{Console, OutputArgs, Product, rounded};
use crate::plot::{Axis, Figure, Panel, Series as Drawn};
use crate::star::when;
use anyhow::{Context as _, bail};
use clap::Args;
use serde_json::json;
use std::fmt::Write as _;
use sunglint_analysis::fold::{Folded, Folding, fold};
use sunglint_analysis::series::Series;
use sunglint_formats::time::format_utc_shortest;
use sunglint_formats::{Column, Table};

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
    /// Stretches of phase
    #[arg(long, value_name = "N", default_value_t = 50)]
    pub bins: usize,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// A slip of the phases by more than this smears a folded curve.
const MOST_SLIP: f64 = 0.1;

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
    let series = curves.series()?;
    let mut folded = Vec::new();
    let mut warnings = curves.warnings.clone();
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

/// The means of all channels in one panel, relative to each one's own mean.
fn figure(folded: &[(&Series, Folded)], args: &FoldArgs) -> Figure {
    let lines = folded.iter().enumerate().map(|(k, (series, f))| {
        let mean = series.value.iter().sum::<f64>() / series.len() as f64;
        let points = f.bins.iter().map(|b| (b.phase, b.mean / mean)).collect();
        Drawn::line(series.name.clone(), k, points)
    });
    let lines = lines.collect();
    let panel = Panel::new(
        Axis::linear("phase (turns)").from_to(0.0, 1.0),
        Axis::linear("rate over its mean"),
        lines,
    );
    Figure { title: format!("Folded on {} s", args.period), panels: vec![panel] }
}
