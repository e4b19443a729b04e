//! Errors of a device, above its cable.

use crate::clock::Expired;
use crate::transport::TransportError;
use std::fmt;

/// Why a device did not do what it was asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DeviceError {
    /// The cable, the system, the deadline of an answer.
    #[error("{device}: {source}")]
    Transport {
        /// The device.
        device: &'static str,
        /// Error of the transport.
        source: TransportError,
    },
    /// The device took longer for its action than it may.
    #[error("{device}: {action} took longer than {:.3} s", after.as_secs_f64())]
    TooSlow {
        /// The device.
        device: &'static str,
        /// Action that the device was doing.
        action: &'static str,
        /// How long was waited.
        after: std::time::Duration,
    },
    /// Somebody set the [`Cancel`](crate::clock::Cancel) token.
    #[error("{device}: {action} was cancelled")]
    Cancelled {
        /// The device.
        device: &'static str,
        /// Action that the device was doing.
        action: &'static str,
    },
    /// The device answered in a way that its protocol does not know.
    #[error("{device}: {reason}")]
    Protocol {
        /// The device.
        device: &'static str,
        /// Description of what came, and of what should have come.
        reason: String,
    },
    /// A device of another kind: no other try makes it one of this kind.
    #[error("{device}: `{name}` is no {what} (DRIVER_INTERFACE {bits})")]
    WrongKind {
        /// The device.
        device: &'static str,
        /// Name of the device on its server.
        name: String,
        /// Kind that was asked for.
        what: &'static str,
        /// Kinds that it says it is of.
        bits: u32,
    },
    /// The device understood and said no.
    #[error("{device} refused {request}: {reason} (code {code})")]
    Refused {
        /// The device.
        device: &'static str,
        /// Request that the device refused.
        request: String,
        /// The device's own code.
        code: i64,
        /// Meaning of the code.
        reason: &'static str,
    },
    /// The device understood and said no, in words of its own.
    #[error("{device} refused {request}: it says `{said}`")]
    Rejected {
        /// The device.
        device: &'static str,
        /// Request that the device refused.
        request: String,
        /// Message of the device.
        said: String,
    },
    /// The device put an error into its queue.
    #[error("{device} refused {request}: error {code}, {said}")]
    Complained {
        /// The device.
        device: &'static str,
        /// Request that the device refused.
        request: String,
        /// The device's number of the error.
        code: i32,
        /// The device's words.
        said: String,
    },
    /// A file that describes the device is wrong or cannot be read.
    #[error(transparent)]
    File(Box<sunglint_formats::FileError>),
    /// A value that this device cannot take.
    #[error("{name}: found {asked}, expected {least} to {most}")]
    OutOfRange {
        /// The value's name, with its unit.
        name: &'static str,
        /// Requested value or name.
        asked: f64,
        /// The least that it takes.
        least: f64,
        /// The most that it takes.
        most: f64,
    },
    /// A name or number that this device does not have.
    #[error("{name}: found {asked}, expected one of {known}")]
    Unknown {
        /// Name of the setting or device that is chosen.
        name: &'static str,
        /// Requested value or name.
        asked: String,
        /// Available values.
        known: String,
    },
    /// The device took the setting and has another value all the same.
    #[error("{device}: {name} was set to {asked}, the device says {got}")]
    NotTaken {
        /// The device.
        device: &'static str,
        /// The setting, with its unit.
        name: &'static str,
        /// Requested value or name.
        asked: String,
        /// Value that the device reports.
        got: String,
    },
    /// The device has to be prepared first.
    #[error("{device}: {reason}")]
    NotReady {
        /// The device.
        device: &'static str,
        /// Description of what is missing, and what to do.
        reason: &'static str,
    },
    /// The device understood and said no in its own words.
    #[error("{device} refused {request}: {message}")]
    Declined {
        /// The device.
        device: &'static str,
        /// Request that the device refused.
        request: String,
        /// Message of the device.
        message: String,
    },
    /// The awaited event did not come, though the line is there.
    #[error("{device}: {awaited} did not come within {:.3} s; meanwhile: {seen}", after.as_secs_f64())]
    Awaited {
        /// The device.
        device: &'static str,
        /// Event that should have come.
        awaited: String,
        /// How long was waited.
        after: std::time::Duration,
        /// Events that came instead.
        seen: String,
    },
    /// A frame that is not the one that was asked for: another program uses the camera, too.
    #[error("{device}: the frame is not ours: {what}")]
    NotOurs {
        /// The device.
        device: &'static str,
        /// Difference between the frame and the request, with both values.
        what: String,
    },
    /// Somebody else stopped or parked the device while it was used: it is left as it is.
    #[error("{device}: {what}: it is left as it is")]
    Taken {
        /// The device.
        device: &'static str,
        /// The act that failed.
        what: &'static str,
    },
    /// A driver that this program does not have.
    #[error("{device}: {reason}")]
    Unavailable {
        /// The device.
        device: &'static str,
        /// Description of what is missing, and what to do.
        reason: &'static str,
    },
    /// A recording that cannot be read on.
    #[error("{device}: it is damaged, or cut off: {reason}")]
    Damaged {
        /// The device.
        device: &'static str,
        /// Error of the reader, and how far it came.
        reason: String,
    },
    /// The device behind a server has gone, though the line is there.
    #[error("{device}: {what}; connect again once it is back")]
    Lost {
        /// The device.
        device: &'static str,
        /// Description of what has gone.
        what: String,
    },
    /// A stage ran into a limit switch.
    #[error(
        "{device}: the {side} limit switch stopped it at {at_deg:.4} deg on the way to {target_deg:.4} deg"
    )]
    LimitHit {
        /// The device.
        device: &'static str,
        /// Which switch.
        side: Side,
        /// Where it stands, deg.
        at_deg: f64,
        /// Where it should have gone, deg.
        target_deg: f64,
    },
    /// A stage stands still short of its target.
    #[error(
        "{device}: it stands still at {at_deg:.4} deg on the way to {target_deg:.4} deg: check for an obstacle, the motor's current and its supply"
    )]
    Stalled {
        /// The device.
        device: &'static str,
        /// Where it stands, deg.
        at_deg: f64,
        /// Where it should have gone, deg.
        target_deg: f64,
    },
    /// Something failed, and after it the device could not be stopped.
    #[error(
        "{source}; and it could not be stopped: it may still be turning, watch it or cut its power"
    )]
    NotStopped {
        /// The device.
        device: &'static str,
        /// Error that came before the attempt to stop.
        source: Box<DeviceError>,
    },
}

/// The error of a setting that reads back as another value.
pub(crate) fn not_taken(
    device: &'static str,
    name: &'static str,
    asked: &str,
    got: &str,
) -> DeviceError {
    DeviceError::NotTaken { device, name, asked: asked.to_owned(), got: got.to_owned() }
}

/// A limit switch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The one towards which the motor's counter grows.
    Right,
    /// The other.
    Left,
}

impl fmt::Display for Side {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Right => "right",
            Self::Left => "left",
        })
    }
}

impl DeviceError {
    /// Name in [`Unknown`](Self::Unknown) of a device that an INDI server does not have.
    pub(crate) const INDI_DEVICE: &'static str = "INDI device";
    /// The same of an Alpaca server.
    pub(crate) const ALPACA_DEVICE: &'static str = "Alpaca device";

    /// Whether its server does not have the device, which may have another name, or a driver that is yet to start.
    pub fn is_not_served(&self) -> bool {
        matches!(self, Self::Unknown { name, .. } if [Self::INDI_DEVICE, Self::ALPACA_DEVICE].contains(name))
    }

    /// Whether the same request will fail for ever: a value beyond the device's range, a driver that is not there, a recording that is damaged.
    pub fn is_permanent(&self) -> bool {
        matches!(
            self,
            Self::OutOfRange { .. }
                | Self::Unavailable { .. }
                | Self::Damaged { .. }
                | Self::File(_)
        )
    }

    /// Whether the same setting will fail for ever: [`is_permanent`](Self::is_permanent), a name that the device does not have, something that it cannot do.
    pub fn is_permanent_setting(&self) -> bool {
        self.is_permanent()
            || matches!(self, Self::Unknown { .. } | Self::NotReady { .. } | Self::WrongKind { .. })
    }

    /// A transport's error while `device` was spoken to; a cancelled wait is told as such.
    pub fn transport(device: &'static str, source: TransportError) -> Self {
        match source {
            TransportError::Cancelled { .. } => {
                Self::Cancelled { device, action: "what was asked" }
            }
            source => Self::Transport { device, source },
        }
    }

    /// A deadline that passed while `device` was busy with `action`.
    pub fn expired(device: &'static str, action: &'static str, expired: Expired) -> Self {
        match expired {
            Expired::Timeout { after } => Self::TooSlow { device, action, after },
            Expired::Cancelled { .. } => Self::Cancelled { device, action },
        }
    }
}

/// Part of the work that a long call had done when it failed, with the error.
#[derive(Debug, thiserror::Error)]
#[error("{error}")]
pub struct Interrupted<T: fmt::Debug> {
    /// Part of the work that was done.
    pub done: T,
    /// Why not all.
    #[source]
    pub error: Box<DeviceError>,
}

impl<T: fmt::Debug> Interrupted<T> {
    /// `done`, and the error.
    pub fn new(done: T, error: DeviceError) -> Self {
        Self { done, error: Box::new(error) }
    }
}

impl Interrupted<Option<f64>> {
    /// A move that failed with `error`, and how stopping after it went: where the stage stands, if that is known. A motor that could not be reached may still
    /// be turning, and that is said.
    pub(crate) fn stopped(
        device: &'static str,
        error: DeviceError,
        stopped: Result<Option<f64>, DeviceError>,
    ) -> Self {
        match stopped {
            Ok(at_deg) => Self::new(at_deg, error),
            Err(_) => Self::new(None, DeviceError::NotStopped { device, source: Box::new(error) }),
        }
    }
}
