//! Monochromators: Spectral Products' and Acton's, and a simulated one of each.

use super::options::OptionKind::{Flag, Integer, Number, Pair, Word};
use super::{Address, AnyDevice, Driver, Kind, Line, OptionKind, OptionSpec, Place, Wire};
use crate::acton;
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::simulated::{InMemory, cm110 as sim_cm110, sp2150 as sim_sp2150};
use crate::spectral_products as cm110;

const BAUD: OptionSpec = OptionSpec {
    name: "baud",
    kind: Integer(1200, 115_200),
    default: "9600",
    about: "speed of the serial line",
};

const fn range(default: &'static str) -> OptionSpec {
    OptionSpec {
        name: "range_nm",
        kind: Pair,
        default,
        about: "wavelengths that may be asked for, nm",
    }
}

const fn slew(default: &'static str) -> OptionSpec {
    OptionSpec {
        name: "slew_nm_s",
        kind: Number(0.01, 1e4),
        default,
        about: "slowest speed of a slew, nm/s: the longest time of a move is of it",
    }
}

/// Spectral Products CM110 and CM112.
pub(super) static CM110: Driver = Driver {
    name: "cm110",
    kind: Kind::Monochromator,
    vendor: "Spectral Products",
    title: "monochromators CM110 and CM112 (Digikröm) on a serial line",
    tried: "our simulated one only: no program of others was found; no real one yet",
    simulated: false,
    place: Place { form: "PORT", example: "cm110:/dev/ttyUSB0", optional: false },
    options: &[BAUD, range(""), slew("25")],
    // It is behind whatever adapter the user has.
    ids: &[],
    wire: Wire::Bytes,
    connect: |address, deadline| super::line::serial(cm110::DEVICE, address, deadline),
    open: open_cm110,
};

/// The simulated CM110.
pub(super) static SIM_CM110: Driver = Driver {
    name: "sim-cm110",
    kind: Kind::Monochromator,
    vendor: "sunglint",
    title: "a simulated CM110 with two gratings",
    tried: "our driver only",
    simulated: true,
    place: Place { form: "", example: "sim-cm110", optional: true },
    options: &[range("0,1500"), slew("25")],
    ids: &[],
    wire: Wire::Bytes,
    connect: |_, _| Ok(Line::bytes(InMemory::new(sim_cm110::Cm110::new(Default::default())))),
    open: open_cm110,
};

fn open_cm110(
    line: Line,
    address: &Address,
    deadline: &Deadline,
) -> Result<AnyDevice, DeviceError> {
    let mut settings = cm110::MonoSettings::default();
    settings.range_nm = address.text("range_nm").and_then(OptionKind::pair);
    settings.slew_nm_s = address.number("slew_nm_s").unwrap_or(settings.slew_nm_s);
    let link = cm110::LinkSettings::default();
    let line = line.into_bytes(cm110::DEVICE)?;
    let mono = cm110::Mono::open(line, link, settings, deadline)?;
    Ok(AnyDevice::Monochromator(Box::new(mono)))
}

const MOTION: OptionSpec = OptionSpec {
    name: "motion",
    kind: Word(&["goto", "scan"]),
    default: "goto",
    about: "goto: fast, and cannot be stopped on its way; scan: with the setting speed_nm_min, and can be",
};

/// Princeton Instruments (Acton) SP2150.
pub(super) static SP2150: Driver = Driver {
    name: "sp2150",
    kind: Kind::Monochromator,
    vendor: "Princeton Instruments (Acton)",
    title: "monochromators SP2150 and others with its words, on a serial line or their USB's serial port",
    tried: "our simulated one only: no program of others was found; no real one yet",
    simulated: false,
    place: Place { form: "PORT", example: "sp2150:/dev/ttyUSB0", optional: false },
    options: &[BAUD, range(""), slew("10"), MOTION],
    // It is behind whatever adapter the user has; the number of its own was not found.
    ids: &[],
    wire: Wire::Bytes,
    connect: |address, deadline| super::line::serial(acton::DEVICE, address, deadline),
    open: open_sp2150,
};

/// The simulated SP2150.
pub(super) static SIM_SP2150: Driver = Driver {
    name: "sim-sp2150",
    kind: Kind::Monochromator,
    vendor: "sunglint",
    title: "a simulated SP2150 with two gratings",
    tried: "our driver only",
    simulated: true,
    place: Place { form: "", example: "sim-sp2150", optional: true },
    options: &[
        range("0,1400"),
        slew("10"),
        MOTION,
        OptionSpec {
            name: "echo",
            kind: Flag,
            default: "yes",
            about: "whether it echoes what it hears, as on RS-232",
        },
    ],
    ids: &[],
    wire: Wire::Bytes,
    connect: |address, _| {
        let settings =
            sim_sp2150::Sp2150Settings { echoes: address.flag("echo"), ..Default::default() };
        Ok(Line::bytes(InMemory::new(sim_sp2150::Sp2150::new(settings))))
    },
    open: open_sp2150,
};

fn open_sp2150(
    line: Line,
    address: &Address,
    deadline: &Deadline,
) -> Result<AnyDevice, DeviceError> {
    let mut settings = acton::MonoSettings::default();
    settings.range_nm = address.text("range_nm").and_then(OptionKind::pair);
    settings.slew_nm_s = address.number("slew_nm_s").unwrap_or(settings.slew_nm_s);
    if address.text("motion") == Some("scan") {
        settings.motion = acton::Motion::Scan;
    }
    let line = line.into_bytes(acton::DEVICE)?;
    let mono = acton::Mono::open(line, acton::LinkSettings::default(), settings, deadline)?;
    Ok(AnyDevice::Monochromator(Box::new(mono)))
}
