//! Inventory of devices: what is plugged in, and what INDI and Alpaca servers have.

use super::{Bus, Listed, Plugged, alpaca, listed, plugged};
use crate::alpaca::{DISCOVERY_PORT, discover};
use crate::clock::Deadline;
use crate::device::DeviceError;
use std::time::Duration;

/// Word in place of an Alpaca server that asks the network which there are.
const ANY: &str = "any";
/// How long servers are waited for that are asked over the network.
const DISCOVERY: Duration = Duration::from_secs(2);

/// A server that was asked.
#[derive(Debug)]
pub struct ServerAsked {
    /// Address of the server, `HOST[:PORT]`.
    pub host: String,
    /// Devices of the server, or why they are not known.
    pub devices: Result<Vec<Listed>, DeviceError>,
}

/// Inventory: what is plugged in, and what servers have.
#[derive(Debug)]
pub struct Inventory {
    /// Serial ports, and USB and HID devices.
    pub plugged: Vec<Plugged>,
    /// Parts of the system that could not be asked, in words.
    pub faults: Vec<String>,
    /// The INDI servers.
    pub servers: Vec<ServerAsked>,
    /// The Alpaca servers.
    pub alpaca: Vec<ServerAsked>,
}

/// Lists what is plugged in (of USB and HID devices only those that a driver recognises, or `all`), and what each of the INDI and
/// Alpaca servers, `HOST[:PORT]`, has; each may take `timeout`. The Alpaca server `any` stands for those that answer in the network.
pub fn inventory(
    all: bool,
    indi: &[String],
    alpaca_hosts: &[String],
    timeout: Duration,
) -> Inventory {
    let (mut found, mut faults) = plugged();
    found.retain(|one| all || one.bus == Bus::Serial || one.driver().is_some());
    let within = || Deadline::within(timeout);
    let ask = |host: &String| ServerAsked { host: host.clone(), devices: listed(host, &within()) };
    let servers = indi.iter().map(ask).collect();
    let mut hosts: Vec<String> = Vec::new();
    for host in alpaca_hosts {
        if host != ANY {
            hosts.push(host.clone());
            continue;
        }
        match discover(DISCOVERY_PORT, DISCOVERY.min(timeout)) {
            Ok(seen) if seen.is_empty() => {
                faults.push("no Alpaca server answered in the network (UDP port 32227): name it, `--alpaca HOST:PORT`".into());
            }
            Ok(seen) => hosts.extend(seen),
            Err(error) => faults.push(format!("Alpaca servers cannot be looked for: {error}")),
        }
    }
    hosts.dedup();
    let ask = |host: String| ServerAsked { devices: alpaca::listed(&host, &within()), host };
    Inventory { plugged: found, faults, servers, alpaca: hosts.into_iter().map(ask).collect() }
}
