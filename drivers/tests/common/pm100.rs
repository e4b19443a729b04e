//! The recorded conversations with a Thorlabs meter: what the host does, what is wrong, and how it must end.
#![allow(dead_code, reason = "each test uses its part")]

use super::words::{power, words};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock, Deadline};
use sunglint_drivers::device::{DeviceError, PowerMeter as _};
use sunglint_drivers::simulated::Steady;
use sunglint_drivers::simulated::pm100::{self, Kind};
use sunglint_drivers::simulated::script::{Fault, Script};
use sunglint_drivers::thorlabs::{Pm100, Pm100Settings, TmcSettings};
use sunglint_drivers::transport::Transfers;

/// Does what the host does in every case. Returns how that ended, in words.
pub fn session(usb: impl Transfers, clear_first: bool, clock: &Arc<dyn Clock>) -> String {
    let within = |seconds| Deadline::after(clock.clone(), Duration::from_secs(seconds));
    let reply_within = Duration::from_millis(500);
    let tmc = TmcSettings { reply_within, clear_first, ..TmcSettings::default() };
    let mut meter = match Pm100::open(usb, tmc, Pm100Settings::default(), &within(5)) {
        Ok(meter) => meter,
        Err(error) => return format!("open: {}", words(&error)),
    };
    let mut go = || -> Result<String, DeviceError> {
        let nm = meter.set_wavelength_nm(532.0, &within(5))?;
        let range = meter.set_range("3mW", &within(5))?;
        let reading = power(&meter.power(&within(5))?);
        Ok(format!("{reading} at {nm} nm, range {range}"))
    };
    go().unwrap_or_else(|error| words(&error))
}

pub struct Case {
    pub name: &'static str,
    pub settings: pm100::Pm100Settings,
    pub watts: f64,
    pub faults: Vec<Fault<Kind>>,
    pub clear_first: bool,
    pub end: &'static str,
}

impl Case {
    pub fn usb(&self) -> pm100::Pm100 {
        let mut meter = pm100::Pm100::new(self.settings.clone(), Steady(self.watts));
        meter.faults = Script::new(self.faults.clone());
        meter
    }

    /// Whether a fake device can show it: none stays silent.
    pub fn is_for_umockdev(&self) -> bool {
        !["silence", "late"].contains(&self.name)
    }
}

const GOOD: &str = "1.3e-3 W at 532 nm, range 5e-3W";

fn case(name: &'static str, end: &'static str) -> Case {
    let settings = pm100::Pm100Settings::default();
    Case { name, settings, watts: 1.3e-3, faults: Vec::new(), clear_first: true, end }
}

fn fault(name: &'static str, on: &str, nth: u32, kind: Kind, end: &'static str) -> Case {
    Case { faults: vec![Fault::new(on, nth, kind)], ..case(name, end) }
}

pub fn cases() -> Vec<Case> {
    let with = |name, end, change: fn(&mut pm100::Pm100Settings)| {
        let mut case = case(name, end);
        change(&mut case.settings);
        case
    };
    let late = Kind::Late(Duration::from_millis(700));
    vec![
        case("good", GOOD),
        Case { clear_first: false, ..case("good_not_cleared", GOOD) },
        Case { watts: 8e-3, ..case("over", "more than Some(0.005) W at 532 nm, range 5e-3W") },
        fault("parts", "MEAS", 0, Kind::Parts, GOOD),
        fault("late", "MEAS", 1, late, GOOD),
        fault("wrong_tag", "MEAS", 1, Kind::WrongTag, GOOD),
        fault(
            "wrong_tag_always",
            "*IDN?",
            0,
            Kind::WrongTag,
            "open: Thorlabs power meter: the answer to *IDN?: a message with tag 3 and 252 as its inverse, expected 4 (02 03 fc 00 1f 00 00 00 01 00 00 00)",
        ),
        fault("short_read", "MEAS", 1, Kind::Short, GOOD),
        fault("stall", "MEAS", 1, Kind::Stall, GOOD),
        fault("silence", "MEAS", 0, Kind::Silence, "no answer but 0 bytes"),
        fault(
            "refused",
            "SYST:ERR?",
            4,
            Kind::Say("-222,\"Data out of range\""),
            "Thorlabs power meter refused SENS:CORR:WAV 532: it says `-222, Data out of range`",
        ),
        with(
            "no_sensor",
            "open: Thorlabs power meter: no sensor: plug one in, and open the meter again",
            |settings| settings.sensor = "no sensor".into(),
        ),
        with("shows_dbm", GOOD, |settings| settings.shows_dbm = true),
        with("slow_to_clear", GOOD, |settings| settings.clearing = 3),
        with("old_complaints", GOOD, |settings| {
            settings.complaints = vec!["-113,\"Undefined header\"", "-410,\"Query INTERRUPTED\""];
        }),
    ]
}
