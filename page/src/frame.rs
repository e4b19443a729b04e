//! Frames on their way to a canvas: a small header as JSON, then the pixels as they are, 16 bits each.
//!
//! The page holds a table of 65,536 colours, so that the stretch and the read-out of pixels cost nothing here. What is larger than the canvas is binned first.

use crate::request::{Answer, Request};
use hifitime::Epoch;
use serde::Serialize;
use sunglint_formats::Frame;
use sunglint_formats::time::format_utc;
use sunglint_radiometry::sky::AzimuthAltitude;

/// Sides of what is sent at most, px.
const MOST_PX: usize = 2048;

/// Description of the pixels that follow.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrameHeader {
    /// Number of the frame.
    pub number: u64,
    /// Start of the exposure, s after the session's start.
    pub start_s: f64,
    /// The same in UTC, to the millisecond.
    pub utc: String,
    /// Exposure, s.
    pub exposure_s: f64,
    /// Columns and rows of the whole frame.
    pub size_px: [usize; 2],
    /// First column and row, columns and rows of the part that is sent.
    pub part_px: [usize; 4],
    /// Columns and rows of the frame in each pixel that is sent, which holds their mean.
    pub bin: usize,
    /// Columns and rows that are sent.
    pub shape: [usize; 2],
    /// Column and row of the sensor of the frame's first pixel, unbinned.
    pub origin_px: [u32; 2],
    /// Sensor pixels in one of the frame.
    pub binning: [u32; 2],
    /// ADU from which a pixel is saturated.
    pub saturation_adu: Option<f64>,
    /// Temperature of the sensor, °C.
    pub temperature_c: Option<f64>,
    /// Target, as the header names it.
    pub target: Option<String>,
    /// Filter, as the header names it.
    pub filter: Option<String>,
    /// Azimuth and altitude at which the header says that the target stood, deg.
    pub azimuth_altitude_deg: Option<AzimuthAltitude>,
}

/// Part of a frame that is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// First column and row, columns and rows.
    pub window_px: [usize; 4],
    /// Columns or rows that are sent at most.
    pub most_px: usize,
}

impl Part {
    /// The part that a request names: `x`, `y`, `w`, `h` and `most`; the whole frame without them.
    pub fn of(request: &Request, size_px: [usize; 2]) -> Self {
        let whole = |key: &str| request.whole(key).and_then(|n| usize::try_from(n).ok());
        let part_px = [
            whole("x").unwrap_or(0),
            whole("y").unwrap_or(0),
            whole("w").unwrap_or(size_px[0]),
            whole("h").unwrap_or(size_px[1]),
        ];
        let most_px = whole("most").unwrap_or(1280).clamp(16, MOST_PX);
        Self::within(Some(part_px), most_px, size_px)
    }

    /// A part of a frame, first column and row, columns and rows, as far as it lies within the frame; the whole frame without one.
    pub fn within(part_px: Option<[usize; 4]>, most_px: usize, size_px: [usize; 2]) -> Self {
        let [x, y, w, h] = part_px.unwrap_or([0, 0, size_px[0], size_px[1]]);
        let (x, y) = (x.min(size_px[0].saturating_sub(1)), y.min(size_px[1].saturating_sub(1)));
        let (w, h) = (w.clamp(1, (size_px[0] - x).max(1)), h.clamp(1, (size_px[1] - y).max(1)));
        Self { window_px: [x, y, w, h], most_px }
    }

    /// Columns and rows of the frame in each pixel that is shown.
    pub fn bin(&self) -> usize {
        let [_, _, w, h] = self.window_px;
        w.max(h).div_ceil(self.most_px).max(1)
    }

    /// Columns and rows that are shown.
    pub fn shape(&self) -> [usize; 2] {
        let [_, _, w, h] = self.window_px;
        [w.div_ceil(self.bin()), h.div_ceil(self.bin())]
    }
}

/// The pixels of a part of a frame, row by row: as they are, or means of blocks.
pub(crate) fn binned(frame: &Frame, part: Part) -> impl Iterator<Item = u16> {
    let ([x, y, w, h], bin, shape) = (part.window_px, part.bin(), part.shape());
    let pixels = frame.pixels.slice(ndarray::s![y..y + h, x..x + w]);
    (0..shape[1]).flat_map(move |j| {
        let rows = bin.min(h - j * bin);
        let mut sums = vec![0_u64; shape[0]];
        for row in pixels.slice(ndarray::s![j * bin..j * bin + rows, ..]).rows() {
            for (column, pixel) in row.iter().enumerate() {
                sums[column / bin] += u64::from(*pixel);
            }
        }
        (0..shape[0]).map(move |i| {
            let columns = bin.min(w - i * bin);
            (sums[i] / (columns * rows) as u64) as u16
        })
    })
}

/// Encodes part of a frame.
pub fn encode(frame: &Frame, number: u64, start: Epoch, request: &Request) -> Answer {
    let (rows, columns) = frame.pixels.dim();
    if rows == 0 || columns == 0 {
        return Answer::error(404, "this frame has no pixels");
    }
    let part = Part::of(request, [columns, rows]);
    let (bin, shape) = (part.bin(), part.shape());
    let text = |key: &str| frame.header.text(key).map(|text| text.trim().to_owned());
    let place = frame.header.real("CENTAZ").zip(frame.header.real("CENTALT"));
    let header = FrameHeader {
        number,
        start_s: (frame.start - start).to_seconds(),
        utc: format_utc(frame.start, 3),
        exposure_s: frame.exposure_s,
        size_px: [columns, rows],
        part_px: part.window_px,
        bin,
        shape,
        origin_px: frame.origin,
        binning: frame.binning,
        saturation_adu: frame.saturation_adu,
        temperature_c: frame.temperature_c,
        target: text("OBJECT"),
        filter: text("FILTER"),
        azimuth_altitude_deg: place.map(|(azimuth, altitude)| [azimuth, altitude].into()),
    };
    let Ok(mut json) = serde_json::to_vec(&header) else {
        return Answer::error(500, "the frame's header cannot be written as JSON");
    };
    while !json.len().is_multiple_of(4) {
        json.push(b' ');
    }
    let mut body = Vec::with_capacity(4 + json.len() + 2 * shape[0] * shape[1]);
    body.extend((json.len() as u32).to_le_bytes());
    body.extend(&json);
    if bin == 1 {
        // As they are: ten times a second for each page, so without the sums.
        let [x, y, w, h] = part.window_px;
        for row in frame.pixels.slice(ndarray::s![y..y + h, x..x + w]).rows() {
            row.iter().for_each(|pixel| body.extend_from_slice(&pixel.to_le_bytes()));
        }
    } else {
        binned(frame, part).for_each(|pixel| body.extend_from_slice(&pixel.to_le_bytes()));
    }
    Answer::bytes(body)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;
    use sunglint_formats::time::parse_utc;

    fn sent(columns: usize, rows: usize, query: &str) -> (serde_json::Value, Vec<u16>) {
        let start = parse_utc("2026-11-21T18:00:00Z").unwrap();
        let frame = Frame {
            pixels: Array2::from_shape_fn((rows, columns), |(y, x)| (100 * y + x) as u16),
            origin: [0, 0],
            binning: [1, 1],
            bayer: None,
            start: start + hifitime::Duration::from_seconds(2.5),
            exposure_s: 0.5,
            gain_e_per_adu: None,
            temperature_c: None,
            saturation_adu: None,
            header: sunglint_formats::fits::Header::default(),
        };
        let request = Request::new(false, "frame/cam/0", query, vec![]).unwrap();
        let body = encode(&frame, 7, start, &request).body;
        let length = u32::from_le_bytes(body[..4].try_into().unwrap()) as usize;
        let header = serde_json::from_slice(&body[4..4 + length]).unwrap();
        assert!((4 + length).is_multiple_of(2));
        let pixels = body[4 + length..].as_chunks::<2>().0;
        (header, pixels.iter().map(|bytes| u16::from_le_bytes(*bytes)).collect())
    }

    /// Truth: by hand: a 3 × 2 frame whole, a part of it, and means of blocks of a frame that they do not divide.
    #[test]
    fn pixels_arrive_as_they_are() {
        let (header, pixels) = sent(3, 2, "");
        assert_eq!(pixels, [0, 1, 2, 100, 101, 102]);
        assert_eq!((&header["number"], &header["start_s"]), (&7.into(), &2.5.into()));
        assert_eq!(sent(3, 2, "x=1&y=1&w=9&h=9").1, [101, 102]);
        // 17 columns in blocks of 2: the last has one.
        let (header, pixels) = sent(17, 2, "most=16");
        assert_eq!((&header["bin"], &header["shape"][0]), (&2.into(), &9.into()));
        assert_eq!(pixels, [50, 52, 54, 56, 58, 60, 62, 64, 66]);
        // Nonsense asks for the whole.
        assert_eq!(sent(3, 2, "x=-1&w=abc&most=1e9").1.len(), 6);
    }
}
