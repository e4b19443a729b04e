//! A simulated device on a real port, for programs that are not ours: a pty with a name, or a TCP port.
//!
//! The device is the one that `sim-…` addresses open in memory, and it keeps its state from one host to the next. One host is served at a
//! time; another one that knocks at the port meanwhile is sent away, unless the first one goes within a moment.
//!
//! A pty has no modem lines and no speed: a host that lifts RTS gets `ENOTTY`, and a wrong baud rate goes unnoticed.

use super::bridge;
use crate::catalogue::{Address, Line, Wire};
use crate::clock::{Cancel, Deadline};
use crate::device::DeviceError;
use crate::transport::TransportError;
use crate::transport::serial::Serial;
use crate::transport::tcp::Tcp;
use std::collections::VecDeque;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Longest time for opening the simulated device.
const OPEN: Duration = Duration::from_secs(5);
/// Longest time for which one host is served before the deadline is made anew.
const DAY: Duration = Duration::from_secs(86_400);
/// Time for which a host that knocks waits for the one that is served to go: one that comes right after another is often seen before the
/// other's end is.
const GRACE: Duration = Duration::from_millis(500);
/// Time after which a pty forgets that a host wanted it for itself: the system keeps that wish of one that was killed, since the port stays open.
const UNLOCK: Duration = Duration::from_millis(50);
/// Time in which answers to a host that has gone are heard and dropped even where the next one waits: they are none for it.
const LATE: Duration = Duration::from_millis(50);
/// Most hosts that wait so.
const MOST_WAITING: usize = 8;

/// Reasons why a device cannot be served.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServeError {
    /// The address is that of a real device.
    #[error("{driver} is a real instrument; only simulated ones (sim-…) are served")]
    Real {
        /// Name of the driver.
        driver: &'static str,
    },
    /// The device speaks in requests over USB or through a library, and has no line of bytes.
    #[error(
        "{driver} does not speak over a line of bytes, so that it cannot be served on a pty or a port; served are {served}"
    )]
    NoBytes {
        /// Name of the driver.
        driver: &'static str,
        /// Names of those that can be.
        served: String,
    },
    /// Something of that name is there already.
    #[error("{}: there is something of that name already; remove it, or choose another name", .path.display())]
    Taken {
        /// The name.
        path: PathBuf,
    },
    /// The system refused a pty, a link or a port.
    #[error("cannot {action} {what}: {source}")]
    System {
        /// Action that was tried.
        action: &'static str,
        /// With what.
        what: String,
        /// The system's words.
        source: io::Error,
    },
    /// The simulated device could not be opened.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// A line failed.
    #[error(transparent)]
    Line(#[from] TransportError),
}

/// A simulated device that is ready to be served.
pub struct Served {
    name: &'static str,
    line: Box<dyn crate::transport::Bytes>,
}

impl std::fmt::Debug for Served {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Served").field("name", &self.name).finish_non_exhaustive()
    }
}

/// Visit of a host at a port.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Visit {
    /// A host is there.
    Came(SocketAddr),
    /// It has gone.
    Left(SocketAddr),
    /// Another host came meanwhile and was sent away.
    SentAway(SocketAddr),
}

impl Served {
    /// Makes the simulated device of an address.
    ///
    /// # Errors
    /// A real device, one without a line of bytes, or options that the device refuses.
    pub fn new(mut address: Address) -> Result<Self, ServeError> {
        let driver = address.driver;
        if !driver.simulated {
            return Err(ServeError::Real { driver: driver.name });
        }
        let no_bytes = || {
            let able = crate::catalogue::DRIVERS.into_iter();
            let able = able.filter(|d| d.simulated && d.wire == Wire::Bytes).map(|d| d.name);
            ServeError::NoBytes { driver: driver.name, served: able.collect::<Vec<_>>().join(", ") }
        };
        if driver.wire != Wire::Bytes {
            return Err(no_bytes());
        }
        match address.connect(&Deadline::within(OPEN))? {
            Line::Bytes(line) => Ok(Self { name: driver.name, line }),
            Line::Transfers(_) | Line::Library => Err(no_bytes()),
        }
    }

    /// A device at the other end of a line in memory, under a name.
    pub fn on_line(name: &'static str, line: Box<dyn crate::transport::Bytes>) -> Self {
        Self { name, line }
    }

    /// Name of its driver.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Serves the device on a pty until the token is set.
    ///
    /// # Errors
    /// The pty failed.
    #[cfg(unix)]
    pub fn on_pty(&mut self, pty: &mut Pty, cancel: &Cancel) -> Result<(), ServeError> {
        while !cancel.is_cancelled() {
            let deadline = Deadline::within(DAY).with_cancel(cancel);
            let Pty { device, held, .. } = pty;
            let mut unlocked = Instant::now();
            bridge(&mut *self.line, device, &deadline, || {
                if unlocked.elapsed() > UNLOCK {
                    unlocked = Instant::now();
                    // A port that is not unlocked refuses the next host, which says so.
                    let _ = rustix::termios::ioctl_tiocnxcl(&*held);
                }
            })?;
        }
        Ok(())
    }

    /// Serves the device at a port, to one host after the other, until the token is set.
    ///
    /// # Errors
    /// The port failed. A host that goes ends its visit only.
    pub fn at_port(
        &mut self,
        port: &Port,
        cancel: &Cancel,
        mut seen: impl FnMut(Visit),
    ) -> Result<(), ServeError> {
        let mut waiting = VecDeque::new();
        while !cancel.is_cancelled() {
            let next = match waiting.pop_front() {
                Some((stream, host, _)) => Some((stream, host)),
                None => port.next()?,
            };
            let Some((stream, host)) = next else {
                // Without a host it goes on, too, and what it says is for nobody.
                self.line.discard(&Deadline::within(LATE))?;
                std::thread::sleep(Duration::from_millis(5));
                continue;
            };
            seen(Visit::Came(host));
            let deadline = Deadline::within(DAY).with_cancel(cancel);
            let ended =
                stream.set_nonblocking(false).map_err(|e| port.fail("set up", e)).and_then(|()| {
                    let mut stream = Tcp::from_stream(stream)?;
                    let meanwhile = || {
                        // What goes wrong with one that is sent away anyhow is no matter.
                        while let Ok(Some((other, host))) = port.next() {
                            waiting.push_back((other, host, Instant::now()));
                        }
                        while waiting.front().is_some_and(|first| {
                            waiting.len() > MOST_WAITING || first.2.elapsed() > GRACE
                        }) {
                            if let Some((other, host, _)) = waiting.pop_front() {
                                drop(other);
                                seen(Visit::SentAway(host));
                            }
                        }
                    };
                    Ok(bridge(&mut *self.line, &mut stream, &deadline, meanwhile)?)
                });
            seen(Visit::Left(host));
            match ended {
                // A host that resets its connection has gone.
                Ok(()) | Err(ServeError::Line(_)) => {}
                Err(error) => return Err(error),
            }
            self.forget(cancel)?;
        }
        Ok(())
    }

    /// Hears what the device still says to a host that has gone.
    fn forget(&mut self, cancel: &Cancel) -> Result<(), ServeError> {
        let gone = Instant::now();
        while gone.elapsed() < LATE && !cancel.is_cancelled() {
            self.line.discard(&Deadline::within(LATE))?;
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(())
    }
}

/// Port on this computer, or on the network.
#[derive(Debug)]
pub struct Port {
    listener: TcpListener,
    at: SocketAddr,
}

impl Port {
    /// Listens at `ADDRESS:PORT`; port 0 lets the system choose one.
    ///
    /// # Errors
    /// The system's refusal: the port is taken, the address is not of this computer.
    pub fn listen(address: &str) -> Result<Self, ServeError> {
        let fail =
            |source| ServeError::System { action: "listen at", what: address.to_owned(), source };
        let listener = TcpListener::bind(address).map_err(fail)?;
        listener.set_nonblocking(true).map_err(fail)?;
        let at = listener.local_addr().map_err(fail)?;
        Ok(Self { listener, at })
    }

    /// Address and port where it listens.
    pub fn at(&self) -> SocketAddr {
        self.at
    }

    fn fail(&self, action: &'static str, source: io::Error) -> ServeError {
        ServeError::System { action, what: self.at.to_string(), source }
    }

    /// Returns a host that waits, if there is one.
    fn next(&self) -> Result<Option<(std::net::TcpStream, SocketAddr)>, ServeError> {
        match self.listener.accept() {
            Ok(host) => Ok(Some(host)),
            Err(error) => match error.kind() {
                io::ErrorKind::WouldBlock
                | io::ErrorKind::Interrupted
                | io::ErrorKind::ConnectionAborted => Ok(None),
                _ => Err(self.fail("listen at", error)),
            },
        }
    }
}

/// A pty whose host's end has a name of the user's choice; the name is removed at the end.
#[cfg(unix)]
#[derive(Debug)]
pub struct Pty {
    device: Serial,
    /// The host's end, held open without a lock on it: without it the first host that closes would hang up the device, and the port would
    /// forget that it is raw.
    held: std::fs::File,
    port: String,
    link: Option<PathBuf>,
}

#[cfg(unix)]
impl Pty {
    /// Opens a pty in raw mode, and links `link` to the host's end where it is given.
    ///
    /// # Errors
    /// The system's refusal; a name that is taken.
    pub fn open(link: Option<&Path>) -> Result<Self, ServeError> {
        use serialport::SerialPort as _;
        use std::os::unix::fs::OpenOptionsExt as _;
        let fail = |source| ServeError::System { action: "open", what: "a pty".to_owned(), source };
        // The name of a pty that has gone, of a server that was killed: looked at before a new one may have its number.
        let is_gone = |link: &&Path| {
            std::fs::read_link(link).is_ok_and(|to| to.starts_with("/dev/pts") && !to.exists())
        };
        if let Some(link) = link.filter(is_gone) {
            let _ = std::fs::remove_file(link);
        }
        let (device, host) = serialport::TTYPort::pair().map_err(|error| fail(error.into()))?;
        let port = host.name().unwrap_or_default();
        let flags = nix::fcntl::OFlag::O_NOCTTY.bits();
        let held =
            std::fs::OpenOptions::new().read(true).write(true).custom_flags(flags).open(&port);
        let held = held.map_err(fail)?;
        if let Some(link) = link {
            std::os::unix::fs::symlink(&port, link).map_err(|source| match source.kind() {
                io::ErrorKind::AlreadyExists => ServeError::Taken { path: link.to_owned() },
                _ => ServeError::System {
                    action: "make the link",
                    what: link.display().to_string(),
                    source,
                },
            })?;
        }
        let device = Serial::from_port(Box::new(device));
        Ok(Self { device, held, port, link: link.map(Path::to_owned) })
    }

    /// Path of the host's end (`/dev/pts/3`).
    pub fn port(&self) -> &str {
        &self.port
    }
}

#[cfg(unix)]
impl Drop for Pty {
    fn drop(&mut self) {
        if let Some(link) = &self.link {
            // Only if it still is ours.
            if std::fs::read_link(link).is_ok_and(|to| to == Path::new(&self.port)) {
                let _ = std::fs::remove_file(link);
            }
        }
    }
}
