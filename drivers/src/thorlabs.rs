//! Thorlabs: rotation stages on the [APT](apt) and [Elliptec](elliptec) protocols; power meters of the PM100 family: SCPI in USBTMC messages.
//!
//! - [`usbtmc`](crate::usbtmc): the messages, and question and answer over them ([`Tmc`]);
//! - [`scpi`]: what the meter answers, parsed strictly;
//! - [`Pm100`]: a [`PowerMeter`](crate::device::PowerMeter) on it;
//! - [`find`], [`open`]: the meters that are plugged in.
//!
//! # Sources
//! USBTMC 1.00 with the USB488 subclass (USB-IF, 2003); the SCPI commands of the makers' manuals of PM100D, PM100USB and
//! PM400, and pymeasure's `thorlabspm100usb.py`; product numbers from Debian's USB database and, where marked in
//! [`PRODUCTS`], from memory.
//!
//! # Tried with
//! Nothing real yet: [our simulated meter](crate::simulated::pm100), which python-usbtmc 0.8 drives in our tests, and
//! recordings of it through the real libusb under umockdev.

pub mod apt;
pub mod elliptec;
mod pm100;
pub mod scpi;
mod usb;

pub use crate::usbtmc::{Endpoints, Tmc, TmcSettings};
pub use pm100::{Pm100, Pm100Settings};
pub use usb::{Found, PRODUCTS, VENDOR, find, open};

/// The device, in messages.
pub(crate) const DEVICE: &str = "Thorlabs power meter";
