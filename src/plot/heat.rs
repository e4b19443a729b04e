//! A field of values over two axes, in colours: the time–wavelength diagram.

use super::PlotError;
use super::scale::{Scale, label};
use plotters::coord::Shift;
use plotters::prelude::*;

/// Width of the strip on the right for the scale of colours, pixels.
pub(super) const BAR_STRIP: u32 = 150;
/// So many colours are told apart in a field; more only make files larger.
const SHADES: usize = 96;
/// Cells across in an SVG and in a bitmap; what is finer is averaged.
const MOST_ACROSS: (usize, usize) = (320, 1600);

/// Viridis in even steps from low to high (Smith and van der Walt 2015, CC0): even to the eye, and in grey, and for any colour vision.
const VIRIDIS: [[u8; 3]; 11] = [
    [68, 1, 84],
    [72, 36, 117],
    [65, 68, 135],
    [53, 95, 141],
    [42, 120, 142],
    [33, 145, 140],
    [34, 168, 132],
    [68, 191, 112],
    [122, 209, 81],
    [189, 223, 38],
    [253, 231, 37],
];

/// A field of values: columns over the horizontal, rows over the vertical axis.
#[derive(Debug, Clone)]
pub struct Heat {
    /// Edges of the columns, increasing: one more than columns.
    pub x_edges: Vec<f64>,
    /// Edges of the rows, increasing.
    pub y_edges: Vec<f64>,
    /// The values, `[column * rows + row]`; what is no number is left white.
    pub values: Vec<f64>,
    /// Quantity and unit, written above the scale of colours, a line for each.
    pub label: Vec<String>,
    /// Logarithmic colours over so many decades below the largest value; linear from 0 where `None`.
    pub decades: Option<f64>,
}

impl Heat {
    fn rows(&self) -> usize {
        self.y_edges.len().saturating_sub(1)
    }

    /// Whether there is a value above 0.
    pub fn has_light(&self) -> bool {
        self.most().is_some()
    }

    /// The largest value; `None` where there is nothing to draw.
    fn most(&self) -> Option<f64> {
        let most = self.values.iter().copied().filter(|v| v.is_finite()).fold(0.0, f64::max);
        (most > 0.0).then_some(most)
    }

    /// First and last value of both axes; `None` where there is nothing to draw.
    pub(super) fn extent(&self) -> Option<((f64, f64), (f64, f64))> {
        self.most()?;
        let ends = |edges: &[f64]| Some((*edges.first()?, *edges.last()?)).filter(|(a, b)| a < b);
        Some((ends(&self.x_edges)?, ends(&self.y_edges)?))
    }

    fn scale(&self) -> Option<Scale> {
        let most = self.most()?;
        Some(match self.decades {
            Some(decades) => Scale::vertical((most * 10_f64.powf(-decades), most), true),
            None => Scale::vertical((0.0, most), false),
        })
    }

    /// Draws the field into an area that the axes span.
    pub(super) fn draw<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        x: &Scale,
        y: &Scale,
        scale: u32,
    ) -> Result<(), PlotError> {
        let failed = |e: DrawingAreaErrorKind<DB::ErrorType>| PlotError::Draw(e.to_string());
        let Some(colours) = self.scale() else { return Ok(()) };
        let (width, height) = area.dim_in_pixel();
        let most = if scale == 1 { MOST_ACROSS.0 } else { MOST_ACROSS.1 };
        let columns = self.x_edges.len().saturating_sub(1);
        let step = columns.div_ceil(most).max(1);
        let rows = self.rows();
        let across = |v: f64| (x.fraction(v) * f64::from(width)).round() as i32;
        let down = |v: f64| ((1.0 - y.fraction(v)) * f64::from(height)).round() as i32;
        for first in (0..columns).step_by(step) {
            let last = (first + step).min(columns);
            let (left, right) = (across(self.x_edges[first]), across(self.x_edges[last]));
            let shade = |row: usize| {
                let cells = (first..last).map(|c| self.values[c * rows + row]);
                let good: Vec<f64> = cells.filter(|v| v.is_finite()).collect();
                let mean = good.iter().sum::<f64>() / good.len() as f64;
                (!good.is_empty()).then(|| shade_of(&colours, mean))
            };
            // Neighbours of one shade are one rectangle.
            let mut row = 0;
            while row < rows {
                let here = shade(row);
                let mut end = row + 1;
                while end < rows && shade(end) == here {
                    end += 1;
                }
                if let Some(shade) = here {
                    let corners =
                        [(left, down(self.y_edges[end])), (right, down(self.y_edges[row]))];
                    let cell = Rectangle::new(corners, colour_of(shade).filled());
                    area.draw(&cell).map_err(failed)?;
                }
                row = end;
            }
        }
        Ok(())
    }

    /// Draws the scale of colours into the strip beside a panel.
    pub(super) fn draw_bar<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        scale: u32,
    ) -> Result<(), PlotError> {
        let failed = |e: DrawingAreaErrorKind<DB::ErrorType>| PlotError::Draw(e.to_string());
        let Some(colours) = self.scale() else { return Ok(()) };
        let (_, height) = area.dim_in_pixel();
        let s = scale as i32;
        let font = ("sans-serif", 13 * scale).into_font().color(&BLACK);
        for (i, line) in self.label.iter().enumerate() {
            area.draw_text(line, &font, (0, (10 + 17 * i as i32) * s)).map_err(failed)?;
        }
        let top = (20 + 17 * self.label.len() as i32) * s;
        let bottom = height as i32 - 60 * s;
        let (left, right) = (0, 18 * s);
        let at = |fraction: f64| bottom - (fraction * f64::from(bottom - top)).round() as i32;
        for shade in 0..SHADES {
            let (from, to) = (shade as f64 / SHADES as f64, (shade + 1) as f64 / SHADES as f64);
            let corners = [(left, at(to)), (right, at(from))];
            area.draw(&Rectangle::new(corners, colour_of(shade).filled())).map_err(failed)?;
        }
        for tick in colours.ticks() {
            let fraction = colours.fraction(*tick);
            if !(-1e-6..=1.0 + 1e-6).contains(&fraction) {
                continue;
            }
            let y = at(fraction);
            let stroke = RGBColor(90, 90, 90).stroke_width(scale);
            area.draw(&PathElement::new([(right, y), (right + 4 * s, y)], stroke))
                .map_err(failed)?;
            area.draw_text(&label(*tick), &font, (right + 8 * s, y - 6 * s)).map_err(failed)?;
        }
        Ok(())
    }
}

fn shade_of(colours: &Scale, value: f64) -> usize {
    let (lo, hi) = colours.ends();
    let fraction = colours.fraction(value.clamp(lo, hi));
    // A fraction from 0 to 1.
    ((fraction * SHADES as f64) as usize).min(SHADES - 1)
}

fn colour_of(shade: usize) -> RGBColor {
    let place = (shade as f64 + 0.5) / SHADES as f64 * (VIRIDIS.len() - 1) as f64;
    let i = (place as usize).min(VIRIDIS.len() - 2);
    let f = place - i as f64;
    // Between two bytes lies a byte.
    let mix = |c: usize| {
        (f64::from(VIRIDIS[i][c]) * (1.0 - f) + f64::from(VIRIDIS[i + 1][c]) * f).round() as u8
    };
    RGBColor(mix(0), mix(1), mix(2))
}

#[cfg(test)]
mod tests {
    use super::super::{Axis, Figure, Panel};
    use super::*;

    fn figure(values: Vec<f64>) -> Figure {
        let heat = Heat {
            x_edges: vec![0.0, 1.0, 2.0, 4.0],
            y_edges: vec![300.0, 400.0, 500.0],
            values,
            label: vec!["W sr⁻¹ nm⁻¹".into()],
            decades: None,
        };
        let (x, y) = (Axis::linear("time (s)"), Axis::linear("wavelength (nm)"));
        let panel = Panel { heat: Some(heat), ..Panel::new(x, y, vec![]) };
        Figure { title: "Field".into(), panels: vec![panel] }
    }

    /// Truth: by hand, the largest value has the last shade, 0 the first, NaN none; two equal neighbours are one rectangle.
    #[test]
    fn a_field_is_drawn_in_the_colours_of_its_scale() {
        let svg = figure(vec![1.0, 1.0, 0.0, 0.5, f64::NAN, 1.0]).svg().unwrap();
        let rectangles = |shade: usize| {
            let RGBColor(r, g, b) = colour_of(shade);
            svg.matches(&format!("fill=\"#{r:02X}{g:02X}{b:02X}\" stroke=\"none\"")).count()
        };
        // Each shade is once in the scale beside the field.
        assert_eq!((rectangles(SHADES - 1), rectangles(0)), (1 + 2, 1 + 1), "{svg}");
        assert_eq!(rectangles(SHADES / 2), 1 + 1);
        assert_eq!(rectangles(10), 1);
        assert!(svg.contains("W sr⁻¹ nm⁻¹"));
        figure(vec![1.0; 6]).png().unwrap();
    }

    #[test]
    fn a_dark_field_is_said() {
        let error = figure(vec![0.0; 6]).svg().unwrap_err().to_string();
        assert!(error.contains("nothing to draw"), "{error}");
    }
}
