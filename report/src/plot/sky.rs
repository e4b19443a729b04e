//! The sky over a site as someone sees it who lies on their back: zenith in the middle, north up, east on the left.

use super::raster::Rasters;
use super::{Drawn, PlotError};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// A map of the sky with the tracks of what moves over it.
#[derive(Debug, Clone)]
pub struct SkyPlot {
    /// Title of the chart.
    pub title: String,
    /// A line below the title.
    pub subtitle: String,
    /// Lowest free altitude against azimuth, degrees: closed around; what is below is shaded.
    pub horizon: Vec<(f64, f64)>,
    /// The tracks.
    pub tracks: Vec<Track>,
    /// Single places: the Sun (drawn on the rim where it is below the horizon), the Moon.
    pub places: Vec<Place>,
    /// Notes for the strip on the right, below the legend.
    pub notes: Vec<String>,
}

/// Path of a target.
#[derive(Debug, Clone)]
pub struct Track {
    /// Text beside it in the list.
    pub name: String,
    /// Way: azimuth and altitude in degrees, and whether it can be seen.
    pub points: Vec<TrackPoint>,
    /// Azimuth, altitude and text of marks along it.
    pub marks: Vec<(f64, f64, String)>,
    /// Where it stands highest.
    pub top: Option<(f64, f64)>,
}

/// A point of a track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackPoint {
    /// Azimuth, degrees.
    pub azimuth_deg: f64,
    /// Altitude, degrees.
    pub altitude_deg: f64,
    /// Visibility there.
    pub light: Light,
}

/// Visibility of a target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Light {
    /// Sunlit in a dark sky.
    Visible,
    /// Sunlit in a bright sky.
    Bright,
    /// In the Earth's shadow.
    Shadow,
}

/// Something that stands still.
#[derive(Debug, Clone)]
pub struct Place {
    /// Name.
    pub name: String,
    /// Azimuth, degrees.
    pub azimuth_deg: f64,
    /// Altitude, degrees; below the horizon it is marked at the rim.
    pub altitude_deg: f64,
    /// Colour.
    pub colour: RGBColor,
}

const WIDTH: u32 = 1120;
const HEIGHT: u32 = 820;
const CENTRE: (f64, f64) = (400.0, 440.0);
const RADIUS: f64 = 330.0;
/// Left end of the list.
const STRIP: i32 = 790;
/// Names that the list has room for.
const NAMES: usize = 22;

const VISIBLE: RGBColor = RGBColor(213, 94, 0);
const BRIGHT: RGBColor = RGBColor(86, 180, 233);
const SHADOW: RGBColor = RGBColor(70, 70, 80);

impl Light {
    fn colour(self) -> RGBColor {
        match self {
            Light::Visible => VISIBLE,
            Light::Bright => BRIGHT,
            Light::Shadow => SHADOW,
        }
    }

    fn words(self) -> &'static str {
        match self {
            Light::Visible => "sunlit, sky dark",
            Light::Bright => "sunlit, sky bright",
            Light::Shadow => "in the Earth's shadow",
        }
    }
}

impl SkyPlot {
    /// The map as an SVG text.
    pub fn svg(&self) -> Result<String, PlotError> {
        super::svg(self)
    }

    /// The map as the bytes of a PNG file, at twice the size of the SVG.
    pub fn png(&self) -> Result<Vec<u8>, PlotError> {
        super::png(self)
    }
}

/// A place on the picture, pixels at scale 1: azimuthal equidistant, east on the left.
fn place(azimuth_deg: f64, altitude_deg: f64) -> (f64, f64) {
    let r = RADIUS * (90.0 - altitude_deg) / 90.0;
    let (sin, cos) = azimuth_deg.to_radians().sin_cos();
    (CENTRE.0 - r * sin, CENTRE.1 - r * cos)
}

impl Drawn for SkyPlot {
    fn size(&self, scale: u32) -> (u32, u32) {
        (WIDTH * scale, HEIGHT * scale)
    }

    fn draw<DB: DrawingBackend>(
        &self,
        root: &DrawingArea<DB, Shift>,
        scale: u32,
        _: &Rasters,
    ) -> Result<(), PlotError> {
        let pen = Pen { root, scale };
        root.fill(&WHITE).map_err(failed::<DB>)?;
        pen.text(&fitted(&self.title, 95), (16.0, 14.0), 19, BLACK, HPos::Left, VPos::Top)?;
        let grey = RGBColor(90, 90, 90);
        pen.text(&self.subtitle, (16.0, 42.0), 13, grey, HPos::Left, VPos::Top)?;
        self.grid(&pen)?;
        for track in &self.tracks {
            pen.track(track)?;
        }
        let many = self.tracks.len() > 12;
        for (i, track) in self.tracks.iter().enumerate() {
            pen.marks(track, i + 1, !many)?;
        }
        for place in &self.places {
            pen.place(place)?;
        }
        self.strip(&pen)
    }
}

impl SkyPlot {
    fn grid<DB: DrawingBackend>(&self, pen: &Pen<'_, DB>) -> Result<(), PlotError> {
        let (ground, line, text) =
            (RGBColor(236, 233, 226), RGBColor(205, 205, 205), RGBColor(110, 110, 110));
        let around = |altitude: &dyn Fn(f64) -> f64| -> Vec<(f64, f64)> {
            (0..=720).map(|i| f64::from(i) * 0.5).map(|az| place(az, altitude(az))).collect()
        };
        // What stands in the way: the ring between the rim and the lowest free altitude.
        pen.polygon(&around(&|_| 0.0), ground)?;
        pen.polygon(&around(&|az| at(&self.horizon, az).max(0.0)), RGBColor(252, 252, 255))?;
        for altitude in [30.0, 60.0] {
            pen.line(&around(&|_| altitude), 1, line)?;
        }
        for azimuth in (0..360).step_by(30) {
            let ends = [place(f64::from(azimuth), 0.0), place(f64::from(azimuth), 84.0)];
            pen.line(&ends, 1, if azimuth % 90 == 0 { RGBColor(185, 185, 185) } else { line })?;
        }
        pen.line(&around(&|az| at(&self.horizon, az).max(0.0)), 1, RGBColor(170, 160, 140))?;
        pen.line(&around(&|_| 0.0), 2, RGBColor(120, 120, 120))?;
        for altitude in [30.0, 60.0] {
            let label = format!("{altitude:.0}°");
            let (x, y) = place(180.0, altitude);
            pen.text(&label, (x + 5.0, y - 2.0), 12, text, HPos::Left, VPos::Bottom)?;
        }
        for azimuth in (0..360).step_by(30) {
            let (x, y) = place(f64::from(azimuth), -5.5);
            let name = match azimuth {
                0 => "N",
                90 => "E",
                180 => "S",
                270 => "W",
                _ => "",
            };
            let at = (x, y);
            if name.is_empty() {
                let degrees = format!("{azimuth}°");
                pen.text(&degrees, at, 12, text, HPos::Center, VPos::Center)?;
            } else {
                pen.text(name, at, 18, BLACK, HPos::Center, VPos::Center)?;
            }
        }
        Ok(())
    }

    fn strip<DB: DrawingBackend>(&self, pen: &Pen<'_, DB>) -> Result<(), PlotError> {
        let x = f64::from(STRIP);
        let mut y = 96.0;
        for light in [Light::Visible, Light::Bright, Light::Shadow] {
            let width = if light == Light::Visible { 4 } else { 2 };
            pen.line(&[(x, y), (x + 26.0, y)], width, light.colour())?;
            pen.text(light.words(), (x + 34.0, y), 13, BLACK, HPos::Left, VPos::Center)?;
            y += 21.0;
        }
        pen.dot((x + 13.0, y), 4.5, VISIBLE, true)?;
        pen.text("highest", (x + 34.0, y), 13, BLACK, HPos::Left, VPos::Center)?;
        y += 34.0;
        let shown = if self.tracks.len() > NAMES { NAMES - 1 } else { self.tracks.len() };
        for (i, track) in self.tracks[..shown].iter().enumerate() {
            let number = (i + 1).to_string();
            pen.text(&number, (x + 16.0, y), 12, VISIBLE, HPos::Right, VPos::Center)?;
            let name = fitted(&track.name, 40);
            pen.text(&name, (x + 24.0, y), 12, BLACK, HPos::Left, VPos::Center)?;
            y += 18.0;
        }
        if shown < self.tracks.len() {
            let more = format!("… and {} more", self.tracks.len() - shown);
            pen.text(&more, (x + 24.0, y), 12, BLACK, HPos::Left, VPos::Center)?;
            y += 18.0;
        }
        y += 14.0;
        for note in &self.notes {
            pen.text(
                &fitted(note, 44),
                (x, y),
                12,
                RGBColor(90, 90, 90),
                HPos::Left,
                VPos::Center,
            )?;
            y += 17.0;
        }
        Ok(())
    }
}

struct Pen<'a, DB: DrawingBackend> {
    root: &'a DrawingArea<DB, Shift>,
    scale: u32,
}

impl<DB: DrawingBackend> Pen<'_, DB> {
    fn pixel(&self, (x, y): (f64, f64)) -> (i32, i32) {
        let scale = f64::from(self.scale);
        // A cast of a float saturates.
        ((x * scale).round() as i32, (y * scale).round() as i32)
    }

    fn text(
        &self,
        text: &str,
        at: (f64, f64),
        size: u32,
        colour: RGBColor,
        h: HPos,
        v: VPos,
    ) -> Result<(), PlotError> {
        let style = ("sans-serif", size * self.scale).into_font().color(&colour);
        let style = style.pos(Pos::new(h, v));
        self.root.draw_text(text, &style, self.pixel(at)).map_err(failed::<DB>)
    }

    fn polygon(&self, points: &[(f64, f64)], colour: RGBColor) -> Result<(), PlotError> {
        let points: Vec<(i32, i32)> = points.iter().map(|p| self.pixel(*p)).collect();
        self.root.draw(&Polygon::new(points, colour.filled())).map_err(failed::<DB>)
    }

    fn line(&self, points: &[(f64, f64)], width: u32, colour: RGBColor) -> Result<(), PlotError> {
        let points: Vec<(i32, i32)> = points.iter().map(|p| self.pixel(*p)).collect();
        let stroke = colour.stroke_width(width * self.scale);
        if self.scale == 1 {
            return self.root.draw(&PathElement::new(points, stroke)).map_err(failed::<DB>);
        }
        // In a bitmap the library's joins shoot out as spikes: single strokes with round ends instead.
        for ends in points.windows(2) {
            self.root.draw(&PathElement::new(ends.to_vec(), stroke)).map_err(failed::<DB>)?;
        }
        if width > 1 {
            for point in &points {
                let radius = (width * self.scale / 2) as i32;
                let join = Circle::new(*point, radius, colour.filled());
                self.root.draw(&join).map_err(failed::<DB>)?;
            }
        }
        Ok(())
    }

    fn dot(
        &self,
        at: (f64, f64),
        radius: f64,
        colour: RGBColor,
        filled: bool,
    ) -> Result<(), PlotError> {
        let at = self.pixel(at);
        let radius = (radius * f64::from(self.scale)).round() as i32;
        let halo = Circle::new(at, radius + 2 * self.scale as i32, WHITE.filled());
        self.root.draw(&halo).map_err(failed::<DB>)?;
        let style = if filled { colour.filled() } else { colour.stroke_width(2 * self.scale) };
        self.root.draw(&Circle::new(at, radius, style)).map_err(failed::<DB>)
    }

    /// A track in pieces of one light each; neighbours share their border.
    fn track(&self, track: &Track) -> Result<(), PlotError> {
        let mut from = 0;
        let points = &track.points;
        for i in 1..=points.len() {
            if i == points.len() || points[i].light != points[from].light {
                let end = (i + 1).min(points.len());
                let piece: Vec<(f64, f64)> = points[from..end]
                    .iter()
                    .map(|p| place(p.azimuth_deg, p.altitude_deg))
                    .collect();
                let light = points[from].light;
                let width = if light == Light::Visible { 4 } else { 2 };
                if piece.len() > 1 {
                    self.line(&piece, width, light.colour())?;
                }
                from = i;
            }
        }
        Ok(())
    }

    fn marks(&self, track: &Track, number: usize, times: bool) -> Result<(), PlotError> {
        if times {
            for (azimuth, altitude, text) in &track.marks {
                let at = place(*azimuth, *altitude);
                self.dot(at, 2.0, RGBColor(60, 60, 60), true)?;
                let (right, h) =
                    if at.0 < CENTRE.0 { (-7.0, HPos::Right) } else { (7.0, HPos::Left) };
                let beside = (at.0 + right, at.1);
                self.text(text, beside, 11, RGBColor(60, 60, 60), h, VPos::Center)?;
            }
        }
        if let [.., before, last] = track.points.as_slice() {
            self.arrow(
                place(before.azimuth_deg, before.altitude_deg),
                place(last.azimuth_deg, last.altitude_deg),
                last.light.colour(),
            )?;
        }
        if let Some((azimuth, altitude)) = track.top {
            let at = place(azimuth, altitude);
            let light = |p: &&TrackPoint| (p.altitude_deg - altitude).abs();
            let nearest = track.points.iter().min_by(|a, b| light(a).total_cmp(&light(b)));
            let colour = nearest.map_or(VISIBLE, |p| p.light.colour());
            self.dot(at, 4.5, colour, true)?;
            // The number stands outside of the track, as seen from the zenith.
            let (dx, dy) = (at.0 - CENTRE.0, at.1 - CENTRE.1);
            let length = dx.hypot(dy).max(1.0);
            let beside = (at.0 + 15.0 * dx / length, at.1 + 15.0 * dy / length);
            self.text(&number.to_string(), beside, 14, BLACK, HPos::Center, VPos::Center)?;
        }
        Ok(())
    }

    fn arrow(&self, from: (f64, f64), to: (f64, f64), colour: RGBColor) -> Result<(), PlotError> {
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let length = dx.hypot(dy);
        if length < 1e-6 {
            return Ok(());
        }
        let (dx, dy) = (dx / length, dy / length);
        let corner = |along: f64, across: f64| {
            (to.0 + along * dx - across * dy, to.1 + along * dy + across * dx)
        };
        self.polygon(&[corner(5.0, 0.0), corner(-9.0, 6.0), corner(-9.0, -6.0)], colour)
    }

    fn place(&self, body: &Place) -> Result<(), PlotError> {
        let up = body.altitude_deg > 0.0;
        let at = place(body.azimuth_deg, if up { body.altitude_deg } else { 0.0 });
        self.dot(at, 6.0, body.colour, up)?;
        if up {
            let (h, right) =
                if at.0 < CENTRE.0 { (HPos::Left, 11.0) } else { (HPos::Right, -11.0) };
            let beside = (at.0 + right, at.1);
            return self.text(&body.name, beside, 12, BLACK, h, VPos::Center);
        }
        // Below the horizon: beyond the names of the directions.
        let text = format!("{}, {:.0}° high", body.name, body.altitude_deg);
        let beyond = place(body.azimuth_deg, -11.0);
        let h = if beyond.0 < CENTRE.0 { HPos::Right } else { HPos::Left };
        let h = if (beyond.0 - CENTRE.0).abs() < 0.4 * RADIUS { HPos::Center } else { h };
        self.text(&text, beyond, 12, BLACK, h, VPos::Center)
    }
}

fn failed<DB: DrawingBackend>(error: DrawingAreaErrorKind<DB::ErrorType>) -> PlotError {
    PlotError::Draw(error.to_string())
}

/// The altitude of a closed polygon at an azimuth.
fn at(horizon: &[(f64, f64)], azimuth_deg: f64) -> f64 {
    let turned = azimuth_deg.rem_euclid(360.0);
    let i = horizon.partition_point(|(azimuth, _)| *azimuth <= turned);
    let (Some(&first), Some(&last)) = (horizon.first(), horizon.last()) else { return 0.0 };
    let a = if i == 0 { (last.0 - 360.0, last.1) } else { horizon[i - 1] };
    let b = if i == horizon.len() { (first.0 + 360.0, first.1) } else { horizon[i] };
    if b.0 > a.0 { a.1 + (b.1 - a.1) * (turned - a.0) / (b.0 - a.0) } else { a.1 }
}

/// A text of at most so many characters.
fn fitted(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.to_owned();
    }
    text.chars().take(most - 1).chain(['…']).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: by hand. North is up, east on the left, the zenith in the middle.
    #[test]
    fn places_on_the_map() {
        let close = |a: (f64, f64), b: (f64, f64)| (a.0 - b.0).hypot(a.1 - b.1) < 1e-9;
        assert!(close(place(123.0, 90.0), CENTRE));
        assert!(close(place(0.0, 0.0), (CENTRE.0, CENTRE.1 - RADIUS)));
        assert!(close(place(90.0, 0.0), (CENTRE.0 - RADIUS, CENTRE.1)));
        assert!(close(place(180.0, 45.0), (CENTRE.0, CENTRE.1 + 0.5 * RADIUS)));
        let mask = [(10.0, 0.0), (100.0, 9.0), (350.0, 2.0)];
        assert!((at(&mask, 55.0) - 4.5).abs() < 1e-9 && (at(&mask, 0.0) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_map_is_drawn_both_ways() {
        let point =
            |azimuth_deg, altitude_deg, light| TrackPoint { azimuth_deg, altitude_deg, light };
        let plot = SkyPlot {
            title: "Sky".into(),
            subtitle: "night".into(),
            horizon: vec![(0.0, 5.0), (359.0, 5.0)],
            tracks: vec![Track {
                name: "ISS".into(),
                points: vec![
                    point(300.0, 5.0, Light::Visible),
                    point(20.0, 70.0, Light::Visible),
                    point(90.0, 20.0, Light::Shadow),
                ],
                marks: vec![(300.0, 5.0, "20:31".into())],
                top: Some((20.0, 70.0)),
            }],
            places: vec![],
            notes: vec!["note".into()],
        };
        let svg = plot.svg().unwrap();
        assert!(svg.contains("ISS") && svg.contains("20:31") && svg.contains("#D55E00"), "{svg}");
        let png = plot.png().unwrap();
        assert_eq!(image::load_from_memory(&png).unwrap().width(), 2 * WIDTH);
    }
}
