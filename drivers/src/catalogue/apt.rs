//! Thorlabs' rotation stages, and a simulated one.

use super::options::OptionKind::{Flag, Integer, Number, Pair, Word};
use super::{
    Address, AnyDevice, Bus, Driver, Kind, Line, OptionKind, OptionSpec, Place, UsbId, Wire,
};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::simulated::InMemory;
use crate::simulated::apt::{Apt, AptSettings};
use crate::thorlabs::apt::{LinkSettings, Model, Stage, StageSettings};

/// In messages.
const DEVICE: &str = "APT controller";

const fn options(trust: &'static str) -> [OptionSpec; 8] {
    [
        OptionSpec {
            name: "baud",
            kind: Integer(1200, 1_000_000),
            default: "115200",
            about: "speed of the serial line",
        },
        OptionSpec {
            name: "model",
            kind: Word(&["k10cr1", "prm1z8", "hdr50"]),
            default: "k10cr1",
            about: "what turns: its counts of a degree",
        },
        OptionSpec {
            name: "address",
            kind: Integer(0, 255),
            default: "80",
            about: "the controller's address: 80 of its own, 33 and up for the bays of a rack",
        },
        OptionSpec {
            name: "channel",
            kind: Integer(1, 255),
            default: "1",
            about: "the controller's channel",
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
            name: "trust_counter",
            kind: Flag,
            default: trust,
            about: "take the counter as it is: it was homed before",
        },
    ]
}

/// Thorlabs APT.
pub(super) static APT: Driver = Driver {
    name: "apt",
    kind: Kind::RotationStage,
    vendor: "Thorlabs",
    title: "rotation stages on the APT protocol: K10CR1, PRM1Z8, HDR50",
    tried: "our simulated stage, and one built on thorlabs-apt-protocol 29.0.0 on a pty; no real stage yet",
    simulated: false,
    place: Place { form: "PORT", example: "apt:/dev/ttyUSB0", optional: true },
    options: &options("no"),
    ids: &[UsbId {
        bus: Bus::Serial,
        vendor: 0x0403,
        product: Some(0xfaf0),
        name: "Thorlabs APT stage",
    }],
    wire: Wire::Bytes,
    connect: |address, deadline| super::line::serial(DEVICE, address, deadline),
    open,
};

/// The simulated K10CR1.
pub(super) static SIM_APT: Driver = Driver {
    name: "sim-apt",
    kind: Kind::RotationStage,
    vendor: "sunglint",
    title: "a simulated K10CR1",
    tried: "its messages against thorlabs-apt-protocol 29.0.0",
    simulated: true,
    place: Place { form: "", example: "sim-apt", optional: true },
    options: &options("yes"),
    ids: &[],
    wire: Wire::Bytes,
    connect: |_, _| Ok(Line::bytes(InMemory::new(Apt::new(AptSettings::default())))),
    open,
};

fn open(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let mut link = LinkSettings::default();
    link.address = address.integer("address").unwrap_or(link.address);
    link.channel = address.integer("channel").unwrap_or(link.channel);
    let settings = StageSettings {
        model: match address.text("model") {
            Some("prm1z8") => Model::Prm1z8,
            Some("hdr50") => Model::Hdr50,
            _ => Model::K10cr1,
        },
        inverted: address.flag("inverted"),
        zero_deg: address.number("zero_deg").unwrap_or(0.0),
        travel_deg: address.text("travel_deg").and_then(OptionKind::pair),
        ..StageSettings::default()
    };
    let mut stage = Stage::open(line.into_bytes(DEVICE)?, link, settings, deadline)?;
    if address.flag("trust_counter") {
        stage.trust_counter();
    }
    Ok(AnyDevice::RotationStage(Box::new(stage)))
}
