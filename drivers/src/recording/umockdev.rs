//! Recordings of USB and HID devices as [umockdev](https://github.com/martinpitt/umockdev) reads them, so that what was
//! recorded goes through the real libusb and hidraw code of a program that runs under `umockdev-run`.
//!
//! ```text
//! umockdev-run -d pm100.umockdev -i /dev/bus/usb/001/007=pm100.ioctl -- PROGRAM
//! umockdev-run -d pm100.umockdev -p /sys/devices/pci0000:00/0000:00:14.0/usb1/1-3=pm100.pcap -- PROGRAM
//! umockdev-run -d efw.umockdev -i /dev/hidraw7=efw.ioctl -- PROGRAM
//! ```
//!
//! Pauses are left out, and so is what a fake device cannot do: a silence ends the conversion with an error, as does a
//! disconnection. umockdev (0.17.16) compares the bytes that a program sends on USB, but not those of written HID feature
//! reports: compare these in the program. A program that asks for something else waits for ever: run it under `timeout`.

use super::{Event, Fault, Recording};
use crate::transport::Transfer;
use std::fmt::Write as _;

/// Event that umockdev cannot show.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{path}:{line}: `{event}` cannot be shown by umockdev: {reason}")]
#[non_exhaustive]
pub struct UmockdevError {
    /// The recording.
    pub path: String,
    /// Line of the recording; 0 for a recording that is no file.
    pub line: u64,
    /// Event in that line.
    pub event: String,
    /// Why not.
    pub reason: &'static str,
}

/// A request of a recording, with what the device made of it.
struct Exchange<'a> {
    line: u64,
    transfer: &'a Transfer,
    /// `Err` if it stalled.
    answer: Result<&'a [u8], ()>,
}

impl Exchange<'_> {
    fn refuse(&self, recording: &Recording, reason: &'static str) -> UmockdevError {
        refuse(recording, self.line, self.transfer, reason)
    }
}

fn refuse(
    recording: &Recording,
    line: u64,
    event: impl std::fmt::Display,
    reason: &'static str,
) -> UmockdevError {
    let (path, event) = (recording.path.display().to_string(), event.to_string());
    UmockdevError { path, line, event, reason }
}

/// Requests with their answers.
fn exchanges(recording: &Recording) -> Result<Vec<Exchange<'_>>, UmockdevError> {
    let events = recording.events.iter().filter(|(_, event)| !matches!(event, Event::Pause(_)));
    let mut exchanges: Vec<Exchange<'_>> = Vec::new();
    // Whether the last request still waits for its answer.
    let mut open = false;
    for (line, event) in events {
        let fail = |reason| Err(refuse(recording, *line, event, reason));
        match (event, exchanges.last_mut()) {
            (Event::Asked(transfer), _) => {
                if open {
                    return fail("the request before it has no answer");
                }
                open = transfer.room().is_some();
                exchanges.push(Exchange { line: *line, transfer, answer: Ok(&[]) });
            }
            (Event::Received(data), Some(last)) if open => {
                last.answer = Ok(data);
                open = false;
            }
            (Event::Fault(Fault::Stall), Some(last)) => {
                last.answer = Err(());
                open = false;
            }
            (Event::Fault(_), _) => {
                return fail("a fake device neither stays silent nor goes away");
            }
            _ => return fail("it belongs to no request"),
        }
    }
    Ok(exchanges)
}

/// EPIPE, as the kernel tells a stalled transfer.
const STALLED: i32 = -32;

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02X}");
        text
    })
}

/// A USB device with one interface that has a bulk endpoint in either direction, on bus 1 as device 7.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UsbDevice {
    /// Vendor's number.
    pub vendor: u16,
    /// Product's number.
    pub product: u16,
    /// Vendor's name.
    pub manufacturer: String,
    /// Product's name.
    pub name: String,
    /// Serial number.
    pub serial: String,
    /// Class, subclass and protocol of the interface.
    pub class: [u8; 3],
    /// Address of the endpoint from the device, bit 7 set.
    pub bulk_in: u8,
    /// Address of the endpoint to the device.
    pub bulk_out: u8,
}

impl UsbDevice {
    /// The device's file.
    pub const NODE: &'static str = "/dev/bus/usb/001/007";
    /// Folder of the device in sysfs.
    pub const SYSFS: &'static str = "/sys/devices/pci0000:00/0000:00:14.0/usb1/1-3";
    const BUS: u16 = 1;
    const DEVICE: u8 = 7;

    /// Device, configuration, interface and endpoint descriptors (USB 2.0, tables 9-8 to 9-13).
    fn descriptors(&self) -> Vec<u8> {
        let [[v0, v1], [p0, p1]] = [self.vendor.to_le_bytes(), self.product.to_le_bytes()];
        let mut all = vec![18, 1, 0, 2, 0, 0, 0, 64, v0, v1, p0, p1, 0, 1, 1, 2, 3, 1];
        all.extend([9, 2, 9 + 9 + 7 + 7, 0, 1, 1, 0, 0xc0, 50]);
        let [class, subclass, protocol] = self.class;
        all.extend([9, 4, 0, 0, 2, class, subclass, protocol, 0]);
        for endpoint in [self.bulk_in, self.bulk_out] {
            all.extend([7, 5, endpoint, 2, 0, 2, 0]);
        }
        all
    }

    /// The `.umockdev` description.
    pub fn description(&self) -> String {
        let (vendor, product) = (self.vendor, self.product);
        let sysfs = Self::SYSFS.trim_start_matches("/sys");
        format!(
            "P: {sysfs}\nN: bus/usb/001/007\nE: DEVNAME={}\nE: DEVTYPE=usb_device\nE: MAJOR=189\nE: MINOR=6\nE: SUBSYSTEM=usb\n\
             E: BUSNUM=001\nE: DEVNUM=007\nE: PRODUCT={vendor:x}/{product:x}/100\nA: bConfigurationValue=1\nA: bDeviceClass=00\n\
             A: bNumConfigurations=1\nA: busnum=1\\n\nA: devnum=7\\n\nA: idVendor={vendor:04x}\nA: idProduct={product:04x}\n\
             A: manufacturer={}\nA: product={}\nA: serial={}\nA: speed=480\nH: descriptors={}\n",
            Self::NODE,
            self.manufacturer,
            self.name,
            self.serial,
            hex(&self.descriptors()),
        )
    }

    /// The `.ioctl` file of a conversation in bulk transfers; clearing a halted endpoint always succeeds there.
    ///
    /// # Errors
    /// Control transfers ([`pcap`](Self::pcap) holds those), HID reports, silence, a disconnection.
    pub fn ioctl(&self, recording: &Recording) -> Result<String, UmockdevError> {
        let mut text = format!("@DEV {}\nUSBDEVFS_CONNECTINFO 0 0700000000000000\n", Self::NODE);
        let mut depth = 0;
        for exchange in exchanges(recording)? {
            let (endpoint, sent, room) = match exchange.transfer {
                Transfer::BulkOut { endpoint, data } => (endpoint, Some(data), data.len()),
                Transfer::BulkIn { endpoint, length } => (endpoint, None, *length),
                Transfer::ClearHalt { .. } => continue,
                _ => {
                    return Err(
                        exchange.refuse(recording, "only bulk transfers fit in an .ioctl file")
                    );
                }
            };
            let (status, answer) = exchange.answer.map_or((STALLED, &[][..]), |answer| (0, answer));
            let (actual, data) = match sent {
                Some(data) => (if status == 0 { data.len() } else { 0 }, data.as_slice()),
                None => (answer.len(), answer),
            };
            // Each step hangs below the one before, a space deeper, so that they are gone through in order.
            let _ = writeln!(
                text,
                "{:depth$}USBDEVFS_REAPURBNDELAY 0 3 {endpoint} {status} 0 {room} {actual} 0 {}",
                "",
                hex(data)
            );
            depth += 1;
        }
        Ok(text)
    }

    /// The conversation as a capture of Linux's usbmon (pcap, link type 220): control transfers too.
    ///
    /// # Errors
    /// HID reports, silence, a disconnection.
    pub fn pcap(&self, recording: &Recording) -> Result<Vec<u8>, UmockdevError> {
        const USB_LINUX_MMAPPED: u32 = 220;
        let mut file = Vec::new();
        file.extend(0xa1b2_c3d4_u32.to_le_bytes());
        file.extend([2, 0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        file.extend(u32::from(u16::MAX).to_le_bytes());
        file.extend(USB_LINUX_MMAPPED.to_le_bytes());
        let mut id = 1_u64;
        for exchange in exchanges(recording)? {
            let no_setup = [0; 8];
            let (kind, endpoint, sent, room, setup) = match exchange.transfer {
                Transfer::BulkOut { endpoint, data } => {
                    (3, *endpoint, data.as_slice(), data.len(), no_setup)
                }
                Transfer::BulkIn { endpoint, length } => (3, *endpoint, &[][..], *length, no_setup),
                Transfer::ControlIn { request_type, request, value, index, length } => {
                    let setup = setup(*request_type, *request, *value, *index, *length);
                    (2, 0x80, &[][..], usize::from(*length), setup)
                }
                Transfer::ControlOut { request_type, request, value, index, data } => {
                    let length = u16::try_from(data.len()).map_err(|_| {
                        exchange.refuse(recording, "a control transfer has at most 65,535 bytes")
                    })?;
                    let setup = setup(*request_type, *request, *value, *index, length);
                    (2, 0, data.as_slice(), data.len(), setup)
                }
                Transfer::ClearHalt { .. } => continue,
                _ => {
                    return Err(exchange.refuse(recording, "HID reports are no USB transfers here"));
                }
            };
            let (status, answer) = exchange.answer.map_or((STALLED, &[][..]), |answer| (0, answer));
            let packet = |event, status, length: usize, data: &[u8], is_control| Packet {
                id,
                event,
                kind,
                endpoint,
                status,
                length,
                data: data.to_vec(),
                setup: if is_control { Some(setup) } else { None },
            };
            let actual = if endpoint & 0x80 != 0 { answer.len() } else { sent.len() };
            packet(b'S', -115, room, sent, kind == 2).write(&mut file);
            packet(b'C', status, actual, answer, false).write(&mut file);
            id += 1;
        }
        Ok(file)
    }
}

/// A setup packet (USB 2.0, table 9-2).
fn setup(request_type: u8, request: u8, value: u16, index: u16, length: u16) -> [u8; 8] {
    let [[v0, v1], [i0, i1], [l0, l1]] = [value, index, length].map(u16::to_le_bytes);
    [request_type, request, v0, v1, i0, i1, l0, l1]
}

/// A packet of usbmon (`struct mon_bin_hdr` in the kernel's Documentation/usb/usbmon.rst).
struct Packet {
    id: u64,
    event: u8,
    kind: u8,
    endpoint: u8,
    status: i32,
    length: usize,
    data: Vec<u8>,
    setup: Option<[u8; 8]>,
}

impl Packet {
    const HEADER: usize = 64;

    fn write(&self, file: &mut Vec<u8>) {
        // At most what a line of a recording holds, 1 MiB.
        let [length, captured] = [self.length, self.data.len()].map(|bytes| bytes as u32);
        let total = captured + Self::HEADER as u32;
        // The record's own header: time (the number of the exchange, ms), bytes in the file and on the wire.
        let (seconds, micros) = ((self.id / 1000) as u32, (self.id % 1000) as u32 * 1000);
        for word in [seconds, micros, total, total] {
            file.extend(word.to_le_bytes());
        }
        let mut header = Vec::with_capacity(Self::HEADER);
        header.extend(self.id.to_le_bytes());
        header.extend([self.event, self.kind, self.endpoint, UsbDevice::DEVICE]);
        header.extend(UsbDevice::BUS.to_le_bytes());
        header.push(if self.setup.is_some() { 0 } else { b'-' });
        header.push(if self.data.is_empty() { b'<' } else { 0 });
        header.extend(i64::from(seconds).to_le_bytes());
        header.extend(micros.to_le_bytes());
        header.extend(self.status.to_le_bytes());
        header.extend(length.to_le_bytes());
        header.extend(captured.to_le_bytes());
        header.extend(self.setup.unwrap_or_default());
        header.resize(Self::HEADER, 0);
        file.extend(header);
        file.extend(&self.data);
    }
}

/// A HID device on hidraw, as `/dev/hidraw7`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HidRaw {
    /// Vendor's number.
    pub vendor: u16,
    /// Product's number.
    pub product: u16,
    /// Product's name.
    pub name: String,
    /// The report descriptor.
    pub report_descriptor: Vec<u8>,
}

impl HidRaw {
    /// The device's file.
    pub const NODE: &'static str = "/dev/hidraw7";

    /// The `.umockdev` description.
    pub fn description(&self) -> String {
        let (vendor, product, name) = (self.vendor, self.product, &self.name);
        let usb = "/devices/pci0000:00/0000:00:14.0/usb1/1-4";
        let hid = format!("{usb}/1-4:1.0/0003:{vendor:04X}:{product:04X}.0001");
        let raw = format!(
            "P: {hid}/hidraw/hidraw7\nN: hidraw7\nE: DEVNAME={}\nE: MAJOR=241\nE: MINOR=7\nE: SUBSYSTEM=hidraw\nA: dev=241:7\\n\n",
            Self::NODE
        );
        let hid = format!(
            "P: {hid}\nE: DRIVER=hid-generic\nE: HID_ID=0003:{vendor:08X}:{product:08X}\nE: HID_NAME={name}\n\
             E: HID_PHYS=usb-0000:00:14.0-4/input0\nE: HID_UNIQ=\nE: SUBSYSTEM=hid\nH: report_descriptor={}\n",
            hex(&self.report_descriptor)
        );
        let interface = format!(
            "P: {usb}/1-4:1.0\nE: DEVTYPE=usb_interface\nE: SUBSYSTEM=usb\nA: bInterfaceNumber=00\\n\n"
        );
        let usb = format!(
            "P: {usb}\nN: bus/usb/001/008\nE: DEVNAME=/dev/bus/usb/001/008\nE: DEVTYPE=usb_device\nE: SUBSYSTEM=usb\n\
             E: BUSNUM=001\nE: DEVNUM=008\nA: busnum=1\\n\nA: devnum=8\\n\nA: idVendor={vendor:04x}\\n\nA: idProduct={product:04x}\\n\n\
             A: manufacturer=\\n\nA: product={name}\\n\nA: bcdDevice=0100\\n\n"
        );
        [raw, hid, interface, usb].join("\n")
    }

    /// The `.ioctl` file: the report descriptor, and the feature reports in their order.
    ///
    /// # Errors
    /// USB transfers, input and output reports ([`script`](Self::script) holds those), silence, a disconnection.
    pub fn ioctl(&self, recording: &Recording) -> Result<String, UmockdevError> {
        /// Bytes of `struct hidraw_report_descriptor`.
        const DESCRIPTOR: usize = 4100;
        let size = u32::try_from(self.report_descriptor.len()).unwrap_or(u32::MAX).to_le_bytes();
        let mut descriptor = [&size, self.report_descriptor.as_slice()].concat();
        descriptor.resize(DESCRIPTOR, 0);
        let mut text = format!("@DEV {}\nHIDIOCGRDESCSIZE 0 {}\n", Self::NODE, hex(&size));
        let _ = writeln!(text, "HIDIOCGRDESC 0 {}", hex(&descriptor));
        for (depth, exchange) in exchanges(recording)?.iter().enumerate() {
            let (name, data, room) = match (exchange.transfer, exchange.answer) {
                (Transfer::FeatureSet { data }, Ok(_)) => ("HIDIOCSFEATURE", data.as_slice(), 0),
                (Transfer::FeatureGet { length, .. }, Ok(answer)) => {
                    ("HIDIOCGFEATURE", answer, *length)
                }
                _ => {
                    return Err(
                        exchange.refuse(recording, "only feature reports fit in this .ioctl file")
                    );
                }
            };
            // The kernel's number of the request holds the room that is asked for, so all of it stands here.
            let rest = "00".repeat(room.saturating_sub(data.len()));
            let _ = writeln!(text, "{:depth$}{name} {} {}{rest}", "", data.len(), hex(data));
        }
        Ok(text)
    }

    /// The `.script` file: output reports, which are compared, and input reports, each after its pause.
    ///
    /// # Errors
    /// USB transfers, feature reports, silence, a disconnection.
    pub fn script(recording: &Recording) -> Result<Vec<u8>, UmockdevError> {
        let mut script = Vec::new();
        for exchange in exchanges(recording)? {
            let (mark, data) = match (exchange.transfer, exchange.answer) {
                (Transfer::ReportOut { data }, Ok(_)) => (b"w 0 ", data.as_slice()),
                (Transfer::ReportIn { .. }, Ok(answer)) => (b"r 0 ", answer),
                _ => {
                    return Err(
                        exchange.refuse(recording, "only input and output reports fit in a script")
                    );
                }
            };
            script.extend_from_slice(mark);
            for byte in data {
                // umockdev's escapes: a caret before a control character raised by 64, and for the caret itself.
                match byte {
                    0..=32 => script.extend([b'^', byte + 64]),
                    b'^' => script.extend(b"^`"),
                    other => script.push(*other),
                }
            }
            script.push(b'\n');
        }
        Ok(script)
    }
}
