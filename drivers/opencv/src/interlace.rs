//! The two fields of an interlaced frame.

use crate::error::wrong;
use hifitime::Duration;
use ndarray::s;
use sunglint_drivers::device::DeviceError;
use sunglint_formats::Frame;

/// A field: every second row of an interlaced frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Field {
    /// Rows 0, 2, 4 …
    Top,
    /// Rows 1, 3, 5 …
    Bottom,
}

impl Field {
    fn other(self) -> Self {
        match self {
            Self::Top => Self::Bottom,
            Self::Bottom => Self::Top,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Top => "top",
            Self::Bottom => "bottom",
        }
    }
}

/// How frames are split.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Interlace {
    /// The field that was exposed first.
    pub first: Field,
    /// From the start of a frame to the start of the next, s.
    pub interval_s: f64,
}

impl Interlace {
    /// Length of a field's exposure where the frame's is said to be this, s.
    pub fn exposure_s(self, frame_s: f64) -> f64 {
        frame_s.min(0.5 * self.interval_s)
    }

    /// The fields in the order of time. The rows of a field stand two sensor rows apart, as those of a frame with that binning do.
    ///
    /// # Errors
    /// An odd number of rows; a first row whose place on the sensor is odd; a mosaic, whose fields lack colours.
    pub fn split(self, frame: &Frame) -> Result<[Frame; 2], DeviceError> {
        let (rows, binning) = (frame.pixels.nrows(), [frame.binning[0], 2 * frame.binning[1]]);
        let cannot = if frame.bayer.is_some() {
            Some("a mosaic's field has half of its colours alone".to_owned())
        } else if !rows.is_multiple_of(2) {
            Some(format!("it has {rows} rows, expected an even number"))
        } else if !frame.origin[1].is_multiple_of(binning[1]) {
            let row = frame.origin[1];
            Some(format!(
                "it begins at the sensor's row {row}, expected a multiple of {}",
                binning[1]
            ))
        } else {
            None
        };
        if let Some(why) = cannot {
            return Err(wrong(format!("the frame cannot be split into fields: {why}")));
        }
        let exposure_s = self.exposure_s(frame.exposure_s);
        let field = |which: Field, number: i64| {
            let begins = match which {
                Field::Top => 0,
                Field::Bottom => 1,
            };
            let mut header = frame.header.clone();
            header.set("FIELD", which.name(), "rows of the frame: top is 0, 2, 4; bottom 1, 3, 5");
            header.set("FIELDNO", number, "1 is the field that was exposed first");
            header.set("ROWPITCH", i64::from(binning[1]), "sensor rows from a row to the next");
            if exposure_s < frame.exposure_s {
                header.comment(&format!(
                    "EXPTIME: half of the frames' interval; the frame's was {} s",
                    frame.exposure_s
                ));
            }
            let later_s = 0.5 * self.interval_s * (number - 1) as f64;
            Frame {
                pixels: frame.pixels.slice(s![begins..;2, ..]).to_owned(),
                binning,
                start: frame.start + Duration::from_seconds(later_s),
                exposure_s,
                header,
                ..frame.clone()
            }
        };
        Ok([field(self.first, 1), field(self.first.other(), 2)])
    }
}
