//! Thorlabs' Elliptec rotation mounts, and a simulated one.

use super::options::OptionKind::{Flag, Integer, Number, Pair, Word};
use super::{Address, AnyDevice, Driver, Kind, Line, OptionKind, OptionSpec, Place, Wire};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::simulated::InMemory;
use crate::simulated::elliptec::{Elliptec, ElliptecSettings};
use crate::thorlabs::elliptec::{DEVICE, LinkSettings};
use crate::turning::TurningSettings;

const fn options(trust: &'static str) -> [OptionSpec; 8] {
    [
        OptionSpec {
            name: "baud",
            kind: Integer(1200, 1_000_000),
            default: "9600",
            about: "speed of the serial line",
        },
        OptionSpec {
            name: "address",
            kind: Word(&[
                "0", "1", "2", "3", "4", "5", "6", "7", "8", "9", "A", "B", "C", "D", "E", "F",
            ]),
            default: "0",
            about: "the module's address on its line",
        },
        OptionSpec {
            name: "home_anticlockwise",
            kind: Flag,
            default: "no",
            about: "search the reference anticlockwise",
        },
        OptionSpec {
            name: "inverted",
            kind: Flag,
            default: "no",
            about: "angles grow while the counter falls",
        },
        OptionSpec {
            name: "zero_deg",
            kind: Number(-1e6, 1e6),
            default: "0",
            about: "the angle at which the counter is 0",
        },
        OptionSpec {
            name: "travel_deg",
            kind: Pair,
            default: "",
            about: "angles between which it may stand",
        },
        OptionSpec {
            name: "tolerance_deg",
            kind: Number(0.0, 360.0),
            default: "0.1",
            about: "how far from its target it may come to rest",
        },
        OptionSpec {
            name: "trust_counter",
            kind: Flag,
            default: trust,
            about: "take the counter as it is: it was homed before",
        },
    ]
}

/// Thorlabs Elliptec.
pub(super) static ELLIPTEC: Driver = Driver {
    name: "elliptec",
    kind: Kind::RotationStage,
    vendor: "Thorlabs",
    title: "Elliptec rotation mounts (ELL14, ELL18 and alike)",
    tried: "our simulated module, which elliptec 0.1.0 and pylablib 1.4.3 drive too; no real module yet",
    simulated: false,
    place: Place { form: "PORT", example: "elliptec:/dev/ttyUSB0", optional: false },
    options: &options("no"),
    // Their USB board has the numbers of any FTDI adapter.
    ids: &[],
    wire: Wire::Bytes,
    connect: |address, deadline| super::line::serial(DEVICE, address, deadline),
    open,
};

/// The simulated mount.
pub(super) static SIM_ELLIPTEC: Driver = Driver {
    name: "sim-elliptec",
    kind: Kind::RotationStage,
    vendor: "sunglint",
    title: "a simulated ELL14",
    tried: "driven by elliptec 0.1.0 and pylablib 1.4.3",
    simulated: true,
    place: Place { form: "", example: "sim-elliptec", optional: true },
    options: &options("yes"),
    ids: &[],
    wire: Wire::Bytes,
    connect: |address, _| {
        let settings = ElliptecSettings { address: digit(address), ..Default::default() };
        Ok(Line::bytes(InMemory::new(Elliptec::new(settings))))
    },
    open,
};

fn digit(address: &Address) -> u8 {
    let digit = address.text("address").and_then(|text| u8::from_str_radix(text, 16).ok());
    digit.unwrap_or(0)
}

fn open(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let link = LinkSettings {
        address: digit(address),
        anticlockwise: address.flag("home_anticlockwise"),
        ..LinkSettings::default()
    };
    let settings = turning(address);
    let mut stage =
        crate::thorlabs::elliptec::open(line.into_bytes(DEVICE)?, link, settings, deadline)?;
    if address.flag("trust_counter") {
        stage.trust_counter();
    }
    Ok(AnyDevice::RotationStage(Box::new(stage)))
}

/// The settings that stages of all protocols have.
pub(super) fn turning(address: &Address) -> TurningSettings {
    let default = TurningSettings::default();
    TurningSettings {
        inverted: address.flag("inverted"),
        zero_deg: address.number("zero_deg").unwrap_or(default.zero_deg),
        travel_deg: address.text("travel_deg").and_then(OptionKind::pair),
        tolerance_deg: address.number("tolerance_deg").unwrap_or(default.tolerance_deg),
        ..default
    }
}
