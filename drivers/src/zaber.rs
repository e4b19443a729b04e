//! Zaber rotation stages on the ASCII protocol, version 3 of messages (firmware 6.06 and later), by serial line or TCP.
//!
//! - [`message`]: commands and replies, checksums, flags;
//! - [`Zaber`]: an [`Axis`](crate::turning::Axis) on it; [`Stage`] is the rotation stage.
//!
//! Every command carries a checksum, so that a device drops one that the line spoilt, and a number, by which its reply is told from
//! an older one. A reply's checksum is checked where it has one; once one had it, all must. What else comes counts only if two readings in a row agree.
//! Lines of alerts (`!`) and information (`#`) come unasked and are passed over.
//!
//! A device counts microsteps, and the maker's table of their angles is on the internet: the user gives them (`counts_per_deg`).
//!
//! # Sources
//! Zaber, "ASCII Protocol Manual"; the bytes that zaber-motion 10.3.0 sends.
//!
//! # Tried with
//! Nothing real yet: [our simulated device](crate::simulated::zaber), which zaber-motion 10.3.0 drives too.

mod axis;
pub mod message;

pub use axis::{LinkSettings, Zaber, open};

/// A rotation stage on a Zaber device.
pub type Stage<T> = crate::turning::Turning<Zaber<T>>;

/// The device, in messages.
pub(crate) const DEVICE: &str = "Zaber device";
