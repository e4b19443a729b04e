//! Errors between the host and a device, whatever the cable.

use crate::clock::Expired;
use crate::recording::ReplayError;
use std::io;
use std::time::Duration;
use sunglint_formats::FileError;

/// Why a transport did not do what it was asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TransportError {
    /// The deadline passed.
    #[error("no answer within {:.3} s{}", after.as_secs_f64(), so_far(got_so_far))]
    Timeout {
        /// How long was waited.
        after: Duration,
        /// Bytes that had come by then; the rest is missing.
        got_so_far: Vec<u8>,
    },
    /// Somebody set the [`Cancel`](crate::clock::Cancel) token.
    #[error("cancelled after {:.3} s{}", after.as_secs_f64(), so_far(got_so_far))]
    Cancelled {
        /// How long was waited.
        after: Duration,
        /// Bytes that had come by then.
        got_so_far: Vec<u8>,
    },
    /// The device or the other end has gone; open it again once it is back.
    #[error("{what} is gone: check cable and power, then connect again{}", so_far(got_so_far))]
    Disconnected {
        /// The port, address or program.
        what: String,
        /// Bytes that had come by then.
        got_so_far: Vec<u8>,
    },
    /// The device is there and this user or program may not have it.
    #[error("{what} cannot be opened: {reason}; {hint}")]
    Refused {
        /// The port or device.
        what: String,
        /// Error that the operating system reported.
        reason: String,
        /// Advice on what to do.
        hint: String,
    },
    /// No device by that name or number.
    #[error("{what} was not found: {hint}")]
    NotFound {
        /// Name of what was looked for.
        what: String,
        /// Advice on what to do.
        hint: String,
    },
    /// The device refused a USB transfer (a stalled endpoint).
    #[error("the device refused the transfer {transfer} (it stalled)")]
    Stalled {
        /// The transfer, as recordings write it.
        transfer: String,
    },
    /// A message without its end.
    #[error("{most} bytes without an end of message")]
    TooLong {
        /// The most that the message may have.
        most: usize,
        /// Bytes that had come.
        got_so_far: Vec<u8>,
    },
    /// This transport has no such transfer (a bulk transfer on HID).
    #[error("{what} cannot do {transfer}")]
    Unsupported {
        /// The transport.
        what: String,
        /// The transfer, as recordings write it.
        transfer: String,
    },
    /// The system refused in another way.
    #[error("cannot {action} {what}: {source}")]
    Io {
        /// `read from`, `write to` …
        action: &'static str,
        /// The port, address or program.
        what: String,
        /// Error that the operating system reported.
        source: io::Error,
    },
    /// Difference between what the host did and what the recording holds.
    #[error(transparent)]
    Replay(Box<ReplayError>),
    /// Error in writing the conversation to the recording.
    #[error(transparent)]
    Recording(Box<FileError>),
}

impl TransportError {
    /// A disconnection of `what`.
    pub fn disconnected(what: impl Into<String>) -> Self {
        Self::Disconnected { what: what.into(), got_so_far: Vec::new() }
    }

    /// Makes a transport error from that of a read or write of `what`: a device that has gone is told from other trouble.
    pub fn from_io(action: &'static str, what: &str, source: io::Error) -> Self {
        use io::ErrorKind as Kind;
        // EIO is what Linux says on a terminal whose other end has gone, ENXIO and ENODEV on an unplugged adapter.
        let gone = cfg!(unix) && matches!(source.raw_os_error(), Some(5 | 6 | 19));
        match source.kind() {
            Kind::BrokenPipe
            | Kind::ConnectionReset
            | Kind::ConnectionAborted
            | Kind::NotConnected
            | Kind::UnexpectedEof => Self::disconnected(what),
            _ if gone => Self::disconnected(what),
            _ => Self::Io { action, what: what.to_owned(), source },
        }
    }

    /// The same error with what had come before it put in front of what it already holds.
    #[must_use]
    pub fn with_got_so_far(mut self, bytes: &[u8]) -> Self {
        match &mut self {
            Self::Timeout { got_so_far, .. }
            | Self::Cancelled { got_so_far, .. }
            | Self::Disconnected { got_so_far, .. }
            | Self::TooLong { got_so_far, .. } => {
                got_so_far.splice(0..0, bytes.iter().copied());
            }
            _ => {}
        }
        self
    }

    /// Whether asking again may help: the device said nothing, or not enough.
    pub fn is_timeout(&self) -> bool {
        matches!(self, Self::Timeout { .. })
    }
}

impl From<Expired> for TransportError {
    fn from(expired: Expired) -> Self {
        match expired {
            Expired::Timeout { after } => Self::Timeout { after, got_so_far: Vec::new() },
            Expired::Cancelled { after } => Self::Cancelled { after, got_so_far: Vec::new() },
        }
    }
}

impl From<ReplayError> for TransportError {
    fn from(error: ReplayError) -> Self {
        Self::Replay(Box::new(error))
    }
}

impl From<FileError> for TransportError {
    fn from(error: FileError) -> Self {
        Self::Recording(Box::new(error))
    }
}

/// ` (so far: 01 02 …)`, or nothing.
fn so_far(bytes: &[u8]) -> String {
    if bytes.is_empty() {
        return String::new();
    }
    format!(" (so far: {})", crate::recording::hex_excerpt(bytes))
}
