//! Swabian Instruments' Time Taggers, and a simulated one.

use super::options::OptionKind::{Flag, Integer, Number};
use super::{Address, AnyDevice, Bus, Driver, Kind, Line, OptionSpec, Place, UsbId, Wire};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::simulated::swabian::{Poisson, Simulated, TaggerSpec};
use crate::swabian::{Channel, Source, TaggerSettings, TimeTagger, spawn};
use std::time::{SystemTime, UNIX_EPOCH};

/// In messages.
const DEVICE: &str = "Time Tagger";
/// The Python that has the maker's package, where it is not `python3`.
const PYTHON: &str = "SUNGLINT_SWABIAN_PYTHON";

const CHANNELS: OptionSpec = OptionSpec {
    name: "channels",
    kind: Integer(1, 18),
    default: "3",
    about: "inputs from 1 up that are counted, as c1, c2 …",
};

const MISSED: OptionSpec = OptionSpec {
    name: "missed",
    kind: Flag,
    default: "yes",
    about: "count missed events too: a tag stream beside the counter",
};

/// Swabian Time Tagger.
pub(super) static TIME_TAGGER: Driver = Driver {
    name: "timetagger",
    kind: Kind::PhotonCounter,
    vendor: "Swabian Instruments",
    title: "Time Taggers, by the maker's Python package (`pip install Swabian-TimeTagger`; another Python: $SUNGLINT_SWABIAN_PYTHON)",
    tried: "our simulated one, and the maker's package 2.22.6 without hardware; no real Time Tagger yet",
    simulated: false,
    place: Place { form: "SERIAL|HOST:PORT", example: "timetagger:2138000XYZ", optional: true },
    options: &[CHANNELS, MISSED],
    ids: &[UsbId {
        bus: Bus::Usb,
        vendor: 0x151f,
        product: None,
        name: "Swabian Time Tagger (Opal Kelly)",
    }],
    wire: Wire::Bytes,
    connect: |_, _| {
        let python = std::env::var_os(PYTHON).unwrap_or_else(|| "python3".into());
        let child = spawn(python).map_err(|error| DeviceError::transport(DEVICE, error))?;
        Ok(Line::bytes(child))
    },
    open,
};

/// The simulated Time Tagger.
pub(super) static SIM_TIME_TAGGER: Driver = Driver {
    name: "sim-timetagger",
    kind: Kind::PhotonCounter,
    vendor: "sunglint",
    title: "a simulated Time Tagger Ultra behind its bridge, steady light on each input",
    tried: "its frames are those of our bridge",
    simulated: true,
    place: Place { form: "", example: "sim-timetagger", optional: true },
    options: &[
        CHANNELS,
        MISSED,
        OptionSpec {
            name: "rate_hz",
            kind: Number(0.0, 1e7),
            default: "10000",
            about: "the mean rate on each input, Hz",
        },
    ],
    ids: &[],
    wire: Wire::Bytes,
    connect: |address, deadline| {
        let rate_hz = address.number("rate_hz").unwrap_or(0.0);
        let rates: Vec<(i32, f64)> = (1..=18).map(|channel| (channel, rate_hz)).collect();
        // Its time is that of the computer, as the other simulated devices' is.
        let spec = TaggerSpec { epoch_ns: unix_ns_at_zero(deadline), ..TaggerSpec::default() };
        Ok(Line::bytes(Simulated::new(spec, Poisson::new(&rates, 1))))
    },
    open,
};

/// The computer's UTC where the deadline's clock shows zero, as Unix time, ns.
fn unix_ns_at_zero(deadline: &Deadline) -> i64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let zero = now.saturating_sub(deadline.now());
    i64::try_from(zero.as_nanos()).unwrap_or(0)
}

fn open(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let count: i32 = address.integer("channels").unwrap_or(3);
    let channel = |number: i32| Channel { name: format!("c{number}"), number };
    let source = match address.place.as_deref() {
        Some(place) if place.contains(':') => Source::Network { address: place.to_owned() },
        place => Source::Usb { serial: place.map(str::to_owned) },
    };
    let settings = TaggerSettings {
        source,
        channels: (1..=count).map(channel).collect(),
        missed: address.flag("missed"),
        ..TaggerSettings::default()
    };
    let tagger = TimeTagger::open(line.into_bytes(DEVICE)?, settings, deadline)?;
    Ok(AnyDevice::PhotonCounter(Box::new(tagger)))
}
