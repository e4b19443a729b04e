//! Requests of the host on USB and HID, as plain data.

use super::TransportError;
use crate::clock::Deadline;
use std::fmt;

/// The most that one transfer carries, bytes.
pub const MOST_TRANSFERRED: usize = 1 << 20;

/// One request of the host and, where `length` or the kind says so, room for the device's answer.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Transfer {
    /// A USB control transfer from the device: the fields of its setup packet (USB 2.0, table 9-2).
    ControlIn {
        /// bmRequestType, bit 7 set.
        request_type: u8,
        /// bRequest.
        request: u8,
        /// wValue.
        value: u16,
        /// wIndex.
        index: u16,
        /// wLength, bytes.
        length: u16,
    },
    /// A USB control transfer to the device.
    ControlOut {
        /// bmRequestType, bit 7 clear.
        request_type: u8,
        /// bRequest.
        request: u8,
        /// wValue.
        value: u16,
        /// wIndex.
        index: u16,
        /// Bytes that are sent.
        data: Vec<u8>,
    },
    /// A USB bulk transfer from the device, of at most `length` bytes.
    BulkIn {
        /// Endpoint address, bit 7 set.
        endpoint: u8,
        /// Room for the answer, bytes.
        length: usize,
    },
    /// A USB bulk transfer to the device.
    BulkOut {
        /// Endpoint address, bit 7 clear.
        endpoint: u8,
        /// Bytes that are sent.
        data: Vec<u8>,
    },
    /// Clears a stalled USB endpoint.
    ClearHalt {
        /// Endpoint address.
        endpoint: u8,
    },
    /// Reads a HID input report of at most `length` bytes, its number first if the device numbers its reports.
    ReportIn {
        /// Room for the answer, bytes.
        length: usize,
    },
    /// Writes a HID output report; the first byte is the report's number (0 if the device has none).
    ReportOut {
        /// Bytes that are sent.
        data: Vec<u8>,
    },
    /// Reads a HID feature report.
    FeatureGet {
        /// The report's number.
        report: u8,
        /// Room for the answer, its number included, bytes.
        length: usize,
    },
    /// Writes a HID feature report; the first byte is the report's number.
    FeatureSet {
        /// Bytes that are sent.
        data: Vec<u8>,
    },
}

impl Transfer {
    /// Returns the bytes that the host sends with the request; `None` for requests that carry nothing.
    pub fn data(&self) -> Option<&[u8]> {
        match self {
            Self::ControlOut { data, .. }
            | Self::BulkOut { data, .. }
            | Self::ReportOut { data }
            | Self::FeatureSet { data } => Some(data),
            _ => None,
        }
    }

    /// Room for the device's answer, bytes; `None` for requests to which the device sends no data.
    pub fn room(&self) -> Option<usize> {
        match self {
            Self::ControlIn { length, .. } => Some(usize::from(*length)),
            Self::BulkIn { length, .. }
            | Self::ReportIn { length }
            | Self::FeatureGet { length, .. } => Some(*length),
            _ => None,
        }
    }
}

impl fmt::Display for Transfer {
    /// The request without its data, as recordings write it between brackets.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ControlIn { request_type, request, value, index, length } => write!(
                f,
                "control-in type={request_type:02x} request={request:02x} value={value:04x} index={index:04x} length={length}"
            ),
            Self::ControlOut { request_type, request, value, index, .. } => write!(
                f,
                "control-out type={request_type:02x} request={request:02x} value={value:04x} index={index:04x}"
            ),
            Self::BulkIn { endpoint, length } => {
                write!(f, "bulk-in endpoint={endpoint:02x} length={length}")
            }
            Self::BulkOut { endpoint, .. } => write!(f, "bulk-out endpoint={endpoint:02x}"),
            Self::ClearHalt { endpoint } => write!(f, "clear-halt endpoint={endpoint:02x}"),
            Self::ReportIn { length } => write!(f, "report-in length={length}"),
            Self::ReportOut { .. } => f.write_str("report-out"),
            Self::FeatureGet { report, length } => {
                write!(f, "feature-get report={report:02x} length={length}")
            }
            Self::FeatureSet { .. } => f.write_str("feature-set"),
        }
    }
}

/// A device that answers requests one by one.
pub trait Transfers: Send {
    /// Makes the request and gives what the device sent: nothing for requests to the device, at most
    /// [`room`](Transfer::room) bytes for requests from it (fewer is a short answer, and no error here).
    ///
    /// # Errors
    /// The deadline, the token, or the transport.
    fn transfer(
        &mut self,
        transfer: &Transfer,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, TransportError>;
}

impl<T: Transfers + ?Sized> Transfers for Box<T> {
    fn transfer(
        &mut self,
        transfer: &Transfer,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, TransportError> {
        (**self).transfer(transfer, deadline)
    }
}

impl<T: Transfers + ?Sized> Transfers for &mut T {
    fn transfer(
        &mut self,
        transfer: &Transfer,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, TransportError> {
        (**self).transfer(transfer, deadline)
    }
}
