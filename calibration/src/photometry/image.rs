//! A frame prepared for the search: one image of all colours above its local background, without what is too sharp, smoothed.

use super::levels::Counter;
use super::regions::neighbours;
use super::smooth::{Profile, Smoother};
use super::tiles::Tiles;
use super::window::{Reading, Window};

/// A window as one image: the values of a monochrome frame, or the means of the 2 × 2 squares of a mosaic (each of which holds all colours);
/// then, above its background, in standard deviations of a pixel.
#[derive(Debug, Default)]
pub(crate) struct Image {
    values: Vec<f32>,
    /// Columns and rows.
    pub size: [usize; 2],
    /// Where its first pixel is in the frame.
    pub(crate) origin: [f64; 2],
    /// Pixels that are masked, and later those that are too sharp.
    left_out: Vec<bool>,
    smoothed: Vec<f32>,
    counter: Counter,
    smoother: Smoother,
}

/// Each value of a row with the one after it.
fn pairs(row: &[f32]) -> impl Iterator<Item = (&f32, &f32)> {
    row.iter().zip(row.get(1..).unwrap_or_default())
}

/// Least scatter of a smoothed image, standard deviations of a pixel. White noise keeps 1, since profiles have a sum of squares of 1. Quantiles of whole numbers tell a pixel's noise to a factor of 1.6,
/// so that less than 0.6 comes only of a sky that is constant, or cut off at 0: what rounding leaves of it is no measure.
const LEAST_NOISE: f32 = 0.6;

impl Image {
    /// Takes a window above its local background. `false` of an empty one.
    pub fn take(&mut self, window: &Window, reading: &Reading<'_>) -> bool {
        let full = reading.saturation_adu as f32;
        let [width, height] = window.size;
        let value = |v: f32| if v == f32::INFINITY { full } else { v };
        self.origin = window.origin.map(|o| o as f64);
        self.values.clear();
        let mut step = if reading.laid.is_empty() { 1.0 } else { 0.0 };
        if reading.frame.bayer.is_none() {
            self.size = window.size;
            self.values.extend(window.values.iter().map(|&v| value(v)));
        } else {
            self.size = [width.saturating_sub(1), height.saturating_sub(1)];
            self.origin = self.origin.map(|o| o + 0.5);
            step *= 0.25;
            for y in 0..self.size[1] {
                let line = |y: usize| &window.values[y * width..][..width];
                let squares = pairs(line(y)).zip(pairs(line(y + 1)));
                let mean = |((a, b), (c, d)): ((&f32, &f32), (&f32, &f32))| {
                    (value(*a) + value(*b) + value(*c) + value(*d)) / 4.0
                };
                self.values.extend(squares.map(mean));
            }
        }
        if self.values.is_empty() {
            return false;
        }
        self.left_out.clear();
        self.left_out.extend(self.values.iter().map(|value| value.is_nan()));
        let tiles = Tiles::of(&self.values, self.size, step, &mut self.counter);
        tiles.take_off(&mut self.values, self.size[0]);
        true
    }

    /// An image of values (row by row) above the background of its tiles, which are of the same values; NaN is masked.
    pub fn above(mut values: Vec<f32>, size: [usize; 2], tiles: &Tiles) -> Self {
        let left_out = values.iter().map(|value| value.is_nan()).collect();
        tiles.take_off(&mut values, size[0]);
        Self { values, size, left_out, ..Self::default() }
    }

    /// Values above the background, in standard deviations of a pixel.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The values and the pixels that are left out: masked ones, and what was too sharp.
    pub fn into_parts(self) -> (Vec<f32>, Vec<bool>) {
        (self.values, self.left_out)
    }

    /// Takes out what is sharper than a point of this width could be: cosmic rays, hot pixels. Gives their pixels.
    ///
    /// A pixel is sharp that is 5 σ above what the fifth highest of its eight neighbours allows: beside a point at least half of them have 35 % of what a
    /// point of `sigma_px` leaves on a diagonal, beside a track one pixel wide five are dark. So are those of its neighbours that are 2.5 σ
    /// above it. They get the median of the others around them. Masked pixels are neither: nothing is known of them.
    pub fn take_out_sharp(&mut self, sigma_px: f64) -> Vec<usize> {
        take_out_sharp(&mut self.values, &mut self.left_out, self.size, sigma_px)
    }

    /// The image smoothed with a normal profile, in standard deviations of the result.
    pub fn significance(&mut self, sigma_px: f64) -> &[f32] {
        let profile = Profile::new(sigma_px);
        let rows = 0..self.size[1];
        self.smoother.smooth(&self.values, self.size, rows, &profile, &mut self.smoothed);
        // Squares of a mosaic share pixels, so the noise of the smoothed frame is measured, not derived.
        match self.smoother.level_of(&self.smoothed, self.size[0]) {
            None => self.smoothed.fill(0.0),
            Some(noise) => {
                let scale = noise.sigma.max(LEAST_NOISE).recip();
                for value in &mut self.smoothed {
                    *value = (*value - noise.level) * scale;
                }
            }
        }
        &self.smoothed
    }

    /// Returns the smoothed image as [`Image::significance`] left it.
    pub fn smoothed(&self) -> &[f32] {
        &self.smoothed
    }

    /// Smooths parts of it with another, narrow profile.
    pub fn narrow(&mut self, sigma_px: f64) -> Narrow {
        let profile = Profile::new(sigma_px);
        let noise = self.smoother.level(&self.values, self.size, &profile);
        let [level, scale] =
            noise.map_or([0.0; 2], |noise| [noise.level, noise.sigma.max(LEAST_NOISE).recip()]);
        Narrow { profile, level, scale }
    }

    /// The highest value within a square around a pixel of the image smoothed by a narrow profile, in standard deviations.
    pub fn highest(&mut self, narrow: &Narrow, [x, y]: [usize; 2], reach: usize) -> f64 {
        let margin = reach + narrow.profile.reach();
        let [width, height] = self.size;
        let columns = x.saturating_sub(margin)..(x + margin + 1).min(width);
        let rows = y.saturating_sub(margin)..(y + margin + 1).min(height);
        let part: Vec<f32> = rows
            .clone()
            .flat_map(|row| &self.values[row * width..][columns.clone()])
            .copied()
            .collect();
        let size = [columns.len(), rows.len()];
        let mut smoothed = Vec::new();
        self.smoother.smooth(&part, size, 0..size[1], &narrow.profile, &mut smoothed);
        // Of the part only what no missing neighbour spoils.
        let inside =
            |at: usize, first: usize| at.saturating_sub(reach) - first..at + reach + 1 - first;
        let (inner_columns, inner_rows) = (inside(x, columns.start), inside(y, rows.start));
        let lines = smoothed.chunks_exact(size[0]).take(inner_rows.end).skip(inner_rows.start);
        let values =
            lines.flat_map(|line| &line[inner_columns.start..inner_columns.end.min(size[0])]);
        let highest = values.copied().fold(f32::NEG_INFINITY, f32::max);
        f64::from((highest - narrow.level) * narrow.scale)
    }
}

/// A narrow profile, and level and scatter of an image that is smoothed with it.
#[derive(Debug)]
pub(crate) struct Narrow {
    profile: Profile,
    level: f32,
    scale: f32,
}

/// Takes out sharp pixels as [`Image::take_out_sharp`] does; `left_out` are the masked pixels, to which the sharp ones are added.
fn take_out_sharp(
    image: &mut [f32],
    left_out: &mut [bool],
    size: [usize; 2],
    sigma_px: f64,
) -> Vec<usize> {
    let least = 0.35 * (-1.0 / (sigma_px * sigma_px)).exp() as f32;
    // What is masked says nothing of its neighbours: it is not dark.
    let excess = |image: &[f32], left_out: &[bool], pixel: usize| {
        let mut near = [0.0; 8];
        let mut n = 0;
        for other in neighbours(pixel, size).filter(|&other| !left_out[other]) {
            near[n] = image[other];
            n += 1;
        }
        near[..n].sort_by(f32::total_cmp);
        // The fourth lowest of eight; of fewer in proportion.
        image[pixel] - near[..n].get(n.saturating_sub(1) / 2).map_or(0.0, |v| v.max(0.0)) / least
    };
    let mut pixels: Vec<usize> =
        above(image, 5.0).filter(|&pixel| excess(image, left_out, pixel) > 5.0).collect();
    for &pixel in &pixels {
        left_out[pixel] = true;
    }
    let mut next = 0;
    while let Some(&pixel) = pixels.get(next) {
        next += 1;
        for other in neighbours(pixel, size) {
            if !left_out[other] && image[other] > 2.5 && excess(image, left_out, other) > 2.5 {
                left_out[other] = true;
                pixels.push(other);
            }
        }
    }
    for &pixel in &pixels {
        let mut near: Vec<f32> = neighbours(pixel, size)
            .filter(|&other| !left_out[other])
            .map(|other| image[other])
            .collect();
        near.sort_by(f32::total_cmp);
        image[pixel] = near.get(near.len() / 2).copied().unwrap_or(0.0);
    }
    pixels
}

/// The pixels above a threshold, in order; a search that passes over the dark in strides.
pub(crate) fn above(image: &[f32], threshold: f32) -> impl Iterator<Item = usize> + '_ {
    const STRIDE: usize = 64;
    image
        .chunks(STRIDE)
        .enumerate()
        .filter(move |(_, chunk)| chunk.iter().fold(false, |any, &v| any | (v > threshold)))
        .flat_map(move |(at, chunk)| {
            let hits = chunk.iter().enumerate().filter(move |(_, v)| **v > threshold);
            hits.map(move |(i, _)| at * STRIDE + i)
        })
}
