//! Errors that end a session.

use crate::catalogue::{AddressError, Kind};
use crate::clock::Expired;
use crate::device::DeviceError;
use sunglint_formats::FileError;

/// Why a session with a device did not do what it was asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SessionError {
    /// The address names no device.
    #[error(transparent)]
    Address(#[from] AddressError),
    /// The device, or the line to it.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The recording cannot be written.
    #[error(transparent)]
    Recording(#[from] FileError),
    /// A wait between two readings was cancelled.
    #[error(transparent)]
    Wait(#[from] Expired),
    /// A second session was opened on one recording.
    #[error("a recording holds one conversation")]
    Replayed,
    /// The device was made already.
    #[error("the line is in use")]
    LineInUse,
    /// The system tells no time.
    #[error("the system has no clock")]
    NoClock(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// A photon counter counted and handed over nothing.
    #[error("the counter gave no bin")]
    NoBin,
    /// This kind of device does not move.
    #[error("a {kind} does not move; stages, filter wheels and focusers do")]
    Immovable {
        /// The kind.
        kind: Kind,
    },
    /// The text names no target of this kind of device.
    #[error("target: found `{found}`, expected {expected}")]
    Target {
        /// The text.
        found: String,
        /// Targets that are allowed.
        expected: &'static str,
    },
    /// The target is one of another kind of device.
    #[error("a {kind} does not go there")]
    NoSuchPlace {
        /// The kind.
        kind: Kind,
    },
}

impl SessionError {
    /// Returns true where the device has to be prepared first.
    pub fn is_not_ready(&self) -> bool {
        matches!(self, Self::Device(DeviceError::NotReady { .. }))
    }
}
