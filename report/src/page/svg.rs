//! The charts as they stand on paper: vector graphics of few strokes, coloured by the page's style.

use super::chart::{Chart, Kind, Line, Scale};
use super::escape::Text;
use crate::plot::{labels, ticks};
use std::fmt::Write as _;

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 250.0;
const LEFT: f64 = 66.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 8.0;
const BOTTOM: f64 = 40.0;
/// Columns in which dots are put together.
const COLUMNS: usize = 220;
/// Points of a line.
const POINTS: usize = 600;
/// A line is broken at gaps longer than so many usual steps.
const GAP: f64 = 5.0;

/// Scales from values to places on the paper.
struct Paper {
    x: (f64, f64),
    y: (f64, f64),
    scale: Scale,
}

impl Paper {
    fn across(&self, x: f64) -> f64 {
        LEFT + (WIDTH - LEFT - RIGHT) * (x - self.x.0) / (self.x.1 - self.x.0)
    }

    fn up(&self, y: f64) -> f64 {
        let of = |v: f64| if self.scale == Scale::Log { v.log10() } else { v };
        let f = (of(y) - of(self.y.0)) / (of(self.y.1) - of(self.y.0));
        let f = if self.scale == Scale::Inverted { 1.0 - f } else { f };
        TOP + (HEIGHT - TOP - BOTTOM) * (1.0 - f.clamp(-0.02, 1.02))
    }

    fn good(&self, y: f64) -> bool {
        y.is_finite() && (self.scale != Scale::Log || y > 0.0)
    }
}

/// The ends of the vertical axis: those that are given, else those of the points, with a margin. A logarithmic one goes over six decades at most.
pub(super) fn range(chart: &Chart) -> (f64, f64) {
    if let Some(range) = chart.range {
        return range;
    }
    let log = chart.scale == Scale::Log;
    let counts = chart.lines.iter().filter(|l| l.kind != Kind::Out);
    let good = counts.flat_map(|l| &l.y).copied().filter(|v| v.is_finite() && (!log || *v > 0.0));
    let (low, high) =
        good.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    match (low > high, log) {
        (true, true) => (0.1, 1.0),
        (true, false) => (0.0, 1.0),
        (false, true) => (low.max(1e-6 * high) / 1.3, high * 1.3),
        (false, false) => {
            let margin = 0.06 * (high - low).max(1e-9 * high.abs()).max(1e-12);
            (low - margin, high + margin)
        }
    }
}

pub(super) fn draw(page: &mut String, chart: &Chart, x_label: &str, x: (f64, f64)) {
    let x = if x.1 > x.0 { x } else { (x.0 - 0.5, x.0 + 0.5) };
    let paper = Paper { x, y: range(chart), scale: chart.scale };
    let _ = writeln!(
        page,
        "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}: {}\">",
        Text(&chart.title),
        Text(&chart.label)
    );
    let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
    let across = ticks(x.0, x.1, false, 8);
    for (tick, label) in across.iter().copied().zip(labels(&across)) {
        let at = paper.across(tick);
        let _ = writeln!(
            page,
            "<path class=\"grid\" d=\"M{at:.1} {TOP}V{bottom}\"/><text x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            bottom + 15.0,
            label
        );
    }
    let up = ticks(paper.y.0, paper.y.1, chart.scale == Scale::Log, 6);
    for (tick, label) in up.iter().copied().zip(labels(&up)) {
        let at = paper.up(tick);
        let _ = writeln!(
            page,
            "<path class=\"grid\" d=\"M{LEFT} {at:.1}H{right}\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            LEFT - 6.0,
            at + 4.0,
            label
        );
    }
    let _ = writeln!(
        page,
        "<path class=\"axis\" d=\"M{LEFT} {TOP}V{bottom}H{right}\"/><text class=\"name\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text><text class=\"name\" transform=\"translate(13 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
        0.5 * (LEFT + right),
        HEIGHT - 6.0,
        Text(x_label),
        0.5 * (TOP + bottom),
        Text(&chart.label)
    );
    if let Some(rule) = chart.rule {
        let _ =
            writeln!(page, "<path class=\"rule\" d=\"M{LEFT} {:.1}H{right}\"/>", paper.up(rule));
    }
    for line in &chart.lines {
        match line.kind {
            Kind::Dots => dots(page, &paper, line),
            Kind::Line => stroke(page, &paper, line),
            // On paper the tables say what was left out.
            Kind::Out => {}
        }
    }
    page.push_str("</svg>\n");
}

/// The class of a line: its place in the palette, and the channel by which it is switched.
fn class(line: &Line) -> String {
    match line.channel {
        Some(channel) => format!("h{} ch{channel}", line.hue),
        None => format!("h{}", line.hue),
    }
}

/// A dot a column at the mean, over a bar from the smallest to the largest value; few points each for itself, over bars of their uncertainties.
fn dots(page: &mut String, paper: &Paper, line: &Line) {
    let few = line.x.len() <= COLUMNS;
    let mut columns: Vec<Vec<usize>> = vec![Vec::new(); if few { line.x.len() } else { COLUMNS }];
    for (i, (x, y)) in line.x.iter().zip(&line.y).enumerate() {
        let f = (x - paper.x.0) / (paper.x.1 - paper.x.0);
        if paper.good(*y) && (0.0..=1.0).contains(&f) {
            let column = if few { i } else { ((f * COLUMNS as f64) as usize).min(COLUMNS - 1) };
            columns[column].push(i);
        }
    }
    let (mut bars, mut marks) = (String::new(), String::new());
    for own in columns.iter().filter(|own| !own.is_empty()) {
        let n = own.len() as f64;
        let mean = |v: &[f64]| own.iter().map(|i| v[*i]).sum::<f64>() / n;
        let (x, y) = (mean(&line.x), mean(&line.y));
        let ends = if few {
            let s = line.sigma.get(own[0]).copied().filter(|s| s.is_finite()).unwrap_or(0.0);
            (y - s, y + s)
        } else {
            let all = own.iter().map(|i| line.y[*i]);
            all.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)))
        };
        let across = paper.across(x);
        if ends.0 < ends.1 {
            let low = if paper.good(ends.0) { paper.up(ends.0) } else { HEIGHT - BOTTOM };
            let _ = write!(bars, "M{across:.1} {low:.1}V{:.1}", paper.up(ends.1));
        }
        let _ = write!(marks, "M{across:.1} {:.1}h0", paper.up(y));
    }
    let _ = writeln!(
        page,
        "<g class=\"{}\"><path class=\"span\" d=\"{bars}\"/><path class=\"dot\" d=\"{marks}\"/></g>",
        class(line)
    );
}

fn stroke(page: &mut String, paper: &Paper, line: &Line) {
    let mut steps: Vec<f64> = line.x.windows(2).map(|p| p[1] - p[0]).filter(|s| *s > 0.0).collect();
    steps.sort_by(f64::total_cmp);
    let stride = line.x.len().div_ceil(POINTS).max(1);
    // One step in ten may be longer: calculated curves have most of their points about a peak.
    let usual = steps.get(steps.len() * 9 / 10).copied().unwrap_or(f64::INFINITY);
    let gap = GAP * usual * stride as f64;
    let mut path = String::new();
    let mut before: Option<f64> = None;
    for (i, (x, y)) in line.x.iter().zip(&line.y).enumerate() {
        if !i.is_multiple_of(stride) && i + 1 != line.x.len() {
            continue;
        }
        if !paper.good(*y) {
            before = None;
            continue;
        }
        let letter = if before.is_some_and(|b| x - b <= gap) { 'L' } else { 'M' };
        let _ = write!(path, "{letter}{:.1} {:.1}", paper.across(*x), paper.up(*y));
        before = Some(*x);
    }
    let _ = writeln!(page, "<g class=\"{}\"><path class=\"line\" d=\"{path}\"/></g>", class(line));
}
