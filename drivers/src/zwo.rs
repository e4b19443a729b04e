//! ZWO's electronic filter wheel (EFW), by HID feature reports.
//!
//! - [`report`]: the reports, made and checked;
//! - [`Wheel`]: a [`FilterWheel`](crate::device::FilterWheel) on them;
//! - [`open`]: the wheel that is plugged in.
//!
//! # Source
//! The protocol is not published. This is what Adam Fritzler found with usbmon on one 7-slot wheel (`zwoefw-set.c`, 2023,
//! MIT). He saw a jump from slot 1 to 7 end in a fault that only cutting the power clears, so the wheel is turned by one
//! slot at a time.
//!
//! # Tried with
//! Nothing real yet: [our simulated wheel](crate::simulated::efw), and recordings of it through hidapi's hidraw under
//! umockdev.

pub mod report;
mod wheel;

pub use wheel::{Wheel, WheelSettings};

use crate::device::DeviceError;
use crate::transport::hid::Hid;

/// ZWO's number.
pub const VENDOR: u16 = 0x03c3;
/// The wheel's number.
pub const PRODUCT: u16 = 0x1f01;

/// The device, in messages.
pub(crate) const DEVICE: &str = "ZWO filter wheel";

/// Opens the first wheel that is plugged in, or the one of this path (`/dev/hidraw0`), for [`Wheel::open`].
///
/// # Errors
/// No wheel, no permission, or the system's own.
pub fn open(path: Option<&str>) -> Result<Hid, DeviceError> {
    let hid = match path {
        Some(path) => Hid::open_path(path),
        None => Hid::open(VENDOR, PRODUCT, None),
    };
    hid.map_err(|error| DeviceError::transport(DEVICE, error))
}
