//! ZWO's filter wheel, and a simulated one.

use super::{Address, AnyDevice, Bus, Driver, Kind, Line, Place, UsbId, Wire};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::simulated::efw::{Efw, EfwSettings};
use crate::zwo::{self, DEVICE, PRODUCT, VENDOR, Wheel, WheelSettings};

/// ZWO EFW.
pub(super) static EFW: Driver = Driver {
    name: "efw",
    kind: Kind::FilterWheel,
    vendor: "ZWO",
    title: "electronic filter wheels EFW, by USB (HID)",
    tried: "our simulated wheel, through hidapi under umockdev; no real wheel yet",
    simulated: false,
    place: Place { form: "HIDRAW", example: "efw:/dev/hidraw0", optional: true },
    options: &[],
    ids: &[UsbId { bus: Bus::Hid, vendor: VENDOR, product: Some(PRODUCT), name: "ZWO EFW" }],
    wire: Wire::Transfers,
    connect: |address, _| zwo::open(address.place.as_deref()).map(Line::transfers),
    open,
};

/// The simulated wheel.
pub(super) static SIM_EFW: Driver = Driver {
    name: "sim-efw",
    kind: Kind::FilterWheel,
    vendor: "sunglint",
    title: "a simulated EFW with seven slots",
    tried: "reports as they were captured from one real wheel by another project",
    simulated: true,
    place: Place { form: "", example: "sim-efw", optional: true },
    options: &[],
    ids: &[],
    wire: Wire::Transfers,
    connect: |_, _| Ok(Line::transfers(Efw::new(EfwSettings::default()))),
    open,
};

fn open(line: Line, _: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let wheel = Wheel::open(line.into_transfers(DEVICE)?, WheelSettings::default(), deadline)?;
    Ok(AnyDevice::FilterWheel(Box::new(wheel)))
}
