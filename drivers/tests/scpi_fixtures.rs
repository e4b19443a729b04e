//! The recorded conversations of `fixtures/scpi`: each replays strictly and ends as it says.
//!
//! They were recorded from our simulated picoammeter (synthetic), on a virtual clock, so that they are the same each time; `SUNGLINT_UPDATE=1` records them anew.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::scpi::{Shared, template};
use crate::common::words::words;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock, Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, Meter as _};
use sunglint_drivers::recording::{Header, Recorded, Recording, Replay};
use sunglint_drivers::scpi::{Cable, Link, ScpiMeter, Told};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::scpi::{Instrument, Kind, ScpiSettings};
use sunglint_drivers::simulated::script::{Fault, Script};
use sunglint_drivers::transport::Bytes;
use sunglint_formats::atomic::Overwrite;
use sunglint_testkit::fixture;

/// Opens, chooses a range, reads. Returns how that ended, in words.
fn session(line: impl Bytes + 'static) -> String {
    let clock: Arc<dyn Clock> = Arc::new(VirtualClock::new());
    let within = |seconds| Deadline::after(clock.clone(), Duration::from_secs(seconds));
    let about = template("keithley6485");
    let link = Link::stream(line, Cable::Unchecked, &about);
    let mut meter = match ScpiMeter::open(link, about, &Told::default(), &within(20)) {
        Ok(meter) => meter,
        Err(error) => return format!("open: {}", words(&error)),
    };
    let mut go = || -> Result<String, DeviceError> {
        let range = meter.set_own("range", "2nA", &within(20))?;
        Ok(format!("{:?} in {range}", meter.read(&within(20))?))
    };
    go().unwrap_or_else(|error| words(&error))
}

/// Name, current, A, fault, end.
type Case = (&'static str, f64, Option<Fault<Kind>>, &'static str);

fn cases() -> Vec<Case> {
    const GOOD: &str = "Value(1.2e-9) in 2nA";
    let late = Kind::Late(Duration::from_millis(5500));
    let at = |on: &str, nth, kind| Some(Fault::new(on, nth, kind));
    vec![
        ("good", 1.2e-9, None, GOOD),
        ("over", 5e-9, None, "Over in 2nA"),
        ("late", 1.2e-9, at("READ?", 1, late), GOOD),
        ("half_a_line", 1.2e-9, at("READ?", 1, Kind::Half), GOOD),
        ("digit_altered", 1.2e-9, at("READ?", 1, Kind::Say("+1.300000E-09A,1,0")), GOOD),
        ("silence", 1.2e-9, at("READ?", 0, Kind::Silence), "no answer but 0 bytes"),
        (
            "volts",
            1.2e-9,
            at("READ?", 0, Kind::Say("+1.2E-03V,1,0")),
            "Keithley 6485: the answer to READ?: found `+1.2E-03V,1,0`, expected `{value}A,{number},{number}`",
        ),
        ("refused", 1.2e-9, at("SYST:ERR?", 3, Kind::Say("-221,\"Settings conflict\"")), GOOD),
        (
            "not_taken",
            1.2e-9,
            at("CURR:RANG?", 0, Kind::Say("2.1E-8")),
            "Keithley 6485: range was set to 2nA, the device says 20nA",
        ),
        (
            "another_device",
            1.2e-9,
            at("*IDN?", 0, Kind::Say("ACME,1,2,3")),
            "open: Keithley 6485: the answer to *IDN?: found `ACME,1,2,3`, expected `KEITHLEY INSTRUMENTS INC.,MODEL {model},{serial},{firmware}`",
        ),
    ]
}

/// Truth: the named ends; the recordings in the repository, byte for byte.
#[test]
fn every_recording_of_scpi_ends_as_it_says() {
    for (name, amperes, fault, end) in cases() {
        let path = fixture(&format!("scpi/{name}.rec"));
        if std::env::var_os("SUNGLINT_UPDATE").is_some() {
            let settings = ScpiSettings { noise: 0.0, ..ScpiSettings::default() };
            let mut device = Instrument::new(settings, move |_| amperes);
            device.faults = Script::new(fault.into_iter().collect());
            let header = Header {
                device: "Keithley 6485".into(),
                source: "sunglint's simulated picoammeter".into(),
                host: Some("sunglint's SCPI driver".into()),
                recorded: None,
                synthetic: true,
            };
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            let line = InMemory::new(device);
            let line = Recorded::create(line, &path, &header, Overwrite::Allow).unwrap();
            assert_eq!(session(line), end, "recording {name}");
        }
        let recording = Recording::read(&path).unwrap();
        assert!(recording.header.synthetic, "{name} was made up, and says so");
        let line = Shared::new(Some(Replay::new(recording)));
        assert_eq!(session(Replayed(line.clone())), end, "{name}");
        let replay = line.with(Option::take).unwrap();
        replay.finish().unwrap_or_else(|error| panic!("{name}: {error}"));
    }
}

/// A replay that the test gets back.
struct Replayed(Shared<Option<Replay>>);

impl Bytes for Replayed {
    fn send(
        &mut self,
        bytes: &[u8],
        deadline: &Deadline,
    ) -> Result<(), sunglint_drivers::transport::TransportError> {
        self.0.with(|replay| replay.as_mut().unwrap().send(bytes, deadline))
    }

    fn receive(
        &mut self,
        buffer: &mut [u8],
        deadline: &Deadline,
    ) -> Result<usize, sunglint_drivers::transport::TransportError> {
        self.0.with(|replay| replay.as_mut().unwrap().receive(buffer, deadline))
    }

    fn discard(
        &mut self,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, sunglint_drivers::transport::TransportError> {
        self.0.with(|replay| replay.as_mut().unwrap().discard(deadline))
    }
}
