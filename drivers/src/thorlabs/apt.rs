//! Thorlabs rotation stages: the APT protocol over a serial line (K10CR1 and K10CR2; PRM1Z8 on a KDC101 or TDC001; HDR50 and
//! NR360 on a BSC201 or KST101; DDR05, DDR25 and DDR100 on a KBD101 or BBD controller; others by their counts of a degree).
//!
//! - [`message`]: the messages, made, parsed strictly, found again on a line that lost bytes;
//! - [`Link`]: request and answer, among messages that nobody asked for;
//! - [`Stage`]: a [`RotationStage`](crate::device::RotationStage) on it.
//!
//! The stage shows up as an FTDI serial port (0403:faf0) at 115,200 baud. Thorlabs asks for hardware flow control (RTS/CTS)
//! and for RTS lifted before the buffers are emptied: [`Serial::open_with`](crate::transport::serial::Serial::open_with) does that, and goes on where there are no
//! modem lines (ptys).
//!
//! # No checksums
//! APT messages have none, so that nothing rests on one of them: a position counts when two readings in a row agree, a move is
//! done when the stage says twice that it stands where it was sent, and a reference search when it was seen to run and to end.
//!
//! # Sources
//! Thorlabs, "APT Controllers Host-Controller Communications Protocol" (issues 20 to 39) as thorlabs-apt-protocol 29.0.0 has it;
//! counts per degree as in pylablib 1.4.3 and, for the K10CR1, in QMI's driver.
//!
//! # Tried with
//! Nothing real yet: messages agree with thorlabs-apt-protocol 29.0.0 both ways, the driver with a device built on that
//! codec, and with [our simulated stage](crate::simulated::apt).

mod link;
pub mod message;
mod motion;
mod stage;

pub use link::{Link, LinkSettings};
pub use stage::{Model, Stage, StageSettings};

/// The device, in messages.
pub(crate) const DEVICE: &str = "Thorlabs stage";
