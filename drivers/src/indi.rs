//! INDI: cameras, rotators and filter wheels behind a server (`indiserver`, or any that speaks INDI 1.7).
//!
//! - [`xml`], [`base64`]: a stream's elements and BLOBs, as they arrive;
//! - [`property`]: what a server defines and changes; [`Client`]: asking, setting, waiting;
//! - [`Camera`], [`Rotator`], [`Wheel`]: the devices, each on a connection of its own.
//!
//! A device is opened by its name on the server (`CCD Simulator`), over any [`Bytes`]: a [`Tcp`](crate::transport::tcp::Tcp)
//! connection to port 7624 as a rule, wrapped in a recorder if so wished.
//!
//! # What the protocol cannot do
//! It has no numbers on requests and no check sums. A driver waits for what only its own request can bring, and reads back
//! what it has set; for whole bytes it relies on TCP. A request for a property that the server does not know gets no
//! answer at all: everything has a deadline.
//!
//! # Tried with
//! The simulators of indi-bin 1.9.9 (Debian 12), live; [our simulated server](crate::simulated::indi). No real camera yet.

pub mod base64;
mod camera;
mod client;
mod image;
pub mod property;
mod rotator;
mod session;
mod stream;
mod wheel;
pub mod xml;

pub use camera::{Camera, CameraSettings, FrameType};
pub use client::{Blobs, Client, Wanted};
pub use rotator::{Rotator, RotatorSettings};
pub use session::{Listed, SessionSettings, devices};
pub use wheel::Wheel;

use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::transport::Bytes;

/// The port of INDI servers.
pub const PORT: u16 = 7624;

/// Opens the camera of that name.
///
/// # Errors
/// See [`DeviceError`]; [`DeviceError::Unknown`] if the server has none of that name ([`devices`] lists them).
pub fn open_camera<T: Bytes>(
    line: T,
    device: &str,
    settings: CameraSettings,
    deadline: &Deadline,
) -> Result<Camera<T>, DeviceError> {
    Camera::open(line, device, settings, deadline)
}

/// Opens the rotator of that name.
///
/// # Errors
/// As [`open_camera`].
pub fn open_rotator<T: Bytes>(
    line: T,
    device: &str,
    settings: RotatorSettings,
    deadline: &Deadline,
) -> Result<Rotator<T>, DeviceError> {
    Rotator::open(line, device, settings, deadline)
}

/// Opens the filter wheel of that name.
///
/// # Errors
/// As [`open_camera`].
pub fn open_wheel<T: Bytes>(
    line: T,
    device: &str,
    settings: SessionSettings,
    deadline: &Deadline,
) -> Result<Wheel<T>, DeviceError> {
    Wheel::open(line, device, settings, deadline)
}
