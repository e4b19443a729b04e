//! Frames out of BLOBs.

use super::property::Blob;
use crate::device::{HostTime, Window};
use hifitime::Epoch;
use ndarray::Array2;
use sunglint_formats::fits::{Fits, Header, inflate};
use sunglint_formats::{Bayer, Frame};

/// Information that the host has about a frame besides its BLOB.
#[derive(Debug, Clone, Copy)]
pub(super) struct Taken {
    pub window: Window,
    /// The sensor's pattern at its first pixel, where the driver says it as a property.
    pub pattern: Option<Bayer>,
    /// The host's time when it asked for the frame.
    pub asked: Epoch,
}

/// A frame of an exposure.
#[derive(Debug)]
pub(super) struct Exposed {
    pub frame: Frame,
    /// How much later it began than the host asked, by the server's clock, s.
    pub later_s: f64,
}

/// Why a BLOB is not the frame that was asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Unfit {
    /// It is no frame that can be read.
    Unreadable(String),
    /// It is a frame with other settings.
    NotOurs(String),
}

impl From<String> for Unfit {
    fn from(reason: String) -> Self {
        Self::Unreadable(reason)
    }
}

impl Taken {
    /// Columns and rows of the frame.
    fn size(&self) -> [u32; 2] {
        let Window { size_px, binning, .. } = self.window;
        [size_px[0] / binning[0].max(1), size_px[1] / binning[1].max(1)]
    }
}

/// The frame of an exposure.
///
/// The server's `EXPTIME` is kept, and its `DATE-OBS` where it is near the host's time; else the frame has the host's, which lies between the request and
/// `answered` ([`HostTime`]). `HOSTDATE` and `HOSTDIFF` are added: when the host asked for the frame, and how much later it began by the server's clock.
/// INDI writes the sensor's Bayer pattern whatever the origin; the frame's own is derived from the origin here.
pub(super) fn from_blob(
    blob: Blob,
    most: usize,
    taken: &Taken,
    answered: Epoch,
) -> Result<Exposed, Unfit> {
    let bytes = unpacked(blob, most)?;
    let fits = Fits::from_bytes("the camera's BLOB", bytes).map_err(|error| error.to_string())?;
    let mut frame = Frame::from_fits(&fits).map_err(|error| error.to_string())?;
    let expected = taken.size();
    let (rows, columns) = frame.pixels.dim();
    if [columns, rows] != expected.map(|n| n as usize) {
        return Err(Unfit::NotOurs(format!(
            "the frame has {columns} × {rows} pixels, expected {} × {}",
            expected[0], expected[1]
        )));
    }
    if frame.binning != [1, 1] && frame.binning != taken.window.binning {
        return Err(Unfit::NotOurs(format!(
            "the frame says that it is binned {:?}, expected {:?}",
            frame.binning, taken.window.binning
        )));
    }
    let pattern = taken.pattern.or(frame.bayer);
    frame.origin = taken.window.origin_px;
    frame.binning = taken.window.binning;
    frame.bayer = pattern.and_then(|pattern| pattern.of_frame(frame.origin, frame.binning));
    let (said, asked) = (frame.start, taken.asked);
    HostTime { asked, answered }.date(&mut frame, Some(said));
    Ok(Exposed { frame, later_s: (said - asked).to_seconds() })
}

/// The bytes of a FITS file.
fn unpacked(blob: Blob, most: usize) -> Result<Vec<u8>, String> {
    match blob.format.to_ascii_lowercase().as_str() {
        ".fits" | ".fit" | ".fts" => Ok(blob.bytes),
        ".fits.z" => {
            let most = blob.size.map_or(most as u64, |size| size.min(most as u64));
            let bytes = inflate("the camera's BLOB", blob.bytes, most)
                .map_err(|error| error.to_string())?;
            match blob.size {
                Some(size) if size != bytes.len() as u64 => Err(format!(
                    "the BLOB unpacks to {} bytes, the server said {size}",
                    bytes.len()
                )),
                _ => Ok(bytes),
            }
        }
        ".fits.fz" => Err("the frame came tile-compressed (.fits.fz), which is not read: turn the camera's compression off (CCD_COMPRESSION)".into()),
        other => Err(format!(
            "the frame came as `{other}`, expected .fits: set CCD_TRANSFER_FORMAT to FORMAT_FITS"
        )),
    }
}

/// A frame of a stream: raw bytes, a byte a pixel, without a header. It began `exposure_s` before it arrived, or earlier.
pub(super) fn from_stream(
    blob: &Blob,
    taken: &Taken,
    arrived: Epoch,
    exposure_s: f64,
    temperature_c: Option<f64>,
) -> Result<Frame, String> {
    if blob.format != ".stream" {
        return Err(format!(
            "the stream came as `{}`, expected .stream: choose the encoder RAW (CCD_STREAM_ENCODER)",
            blob.format
        ));
    }
    let [columns, rows] = taken.size().map(|n| n as usize);
    let found = blob.bytes.len();
    let pixels = blob.bytes.iter().map(|&byte| u16::from(byte)).collect();
    let pixels = Array2::from_shape_vec((rows, columns), pixels).map_err(|_| {
        format!("a frame of the stream has {found} bytes, expected {columns} × {rows} of 8 bits")
    })?;
    let Window { origin_px, binning, .. } = taken.window;
    let mut header = Header::default();
    HostTime::note(&mut header, taken.asked);
    header.comment(
        "DATE-OBS: when the frame arrived at the host, less the exposure; the stream tells no time",
    );
    Ok(Frame {
        pixels,
        origin: origin_px,
        binning,
        bayer: taken.pattern.and_then(|pattern| pattern.of_frame(origin_px, binning)),
        start: arrived - hifitime::Duration::from_seconds(exposure_s),
        exposure_s,
        gain_e_per_adu: None,
        temperature_c,
        saturation_adu: Some(255.0),
        header,
    })
}
