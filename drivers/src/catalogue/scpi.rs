//! Instruments that speak SCPI and are described by a file, and simulated ones.

use super::options::OptionKind::{Integer, Number, Text, Word};
use super::{Address, AddressError, AnyDevice, Driver, Kind, Line, OptionSpec, Place, Wire};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::scpi::{
    Cable, DEVICE, Definition, DeviceKind, Link, ScpiMeter, ScpiPowerMeter, ScpiSource, Told,
    definition,
};
use crate::simulated::InMemory;
use crate::simulated::scpi::{Adapter, Instrument, Model, ScpiSettings};
use crate::transport::{TransportError, tcp::Tcp};
use crate::usbtmc::{self, TmcSettings};

/// Name in addresses that stands for the driver which the device's file asks for.
const ANY: &str = "scpi";

/// Port of SCPI on raw TCP, and of a Prologix GPIB-ETHERNET adapter.
const PORTS: [u16; 2] = [5025, 1234];

/// Beginning of the place of an instrument that takes lines in requests of ZeroMQ.
const ZEROMQ: &str = "zmq:";

/// Port of ID Quantique's time controllers, which speak ZeroMQ.
const ZEROMQ_PORT: u16 = 5555;

const DEVICE_FILE: OptionSpec = OptionSpec {
    name: "device",
    kind: Text,
    default: "",
    about: "the TOML file that describes the device, or a template's name (devices template)",
};

const GIVEN: [OptionSpec; 4] = [
    DEVICE_FILE,
    OptionSpec {
        name: "gpib",
        kind: Integer(0, 30),
        default: "",
        about: "its GPIB address, behind a Prologix adapter at the place",
    },
    OptionSpec {
        name: "gain",
        kind: Text,
        default: "",
        about: "name of the gain at which the amplifier stands, of the file's [gain]",
    },
    OptionSpec {
        name: "baud",
        kind: Integer(1200, 1_000_000),
        default: "9600",
        about: "speed of the serial line",
    },
];

const WAVELENGTH: OptionSpec = OptionSpec {
    name: "wavelength_nm",
    kind: Number(1.0, 1e6),
    default: "",
    about: "wavelength of the light, of the file's [response]",
};

/// Where a USBTMC instrument is spoken to; what is plugged in says it, a recording may have to.
const ENDPOINTS: [OptionSpec; 3] = [
    OptionSpec {
        name: "interface",
        kind: Integer(0, 255),
        default: "0",
        about: "the number of its USBTMC interface (found by itself)",
    },
    OptionSpec {
        name: "bulk_in",
        kind: Integer(128, 255),
        default: "130",
        about: "the endpoint from the instrument (found by itself)",
    },
    OptionSpec {
        name: "bulk_out",
        kind: Integer(1, 127),
        default: "2",
        about: "the endpoint to the instrument (found by itself)",
    },
];

const OPTIONS: [OptionSpec; 7] =
    [GIVEN[0], GIVEN[1], GIVEN[2], GIVEN[3], ENDPOINTS[0], ENDPOINTS[1], ENDPOINTS[2]];
const METER: &[OptionSpec] = &OPTIONS;
const POWER_METER: &[OptionSpec] = &[
    OPTIONS[0], OPTIONS[1], OPTIONS[2], WAVELENGTH, OPTIONS[3], OPTIONS[4], OPTIONS[5], OPTIONS[6],
];
const SOURCE: &[OptionSpec] =
    &[OPTIONS[0], OPTIONS[1], OPTIONS[3], OPTIONS[4], OPTIONS[5], OPTIONS[6]];

const fn driver(
    name: &'static str,
    kind: Kind,
    title: &'static str,
    example: &'static str,
    options: &'static [OptionSpec],
) -> Driver {
    Driver {
        name,
        kind,
        vendor: "any",
        title,
        tried: "our simulated instruments, which pyvisa drives too, and devices made of sinstruments 1.5.0 and pyzmq 27.3.0; no real instrument yet",
        simulated: false,
        place: Place {
            form: "PORT|tcp:HOST[:PORT]|zmq:HOST[:PORT]|usb[:VVVV:PPPP[:SERIAL]]",
            example,
            optional: false,
        },
        options,
        ids: &[],
        wire: Wire::Bytes,
        connect,
        open,
    }
}

/// Meters.
pub(super) static METERS: Driver = driver(
    "scpi-meter",
    Kind::Meter,
    "meters that speak SCPI and are described by a file: picoammeters, multimeters, photodiode amplifiers",
    "scpi-meter:tcp:192.168.1.20:5025",
    METER,
);

/// Sources.
pub(super) static SOURCES: Driver = driver(
    "scpi-source",
    Kind::Source,
    "sources that speak SCPI and are described by a file: supplies, source meters",
    "scpi-source:tcp:192.168.1.21:5025",
    SOURCE,
);

/// Power meters.
pub(super) static POWER_METERS: Driver = driver(
    "scpi-power-meter",
    Kind::PowerMeter,
    "power meters that speak SCPI and are described by a file: photodiodes with their responsivity, meters of watts",
    "scpi-power-meter:/dev/ttyUSB0",
    POWER_METER,
);

/// A simulated instrument's own options, over those of the link.
const MODEL: OptionSpec = OptionSpec {
    name: "model",
    kind: Word(&["picoammeter", "multimeter"]),
    default: "picoammeter",
    about: "the instrument: a Keithley 6485 or a Keithley 2000",
};

const SIM_GPIB: OptionSpec = OptionSpec {
    name: "gpib",
    kind: Integer(0, 30),
    default: "",
    about: "it is at this GPIB address, behind a simulated Prologix adapter",
};

/// The simulated meter.
pub(super) static SIM_METER: Driver = Driver {
    name: "sim-scpi",
    kind: Kind::Meter,
    vendor: "sunglint",
    title: "a simulated picoammeter or multimeter",
    tried: "pyvisa 1.16.2 with pyvisa-py 0.8.1 drives it",
    simulated: true,
    place: Place { form: "", example: "sim-scpi", optional: true },
    options: &[
        MODEL,
        OptionSpec {
            name: "level",
            kind: Number(-1e3, 1e3),
            default: "1.2e-9",
            about: "the current or voltage at its input, A or V",
        },
        OptionSpec {
            name: "noise",
            kind: Number(0.0, 1.0),
            default: "0.001",
            about: "its noise, as a part of the level (rms)",
        },
        SIM_GPIB,
    ],
    ids: &[],
    wire: Wire::Bytes,
    connect: |address, _| {
        let model = match address.text(MODEL.name) {
            Some("multimeter") => Model::Multimeter,
            _ => Model::Picoammeter,
        };
        let level = address.number("level").unwrap_or(0.0);
        let noise = address.number("noise").unwrap_or(0.0);
        Ok(simulated(address, ScpiSettings { model, noise, ..ScpiSettings::default() }, level))
    },
    open: |line, address, deadline| {
        let file = match address.text(MODEL.name) {
            Some("multimeter") => "keithley2000",
            _ => "keithley6485",
        };
        on_line(line, address, definition(file).map_err(file_error)?, deadline)
    },
};

/// The simulated source.
pub(super) static SIM_SOURCE: Driver = Driver {
    name: "sim-scpi-source",
    kind: Kind::Source,
    vendor: "sunglint",
    title: "a simulated supply, a Rigol DP832",
    tried: "pyvisa 1.16.2 with pyvisa-py 0.8.1 drives it",
    simulated: true,
    place: Place { form: "", example: "sim-scpi-source", optional: true },
    options: &[SIM_GPIB],
    ids: &[],
    wire: Wire::Bytes,
    connect: |address, _| {
        let settings = ScpiSettings { model: Model::Supply, ..ScpiSettings::default() };
        Ok(simulated(address, settings, 0.0))
    },
    open: |line, address, deadline| {
        on_line(line, address, definition("rigol_dp832").map_err(file_error)?, deadline)
    },
};

fn simulated(address: &Address, settings: ScpiSettings, level: f64) -> Line {
    let instrument = Instrument::new(settings, move |_| level);
    match address.integer("gpib") {
        Some(gpib) => Line::bytes(InMemory::new(Adapter::new(gpib, instrument))),
        None => Line::bytes(InMemory::new(instrument)),
    }
}

fn file_error(error: sunglint_formats::FileError) -> DeviceError {
    DeviceError::File(Box::new(error))
}

/// The driver that the device's file asks for, for an address of the driver `scpi`.
pub(super) fn driver_of(
    name: &str,
    options: &[String],
) -> Result<Option<&'static str>, AddressError> {
    if name != ANY {
        return Ok(None);
    }
    let given = options.iter().find_map(|option| option.trim().strip_prefix("device="));
    let Some(file) = given.map(str::trim) else {
        let expected = "--with device=FILE.toml, or a template's name (sunglint devices template)";
        return Err(AddressError::new("option device", "none", expected));
    };
    let about = definition(file).map_err(|error| {
        AddressError::new("option device", file, format!("the file of a device: {error}"))
    })?;
    Ok(Some(match about.kind() {
        DeviceKind::Meter => METERS.name,
        DeviceKind::Source => SOURCES.name,
        DeviceKind::PowerMeter => POWER_METERS.name,
    }))
}

/// Whether a place of these drivers is on USB, where requests are made.
pub(super) fn wire(driver: &Driver, place: Option<&str>) -> Option<Wire> {
    let ours = [METERS.name, SOURCES.name, POWER_METERS.name].contains(&driver.name);
    (ours && place.is_some_and(is_usb)).then_some(Wire::Transfers)
}

fn is_usb(place: &str) -> bool {
    place == "usb" || place.starts_with("usb:")
}

fn not_found(what: String, hint: &str) -> DeviceError {
    DeviceError::transport(DEVICE, TransportError::NotFound { what, hint: hint.to_owned() })
}

/// Numbers (vendor, product) and serial number.
type UsbPlace<'p> = (Option<(u16, u16)>, Option<&'p str>);

/// Numbers and serial number behind `usb`.
fn usb_place(place: &str) -> Result<UsbPlace<'_>, DeviceError> {
    let bad = || {
        not_found(
            place.to_owned(),
            "write usb, usb:VVVV:PPPP or usb:VVVV:PPPP:SERIAL, the numbers in hexadecimal",
        )
    };
    let Some(rest) = place.strip_prefix("usb:") else { return Ok((None, None)) };
    let mut parts = rest.splitn(3, ':');
    let mut number = || {
        let digits = parts.next().filter(|part| (1..=4).contains(&part.len()));
        digits.and_then(|digits| u16::from_str_radix(digits, 16).ok()).ok_or_else(bad)
    };
    let numbers = (number()?, number()?);
    Ok((Some(numbers), parts.next().filter(|serial| !serial.is_empty())))
}

/// `HOST:PORT`, with the usual port where none is given.
fn server(place: &str, usual: u16) -> String {
    let has_port = match place.rsplit_once(':') {
        Some((host, port)) => {
            (!host.contains(':') || host.ends_with(']')) && port.bytes().all(|b| b.is_ascii_digit())
        }
        None => false,
    };
    if has_port { place.to_owned() } else { format!("{place}:{usual}") }
}

fn connect(address: &mut Address, deadline: &Deadline) -> Result<Line, DeviceError> {
    // Before anything is opened: an address without a file, or with a wrong one.
    described(address)?;
    let place = address.place.clone().unwrap_or_default();
    if is_usb(&place) {
        let (numbers, serial) = usb_place(&place)?;
        let (usb, found) = usbtmc::open(DEVICE, numbers, serial)?;
        if found != TmcSettings::default().endpoints {
            address.found("interface", found.interface.to_string());
            address.found("bulk_in", found.bulk_in.to_string());
            address.found("bulk_out", found.bulk_out.to_string());
        }
        return Ok(Line::transfers(usb));
    }
    if let Some(host) = place.strip_prefix(ZEROMQ) {
        if address.text("gpib").is_some() {
            let hint = "a GPIB adapter is at a serial port or tcp:HOST: leave gpib out";
            return Err(not_found(place.clone(), hint));
        }
        let tcp = Tcp::connect(&server(host, ZEROMQ_PORT), deadline);
        return tcp.map(Line::bytes).map_err(|error| DeviceError::transport(DEVICE, error));
    }
    if let Some(host) = place.strip_prefix("tcp:") {
        let host = server(host, PORTS[usize::from(address.text("gpib").is_some())]);
        let tcp = Tcp::connect(&host, deadline);
        return tcp.map(Line::bytes).map_err(|error| DeviceError::transport(DEVICE, error));
    }
    super::line::serial(DEVICE, address, deadline)
}

fn described(address: &Address) -> Result<Definition, DeviceError> {
    let Some(file) = address.text(DEVICE_FILE.name) else {
        let reason = "it needs the file that describes it: --with device=FILE.toml; `sunglint devices template` prints some to begin with";
        return Err(DeviceError::NotReady { device: DEVICE, reason });
    };
    definition(file).map_err(file_error)
}

fn open(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    on_line(line, address, described(address)?, deadline)
}

fn on_line(
    line: Line,
    address: &Address,
    about: Definition,
    deadline: &Deadline,
) -> Result<AnyDevice, DeviceError> {
    let place = address.place.as_deref().unwrap_or_default();
    let link = if is_usb(place) {
        let mut tmc = TmcSettings::default();
        let known = &mut tmc.endpoints;
        known.interface = address.integer("interface").unwrap_or(known.interface);
        known.bulk_in = address.integer("bulk_in").unwrap_or(known.bulk_in);
        known.bulk_out = address.integer("bulk_out").unwrap_or(known.bulk_out);
        Link::usbtmc(line.into_transfers(DEVICE)?, tmc, &about)
    } else if place.starts_with(ZEROMQ) {
        Link::zeromq(line.into_bytes(DEVICE)?, &about)
    } else {
        let cable = if place.starts_with("tcp:") { Cable::Checked } else { Cable::Unchecked };
        let line = line.into_bytes(DEVICE)?;
        match address.integer("gpib") {
            Some(gpib) => Link::gpib(line, gpib, cable, &about),
            None => Link::stream(line, cable, &about),
        }
    };
    let told = Told {
        gain: address.text("gain").map(str::to_owned),
        wavelength_nm: address.number("wavelength_nm"),
    };
    Ok(match address.driver.kind {
        Kind::Source => {
            AnyDevice::Source(Box::new(ScpiSource::open(link, about, &told, deadline)?))
        }
        Kind::PowerMeter => {
            AnyDevice::PowerMeter(Box::new(ScpiPowerMeter::open(link, about, &told, deadline)?))
        }
        _ => AnyDevice::Meter(Box::new(ScpiMeter::open(link, about, &told, deadline)?)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the form of the places, by hand.
    #[test]
    fn places_are_read() {
        for (place, whole) in [
            ("lab", "lab:5025"),
            ("lab:5555", "lab:5555"),
            ("10.0.0.3", "10.0.0.3:5025"),
            ("[::1]", "[::1]:5025"),
            ("[::1]:7", "[::1]:7"),
        ] {
            assert_eq!(server(place, 5025), whole);
        }
        assert_eq!(server("10.0.0.3", ZEROMQ_PORT), "10.0.0.3:5555");
        assert_eq!(usb_place("usb").unwrap(), (None, None));
        assert_eq!(usb_place("usb:2a8d:1301:MY1").unwrap(), (Some((0x2a8d, 0x1301)), Some("MY1")));
        for bad in ["usb:2a8d", "usb:x:1", "usb:12345:1", "usb:"] {
            assert!(usb_place(bad).unwrap_err().to_string().contains("VVVV:PPPP"), "{bad}");
        }
    }

    /// Truth: the `kind` of the templates.
    #[test]
    fn the_file_chooses_the_driver() {
        let of = |file: &str| Address::parse("scpi:tcp:lab", &[format!("device={file}")]);
        assert_eq!(of("keithley6485").unwrap().driver.name, "scpi-meter");
        assert_eq!(of("rigol_dp832").unwrap().driver.name, "scpi-source");
        let missing = of("nowhere.toml").unwrap_err().to_string();
        assert!(missing.contains("cannot read nowhere.toml"), "{missing}");
        let none = Address::parse("scpi:tcp:lab", &[]).unwrap_err().to_string();
        assert!(none.contains("--with device=FILE.toml"), "{none}");
        let usb = Address::parse("scpi:usb", &["device=keysight34461a".to_owned()]).unwrap();
        assert_eq!(usb.wire(), Wire::Transfers);
    }
}
