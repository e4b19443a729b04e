//! Folded light curves: every sample by its phase in a period.

use crate::plot::{Axis, Figure, Heat, Panel, Series as Drawn};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_analysis::fold::{Folded, FoldedChannel, FoldedCurves};
use sunglint_analysis::series::Series;
use sunglint_formats::time::format_utc_shortest;
use sunglint_formats::{Column, Table};
use sunglint_radiometry::light_curve::Input;

/// Series that are drawn turn by turn.
const DRAWN: usize = 6;
/// Rows of such a panel.
const MOST_ROWS: usize = 400;
/// Colours reach so many decades below the largest rate.
const DECADES: f64 = 2.0;

/// All forms of the result.
pub fn product(found: &FoldedCurves) -> Product {
    Product {
        name: "folded".into(),
        table: table(found),
        figure: Some(figure(found)),
        json: json(found),
        ..Product::default()
    }
}

#[derive(Serialize)]
struct AxisJson {
    ra_deg: f64,
    dec_deg: f64,
}

#[derive(Serialize)]
struct ChannelJson<'a> {
    name: &'a str,
    samples: usize,
    flagged: usize,
    turns: f64,
    slip_turns: Option<f64>,
}

#[derive(Serialize)]
struct FoldJson<'a> {
    period_s: f64,
    period_sigma_s: Option<f64>,
    axis: Option<AxisJson>,
    epoch_utc: String,
    bins: usize,
    unit: Option<&'a str>,
    channels: Vec<ChannelJson<'a>>,
    warnings: &'a [String],
    removed: &'a [String],
    inputs: &'a [Input],
}

/// Summary with its documented keys.
pub fn json(found: &FoldedCurves) -> Value {
    let axis = |(ra, dec)| AxisJson { ra_deg: rounded(ra), dec_deg: rounded(dec) };
    let channels = found.channels.iter().map(|c| ChannelJson {
        name: &c.series.name,
        samples: c.series.len(),
        flagged: c.series.left_out.flagged,
        turns: rounded(c.folded.turns),
        slip_turns: c.folded.slip.map(rounded),
    });
    json_of(&FoldJson {
        period_s: rounded(found.period_s),
        period_sigma_s: found.period_sigma_s.map(rounded),
        axis: found.axis_deg.map(axis),
        epoch_utc: format_utc_shortest(found.epoch),
        bins: found.bins,
        unit: found.are_rates.then_some("Hz"),
        channels: channels.collect(),
        warnings: &found.warnings,
        removed: &found.removed,
        inputs: &found.inputs,
    })
}

/// Text of the lowest and the highest means.
pub fn text(found: &FoldedCurves) -> String {
    let epoch = format_utc_shortest(found.epoch);
    let mut text =
        format!("folded on {} s from {epoch}, {} phase bins\n\n", found.period_s, found.bins);
    let unit = if found.are_rates { "Hz" } else { "  " };
    let _ = writeln!(
        text,
        "  channel          samples     turns     lowest mean    highest mean  at phase"
    );
    for FoldedChannel { series, folded: f } in &found.channels {
        let filled = || f.bins.iter().filter(|b| b.samples > 0);
        let high = filled().max_by(|a, b| a.mean.total_cmp(&b.mean));
        let low = filled().min_by(|a, b| a.mean.total_cmp(&b.mean));
        let (Some(high), Some(low)) = (high, low) else { continue };
        let _ = writeln!(
            text,
            "  {:<14} {:>9} {:>9.2} {:>12.5e} {unit} {:>12.5e} {unit} {:>9.3}",
            series.name,
            series.len(),
            f.turns,
            low.mean,
            high.mean,
            high.phase
        );
    }
    if !found.are_rates {
        text.push_str("  means are fluxes, relative to that of magnitude 0\n");
    }
    text
}

/// Table with a row for each stretch of phase of each channel.
pub fn table(found: &FoldedCurves) -> Table {
    let rows = || {
        found.channels.iter().flat_map(|c| c.folded.bins.iter().map(move |bin| (&c.series, bin)))
    };
    let unit = found.are_rates.then_some("Hz");
    let name = |what: &str| format!("{what}_{}", if found.are_rates { "hz" } else { "flux" });
    let columns = vec![
        Column::text("channel", rows().map(|(s, _)| s.name.clone()).collect()),
        Column::f64("phase", None, rows().map(|(_, b)| b.phase).collect()),
        Column::f64(name("mean"), unit, rows().map(|(_, b)| b.mean).collect()),
        Column::f64(name("sigma"), unit, rows().map(|(_, b)| b.sigma).collect()),
        Column::f64(name("scatter"), unit, rows().map(|(_, b)| b.scatter).collect()),
        Column::i64("samples", None, rows().map(|(_, b)| b.samples as i64).collect()),
    ];
    Table { columns, ..Table::default() }
}

/// Figure of the means of all channels in one panel, relative to each one's own mean, and below it turn by turn.
pub fn figure(found: &FoldedCurves) -> Figure {
    let lines =
        found.channels.iter().enumerate().map(|(k, FoldedChannel { series, folded: f })| {
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
    panels.extend(
        found.channels.iter().take(DRAWN).filter_map(|c| turn_by_turn(&c.series, &c.folded)),
    );
    Figure { title: format!("Folded on {} s", found.period_s), panels }
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
