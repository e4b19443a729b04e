//! The device's name and the errors that all sources share.

use sunglint_drivers::device::DeviceError;

pub(crate) const DEVICE: &str = "frame grabber";

/// Makes an error from words that say what is wrong, where, and what to do.
pub(crate) fn wrong(reason: impl Into<String>) -> DeviceError {
    DeviceError::Protocol { device: DEVICE, reason: reason.into() }
}

/// OpenCV's own words.
pub(crate) fn said(doing: &str, error: &opencv::Error) -> DeviceError {
    wrong(format!("{doing}: OpenCV says `{}` (code {})", error.message.trim(), error.code))
}
