//! HID reports, feature reports included, by [`hidapi`] on the kernel's hidraw devices.

use super::stream::RealEnd;
use super::transfer::MOST_TRANSFERRED;
use super::{Transfer, Transfers, TransportError, whole_ms};
use crate::clock::Deadline;
use hidapi::{HidApi, HidDevice, HidError};
use std::ffi::CString;
use std::io;

/// An open HID device.
pub struct Hid {
    name: String,
    device: HidDevice,
}

impl Hid {
    /// Opens the first device with these numbers (and this serial number, if given).
    ///
    /// # Errors
    /// [`TransportError::NotFound`], [`TransportError::Refused`] (no permission), or [`TransportError::Io`].
    pub fn open(vendor: u16, product: u16, serial: Option<&str>) -> Result<Self, TransportError> {
        let name = format!("HID device {vendor:04x}:{product:04x}");
        let api = HidApi::new().map_err(|error| explain(error, "list", "HID devices"))?;
        let found = api.device_list().find(|about| {
            (about.vendor_id(), about.product_id()) == (vendor, product)
                && serial.is_none_or(|wanted| about.serial_number() == Some(wanted))
        });
        let Some(found) = found else { return Err(not_found(&name)) };
        let device = found.open_device(&api).map_err(|error| explain(error, "open", &name))?;
        Ok(Self { name, device })
    }

    /// Opens a device by its path (`/dev/hidraw0`).
    ///
    /// # Errors
    /// The errors of [`open`](Self::open).
    pub fn open_path(path: &str) -> Result<Self, TransportError> {
        let raw = CString::new(path).map_err(|_| not_found(path))?;
        let api = HidApi::new().map_err(|error| explain(error, "list", "HID devices"))?;
        let device = api.open_path(&raw).map_err(|error| explain(error, "open", path))?;
        Ok(Self { name: path.to_owned(), device })
    }

    /// The device, as messages name it.
    pub fn name(&self) -> &str {
        &self.name
    }
}

fn not_found(what: &str) -> TransportError {
    TransportError::NotFound {
        what: what.to_owned(),
        hint: "check cable and power; /dev/hidraw* are the devices that are there".to_owned(),
    }
}

/// Explains hidapi's error to the person at the desk.
pub(crate) fn explain(error: HidError, action: &'static str, what: &str) -> TransportError {
    let source = match error {
        HidError::IoError { error } => error,
        HidError::HidApiError { message } => match code_in(&message) {
            Some(code) => io::Error::from_raw_os_error(code),
            None => io::Error::other(message),
        },
        other => io::Error::other(other),
    };
    match source.kind() {
        io::ErrorKind::PermissionDenied => TransportError::Refused {
            what: what.to_owned(),
            reason: source.to_string(),
            hint: "install udev/70-sunglint.rules and plug the device in again".to_owned(),
        },
        io::ErrorKind::NotFound if action == "open" => not_found(what),
        _ => TransportError::from_io(action, what, source),
    }
}

/// The system's own code in a text of hidapi's: `…: Permission denied (os error 13)`, `ioctl (…): ENODEV: No such device`.
fn code_in(message: &str) -> Option<i32> {
    if let Some((_, code)) = message.split_once("(os error ") {
        return code.strip_suffix(')')?.parse().ok();
    }
    // Linux's numbers: the texts are those of its own backend.
    let names = [("ENOENT", 2), ("EIO", 5), ("ENXIO", 6), ("EACCES", 13), ("ENODEV", 19)];
    let of = |(name, _): &&(&str, i32)| message.contains(&format!(": {name}: "));
    names.iter().find(of).map(|(_, code)| *code)
}

impl Transfers for Hid {
    fn transfer(
        &mut self,
        transfer: &Transfer,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, TransportError> {
        let unsupported = || TransportError::Unsupported {
            what: self.name.clone(),
            transfer: transfer.to_string(),
        };
        let room = transfer.room().unwrap_or(0);
        if room > MOST_TRANSFERRED {
            return Err(unsupported());
        }
        let end = RealEnd::of(deadline)?;
        let mut answer = vec![0; room];
        match transfer {
            Transfer::ReportOut { data } => {
                let count = self
                    .device
                    .write(data)
                    .map_err(|error| explain(error, "write to", &self.name))?;
                if count < data.len() {
                    let short = HidError::IncompleteSendError { sent: count, all: data.len() };
                    return Err(explain(short, "write to", &self.name));
                }
            }
            Transfer::FeatureSet { data } => self
                .device
                .send_feature_report(data)
                .map_err(|error| explain(error, "write to", &self.name))?,
            Transfer::FeatureGet { report, .. } => {
                let Some(first) = answer.first_mut() else { return Err(unsupported()) };
                *first = *report;
                let count = self
                    .device
                    .get_feature_report(&mut answer)
                    .map_err(|error| explain(error, "read from", &self.name))?;
                answer.truncate(count);
            }
            Transfer::ReportIn { .. } => loop {
                let slice = i32::try_from(whole_ms(end.slice(deadline)?)).unwrap_or(i32::MAX);
                let count = self
                    .device
                    .read_timeout(&mut answer, slice)
                    .map_err(|error| explain(error, "read from", &self.name))?;
                if count > 0 {
                    answer.truncate(count);
                    break;
                }
            },
            _ => return Err(unsupported()),
        }
        Ok(answer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: EACCES is 13, ENODEV 19, EIO 5 on Linux (errno(3)).
    #[test]
    fn hid_errors_become_advice() {
        let of = |code| {
            let error = io::Error::from_raw_os_error(code);
            explain(HidError::IoError { error }, "open", "HID device 03c3:1f01")
        };
        assert_eq!(
            of(13).to_string(),
            "HID device 03c3:1f01 cannot be opened: Permission denied (os error 13); install udev/70-sunglint.rules and plug the device in again"
        );
        assert!(matches!(of(19), TransportError::Disconnected { .. }));
        assert!(matches!(of(5), TransportError::Disconnected { .. }));
        // The texts are those that hidapi 2.6.7 makes (linux_native.rs).
        let of_text = |message: &str, action| {
            let error = HidError::HidApiError { message: message.into() };
            explain(error, action, "HID device 03c3:1f01")
        };
        let gone = of_text("ioctl (GFEATURE): ENODEV: No such device", "read from");
        assert!(matches!(gone, TransportError::Disconnected { .. }), "{gone}");
        let denied =
            "failed to open device with path /dev/hidraw0: Permission denied (os error 13)";
        let denied = of_text(denied, "open");
        assert!(matches!(denied, TransportError::Refused { .. }), "{denied}");
        let text = HidError::HidApiError { message: "odd".into() };
        assert!(matches!(explain(text, "read from", "x"), TransportError::Io { .. }));
        let missing = Hid::open_path("/dev/no-such-hidraw").err().expect("it is not there");
        assert!(
            matches!(missing, TransportError::NotFound { .. } | TransportError::Io { .. }),
            "{missing}"
        );
    }
}
