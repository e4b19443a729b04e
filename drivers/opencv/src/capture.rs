//! A source of pictures, whatever it is.

use crate::error::DEVICE;
use crate::picture::Picture;
use sunglint_drivers::device::DeviceError;
use sunglint_formats::Bayer;

/// Description that a source gives of itself.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct About {
    /// The device or the file.
    pub name: String,
    /// OpenCV's backend, or what stands in for it.
    pub backend: String,
    /// Columns and rows of a picture, px.
    pub size_px: [u32; 2],
    /// The four characters of the codec or pixel format, where there are some.
    pub codec: Option<String>,
    /// How many pictures the source says that it has.
    pub pictures: Option<u64>,
    /// The pattern at the first pixel, where the pixel format says it.
    pub bayer: Option<Bayer>,
    /// Why the pixels are not those that the sensor delivered; `None` where they are.
    pub lossy: Option<String>,
    /// From the start of a picture to the start of the next, s, as the source says it: a nominal number.
    pub interval_s: Option<f64>,
}

/// Settings that a live source changes by itself, where its driver says whether it does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Automation {
    /// The exposure.
    pub exposure: Option<bool>,
    /// The gain.
    pub gain: Option<bool>,
}

/// A source of pictures. It lives on a thread of its own and may block; the [`Grabber`](crate::Grabber) waits for it no longer
/// than its caller's deadline.
pub trait Capture {
    /// Returns the description of the source.
    fn about(&self) -> About;

    /// The next picture; `None` where there is none left.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn next(&mut self) -> Result<Option<Picture>, DeviceError>;

    /// Sets the exposure, s, and gives the exposure that the source then says.
    ///
    /// # Errors
    /// A source that has no exposure to set, or does not take this one.
    fn set_exposure_s(&mut self, exposure_s: f64) -> Result<f64, DeviceError> {
        let _ = exposure_s;
        let reason = "it has no exposure that can be set";
        Err(DeviceError::NotReady { device: DEVICE, reason })
    }

    /// Sets the gain in the source's own steps, and gives the gain that it then says.
    ///
    /// # Errors
    /// A source that has no gain to set, or does not take this one.
    fn set_gain(&mut self, gain: f64) -> Result<f64, DeviceError> {
        let _ = gain;
        Err(DeviceError::NotReady { device: DEVICE, reason: "it has no gain that can be set" })
    }

    /// Exposure, s, and gain as the source says them now, where it does.
    fn exposure_and_gain(&self) -> [Option<f64>; 2] {
        [None, None]
    }

    /// Returns which of its settings the source changes by itself, where it says so.
    fn automation(&self) -> Automation {
        Automation::default()
    }
}

/// Opens a source, on the thread on which it will live.
pub type Open = Box<dyn FnOnce() -> Result<Box<dyn Capture>, DeviceError> + Send>;

/// The interval of a rate, if it is one.
pub(crate) fn interval_s(rate_hz: f64) -> Option<f64> {
    (rate_hz.is_finite() && rate_hz > 0.0).then(|| 1.0 / rate_hz)
}

/// The four characters in a property.
pub(crate) fn four_characters(property: f64) -> String {
    let bytes = (property as i64 as u32).to_le_bytes();
    bytes.iter().map(|&byte| char::from(byte)).collect()
}

/// Four characters for an error or a table: without those that cannot be printed.
pub(crate) fn printable(four: &str) -> String {
    four.chars().map(|c| if c.is_ascii_graphic() || c == ' ' { c } else { '.' }).collect()
}
