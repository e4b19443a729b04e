//! A recorded file, through OpenCV's FFmpeg.

use crate::capture::{self, About, Capture, four_characters, printable};
use crate::error::{said, wrong};
use crate::mat;
use crate::picture::Picture;
use opencv::core::Mat;
use opencv::prelude::*;
use opencv::videoio::{self, VideoCapture};
use std::path::{Path, PathBuf};
use sunglint_drivers::device::DeviceError;

/// Codecs and the pixel formats in which OpenCV 4.6 gives back each number of theirs (tried, all 256 of them, in the tests).
/// FFV1 in YUV or with 16 bits is without loss in the file, but OpenCV converts it to 8 bits of blue, green and red.
const LOSSLESS: [(&str, &str); 6] = [
    ("FFV1", "Y800"),
    ("FFV1", "BGRA"),
    ("MPNG", "Y800"),
    ("MPNG", "RGB\u{18}"),
    ("Y800", "Y800"),
    ("GREY", "Y800"),
];

/// A recorded file.
pub struct Recording {
    path: PathBuf,
    file: VideoCapture,
    next: u64,
    about: About,
}

impl Recording {
    /// Opens a file.
    ///
    /// # Errors
    /// No such file; nothing that FFmpeg knows; no picture in it.
    pub fn open(path: &Path) -> Result<Self, DeviceError> {
        let shown = path.display();
        let metadata = path.metadata().map_err(|e| wrong(format!("cannot open {shown}: {e}")))?;
        let doing = format!("opening {shown}");
        let file = VideoCapture::from_file(path, videoio::CAP_FFMPEG)
            .map_err(|error| said(&doing, &error))?;
        if !file.is_opened().map_err(|error| said(&doing, &error))? {
            return Err(wrong(format!(
                "{shown} ({} bytes) is no recording that OpenCV's FFmpeg opens: it is cut off near its start, or something else",
                metadata.len()
            )));
        }
        let property =
            |which| file.get(which).map_err(|error| said(&format!("asking {shown}"), &error));
        let codec = four_characters(property(videoio::CAP_PROP_FOURCC)?);
        let format = four_characters(property(videoio::CAP_PROP_CODEC_PIXEL_FORMAT)?);
        let side = |pixels: f64| if pixels.is_finite() { pixels as u32 } else { 0 };
        let size_px = [
            side(property(videoio::CAP_PROP_FRAME_WIDTH)?),
            side(property(videoio::CAP_PROP_FRAME_HEIGHT)?),
        ];
        // AVI counts its frames; of other files FFmpeg only knows how long they are.
        let count = property(videoio::CAP_PROP_FRAME_COUNT)?;
        let counted = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("avi"));
        let pictures = (counted && (0.0..1e15).contains(&count)).then_some(count as u64);
        if pictures == Some(0) {
            return Err(wrong(format!("{shown} has no picture in it")));
        }
        let exact = LOSSLESS.contains(&(codec.as_str(), format.as_str()));
        let (codec, format) = (printable(&codec), printable(&format));
        let lossy = (!exact).then(|| {
            format!(
                "{codec} in {format} does not come back through OpenCV as it was taken (FFV1 or MPNG in 8-bit grey or BGR does)"
            )
        });
        let backend = file.get_backend_name().map_err(|error| said(&doing, &error))?;
        let (name, codec) = (shown.to_string(), Some(codec));
        let rate_hz = property(videoio::CAP_PROP_FPS)?;
        let interval_s = capture::interval_s(rate_hz);
        let about =
            About { name, backend, size_px, codec, pictures, bayer: None, lossy, interval_s };
        Ok(Self { path: path.to_owned(), file, next: 0, about })
    }
}

impl Capture for Recording {
    fn about(&self) -> About {
        self.about.clone()
    }

    fn next(&mut self) -> Result<Option<Picture>, DeviceError> {
        let doing = format!("picture {} of {}", self.next, self.path.display());
        let failed = |error: opencv::Error| said(&doing, &error);
        if !self.file.grab().map_err(failed)? {
            return Ok(None);
        }
        let mut mat = Mat::default();
        if !self.file.retrieve_def(&mut mat).map_err(failed)? {
            return Err(wrong(format!("{doing} cannot be decoded")));
        }
        let (planes, bits) =
            mat::planes(&mat).map_err(|found| wrong(format!("{doing}: {found}")))?;
        let position = self.file.get(videoio::CAP_PROP_POS_MSEC).map_err(failed)?;
        let position_ms = Some(position).filter(|ms| ms.is_finite());
        let index = self.next;
        self.next += 1;
        Ok(Some(Picture { planes, bits, index, position_ms, arrived: None, readings: [None; 2] }))
    }
}
