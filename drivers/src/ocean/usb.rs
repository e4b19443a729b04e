//! OBP on USB: frames on two bulk endpoints.

use super::DEVICE;
use super::obp::{HEAD, MOST_DATA, TAIL};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::transport::usb::Usb;
use crate::transport::{Bytes, MOST_DISCARDED, Transfer, Transfers, TransportError};
use rusb::{Context, UsbContext as _};
use std::collections::VecDeque;
use std::time::Duration;

/// Ocean Optics' number.
pub const VENDOR: u16 = 0x2457;
/// Product numbers and names of models that speak OBP with 16 bits a pixel, as seabreeze has them.
pub const PRODUCTS: [(u16, &str); 3] =
    [(0x2003, "Ocean Optics HDX"), (0x4000, "Ocean Optics STS"), (0x5000, "Ocean Optics Ventana")];
/// Endpoints to the instrument and from it: of the HDX and STS. (The Ventana's second is 0x82: `open` looks.)
pub const ENDPOINTS: [u8; 2] = [0x01, 0x81];
/// A bulk read: a multiple of the packets of all speeds.
const ROOM: usize = (HEAD + MOST_DATA + TAIL).next_multiple_of(512);

/// A stream of bytes over bulk transfers.
pub struct Bulk<U> {
    usb: U,
    endpoints: [u8; 2],
    heard: VecDeque<u8>,
}

impl<U: Transfers> Bulk<U> {
    /// Speaks over these endpoints: to the instrument, and from it.
    pub fn new(usb: U, endpoints: [u8; 2]) -> Self {
        Self { usb, endpoints, heard: VecDeque::new() }
    }

    fn read(&mut self, deadline: &Deadline) -> Result<(), TransportError> {
        let transfer = Transfer::BulkIn { endpoint: self.endpoints[1], length: ROOM };
        self.heard.extend(self.usb.transfer(&transfer, deadline)?);
        Ok(())
    }
}

impl<U: Transfers> Bytes for Bulk<U> {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        let transfer = Transfer::BulkOut { endpoint: self.endpoints[0], data: bytes.to_vec() };
        self.usb.transfer(&transfer, deadline).map(|_| ())
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        if buffer.is_empty() {
            return Ok(0);
        }
        // A packet without data is nothing yet.
        while self.heard.is_empty() {
            self.read(deadline)?;
        }
        let count = buffer.len().min(self.heard.len());
        for (to, from) in buffer.iter_mut().zip(self.heard.drain(..count)) {
            *to = from;
        }
        Ok(count)
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        /// So long nothing comes: there is nothing.
        const QUIET: Duration = Duration::from_millis(2);
        while self.heard.len() < MOST_DISCARDED {
            deadline.remaining()?;
            match self.read(&deadline.at_most(QUIET)) {
                Ok(()) => {}
                Err(error) if error.is_timeout() => break,
                Err(error) => return Err(error),
            }
        }
        Ok(self.heard.drain(..).collect())
    }
}

/// The first of these products that is plugged in.
pub(super) fn plugged(products: &[u16]) -> Result<u16, DeviceError> {
    let transport = |error| DeviceError::transport(DEVICE, error);
    let fail = |error: rusb::Error| {
        let source = std::io::Error::other(error);
        let what = "USB devices".to_owned();
        transport(TransportError::Io { action: "list", what, source })
    };
    let context = Context::new().map_err(fail)?;
    let devices = context.devices().map_err(fail)?;
    let found = devices.iter().find_map(|device| {
        let about = device.device_descriptor().ok()?;
        let ours = about.vendor_id() == VENDOR && products.contains(&about.product_id());
        ours.then_some(about.product_id())
    });
    let missing = || {
        let hint = "check cable and power (`lsusb -d 2457:`); one on the network is named, such as ocean:tcp:192.168.1.20:57357";
        let hint = hint.to_owned();
        transport(TransportError::NotFound { what: DEVICE.to_owned(), hint })
    };
    found.ok_or_else(missing)
}

/// Opens the first instrument on OBP that is plugged in, with its endpoints.
///
/// # Errors
/// None, no permission, or another program has it.
pub fn open() -> Result<(Usb, [u8; 2]), DeviceError> {
    let (usb, product) = open_product(&PRODUCTS.map(|(product, _)| product))?;
    Ok((usb, endpoints(product)))
}

/// Endpoints of a product on OBP.
pub(crate) fn endpoints(product: u16) -> [u8; 2] {
    let ventana = product == PRODUCTS[2].0;
    if ventana { [0x01, 0x82] } else { ENDPOINTS }
}

/// Opens the first instrument with one of these product numbers that is plugged in, and gives its number.
///
/// # Errors
/// None, no permission, or another program has it.
pub fn open_product(products: &[u16]) -> Result<(Usb, u16), DeviceError> {
    let product = plugged(products)?;
    let usb = Usb::open(VENDOR, product, None, 0);
    let usb = usb.map_err(|error| DeviceError::transport(DEVICE, error))?;
    Ok((usb, product))
}
