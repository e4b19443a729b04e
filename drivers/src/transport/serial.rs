//! Serial ports, by [`serialport`]. Modem lines are used only where a device asks for them ([`PortSettings`]), and not
//! missed where there are none: ptys and many adapters have none.

use super::stream::{self, Blocking};
use super::{Bytes, TransportError};
use crate::clock::Deadline;
use serialport::SerialPort;
use std::io::{self, Read as _, Write as _};
use std::time::Duration;

/// Flow control of a serial port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Flow {
    /// None.
    #[default]
    None,
    /// By the modem lines RTS and CTS.
    RtsCts,
    /// By the bytes XON and XOFF, which a line of text does not hold otherwise.
    XonXoff,
}

/// Settings of a serial port. All have 8 data bits and no parity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PortSettings {
    /// Speed, bit/s.
    pub baud: u32,
    /// Flow control.
    pub flow: Flow,
    /// Whether there are 2 stop bits instead of 1.
    pub two_stop_bits: bool,
    /// Whether RTS is lifted after opening and both buffers are emptied 50 ms later, with another 50 ms before the first byte, as the
    /// makers of FTDI devices ask.
    pub lift_rts: bool,
}

impl PortSettings {
    /// A port at this speed, bit/s: 1 stop bit, no flow control.
    pub fn at(baud: u32) -> Self {
        Self { baud, flow: Flow::None, two_stop_bits: false, lift_rts: false }
    }
}

/// Pause before and after the buffers are emptied, where RTS is lifted.
const SETTLE: Duration = Duration::from_millis(50);

/// A serial port, 8 data bits, no parity.
#[derive(Debug)]
pub struct Serial {
    name: String,
    port: Box<dyn SerialPort>,
}

impl Serial {
    /// Opens the port (`/dev/ttyUSB0`, `/dev/serial/by-id/…`) for this program alone, without flow control. What had arrived before is
    /// dropped.
    ///
    /// # Errors
    /// [`TransportError::NotFound`], [`TransportError::Refused`] (no permission, or another program has it), or
    /// [`TransportError::Io`].
    pub fn open(path: &str, baud: u32) -> Result<Self, TransportError> {
        let settings = PortSettings::at(baud);
        Self::open_with(path, settings, &Deadline::within(Duration::from_secs(1)))
    }

    /// Opens the port as these settings say. A port without modem lines (a pty) is used without them.
    ///
    /// # Errors
    /// The errors of [`open`](Self::open); the deadline or its token while RTS settles.
    pub fn open_with(
        path: &str,
        settings: PortSettings,
        deadline: &Deadline,
    ) -> Result<Self, TransportError> {
        use serialport::{ClearBuffer, FlowControl, StopBits};
        let stop_bits = if settings.two_stop_bits { StopBits::Two } else { StopBits::One };
        let mut port = serialport::new(path, settings.baud)
            .timeout(Duration::from_millis(20))
            .stop_bits(stop_bits)
            .open()
            .map_err(|error| explain_open(path, error))?;
        let failed = |action| {
            move |error: serialport::Error| TransportError::from_io(action, path, error.into())
        };
        if settings.lift_rts {
            // Before the flow control is set, which takes RTS for itself.
            match port.write_request_to_send(true) {
                Err(error) if !has_no_modem_lines(&error.to_string()) => {
                    return Err(failed("lift RTS of")(error));
                }
                _ => {}
            }
            deadline.sleep(SETTLE)?;
            port.clear(ClearBuffer::All).map_err(failed("clear"))?;
            deadline.sleep(SETTLE)?;
        }
        let flow = match settings.flow {
            Flow::None => FlowControl::None,
            Flow::RtsCts => FlowControl::Hardware,
            Flow::XonXoff => FlowControl::Software,
        };
        if settings.flow != Flow::None {
            port.set_flow_control(flow).map_err(failed("set the flow control of"))?;
        }
        port.clear(ClearBuffer::Input).map_err(failed("clear"))?;
        Ok(Self { name: path.to_owned(), port })
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

/// ENOTTY, or EINVAL of older kernels, of which serialport keeps nix's words only.
fn has_no_modem_lines(reason: &str) -> bool {
    is_no_port(reason) || reason.contains("Invalid argument")
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

    /// Truth: a pty has no modem lines (ENOTTY) and takes the other settings; the bytes come through. The time is the
    /// deadline's: 50 ms before the buffers are emptied and 50 ms after, on a clock that is turned by hand.
    #[cfg(unix)]
    #[test]
    fn a_port_without_modem_lines_is_opened_all_the_same() {
        use crate::clock::{Clock as _, VirtualClock};
        use std::sync::Arc;
        let (mut device, host) = serialport::TTYPort::pair().unwrap();
        let path = host.name().unwrap();
        drop(host);
        for (flow, two_stop_bits) in
            [(Flow::RtsCts, false), (Flow::XonXoff, true), (Flow::None, false)]
        {
            let clock = Arc::new(VirtualClock::new());
            let deadline = Deadline::after(clock.clone(), Duration::from_secs(1));
            let settings =
                PortSettings { flow, two_stop_bits, lift_rts: true, ..PortSettings::at(115_200) };
            let mut port = Serial::open_with(&path, settings, &deadline).unwrap();
            assert_eq!(clock.now(), 2 * SETTLE);
            port.send(b"who", &Deadline::within(Duration::from_secs(5))).unwrap();
            let mut heard = [0; 3];
            device.read_exact(&mut heard).unwrap();
            assert_eq!(&heard, b"who");
            let soon = Deadline::after(clock.clone(), Duration::from_millis(60));
            let late = Serial::open_with("/dev/no-such-port", settings, &soon).unwrap_err();
            assert!(matches!(late, TransportError::NotFound { .. }), "{late}");
            drop(port);
            let late = Serial::open_with(&path, settings, &soon).unwrap_err();
            assert!(late.is_timeout(), "{late}");
        }
    }

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
