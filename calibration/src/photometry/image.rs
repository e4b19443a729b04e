//! A frame prepared for the search: one image of all colours above its local background, without what is too sharp, smoothed.

use super::background::{Clipping, clipped_median};
use super::regions::neighbours;
use super::window::{Reading, Window};

/// Pixels across a tile of the local background.
pub(crate) const TILE: usize = 32;

/// A window as one image: the values of a monochrome frame, or the means of the 2 × 2 squares of a mosaic (each of which holds all colours).
pub(crate) struct Image {
    values: Vec<f32>,
    /// Columns and rows.
    pub size: [usize; 2],
    /// Where its first pixel is in the frame.
    pub origin: [f64; 2],
}

impl Image {
    /// `None` of an empty window.
    pub fn of(window: &Window, reading: &Reading<'_>) -> Option<Self> {
        let full = reading.saturation_adu as f32;
        let [width, height] = window.size;
        let value = |v: f32| if v == f32::INFINITY { full } else { v };
        let origin = window.origin.map(|o| o as f64);
        if reading.frame.bayer.is_none() {
            let values: Vec<f32> = window.values.iter().map(|&v| value(v)).collect();
            return (!values.is_empty()).then_some(Self { values, size: window.size, origin });
        }
        let size = [width.checked_sub(1)?, height.checked_sub(1)?];
        let mut values = Vec::with_capacity(size[0] * size[1]);
        for y in 0..size[1] {
            let (upper, lower) =
                (&window.values[y * width..][..width], &window.values[(y + 1) * width..][..width]);
            for x in 0..size[0] {
                let square = [upper[x], upper[x + 1], lower[x], lower[x + 1]];
                values.push(square.into_iter().map(value).sum::<f32>() / 4.0);
            }
        }
        (!values.is_empty()).then_some(Self { values, size, origin: origin.map(|o| o + 0.5) })
    }

    /// The image above its local background, in standard deviations of a pixel. Masked pixels count nothing.
    pub fn above_background(&self) -> Vec<f64> {
        let tiles = Tiles::of(self);
        let width = self.size[0];
        let pixels = self.values.iter().enumerate().map(|(i, &value)| {
            let (level, sigma) = tiles.at(i % width, i / width);
            if value.is_nan() { 0.0 } else { (f64::from(value) - level) / sigma }
        });
        pixels.collect()
    }
}

impl Image {
    /// Which pixels are masked.
    pub fn masked(&self) -> Vec<bool> {
        self.values.iter().map(|value| value.is_nan()).collect()
    }
}

/// Takes what is sharper than a point could be out of an image above its background: cosmic rays, hot pixels. Gives their pixels.
///
/// A pixel is sharp that is 5 σ above what the fifth highest of its eight neighbours allows: beside a point at least half of them have 35 % of what a
/// point of `sigma_px` leaves on a diagonal, beside a track one pixel wide five are dark. So are those of its neighbours that are 2.5 σ
/// above it. They get the median of the others around them. Masked pixels are neither: nothing is known of them.
pub(crate) fn take_out_sharp(
    image: &mut [f64],
    masked: &[bool],
    size: [usize; 2],
    sigma_px: f64,
) -> Vec<usize> {
    let least = 0.35 * (-1.0 / (sigma_px * sigma_px)).exp();
    // What is masked says nothing of its neighbours: it is not dark.
    let mut sharp = masked.to_vec();
    let mut pixels = Vec::new();
    let excess = |image: &[f64], sharp: &[bool], pixel: usize| {
        let mut near = [0.0; 8];
        let mut n = 0;
        for other in neighbours(pixel, size).filter(|&other| !sharp[other]) {
            near[n] = image[other];
            n += 1;
        }
        near[..n].sort_by(f64::total_cmp);
        // The fourth lowest of eight; of fewer in proportion.
        image[pixel] - near[..n].get(n.saturating_sub(1) / 2).map_or(0.0, |v| v.max(0.0)) / least
    };
    for (pixel, &value) in image.iter().enumerate() {
        if value > 5.0 && excess(image, &sharp, pixel) > 5.0 {
            pixels.push(pixel);
        }
    }
    for &pixel in &pixels {
        sharp[pixel] = true;
    }
    let mut next = 0;
    while let Some(&pixel) = pixels.get(next) {
        next += 1;
        for other in neighbours(pixel, size) {
            if !sharp[other] && image[other] > 2.5 && excess(image, &sharp, other) > 2.5 {
                sharp[other] = true;
                pixels.push(other);
            }
        }
    }
    for &pixel in &pixels {
        let mut near: Vec<f64> = neighbours(pixel, size)
            .filter(|&other| !sharp[other])
            .map(|other| image[other])
            .collect();
        near.sort_by(f64::total_cmp);
        image[pixel] = near.get(near.len() / 2).copied().unwrap_or(0.0);
    }
    pixels
}

/// An image smoothed with a normal profile, in standard deviations of the result.
pub(crate) fn significance(image: &[f64], size: [usize; 2], sigma_px: f64) -> Vec<f64> {
    let smoothed = smooth(image, size, sigma_px);
    // Squares of a mosaic share pixels, so the noise of the smoothed frame is measured, not derived.
    let mut sorted: Vec<f32> = smoothed.iter().map(|&v| v as f32).collect();
    let Some(noise) = clipped_median(&mut sorted, &CLIPPING) else { return vec![0.0; image.len()] };
    let scatter = noise.pixel_sigma_adu.max(1e-9);
    smoothed.iter().map(|v| (v - noise.level_adu) / scatter).collect()
}

/// Clipping for levels of tiles and of the smoothed frame.
const CLIPPING: Clipping =
    Clipping { sigma: 3.0, rounds: 8, gain_and_read_noise: None, step_adu: 0.0 };

/// Levels and scatters of the tiles of an image, each the median of its neighbourhood.
struct Tiles {
    count: [usize; 2],
    size: [f64; 2],
    level: Vec<f64>,
    sigma: Vec<f64>,
}

impl Tiles {
    fn of(image: &Image) -> Self {
        let count = image.size.map(|n| (n / TILE).max(1));
        let size = [0, 1].map(|axis| image.size[axis] as f64 / count[axis] as f64);
        let (mut level, mut sigma) = (Vec::new(), Vec::new());
        let mut values = Vec::new();
        let edge = |axis: usize, i: usize| (i as f64 * size[axis]).round() as usize;
        for row in 0..count[1] {
            for column in 0..count[0] {
                values.clear();
                for y in edge(1, row)..edge(1, row + 1).min(image.size[1]) {
                    let from = y * image.size[0];
                    let line = &image.values
                        [from + edge(0, column)..from + edge(0, column + 1).min(image.size[0])];
                    values.extend(line.iter().copied().filter(|v| v.is_finite()));
                }
                let found = clipped_median(&mut values, &CLIPPING);
                level.push(found.map_or(f64::NAN, |b| b.level_adu));
                sigma.push(found.map_or(f64::NAN, |b| b.pixel_sigma_adu));
            }
        }
        // Whole counts scatter by 1/√12 at least.
        let least = 12f64.sqrt().recip();
        Self {
            count,
            size,
            level: around(&level, count, 0.0),
            sigma: around(&sigma, count, least).iter().map(|s| s.max(least)).collect(),
        }
    }

    /// Level between the tiles' middles, and the scatter of the tile.
    fn at(&self, x: usize, y: usize) -> (f64, f64) {
        let [columns, rows] = self.count;
        let axis = |at: usize, axis: usize| {
            let place = ((at as f64 + 0.5) / self.size[axis] - 0.5)
                .clamp(0.0, (self.count[axis] - 1) as f64);
            (place as usize, (place as usize + 1).min(self.count[axis] - 1), place.fract())
        };
        let (x0, x1, u) = axis(x, 0);
        let (y0, y1, v) = axis(y, 1);
        let level = |column: usize, row: usize| self.level[row * columns + column];
        let upper = level(x0, y0) * (1.0 - u) + level(x1, y0) * u;
        let lower = level(x0, y1) * (1.0 - u) + level(x1, y1) * u;
        let nearest =
            |at: usize, axis: usize, n: usize| ((at as f64 / self.size[axis]) as usize).min(n - 1);
        let sigma = self.sigma[nearest(y, 1, rows) * columns + nearest(x, 0, columns)];
        (upper * (1.0 - v) + lower * v, sigma)
    }
}

/// The median of each tile and its neighbours; `otherwise` where there is none.
fn around(values: &[f64], [columns, rows]: [usize; 2], otherwise: f64) -> Vec<f64> {
    let mut out = Vec::with_capacity(values.len());
    for row in 0..rows {
        for column in 0..columns {
            let mut near: Vec<f64> = (row.saturating_sub(1)..(row + 2).min(rows))
                .flat_map(|r| {
                    (column.saturating_sub(1)..(column + 2).min(columns))
                        .map(move |c| r * columns + c)
                })
                .map(|i| values[i])
                .filter(|v| v.is_finite())
                .collect();
            near.sort_by(f64::total_cmp);
            let n = near.len();
            out.push(if n == 0 { otherwise } else { 0.5 * (near[(n - 1) / 2] + near[n / 2]) });
        }
    }
    out
}

/// Convolution with a normal profile of sum of squares 1 in both directions; what is beyond the edge counts nothing.
fn smooth(image: &[f64], [width, height]: [usize; 2], sigma_px: f64) -> Vec<f64> {
    let reach = (4.0 * sigma_px).ceil() as usize;
    let profile: Vec<f64> =
        (0..=reach).map(|i| (-0.5 * (i as f64 / sigma_px).powi(2)).exp()).collect();
    let norm = (2.0 * profile.iter().skip(1).map(|p| p * p).sum::<f64>() + 1.0).sqrt();
    let profile: Vec<f64> = profile.iter().map(|p| p / norm).collect();
    let mut rows = vec![0.0; image.len()];
    for (line, out) in image.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
        for (x, out) in out.iter_mut().enumerate() {
            let from = x.saturating_sub(reach);
            let part = &line[from..(x + reach + 1).min(width)];
            *out = part.iter().enumerate().map(|(i, v)| v * profile[(from + i).abs_diff(x)]).sum();
        }
    }
    let mut out = vec![0.0; image.len()];
    for y in 0..height {
        for other in y.saturating_sub(reach)..(y + reach + 1).min(height) {
            let weight = profile[other.abs_diff(y)];
            let (to, from) = (&mut out[y * width..][..width], &rows[other * width..][..width]);
            for (to, from) in to.iter_mut().zip(from) {
                *to += weight * from;
            }
        }
    }
    out
}
