//! Rotation stages on Standa's controllers, and a simulated one.

use super::elliptec::turning;
use super::options::OptionKind::{Flag, Integer, Number, Pair};
use super::{Address, AnyDevice, Driver, Kind, Line, OptionKind, OptionSpec, Place, Wire};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::simulated::InMemory;
use crate::simulated::standa::{Standa, StandaSettings};
use crate::standa::{DEVICE, LinkSettings};
use crate::transport::serial::PortSettings;

const fn option(
    name: &'static str,
    kind: OptionKind,
    default: &'static str,
    about: &'static str,
) -> OptionSpec {
    OptionSpec { name, kind, default, about }
}

const fn options(counts_per_deg: &'static str) -> [OptionSpec; 8] {
    [
        option("baud", Integer(9600, 1_000_000), "115200", "speed of the serial line"),
        option(
            "counts_per_deg",
            Number(1e-6, 1e12),
            counts_per_deg,
            "counts of a degree: full steps of a degree times microsteps; of a DC motor those of its encoder; it must be given",
        ),
        option(
            "microsteps",
            Integer(1, 256),
            "256",
            "microsteps of a full step in counts_per_deg; a controller that divides otherwise is refused",
        ),
        option("inverted", Flag, "no", "angles grow while the counter falls"),
        option("zero_deg", Number(-1e6, 1e6), "0", "the angle at which the counter is 0"),
        option("travel_deg", Pair, "", "angles between which it may stand"),
        option(
            "tolerance_deg",
            Number(0.0, 360.0),
            "0",
            "how far from its target it may come to rest (a DC motor does not stand still on a count)",
        ),
        option(
            "trust_counter",
            Flag,
            "no",
            "take the counter as it is, though the controller does not say that it has a reference",
        ),
    ]
}

/// Standa 8SMC4 and 8SMC5.
pub(super) static STANDA: Driver = Driver {
    name: "standa",
    kind: Kind::RotationStage,
    vendor: "Standa",
    title: "rotation stages on 8SMC4 and 8SMC5 controllers, by serial port (USB too) or TCP",
    tried: "our simulated controller, which libximc 2.14.30 and pylablib 1.4.3 drive too; no real controller yet",
    simulated: false,
    place: Place { form: "PORT", example: "standa:/dev/ttyACM0", optional: false },
    options: &options(""),
    // Its USB has the numbers 1cbe:0007 of its chip, which others have too.
    ids: &[],
    wire: Wire::Bytes,
    connect: |address, deadline| {
        let baud = address.integer("baud").unwrap_or(115_200);
        let port = PortSettings { two_stop_bits: true, ..PortSettings::at(baud) };
        super::line::serial_with(DEVICE, address, port, deadline)
    },
    open,
};

/// The simulated controller.
pub(super) static SIM_STANDA: Driver = Driver {
    name: "sim-standa",
    kind: Kind::RotationStage,
    vendor: "sunglint",
    title: "a simulated 8SMC5 with a stepper of 25600 microsteps a degree",
    tried: "driven by libximc 2.14.30 and pylablib 1.4.3",
    simulated: true,
    place: Place { form: "", example: "sim-standa", optional: true },
    options: &options("25600"),
    ids: &[],
    wire: Wire::Bytes,
    connect: |_, _| {
        let settings = StandaSettings { referenced: true, ..Default::default() };
        Ok(Line::bytes(InMemory::new(Standa::new(settings))))
    },
    open,
};

fn open(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let Some(counts_per_deg) = address.number("counts_per_deg") else {
        let reason = "give its counts of a degree (counts_per_deg=NUMBER): full steps of a degree, from the stage's data sheet, times the microsteps of a step";
        return Err(DeviceError::NotReady { device: DEVICE, reason });
    };
    let mut link = LinkSettings::new(counts_per_deg);
    link.microsteps = address.integer("microsteps").unwrap_or(link.microsteps);
    let line = line.into_bytes(DEVICE)?;
    let mut stage = crate::standa::open(line, link, turning(address), deadline)?;
    if address.flag("trust_counter") {
        stage.trust_counter();
    }
    Ok(AnyDevice::RotationStage(Box::new(stage)))
}
