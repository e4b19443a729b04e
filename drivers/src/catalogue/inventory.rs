//! Inventory of devices: what is plugged in, and what INDI servers have.

use super::{Bus, Listed, Plugged, listed, plugged};
use crate::clock::Deadline;
use crate::device::DeviceError;
use std::time::Duration;

/// An INDI server that was asked.
#[derive(Debug)]
pub struct IndiServer {
    /// Address of the server, `HOST[:PORT]`.
    pub host: String,
    /// Devices of the server, or why they are not known.
    pub devices: Result<Vec<Listed>, DeviceError>,
}

/// Inventory: what is plugged in, and what INDI servers have.
#[derive(Debug)]
pub struct Inventory {
    /// Serial ports, and USB and HID devices.
    pub plugged: Vec<Plugged>,
    /// Parts of the system that could not be asked, in words.
    pub faults: Vec<String>,
    /// The servers.
    pub servers: Vec<IndiServer>,
}

/// Lists what is plugged in (of USB and HID devices only those that a driver recognises, or `all`), and what each of the
/// servers, `HOST[:PORT]`, has; each may take `timeout`.
pub fn inventory(all: bool, servers: &[String], timeout: Duration) -> Inventory {
    let (mut found, faults) = plugged();
    found.retain(|one| all || one.bus == Bus::Serial || one.driver().is_some());
    let ask = |host: &String| IndiServer {
        host: host.clone(),
        devices: listed(host, &Deadline::within(timeout)),
    };
    Inventory { plugged: found, faults, servers: servers.iter().map(ask).collect() }
}
