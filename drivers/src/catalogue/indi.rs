//! Devices behind an INDI server, and a simulated server's.

use super::{
    Address, AddressError, AnyDevice, Driver, Kind, Line, OptionKind, OptionSpec, Place, Wire,
};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::indi::{
    CameraSettings, Focuser, MountSettings, PORT, RotatorSettings, SessionSettings, open_camera,
    open_mount, open_rotator, open_wheel,
};
use crate::simulated::indi::{
    CameraSpec, Ramp, RotatorSpec, Server, ServerSettings, Simulated, WheelSpec,
};
use crate::transport::TransportError;
use crate::transport::tcp::Tcp;
use sunglint_formats::nearest_names;

const SERVER: &str = "INDI server";

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
        vendor: "INDI",
        title,
        tried: "the simulators of indi-bin 1.9.9, live; no real device yet",
        simulated: false,
        place: Place { form: "[HOST[:PORT]/]DEVICE", example, optional: false },
        options: match kind {
            Kind::Camera => CAMERA_OPTIONS,
            _ => NONE,
        },
        ids: &[],
        wire: Wire::Bytes,
        connect,
        open,
    }
}

const NONE: &[OptionSpec] = &[];
/// Largest frame, MiB.
const FRAME_MIB: &str = "frame_mib";
const CAMERA_OPTIONS: &[OptionSpec] = &[OptionSpec {
    name: FRAME_MIB,
    kind: OptionKind::Integer(1, 4096),
    default: "128",
    about: "the largest frame that is taken, MiB: memory that a server can claim",
}];

/// Cameras.
pub(super) static CAMERA: Driver = real(
    "indi-camera",
    Kind::Camera,
    "cameras behind an INDI server (Atik, ZWO, QHY, … by INDI's own drivers)",
    "indi-camera:localhost:7624/CCD Simulator",
    camera,
);
/// Rotators.
pub(super) static ROTATOR: Driver = real(
    "indi-rotator",
    Kind::RotationStage,
    "rotators behind an INDI server",
    "indi-rotator:localhost:7624/Rotator Simulator",
    rotator,
);
/// Filter wheels.
pub(super) static WHEEL: Driver = real(
    "indi-wheel",
    Kind::FilterWheel,
    "filter wheels behind an INDI server",
    "indi-wheel:localhost:7624/Filter Simulator",
    wheel,
);

/// Focusers.
pub(super) static FOCUSER: Driver = real(
    "indi-focuser",
    Kind::Focuser,
    "focusers behind an INDI server",
    "indi-focuser:localhost:7624/Focuser Simulator",
    focuser,
);

/// Telescope mounts.
pub(super) static TELESCOPE: Driver = real(
    "indi-telescope",
    Kind::Mount,
    "telescope mounts behind an INDI server",
    "indi-telescope:localhost:7624/Telescope Simulator",
    mount,
);

const fn simulated(
    name: &'static str,
    kind: Kind,
    title: &'static str,
    open: fn(Line, &Address, &Deadline) -> Result<AnyDevice, DeviceError>,
) -> Driver {
    Driver {
        name,
        kind,
        vendor: "sunglint",
        title,
        tried: "our own client only",
        simulated: true,
        place: Place { form: "", example: name, optional: true },
        options: NONE,
        ids: &[],
        wire: Wire::Bytes,
        connect: simulated_server,
        open,
    }
}

/// The simulated camera.
pub(super) static SIM_CAMERA: Driver = simulated(
    "sim-camera",
    Kind::Camera,
    "a simulated camera of 160 × 120 px with a cooler, behind a simulated INDI server",
    camera,
);
/// The simulated rotator.
pub(super) static SIM_ROTATOR: Driver = simulated(
    "sim-rotator",
    Kind::RotationStage,
    "a simulated rotator (10°/s), behind a simulated INDI server",
    rotator,
);
/// The simulated wheel.
pub(super) static SIM_WHEEL: Driver = simulated(
    "sim-wheel",
    Kind::FilterWheel,
    "a simulated wheel with five filters, behind a simulated INDI server",
    wheel,
);

/// Host with port, and device, of `[HOST[:PORT]/]DEVICE`.
fn parts(place: &str) -> Result<(String, &str), AddressError> {
    let (host, device) = place.split_once('/').unwrap_or(("localhost", place));
    let wrong = |expected: &str| AddressError::new("INDI address", place, expected);
    if device.is_empty() || host.is_empty() {
        return Err(wrong("HOST:PORT/DEVICE, the device's name as the server has it"));
    }
    Ok((with_port(host).ok_or_else(|| wrong("a port from 1 to 65535 behind the host"))?, device))
}

/// The host with INDI's own port where none is named; an IPv6 address stands in brackets.
fn with_port(host: &str) -> Option<String> {
    let port = match host.rsplit_once(':') {
        Some((_, port)) if !host.ends_with(']') => port,
        _ => return Some(format!("{host}:{PORT}")),
    };
    port.parse::<u16>().ok().filter(|port| *port > 0).map(|_| host.to_owned())
}

fn connect(address: &mut Address, deadline: &Deadline) -> Result<Line, DeviceError> {
    let (host, _) = parts(address.place.as_deref().unwrap_or("")).map_err(not_found)?;
    let line = Tcp::connect(&host, deadline);
    line.map(Line::bytes).map_err(|error| DeviceError::transport(SERVER, error))
}

/// A device of a server, and the addresses by which drivers of ours open it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Listed {
    /// Name of the device.
    pub name: String,
    /// The program that drives it there, where it says so.
    pub driver: Option<String>,
    /// Addresses; none if it is no camera, rotator, filter wheel, focuser or telescope.
    pub addresses: Vec<String>,
}

/// The devices of the server at `HOST[:PORT]`.
///
/// # Errors
/// Nobody listens there, or see [`DeviceError`].
pub fn listed(host: &str, deadline: &Deadline) -> Result<Vec<Listed>, DeviceError> {
    let wrong = || AddressError::new("INDI server", host, "HOST[:PORT]");
    let server = with_port(host).filter(|_| !host.is_empty()).ok_or_else(|| not_found(wrong()))?;
    let line = Tcp::connect(&server, deadline);
    let line = line.map_err(|error| DeviceError::transport(SERVER, error))?;
    let devices = crate::indi::devices(line, SessionSettings::default(), deadline)?;
    let of = |device: crate::indi::Listed| {
        let kinds = [&CAMERA, &WHEEL, &ROTATOR, &TELESCOPE, &FOCUSER].into_iter().zip(device.is);
        let kinds = kinds.filter(|(_, is)| *is);
        let addresses = kinds.map(|(kind, _)| format!("{}:{server}/{}", kind.name, device.name));
        Listed { addresses: addresses.collect(), driver: device.driver, name: device.name }
    };
    Ok(devices.into_iter().map(of).collect())
}

fn not_found(error: AddressError) -> DeviceError {
    let AddressError { field, found, expected } = error;
    let (what, hint) = (format!("{field} `{found}`"), format!("give {expected}"));
    DeviceError::transport(SERVER, TransportError::NotFound { what, hint })
}

/// A server whose clock begins now.
fn simulated_server(_: &mut Address, deadline: &Deadline) -> Result<Line, DeviceError> {
    let settings = ServerSettings::default();
    let passed = i64::try_from(deadline.now().as_nanos()).unwrap_or(0);
    let now = (CameraSettings::default().utc)();
    let epoch = now - hifitime::Duration::from_truncated_nanoseconds(passed);
    Ok(Line::bytes(Simulated::new(Server::new(ServerSettings { epoch, ..settings }, Ramp))))
}

/// Devices of a server that are named at most in an error.
const MOST_NAMED: usize = 12;

/// The error of a device that its server does not have, with those that it has: it is asked anew, because it says nothing about others to who asked for one.
fn with_known(error: DeviceError, address: &Address, deadline: &Deadline) -> DeviceError {
    let DeviceError::Unknown { name: DeviceError::INDI_DEVICE, asked, .. } = &error else {
        return error;
    };
    let place = address.place.as_deref().and_then(|place| parts(place).ok());
    let Some((server, _)) = place else { return error };
    let Ok(line) = Tcp::connect(&server, deadline) else { return error };
    let settings = SessionSettings::default();
    let Ok(devices) = crate::indi::devices(line, settings, deadline) else { return error };
    let names: Vec<String> = devices.into_iter().map(|device| device.name).collect();
    if names.is_empty() {
        return error;
    }
    let mut names = nearest_first(asked, names);
    let more = names.len().saturating_sub(MOST_NAMED);
    names.truncate(MOST_NAMED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    let known = format!("a device that {server} has: {}{more}", names.join(", "));
    DeviceError::Unknown { name: DeviceError::INDI_DEVICE, asked: asked.clone(), known }
}

/// The names in their order, but for those that are like one that was asked for: they come first.
fn nearest_first(asked: &str, mut names: Vec<String>) -> Vec<String> {
    let all = names.clone();
    let nearest = nearest_names(asked, all.iter().map(String::as_str), all.len());
    let place = |name: &String| nearest.iter().position(|near| near == name);
    names.sort_by_key(|name| place(name).unwrap_or(usize::MAX));
    names
}

/// The device's name: as the address says, or that of the simulated one.
fn name(address: &Address, simulated: String) -> Result<String, DeviceError> {
    match &address.place {
        Some(place) => parts(place).map(|(_, name)| name.to_owned()).map_err(not_found),
        None => Ok(simulated),
    }
}

fn camera(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let name = name(address, CameraSpec::default().name)?;
    let line = line.into_bytes(SERVER)?;
    let mut settings = CameraSettings::default();
    if let Some(mib) = address.integer::<usize>(FRAME_MIB) {
        settings.session.limits.blob_bytes = mib << 20;
    }
    let camera = open_camera(line, &name, settings, deadline)
        .map_err(|error| with_known(error, address, deadline))?;
    Ok(AnyDevice::Camera(Box::new(camera)))
}

fn rotator(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let name = name(address, RotatorSpec::default().name)?;
    let line = line.into_bytes(SERVER)?;
    let rotator = open_rotator(line, &name, RotatorSettings::default(), deadline)
        .map_err(|error| with_known(error, address, deadline))?;
    Ok(AnyDevice::RotationStage(Box::new(rotator)))
}

fn wheel(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let name = name(address, WheelSpec::default().name)?;
    let line = line.into_bytes(SERVER)?;
    let wheel = open_wheel(line, &name, SessionSettings::default(), deadline)
        .map_err(|error| with_known(error, address, deadline))?;
    Ok(AnyDevice::FilterWheel(Box::new(wheel)))
}

fn focuser(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let name = name(address, "Focuser Simulator".to_owned())?;
    let line = line.into_bytes(SERVER)?;
    let focuser = Focuser::open(line, &name, SessionSettings::default(), deadline)
        .map_err(|error| with_known(error, address, deadline))?;
    Ok(AnyDevice::Focuser(Box::new(focuser)))
}

fn mount(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let name = name(address, "Telescope Simulator".to_owned())?;
    let line = line.into_bytes(SERVER)?;
    let mount = open_mount(line, &name, MountSettings::default(), deadline)
        .map_err(|error| with_known(error, address, deadline))?;
    Ok(AnyDevice::Mount(Box::new(mount)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: by eye.
    #[test]
    fn the_nearest_name_comes_first() {
        let names = ["CCD Simulator", "Focuser Simulator", "Rotator Simulator", "Mount"];
        let names = || names.map(str::to_owned).to_vec();
        assert_eq!(nearest_first("rotatr simulator", names())[0], "Rotator Simulator");
        assert_eq!(nearest_first("CCD Simulater", names())[0], "CCD Simulator");
        assert_eq!(nearest_first("QHY", names()), names());
    }

    /// Truth: INDI's port is 7624 (its protocol document).
    #[test]
    fn hosts_ports_and_names_are_told_apart() {
        let of = |place| parts(place).unwrap();
        assert_eq!(of("CCD Simulator"), ("localhost:7624".into(), "CCD Simulator"));
        assert_eq!(of("lab/CCD Simulator"), ("lab:7624".into(), "CCD Simulator"));
        assert_eq!(of("lab:99/A/B"), ("lab:99".into(), "A/B"));
        assert_eq!(of("[::1]/X"), ("[::1]:7624".into(), "X"));
        assert_eq!(of("[::1]:5/X"), ("[::1]:5".into(), "X"));
        for wrong in ["lab:0/X", "lab:99999/X", "lab:x/X", "lab/", "/X"] {
            assert!(parts(wrong).is_err(), "{wrong}");
        }
    }
}
