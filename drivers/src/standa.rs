//! Standa 8SMC4 and 8SMC5 motor controllers (XIMC), by serial line or TCP.
//!
//! - [`message`]: commands, replies, checksums, the state of a controller;
//! - [`Standa`]: an [`Axis`](crate::turning::Axis) on it; [`Stage`] is the rotation stage.
//!
//! A command is four letters; data follow where it has some, and a checksum over the data. The reply repeats the letters. Neither has a
//! number, and letters alone have no checksum: after anything that was not understood the line is emptied with bytes of zero, which a controller
//! that waits for a command sends back.
//!
//! A stepper's position is full steps and microsteps, of a DC motor that of its encoder. The controller does not know what it turns: the user gives the counts of
//! a degree (`counts_per_deg`), and the division of a step for which they hold. A controller that divides otherwise is refused.
//!
//! `home` finds the reference and leaves the counter as it is; as the maker's own library does (`command_homezero`), the driver sets it to zero then.
//!
//! # Sources
//! The maker's description of the protocol, version 20.3, in its library libximc (BSD licence); the bytes that pylablib 1.4.3 sends.
//!
//! # Tried with
//! Nothing real yet: [our simulated controller](crate::simulated::standa), which the maker's libximc 2.14.30 and pylablib 1.4.3 drive too.

mod axis;
pub mod message;

pub use axis::{LinkSettings, Standa, open};

/// A rotation stage on a Standa controller.
pub type Stage<T> = crate::turning::Turning<Standa<T>>;

/// The controller, in messages.
pub(crate) const DEVICE: &str = "Standa controller";
