//! Every driver by its name: what it drives, how its address is written, by which numbers its device is recognised, how a line
//! to it is opened and how the device is made on that line.
//!
//! An [`Address`] is `DRIVER[:WHERE]` (`tmcl:/dev/ttyACM0`, `indi-camera:localhost:7624/CCD Simulator`) with options
//! (`gear=10`). [`Address::connect`] gives a [`Line`], boxed, so that a recorder, a replay or a fault injector can be put around
//! it; [`Address::open`] makes an [`AnyDevice`] on it. Simulated devices (`sim-…`) are drivers like others.
//!
//! A new driver is one [`Driver`] in a file of this folder, and one line in [`DRIVERS`].
//!
//! ```
//! use std::time::Duration;
//! use sunglint_drivers::catalogue::{Address, AnyDevice};
//! use sunglint_drivers::clock::Deadline;
//! use sunglint_drivers::device::Power;
//!
//! let mut address = Address::parse("sim-pm100", &["power_w=2e-6".to_owned()])?;
//! let within = || Deadline::within(Duration::from_secs(5));
//! let line = address.connect(&within())?;
//! let AnyDevice::PowerMeter(mut meter) = address.open(line, &within())? else { unreachable!() };
//! assert_eq!(meter.power(&within())?, Power::Watts(2e-6));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod address;
mod alpaca;
mod any;
mod apt;
mod elliptec;
mod indi;
mod inventory;
mod line;
mod meters;
mod monochromators;
mod newport;
mod ocean;
pub mod opencv;
mod options;
mod plugged;
mod scpi;
mod standa;
mod swabian;
mod trinamic;
pub mod udev;
mod zaber;
mod zwo;

pub use address::{Address, AddressError};
pub use alpaca::listed as alpaca_listed;
pub use any::AnyDevice;
pub use indi::{Listed, listed};
pub use inventory::{Inventory, ServerAsked, inventory};
pub use line::{Line, Rest, Wire};
pub use options::{OptionKind, OptionSpec};
pub use plugged::{Access, Plugged, plugged};

use crate::clock::Deadline;
use crate::device::DeviceError;
use std::fmt;

/// Every driver, real ones first.
pub static DRIVERS: [&Driver; 47] = [
    &swabian::TIME_TAGGER,
    &trinamic::TMCL,
    &apt::APT,
    &elliptec::ELLIPTEC,
    &zaber::ZABER,
    &newport::ESP301,
    &newport::SMC100,
    &standa::STANDA,
    &indi::CAMERA,
    &indi::ROTATOR,
    &indi::WHEEL,
    &indi::FOCUSER,
    &indi::TELESCOPE,
    &alpaca::CAMERA,
    &alpaca::ROTATOR,
    &alpaca::WHEEL,
    &alpaca::FOCUSER,
    &alpaca::TELESCOPE,
    &opencv::OPENCV,
    &meters::OPHIR,
    &meters::PM100,
    &monochromators::CM110,
    &monochromators::SP2150,
    &ocean::OCEAN,
    &zwo::EFW,
    &scpi::METERS,
    &scpi::SOURCES,
    &scpi::POWER_METERS,
    &swabian::SIM_TIME_TAGGER,
    &trinamic::SIM_TMCL,
    &apt::SIM_APT,
    &elliptec::SIM_ELLIPTEC,
    &zaber::SIM_ZABER,
    &newport::SIM_ESP301,
    &newport::SIM_SMC100,
    &standa::SIM_STANDA,
    &indi::SIM_CAMERA,
    &indi::SIM_ROTATOR,
    &indi::SIM_WHEEL,
    &meters::SIM_OPHIR,
    &meters::SIM_PM100,
    &monochromators::SIM_CM110,
    &monochromators::SIM_SP2150,
    &ocean::SIM_OCEAN,
    &zwo::SIM_EFW,
    &scpi::SIM_METER,
    &scpi::SIM_SOURCE,
];

/// Kind of a device: what it does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Counts photons.
    PhotonCounter,
    /// Takes frames.
    Camera,
    /// Measures optical power.
    PowerMeter,
    /// Turns to angles.
    RotationStage,
    /// Turns filters into the beam.
    FilterWheel,
    /// Moves a telescope's focus.
    Focuser,
    /// Points a telescope.
    Mount,
    /// Measures a quantity.
    Meter,
    /// Feeds a lamp, a laser or a sample.
    Source,
    /// Records spectra.
    Spectrometer,
    /// Chooses a wavelength.
    Monochromator,
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::PhotonCounter => "photon counter",
            Self::Camera => "camera",
            Self::PowerMeter => "power meter",
            Self::RotationStage => "rotation stage",
            Self::FilterWheel => "filter wheel",
            Self::Focuser => "focuser",
            Self::Mount => "mount",
            Self::Meter => "meter",
            Self::Source => "source",
            Self::Spectrometer => "spectrometer",
            Self::Monochromator => "monochromator",
        })
    }
}

/// How the system shows a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bus {
    /// USB device that a program speaks to by itself.
    Usb,
    /// HID device (`/dev/hidraw0`).
    Hid,
    /// Serial port (`/dev/ttyACM0`).
    Serial,
}

impl fmt::Display for Bus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Usb => "usb",
            Self::Hid => "hid",
            Self::Serial => "serial",
        })
    }
}

/// Numbers by which a device is recognised.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UsbId {
    /// How the system shows it.
    pub bus: Bus,
    /// The vendor's number.
    pub vendor: u16,
    /// The product's number; `None` for all of the vendor's.
    pub product: Option<u16>,
    /// Name of the device.
    pub name: &'static str,
}

impl UsbId {
    /// Whether a device with these numbers is meant.
    pub fn is(&self, bus: Bus, vendor: u16, product: u16) -> bool {
        (self.bus, self.vendor) == (bus, vendor) && self.product.is_none_or(|own| own == product)
    }
}

/// How the part of an address behind the driver's name is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// Form of the place (`[PORT]`); empty if there is none.
    pub form: &'static str,
    /// An example of a whole address.
    pub example: &'static str,
    /// Whether it can be left out.
    pub optional: bool,
}

/// A driver.
#[derive(Debug)]
pub struct Driver {
    /// Name of the driver in addresses.
    pub name: &'static str,
    /// Kind of device that it drives.
    pub kind: Kind,
    /// Who makes the devices.
    pub vendor: &'static str,
    /// The devices, in a line.
    pub title: &'static str,
    /// Devices that it was tried with, in a line.
    pub tried: &'static str,
    /// Whether the device is simulated by this program.
    pub simulated: bool,
    /// Where the device is.
    pub place: Place,
    /// Options that the driver may have to be given.
    pub options: &'static [OptionSpec],
    /// The numbers by which the device is recognised.
    pub ids: &'static [UsbId],
    /// Traffic on its line: bytes or requests.
    pub wire: Wire,
    /// Opens the line. What it finds on the way (endpoints, the port) it may put into the address, so that a replay knows.
    pub(crate) connect: fn(&mut Address, &Deadline) -> Result<Line, DeviceError>,
    /// Makes the device on the line.
    pub(crate) open: fn(Line, &Address, &Deadline) -> Result<AnyDevice, DeviceError>,
}

impl Driver {
    /// The driver of that name.
    ///
    /// # Errors
    /// No such driver; the nearest names.
    pub fn named(name: &str) -> Result<&'static Self, AddressError> {
        DRIVERS
            .into_iter()
            .find(|driver| driver.name == name)
            .ok_or_else(|| AddressError::no_driver(name))
    }

    /// Whether its device hands over time tags
    /// ([`PhotonCounter::streams_tags`](crate::device::PhotonCounter::streams_tags)), as far as is known without opening it.
    pub fn streams_tags(&self) -> bool {
        matches!(self.name, "timetagger" | "sim-timetagger")
    }

    /// The form of its addresses (`tmcl[:PORT]`).
    pub fn form(&self) -> String {
        match (self.place.form, self.place.optional) {
            ("", _) => self.name.to_owned(),
            (form, true) => format!("{}[:{form}]", self.name),
            (form, false) => format!("{}:{form}", self.name),
        }
    }

    /// The driver that recognises a device by its numbers.
    pub fn of(bus: Bus, vendor: u16, product: u16) -> Option<&'static Self> {
        DRIVERS.into_iter().find(|driver| driver.ids.iter().any(|id| id.is(bus, vendor, product)))
    }
}
