//! INDI: cameras, rotators, filter wheels, focusers and mounts behind a server (`indiserver`, or any that speaks INDI 1.7).
//!
//! - [`xml`], [`base64`]: a stream's elements and BLOBs, as they arrive;
//! - [`property`]: what a server defines and changes; [`Client`]: asking, setting, waiting;
//! - [`Camera`], [`Rotator`], [`Wheel`], [`Focuser`], [`Mount`]: the devices, each on a connection of its own.
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
//!
//! # A frame, on a desk without a camera
//!
//! ```
//! use std::{sync::Arc, time::Duration};
//! use sunglint_drivers::clock::{Deadline, VirtualClock};
//! use sunglint_drivers::device::{Camera as _, Window};
//! use sunglint_drivers::indi::{CameraSettings, open_camera};
//! use sunglint_drivers::simulated::indi::{Ramp, Server, ServerSettings, Simulated};
//!
//! let clock = Arc::new(VirtualClock::new());
//! let within = |seconds| Deadline::after(clock.clone(), Duration::from_secs(seconds));
//! // With a real server: `Tcp::connect("localhost:7624", &deadline)?`, and deadlines on `Deadline::within`.
//! let line = Simulated::new(Server::new(ServerSettings::default(), Ramp));
//! let mut camera = open_camera(line, "Simulated Camera", CameraSettings::default(), &within(10))?;
//! camera.set_window(Window { origin_px: [10, 20], size_px: [64, 48], binning: [1, 1] }, &within(5))?;
//! let frame = camera.expose(0.5, &within(5))?;
//! assert_eq!((frame.pixels.dim(), frame.exposure_s), ((48, 64), 0.5));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod base64;
mod camera;
mod client;
mod focuser;
mod image;
mod mount;
pub mod property;
mod rotator;
mod session;
mod stream;
mod wheel;
pub mod xml;

pub use crate::device::FrameType;
pub use camera::{Camera, CameraSettings};
pub use client::{Blobs, Client, Wanted};
pub use focuser::Focuser;
pub use mount::{Mount, MountSettings};
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
/// The errors of [`open_camera`].
pub fn open_rotator<T: Bytes>(
    line: T,
    device: &str,
    settings: RotatorSettings,
    deadline: &Deadline,
) -> Result<Rotator<T>, DeviceError> {
    Rotator::open(line, device, settings, deadline)
}

/// Opens the telescope mount of that name.
///
/// # Errors
/// The errors of [`open_camera`].
pub fn open_mount<T: Bytes>(
    line: T,
    device: &str,
    settings: MountSettings,
    deadline: &Deadline,
) -> Result<Mount<T>, DeviceError> {
    Mount::open(line, device, settings, deadline)
}

/// Opens the filter wheel of that name.
///
/// # Errors
/// The errors of [`open_camera`].
pub fn open_wheel<T: Bytes>(
    line: T,
    device: &str,
    settings: SessionSettings,
    deadline: &Deadline,
) -> Result<Wheel<T>, DeviceError> {
    Wheel::open(line, device, settings, deadline)
}
