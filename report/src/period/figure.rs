//! Periodograms and dispersions of all channels, and the curves folded on the best period.

use crate::plot::{Axis, Figure, Panel, Series as Line, Span};
use plotters::style::RGBColor;
use sunglint_analysis::fold::{Folding, fold};
use sunglint_analysis::period::FoundPeriod;
use sunglint_analysis::period::verdict::Outcome;

/// Phase bins of a folded curve, at most.
const BINS: usize = 60;
/// The stretch around a period of the verdict, relative.
const MARK: f64 = 0.004;

/// Figure of the periodograms, the dispersions and the folded curves; `None` where no period could be looked for.
pub fn figure(found: &FoundPeriod) -> Option<Figure> {
    let grid = found.grid?;
    let (lowest, highest) = (1.0 / grid.last_hz(), 1.0 / grid.first_hz);
    let periods: Vec<f64> = (0..grid.n).map(|i| 1.0 / grid.frequency_hz(i)).collect();
    let name = match found.along {
        Some(_) => "period, in the time of the body's clock (s)",
        None => "period (s)",
    };
    let axis = || Axis::log(name).from_to(lowest, highest);
    let over = |values: &[f64]| periods.iter().copied().zip(values.iter().copied()).collect();
    let mut power: Vec<Line> = found
        .drawn
        .iter()
        .enumerate()
        .map(|(k, d)| Line::line(d.name.clone(), k, over(&d.power)))
        .collect();
    power.push(
        Line::line("sampling", 6, over(&found.window))
            .with_colour_and_dash(RGBColor(150, 150, 150), 2),
    );
    let theta = found
        .drawn
        .iter()
        .enumerate()
        .map(|(k, d)| Line::line(d.name.clone(), k, over(&d.theta)))
        .collect();
    let harmonics = match found.harmonics {
        1 => "1 harmonic".to_owned(),
        k => format!("{k} harmonics"),
    };
    let mut panels = vec![
        Panel::new(axis(), Axis::linear(format!("power, {harmonics}")).from_to(0.0, 1.0), power),
        Panel::new(axis(), Axis::linear("phase dispersion Θ"), theta),
    ];
    for panel in &mut panels {
        panel.spans = marks(found);
    }
    panels.extend(folded(found));
    Some(Figure { title: headline(found), panels })
}

fn headline(found: &FoundPeriod) -> String {
    let title = found.curves.title();
    match (&found.verdict.outcome, found.verdict.best) {
        (Outcome::One(e), _) => format!("{title}: one period, {:.5} s", e.period_s),
        (Outcome::Family(members), Some(best)) => {
            format!(
                "{title}: {} periods are possible, the best {:.5} s",
                members.len(),
                best.period_s
            )
        }
        (Outcome::Two(one, other), _) => {
            format!("{title}: two periods, {:.5} s and {:.5} s", one.period_s, other.period_s)
        }
        _ => format!("{title}: not enough data for a period"),
    }
}

/// The verdict's periods as shaded stretches.
fn marks(found: &FoundPeriod) -> Vec<Span> {
    let span = |period: f64, label: &str, colour| Span {
        label: label.into(),
        range: (period * (1.0 - MARK), period * (1.0 + MARK)),
        colour,
    };
    match &found.drawn_verdict().outcome {
        Outcome::One(e) => vec![span(e.period_s, "verdict", RGBColor(250, 200, 120))],
        Outcome::Family(members) => members
            .iter()
            .map(|m| span(m.estimate.period_s, "family", RGBColor(250, 220, 170)))
            .collect(),
        Outcome::Two(one, other) => {
            [one, other].map(|e| span(e.period_s, "two", RGBColor(250, 220, 170))).to_vec()
        }
        _ => Vec::new(),
    }
}

fn folded(found: &FoundPeriod) -> Option<Panel> {
    let period_s = found.folds_on()?;
    let mut lines = Vec::new();
    for (k, drawn) in found.drawn.iter().enumerate() {
        let series = found.series.iter().find(|s| s.name == drawn.name)?;
        let bins = (series.len() / 5).clamp(8, BINS);
        let folding = Folding { period_s, period_sigma_s: None, epoch_s: 0.0, bins };
        let folded = fold(series, &folding).ok()?;
        let mean = series.value.iter().sum::<f64>() / series.len() as f64;
        let points = folded.bins.iter().map(|b| (b.phase, b.mean / mean)).collect();
        lines.push(Line::line(drawn.name.clone(), k, points));
    }
    Some(Panel::new(
        Axis::linear(format!("phase in {period_s:.5} s")).from_to(0.0, 1.0),
        Axis::linear("rate over its mean"),
        lines,
    ))
}
