//! Figures: lines and points on one or several panels, as PNG or SVG.

pub mod gallery;
mod heat;
mod panel;
mod raster;
mod scale;
pub mod sky;

pub use heat::{Heat, viridis};
pub use plotters::style::RGBColor;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use raster::Rasters;
pub use raster::base64;
use scale::Scale;
pub use scale::{labels, ticks};
use std::io::Cursor;
use std::sync::Once;

/// A figure: panels above one another.
#[derive(Debug, Clone)]
pub struct Figure {
    /// Title of the figure.
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
    /// Series that are drawn, in order.
    pub series: Vec<Series>,
    /// Stretches of the horizontal axis that are shaded, below everything else.
    pub spans: Vec<Span>,
    /// A field of values in colours, with its scale on the right.
    pub heat: Option<Heat>,
}

/// A shaded stretch of the horizontal axis.
#[derive(Debug, Clone)]
pub struct Span {
    /// Meaning of the span, in the legend once for all spans of that name.
    pub label: String,
    /// Ends.
    pub range: (f64, f64),
    /// Colour: pale, since lines run over it.
    pub colour: RGBColor,
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
    /// From the largest value to the smallest: magnitudes.
    pub inverted: bool,
}

/// A line or a row of points.
#[derive(Debug, Clone)]
pub struct Series {
    /// Name in the legend; none where empty.
    pub label: String,
    /// Points; a point that is no number breaks the line.
    pub points: Vec<(f64, f64)>,
    /// Style.
    pub style: Style,
    /// Colour.
    pub colour: RGBColor,
    /// Number of the line's dashes in [`DASHES`].
    pub dash: usize,
}

/// Style of a series.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// A line through the points.
    Line,
    /// A dot a point.
    Dots,
    /// All below the line through the points, down to the panel's lower edge: piles are drawn from the top one down.
    Area,
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

/// Lengths of stroke and gap in turn, in pixels of the SVG; none is a whole line. Lines beyond the colours take the next dashes.
pub const DASHES: [&[f64]; 4] = [&[], &[9.0, 5.0], &[2.0, 4.0], &[10.0, 4.0, 2.0, 4.0]];

/// A colour in which people find a wavelength again: the spectrum's where it is seen, violet and wine red beside it, then
/// browns and greys in the infrared. All are dark enough for white paper.
pub fn colour_of_wavelength_nm(nm: f64) -> RGBColor {
    const STOPS: [(f64, [f64; 3]); 11] = [
        (340.0, [122.0, 60.0, 170.0]),
        (400.0, [95.0, 40.0, 190.0]),
        (450.0, [25.0, 80.0, 215.0]),
        (490.0, [0.0, 135.0, 165.0]),
        (530.0, [0.0, 145.0, 60.0]),
        (580.0, [170.0, 130.0, 0.0]),
        (620.0, [225.0, 45.0, 25.0]),
        (700.0, [150.0, 10.0, 35.0]),
        (800.0, [105.0, 20.0, 95.0]),
        (950.0, [110.0, 90.0, 120.0]),
        (1100.0, [60.0, 60.0, 65.0]),
    ];
    let upper = STOPS.partition_point(|(stop, _)| *stop <= nm).clamp(1, STOPS.len() - 1);
    let ((from, a), (to, b)) = (STOPS[upper - 1], STOPS[upper]);
    let f = ((nm - from) / (to - from)).clamp(0.0, 1.0);
    // Between two bytes lies a byte.
    let [r, g, b] = [0, 1, 2].map(|i| (a[i] + f * (b[i] - a[i])).round() as u8);
    RGBColor(r, g, b)
}

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
        Self { label: label.into(), range: None, log: false, inverted: false }
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

    /// The same axis the other way round.
    #[must_use]
    pub fn inverted(mut self) -> Self {
        self.inverted = true;
        self
    }

    /// Whether a value can be drawn: a number, above 0 on a logarithmic axis, within a given range.
    fn good(&self, value: f64) -> bool {
        let within = self.range.is_none_or(|(first, last)| (first..=last).contains(&value));
        value.is_finite() && (!self.log || value > 0.0) && within
    }

    /// The range to draw, with a margin where it comes from the data.
    fn extent(&self, values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
        let (lo, hi) =
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
        if lo > hi {
            return None;
        }
        let (lo, hi) = self.range.unwrap_or((lo, hi));
        // One value only: room on both sides of it. Closer together than this, floats cannot be told apart on an axis.
        let narrow = hi - lo <= 1e-12 * lo.abs().max(hi.abs());
        Some(if self.log {
            let room = if narrow { 2.0 } else { 1.2 };
            if self.range.is_some() && !narrow { (lo, hi) } else { (lo / room, hi * room) }
        } else if narrow {
            let margin = if hi == 0.0 { 1.0 } else { 0.05 * hi.abs() };
            (lo - margin, hi + margin)
        } else if self.range.is_some() {
            (lo, hi)
        } else {
            let margin = 0.04 * (hi - lo);
            (lo - margin, hi + margin)
        })
    }
}

impl Panel {
    /// A panel of lines and points.
    pub fn new(x: Axis, y: Axis, series: Vec<Series>) -> Self {
        Self { x, y, series, spans: Vec::new(), heat: None }
    }
}

impl Series {
    /// Dots, in the `index`-th colour.
    pub fn dots(label: impl Into<String>, index: usize, points: Vec<(f64, f64)>) -> Self {
        Self { style: Style::Dots, ..Self::line(label, index, points) }
    }

    /// A line, the `index`-th of its panel: after eight colours the lines become dashed, after 32 they repeat.
    pub fn line(label: impl Into<String>, index: usize, points: Vec<(f64, f64)>) -> Self {
        Self {
            label: label.into(),
            points,
            style: Style::Line,
            colour: COLOURS[index % COLOURS.len()],
            dash: index / COLOURS.len() % DASHES.len(),
        }
    }

    /// The same in a colour of its own and without dashes ([`colour_of_wavelength_nm`] for a band).
    #[must_use]
    pub fn with_colour(self, colour: RGBColor) -> Self {
        self.with_colour_and_dash(colour, 0)
    }

    /// The same in a colour and with dashes of its own: for bands whose colours are alike.
    #[must_use]
    pub fn with_colour_and_dash(mut self, colour: RGBColor, dash: usize) -> Self {
        (self.colour, self.dash) = (colour, dash % DASHES.len());
        self
    }
}

const WIDTH: u32 = 1000;
/// Widths of the strip on the right that holds the names, so that they never lie on the data.
const LEGEND_WIDTH: std::ops::RangeInclusive<u32> = 110..=320;
/// Names that the strip has room for.
const LEGEND_NAMES: usize = 18;
const PANEL_HEIGHT: u32 = 400;
const TITLE_HEIGHT: u32 = 46;

impl Figure {
    /// The figure as an SVG text.
    ///
    /// ```
    /// use sunglint_report::plot::{Axis, Figure, Panel, Series};
    ///
    /// let axis = |label: &str| Axis { label: label.into(), range: None, log: false, inverted: false };
    /// let line = Series::line("green", 0, vec![(0.0, 1.0), (1.0, 3.0), (2.0, 2.0)]);
    /// let panel = Panel::new(axis("time in s"), axis("rate in Hz"), vec![line]);
    /// let svg = Figure { title: "A light curve".into(), panels: vec![panel] }.svg()?;
    /// assert!(svg.starts_with("<svg") && svg.contains("A light curve"));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn svg(&self) -> Result<String, PlotError> {
        svg(self)
    }

    /// The figure as the bytes of a PNG file, at twice the size of the SVG.
    pub fn png(&self) -> Result<Vec<u8>, PlotError> {
        png(self)
    }
}

/// Drawing at any scale.
trait Drawn {
    /// Width and height in pixels.
    fn size(&self, scale: u32) -> (u32, u32);

    /// Draws on an area of that size.
    fn draw<DB: DrawingBackend>(
        &self,
        root: &DrawingArea<DB, Shift>,
        scale: u32,
        rasters: &Rasters,
    ) -> Result<(), PlotError>;
}

fn svg(figure: &impl Drawn) -> Result<String, PlotError> {
    use_font();
    let mut text = String::new();
    let rasters = Rasters::default();
    {
        let root = SVGBackend::with_string(&mut text, figure.size(1)).into_drawing_area();
        figure.draw(&root, 1, &rasters)?;
        root.present().map_err(|e| PlotError::Draw(e.to_string()))?;
    }
    // Names are drawn as they are: XML forbids some characters even in quotes.
    Ok(rasters.put_into(sunglint_formats::text::printable(&text).into_owned()))
}

fn png(figure: &impl Drawn) -> Result<Vec<u8>, PlotError> {
    use_font();
    // Drawn at twice the size again and shrunk: the library draws lines without smoothing.
    let (width, height) = figure.size(4);
    let mut pixels = vec![255_u8; (width * height * 3) as usize];
    {
        let root = BitMapBackend::with_buffer(&mut pixels, (width, height)).into_drawing_area();
        figure.draw(&root, 4, &Rasters::default())?;
        root.present().map_err(|e| PlotError::Draw(e.to_string()))?;
    }
    let pixels = sunglint_numerics::raster::halved(&pixels, width as usize, 3);
    let image = image::RgbImage::from_raw(width / 2, height / 2, pixels)
        .ok_or_else(|| PlotError::Draw("the picture has not the size it was asked for".into()))?;
    let mut bytes = Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, image::ImageFormat::Png)
        .map_err(|e| PlotError::Draw(e.to_string()))?;
    Ok(bytes.into_inner())
}

impl Drawn for Figure {
    fn size(&self, scale: u32) -> (u32, u32) {
        let panels = u32::try_from(self.panels.len()).unwrap_or(1);
        (WIDTH * scale, (TITLE_HEIGHT + PANEL_HEIGHT * panels) * scale)
    }

    fn draw<DB: DrawingBackend>(
        &self,
        root: &DrawingArea<DB, Shift>,
        scale: u32,
        rasters: &Rasters,
    ) -> Result<(), PlotError> {
        let failed = |e: DrawingAreaErrorKind<DB::ErrorType>| PlotError::Draw(e.to_string());
        root.fill(&WHITE).map_err(failed)?;
        let margin = scale as i32;
        let style = |size: u32| ("sans-serif", size * scale).into_font().color(&BLACK);
        // A long title is written smaller rather than cut off.
        let mut size = 19;
        while size > 8 {
            let (width, _) = root.estimate_text_size(&self.title, &style(size)).map_err(failed)?;
            if width <= (WIDTH - 32) * scale {
                break;
            }
            size -= 1;
        }
        root.draw_text(&self.title, &style(size), (16 * margin, 16 * margin)).map_err(failed)?;
        let (_, below) = root.split_vertically(TITLE_HEIGHT * scale);
        // One width for all panels, so that what is above one another belongs together.
        let widths = self.panels.iter().map(|panel| panel.legend_width(root, scale));
        let legend_width = widths.collect::<Result<Vec<_>, _>>()?.into_iter().max().unwrap_or(0);
        for (panel, area) in self.panels.iter().zip(below.split_evenly((self.panels.len(), 1))) {
            let points = || {
                panel
                    .series
                    .iter()
                    .flat_map(|s| &s.points)
                    .filter(|(x, y)| panel.x.good(*x) && panel.y.good(*y))
            };
            let empty = || PlotError::Empty(panel.y.label.clone());
            let (x, y) = match &panel.heat {
                // A field fills its panel.
                Some(heat) => heat.extent().ok_or_else(empty)?,
                None => (
                    panel.x.extent(points().map(|p| p.0)).ok_or_else(empty)?,
                    panel.y.extent(points().map(|p| p.1)).ok_or_else(empty)?,
                ),
            };
            let x = Scale::horizontal(x, panel.x.log).turned(panel.x.inverted);
            let y = Scale::vertical(y, panel.y.log).turned(panel.y.inverted);
            panel.draw(&area, scale, legend_width, (x, y), rasters)?;
        }
        Ok(())
    }
}

/// Cuts a way in pixels into strokes of a pattern (`scale` times as long); all of it is one stroke where there is no pattern.
fn dashes(way: &[(f64, f64)], pattern: &[f64], scale: f64) -> Vec<Vec<(i32, i32)>> {
    // A cast of a float saturates, and a picture is smaller than that.
    let round = |p: (f64, f64)| (p.0.round() as i32, p.1.round() as i32);
    let (Some(&first), false) = (way.first(), pattern.is_empty()) else {
        return vec![way.iter().copied().map(round).collect()];
    };
    let mut strokes = vec![vec![round(first)]];
    let (mut turn, mut left) = (0, pattern[0] * scale);
    for ends in way.windows(2) {
        let (mut from, to) = (ends[0], ends[1]);
        loop {
            let length = (to.0 - from.0).hypot(to.1 - from.1);
            let here = if length <= left {
                to
            } else {
                let f = left / length;
                (from.0 + f * (to.0 - from.0), from.1 + f * (to.1 - from.1))
            };
            if let (0, Some(stroke)) = (turn % 2, strokes.last_mut()) {
                stroke.push(round(here));
            }
            if length <= left {
                left -= length;
                break;
            }
            turn = (turn + 1) % pattern.len();
            left = pattern[turn] * scale;
            if turn % 2 == 0 {
                strokes.push(vec![round(here)]);
            }
            from = here;
        }
    }
    strokes.retain(|stroke| stroke.len() > 1);
    strokes
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
            panels: vec![Panel::new(Axis::linear("x (nm)"), y, series)],
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

    /// Truth: a way of 100 pixels in strokes of 9 and gaps of 5 has 8 strokes, of 65 pixels in all, whatever its points are.
    #[test]
    fn dashes_are_as_long_as_they_should_be() {
        for n in [1, 7, 1000] {
            let way: Vec<(f64, f64)> =
                (0..=n).map(|i| (0.0, 100.0 * f64::from(i) / f64::from(n))).collect();
            let strokes = dashes(&way, DASHES[1], 1.0);
            let drawn: i32 = strokes.iter().map(|s| s[s.len() - 1].1 - s[0].1).sum();
            assert_eq!((strokes.len(), drawn), (8, 7 * 9 + 2), "{n}");
        }
        assert_eq!(dashes(&[(0.0, 0.0), (1.0, 2.0)], DASHES[0], 4.0), [[(0, 0), (1, 2)]]);
    }

    #[test]
    fn the_first_32_lines_differ() {
        let looks: std::collections::HashSet<_> = (0..32)
            .map(|i| Series::line("", i, vec![]))
            .map(|s| (s.colour.0, s.colour.1, s.colour.2, s.dash))
            .collect();
        assert_eq!(looks.len(), 32);
    }

    #[test]
    fn one_point_is_a_dot_in_the_middle_of_a_panel() {
        let mut figure = figure(vec![(550.0, 0.7)], false);
        for range in [None, Some((550.0, 550.0))] {
            figure.panels[0].x.range = range;
            let svg = figure.svg().unwrap();
            assert_eq!(svg.matches("<circle").count(), 1, "{svg}");
            // Both ends of the axis are 5 % away.
            assert!(svg.contains("530") && svg.contains("570"), "{svg}");
            figure.png().unwrap();
        }
    }

    /// Truth: WCAG's contrast with white of at least 3, what it asks of graphics; and neighbouring bands 40 apart in RGB.
    #[test]
    fn colours_of_wavelengths_are_seen_and_told_apart() {
        let linear = |c: u8| {
            let c = f64::from(c) / 255.0;
            if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
        };
        for nm in 200..1400 {
            let RGBColor(r, g, b) = colour_of_wavelength_nm(f64::from(nm));
            let luminance = 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
            assert!(1.05 / (luminance + 0.05) > 3.0, "{nm} nm");
        }
        let bands = [360.0, 450.0, 530.0, 620.0, 700.0, 800.0, 950.0, 1100.0];
        for pair in bands.windows(2) {
            let (a, b) = (colour_of_wavelength_nm(pair[0]), colour_of_wavelength_nm(pair[1]));
            let apart = |a: u8, b: u8| (f64::from(a) - f64::from(b)).powi(2);
            let distance = (apart(a.0, b.0) + apart(a.1, b.1) + apart(a.2, b.2)).sqrt();
            assert!(distance > 40.0, "{pair:?}: {distance}");
        }
        let RGBColor(r, g, b) = colour_of_wavelength_nm(450.0);
        assert!(b > r && b > g);
    }
}
