//! Devices of Alpaca servers.

use super::{
    Address, AddressError, AnyDevice, Driver, Kind, Line, Listed, OptionKind, OptionSpec, Wire,
};
use crate::alpaca::{
    Camera, Focuser, Mount, MountSettings, PORT, Place, Rotator, SessionSettings, Wheel, configured,
};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::transport::TransportError;
use crate::transport::tcp::Tcp;

const SERVER: &str = "Alpaca server";
/// Largest frame, MiB.
const FRAME_MIB: &str = "frame_mib";
const CAMERA_OPTIONS: &[OptionSpec] = &[OptionSpec {
    name: FRAME_MIB,
    kind: OptionKind::Integer(1, 4096),
    default: "128",
    about: "the largest frame that is taken, MiB: memory that a server can claim",
}];

const fn real(
    name: &'static str,
    kind: Kind,
    title: &'static str,
    example: &'static str,
    open: fn(Line, &Address, &Deadline) -> Result<AnyDevice, DeviceError>,
) -> Driver {
    Driver {
        name,
        kind,
        vendor: "ASCOM Alpaca",
        title,
        tried: "alpaca-simulators 1.3.2, live; no real device yet",
        simulated: false,
        place: super::Place { form: "HOST[:PORT]/NUMBER", example, optional: false },
        options: match kind {
            Kind::Camera => CAMERA_OPTIONS,
            _ => &[],
        },
        ids: &[],
        wire: Wire::Bytes,
        connect,
        open,
    }
}

/// Cameras.
pub(super) static CAMERA: Driver = real(
    "alpaca-camera",
    Kind::Camera,
    "cameras of ASCOM Alpaca servers",
    "alpaca-camera:localhost:11111/0",
    camera,
);
/// Rotators.
pub(super) static ROTATOR: Driver = real(
    "alpaca-rotator",
    Kind::RotationStage,
    "rotators of ASCOM Alpaca servers",
    "alpaca-rotator:localhost:11111/0",
    rotator,
);
/// Filter wheels.
pub(super) static WHEEL: Driver = real(
    "alpaca-wheel",
    Kind::FilterWheel,
    "filter wheels of ASCOM Alpaca servers",
    "alpaca-wheel:localhost:11111/0",
    wheel,
);
/// Focusers.
pub(super) static FOCUSER: Driver = real(
    "alpaca-focuser",
    Kind::Focuser,
    "focusers of ASCOM Alpaca servers",
    "alpaca-focuser:localhost:11111/0",
    focuser,
);
/// Telescope mounts.
pub(super) static TELESCOPE: Driver = real(
    "alpaca-telescope",
    Kind::Mount,
    "telescope mounts of ASCOM Alpaca servers (`alpaca:` for short)",
    "alpaca-telescope:localhost:11111/0",
    mount,
);

/// Drivers by ASCOM's names of the kinds.
static KINDS: [(&str, &Driver); 5] = [
    ("camera", &CAMERA),
    ("filterwheel", &WHEEL),
    ("rotator", &ROTATOR),
    ("focuser", &FOCUSER),
    ("telescope", &TELESCOPE),
];

/// The host with Alpaca's own port where none is named; an IPv6 address stands in brackets.
fn with_port(host: &str) -> Option<String> {
    let port = match host.rsplit_once(':') {
        Some((_, port)) if !host.ends_with(']') => port,
        _ => return Some(format!("{host}:{PORT}")).filter(|_| !host.is_empty()),
    };
    port.parse::<u16>().ok().filter(|port| *port > 0).map(|_| host.to_owned())
}

fn parse(text: &str) -> Result<Place, AddressError> {
    let wrong = |expected: &str| AddressError::new("Alpaca address", text, expected);
    let (host, number) = text.split_once('/').unwrap_or((text, "0"));
    // A host's name goes into a line of HTTP.
    if host.is_empty() || !host.bytes().all(|b| b.is_ascii_graphic() && b != b'/') {
        return Err(wrong("HOST:PORT/NUMBER"));
    }
    let server = with_port(host).ok_or_else(|| wrong("a port from 1 to 65535 behind the host"))?;
    let number: u32 =
        number.parse().map_err(|_| wrong("the device's number, from 0, behind the slash"))?;
    Ok(Place { server, number })
}

fn place(address: &Address) -> Result<Place, DeviceError> {
    parse(address.place.as_deref().unwrap_or("")).map_err(not_found)
}

fn not_found(error: AddressError) -> DeviceError {
    let AddressError { field, found, expected } = error;
    let (what, hint) = (format!("{field} `{found}`"), format!("give {expected}"));
    DeviceError::transport(SERVER, TransportError::NotFound { what, hint })
}

fn connect(address: &mut Address, deadline: &Deadline) -> Result<Line, DeviceError> {
    let line = Tcp::connect(&place(address)?.server, deadline);
    line.map(Line::bytes).map_err(|error| DeviceError::transport(SERVER, error))
}

/// The devices of the server at `HOST[:PORT]`.
///
/// # Errors
/// Nobody listens there, or see [`DeviceError`].
pub fn listed(host: &str, deadline: &Deadline) -> Result<Vec<Listed>, DeviceError> {
    let Place { server, .. } = parse(host).map_err(not_found)?;
    let line = Tcp::connect(&server, deadline);
    let line = line.map_err(|error| DeviceError::transport(SERVER, error))?;
    let all = configured(line, &server, deadline)?;
    let of = |one: crate::alpaca::Configured| {
        let driver = KINDS.iter().find(|(kind, _)| *kind == one.kind).map(|(_, driver)| driver);
        let addresses = driver.map(|d| format!("{}:{server}/{}", d.name, one.number));
        let driver = Some(one.kind);
        Listed { name: one.name, driver, addresses: addresses.into_iter().collect() }
    };
    Ok(all.into_iter().map(of).collect())
}

fn camera(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let mut settings = SessionSettings::default();
    if let Some(mib) = address.integer::<usize>(FRAME_MIB) {
        settings.frame_bytes = mib << 20;
    }
    let camera = Camera::open(line.into_bytes(SERVER)?, &place(address)?, settings, deadline)?;
    Ok(AnyDevice::Camera(Box::new(camera)))
}

fn rotator(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let settings = SessionSettings::default();
    let rotator = Rotator::open(line.into_bytes(SERVER)?, &place(address)?, settings, deadline)?;
    Ok(AnyDevice::RotationStage(Box::new(rotator)))
}

fn wheel(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let settings = SessionSettings::default();
    let wheel = Wheel::open(line.into_bytes(SERVER)?, &place(address)?, settings, deadline)?;
    Ok(AnyDevice::FilterWheel(Box::new(wheel)))
}

fn focuser(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let settings = SessionSettings::default();
    let focuser = Focuser::open(line.into_bytes(SERVER)?, &place(address)?, settings, deadline)?;
    Ok(AnyDevice::Focuser(Box::new(focuser)))
}

fn mount(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let settings = MountSettings::default();
    let mount = Mount::open(line.into_bytes(SERVER)?, &place(address)?, settings, deadline)?;
    Ok(AnyDevice::Mount(Box::new(mount)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: Alpaca's usual port is 11111 and devices count from 0 (ASCOM's API).
    #[test]
    fn hosts_ports_and_numbers_are_told_apart() {
        let of = |text| parse(text).map(|place| (place.server, place.number)).unwrap();
        assert_eq!(of("lab"), ("lab:11111".into(), 0));
        assert_eq!(of("lab:99/2"), ("lab:99".into(), 2));
        assert_eq!(of("[::1]/1"), ("[::1]:11111".into(), 1));
        assert_eq!(of("[::1]:5/1"), ("[::1]:5".into(), 1));
        for wrong in
            ["", "/0", "lab:0/0", "lab:99999", "lab/x", "lab/-1", "lab/", "a b/0", "a\r\nb/0"]
        {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
