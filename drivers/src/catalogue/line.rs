//! A line to a device, whatever its cable: recorded, replayed, or spoilt on purpose.

use super::{Address, Bus};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::recording::{Faults, Faulty, Header, Recorded, Recording, Replay, ReplayError};
use crate::transport::serial::{PortSettings, Serial};
use crate::transport::tcp::Tcp;
use crate::transport::{Bytes, Transfer, Transfers, TransportError};
use std::fmt;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard};
use sunglint_formats::FileError;
use sunglint_formats::atomic::Overwrite;

/// Kind of traffic over a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wire {
    /// Bytes.
    Bytes,
    /// Requests one by one.
    Transfers,
    /// None of ours: a library speaks to the device.
    Library,
}

/// An open line.
pub enum Line {
    /// Line that carries bytes.
    Bytes(Box<dyn Bytes>),
    /// Line that carries requests.
    Transfers(Box<dyn Transfers>),
    /// No line of ours: a library speaks to the device.
    Library,
}

impl fmt::Debug for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Bytes(_) => "Line::Bytes",
            Self::Transfers(_) => "Line::Transfers",
            Self::Library => "Line::Library",
        })
    }
}

impl Line {
    /// A line of bytes.
    pub fn bytes(line: impl Bytes + 'static) -> Self {
        Self::Bytes(Box::new(line))
    }

    /// A line of requests.
    pub fn transfers(line: impl Transfers + 'static) -> Self {
        Self::Transfers(Box::new(line))
    }

    /// The line, written down as it is used.
    ///
    /// # Errors
    /// See [`Recorded::create`]; a library's device, of which nothing can be written down.
    pub fn recorded(
        self,
        path: impl AsRef<Path>,
        header: &Header,
        overwrite: Overwrite,
    ) -> Result<Self, FileError> {
        self.recorded_at(path.as_ref(), header, overwrite)
    }

    fn recorded_at(
        self,
        path: &Path,
        header: &Header,
        overwrite: Overwrite,
    ) -> Result<Self, FileError> {
        Ok(match self {
            Self::Bytes(line) => Self::bytes(Recorded::create(line, path, header, overwrite)?),
            Self::Transfers(line) => {
                Self::transfers(Recorded::create(line, path, header, overwrite)?)
            }
            Self::Library => {
                let unheard = "a library speaks to this device: nothing of it can be written down";
                let error = std::io::Error::new(std::io::ErrorKind::Unsupported, unheard);
                return Err(FileError::io("record to", path, error));
            }
        })
    }

    /// The line with faults.
    pub fn faulty(self, faults: Faults, seed: u64) -> Self {
        match self {
            Self::Bytes(line) => Self::bytes(Faulty::new(line, faults, seed)),
            Self::Transfers(line) => Self::transfers(Faulty::new(line, faults, seed)),
            Self::Library => Self::Library,
        }
    }

    /// A recording as a line, and what is left of it when the device is done.
    pub fn replay(recording: Recording, wire: Wire) -> (Self, Rest) {
        let kept = Kept { replay: Replay::new(recording), mismatch: None };
        let replay = Arc::new(Mutex::new(kept));
        let rest = Rest(Arc::clone(&replay));
        let line = match wire {
            Wire::Bytes => Self::bytes(Shared(replay)),
            Wire::Transfers => Self::transfers(Shared(replay)),
            Wire::Library => Self::Library,
        };
        (line, rest)
    }

    /// The line, for a driver that speaks in bytes.
    pub(super) fn into_bytes(self, device: &'static str) -> Result<Box<dyn Bytes>, DeviceError> {
        match self {
            Self::Bytes(line) => Ok(line),
            Self::Transfers(_) | Self::Library => Err(wrong(device, "bytes")),
        }
    }

    /// The line, for a driver that makes requests.
    pub(super) fn into_transfers(
        self,
        device: &'static str,
    ) -> Result<Box<dyn Transfers>, DeviceError> {
        match self {
            Self::Transfers(line) => Ok(line),
            Self::Bytes(_) | Self::Library => Err(wrong(device, "requests (USB, HID)")),
        }
    }
}

fn wrong(device: &'static str, expected: &str) -> DeviceError {
    DeviceError::Protocol { device, reason: format!("this driver needs a line of {expected}") }
}

/// A replay that its driver and [`Rest`] hold.
#[derive(Debug)]
struct Kept {
    replay: Replay,
    /// The first thing that the host did and the recording does not hold: a driver may go on after it.
    mismatch: Option<ReplayError>,
}

/// The driver's end of it.
struct Shared(Arc<Mutex<Kept>>);

fn locked(kept: &Mutex<Kept>) -> MutexGuard<'_, Kept> {
    // A panic of another holder leaves a replay that is as good as before.
    kept.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

impl Shared {
    fn with<V>(
        &self,
        act: impl FnOnce(&mut Replay) -> Result<V, TransportError>,
    ) -> Result<V, TransportError> {
        let mut kept = locked(&self.0);
        let done = act(&mut kept.replay);
        if let Err(TransportError::Replay(error)) = &done {
            kept.mismatch.get_or_insert_with(|| (**error).clone());
        }
        done
    }
}

/// Remainder of a recording that the host has not said or read.
#[derive(Debug)]
pub struct Rest(Arc<Mutex<Kept>>);

impl Rest {
    /// Whether the host has said and read everything, and nothing else. The replay is over then.
    ///
    /// # Errors
    /// The first thing that the host did otherwise, or the first line that is left over.
    pub fn finish(self) -> Result<(), ReplayError> {
        let header = Header {
            device: String::new(),
            source: String::new(),
            host: None,
            recorded: None,
            synthetic: true,
        };
        let nothing = Replay::new(Recording::new(header, []));
        let mut kept = locked(&self.0);
        match kept.mismatch.take() {
            Some(mismatch) => Err(mismatch),
            None => std::mem::replace(&mut kept.replay, nothing).finish(),
        }
    }
}

impl Bytes for Shared {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        self.with(|replay| replay.send(bytes, deadline))
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        self.with(|replay| replay.receive(buffer, deadline))
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        self.with(|replay| replay.discard(deadline))
    }
}

impl Transfers for Shared {
    fn transfer(
        &mut self,
        transfer: &Transfer,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, TransportError> {
        self.with(|replay| replay.transfer(transfer, deadline))
    }
}

/// Opens a serial port, or `tcp:HOST:PORT` for one behind a server. Without a place, the one port by whose numbers the driver
/// recognises its device.
pub(super) fn serial(
    device: &'static str,
    address: &mut Address,
    deadline: &Deadline,
) -> Result<Line, DeviceError> {
    let baud = address.integer("baud").unwrap_or(9600);
    serial_with(device, address, PortSettings::at(baud), deadline)
}

/// The same, of a port with these settings.
pub(super) fn serial_with(
    device: &'static str,
    address: &mut Address,
    settings: PortSettings,
    deadline: &Deadline,
) -> Result<Line, DeviceError> {
    let fail = |error| DeviceError::transport(device, error);
    let place = match address.place.clone() {
        Some(place) => place,
        None => {
            let place = only_port(address).map_err(fail)?;
            address.place = Some(place.clone());
            place
        }
    };
    if let Some(server) = place.strip_prefix("tcp:") {
        return Tcp::connect(server, deadline).map(Line::bytes).map_err(fail);
    }
    Serial::open_with(&place, settings, deadline).map(Line::bytes).map_err(fail)
}

fn only_port(address: &Address) -> Result<String, TransportError> {
    let driver = address.driver;
    let (all, _) = super::plugged();
    let is_ours = |found: &super::Plugged| {
        found.bus == Bus::Serial && found.driver().is_some_and(|of| of.name == driver.name)
    };
    let mut ports = all.into_iter().filter(is_ours).map(|found| found.path);
    match (ports.next(), ports.next()) {
        (Some(port), None) => Ok(port),
        (None, _) => Err(TransportError::NotFound {
            what: format!("a serial port with a {} device", driver.name),
            hint: format!("check cable and power, or name the port ({})", driver.place.example),
        }),
        (Some(one), Some(other)) => Err(TransportError::NotFound {
            what: format!("which serial port to use of {one}, {other}"),
            hint: format!("name it ({})", driver.place.example),
        }),
    }
}
