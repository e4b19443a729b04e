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
use crate::transport::serial::{Flow, PortSettings};

/// In messages.
const DEVICE: &str = "APT controller";

const fn options(trust: &'static str) -> [OptionSpec; 12] {
    [
        OptionSpec {
            name: "baud",
            kind: Integer(1200, 1_000_000),
            default: "115200",
            about: "speed of the serial line",
        },
        OptionSpec {
            name: "model",
            kind: Word(&[
                "k10cr1",
                "k10cr2",
                "prm1z8",
                "hdr50",
                "nr360",
                "nr360-coarse",
                "ddr100",
                "ddr05",
                "ddr25",
            ]),
            default: "",
            about: "what turns on the controller; a K10CR1 or K10CR2 says it by itself",
        },
        OptionSpec {
            name: "counts_per_deg",
            kind: Number(1e-6, 1e12),
            default: "",
            about: "counts of a degree of any other stage",
        },
        OptionSpec {
            name: "servo",
            kind: Flag,
            default: "",
            about: "of a stage by counts_per_deg: whether its controller is for servo motors, if its name does not say so",
        },
        OptionSpec {
            name: "tolerance_deg",
            kind: Number(0.0, 360.0),
            default: "",
            about: "how far from its target it may come to rest (0 for steppers, 0.005 for servos)",
        },
        OptionSpec {
            name: "rts_cts",
            kind: Flag,
            default: "yes",
            about: "flow control by RTS and CTS, as Thorlabs asks; no for adapters without these lines",
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
    title: "rotation stages on the APT (Kinesis) protocol: K10CR1, K10CR2, PRM1Z8, HDR50, NR360, DDR05, DDR25, DDR100, others by counts_per_deg",
    tried: "our simulated stage, which pylablib 1.4.3 drives too, and one built on thorlabs-apt-protocol 29.0.0 on a pty; no real stage yet",
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
    connect: |address, deadline| {
        let mut port = PortSettings::at(address.integer("baud").unwrap_or(115_200));
        if address.flag("rts_cts") {
            port = PortSettings { flow: Flow::RtsCts, lift_rts: true, ..port };
        }
        super::line::serial_with(DEVICE, address, port, deadline)
    },
    open,
};

/// The simulated K10CR1.
pub(super) static SIM_APT: Driver = Driver {
    name: "sim-apt",
    kind: Kind::RotationStage,
    vendor: "sunglint",
    title: "a simulated K10CR1",
    tried: "its messages against thorlabs-apt-protocol 29.0.0; driven by pylablib 1.4.3",
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
        model: match address.number("counts_per_deg") {
            Some(counts_per_deg) => {
                let servo = address.text("servo").and_then(OptionKind::flag);
                Some(Model::Other { counts_per_deg, servo })
            }
            None => address.text("model").and_then(Model::named),
        },
        tolerance_deg: address.number("tolerance_deg"),
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
