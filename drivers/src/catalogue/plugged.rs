//! List of what is plugged in, which driver recognises it, and whether this user may have it.

use super::{Bus, Driver};
use hidapi::HidApi;
use rusb::UsbContext as _;
use std::path::Path;

/// Whether this user may read and write a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Yes.
    Granted,
    /// No.
    Denied,
    /// It cannot be told here.
    Unknown,
}

/// A device that is plugged in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plugged {
    /// How the system shows it.
    pub bus: Bus,
    /// Device file (`/dev/ttyACM0`), or what stands for it.
    pub path: String,
    /// Vendor's and product's numbers, if it is on USB.
    pub ids: Option<[u16; 2]>,
    /// Name that the device gives itself, as far as it could be asked.
    pub name: Option<String>,
    /// Serial number of the device, as far as it could be asked.
    pub serial: Option<String>,
    /// Whether this user may have it.
    pub access: Access,
}

impl Plugged {
    /// The driver that recognises it.
    pub fn driver(&self) -> Option<&'static Driver> {
        self.ids.and_then(|[vendor, product]| Driver::of(self.bus, vendor, product))
    }

    /// The address by which its driver opens it.
    pub fn address(&self) -> Option<String> {
        let driver = self.driver()?;
        let name = driver.name;
        let place = match self.bus {
            // Not every driver on USB tells its devices apart by a serial number.
            Bus::Usb => self.serial.as_deref().filter(|_| driver.place.form.contains("SERIAL")),
            Bus::Hid | Bus::Serial => Some(self.path.as_str()),
        };
        Some(place.map_or_else(|| name.to_owned(), |place| format!("{name}:{place}")))
    }
}

/// Lists what is plugged in on USB, HID and serial ports, in that order, and tells what could not be listed. Nothing is spoken to
/// but the system; on USB the names and serial numbers of known devices are asked for.
pub fn plugged() -> (Vec<Plugged>, Vec<String>) {
    let (mut all, mut trouble) = (Vec::new(), Vec::new());
    let mut add = |found: Result<Vec<Plugged>, String>, what: &str| match found {
        Ok(found) => all.extend(found),
        Err(reason) => trouble.push(format!("{what} cannot be listed: {reason}")),
    };
    let usb = usb().map_err(|error| format!("{error} (has this machine USB?)"));
    add(usb, "USB devices");
    add(hid().map_err(|error| error.to_string()), "HID devices");
    add(serial().map_err(|error| error.to_string()), "serial ports");
    (all, trouble)
}

fn usb() -> Result<Vec<Plugged>, rusb::Error> {
    let context = rusb::Context::new()?;
    let devices = context.devices()?;
    Ok(devices.iter().filter_map(|device| usb_device(&device)).collect())
}

fn usb_device(device: &rusb::Device<rusb::Context>) -> Option<Plugged> {
    let about = device.device_descriptor().ok()?;
    let ids = [about.vendor_id(), about.product_id()];
    let path = format!("/dev/bus/usb/{:03}/{:03}", device.bus_number(), device.address());
    let known = Driver::of(Bus::Usb, ids[0], ids[1]).is_some();
    // Others are left in peace.
    let handle = if known { device.open().ok() } else { None };
    let texts = handle.map(|handle| {
        let name = handle.read_product_string_ascii(&about).ok();
        (name, handle.read_serial_number_string_ascii(&about).ok())
    });
    let (name, serial) = texts.unwrap_or_default();
    let access = access(&path);
    Some(Plugged { bus: Bus::Usb, path, ids: Some(ids), name, serial, access })
}

fn hid() -> Result<Vec<Plugged>, hidapi::HidError> {
    let api = HidApi::new()?;
    let of = |text: Option<&str>| text.filter(|text| !text.is_empty()).map(str::to_owned);
    let all = api.device_list().map(|about| {
        let path = about.path().to_string_lossy().into_owned();
        Plugged {
            bus: Bus::Hid,
            ids: Some([about.vendor_id(), about.product_id()]),
            name: of(about.product_string()),
            serial: of(about.serial_number()),
            access: access(&path),
            path,
        }
    });
    let mut all: Vec<Plugged> = all.collect();
    // A device with several collections is listed once for each.
    all.dedup_by(|one, other| one.path == other.path);
    Ok(all)
}

fn serial() -> Result<Vec<Plugged>, serialport::Error> {
    // serialport's own look-up ends the program where there is no such folder (a container without /sys).
    if cfg!(target_os = "linux") && !Path::new("/sys/class/tty").is_dir() {
        return Ok(Vec::new());
    }
    let ports = serialport::available_ports()?.into_iter().map(|port| {
        let (ids, name, serial) = match port.port_type {
            serialport::SerialPortType::UsbPort(usb) => {
                (Some([usb.vid, usb.pid]), usb.product, usb.serial_number)
            }
            _ => (None, None, None),
        };
        let access = access(&port.port_name);
        Plugged { bus: Bus::Serial, path: port.port_name, ids, name, serial, access }
    });
    let mut ports: Vec<Plugged> = ports.collect();
    ports.sort_by(|one, other| one.path.cmp(&other.path));
    Ok(ports)
}

/// Asked of the system, without opening: opening a serial port may reset what is behind it.
fn access(path: &str) -> Access {
    #[cfg(unix)]
    {
        use nix::errno::Errno;
        use nix::unistd::AccessFlags;
        match nix::unistd::access(path, AccessFlags::R_OK | AccessFlags::W_OK) {
            Ok(()) => Access::Granted,
            Err(Errno::EACCES | Errno::EPERM | Errno::EROFS) => Access::Denied,
            Err(_) => Access::Unknown,
        }
    }
    #[cfg(not(unix))]
    {
        let _ = path;
        Access::Unknown
    }
}
