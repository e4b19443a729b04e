//! Thorlabs Elliptec rotation mounts (ELL14, ELL18 and alike), by their serial line of 9600 baud.
//!
//! - [`reply`]: what a module says, parsed strictly;
//! - [`Elliptec`]: an [`Axis`](crate::turning::Axis) on it; [`Stage`] is the rotation stage.
//!
//! Several modules may share one line; each has an address, `0` to `F`. A command is the address, two small letters and
//! hexadecimal digits, without an end: the module knows how long each command is. An answer is the address, two capital letters, digits, and CR LF.
//!
//! # What comes unasked
//! The end of a move is told (`PO…`, or `GS..` where it failed) whenever it comes. Until then some firmware answers `GS09`
//! (busy) and some nothing, so that silence during a move is no error at once. After a move, a lost answer or a spoilt one the
//! line is brought into step: asked who it is (`in`), the module answers behind all that is older.
//!
//! # No checksums
//! A position counts when two readings in a row agree, the pulses of a turn too. A module that got half a command waits 2 s for the rest; so
//! does the driver before it asks again.
//!
//! # Sources
//! Thorlabs, "ELLx modules protocol manual"; the packages elliptec 0.1.0 and pylablib 1.4.3.
//!
//! # Tried with
//! Nothing real yet: [our simulated module](crate::simulated::elliptec), which elliptec 0.1.0 and pylablib 1.4.3 drive too.

mod axis;
pub mod reply;

pub use axis::{Elliptec, LinkSettings, open};

/// A rotation stage on an Elliptec module.
pub type Stage<T> = crate::turning::Turning<Elliptec<T>>;

/// The device, in messages.
pub(crate) const DEVICE: &str = "Elliptec module";
