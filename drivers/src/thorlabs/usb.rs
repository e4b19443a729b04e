//! The meters that are plugged in.

use super::DEVICE;
use crate::device::DeviceError;
use crate::transport::TransportError;
use crate::transport::usb::Usb;
use crate::usbtmc::{Endpoints, endpoints};
use rusb::{Context, Device, UsbContext as _};

/// Thorlabs' number.
pub const VENDOR: u16 = 0x1313;

/// Product numbers and their names: from Debian's USB database (2022), PM100A and PM160 from memory.
pub const PRODUCTS: [(u16, &str); 8] = [
    (0x8070, "PM100D"),
    (0x8072, "PM100USB"),
    (0x8075, "PM400"),
    (0x8076, "PM101"),
    (0x8078, "PM100D"),
    (0x8079, "PM100A"),
    (0x807b, "PM160"),
    (0x80b0, "PM200"),
];

/// A meter that is plugged in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Found {
    /// Product number of the meter.
    pub product: u16,
    /// The product's name.
    pub name: &'static str,
    /// Serial number of the meter, if this user may ask for it.
    pub serial: Option<String>,
    /// Where it is spoken to; `None` if it has no USBTMC interface: the vendor's driver switcher can give it one.
    pub endpoints: Option<Endpoints>,
}

fn about(device: &Device<Context>) -> Option<Found> {
    let descriptor = device.device_descriptor().ok()?;
    if descriptor.vendor_id() != VENDOR {
        return None;
    }
    let product = descriptor.product_id();
    let (_, name) = PRODUCTS.into_iter().find(|(number, _)| *number == product)?;
    let handle = device.open().ok();
    let serial = handle.and_then(|handle| handle.read_serial_number_string_ascii(&descriptor).ok());
    Some(Found { product, name, serial, endpoints: endpoints(device) })
}

/// The meters that are plugged in.
///
/// # Errors
/// USB cannot be used here.
pub fn find() -> Result<Vec<Found>, DeviceError> {
    let fail = |error: rusb::Error| {
        let source = std::io::Error::other(error);
        let what = "USB devices".to_owned();
        DeviceError::transport(DEVICE, TransportError::Io { action: "list", what, source })
    };
    let context = Context::new().map_err(fail)?;
    Ok(context.devices().map_err(fail)?.iter().filter_map(|device| about(&device)).collect())
}

/// Opens the first meter (or the one with this serial number), the kernel's own driver for it set aside, and gives it with
/// its endpoints, for [`Pm100::open`](super::Pm100::open).
///
/// # Errors
/// No meter, one without USBTMC, no permission, or another program has it.
pub fn open(serial: Option<&str>) -> Result<(Usb, Endpoints), DeviceError> {
    let transport = |error| DeviceError::transport(DEVICE, error);
    let mut all = find()?.into_iter();
    let found =
        all.find(|found| serial.is_none_or(|wanted| found.serial.as_deref() == Some(wanted)));
    let Some(found) = found else {
        let what = serial.map_or_else(String::new, |serial| format!(" {serial}"));
        return Err(transport(TransportError::NotFound {
            what: format!("{DEVICE}{what}"),
            hint: "check cable and power; `lsusb -d 1313:` lists those that are there".to_owned(),
        }));
    };
    let Some(endpoints) = found.endpoints else {
        return Err(transport(TransportError::Refused {
            what: found.name.to_owned(),
            reason: "it has no USBTMC interface".to_owned(),
            hint: "switch it to USBTMC with the vendor's driver switcher".to_owned(),
        }));
    };
    let usb = Usb::open(VENDOR, found.product, serial, endpoints.interface).map_err(transport)?;
    Ok((usb, endpoints))
}
