//! A closer look at a place of a frame: its window, the background of each plane there, and the light above it.

use super::background::{Background, Clipping, clipped_median};
use super::overlap::Aperture;
use super::window::{Plane, Reading, Window};
use glam::DVec2;

/// Settings of a look at a place of a frame, besides the frame.
#[derive(Clone, Copy)]
pub(crate) struct Setting {
    pub(crate) annulus_px: [f64; 2],
    pub clipping: Clipping,
    pub gain_e_per_adu: f64,
}

/// Least part of the annulus' width that is enough of it at a frame's edge.
const LEAST_ANNULUS: f64 = 0.4;

impl Setting {
    /// The same with an annulus that ends at the edge of a frame of this size, where enough of it is left.
    pub fn within(&self, aperture: &Aperture, size: [usize; 2]) -> Self {
        let [inner, outer] = self.annulus_px;
        let trail = aperture.half_box_px(0.0);
        let room = (0..2)
            .map(|axis| {
                let centre = aperture.centre_px[axis];
                (centre + 0.5).min(size[axis] as f64 - 0.5 - centre) - trail[axis]
            })
            .fold(f64::INFINITY, f64::min);
        let enough = room >= inner + LEAST_ANNULUS * (outer - inner);
        Self { annulus_px: [inner, if enough { outer.min(room) } else { outer }], ..*self }
    }
}

/// Buffers of a look, and what it found.
#[derive(Debug, Default)]
pub(crate) struct Look {
    pub window: Window,
    /// Planes and their backgrounds, `None` where the annulus has too few pixels.
    pub planes: Vec<(Plane, Option<Background>)>,
    annulus: Vec<f32>,
    light: Vec<f32>,
    masked: Vec<[f64; 2]>,
}

impl Look {
    /// Takes the pixels around an aperture, out to the annulus, and the background of each plane.
    pub fn at(&mut self, reading: &Reading<'_>, aperture: &Aperture, setting: &Setting) {
        let half = aperture.half_box_px(setting.annulus_px[1]);
        self.window.take(reading, aperture.centre_px.to_array(), half);
        self.planes.clear();
        for plane in Plane::of(reading.frame.bayer) {
            gather(&mut self.annulus, &self.window, plane, aperture, setting.annulus_px);
            self.planes.push((plane, clipped_median(&mut self.annulus, &setting.clipping)));
        }
    }

    /// The light above the background; `None` where a plane has no background. Saturated pixels count as just saturated, those within a pixel of
    /// a place of `without` as masked.
    pub fn light(
        &mut self,
        reading: &Reading<'_>,
        setting: &Setting,
        without: &[DVec2],
    ) -> Option<Light<'_>> {
        let mut levels = Levels::default();
        for (plane, background) in &self.planes {
            let background = (*background)?;
            for row in 0..2 {
                for column in 0..2 {
                    if plane.columns(row, column).is_some_and(|(first, _)| first == column) {
                        levels.level[row][column] = background.level_adu as f32;
                        levels.sigma[row][column] = background.pixel_sigma_adu;
                    }
                }
            }
        }
        self.light.clear();
        self.masked.clear();
        let saturation = reading.saturation_adu as f32;
        let (first, sides) =
            (self.window.origin.map(|o| o as f64), self.window.size.map(|n| n as f64));
        let near =
            |p: &&DVec2| (0..2).all(|axis| (-1.0..=sides[axis]).contains(&(p[axis] - first[axis])));
        let without: Vec<DVec2> = without.iter().filter(near).copied().collect();
        for (row, line) in self.window.rows() {
            for (i, &value) in line.iter().enumerate() {
                let column = self.window.origin[0] + i;
                // Squares of a mosaic have their places between pixels.
                let hit = |p: &DVec2| {
                    (p[0] - column as f64).abs() < 0.9 && (p[1] - row as f64).abs() < 0.9
                };
                let value = if without.iter().any(hit) { f32::NAN } else { value };
                if value.is_nan() {
                    self.masked.push([column as f64, row as f64]);
                }
                let value = if value == f32::INFINITY { saturation } else { value };
                self.light.push(value - levels.level[row % 2][column % 2]);
            }
        }
        Some(Light {
            window: &self.window,
            values: &self.light,
            masked: &self.masked,
            levels,
            mosaic: self.planes.len() > 1,
            adu_per_e: setting.gain_e_per_adu.recip(),
        })
    }
}

/// This plane's usable pixels whose middles lie in the annulus.
fn gather(
    out: &mut Vec<f32>,
    window: &Window,
    plane: Plane,
    aperture: &Aperture,
    annulus_px: [f64; 2],
) {
    out.clear();
    let [inner2, outer2] = annulus_px.map(|r| r * r);
    let disc = aperture.trail_px == DVec2::ZERO;
    let [cx, cy] = aperture.centre_px.to_array();
    for (row, line) in window.rows() {
        let Some((first, step)) = plane.columns(row, window.origin[0]) else { continue };
        let y = row as f64;
        if disc {
            // Only what lies between the two circles in this row.
            let dy2 = (y - cy).powi(2);
            if dy2 > outer2 {
                continue;
            }
            let reach = (outer2 - dy2).sqrt();
            let spans = match inner2 - dy2 {
                hole2 if hole2 > 0.0 => {
                    [(cx - reach, cx - hole2.sqrt()), (cx + hole2.sqrt(), cx + reach)]
                }
                // The second is empty.
                _ => [(cx - reach, cx + reach), (0.0, -1.0)],
            };
            for (from, to) in spans {
                push_between(out, line, window.origin[0], first, step, from, to);
            }
            continue;
        }
        let mut column = first;
        while let Some(&value) = line.get(column - window.origin[0]) {
            let distance = aperture.distance_px(column as f64, y);
            if (annulus_px[0]..=annulus_px[1]).contains(&distance) && value.is_finite() {
                out.push(value);
            }
            column += step;
        }
    }
}

/// The finite values of the columns `from`…`to` of a row.
fn push_between(
    out: &mut Vec<f32>,
    line: &[f32],
    origin: usize,
    first: usize,
    step: usize,
    from: f64,
    to: f64,
) {
    let low = from.ceil().max(first as f64) as usize;
    let start = low - origin + (low - first) % step;
    let end = (to.floor() + 1.0 - origin as f64).max(0.0) as usize;
    for &value in line[start.min(line.len())..end.clamp(start.min(line.len()), line.len())]
        .iter()
        .step_by(step)
    {
        if value.is_finite() {
            out.push(value);
        }
    }
}

/// Background and scatter by the parity of row and column.
#[derive(Debug, Clone, Copy, Default)]
struct Levels {
    level: [[f32; 2]; 2],
    sigma: [[f64; 2]; 2],
}

/// The light of a window above the background of each plane; NaN where a pixel is masked.
pub(crate) struct Light<'a> {
    pub window: &'a Window,
    pub values: &'a [f32],
    masked: &'a [[f64; 2]],
    levels: Levels,
    pub mosaic: bool,
    pub adu_per_e: f64,
}

impl Light<'_> {
    /// Scatter of a pixel without the source, ADU.
    pub fn pixel_sigma(&self, column: usize, row: usize) -> f64 {
        self.levels.sigma[row % 2][column % 2]
    }

    /// The masked pixels of the window: column and row.
    pub(crate) fn masked(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        self.masked.iter().copied()
    }

    /// The light that a masked pixel's mirror image through `centre` has, between the pixels of its own colour: by Catmull-Rom splines, or
    /// straight lines where the mask is among their sixteen pixels; `None` where it is among the four next ones, too. For centroids alone: a
    /// sum is not filled up with it.
    pub(crate) fn mirrored(&self, pixel: [f64; 2], centre: [f64; 2]) -> Option<f64> {
        let splines = |t: f64| {
            [
                0.5 * t * (-1.0 + t * (2.0 - t)),
                0.5 * (2.0 + t * t * (3.0 * t - 5.0)),
                0.5 * t * (1.0 + t * (4.0 - 3.0 * t)),
                0.5 * t * t * (t - 1.0),
            ]
        };
        self.between(pixel, centre, splines)
            .or_else(|| self.between(pixel, centre, |t| [0.0, 1.0 - t, t, 0.0]))
    }

    /// A sum over the pixels around the mirror image, those of weight 0 left out.
    fn between(
        &self,
        pixel: [f64; 2],
        centre: [f64; 2],
        weights: fn(f64) -> [f64; 4],
    ) -> Option<f64> {
        let step = if self.mosaic { 2.0 } else { 1.0 };
        let taps = |axis: usize| {
            let along = 2.0 * (centre[axis] - pixel[axis]) / step;
            let first = pixel[axis] + (along.floor() - 1.0) * step;
            (first - self.window.origin[axis] as f64, weights(along - along.floor()))
        };
        let ((left, across), (top, down)) = (taps(0), taps(1));
        let mut sum = 0.0;
        for (j, v) in down.iter().enumerate() {
            for (i, u) in across.iter().enumerate().filter(|(_, u)| **u * v != 0.0) {
                let place = [left + i as f64 * step, top + j as f64 * step];
                let inside =
                    (0..2).all(|a| place[a] >= 0.0 && place[a] < self.window.size[a] as f64);
                let at = place[1] as usize * self.window.size[0] + place[0] as usize;
                let value = *self.values.get(at).filter(|value| inside && !value.is_nan())?;
                sum += u * v * f64::from(value);
            }
        }
        Some(sum)
    }

    /// Rows with their number in the frame.
    pub fn rows(&self) -> impl Iterator<Item = (usize, &[f32])> {
        let origin = self.window.origin[1];
        self.values
            .chunks_exact(self.window.size[0].max(1))
            .enumerate()
            .map(move |(i, row)| (origin + i, row))
    }
}
