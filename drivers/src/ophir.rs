//! Ophir power meters on a serial line (Nova II, Vega, LaserStar, Nova with its adapter; EA-1 Ethernet adapters, by TCP).
//!
//! - [`reply`]: what the meter answers, parsed strictly;
//! - [`Link`]: command and answer, with one repetition where the line spoilt one;
//! - [`Meter`]: a [`PowerMeter`](crate::device::PowerMeter) on it.
//!
//! # The protocol
//! 8 data bits, no parity, 1 stop bit, no flow control, 9600 baud unless the meter was told otherwise. A command is
//! `$XX…` with CR LF; the answer is `*…` or, for a refusal, `?…`, with CR LF. There is no checksum: a spoilt digit is a
//! wrong number that no host can see. [`Confirmed`](crate::device::Confirmed) reads until two readings agree.
//!
//! # Sources
//! The commands and answers are those of pymeasure (`ophir_base.py` and its tests, MIT) and of pylablib 1.4.3
//! (`devices/Ophir`, by its author tried on a Vega with a photodiode head); `$AQ` (averaging) and the words of `$ZQ`
//! (zeroing) are from memory of the maker's list of commands and not confirmed.
//!
//! # Tried with
//! Nothing real yet: [our simulated meter](crate::simulated::ophir), which pylablib's own host drives through a pty.
//! Juno, StarLite and other meters on their own USB speak a closed protocol and are not reached.

mod link;
mod meter;
pub mod reply;

pub use link::{Link, LinkSettings};
pub use meter::{Filter, Meter, MeterSettings};

/// The device, in messages.
pub(crate) const DEVICE: &str = "Ophir power meter";
