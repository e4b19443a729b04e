//! Monochromators CM110 and CM112 of Spectral Products (Digikröm), on a serial line.
//!
//! - [`frame`]: commands and answers as bytes, read strictly;
//! - [`Link`]: command and answer, brought into step by the echo where the line spoilt one;
//! - [`Mono`]: a [`Monochromator`](crate::device::Monochromator) on it.
//!
//! # The protocol
//! 9600 baud, 8 data bits, no parity, 1 stop bit; bytes, not text. A command is its number with its arguments, high byte first:
//! 16 goes to a wavelength, 56 asks, 50 sets the unit, 26 selects a grating, 27 is answered with 27. Other answers are a status and 24 (a value
//! comes before them). The 24 comes when the work is *done*: during a slew the instrument is silent. It cannot be stopped.
//!
//! Nothing marks where a command or an answer begins, and there is no checksum. So a wavelength is read until two readings
//! agree, and after each move. Not even that shows one fault: a byte on the way to the instrument that turns "go to" (16) into
//! "this is" (18, which calibrates) leaves a wrong scale. Keep the cable short, and check a line of a lamp now and then.
//!
//! # Sources
//! Numbers of commands, of questions and of units and the bits of the status are those of three public drivers, each written with an instrument at hand
//! (CM110 in Python by two authors, CM112 in `mqlab`); bits 6 and 5 of the status, and that a slow slew answers late, only of one.
//!
//! # Tried with
//! Nothing real, and no program that we did not write: none was found that plays or drives one on a line. [Our simulated
//! instrument](crate::simulated::cm110) is of the same sources.

pub mod frame;
mod link;
mod mono;

pub use link::{Link, LinkSettings};
pub use mono::{Mono, MonoSettings};

/// The device, in messages.
pub(crate) const DEVICE: &str = "CM110 monochromator";
