//! Servers in the network, and the devices of a server.

use super::answer::{Envelope, MOST_JSON};
use super::http::{Http, HttpError, Request};
use super::session::Place;
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::transport::Bytes;
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeSet;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::Duration;

const SERVER: &str = "Alpaca server";
/// Port on which servers answer who looks for them.
pub const DISCOVERY_PORT: u16 = 32_227;
const QUESTION: &[u8] = b"alpacadiscovery1";
/// Servers and devices that are listed at most.
const MOST: usize = 256;
/// Kinds of devices that are asked for where a server has no list of them.
const KINDS: [&str; 6] =
    ["telescope", "camera", "filterwheel", "rotator", "focuser", "safetymonitor"];

/// A device of a server, as its list has it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Configured {
    /// Name that people know it by.
    pub name: String,
    /// Kind in lower case (`telescope`).
    pub kind: String,
    /// Number among those of its kind.
    pub number: u32,
}

#[derive(Debug, Deserialize)]
struct Port {
    #[serde(rename = "AlpacaPort")]
    port: u16,
}

/// Asks the local network, and this computer, for Alpaca servers on UDP `port`, and gives those that answer within `time`, as `HOST:PORT`.
///
/// # Errors
/// The system lets nothing be sent.
pub fn discover(port: u16, time: Duration) -> Result<Vec<String>, std::io::Error> {
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
    socket.set_broadcast(true)?;
    let asked =
        [Ipv4Addr::BROADCAST, Ipv4Addr::LOCALHOST].map(|to| socket.send_to(QUESTION, (to, port)));
    // A computer without a network still has itself.
    let [network, own] = asked;
    if network.is_err() {
        own?;
    }
    let end = std::time::Instant::now() + time;
    let mut found = BTreeSet::new();
    let mut buffer = [0; 1024];
    while found.len() < MOST {
        let left = end.saturating_duration_since(std::time::Instant::now());
        if left.is_zero() {
            break;
        }
        socket.set_read_timeout(Some(left))?;
        match socket.recv_from(&mut buffer) {
            Ok((count, from)) => found.extend(server_of(&buffer[..count], from)),
            Err(error)
                if matches!(
                    error.kind(),
                    std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut
                ) => {}
            // An answer of the system to the question, such as a closed port.
            Err(error) if error.kind() == std::io::ErrorKind::ConnectionRefused => {}
            Err(error) => return Err(error),
        }
    }
    Ok(found.into_iter().collect())
}

/// The server of an answer; `None` where it is none.
pub fn server_of(answer: &[u8], from: SocketAddr) -> Option<String> {
    let Port { port } = serde_json::from_slice(answer).ok()?;
    (port > 0).then(|| SocketAddr::new(from.ip(), port).to_string())
}

/// The devices of a server: its list, or, where it has none, the first of each kind that answers.
///
/// # Errors
/// See [`DeviceError`].
pub fn configured<T: Bytes>(
    line: T,
    server: &str,
    deadline: &Deadline,
) -> Result<Vec<Configured>, DeviceError> {
    let mut http = Http::new(line, server);
    let mut get = |path: &str| {
        let request = Request {
            method: "GET",
            path,
            form: "",
            accept: "application/json",
            most_body: MOST_JSON,
            repeats: true,
        };
        http.exchange(&request, deadline).map_err(|error| match error {
            HttpError::Transport(error) => DeviceError::transport(SERVER, error),
            HttpError::Malformed(reason) => DeviceError::Protocol { device: SERVER, reason },
        })
    };
    let listed = get("/management/v1/configureddevices?ClientID=2108&ClientTransactionID=1")?;
    if listed.status == 200 {
        let envelope: Envelope<Value> = Envelope::parse(&listed.body)
            .map_err(|reason| DeviceError::Protocol { device: SERVER, reason })?;
        let all = envelope.value.as_ref().and_then(Value::as_array).cloned().unwrap_or_default();
        let of = |one: &Value| {
            let text = |name| one.get(name).and_then(Value::as_str).map(clean);
            let number = one.get("DeviceNumber").and_then(Value::as_u64)?;
            Some(Configured {
                name: text("DeviceName")?,
                kind: text("DeviceType")?.to_lowercase(),
                number: u32::try_from(number).ok()?,
            })
        };
        return Ok(all.iter().take(MOST).filter_map(of).collect());
    }
    let mut found = Vec::new();
    for kind in KINDS {
        let path = format!("/api/v1/{kind}/0/name?ClientID=2108&ClientTransactionID=1");
        let answer = get(&path)?;
        if answer.status != 200 {
            continue;
        }
        if let Ok(Envelope { error_number: 0, value: Some(Value::String(name)), .. }) =
            Envelope::<Value>::parse(&answer.body)
        {
            found.push(Configured { name: clean(&name), kind: kind.to_owned(), number: 0 });
        }
    }
    Ok(found)
}

fn clean(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(100).collect()
}

/// Whether the safety monitor at a place says that it is safe.
///
/// # Errors
/// See [`DeviceError`].
pub fn is_safe<T: Bytes>(line: T, place: &Place, deadline: &Deadline) -> Result<bool, DeviceError> {
    let label = ["Alpaca safety monitor", "safetymonitor"];
    let settings = super::session::SessionSettings::default();
    super::session::Session::open(line, place, label, settings, deadline)?.flag("issafe", deadline)
}
