//! Trinamic's motor controllers, and a simulated one.

use super::options::OptionKind::{Flag, Integer, Number, Pair, Word};
use super::{
    Address, AnyDevice, Bus, Driver, Kind, Line, OptionKind, OptionSpec, Place, UsbId, Wire,
};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::simulated::InMemory;
use crate::simulated::tmcl::{Module, ModuleSettings};
use crate::trinamic::{Approach, DEVICE, LinkSettings, Search, Stage, StageSettings};

const fn option(
    name: &'static str,
    kind: OptionKind,
    default: &'static str,
    about: &'static str,
) -> OptionSpec {
    OptionSpec { name, kind, default, about }
}

/// The options of a stage; a simulated one knows its switches.
const fn stage(
    search_mode: &'static str,
    search_speed: &'static str,
    trust: &'static str,
) -> [OptionSpec; 14] {
    [
        option("baud", Integer(1200, 1_000_000), "9600", "speed of the serial line"),
        option("module", Integer(0, 255), "1", "the module's address"),
        option("motor", Integer(0, 5), "0", "the motor's number on the module"),
        option("full_steps_per_turn", Integer(1, 100_000), "200", "full steps of a motor turn"),
        option("gear", Number(1e-6, 1e6), "1", "turns of the motor for one turn of the stage"),
        option("inverted", Flag, "no", "angles grow while the module's counter falls"),
        option("zero_deg", Number(-1e6, 1e6), "0", "the angle at which the module's counter is 0"),
        option("travel_deg", Pair, "", "angles between which it may stand"),
        option(
            "approach",
            Word(&["direct", "below:", "above:"]),
            "direct",
            "from which side targets are approached, by how many degrees at least",
        ),
        option(
            "search_mode",
            Integer(1, 255),
            search_mode,
            "reference search, as its manual numbers them",
        ),
        option(
            "search_speed",
            Integer(1, 10_000_000),
            search_speed,
            "speed of the search, the module's own unit",
        ),
        option(
            "search_switch_speed",
            Integer(1, 10_000_000),
            "500",
            "speed at the switch, the module's own unit",
        ),
        option(
            "search_tolerance_deg",
            Number(0.0, 360.0),
            "0.5",
            "how far from zero the counter may be after the search",
        ),
        option(
            "trust_counter",
            Flag,
            trust,
            "take the module's counter as it is: it was homed before",
        ),
    ]
}

/// Trinamic TMCL.
pub(super) static TMCL: Driver = Driver {
    name: "tmcl",
    kind: Kind::RotationStage,
    vendor: "Trinamic (Analog Devices)",
    title: "stages on TMCL motor controllers (TMCM-1110 and alike), by serial port or USB",
    tried: "our simulated module; frames and codes against pytrinamic 0.2.26; no real module yet",
    simulated: false,
    place: Place { form: "PORT", example: "tmcl:/dev/ttyACM0", optional: true },
    options: &stage("", "5000", "no"),
    // From Trinamic's own numbers (2a3c) and, for the older 16d0:06cc, MCS's list of numbers lent to others.
    ids: &[
        UsbId { bus: Bus::Serial, vendor: 0x2a3c, product: None, name: "Trinamic module" },
        UsbId {
            bus: Bus::Serial,
            vendor: 0x16d0,
            product: Some(0x06cc),
            name: "Trinamic TMCM-3110",
        },
    ],
    wire: Wire::Bytes,
    connect: |address, deadline| super::line::serial(DEVICE, address, deadline),
    open,
};

/// The simulated module.
pub(super) static SIM_TMCL: Driver = Driver {
    name: "sim-tmcl",
    kind: Kind::RotationStage,
    vendor: "sunglint",
    title: "a simulated TMCM-1110 with limit switches a turn away on either side",
    tried: "frames and codes against pytrinamic 0.2.26",
    simulated: true,
    place: Place { form: "", example: "sim-tmcl", optional: true },
    options: &stage("1", "50000", "yes"),
    ids: &[],
    wire: Wire::Bytes,
    connect: |_, _| Ok(Line::bytes(InMemory::new(Module::new(ModuleSettings::default())))),
    open,
};

fn open(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let mut link = LinkSettings::default();
    link.module = address.integer("module").unwrap_or(link.module);
    let mut settings = StageSettings::default();
    settings.motor = address.integer("motor").unwrap_or(settings.motor);
    settings.full_steps_per_turn =
        address.integer("full_steps_per_turn").unwrap_or(settings.full_steps_per_turn);
    settings.gear = address.number("gear").unwrap_or(settings.gear);
    settings.inverted = address.flag("inverted");
    settings.zero_deg = address.number("zero_deg").unwrap_or(settings.zero_deg);
    settings.travel_deg = address.text("travel_deg").and_then(OptionKind::pair);
    settings.approach = match address.text("approach").map(OptionKind::word) {
        Some(("below", Some(by_deg))) => Approach::FromBelow { by_deg },
        Some(("above", Some(by_deg))) => Approach::FromAbove { by_deg },
        _ => Approach::Direct,
    };
    settings.search = search(address);
    let mut stage = Stage::open(line.into_bytes(DEVICE)?, link, settings, deadline)?;
    if address.flag("trust_counter") {
        stage.trust_counter();
    }
    Ok(AnyDevice::RotationStage(Box::new(stage)))
}

/// How the reference is searched, if a mode is named.
fn search(address: &Address) -> Option<Search> {
    Some(Search {
        mode: address.integer("search_mode")?,
        speed: address.integer("search_speed")?,
        switch_speed: address.integer("search_switch_speed")?,
        tolerance_deg: address.number("search_tolerance_deg")?,
    })
}
