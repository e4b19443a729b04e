//! The recorded conversations of `fixtures/spectra`: monochromators and a spectrometer. Each replays strictly and ends as it says.
//!
//! They were recorded from our simulated instruments (synthetic), on a virtual clock, so that they are the same each time;
//! `SUNGLINT_UPDATE=1` records them anew.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::words::words;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock, Deadline, VirtualClock};
use sunglint_drivers::device::{DeviceError, Monochromator, Spectrometer as _};
use sunglint_drivers::recording::{Header, Recorded, Recording, Replay};
use sunglint_drivers::simulated::script::{Fault, Script};
use sunglint_drivers::simulated::{InMemory, cm110, ocean as sim_ocean, sp2150};
use sunglint_drivers::transport::{Bytes, TransportError};
use sunglint_drivers::{acton, ocean, spectral_products};
use sunglint_formats::atomic::Overwrite;
use sunglint_testkit::fixture;

/// A line whose cable is pulled out after so many reads.
struct Cut {
    line: Box<dyn Bytes>,
    reads: Option<u32>,
}

impl Bytes for Cut {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        self.line.send(bytes, deadline)
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        match &mut self.reads {
            Some(0) => return Err(TransportError::disconnected("the simulated instrument")),
            Some(left) => *left -= 1,
            None => {}
        }
        self.line.receive(buffer, deadline)
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        self.line.discard(deadline)
    }
}

#[derive(Clone)]
enum Which {
    Cm110(Vec<Fault<cm110::Kind>>),
    Sp2150(bool, Vec<Fault<sp2150::Kind>>),
    Ocean(Vec<Fault<sim_ocean::Kind>>),
}

struct Case {
    name: &'static str,
    which: Which,
    reads: Option<u32>,
    end: &'static str,
}

impl Case {
    fn line(&self) -> Cut {
        let line: Box<dyn Bytes> = match self.which.clone() {
            Which::Cm110(faults) => {
                let mut device = cm110::Cm110::new(Default::default());
                device.faults = Script::new(faults);
                Box::new(InMemory::new(device))
            }
            Which::Sp2150(echoes, faults) => {
                let settings = sp2150::Sp2150Settings { echoes, ..Default::default() };
                let mut device = sp2150::Sp2150::new(settings);
                device.faults = Script::new(faults);
                Box::new(InMemory::new(device))
            }
            Which::Ocean(faults) => {
                let settings = sim_ocean::OceanSettings { checked: true, ..Default::default() };
                let mut device = sim_ocean::Ocean::new(settings);
                device.faults = Script::new(faults);
                Box::new(InMemory::new(device))
            }
        };
        Cut { line, reads: self.reads }
    }

    fn device(&self) -> &'static str {
        match self.which {
            Which::Cm110(_) => "Spectral Products CM110",
            Which::Sp2150(..) => "Princeton Instruments SP-2-150i",
            Which::Ocean(_) => "Ocean Optics HDX",
        }
    }

    /// Does what the host does in every case. Returns how that ended, in words.
    fn session(&self, line: impl Bytes, clock: &Arc<dyn Clock>) -> String {
        let within = |seconds| Deadline::after(clock.clone(), Duration::from_secs(seconds));
        let go = || -> Result<String, DeviceError> {
            match self.which {
                Which::Cm110(_) => {
                    let (link, settings) = Default::default();
                    let mut mono: spectral_products::Mono<_> =
                        spectral_products::Mono::open(line, link, settings, &within(10))?;
                    go_there(&mut mono, 546.1, &within(60))
                }
                Which::Sp2150(..) => {
                    let (link, settings) = Default::default();
                    let mut mono: acton::Mono<_> =
                        acton::Mono::open(line, link, settings, &within(10))?;
                    go_there(&mut mono, 546.07, &within(90))
                }
                Which::Ocean(_) => {
                    let (link, settings) = Default::default();
                    let mut device: ocean::Obp<_> =
                        ocean::Obp::open(line, link, settings, &within(10))?;
                    let spectrum = device.expose(0.02, &within(30))?;
                    let most = spectrum.counts.iter().copied().fold(0.0, f64::max);
                    let at = spectrum.counts.iter().position(|counts| *counts == most).unwrap();
                    let nm = spectrum.wavelength_nm[at];
                    Ok(format!("{most} counts at {nm:.2} nm"))
                }
            }
        };
        go().unwrap_or_else(|error| words(&error))
    }
}

fn go_there(mono: &mut dyn Monochromator, nm: f64, d: &Deadline) -> Result<String, DeviceError> {
    let serial = mono.identity(d)?.serial.unwrap_or_default();
    let at = mono.move_to(nm, d).map_err(|failed| *failed.error)?;
    Ok(format!("{serial} at {at} nm"))
}

fn cm110(name: &'static str, on: &str, nth: u32, kind: cm110::Kind, end: &'static str) -> Case {
    Case { name, which: Which::Cm110(vec![Fault::new(on, nth, kind)]), reads: None, end }
}

fn sp2150(name: &'static str, on: &str, nth: u32, kind: sp2150::Kind, end: &'static str) -> Case {
    Case { name, which: Which::Sp2150(true, vec![Fault::new(on, nth, kind)]), reads: None, end }
}

fn spectrometer(
    name: &'static str,
    on: &str,
    nth: u32,
    kind: sim_ocean::Kind,
    end: &'static str,
) -> Case {
    Case { name, which: Which::Ocean(vec![Fault::new(on, nth, kind)]), reads: None, end }
}

fn cases() -> Vec<Case> {
    const CM110: &str = "11042 at 546.1 nm";
    const GONE: &str = "gone after 0 bytes";
    const OCEAN: &str = "19382 counts at 253.72 nm";
    const SP2150: &str = "21531234 at 546.07 nm";
    let late = Duration::from_millis(700);
    let plain = |name, which, end| Case { name, which, reads: None, end };
    vec![
        plain("cm110_good", Which::Cm110(Vec::new()), CM110),
        cm110("cm110_late", "56 0", 2, cm110::Kind::Late(late), CM110),
        cm110("cm110_half", "56 0", 2, cm110::Kind::Half, CM110),
        cm110("cm110_silence", "", 0, cm110::Kind::Silence, "no answer but 0 bytes"),
        cm110(
            "cm110_refused",
            "16",
            0,
            cm110::Kind::Status(0x80),
            "CM110 monochromator refused to go to 5461: the value is larger than it takes (code 130)",
        ),
        Case { reads: Some(12), ..plain("cm110_disconnect", Which::Cm110(Vec::new()), GONE) },
        plain("sp2150_good", Which::Sp2150(true, Vec::new()), SP2150),
        plain("sp2150_no_echo", Which::Sp2150(false, Vec::new()), SP2150),
        sp2150("sp2150_half", "?NM", 2, sp2150::Kind::Half, SP2150),
        sp2150("sp2150_silence", "", 0, sp2150::Kind::Silence, "no answer but 0 bytes"),
        sp2150(
            "sp2150_not_understood",
            "GOTO",
            0,
            sp2150::Kind::Say("GOTO ?"),
            "SP2150 monochromator refused 546.070 GOTO: it says `546.070 GOTO GOTO ?`",
        ),
        plain("ocean_good", Which::Ocean(Vec::new()), OCEAN),
        spectrometer(
            "ocean_not_ready",
            "00101000",
            0,
            sim_ocean::Kind::Nack(7),
            "Ocean spectrometer refused the message 00101000: it is not ready for this message (code 7)",
        ),
        spectrometer("ocean_wrong_sum", "00180101", 1, sim_ocean::Kind::WrongSum, OCEAN),
        spectrometer("ocean_silence", "", 0, sim_ocean::Kind::Silence, "no answer but 0 bytes"),
    ]
}

/// Truth: the named ends; the recordings in the repository, byte for byte.
#[test]
fn every_recording_ends_as_it_says() {
    for case in cases() {
        let path = fixture(&format!("spectra/{}.rec", case.name));
        let clock: Arc<dyn Clock> = Arc::new(VirtualClock::new());
        if std::env::var_os("SUNGLINT_UPDATE").is_some() {
            let header = Header {
                device: case.device().into(),
                source: "sunglint's simulated instrument".into(),
                host: Some("sunglint's driver".into()),
                recorded: None,
                synthetic: true,
            };
            let line = Recorded::create(case.line(), &path, &header, Overwrite::Allow).unwrap();
            assert_eq!(case.session(line, &clock), case.end, "recording {}", case.name);
        }
        let recording = Recording::read(&path).unwrap();
        assert!(recording.header.synthetic, "{} was made up, and says so", case.name);
        let clock: Arc<dyn Clock> = Arc::new(VirtualClock::new());
        let mut line = Replay::new(recording);
        assert_eq!(case.session(&mut line, &clock), case.end, "{}", case.name);
        line.finish().unwrap_or_else(|error| panic!("{}: {error}", case.name));
    }
}
