//! Pictures beside one another, each with its scale of colours or the names of its colours.

use super::heat::draw_scale;
use super::raster::Rasters;
use super::scale::Scale;
use super::{Drawn, PlotError};
use image::RgbaImage;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Pictures beside one another: two in a row, or as many more as let them fit a page (A4).
#[derive(Debug, Clone)]
pub struct Gallery {
    /// Title of the pictures.
    pub title: String,
    /// Lines below the title.
    pub subtitle: Vec<String>,
    /// The pictures.
    pub tiles: Vec<Tile>,
}

/// A picture.
#[derive(Debug, Clone)]
pub struct Tile {
    /// Title of the picture.
    pub title: String,
    /// The picture: rows from the top.
    pub image: RgbaImage,
    /// Whether what is drawn over it has to be bright.
    pub is_dark: bool,
    /// Meaning of its colours.
    pub key: Key,
    /// Directions, drawn from one point in the lower right corner.
    pub arrows: Vec<Arrow>,
    /// A length in the lower left corner: its share of the picture's width, and in words.
    pub scale_bar: Option<(f64, String)>,
}

/// Meaning of colours.
#[derive(Debug, Clone)]
pub enum Key {
    /// Values between two ends.
    Bar {
        /// Quantity and unit, a line for each.
        label: Vec<String>,
        /// The values at both ends.
        range: (f64, f64),
        /// True for a logarithmic scale.
        log: bool,
    },
    /// Names of colours.
    Names(Vec<(RGBColor, String)>),
    /// Some words.
    Words(Vec<String>),
}

/// A direction across a picture.
#[derive(Debug, Clone)]
pub struct Arrow {
    /// Name of the thing there.
    pub name: String,
    /// To the right and upwards; 1 long where it lies across the line of sight.
    pub across: (f64, f64),
    /// Whether it points towards whoever looks.
    pub is_near: bool,
    /// Colour, where it has one of its own.
    pub colour: Option<RGBColor>,
}

const PICTURE: u32 = 400;
const STRIP: u32 = 170;
const MARGIN: u32 = 16;
const TILE_TITLE: u32 = 30;
const TITLE: u32 = 44;
const LINE: u32 = 19;
/// Length of an arrow, pixels, and its room.
const ARROW: f64 = 30.0;
const CORNER: f64 = 54.0;

impl Gallery {
    /// The figure as an SVG text.
    pub fn svg(&self) -> Result<String, PlotError> {
        super::svg(self)
    }

    /// The figure as the bytes of a PNG file, at twice the size of the SVG.
    pub fn png(&self) -> Result<Vec<u8>, PlotError> {
        super::png(self)
    }

    /// Pictures in a row: the fewest, two or more, with which the figure is no higher than a page of its width.
    fn columns(&self) -> usize {
        let n = self.tiles.len();
        let fits = |columns: &usize| {
            let (width, height) = self.size_of(*columns);
            f64::from(height) <= f64::from(width) * std::f64::consts::SQRT_2
        };
        (2..n).find(fits).unwrap_or(n).max(1)
    }

    /// Width and height with so many pictures in a row, pixels.
    fn size_of(&self, columns: usize) -> (u32, u32) {
        let rows = self.tiles.len().div_ceil(columns.max(1)).max(1) as u32;
        let width = MARGIN + columns as u32 * (PICTURE + STRIP + MARGIN);
        // A single picture has a title as well.
        (width.max(760), self.head() + rows * (TILE_TITLE + PICTURE + MARGIN))
    }

    fn head(&self) -> u32 {
        TITLE + LINE * self.subtitle.len() as u32 + 6
    }
}

/// Width and height of a picture as it is drawn: its longer side has the same length everywhere.
fn drawn_size(image: &RgbaImage) -> (u32, u32) {
    let (w, h) = (f64::from(image.width()), f64::from(image.height()));
    let scale = f64::from(PICTURE) / w.max(h).max(1.0);
    let side = |x: f64| ((x * scale).round() as u32).max(1);
    (side(w), side(h))
}

fn failed<DB: DrawingBackend>(error: DrawingAreaErrorKind<DB::ErrorType>) -> PlotError {
    PlotError::Draw(error.to_string())
}

impl Drawn for Gallery {
    fn size(&self, scale: u32) -> (u32, u32) {
        let (width, height) = self.size_of(self.columns());
        (width * scale, height * scale)
    }

    fn draw<DB: DrawingBackend>(
        &self,
        root: &DrawingArea<DB, Shift>,
        scale: u32,
        rasters: &Rasters,
    ) -> Result<(), PlotError> {
        root.fill(&WHITE).map_err(failed::<DB>)?;
        let (width, _) = root.dim_in_pixel();
        let s = scale as i32;
        let mut size = 19;
        let style = |size: u32| ("sans-serif", size * scale).into_font().color(&BLACK);
        while size > 8
            && root.estimate_text_size(&self.title, &style(size)).map_err(failed::<DB>)?.0
                > width - 2 * MARGIN * scale
        {
            size -= 1;
        }
        root.draw_text(&self.title, &style(size), (16 * s, 14 * s)).map_err(failed::<DB>)?;
        let grey = ("sans-serif", 13 * scale).into_font().color(&RGBColor(90, 90, 90));
        for (i, line) in self.subtitle.iter().enumerate() {
            let y = (TITLE + LINE * i as u32) as i32 * s;
            root.draw_text(line, &grey, (16 * s, y)).map_err(failed::<DB>)?;
        }
        for (i, tile) in self.tiles.iter().enumerate() {
            let (row, column) = ((i / self.columns()) as u32, (i % self.columns()) as u32);
            let x = MARGIN + column * (PICTURE + STRIP + MARGIN);
            let y = self.head() + row * (TILE_TITLE + PICTURE + MARGIN);
            let area = root.clone().shrink(
                (x * scale, y * scale),
                ((PICTURE + STRIP) * scale, (TILE_TITLE + PICTURE) * scale),
            );
            tile.draw(&area, scale, rasters)?;
        }
        Ok(())
    }
}

impl Tile {
    fn draw<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        scale: u32,
        rasters: &Rasters,
    ) -> Result<(), PlotError> {
        let s = scale as i32;
        let title = ("sans-serif", 15 * scale).into_font().color(&BLACK);
        area.draw_text(&self.title, &title, (0, 6 * s)).map_err(failed::<DB>)?;
        let (_, below) = area.split_vertically(TILE_TITLE * scale);
        let (picture, strip) = below.split_horizontally((PICTURE + 12) * scale);
        let (width, height) = drawn_size(&self.image);
        self.pixels(&picture, (width * scale, height * scale), scale, rasters)?;
        let frame = Rectangle::new(
            [(0, 0), ((width * scale) as i32, (height * scale) as i32)],
            RGBColor(120, 120, 120).stroke_width(scale),
        );
        picture.draw(&frame).map_err(failed::<DB>)?;
        let pen = Pen {
            area: &picture,
            scale,
            colour: if self.is_dark { WHITE } else { RGBColor(40, 40, 40) },
        };
        pen.compass(&self.arrows, (f64::from(width) - CORNER, f64::from(height) - CORNER))?;
        if let Some((share, words)) = &self.scale_bar {
            pen.length(share * f64::from(width), words, f64::from(height))?;
        }
        self.key(&strip, scale)
    }

    /// The picture itself: in an SVG one image, in a bitmap rectangles of one colour.
    fn pixels<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        (width, height): (u32, u32),
        scale: u32,
        rasters: &Rasters,
    ) -> Result<(), PlotError> {
        if scale == 1 {
            let corners = [(0, 0), (width as i32, height as i32)];
            let stand_in = Rectangle::new(corners, rasters.add(&self.image)?.filled());
            return area.draw(&stand_in).map_err(failed::<DB>);
        }
        let (columns, rows) = self.image.dimensions();
        let edge = |i: u32, n: u32, length: u32| {
            (u64::from(i) * u64::from(length) / u64::from(n.max(1))) as i32
        };
        for y in 0..rows {
            let (top, bottom) = (edge(y, rows, height), edge(y + 1, rows, height));
            let mut x = 0;
            while x < columns {
                let colour = *self.image.get_pixel(x, y);
                let mut end = x + 1;
                while end < columns && *self.image.get_pixel(end, y) == colour {
                    end += 1;
                }
                let [r, g, b, a] = colour.0;
                if a > 0 && bottom > top {
                    let last = (edge(end, columns, width), bottom);
                    let corners = [(edge(x, columns, width), top), last];
                    let run = Rectangle::new(corners, RGBColor(r, g, b).filled());
                    area.draw(&run).map_err(failed::<DB>)?;
                }
                x = end;
            }
        }
        Ok(())
    }

    fn key<DB: DrawingBackend>(
        &self,
        strip: &DrawingArea<DB, Shift>,
        scale: u32,
    ) -> Result<(), PlotError> {
        let s = scale as i32;
        let font = ("sans-serif", 13 * scale).into_font().color(&BLACK);
        match &self.key {
            Key::Bar { label, range, log } => {
                draw_scale(label, &Scale::vertical(*range, *log), strip, scale, 8)
            }
            Key::Names(names) => {
                for (i, (colour, name)) in names.iter().enumerate() {
                    let y = (4 + 20 * i as i32) * s;
                    let swatch = Rectangle::new([(0, y), (16 * s, y + 13 * s)], colour.filled());
                    strip.draw(&swatch).map_err(failed::<DB>)?;
                    strip.draw_text(name, &font, (22 * s, y)).map_err(failed::<DB>)?;
                }
                Ok(())
            }
            Key::Words(lines) => {
                for (i, line) in lines.iter().enumerate() {
                    let at = (0, (4 + 18 * i as i32) * s);
                    strip.draw_text(line, &font, at).map_err(failed::<DB>)?;
                }
                Ok(())
            }
        }
    }
}

struct Pen<'a, DB: DrawingBackend> {
    area: &'a DrawingArea<DB, Shift>,
    scale: u32,
    colour: RGBColor,
}

impl<DB: DrawingBackend> Pen<'_, DB> {
    fn pixel(&self, (x, y): (f64, f64)) -> (i32, i32) {
        let scale = f64::from(self.scale);
        // A cast of a float saturates.
        ((x * scale).round() as i32, (y * scale).round() as i32)
    }

    fn text(&self, text: &str, at: (f64, f64), h: HPos, v: VPos) -> Result<(), PlotError> {
        let style = ("sans-serif", 12 * self.scale).into_font().color(&self.colour);
        let style = style.pos(Pos::new(h, v));
        self.area.draw_text(text, &style, self.pixel(at)).map_err(failed::<DB>)
    }

    fn line(&self, from: (f64, f64), to: (f64, f64)) -> Result<(), PlotError> {
        let ends = [self.pixel(from), self.pixel(to)];
        let stroke = self.colour.stroke_width(2 * self.scale);
        self.area.draw(&PathElement::new(ends, stroke)).map_err(failed::<DB>)
    }

    /// Directions from one point.
    fn compass(&self, arrows: &[Arrow], from: (f64, f64)) -> Result<(), PlotError> {
        for arrow in arrows {
            let pen = Pen { colour: arrow.colour.unwrap_or(self.colour), ..*self };
            let (dx, dy) = (arrow.across.0, -arrow.across.1);
            let length = dx.hypot(dy);
            if length < 0.15 {
                // Along the line of sight: a dot towards whoever looks, a ring away from them.
                let radius = (4 * self.scale) as i32;
                let style = if arrow.is_near {
                    pen.colour.filled()
                } else {
                    pen.colour.stroke_width(self.scale)
                };
                let dot = Circle::new(self.pixel(from), radius, style);
                self.area.draw(&dot).map_err(failed::<DB>)?;
                let beside = (from.0 + 8.0, from.1 + 12.0);
                pen.text(&arrow.name, beside, HPos::Left, VPos::Center)?;
                continue;
            }
            let tip = (from.0 + ARROW * dx, from.1 + ARROW * dy);
            pen.line(from, tip)?;
            let (ux, uy) = (dx / length, dy / length);
            let corner = |along: f64, aside: f64| {
                self.pixel((tip.0 + along * ux - aside * uy, tip.1 + along * uy + aside * ux))
            };
            let head = vec![corner(4.0, 0.0), corner(-5.0, 4.0), corner(-5.0, -4.0)];
            self.area.draw(&Polygon::new(head, pen.colour.filled())).map_err(failed::<DB>)?;
            let beyond = (tip.0 + 13.0 * ux, tip.1 + 12.0 * uy);
            pen.text(&arrow.name, beyond, HPos::Center, VPos::Center)?;
        }
        Ok(())
    }

    /// A length, above the lower left corner.
    fn length(&self, length: f64, words: &str, height: f64) -> Result<(), PlotError> {
        let (left, y) = (14.0, height - 14.0);
        self.line((left, y), (left + length, y))?;
        for x in [left, left + length] {
            self.line((x, y - 4.0), (x, y + 4.0))?;
        }
        self.text(words, (left, y - 8.0), HPos::Left, VPos::Bottom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgba;

    fn tile() -> Tile {
        Tile {
            title: "Tile".into(),
            image: RgbaImage::new(4, 4),
            is_dark: false,
            key: Key::Words(vec![]),
            arrows: vec![],
            scale_bar: None,
        }
    }

    /// Truth: the sides of A4, 210 by 297 mm: no figure is higher for its width. Up to six pictures stand two in a row.
    #[test]
    fn figures_of_many_pictures_fit_a_page() {
        for n in 1..=60 {
            let tiles = vec![tile(); n];
            let subtitle = vec!["line".into(); 3];
            let gallery = Gallery { title: "Title".into(), subtitle, tiles };
            let (width, height) = gallery.size(1);
            let columns = if n <= 6 { n.min(2) } else { gallery.columns() };
            assert_eq!(gallery.columns(), columns, "{n}");
            assert!(f64::from(height) / f64::from(width) <= 297.0 / 210.0, "{n}: {width} {height}");
            assert!(n > 15 || columns <= 3, "{n}: {columns}");
        }
    }

    /// Truth: by hand: a red left half of the picture is red in the middle of the left half of what is drawn, in a bitmap of twice the size.
    #[test]
    fn a_picture_is_drawn_both_ways() {
        let image = RgbaImage::from_fn(40, 20, |x, _| {
            if x < 20 { Rgba([255, 0, 0, 255]) } else { Rgba([0, 0, 255, 255]) }
        });
        let tile = Tile {
            title: "Tile".into(),
            image,
            is_dark: true,
            key: Key::Bar { label: vec!["m".into()], range: (0.0, 2.0), log: false },
            arrows: vec![Arrow {
                name: "Sun".into(),
                across: (1.0, 0.0),
                is_near: true,
                colour: None,
            }],
            scale_bar: Some((0.25, "1 m".into())),
        };
        let gallery = Gallery { title: "Title".into(), subtitle: vec![], tiles: vec![tile] };
        let svg = gallery.svg().unwrap();
        assert_eq!(svg.matches("<image ").count(), 1);
        assert!(svg.contains("Sun") && svg.contains("1 m"), "{svg}");
        let png = image::load_from_memory(&gallery.png().unwrap()).unwrap().to_rgba8();
        let at = |fraction: f64| {
            let x = f64::from(MARGIN) + fraction * f64::from(PICTURE);
            let y = f64::from(gallery.head() + TILE_TITLE) + 0.25 * f64::from(PICTURE);
            png.get_pixel((2.0 * x) as u32, (2.0 * y) as u32).0
        };
        assert_eq!((at(0.25), at(0.6)), ([255, 0, 0, 255], [0, 0, 255, 255]));
    }
}
