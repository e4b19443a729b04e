//! A panel: its axes, what is drawn between them, and the names beside them.

use super::raster::Rasters;
use super::scale::Scale;
use super::{DASHES, LEGEND_NAMES, LEGEND_WIDTH, Panel, PlotError, Series, Style, dashes, heat};
use plotters::coord::Shift;
use plotters::prelude::*;

impl Panel {
    /// The series that the names beside the panel are of, and how many of them have room.
    fn named(&self) -> (Vec<&Series>, usize) {
        let named: Vec<&Series> = self.series.iter().filter(|s| !s.label.is_empty()).collect();
        let shown = if named.len() > LEGEND_NAMES { LEGEND_NAMES - 1 } else { named.len() };
        (named, shown)
    }

    /// The width that the names need; 0 without names.
    pub(super) fn legend_width<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        scale: u32,
    ) -> Result<u32, PlotError> {
        let failed = |e: DrawingAreaErrorKind<DB::ErrorType>| PlotError::Draw(e.to_string());
        let (named, shown) = self.named();
        let font = ("sans-serif", 13 * scale).into_font().color(&BLACK);
        let mut width = if self.heat.is_some() { heat::BAR_STRIP } else { 0 };
        let names = named[..shown].iter().map(|s| s.label.as_str()).chain(self.span_names());
        for label in names {
            let (name, _) = area.estimate_text_size(label, &font).map_err(failed)?;
            let wanted = name / scale + 26 + 6 + 10;
            width = width.max(wanted.clamp(*LEGEND_WIDTH.start(), *LEGEND_WIDTH.end()));
        }
        Ok(width)
    }

    /// The names of the shaded stretches, each once.
    fn span_names(&self) -> impl Iterator<Item = &str> {
        let named = self.spans.iter().enumerate().filter(|(i, span)| {
            !span.label.is_empty() && self.spans[..*i].iter().all(|s| s.label != span.label)
        });
        named.map(|(_, span)| span.label.as_str())
    }

    /// Draws the names beside the panel and gives what is left of its area.
    fn legend<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        scale: u32,
        width: u32,
    ) -> Result<DrawingArea<DB, Shift>, PlotError> {
        let failed = |e: DrawingAreaErrorKind<DB::ErrorType>| PlotError::Draw(e.to_string());
        let (named, shown) = self.named();
        let font = ("sans-serif", 13 * scale).into_font().color(&BLACK);
        let length = 26 * scale as i32;
        let (area, legend) = area.split_horizontally(area.dim_in_pixel().0 - width * scale);
        let height = |i: usize| (22 + 20 * i as i32) * scale as i32;
        let beside = |i: usize| (length + 6 * scale as i32, height(i) - 5 * scale as i32);
        for (i, series) in named[..shown].iter().enumerate() {
            if series.style == Style::Dots {
                for third in [1, 3, 5] {
                    let at = (third * length / 6, height(i));
                    let dot = Circle::new(at, 2 * scale, series.colour.filled());
                    legend.draw(&dot).map_err(failed)?;
                }
                legend.draw_text(&series.label, &font, beside(i)).map_err(failed)?;
                continue;
            }
            let ends = [(0.0, f64::from(height(i))), (f64::from(length), f64::from(height(i)))];
            for piece in dashes(&ends, DASHES[series.dash], f64::from(scale)) {
                let line = PathElement::new(piece, series.colour.stroke_width(3 * scale));
                legend.draw(&line).map_err(failed)?;
            }
            legend.draw_text(&series.label, &font, beside(i)).map_err(failed)?;
        }
        // Beside a field the scale of colours has the strip, and the names of stretches stand below it.
        let below = legend.dim_in_pixel().1 as i32 - 40 * scale as i32;
        let height = |i: usize| if self.heat.is_some() { below + height(i) } else { height(i) };
        let beside = |i: usize| (length + 6 * scale as i32, height(i) - 5 * scale as i32);
        let mut next = shown + usize::from(shown < named.len());
        for name in self.span_names() {
            let Some(span) = self.spans.iter().find(|s| s.label == name) else { continue };
            let corners =
                [(0, height(next) - 6 * scale as i32), (length, height(next) + 6 * scale as i32)];
            let field = Rectangle::new(corners, span.colour.filled());
            legend.draw(&field).map_err(failed)?;
            legend.draw_text(name, &font, beside(next)).map_err(failed)?;
            next += 1;
        }
        if let Some(heat) = &self.heat {
            heat.draw_bar(&legend, scale)?;
        }
        if shown < named.len() {
            let more = format!("… and {} more", named.len() - shown);
            legend.draw_text(&more, &font, beside(shown)).map_err(failed)?;
        }
        Ok(area)
    }

    pub(super) fn draw<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        scale: u32,
        legend_width: u32,
        (x, y): (Scale, Scale),
        rasters: &Rasters,
    ) -> Result<(), PlotError> {
        let failed = |e: DrawingAreaErrorKind<DB::ErrorType>| PlotError::Draw(e.to_string());
        let area = self.legend(area, scale, legend_width)?;
        let mut chart = ChartBuilder::on(&area)
            .margin(10 * scale)
            .margin_right(24 * scale)
            .x_label_area_size(44 * scale)
            .y_label_area_size(72 * scale)
            .build_cartesian_2d(x.clone(), y.clone())
            .map_err(failed)?;
        // Below the grid.
        {
            let plot = chart.plotting_area();
            let (width, height) = plot.dim_in_pixel();
            let pixels = plot.strip_coord_spec();
            if let Some(heat) = &self.heat {
                heat.draw(&pixels, (&x, &y), scale, rasters)?;
            }
            for span in &self.spans {
                let at = |v: f64| (x.fraction(v).clamp(0.0, 1.0) * f64::from(width)).round() as i32;
                let (from, to) = (at(span.range.0), at(span.range.1));
                let (from, to) = (from.min(to), from.max(to).max(from + 1));
                // A picture is no higher than that.
                let corners = [(from, 0), (to, height as i32)];
                pixels.draw(&Rectangle::new(corners, span.colour.filled())).map_err(failed)?;
            }
        }
        let grey = RGBColor(222, 222, 222);
        chart
            .configure_mesh()
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .axis_desc_style(("sans-serif", 15 * scale))
            .label_style(("sans-serif", 13 * scale))
            // Lines across a field would be taken for something in it.
            .bold_line_style(if self.heat.is_some() {
                TRANSPARENT.into()
            } else {
                grey.stroke_width(scale)
            })
            .light_line_style(TRANSPARENT)
            .axis_style(RGBColor(120, 120, 120).stroke_width(scale))
            // The labels keep their distance from the axes, and so from those of the other axis.
            .set_all_tick_mark_size(5 * scale)
            .x_label_formatter(&|v| x.label(*v))
            .y_label_formatter(&|v| y.label(*v))
            .draw()
            .map_err(failed)?;
        let plot = chart.plotting_area().strip_coord_spec();
        let (width, height) = plot.dim_in_pixel();
        let pixel = |p: &(f64, f64)| {
            (x.fraction(p.0) * f64::from(width), (1.0 - y.fraction(p.1)) * f64::from(height))
        };
        for series in &self.series {
            let colour = series.colour;
            let good = |p: &(f64, f64)| self.x.good(p.0) && self.y.good(p.1);
            match series.style {
                Style::Line => {
                    // A point that is no number breaks the line: a gap is shown, not bridged.
                    for piece in series.points.split(|p| !good(p)).filter(|p| !p.is_empty()) {
                        if let [point] = piece {
                            // Nothing to draw a line to: a dot that is seen.
                            let dot = Circle::new(*point, 3 * scale, colour.filled());
                            chart.draw_series([dot]).map_err(failed)?;
                            continue;
                        }
                        if series.dash != 0 {
                            let way: Vec<(f64, f64)> = piece.iter().map(pixel).collect();
                            for dash in dashes(&way, DASHES[series.dash], f64::from(scale)) {
                                let dash = PathElement::new(dash, colour.stroke_width(2 * scale));
                                plot.draw(&dash).map_err(failed)?;
                            }
                            continue;
                        }
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
                Style::Area => {
                    for piece in series.points.split(|p| !good(p)).filter(|p| p.len() > 1) {
                        let whole = |(a, b): (f64, f64)| (a.round() as i32, b.round() as i32);
                        let mut outline: Vec<(i32, i32)> =
                            piece.iter().map(|p| whole(pixel(p))).collect();
                        // A picture is no higher than that.
                        let foot = height as i32;
                        let ends = (outline[0].0, outline[outline.len() - 1].0);
                        outline.extend([(ends.1, foot), (ends.0, foot)]);
                        plot.draw(&Polygon::new(outline, colour.filled())).map_err(failed)?;
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
