//! Trinamic (Analog Devices) motor controllers: TMCL over a serial line.
//!
//! - [`tmcl`]: the frames of nine bytes, as checked views and parsed values; commands, parameters, states;
//! - [`Link`]: request and answer, with one repetition where the line spoilt one;
//! - [`Stage`]: a [`RotationStage`](crate::device::RotationStage) on it.
//!
//! # Tried with
//! Nothing real yet: frames and parameters agree with Trinamic's own pytrinamic 0.2.26, the driver with a device built
//! on its codec, and with [our simulated module](crate::simulated::tmcl). Modules of the TMCM-1110 kind (one axis, limit
//! switches, reference search in the firmware) are what it is written for.

mod link;
mod motion;
mod stage;
pub mod tmcl;

pub use link::{Link, LinkSettings};
pub use stage::{Approach, Search, Stage, StageSettings};

/// The device, in messages.
pub(crate) const DEVICE: &str = "Trinamic stage";
