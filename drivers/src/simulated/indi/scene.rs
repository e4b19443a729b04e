//! Scenes that a simulated camera sees.

use crate::device::Window;
use hifitime::Epoch;
use ndarray::Array2;
use sunglint_formats::Bayer;

/// An exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shot {
    /// The part of the sensor that is read.
    pub window: Window,
    /// How long, s.
    pub exposure_s: f64,
    /// When it began.
    pub start: Epoch,
    /// The camera's gain, in its own steps.
    pub gain: f64,
}

impl Shot {
    /// Columns and rows of the frame.
    pub fn size(&self) -> [u32; 2] {
        let Window { size_px, binning, .. } = self.window;
        [size_px[0] / binning[0], size_px[1] / binning[1]]
    }

    /// A frame made pixel by pixel: `adu` gets the column and row of each pixel's first sensor pixel.
    pub fn each_pixel(&self, adu: impl Fn(u32, u32) -> u16) -> Array2<u16> {
        let [columns, rows] = self.size();
        let Window { origin_px, binning, .. } = self.window;
        Array2::from_shape_fn((rows as usize, columns as usize), |(row, column)| {
            let on_sensor = |i: usize, axis: usize| origin_px[axis] + i as u32 * binning[axis];
            adu(on_sensor(column, 0), on_sensor(row, 1))
        })
    }
}

/// Where a simulated camera's frames come from.
pub trait Scene: Send {
    /// The frame of an exposure, ADU, `[row, column]`, of [`Shot::size`].
    fn frame(&mut self, shot: &Shot) -> Array2<u16>;
}

impl<F: FnMut(&Shot) -> Array2<u16> + Send> Scene for F {
    fn frame(&mut self, shot: &Shot) -> Array2<u16> {
        self(shot)
    }
}

/// A pattern that tells every pixel of the sensor from its neighbours, brighter for a longer exposure: to see whether a
/// frame is the right part of the right exposure.
#[derive(Debug, Clone, Copy, Default)]
pub struct Ramp;

impl Ramp {
    /// The value of a sensor pixel, ADU.
    pub fn adu(column: u32, row: u32, exposure_s: f64) -> u16 {
        let milliseconds = (exposure_s * 1000.0).round() as u32;
        let mixed = column.wrapping_mul(31) ^ row.wrapping_mul(257) ^ milliseconds.wrapping_mul(7);
        // The lowest 16 bits are meant.
        (mixed & 0xffff) as u16
    }
}

impl Scene for Ramp {
    fn frame(&mut self, shot: &Shot) -> Array2<u16> {
        shot.each_pixel(|column, row| Self::adu(column, row, shot.exposure_s))
    }
}

/// Light of one colour on a sensor with a mosaic: the pixels of that colour see it, the others nothing. Made up, to check
/// which pixel of a frame has which colour.
#[derive(Debug, Clone, Copy)]
pub struct OneColour {
    /// The colours of the sensor's first 2 × 2 pixels.
    pub pattern: Bayer,
    /// `R`, `G` or `B`.
    pub colour: char,
    /// Value that the pixels of this colour see, ADU.
    pub adu: u16,
}

impl Scene for OneColour {
    fn frame(&mut self, shot: &Shot) -> Array2<u16> {
        shot.each_pixel(|column, row| {
            let place = (row % 2 * 2 + column % 2) as usize;
            let here = self.pattern.name().chars().nth(place);
            if here == Some(self.colour) { self.adu } else { 0 }
        })
    }
}
