//! The recorded conversations with an Ophir meter: what the host does, what is wrong, and how it must end.

use super::words::{power, words};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock, Deadline};
use sunglint_drivers::device::{DeviceError, PowerMeter as _};
use sunglint_drivers::ophir::{LinkSettings, Meter, MeterSettings};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::Steady;
use sunglint_drivers::simulated::ophir::{HeadWavelengths, Kind, Ophir, OphirSettings};
use sunglint_drivers::simulated::script::{Fault, Script};
use sunglint_drivers::transport::{Bytes, TransportError};

pub const LINK: LinkSettings = LinkSettings { reply_within: Duration::from_millis(300) };

/// Does what the host does in every case. Returns how that ended, in words.
pub fn session(line: impl Bytes, clock: &Arc<dyn Clock>) -> String {
    let within = |seconds| Deadline::after(clock.clone(), Duration::from_secs(seconds));
    let settings = MeterSettings { settle: Duration::from_millis(50), ..MeterSettings::default() };
    let mut meter = match Meter::open(line, LINK, settings, &within(5)) {
        Ok(meter) => meter,
        Err(error) => return format!("open: {}", words(&error)),
    };
    let mut go = || -> Result<String, DeviceError> {
        let filter = meter.filter(&within(5))?.map_or("no filter", |filter| filter.name());
        let nm = meter.set_wavelength_nm(532.0, &within(5))?;
        let range = meter.set_range("3.00mW", &within(5))?;
        let reading = power(&meter.power(&within(5))?);
        Ok(format!("{reading} at {nm} nm, range {range}, filter {filter}"))
    };
    go().unwrap_or_else(|error| words(&error))
}

/// A line whose cable is pulled out in the middle of the answer to a command.
pub struct Cut<L> {
    line: L,
    at: &'static str,
    heard: Option<usize>,
}

impl<L: Bytes> Bytes for Cut<L> {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        if bytes.starts_with(self.at.as_bytes()) && !self.at.is_empty() {
            self.heard = Some(0);
        }
        self.line.send(bytes, deadline)
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        let count = self.line.receive(buffer, deadline)?;
        if let Some(heard) = &mut self.heard {
            *heard += count;
            if *heard >= 5 {
                return Err(TransportError::disconnected("the simulated meter"));
            }
        }
        Ok(count)
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        self.line.discard(deadline)
    }
}

pub struct Case {
    pub name: &'static str,
    pub settings: OphirSettings,
    pub watts: f64,
    pub faults: Vec<Fault<Kind>>,
    pub cut: &'static str,
    pub end: &'static str,
}

impl Case {
    pub fn line(&self) -> Cut<InMemory<Ophir>> {
        let mut meter = Ophir::new(self.settings.clone(), Steady(self.watts));
        meter.faults = Script::new(self.faults.clone());
        Cut { line: InMemory::new(meter), at: self.cut, heard: None }
    }
}

const GOOD: &str = "1.3e-3 W at 532 nm, range 3.00mW, filter OUT";

fn case(name: &'static str, end: &'static str) -> Case {
    let settings = OphirSettings::default();
    Case { name, settings, watts: 1.3e-3, faults: Vec::new(), cut: "", end }
}

fn fault(name: &'static str, on: &str, nth: u32, kind: Kind, end: &'static str) -> Case {
    Case { faults: vec![Fault::new(on, nth, kind)], ..case(name, end) }
}

pub fn cases() -> Vec<Case> {
    let with = |name, end, change: fn(&mut OphirSettings)| {
        let mut case = case(name, end);
        change(&mut case.settings);
        case
    };
    let late = Kind::Late(Duration::from_millis(400));
    vec![
        case("good", GOOD),
        Case {
            watts: 5e-3,
            ..case("over", "more than Some(0.003) W at 532 nm, range 3.00mW, filter OUT")
        },
        fault("late", "$SP", 1, late, GOOD),
        fault("half_a_line", "$SP", 1, Kind::Half, GOOD),
        fault("silence", "$SP", 0, Kind::Silence, "no answer but 0 bytes"),
        fault(
            "refused",
            "$WI",
            0,
            Kind::Say("?COM ERROR"),
            "Ophir power meter refused $WI2: it says `COM ERROR`",
        ),
        fault(
            "no_number",
            "$SP",
            0,
            Kind::Say("*1.3-0E-5"),
            "Ophir power meter: the answer to $SP: found `1.3-0E-5`, expected a reading such as `1.300E-5`, or `OVER`",
        ),
        fault(
            "sign_lost",
            "$SP",
            0,
            Kind::Say("*1.300E3"),
            "Ophir power meter: it reads 1.3e3 W, its largest range ends at 3e-2 W",
        ),
        with(
            "no_head",
            "open: Ophir power meter: no head: plug one in, and open the meter again",
            |settings| settings.head = "XX 0 NONE 00000000".into(),
        ),
        with("shows_dbm", GOOD, |settings| {
            settings.knows_dbm = true;
            settings.range = -2;
        }),
        with(
            "discrete_wavelengths",
            "wavelength_nm: found 532, expected one of 633, 1064, <800",
            |settings| {
                settings.wavelengths = HeadWavelengths::Discrete(vec!["633", "1064", "<800"])
            },
        ),
        Case { cut: "$SP", ..case("disconnect", "gone after 4 bytes") },
    ]
}
