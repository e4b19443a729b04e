//! Charts as numbers.

use super::escape::Text;
use super::svg;
use crate::plot::base64;
use serde::Serialize;
use std::fmt::Write as _;

/// Kind of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Evenly.
    Linear,
    /// By factors; what is not above 0 is marked at the edge.
    Log,
    /// Evenly, from the largest value to the smallest: magnitudes.
    Inverted,
}

impl Scale {
    fn name(self) -> &'static str {
        match self {
            Scale::Linear => "linear",
            Scale::Log => "log",
            Scale::Inverted => "inverted",
        }
    }
}

/// Style of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A dot a point.
    Dots,
    /// A line through the points, broken at what is no number and at gaps.
    Line,
    /// A mark a point that does not count.
    Out,
}

/// Points of one kind.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Name of the values.
    pub name: String,
    /// The channel that they are of; `None` of none.
    pub channel: Option<usize>,
    /// Their place in the palette where they are of no channel.
    pub hue: usize,
    /// Style of the lines.
    pub kind: Kind,
    /// Where, increasing.
    pub x: Vec<f64>,
    /// Values; NaN where there is nothing.
    pub y: Vec<f64>,
    /// Standard uncertainties; empty where there are none.
    pub sigma: Vec<f64>,
}

impl Line {
    /// Dots without uncertainties.
    pub fn dots(name: &str, channel: Option<usize>, x: Vec<f64>, y: Vec<f64>) -> Self {
        let (hue, sigma) = (0, Vec::new());
        Self { name: name.into(), channel, hue, kind: Kind::Dots, x, y, sigma }
    }

    /// The same in another kind.
    #[must_use]
    pub fn of_kind(self, kind: Kind) -> Self {
        Self { kind, ..self }
    }
}

/// A chart.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// Name in the page: letters.
    pub id: &'static str,
    /// Title.
    pub title: String,
    /// Quantity and unit of its vertical axis.
    pub label: String,
    /// Quantity and unit of its horizontal axis, where its group has none for it.
    pub x_label: String,
    /// Kind of its vertical axis.
    pub scale: Scale,
    /// The ends of that; from the points where `None`.
    pub range: Option<(f64, f64)>,
    /// A value that is marked across.
    pub rule: Option<f64>,
    /// Lines that it shows.
    pub lines: Vec<Line>,
}

impl Chart {
    /// A chart over its points.
    pub fn new(id: &'static str, title: &str, label: &str, scale: Scale, lines: Vec<Line>) -> Self {
        Self {
            id,
            title: title.into(),
            label: label.into(),
            x_label: String::new(),
            scale,
            range: None,
            rule: None,
            lines,
        }
    }

    /// From the first to the last point, with a margin.
    pub(super) fn extent(&self) -> (f64, f64) {
        let all = || self.lines.iter().flat_map(|l| &l.x).copied().filter(|x| x.is_finite());
        let (low, high) =
            (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
        if low > high {
            return (0.0, 1.0);
        }
        let margin = 0.06 * (high - low).max(1e-9);
        (low - margin, high + margin)
    }

    pub(super) fn write(&self, page: &mut String, x_label: Option<&str>, x: (f64, f64)) {
        let _ = write!(
            page,
            "<figure class=\"chart\" data-chart=\"{}\">\n<figcaption>{}",
            self.id,
            Text(&self.title)
        );
        // What no legend above names.
        for line in self.lines.iter().filter(|l| l.channel.is_none()) {
            let _ = write!(
                page,
                "<span class=\"own h{}\"><i></i>{}</span>",
                line.hue,
                Text(&line.name)
            );
        }
        page.push_str("</figcaption>\n");
        svg::draw(page, self, x_label.unwrap_or(&self.x_label), x);
        page.push_str("</figure>\n");
    }

    fn data(&self, pool: &mut Vec<String>) -> ChartData<'_> {
        let mut lines = Vec::new();
        for line in &self.lines {
            lines.push(LineData {
                name: &line.name,
                channel: line.channel,
                hue: line.hue,
                kind: match line.kind {
                    Kind::Dots => "dots",
                    Kind::Line => "line",
                    Kind::Out => "out",
                },
                x: pooled(pool, &line.x),
                y: pooled(pool, &line.y),
                s: (!line.sigma.is_empty()).then(|| pooled(pool, &line.sigma)),
            });
        }
        ChartData {
            id: self.id,
            title: &self.title,
            label: &self.label,
            scale: self.scale.name(),
            range: self.range.map(|(a, b)| [a, b]),
            rule: self.rule,
            lines,
        }
    }
}

/// The place in the pool of some numbers, as base64 of 32-bit floats in the order of the smallest byte first. Times are the same in most lines.
fn pooled(pool: &mut Vec<String>, values: &[f64]) -> usize {
    // Seven digits are more than a screen shows.
    let bytes: Vec<u8> = values.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect();
    let text = base64(&bytes);
    match pool.iter().position(|other| *other == text) {
        Some(place) => place,
        None => {
            pool.push(text);
            pool.len() - 1
        }
    }
}

/// A line's numbers, for the script.
#[derive(Serialize)]
struct LineData<'a> {
    name: &'a str,
    channel: Option<usize>,
    hue: usize,
    kind: &'static str,
    x: usize,
    y: usize,
    s: Option<usize>,
}

/// A chart's numbers, for the script.
#[derive(Serialize)]
struct ChartData<'a> {
    id: &'a str,
    title: &'a str,
    label: &'a str,
    scale: &'static str,
    range: Option<[f64; 2]>,
    rule: Option<f64>,
    lines: Vec<LineData<'a>>,
}

/// A group's numbers, for the script.
#[derive(Serialize)]
pub(super) struct GroupData<'a> {
    label: &'a str,
    start: f64,
    from: f64,
    to: f64,
    charts: Vec<ChartData<'a>>,
}

/// Charts above one another on one axis of time.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// Title of the charts.
    pub title: String,
    /// The axis of time.
    pub x_label: String,
    /// Zero: milliseconds after 1970 (without leap seconds, as browsers count).
    pub start_ms: f64,
    /// First value, s.
    pub from: f64,
    /// Last.
    pub to: f64,
    /// The charts.
    pub charts: Vec<Chart>,
}

impl Group {
    pub(super) fn data(&self, pool: &mut Vec<String>) -> GroupData<'_> {
        GroupData {
            label: &self.x_label,
            start: self.start_ms,
            from: self.from,
            to: self.to,
            charts: self.charts.iter().map(|c| c.data(pool)).collect(),
        }
    }
}
