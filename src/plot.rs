//! Figures: lines and points on one or several panels, as PNG or SVG.

use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use std::io::Cursor;
use std::sync::Once;

/// A figure: panels above one another.
#[derive(Debug, Clone)]
pub struct Figure {
    /// What it shows.
    pub title: String,
    /// One or more panels, top to bottom.
    pub panels: Vec<Panel>,
}

/// One set of axes.
#[derive(Debug, Clone)]
pub struct Panel {
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// What is drawn, in order.
    pub series: Vec<Series>,
}

/// An axis.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Quantity and unit.
    pub label: String,
    /// First and last value; from the data where `None`.
    pub range: Option<(f64, f64)>,
    /// Logarithmic; values not above 0 are then left out.
    pub log: bool,
}

/// A line or a row of points.
#[derive(Debug, Clone)]
pub struct Series {
    /// Its name in the legend; none where empty.
    pub label: String,
    /// Its points; a point that is no number breaks the line.
    pub points: Vec<(f64, f64)>,
    /// How it is drawn.
    pub style: Style,
    /// Its colour.
    pub colour: RGBColor,
}

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// A line through the points.
    Line,
    /// A dot a point.
    Dots,
}

/// Colours that people with any colour vision tell apart (Okabe and Ito 2008), in the order of use.
pub const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(90, 90, 90),
    RGBColor(160, 140, 20),
];

/// Why a figure was not drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlotError {
    /// The drawing library failed.
    #[error("cannot draw the figure: {0}")]
    Draw(String),
    /// No point can be drawn.
    #[error("nothing to draw: the panel `{0}` has no point that is a number within its axes")]
    Empty(String),
}

impl Axis {
    /// A linear axis over the data.
    pub fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), range: None, log: false }
    }

    /// A logarithmic axis over the data.
    pub fn log(label: impl Into<String>) -> Self {
        Self { log: true, ..Self::linear(label) }
    }

    /// The same axis from `first` to `last`.
    #[must_use]
    pub fn from_to(mut self, first: f64, last: f64) -> Self {
        self.range = Some((first, last));
        self
    }

    /// Whether a value can be drawn: a number, above 0 on a logarithmic axis, within a given range.
    fn good(&self, value: f64) -> bool {
        let within = self.range.is_none_or(|(first, last)| (first..=last).contains(&value));
        value.is_finite() && (!self.log || value > 0.0) && within
    }

    /// The range to draw, with a margin where it comes from the data.
    fn extent(&self, values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
        if let Some(range) = self.range {
            return Some(range);
        }
        let (lo, hi) =
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
        if lo > hi {
            return None;
        }
        Some(if self.log {
            (lo / 1.2, hi * 1.2)
        } else {
            let margin = if hi > lo { 0.04 * (hi - lo) } else { 0.5 * hi.abs().max(1.0) };
            (lo - margin, hi + margin)
        })
    }
}

impl Series {
    /// A line.
    pub fn line(label: impl Into<String>, colour: usize, points: Vec<(f64, f64)>) -> Self {
        Self {
            label: label.into(),
            points,
            style: Style::Line,
            colour: COLOURS[colour % COLOURS.len()],
        }
    }
}

const WIDTH: u32 = 1000;
/// Width of the strip on the right that holds the names, so that they never lie on the data.
const LEGEND_WIDTH: u32 = 150;
const PANEL_HEIGHT: u32 = 400;
const TITLE_HEIGHT: u32 = 46;

impl Figure {
    fn size(&self, scale: u32) -> (u32, u32) {
        let panels = u32::try_from(self.panels.len()).unwrap_or(1);
        (WIDTH * scale, (TITLE_HEIGHT + PANEL_HEIGHT * panels) * scale)
    }

    /// The figure as an SVG text.
    pub fn svg(&self) -> Result<String, PlotError> {
        use_font();
        let mut text = String::new();
        {
            let root = SVGBackend::with_string(&mut text, self.size(1)).into_drawing_area();
            self.draw(&root, 1)?;
            root.present().map_err(|e| PlotError::Draw(e.to_string()))?;
        }
        Ok(text)
    }

    /// The figure as the bytes of a PNG file, at twice the size of the SVG.
    pub fn png(&self) -> Result<Vec<u8>, PlotError> {
        use_font();
        // Drawn at twice the size again and shrunk: the library draws lines without smoothing.
        let (width, height) = self.size(4);
        let mut pixels = vec![255_u8; (width * height * 3) as usize];
        {
            let root = BitMapBackend::with_buffer(&mut pixels, (width, height)).into_drawing_area();
            self.draw(&root, 4)?;
            root.present().map_err(|e| PlotError::Draw(e.to_string()))?;
        }
        let image = image::RgbImage::from_raw(width, height, pixels).ok_or_else(|| {
            PlotError::Draw("the picture has not the size it was asked for".into())
        })?;
        let image = image::imageops::thumbnail(&image, width / 2, height / 2);
        let mut bytes = Cursor::new(Vec::new());
        image
            .write_to(&mut bytes, image::ImageFormat::Png)
            .map_err(|e| PlotError::Draw(e.to_string()))?;
        Ok(bytes.into_inner())
    }

    fn draw<DB: DrawingBackend>(
        &self,
        root: &DrawingArea<DB, Shift>,
        scale: u32,
    ) -> Result<(), PlotError> {
        let failed = |e: DrawingAreaErrorKind<DB::ErrorType>| PlotError::Draw(e.to_string());
        root.fill(&WHITE).map_err(failed)?;
        let title = ("sans-serif", 19 * scale).into_font().color(&BLACK);
        let margin = scale as i32;
        root.draw_text(&self.title, &title, (16 * margin, 16 * margin)).map_err(failed)?;
        let (_, below) = root.split_vertically(TITLE_HEIGHT * scale);
        for (panel, area) in self.panels.iter().zip(below.split_evenly((self.panels.len(), 1))) {
            let points = || {
                panel
                    .series
                    .iter()
                    .flat_map(|s| &s.points)
                    .filter(|(x, y)| panel.x.good(*x) && panel.y.good(*y))
            };
            let empty = || PlotError::Empty(panel.y.label.clone());
            let x = panel.x.extent(points().map(|p| p.0)).ok_or_else(empty)?;
            let y = panel.y.extent(points().map(|p| p.1)).ok_or_else(empty)?;
            match (panel.x.log, panel.y.log) {
                (false, false) => panel.draw(&area, scale, x.0..x.1, y.0..y.1)?,
                (false, true) => panel.draw(&area, scale, x.0..x.1, (y.0..y.1).log_scale())?,
                (true, false) => panel.draw(&area, scale, (x.0..x.1).log_scale(), y.0..y.1)?,
                (true, true) => {
                    panel.draw(&area, scale, (x.0..x.1).log_scale(), (y.0..y.1).log_scale())?;
                }
            }
        }
        Ok(())
    }
}

impl Panel {
    fn draw<DB, X, Y>(
        &self,
        area: &DrawingArea<DB, Shift>,
        scale: u32,
        x: X,
        y: Y,
    ) -> Result<(), PlotError>
    where
        DB: DrawingBackend,
        X: AsRangedCoord<Value = f64>,
        Y: AsRangedCoord<Value = f64>,
        X::CoordDescType: ValueFormatter<f64> + Ranged<ValueType = f64>,
        Y::CoordDescType: ValueFormatter<f64> + Ranged<ValueType = f64>,
    {
        let failed = |e: DrawingAreaErrorKind<DB::ErrorType>| PlotError::Draw(e.to_string());
        let names: Vec<(&str, RGBColor)> = self
            .series
            .iter()
            .filter(|s| !s.label.is_empty())
            .map(|s| (s.label.as_str(), s.colour))
            .collect();
        let legend_width = if names.is_empty() { 0 } else { LEGEND_WIDTH * scale };
        let (area, legend) = area.split_horizontally(area.dim_in_pixel().0 - legend_width);
        for (i, (name, colour)) in names.iter().enumerate() {
            let (y, length) = ((22 + 20 * i as i32) * scale as i32, 18 * scale as i32);
            let line = PathElement::new([(0, y), (length, y)], colour.stroke_width(3 * scale));
            legend.draw(&line).map_err(failed)?;
            let font = ("sans-serif", 13 * scale).into_font().color(&BLACK);
            let middle = y - 6 * scale as i32;
            legend.draw_text(name, &font, (length + 6 * scale as i32, middle)).map_err(failed)?;
        }
        let mut chart = ChartBuilder::on(&area)
            .margin(10 * scale)
            .margin_right(24 * scale)
            .x_label_area_size(44 * scale)
            .y_label_area_size(72 * scale)
            .build_cartesian_2d(x, y)
            .map_err(failed)?;
        let grey = RGBColor(222, 222, 222);
        chart
            .configure_mesh()
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .axis_desc_style(("sans-serif", 15 * scale))
            .label_style(("sans-serif", 13 * scale))
            .bold_line_style(grey.stroke_width(scale))
            .light_line_style(TRANSPARENT)
            .axis_style(RGBColor(120, 120, 120).stroke_width(scale))
            .x_label_formatter(&|v| tick(*v))
            .y_label_formatter(&|v| tick(*v))
            .draw()
            .map_err(failed)?;
        for series in &self.series {
            let colour = series.colour;
            let good = |p: &(f64, f64)| self.x.good(p.0) && self.y.good(p.1);
            match series.style {
                Style::Line => {
                    // A point that is no number breaks the line: a gap is shown, not bridged.
                    for piece in series.points.split(|p| !good(p)).filter(|p| !p.is_empty()) {
                        if scale == 1 {
                            let line =
                                LineSeries::new(piece.iter().copied(), colour.stroke_width(2));
                            chart.draw_series(line).map_err(failed)?;
                            continue;
                        }
                        // In a bitmap the library's joins shoot out as spikes: single strokes with round ends instead.
                        let stroke = colour.stroke_width(2 * scale);
                        let strokes = piece.windows(2).map(|ends| PathElement::new(ends, stroke));
                        chart.draw_series(strokes).map_err(failed)?;
                        let joins = piece.iter().map(|p| Circle::new(*p, scale, colour.filled()));
                        chart.draw_series(joins).map_err(failed)?;
                    }
                }
                Style::Dots => {
                    let dots = series.points.iter().copied().filter(good);
                    let dots = dots.map(|p| Circle::new(p, 2 * scale, colour.filled()));
                    chart.draw_series(dots).map_err(failed)?;
                }
            }
        }
        Ok(())
    }
}

/// A tick's number, as short as it can be.
fn tick(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let size = value.abs();
    if (1e-3..1e5).contains(&size) {
        let text = format!("{value:.4}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        format!("{value:.0e}")
    }
}

/// Figures carry their own font: nothing of the system's is needed.
fn use_font() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // An embedded font that does not load would show as a drawing error, with its name.
        let _ = register_font("sans-serif", FontStyle::Normal, dejavu::sans::regular());
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(points: Vec<(f64, f64)>, log: bool) -> Figure {
        let y = if log { Axis::log("y (1)") } else { Axis::linear("y (1)") };
        let series = vec![Series::line("line", 0, points)];
        Figure {
            title: "Title".into(),
            panels: vec![Panel { x: Axis::linear("x (nm)"), y, series }],
        }
    }

    #[test]
    fn a_figure_is_drawn_both_ways_and_gaps_are_not_bridged() {
        let points = vec![(0.0, 1.0), (1.0, 2.0), (2.0, f64::NAN), (3.0, 4.0), (4.0, 3.0)];
        let svg = figure(points.clone(), false).svg().unwrap();
        assert!(svg.contains("Title") && svg.contains("x (nm)"));
        // Two pieces of the line, and the stroke beside its name (which is thicker).
        let strokes = |width: u32| {
            svg.matches(&format!("stroke=\"#0072B2\" stroke-width=\"{width}\"")).count()
        };
        assert_eq!((strokes(2), strokes(3)), (2, 1), "{svg}");
        let png = figure(points, true).png().unwrap();
        assert_eq!(image::load_from_memory(&png).unwrap().width(), 2 * WIDTH);
    }

    #[test]
    fn nothing_to_draw_is_said() {
        let error = figure(vec![(0.0, -1.0), (f64::NAN, 1.0)], true).svg().unwrap_err();
        assert!(error.to_string().contains("nothing to draw: the panel `y (1)`"));
    }

    #[test]
    fn ticks_are_short() {
        for (value, text) in
            [(0.0, "0"), (0.25, "0.25"), (400.0, "400"), (1e6, "1e6"), (2e-5, "2e-5")]
        {
            assert_eq!(tick(value), text);
        }
    }
}
