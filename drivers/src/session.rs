//! Sessions with one device: opened, recorded or replayed, with deadlines that a [`Cancel`] token ends.
//!
//! A [`Session`] opens the line to a device and makes the device on it. An [`OpenDevice`] then
//! [reads](OpenDevice::read), [sets](OpenDevice::set) or [moves](OpenDevice::travel); [`check`] is a self-test that changes nothing.
//! The other end is a [`Peer`]: a real line, or a [`Recording`] that the driver has to follow to the last byte.
//!
//! ```
//! use sunglint_drivers::catalogue::Address;
//! use sunglint_drivers::clock::Cancel;
//! use sunglint_drivers::session::{Peer, ReadOptions, SessionOptions, Session};
//! use sunglint_numerics::progress::Silent;
//!
//! let peer = Peer::live(&Cancel::new());
//! let address = Address::parse("sim-pm100", &["power_w=2e-6".to_owned()])?;
//! let mut meter = Session::start(&peer, address, &SessionOptions::default())?;
//! let done = meter.read(&ReadOptions { count: 2, ..ReadOptions::default() }, &Silent)?;
//! assert_eq!(done.readings.len(), 2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod check;
mod error;
mod read;
mod set;
mod travel;

pub use check::{Check, CheckStep, Finding, Verdict, check};
pub use error::SessionError;
pub use read::{ReadOptions, Reading, Readings};
pub use set::{SetValue, SettingsDone};
pub use travel::{Destination, FailedMove, Move, Moves, Position, Target};

use crate::catalogue::{Address, AnyDevice, Line, Rest};
use crate::clock::{Cancel, Clock, Deadline, SystemClock, VirtualClock};
use crate::device::Identity;
use crate::recording::{Header, Recording};
use hifitime::Epoch;
use std::cell::{Cell, RefCell};
use std::fmt;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use sunglint_formats::atomic::Overwrite;
use sunglint_formats::time::format_utc;

/// How long a line may take to open, and an answer to come.
const CONNECT: Duration = Duration::from_secs(10);
/// How long a device may take until it is ready.
const READY: Duration = Duration::from_secs(60);

/// Returns UTC now.
fn utc_now() -> Result<Epoch, SessionError> {
    Epoch::now().map_err(|error| SessionError::NoClock(Box::new(error)))
}

/// The other end of a session.
#[derive(Debug)]
pub struct Peer(End);

enum End {
    Live { cancel: Cancel },
    Replay { recording: Box<Cell<Option<Recording>>>, rest: RefCell<Option<Rest>> },
}

impl fmt::Debug for End {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Live { .. } => "Live",
            Self::Replay { .. } => "Replay",
        })
    }
}

impl Peer {
    /// Real lines. The token ends what is under way in good order: a motor is stopped.
    pub fn live(cancel: &Cancel) -> Self {
        Self(End::Live { cancel: cancel.clone() })
    }

    /// A recording, which holds one session.
    pub fn replay(recording: Recording) -> Self {
        let recording = Box::new(Cell::new(Some(recording)));
        Self(End::Replay { recording, rest: RefCell::new(None) })
    }

    /// Returns true for real lines.
    pub fn is_live(&self) -> bool {
        matches!(self.0, End::Live { .. })
    }

    /// Takes what is left of the recording; `None` for a real line, and before a session was opened.
    pub fn rest(&self) -> Option<Rest> {
        match &self.0 {
            End::Live { .. } => None,
            End::Replay { rest, .. } => rest.borrow_mut().take(),
        }
    }
}

/// Options of a session.
#[derive(Debug, Default)]
pub struct SessionOptions<'a> {
    /// Longest time of one step; `None` for the usual time of each kind of step.
    pub timeout: Option<Duration>,
    /// Where every byte that is said is written down.
    pub record: Option<RecordTo<'a>>,
}

/// A recording to be made.
pub struct RecordTo<'a> {
    /// The file.
    pub file: &'a Path,
    /// Whether it may replace one that is there.
    pub overwrite: Overwrite,
    /// Gives the `host` of the recording's header: the program and what it was asked, with the address as the driver completed it.
    pub host: &'a dyn Fn(&Address) -> String,
}

impl fmt::Debug for RecordTo<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RecordTo").field("file", &self.file).finish_non_exhaustive()
    }
}

impl RecordTo<'_> {
    fn header(&self, address: &Address) -> Result<Header, SessionError> {
        let driver = address.driver;
        Ok(Header {
            device: format!("{} ({})", driver.title, address),
            source: if driver.simulated { "sunglint's simulated device" } else { "hardware" }
                .into(),
            host: Some((self.host)(address)),
            recorded: Some(format_utc(utc_now()?, 3)),
            synthetic: driver.simulated,
        })
    }
}

/// A line to a device, with the deadlines of its steps.
pub struct Session {
    address: Address,
    line: Option<Line>,
    clock: Arc<dyn Clock>,
    cancel: Cancel,
    timeout: Option<Duration>,
}

impl fmt::Debug for Session {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Session").field("address", &self.address).finish_non_exhaustive()
    }
}

impl Session {
    /// Opens the line.
    ///
    /// # Errors
    /// The line cannot be opened, the recording cannot be written, or the recording that is replayed was used already.
    pub fn connect(
        peer: &Peer,
        mut address: Address,
        options: &SessionOptions<'_>,
    ) -> Result<Self, SessionError> {
        let timeout = options.timeout;
        let (clock, cancel): (Arc<dyn Clock>, Cancel) = match &peer.0 {
            End::Live { cancel } => (Arc::new(SystemClock), cancel.clone()),
            End::Replay { .. } => (Arc::new(VirtualClock::new()), Cancel::new()),
        };
        let deadline = Deadline::after(clock.clone(), timeout.unwrap_or(CONNECT));
        let line = match &peer.0 {
            End::Live { cancel } => {
                let line = address.connect(&deadline.with_cancel(cancel))?;
                match &options.record {
                    None => line,
                    Some(to) => line.recorded(to.file, &to.header(&address)?, to.overwrite)?,
                }
            }
            End::Replay { recording, rest } => {
                let recording = recording.take().ok_or(SessionError::Replayed)?;
                let (line, left) = Line::replay(recording, address.wire());
                *rest.borrow_mut() = Some(left);
                line
            }
        };
        Ok(Self { address, line: Some(line), clock, cancel, timeout })
    }

    /// Opens the line and the device, and asks who it is.
    ///
    /// # Errors
    /// See [`connect`](Self::connect); the device does not answer as its driver expects.
    pub fn start(
        peer: &Peer,
        address: Address,
        options: &SessionOptions<'_>,
    ) -> Result<OpenDevice, SessionError> {
        let mut session = Self::connect(peer, address, options)?;
        let mut device = session.open()?;
        let identity = device.device().identity(&session.soon())?;
        Ok(OpenDevice { session, device, identity })
    }

    /// Makes the device on the line, once.
    fn open(&mut self) -> Result<AnyDevice, SessionError> {
        let line = self.line.take().ok_or(SessionError::LineInUse)?;
        Ok(self.address.open(line, &self.within(READY))?)
    }

    /// Returns the deadline of a step that usually takes less than `usual`: the session's own time, or that.
    fn within(&self, usual: Duration) -> Deadline {
        let time = self.timeout.unwrap_or(usual);
        Deadline::after(self.clock.clone(), time).with_cancel(&self.cancel)
    }

    /// Returns the deadline of an answer.
    fn soon(&self) -> Deadline {
        self.within(CONNECT)
    }

    /// Returns a deadline of a few seconds that no token ends: for what a person has to know after a cancelled move.
    fn grace(&self) -> Deadline {
        Deadline::after(self.clock.clone(), Duration::from_secs(3))
    }

    /// Waits until `time` after `start` on the clock.
    fn wait_until(&self, start: Duration, time: Duration) -> Result<(), SessionError> {
        let due = start.saturating_add(time).saturating_sub(self.clock.now());
        let whole = Deadline::after(self.clock.clone(), Duration::MAX).with_cancel(&self.cancel);
        Ok(whole.sleep(due)?)
    }

    /// Returns the clock's time.
    fn now(&self) -> Duration {
        self.clock.now()
    }
}

/// A device that has said who it is.
#[derive(Debug)]
pub struct OpenDevice {
    session: Session,
    device: AnyDevice,
    identity: Identity,
}

impl OpenDevice {
    /// Returns the device's address, as the driver completed it.
    pub fn address(&self) -> &Address {
        &self.session.address
    }

    /// Returns who the device says it is.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// Returns the device.
    pub fn device(&mut self) -> &mut AnyDevice {
        &mut self.device
    }
}
