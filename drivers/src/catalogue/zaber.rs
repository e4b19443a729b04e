//! Zaber's rotation stages, and a simulated one.

use super::elliptec::turning;
use super::options::OptionKind::{Flag, Integer, Number, Pair};
use super::{Address, AnyDevice, Driver, Kind, Line, OptionSpec, Place, Wire};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::simulated::InMemory;
use crate::simulated::zaber::{Zaber, ZaberSettings};
use crate::transport::serial::PortSettings;
use crate::zaber::{DEVICE, LinkSettings};

const fn options(counts_per_deg: &'static str) -> [OptionSpec; 9] {
    [
        OptionSpec {
            name: "baud",
            kind: Integer(1200, 1_000_000),
            default: "115200",
            about: "speed of the serial line",
        },
        OptionSpec {
            name: "device",
            kind: Integer(1, 99),
            default: "1",
            about: "the device's address on its line",
        },
        OptionSpec { name: "axis", kind: Integer(1, 9), default: "1", about: "the device's axis" },
        OptionSpec {
            name: "counts_per_deg",
            kind: Number(1e-6, 1e12),
            default: counts_per_deg,
            about: "microsteps of a degree, from the stage's data sheet; it must be given",
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
            default: "0",
            about: "how far from its target it may come to rest",
        },
        OptionSpec {
            name: "trust_counter",
            kind: Flag,
            default: "no",
            about: "take the counter as it is, though the device says that it has no reference",
        },
    ]
}

/// Zaber ASCII.
pub(super) static ZABER: Driver = Driver {
    name: "zaber",
    kind: Kind::RotationStage,
    vendor: "Zaber",
    title: "rotation stages on the Zaber ASCII protocol, by serial port or TCP",
    tried: "our simulated device, which zaber-motion 10.3.0 drives too; no real device yet",
    simulated: false,
    place: Place { form: "PORT", example: "zaber:/dev/ttyUSB0", optional: false },
    options: &options(""),
    // Their cables have the numbers of any FTDI adapter.
    ids: &[],
    wire: Wire::Bytes,
    connect: |address, deadline| {
        let port = PortSettings::at(address.integer("baud").unwrap_or(115_200));
        super::line::serial_with(DEVICE, address, port, deadline)
    },
    open,
};

/// The simulated device.
pub(super) static SIM_ZABER: Driver = Driver {
    name: "sim-zaber",
    kind: Kind::RotationStage,
    vendor: "sunglint",
    title: "a simulated Zaber device with one axis of 1000 microsteps a degree",
    tried: "driven by zaber-motion 10.3.0",
    simulated: true,
    place: Place { form: "", example: "sim-zaber", optional: true },
    options: &options("1000"),
    ids: &[],
    wire: Wire::Bytes,
    connect: |address, _| {
        let address = address.integer("device").unwrap_or(1);
        let settings = ZaberSettings { address, referenced: true, ..Default::default() };
        Ok(Line::bytes(InMemory::new(Zaber::new(settings))))
    },
    open,
};

fn open(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let Some(counts_per_deg) = address.number("counts_per_deg") else {
        let reason = "give its microsteps of a degree (counts_per_deg=NUMBER): 1 / (microstep size in deg) of its data sheet";
        return Err(DeviceError::NotReady { device: DEVICE, reason });
    };
    let mut link = LinkSettings::new(counts_per_deg);
    link.device = address.integer("device").unwrap_or(link.device);
    link.axis = address.integer("axis").unwrap_or(link.axis);
    let mut stage = crate::zaber::open(line.into_bytes(DEVICE)?, link, turning(address), deadline)?;
    if address.flag("trust_counter") {
        stage.trust_counter();
    }
    Ok(AnyDevice::RotationStage(Box::new(stage)))
}
