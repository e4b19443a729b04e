//! USB control and bulk transfers, by [`rusb`] (libusb, built in).

use super::stream::RealEnd;
use super::transfer::MOST_TRANSFERRED;
use super::{Transfer, Transfers, TransportError, whole_ms};
use crate::clock::Deadline;
use rusb::{Context, DeviceHandle, UsbContext as _};
use std::time::Duration;

/// An open USB device with one claimed interface.
#[derive(Debug)]
pub struct Usb {
    name: String,
    handle: DeviceHandle<Context>,
}

impl Usb {
    /// Opens the first device with these numbers (and this serial number, if given) and claims `interface`; a kernel
    /// driver that holds it is set aside meanwhile.
    ///
    /// # Errors
    /// [`TransportError::NotFound`], [`TransportError::Refused`] (no permission, or another program has it), or
    /// [`TransportError::Io`].
    pub fn open(
        vendor: u16,
        product: u16,
        serial: Option<&str>,
        interface: u8,
    ) -> Result<Self, TransportError> {
        let name = match serial {
            Some(serial) => {
                format!("USB device {vendor:04x}:{product:04x} (serial number {serial})")
            }
            None => format!("USB device {vendor:04x}:{product:04x}"),
        };
        let fail = |error| explain(error, "open", &name, "");
        let mut refused = None;
        // Not rusb's global context: that one panics on a machine without USB.
        let context = Context::new().map_err(|error| explain(error, "use USB for", &name, ""))?;
        for device in context.devices().map_err(fail)?.iter() {
            let Ok(about) = device.device_descriptor() else { continue };
            if (about.vendor_id(), about.product_id()) != (vendor, product) {
                continue;
            }
            let handle = match device.open() {
                Ok(handle) => handle,
                Err(error) => {
                    refused = Some(error);
                    continue;
                }
            };
            let is_it = match serial {
                Some(wanted) => handle
                    .read_serial_number_string_ascii(&about)
                    .is_ok_and(|found| found == wanted),
                None => true,
            };
            if is_it {
                claim(&handle, interface).map_err(fail)?;
                return Ok(Self { name, handle });
            }
        }
        Err(fail(refused.unwrap_or(rusb::Error::NotFound)))
    }

    /// The device's numbers, as messages name it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The open device, for its descriptors.
    pub fn handle(&self) -> &DeviceHandle<Context> {
        &self.handle
    }

    fn once(&self, transfer: &Transfer, time: Duration) -> Result<Vec<u8>, rusb::Error> {
        let room = transfer.room().unwrap_or(0);
        let mut answer = vec![0; room];
        let count = match transfer {
            Transfer::ControlIn { request_type, request, value, index, .. } => self
                .handle
                .read_control(*request_type, *request, *value, *index, &mut answer, time)?,
            Transfer::ControlOut { request_type, request, value, index, data } => {
                let count = self.handle.write_control(
                    *request_type,
                    *request,
                    *value,
                    *index,
                    data,
                    time,
                )?;
                return whole(count, data);
            }
            Transfer::BulkIn { endpoint, .. } => {
                self.handle.read_bulk(*endpoint, &mut answer, time)?
            }
            Transfer::BulkOut { endpoint, data } => {
                let count = self.handle.write_bulk(*endpoint, data, time)?;
                return whole(count, data);
            }
            Transfer::ClearHalt { endpoint } => {
                self.handle.clear_halt(*endpoint)?;
                0
            }
            _ => return Err(rusb::Error::NotSupported),
        };
        answer.truncate(count);
        Ok(answer)
    }
}

/// Claims an interface from whatever kernel driver holds it; on a system that cannot set drivers aside, one that is free.
fn claim(handle: &DeviceHandle<Context>, interface: u8) -> Result<(), rusb::Error> {
    let _ = handle.set_auto_detach_kernel_driver(true);
    match handle.claim_interface(interface) {
        Err(rusb::Error::Other | rusb::Error::NotSupported) => {
            // A driver that holds it is told as such (busy).
            let _ = handle.set_auto_detach_kernel_driver(false);
            handle.claim_interface(interface)
        }
        claimed => claimed,
    }
}

/// Half a request is no request.
fn whole(count: usize, data: &[u8]) -> Result<Vec<u8>, rusb::Error> {
    if count == data.len() { Ok(Vec::new()) } else { Err(rusb::Error::Timeout) }
}

/// Explains libusb's error to the person at the desk.
pub(crate) fn explain(
    error: rusb::Error,
    action: &'static str,
    what: &str,
    transfer: &str,
) -> TransportError {
    let refused = |hint: &str| TransportError::Refused {
        what: what.to_owned(),
        reason: error.to_string(),
        hint: hint.to_owned(),
    };
    match error {
        rusb::Error::Access => {
            refused("install udev/70-sunglint.rules and plug the device in again")
        }
        rusb::Error::Busy => refused("close the other program that has it open"),
        rusb::Error::NotFound if action == "open" => TransportError::NotFound {
            what: what.to_owned(),
            hint: "check cable and power; `lsusb` lists the devices that are there".to_owned(),
        },
        rusb::Error::NoDevice => TransportError::disconnected(what),
        rusb::Error::Pipe => TransportError::Stalled { transfer: transfer.to_owned() },
        rusb::Error::NotSupported => {
            TransportError::Unsupported { what: what.to_owned(), transfer: transfer.to_owned() }
        }
        other => TransportError::Io {
            action,
            what: what.to_owned(),
            source: std::io::Error::other(other),
        },
    }
}

impl Transfers for Usb {
    fn transfer(
        &mut self,
        transfer: &Transfer,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, TransportError> {
        if transfer.room().unwrap_or(0) > MOST_TRANSFERRED {
            return Err(explain(rusb::Error::NotSupported, "", &self.name, &transfer.to_string()));
        }
        let end = RealEnd::of(deadline)?;
        loop {
            // A bulk read that got nothing in its slice has taken nothing and may be asked again, so that the token is
            // looked at; any other transfer is made once and may take what is left.
            let time = match transfer {
                Transfer::BulkIn { .. } => end.slice(deadline)?,
                _ => deadline.remaining()?,
            };
            let time = Duration::from_millis(whole_ms(time).into());
            match self.once(transfer, time) {
                Ok(answer) => return Ok(answer),
                Err(rusb::Error::Timeout) => match transfer {
                    Transfer::BulkIn { .. } => {}
                    _ => {
                        let after = deadline.elapsed();
                        return Err(TransportError::Timeout { after, got_so_far: Vec::new() });
                    }
                },
                Err(error) => {
                    return Err(explain(error, "talk to", &self.name, &transfer.to_string()));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: 0000:0000 is no device (USB-IF assigns no vendor 0). Where there is no USB at all (a container), libusb cannot start.
    #[test]
    fn a_missing_device_is_an_error() {
        let error = Usb::open(0, 0, None, 0).unwrap_err();
        assert!(
            matches!(error, TransportError::NotFound { .. } | TransportError::Io { .. }),
            "{error}"
        );
    }

    /// Truth: the meanings that libusb documents for its error codes (LIBUSB_ERROR_ACCESS, NO_DEVICE, PIPE …).
    #[test]
    fn libusb_errors_become_advice() {
        let of =
            |error| explain(error, "open", "USB device 1313:8078", "bulk-in endpoint=82 length=64");
        assert_eq!(
            of(rusb::Error::Access).to_string(),
            "USB device 1313:8078 cannot be opened: Access denied (insufficient permissions); install udev/70-sunglint.rules and plug the device in again"
        );
        assert!(matches!(of(rusb::Error::Busy), TransportError::Refused { .. }));
        assert!(matches!(of(rusb::Error::NotFound), TransportError::NotFound { .. }));
        assert!(matches!(of(rusb::Error::NoDevice), TransportError::Disconnected { .. }));
        assert!(matches!(of(rusb::Error::Pipe), TransportError::Stalled { .. }));
        assert!(matches!(of(rusb::Error::Overflow), TransportError::Io { .. }));
        assert!(whole(3, &[1, 2, 3]).is_ok() && whole(2, &[1, 2, 3]).is_err());
    }
}
