//! Swabian Instruments' Time Taggers: photon counters with raw time tags.
//!
//! The maker's library is closed and has no C interface, so that it runs in a process of its own: a small Python program
//! ([`BRIDGE`], which we ship) speaks to it in the user's Python, where the user has installed the maker's package
//! (`pip install Swabian-TimeTagger`; never bundled). A crash there is a named error here, with its last words.
//!
//! - [`spawn`]: starts the bridge;
//! - [`frame`]: what it sends, as frames with number and checksum;
//! - [`TimeTagger`]: a [`PhotonCounter`](crate::device::PhotonCounter) on it: finished bins, each once; and raw tags into a
//!   [`TagWriter`](crate::tags::TagWriter);
//! - [`convert`]: the maker's `.ttbin` files as 16-byte records.
//!
//! # What a bin says
//! Bins are the maker's `Counter`'s, handed over once each (`getDataObject(remove=True)`), so that nothing is lost or
//! counted twice by when it is asked for. Their times on the counter's clock follow each other without a gap, or carry the
//! flag `GAP`; one that comes twice is an error. `OVERFLOW`, `MISSED` and `ERROR` mean what [`tags`](crate::tags) says. What
//! was missed is known from a tag stream beside the counter ([`TaggerSettings::missed`]); its reports are booked in the
//! bin in which they lie, or in the next where they come late, so that over an overflow their sum is right. Starts in UTC
//! come from the computer's clock (`CLOCK_FREE`): the shortest delay of the last minute of bins places them.
//!
//! # Tried with
//! No Time Tagger yet. The maker's package 2.22.6 without hardware: its version, its errors, damaged files. All else with a
//! stand-in of ours for that package, which shows that the plumbing holds and nothing more, and with
//! [our simulated bridge](crate::simulated::swabian).

mod advice;
mod bridge;
pub mod frame;
mod raw;
mod streamed;
mod tagger;
mod utc;

pub use raw::{Converted, TagSummary, convert};
pub use tagger::{Channel, Source, TaggerSettings, TimeTagger};

use crate::transport::TransportError;
use crate::transport::child::Child;
use std::path::Path;
use std::process::Command;

/// The bridge's program.
pub const BRIDGE: &str = include_str!("../bridge/swabian.py");

/// The device, in messages.
pub(crate) const DEVICE: &str = "Time Tagger";

/// Starts the bridge in `python`: the user's, in which the maker's package is installed.
///
/// # Errors
/// No such program, or the system refuses.
pub fn spawn(python: impl AsRef<Path>) -> Result<Child, TransportError> {
    spawn_with(python, &[])
}

/// Starts the bridge with options of its own: `--module NAME --path FOLDER` takes a stand-in for the maker's package.
///
/// # Errors
/// The errors of [`spawn`].
pub fn spawn_with(python: impl AsRef<Path>, options: &[&str]) -> Result<Child, TransportError> {
    Child::spawn(Command::new(python.as_ref()).args(["-c", BRIDGE]).args(options))
}
