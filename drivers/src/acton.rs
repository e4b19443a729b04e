//! Monochromators of Princeton Instruments (Acton): SP2150 and its kin, on a serial line.
//!
//! - [`reply`]: what the instrument answers, parsed strictly;
//! - [`Link`]: command and answer, brought into step by the model's name where the line spoilt one;
//! - [`Mono`]: a [`Monochromator`](crate::device::Monochromator) on it.
//!
//! # The protocol
//! 9600 baud, 8 data bits, no parity, 1 stop bit. Words with their parameters before them and a carriage return behind
//! (`546.7 GOTO`, `?NM`). On RS-232 the instrument echoes what it hears, on its own USB it does not. Then come the answer's
//! words, and ` ok` with CR LF once the work is *done*: after `GOTO` at the end of the slew, after `GRATING` some 20 s later. What it does not
//! understand ends with `?`. There is no checksum: a wavelength is read until two readings agree.
//!
//! `GOTO` cannot be stopped. `>NM` answers at once, goes with the speed of `NM/MIN`, tells with `MONO-?DONE` whether it is there and
//! is ended by `MONO-STOP`: [`Motion::Scan`].
//!
//! # Sources
//! Words, layouts and the echo are those of the maker's manual of the IsoPlane, which has the same command set (its appendix A.4), and of public drivers
//! for SP2150i, SP2300i and SP2500i (nplab's prints a list of gratings as it came). What an error looks like beyond its `?` was not found.
//!
//! # Tried with
//! Nothing real, and no program that we did not write: none was found that plays one on a line. [Our simulated
//! instrument](crate::simulated::sp2150) is of the same sources.

mod link;
mod mono;
pub mod reply;

pub use link::{Link, LinkSettings};
pub use mono::{Mono, MonoSettings, Motion};

/// The device, in messages.
pub(crate) const DEVICE: &str = "SP2150 monochromator";
