//! The pixels around a target, as numbers: calibrated, with those to leave out marked.

use super::calibrate::Laid;
use super::measurement::Colour;
use sunglint_formats::frame::{Bayer, Frame};

/// A part of a frame. A value is NaN where the pixel is masked, and infinite where it is saturated.
#[derive(Debug, Default)]
pub(crate) struct Window {
    /// Column and row of its first pixel in the frame.
    pub origin: [usize; 2],
    /// Columns and rows.
    pub size: [usize; 2],
    /// Row by row.
    pub values: Vec<f32>,
}

/// How a frame's pixels become values.
#[derive(Clone, Copy)]
pub(crate) struct Reading<'a> {
    pub frame: &'a Frame,
    pub laid: Laid<'a>,
    pub saturation_adu: f64,
}

impl Window {
    /// Takes the pixels whose middles lie within `half` of `centre`, as far as the frame has them.
    pub(crate) fn take(&mut self, reading: &Reading<'_>, centre: [f64; 2], half: [f64; 2]) {
        let pixels = &reading.frame.pixels;
        let size = [pixels.ncols(), pixels.nrows()];
        let mut end = [0; 2];
        for axis in 0..2 {
            // The casts saturate: places off the frame give an empty window.
            let from = (centre[axis] - half[axis]).ceil().max(0.0) as usize;
            let to = (centre[axis] + half[axis]).floor().max(-1.0) + 1.0;
            end[axis] = (to as usize).min(size[axis]);
            self.origin[axis] = from.min(end[axis]);
            self.size[axis] = end[axis] - self.origin[axis];
        }
        self.values.clear();
        // Counts are whole: the first saturated one.
        let saturated = reading.saturation_adu.ceil().clamp(0.0, 65_536.0) as u32;
        for row in self.origin[1]..end[1] {
            let line = pixels.row(row);
            let line = line.slice(ndarray::s![self.origin[0]..end[0]]);
            let first = self.values.len();
            let read =
                |&p: &u16| if u32::from(p) >= saturated { f32::INFINITY } else { f32::from(p) };
            match line.as_slice() {
                Some(line) => self.values.extend(line.iter().map(read)),
                None => self.values.extend(line.iter().map(read)),
            }
            reading.laid.over_row(self.origin[0], row, &mut self.values[first..]);
        }
    }

    /// The window's rows with their number in the frame.
    pub fn rows(&self) -> impl Iterator<Item = (usize, &[f32])> {
        let origin = self.origin[1];
        self.values
            .chunks_exact(self.size[0].max(1))
            .enumerate()
            .map(move |(i, row)| (origin + i, row))
    }
}

/// One colour's pixels of a frame: where they begin in a row, and how far apart they are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Plane {
    pub colour: Colour,
    /// For even and odd rows: the parity of the columns; `None` for a row without any.
    parity: [Option<usize>; 2],
    mono: bool,
}

impl Plane {
    /// The planes of a mosaic, or the one of a monochrome frame.
    pub fn of(bayer: Option<Bayer>) -> impl Iterator<Item = Self> {
        let colours: &[Colour] = match bayer {
            None => &[Colour::Mono],
            Some(_) => &[Colour::Red, Colour::Green, Colour::Blue],
        };
        colours.iter().map(move |&colour| Self::new(bayer, colour))
    }

    fn new(bayer: Option<Bayer>, colour: Colour) -> Self {
        let Some(bayer) = bayer else { return Self { colour, parity: [None; 2], mono: true } };
        let letter = match colour {
            Colour::Blue => b'B',
            Colour::Red => b'R',
            _ => b'G',
        };
        let name = bayer.name().as_bytes();
        let parity = [0, 2].map(|row| (0..2).find(|column| name[row + column] == letter));
        Self { colour, parity, mono: false }
    }

    /// First column at or after `column` that this plane has in a row, and the step from one to the next.
    pub fn columns(&self, row: usize, column: usize) -> Option<(usize, usize)> {
        if self.mono {
            return Some((column, 1));
        }
        let parity = self.parity[row % 2]?;
        Some((column + (column + parity) % 2, 2))
    }

    /// Returns the factor by which a sum over this plane stands for all pixels: 1, 4 for red and blue, 2 for green.
    pub fn factor(&self) -> f64 {
        match self.colour {
            Colour::Mono => 1.0,
            Colour::Green => 2.0,
            Colour::Red | Colour::Blue => 4.0,
        }
    }
}
