//! Serial ports, by [`serialport`]. Modem lines are never used: ptys and many adapters have none.

use super::stream::{self, Blocking};
use super::{Bytes, TransportError};
use crate::clock::Deadline;
use serialport::SerialPort;
use std::io::{self, Read as _, Write as _};
use std::time::Duration;

/// A serial port, 8 data bits, no parity, 1 stop bit, no flow control.
#[derive(Debug)]
pub struct Serial {
    name: String,
    port: Box<dyn SerialPort>,
}

impl Serial {
    /// Opens the port (`/dev/ttyUSB0`, `/dev/serial/by-id/…`) for this program alone. What had arrived before is
    /// dropped.
    ///
    /// # Errors
    /// [`TransportError::NotFound`], [`TransportError::Refused`] (no permission, or another program has it), or
    /// [`TransportError::Io`].
    pub fn open(path: &str, baud: u32) -> Result<Self, TransportError> {
        let port = serialport::new(path, baud)
            .timeout(Duration::from_millis(20))
            .open()
            .map_err(|error| explain_open(path, error))?;
        let this = Self { name: path.to_owned(), port };
        this.port
            .clear(serialport::ClearBuffer::Input)
            .map_err(|error| TransportError::from_io("clear", path, error.into()))?;
        Ok(this)
    }

    /// A port that is open already, such as one end of a pty pair.
    pub fn from_port(port: Box<dyn SerialPort>) -> Self {
        Self { name: port.name().unwrap_or_else(|| "serial port".to_owned()), port }
    }

    /// The path of the port.
    pub fn name(&self) -> &str {
        &self.name
    }
}

/// Explains a failed opening to the person at the desk.
pub(crate) fn explain_open(path: &str, error: serialport::Error) -> TransportError {
    use serialport::ErrorKind as Kind;
    let reason = error.to_string();
    match error.kind() {
        Kind::Io(io::ErrorKind::PermissionDenied) => TransportError::Refused {
            what: path.to_owned(),
            reason,
            hint: "install udev/70-sunglint.rules and plug the device in again, or join the port's group (often `dialout`) and log in again".to_owned(),
        },
        Kind::Io(io::ErrorKind::NotFound) => not_found(path),
        // serialport says NoDevice both for a missing port and for one that another program holds.
        Kind::NoDevice if !std::path::Path::new(path).exists() => not_found(path),
        Kind::NoDevice => TransportError::Refused {
            what: path.to_owned(),
            reason,
            hint: "close the other program that has it open".to_owned(),
        },
        // ENOTTY, of which serialport keeps nix's words only.
        _ if is_no_port(&reason) => {
            TransportError::Refused {
                what: path.to_owned(),
                reason,
                hint: "it is no serial port; name one, such as /dev/ttyUSB0".to_owned(),
            }
        }
        Kind::InvalidInput => TransportError::Refused {
            what: path.to_owned(),
            reason,
            hint: "name a serial port, such as /dev/ttyUSB0, and a speed that it has".to_owned(),
        },
        _ => TransportError::Io { action: "open", what: path.to_owned(), source: error.into() },
    }
}

fn is_no_port(reason: &str) -> bool {
    ["Not a typewriter", "Inappropriate ioctl"].iter().any(|words| reason.contains(words))
}

fn not_found(path: &str) -> TransportError {
    TransportError::NotFound {
        what: path.to_owned(),
        hint: "check cable and power; /dev/serial/by-id lists the ports that are there".to_owned(),
    }
}

impl Blocking for Serial {
    fn name(&self) -> &str {
        &self.name
    }

    fn read_within(&mut self, buffer: &mut [u8], time: Duration) -> io::Result<usize> {
        self.port.set_timeout(time)?;
        self.port.read(buffer)
    }

    fn write_within(&mut self, bytes: &[u8], time: Duration) -> io::Result<usize> {
        self.port.set_timeout(time)?;
        self.port.write(bytes)
    }
}

impl Bytes for Serial {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        stream::send(self, bytes, deadline)
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        stream::receive(self, buffer, deadline)
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        stream::discard(self, deadline)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the words that a person needs; the kinds are those that serialport 4.10 gives for EACCES and for a port
    /// that another program holds.
    #[test]
    fn a_refused_port_says_what_to_do() {
        let denied = serialport::Error::new(
            serialport::ErrorKind::Io(io::ErrorKind::PermissionDenied),
            "Permission denied",
        );
        assert_eq!(
            explain_open("/dev/ttyUSB0", denied).to_string(),
            "/dev/ttyUSB0 cannot be opened: Permission denied; install udev/70-sunglint.rules and plug the device in again, or join the port's group (often `dialout`) and log in again"
        );
        let missing = Serial::open("/dev/no-such-port", 9600).unwrap_err();
        assert!(matches!(missing, TransportError::NotFound { .. }), "{missing}");
        let plain = tempfile::NamedTempFile::new().unwrap();
        let not_a_port = Serial::open(plain.path().to_str().unwrap(), 9600).unwrap_err();
        assert!(not_a_port.to_string().contains("open"), "{not_a_port}");
    }
}
