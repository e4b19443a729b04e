//! Meters, sources and power meters that speak SCPI, each described by a small file.
//!
//! - [`Definition`]: the file (TOML), checked; [`TEMPLATES`]: files to begin with;
//! - [`Pattern`]: patterns of answers, with a named number; [`reply`]: where an answer ends, numbers, complaints, all parsed strictly;
//! - [`Response`]: the responsivity of a photodiode;
//! - [`Link`]: one question at a time, over TCP, a serial line, a Prologix GPIB adapter, [USBTMC](crate::usbtmc) or in requests of ZeroMQ;
//! - [`ScpiMeter`], [`ScpiSource`], [`ScpiPowerMeter`]: the devices.
//!
//! `docs/devices-scpi.md` lists every key of the file.
//!
//! # Rules
//! - One question is outstanding, ever. After a late, spoilt or missing answer a TCP connection is closed and opened, as raw TCP has no device clear; elsewhere
//!   buffers are cleared. Then the device says who it is before anything else counts.
//! - After each setting `SYST:ERR?` is asked until it says 0; the first error is [`DeviceError::Complained`](crate::device::DeviceError::Complained).
//! - ±9.9E37 is more than the range holds, 9.91E37 no number.
//! - On a serial line, which has no checksum, nothing rests on one answer: a reading is said twice (`READ?`, then `FETC?`), a setting is read back twice.
//! - A reading is measured after the call began: by a trigger, or by waiting where the device measures by itself ([`Meter`](crate::device::Meter)).
//!
//! # Sources
//! IEEE 488.2-1992; SCPI-99 volume 1 (7.2.1 numbers, 21.8 error queue); Prologix' GPIB-USB and GPIB-ETHERNET manuals (from memory); ZMTP 3.0 (ZeroMQ's RFC 23). The templates are from memory
//! of the makers' manuals, and say so.
//!
//! # Tried with
//! Nothing real yet: [our simulated instruments](crate::simulated::scpi), which pyvisa drives by TCP and on a pty, and a device made of sinstruments; ZeroMQ with a device made of pyzmq.

mod definition;
mod devices;
mod instrument;
mod link;
mod names;
mod pattern;
pub mod reply;
mod response;
mod way;
mod zmtp;

pub use definition::{Definition, DeviceKind};
pub use devices::{ScpiMeter, ScpiPowerMeter, ScpiSource};
pub use instrument::Told;
pub use link::{Cable, Link};
pub use pattern::{Captured, Pattern};
pub use response::Response;

use sunglint_formats::FileError;

/// The device in messages before its file was read.
pub(crate) const DEVICE: &str = "SCPI device";

/// A file of a device, to begin with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Template {
    /// Name of the template.
    pub name: &'static str,
    /// Text of the file.
    pub text: &'static str,
}

macro_rules! templates {
    ($($name:literal),* $(,)?) => {
        [$(Template { name: $name, text: include_str!(concat!("scpi/templates/", $name, ".toml")) }),*]
    };
}

/// Files to begin with. All are from memory of manuals, and none was tried with an instrument.
pub static TEMPLATES: [Template; 8] = templates![
    "keithley6485",
    "keithley2000",
    "keithley2400",
    "keysight34461a",
    "keysight34450a",
    "rigol_dp832",
    "photodiode",
    "idq_id900",
];

impl Template {
    /// The template of that name.
    pub fn named(name: &str) -> Option<&'static Self> {
        TEMPLATES.iter().find(|template| template.name == name)
    }
}

/// Reads the file of a device, or the template of that name.
///
/// # Errors
/// See [`Definition::read`].
pub fn definition(file: &str) -> Result<Definition, FileError> {
    match Template::named(file) {
        Some(template) => Definition::parse(format!("template:{file}"), template.text),
        None => Definition::read(file),
    }
}
