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
//! A meter measures by itself (a Vega 15 times a second) and tells its last value until the next one is there; no command says which one it is. A reading is asked for once a new value must
//! be there, 1.3 times the [time between values](crate::device::Update) after the call. That time is measured from the second reading on, by when the values change. In light without noise it cannot
//! be measured and is taken to be that of 15 a second.
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
