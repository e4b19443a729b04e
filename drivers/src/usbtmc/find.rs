//! Instruments on USB that have a USBTMC interface.

use super::Endpoints;
use crate::device::DeviceError;
use crate::transport::TransportError;
use crate::transport::usb::Usb;
use rusb::{Context, Device, Direction, TransferType, UsbContext as _};

/// The first interface of class FE (application), subclass 03 (test and measurement).
pub(crate) fn endpoints(device: &Device<Context>) -> Option<Endpoints> {
    let configuration =
        device.active_config_descriptor().or_else(|_| device.config_descriptor(0)).ok()?;
    configuration.interfaces().flat_map(|interface| interface.descriptors()).find_map(|found| {
        if (found.class_code(), found.sub_class_code()) != (0xfe, 0x03) {
            return None;
        }
        let bulk = |direction| {
            let mut all = found.endpoint_descriptors();
            let one = all.find(|endpoint| {
                endpoint.transfer_type() == TransferType::Bulk && endpoint.direction() == direction
            });
            one.map(|endpoint| endpoint.address())
        };
        let interface = found.interface_number();
        Some(Endpoints {
            interface,
            bulk_in: bulk(Direction::In)?,
            bulk_out: bulk(Direction::Out)?,
        })
    })
}

/// An instrument that is plugged in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Found {
    /// Vendor number.
    pub vendor: u16,
    /// Product number.
    pub product: u16,
    /// Serial number, if this user may ask for it.
    pub serial: Option<String>,
    /// Where it is spoken to.
    pub endpoints: Endpoints,
}

fn about(device: &Device<Context>) -> Option<Found> {
    let endpoints = endpoints(device)?;
    let descriptor = device.device_descriptor().ok()?;
    let handle = device.open().ok();
    let serial = handle.and_then(|handle| handle.read_serial_number_string_ascii(&descriptor).ok());
    let (vendor, product) = (descriptor.vendor_id(), descriptor.product_id());
    Some(Found { vendor, product, serial, endpoints })
}

/// Lists the instruments that are plugged in; `device` names what is looked for in errors.
///
/// # Errors
/// USB cannot be used here.
pub fn find(device: &'static str) -> Result<Vec<Found>, DeviceError> {
    let fail = |error: rusb::Error| {
        let source = std::io::Error::other(error);
        let what = "USB devices".to_owned();
        DeviceError::transport(device, TransportError::Io { action: "list", what, source })
    };
    let context = Context::new().map_err(fail)?;
    Ok(context.devices().map_err(fail)?.iter().filter_map(|device| about(&device)).collect())
}

/// Opens the one instrument with these numbers (vendor, product) and this serial number, as far as they are given.
///
/// # Errors
/// None or several such instruments, no permission, or another program has it.
pub fn open(
    device: &'static str,
    numbers: Option<(u16, u16)>,
    serial: Option<&str>,
) -> Result<(Usb, Endpoints), DeviceError> {
    let transport = |error| DeviceError::transport(device, error);
    let mut all = find(device)?;
    all.retain(|found| {
        numbers.is_none_or(|numbers| numbers == (found.vendor, found.product))
            && serial.is_none_or(|serial| found.serial.as_deref() == Some(serial))
    });
    let found = match all.as_slice() {
        [found] => found,
        [] => {
            return Err(transport(TransportError::NotFound {
                what: "an instrument with a USBTMC interface".to_owned(),
                hint: "check cable, power and permission; `lsusb` lists what is there".to_owned(),
            }));
        }
        several => {
            let places = several.iter().map(|found| {
                let Found { vendor, product, serial, .. } = found;
                let serial = serial.as_ref().map_or_else(String::new, |s| format!(":{s}"));
                format!("usb:{vendor:04x}:{product:04x}{serial}")
            });
            return Err(transport(TransportError::NotFound {
                what: "which of several instruments to use".to_owned(),
                hint: format!("name one: {}", places.collect::<Vec<_>>().join(", ")),
            }));
        }
    };
    let usb = Usb::open(found.vendor, found.product, serial, found.endpoints.interface)
        .map_err(transport)?;
    Ok((usb, found.endpoints))
}
