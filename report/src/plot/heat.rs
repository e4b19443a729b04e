//! A field of values over two axes, in colours: the time–wavelength diagram.

use super::PlotError;
use super::raster::Rasters;
use super::scale::Scale;
use image::{Rgba, RgbaImage};
use plotters::coord::Shift;
use plotters::prelude::*;

/// Width of the strip on the right for the scale of colours, pixels.
pub(super) const BAR_STRIP: u32 = 150;
/// So many colours are told apart in a field; more only make files larger.
const SHADES: usize = 96;
/// Cells across in an SVG and in a bitmap; what is finer is averaged.
const MOST_ACROSS: usize = 1600;

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

    /// Returns true where there is a value above 0.
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
        (x, y): (&Scale, &Scale),
        scale: u32,
        rasters: &Rasters,
    ) -> Result<(), PlotError> {
        let failed = |e: DrawingAreaErrorKind<DB::ErrorType>| PlotError::Draw(e.to_string());
        let Some(colours) = self.scale() else { return Ok(()) };
        let (width, height) = area.dim_in_pixel();
        if scale == 1 {
            // A drawing of lines holds the field as one picture, twice as fine as the pixels of its size.
            let field = self.raster(&colours, (2 * width, 2 * height), (x, y));
            let corners = [(0, 0), (width as i32, height as i32)];
            let stand_in = Rectangle::new(corners, rasters.add(&field)?.filled());
            return area.draw(&stand_in).map_err(failed);
        }
        let most = MOST_ACROSS;
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

    /// The field as a picture of that size, transparent where there is no number. Of the columns in one pixel it shows the mean.
    fn raster(
        &self,
        colours: &Scale,
        (width, height): (u32, u32),
        (x, y): (&Scale, &Scale),
    ) -> RgbaImage {
        let rows = self.rows();
        let edge = |scale: &Scale, edges: &[f64], size: u32| -> Vec<f64> {
            edges.iter().map(|e| scale.fraction(*e) * f64::from(size)).collect()
        };
        let (across, up) = (edge(x, &self.x_edges, width), edge(y, &self.y_edges, height));
        // The cells that a pixel lies in: those whose middles it holds, else the one that holds its middle.
        let cells = |edges: &[f64], pixel: u32| -> std::ops::Range<usize> {
            let (from, to) = (f64::from(pixel), f64::from(pixel) + 1.0);
            let middle = |i: usize| 0.5 * (edges[i] + edges[i + 1]);
            let first = edges.partition_point(|e| *e <= from).saturating_sub(1);
            let last = edges.partition_point(|e| *e < to).min(edges.len() - 1);
            let inside: Vec<usize> =
                (first..last).filter(|i| (from..to).contains(&middle(*i))).collect();
            match (inside.first(), inside.last()) {
                (Some(first), Some(last)) => *first..last + 1,
                _ => {
                    let i = edges.partition_point(|e| *e <= from + 0.5).saturating_sub(1);
                    let i = i.min(edges.len().saturating_sub(2));
                    i..i + 1
                }
            }
        };
        let columns: Vec<_> = (0..width).map(|pixel| cells(&across, pixel)).collect();
        let lines: Vec<_> = (0..height).map(|pixel| cells(&up, height - 1 - pixel)).collect();
        RgbaImage::from_fn(width, height, |px, py| {
            let (mut sum, mut good) = (0.0, 0.0);
            for column in columns[px as usize].clone() {
                for row in lines[py as usize].clone() {
                    let value = self.values[column * rows + row];
                    if value.is_finite() {
                        (sum, good) = (sum + value, good + 1.0);
                    }
                }
            }
            if good == 0.0 {
                return Rgba([0, 0, 0, 0]);
            }
            let RGBColor(r, g, b) = colour_of(shade_of(colours, sum / good));
            Rgba([r, g, b, 255])
        })
    }

    /// Draws the scale of colours into the strip beside a panel.
    pub(super) fn draw_bar<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        scale: u32,
    ) -> Result<(), PlotError> {
        match self.scale() {
            Some(colours) => draw_scale(&self.label, &colours, area, scale, 60),
            None => Ok(()),
        }
    }
}

/// Draws a scale of colours with its quantity above it, down to so many pixels above the area's end.
pub(super) fn draw_scale<DB: DrawingBackend>(
    title: &[String],
    colours: &Scale,
    area: &DrawingArea<DB, Shift>,
    scale: u32,
    below: i32,
) -> Result<(), PlotError> {
    let failed = |e: DrawingAreaErrorKind<DB::ErrorType>| PlotError::Draw(e.to_string());
    let (_, height) = area.dim_in_pixel();
    let s = scale as i32;
    let font = ("sans-serif", 13 * scale).into_font().color(&BLACK);
    for (i, line) in title.iter().enumerate() {
        area.draw_text(line, &font, (0, (10 + 17 * i as i32) * s)).map_err(failed)?;
    }
    let top = (20 + 17 * title.len() as i32) * s;
    let bottom = height as i32 - below * s;
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
        area.draw(&PathElement::new([(right, y), (right + 4 * s, y)], stroke)).map_err(failed)?;
        area.draw_text(&colours.label(*tick), &font, (right + 8 * s, y - 6 * s)).map_err(failed)?;
    }
    Ok(())
}

fn shade_of(colours: &Scale, value: f64) -> usize {
    let (lo, hi) = colours.ends();
    let fraction = colours.fraction(value.clamp(lo, hi));
    // A fraction from 0 to 1.
    ((fraction * SHADES as f64) as usize).min(SHADES - 1)
}

/// The colour at a fraction of the scale, from 0 to 1; what is beyond has the end's.
///
/// ```
/// use sunglint_report::plot::viridis;
///
/// let light = |f: f64| { let c = viridis(f); u32::from(c.0) + u32::from(c.1) + u32::from(c.2) };
/// assert!(light(1.0) > light(0.5) && light(0.5) > light(0.0));
/// assert_eq!(viridis(7.0), viridis(1.0));
/// ```
pub fn viridis(fraction: f64) -> RGBColor {
    colour_of(((fraction.clamp(0.0, 1.0) * SHADES as f64) as usize).min(SHADES - 1))
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

    /// Truth: by hand, the largest value has the last shade, 0 the first, NaN none; the columns are as wide as their edges, the first row is
    /// at the bottom, and two columns in one pixel have their mean.
    #[test]
    fn a_field_is_drawn_in_the_colours_of_its_scale() {
        let one = figure(vec![1.0, 1.0, 0.0, 0.5, f64::NAN, 1.0]);
        let heat = one.panels[0].heat.clone().unwrap();
        let (x, y) = (Scale::horizontal((0.0, 4.0), false), Scale::vertical((300.0, 500.0), false));
        let pixel = |image: &RgbaImage, px: u32, py: u32| image.get_pixel(px, py).0;
        let colour = |shade: usize| {
            let RGBColor(r, g, b) = colour_of(shade);
            [r, g, b, 255]
        };
        let image = heat.raster(&heat.scale().unwrap(), (8, 4), (&x, &y));
        assert_eq!(
            (pixel(&image, 0, 0), pixel(&image, 1, 3)),
            (colour(SHADES - 1), colour(SHADES - 1))
        );
        assert_eq!((pixel(&image, 2, 3), pixel(&image, 3, 0)), (colour(0), colour(SHADES / 2)));
        for px in 4..8 {
            assert_eq!((pixel(&image, px, 0), pixel(&image, px, 3)), (colour(SHADES - 1), [0; 4]));
        }
        let image = heat.raster(&heat.scale().unwrap(), (2, 2), (&x, &y));
        assert_eq!(pixel(&image, 0, 1), colour(SHADES / 2));
        let svg = one.svg().unwrap();
        assert_eq!(svg.matches("<image ").count(), 1, "{svg}");
        assert!(svg.contains("href=\"data:image/png;base64,iVBORw0KGgo"));
        assert!(svg.contains("W sr⁻¹ nm⁻¹"));
        figure(vec![1.0; 6]).png().unwrap();
    }

    #[test]
    fn a_dark_field_is_said() {
        let error = figure(vec![0.0; 6]).svg().unwrap_err().to_string();
        assert!(error.contains("nothing to draw"), "{error}");
    }
}
