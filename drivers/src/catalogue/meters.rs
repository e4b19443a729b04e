//! Power meters: Ophir's, Thorlabs', and a simulated one of each.

use super::options::OptionKind::{Integer, Number};
use super::{Address, AnyDevice, Bus, Driver, Kind, Line, OptionSpec, Place, UsbId, Wire};
use crate::clock::Deadline;
use crate::device::{DeviceError, Update};
use crate::simulated::{InMemory, Steady, ophir as sim_ophir, pm100 as sim_pm100};
use crate::{ophir, thorlabs};
use std::time::Duration;

/// The light on a simulated head.
const POWER: OptionSpec = OptionSpec {
    name: "power_w",
    kind: Number(-1.0, 1e3),
    default: "0.0013",
    about: "the light on the simulated head, W",
};

/// Values of an Ophir meter in a second.
const UPDATE_HZ: OptionSpec = OptionSpec {
    name: "update_hz",
    kind: Number(0.01, 1000.0),
    default: "",
    about: "new values of the meter in a second, as its manual says; measured if it is not given",
};

/// Ophir, by serial port.
pub(super) static OPHIR: Driver = Driver {
    name: "ophir",
    kind: Kind::PowerMeter,
    vendor: "Ophir (MKS)",
    title: "meters on a serial line: Nova II, Vega, LaserStar, Nova with its adapter; EA-1 by TCP",
    tried: "our simulated meter, which pylablib 1.4.3 drives too; no real meter yet",
    simulated: false,
    place: Place { form: "PORT", example: "ophir:/dev/ttyUSB0", optional: false },
    options: &[
        OptionSpec {
            name: "baud",
            kind: Integer(1200, 115_200),
            default: "9600",
            about: "speed of the serial line",
        },
        UPDATE_HZ,
    ],
    // A meter on a serial line is behind whatever adapter the user has.
    ids: &[],
    wire: Wire::Bytes,
    connect: |address, deadline| super::line::serial(ophir::DEVICE, address, deadline),
    open: open_ophir,
};

/// The simulated Ophir meter.
pub(super) static SIM_OPHIR: Driver = Driver {
    name: "sim-ophir",
    kind: Kind::PowerMeter,
    vendor: "sunglint",
    title: "a simulated Vega with a PD300 head",
    tried: "pylablib 1.4.3 drives it",
    simulated: true,
    place: Place { form: "", example: "sim-ophir", optional: true },
    options: &[
        POWER,
        OptionSpec {
            default: "15",
            about: "new values of the simulated meter in a second",
            ..UPDATE_HZ
        },
    ],
    ids: &[],
    wire: Wire::Bytes,
    connect: |address, _| {
        let light = Steady(address.number(POWER.name).unwrap_or(0.0));
        let mut settings = sim_ophir::OphirSettings::default();
        settings.update = period(address).unwrap_or(settings.update);
        Ok(Line::bytes(InMemory::new(sim_ophir::Ophir::new(settings, light))))
    },
    open: open_ophir,
};

/// The time from one value to the next, where it is given.
fn period(address: &Address) -> Option<Duration> {
    Some(Duration::from_secs_f64(1.0 / address.number(UPDATE_HZ.name)?))
}

fn open_ophir(
    line: Line,
    address: &Address,
    deadline: &Deadline,
) -> Result<AnyDevice, DeviceError> {
    let line = line.into_bytes(ophir::DEVICE)?;
    let link = ophir::LinkSettings::default();
    let mut settings = ophir::MeterSettings::default();
    if let Some(period) = period(address) {
        settings.update = Update::Known(period);
    }
    let meter = ophir::Meter::open(line, link, settings, deadline)?;
    Ok(AnyDevice::PowerMeter(Box::new(meter)))
}

/// Where a PM100 is spoken to; what is plugged in says it, a recording may have to.
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
        about: "the endpoint from the meter (found by itself)",
    },
    OptionSpec {
        name: "bulk_out",
        kind: Integer(1, 127),
        default: "2",
        about: "the endpoint to the meter (found by itself)",
    },
];

const fn pm100_ids() -> [UsbId; thorlabs::PRODUCTS.len()] {
    let empty = UsbId { bus: Bus::Usb, vendor: thorlabs::VENDOR, product: None, name: "" };
    let mut ids = [empty; thorlabs::PRODUCTS.len()];
    let mut i = 0;
    while i < ids.len() {
        let (product, name) = thorlabs::PRODUCTS[i];
        ids[i] = UsbId { product: Some(product), name, ..empty };
        i += 1;
    }
    ids
}

/// Thorlabs PM100.
pub(super) static PM100: Driver = Driver {
    name: "pm100",
    kind: Kind::PowerMeter,
    vendor: "Thorlabs",
    title: "meters PM100D, PM100A, PM100USB, PM101, PM160, PM200, PM400, by USB",
    tried: "our simulated meter, which python-usbtmc 0.8 drives too, through libusb under umockdev; no real meter yet",
    simulated: false,
    place: Place { form: "SERIAL", example: "pm100:P0000001", optional: true },
    options: &ENDPOINTS,
    ids: &pm100_ids(),
    wire: Wire::Transfers,
    connect: |address, _| {
        let (usb, found) = thorlabs::open(address.place.as_deref())?;
        if found != thorlabs::TmcSettings::default().endpoints {
            address.found("interface", found.interface.to_string());
            address.found("bulk_in", found.bulk_in.to_string());
            address.found("bulk_out", found.bulk_out.to_string());
        }
        Ok(Line::transfers(usb))
    },
    open: open_pm100,
};

/// The simulated PM100D.
pub(super) static SIM_PM100: Driver = Driver {
    name: "sim-pm100",
    kind: Kind::PowerMeter,
    vendor: "sunglint",
    title: "a simulated PM100D with an S120C sensor",
    tried: "python-usbtmc 0.8 drives it",
    simulated: true,
    place: Place { form: "", example: "sim-pm100", optional: true },
    options: &[POWER],
    ids: &[],
    wire: Wire::Transfers,
    connect: |address, _| {
        let light = Steady(address.number(POWER.name).unwrap_or(0.0));
        Ok(Line::transfers(sim_pm100::Pm100::new(Default::default(), light)))
    },
    open: open_pm100,
};

fn open_pm100(
    line: Line,
    address: &Address,
    deadline: &Deadline,
) -> Result<AnyDevice, DeviceError> {
    let mut tmc = thorlabs::TmcSettings::default();
    let known = &mut tmc.endpoints;
    known.interface = address.integer("interface").unwrap_or(known.interface);
    known.bulk_in = address.integer("bulk_in").unwrap_or(known.bulk_in);
    known.bulk_out = address.integer("bulk_out").unwrap_or(known.bulk_out);
    let line = line.into_transfers(thorlabs::DEVICE)?;
    let meter = thorlabs::Pm100::open(line, tmc, thorlabs::Pm100Settings::default(), deadline)?;
    Ok(AnyDevice::PowerMeter(Box::new(meter)))
}
