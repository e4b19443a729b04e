//! The driver of the older USB protocol (OOI) against our simulated spectrometers, on a virtual clock.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::catalogue::{
    Access, Address, AnyDevice, Bus, DRIVERS, Line, OptionKind, Plugged, Wire,
};
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, Spectrometer as _, Spectrum};
use sunglint_drivers::ocean::ooi::{
    Layout, MARK, Model, Ooi, OoiSettings, Saturation, Speed, command, firmware, saturation,
    set_integration, slot_number, slot_order, slot_text, spectrum, status,
};
use sunglint_drivers::recording::{Header, Recording};
use sunglint_drivers::simulated::ooi::{self as sim, Kind, Runs};
use sunglint_drivers::simulated::script::{Fault, Script};
use sunglint_drivers::transport::{Transfer, Transfers, TransportError};
use sunglint_formats::atomic::Overwrite;

fn named(name: &str) -> Model {
    Model::named(name).unwrap()
}

struct Bench {
    clock: Arc<VirtualClock>,
    device: Ooi<sim::Ooi>,
}

impl Bench {
    fn new(settings: sim::OoiSettings) -> Self {
        Self::with(settings, Vec::new()).unwrap()
    }

    fn with(settings: sim::OoiSettings, faults: Vec<Fault<Kind>>) -> Result<Self, DeviceError> {
        let clock = Arc::new(VirtualClock::new());
        let model = settings.model;
        let mut device = sim::Ooi::new(settings);
        device.faults = Script::new(faults);
        let within = Deadline::after(clock.clone(), Duration::from_secs(20));
        let device = Ooi::open(device, model, OoiSettings::default(), &within)?;
        Ok(Self { clock, device })
    }

    fn within(&self, seconds: u64) -> Deadline {
        Deadline::after(self.clock.clone(), Duration::from_secs(seconds))
    }

    fn expose(&mut self, integration_s: f64) -> Result<Spectrum, DeviceError> {
        let called = self.clock.now();
        let spectrum = self.device.expose(integration_s, &self.within(60))?;
        check(&spectrum, self.device.line(), called, integration_s);
        Ok(spectrum)
    }
}

/// A spectrum is one that the instrument gave, value by value: of the integration that was asked for, and begun after the call.
fn check(spectrum: &Spectrum, device: &sim::Ooi, called: Duration, integration_s: f64) {
    let same = |given: &&sim::Given| {
        let counts = given.counts.iter().map(|count| f64::from(*count));
        counts.eq(spectrum.counts.iter().copied())
    };
    let given = device.given().iter().rev().find(same).expect("a spectrum that was never given");
    assert_eq!(f64::from(given.us) / 1e6, spectrum.integration_s, "of the old integration");
    assert!((spectrum.integration_s - integration_s).abs() <= 0.000_5 + 1e-9);
    assert!(given.since >= called, "it began at {:?}, the call at {called:?}", given.since);
    assert_eq!(spectrum.counts.len(), spectrum.wavelength_nm.len());
}

/// Truth: the instrument's own account, of each model at each speed, in each of its ways: it integrates all the time, once ahead, or when it is asked; commands wait for the spectrum before them, or do not.
#[test]
fn no_spectrum_of_any_model_is_of_an_old_integration_or_began_before_the_call() {
    for model in Model::ALL {
        for bits in 0..12 {
            let runs = [Runs::Freely, Runs::Ahead, Runs::Asked][bits % 3];
            let high_speed = model.layout == Layout::Words && bits % 2 == 0;
            if model.layout == Layout::Words && !high_speed && !model.tells_status {
                continue;
            }
            let in_order = bits < 6;
            let of = sim::OoiSettings::of(model);
            let settings = sim::OoiSettings { runs, high_speed, in_order, ..of };
            let mut bench = Bench::new(settings);
            for integration_s in [0.02, 2.0, 2.0, 0.016, 0.1, 0.1, 0.016] {
                for pause_ms in [0, 777] {
                    bench.clock.sleep(Duration::from_millis(pause_ms));
                    bench.expose(integration_s).unwrap_or_else(|error| {
                        panic!("{} {runs:?} {integration_s}: {error}", model.name)
                    });
                }
            }
        }
    }
}

/// Truth: by construction: a deadline that passes within an integration, or between the change and the first spectrum, leaves nothing old behind.
#[test]
fn what_was_interrupted_is_not_handed_out_later() {
    for name in ["usb2000", "usb4000", "nirquest512"] {
        for ms in [1, 3, 7, 12, 40, 150, 900, 1005, 1012, 1500, 1990, 2100] {
            for bits in 0..12 {
                let runs = [Runs::Freely, Runs::Ahead, Runs::Asked][bits % 3];
                let of = sim::OoiSettings::of(named(name));
                let mut bench = Bench::new(sim::OoiSettings { runs, in_order: bits < 6, ..of });
                bench.expose(1.0).unwrap();
                let cancel = Cancel::new();
                let within = Deadline::after(bench.clock.clone(), Duration::from_millis(ms));
                if bits % 2 == 0 {
                    cancel.cancel();
                }
                let start = bench.clock.now();
                let failed = bench.device.expose(0.02, &within.with_cancel(&cancel));
                assert!(bench.clock.now() - start <= Duration::from_millis(ms));
                if failed.is_err() {
                    let told = |error| panic!("{name} {runs:?} {ms} ms: {error}");
                    bench.expose(1.0).unwrap_or_else(told);
                    bench.expose(0.02).unwrap_or_else(told);
                }
            }
        }
    }
}

/// Truth: by construction: an instrument that was switched off and on has its first time again, and another program may set another, of models that tell their status.
#[test]
fn an_integration_that_somebody_else_changed_is_set_again() {
    let mut bench = Bench::new(sim::OoiSettings::of(named("usb4000")));
    bench.expose(0.3).unwrap();
    bench.device.line_mut().power_cycle();
    bench.expose(0.3).unwrap();
    let now = bench.clock.now();
    bench.device.line_mut().set_by_another(20_000, now);
    bench.expose(0.3).unwrap();
    // What another left waiting for a trigger is told to wait no more when it is opened.
    let mut device = sim::Ooi::new(sim::OoiSettings::of(named("usb4000")));
    device.trigger(3);
    let within = bench.within(20);
    let mut device = Ooi::open(device, named("usb4000"), OoiSettings::default(), &within).unwrap();
    device.expose(0.02, &bench.within(20)).unwrap();
    // And one that has waited since is an error in time.
    device.line_mut().trigger(3);
    let start = bench.clock.now();
    let error = device.expose(0.02, &bench.within(20)).unwrap_err();
    assert!(error.to_string().contains("no answer within"), "{error}");
    assert!(bench.clock.now() - start <= Duration::from_secs(20));
}

/// Truth: the table's limits and unit; what a model of whole milliseconds was set to is told.
#[test]
fn what_it_does_not_take_is_a_typed_error() {
    for model in Model::ALL {
        let mut bench = Bench::new(sim::OoiSettings::of(model));
        let [least, most] = model.integration_us.map(|us| f64::from(us) / 1e6);
        let range = bench.device.integration_s().unwrap().to_array();
        assert_eq!(range, [least, most]);
        let bad = [0.0, -1.0, least - 2e-6, most + 1.0, f64::NAN, f64::INFINITY, 1e300];
        for bad in bad {
            let error = bench.device.expose(bad, &bench.within(60)).unwrap_err();
            assert!(matches!(error, DeviceError::OutOfRange { .. }), "{error}");
        }
    }
    let mut bench = Bench::new(sim::OoiSettings::of(named("usb2000")));
    assert_eq!(bench.expose(0.0164).unwrap().integration_s, 0.016);
    assert_eq!(bench.expose(0.0166).unwrap().integration_s, 0.017);
    let mut bench = Bench::new(sim::OoiSettings::of(named("usb4000")));
    assert_eq!(bench.expose(0.016_437).unwrap().integration_s, 0.016_437);
}

/// Truth: the lamp's light, 0.1 s of which saturates the brightest line of `LINES`; slot 17's end, or the model's.
#[test]
fn a_spectrum_says_where_it_saturates() {
    for model in Model::ALL {
        // The brightest line, 253.65 nm, is out of reach of a NIRQuest.
        if model.name.starts_with("NIRQuest") {
            continue;
        }
        let settings = sim::OoiSettings::of(model);
        let end = f64::from(settings.saturation.unwrap_or(model.saturation));
        let mut bench = Bench::new(settings);
        let dim = bench.expose(0.016).unwrap();
        assert_eq!(dim.saturation_counts, Some(end), "{}", model.name);
        assert!(!dim.is_saturated(), "{}", model.name);
        assert!(bench.expose(0.5).unwrap().is_saturated(), "{}", model.name);
    }
}

/// Truth: by construction: a lamp so bright that each pixel stands at slot 17's end, spectrum after spectrum, which are equal and no copies.
#[test]
fn spectra_that_are_saturated_throughout_are_no_copies() {
    for name in ["usb4000", "usb2000", "maya2000pro"] {
        let mut settings = sim::OoiSettings { lamp: 0.0, ..sim::OoiSettings::of(named(name)) };
        settings.dark_counts_s = 1e9;
        let end = f64::from(settings.saturation.unwrap_or(settings.model.saturation));
        let mut bench = Bench::new(settings);
        let within = bench.within(60);
        for _ in 0..3 {
            let spectrum = bench.device.expose(0.02, &within).unwrap();
            assert!(spectrum.counts.iter().all(|counts| *counts == end), "{name}");
        }
    }
}

/// Truth: what was put into the memory.
#[test]
fn the_memory_is_read_and_told() {
    let settings = sim::OoiSettings::of(named("usb4000"));
    let mut bench = Bench::new(settings.clone());
    let identity = bench.device.identity(&bench.within(5)).unwrap();
    assert_eq!((identity.model.as_str(), identity.serial.as_deref()), ("USB4000", Some("SIM1022")));
    let calibration = bench.device.calibration().clone();
    let text = |slot: u8| settings.texts[&slot].parse::<f64>().unwrap();
    assert_eq!(calibration.wavelength, (1..5).map(text).collect::<Vec<_>>());
    assert_eq!(calibration.nonlinearity, Some((6..14).map(text).collect::<Vec<_>>()));
    assert_eq!((calibration.stray_light, calibration.saturation), (Some(0.002), Some(54_321)));
    bench.expose(0.25).unwrap();
    let settings = bench.device.settings(&bench.within(5)).unwrap();
    let said: Vec<String> = settings.iter().map(|s| format!("{}={}", s.name, s.value)).collect();
    for expected in [
        "pixels=3648",
        "saturation_counts=54321",
        "dark_pixels=5-15",
        "stray_light=0.002",
        "usb_speed=high",
        "integration_us=250000",
    ] {
        assert!(said.iter().any(|one| one == expected), "{expected}: {said:?}");
    }
    assert!(said.iter().any(|one| one.starts_with("nonlinearity=9.3e-1 2.9e-6 ")), "{said:?}");
}

/// Truth: memories that were never written, or hold no numbers. The wavelength is needed; the rest is not.
#[test]
fn a_memory_that_holds_no_calibration_is_an_error_that_says_so() {
    let with = |slot: u8, text: Option<&str>| {
        let mut settings = sim::OoiSettings::of(named("hr4000"));
        match text {
            Some(text) => settings.texts.insert(slot, text.to_owned()),
            None => settings.texts.remove(&slot),
        };
        Bench::with(settings, Vec::new())
    };
    for slot in 1..5 {
        for bad in [None, Some(""), Some("nan"), Some("inf"), Some("1,5"), Some("x")] {
            let error = with(slot, bad).err().unwrap().to_string();
            assert!(error.contains(&format!("slot {slot} of its memory: ")), "{error}");
            assert!(error.contains("no calibration of the wavelength"), "{error}");
        }
    }
    for (slot, bad) in [(1, "0"), (2, "-0.2"), (2, "1e9"), (3, "1"), (4, "-1e-6")] {
        let error = with(slot, Some(bad)).err().unwrap().to_string();
        assert!(error.contains("do not rise from pixel to pixel"), "{error}");
    }
    let error = with(0, None).err().unwrap().to_string();
    assert!(error.contains("its serial number: found "), "{error}");
    for bad in [None, Some("8"), Some("1.5"), Some("-1"), Some("x")] {
        let bench = with(14, bad).unwrap();
        assert_eq!(bench.device.calibration().nonlinearity, None);
        assert_eq!(bench.device.calibration().linear(100.0), None);
    }
    assert_eq!(with(9, None).unwrap().device.calibration().nonlinearity, None);
    assert_eq!(with(5, None).unwrap().device.calibration().stray_light, None);
    let two = with(14, Some("1")).unwrap();
    assert_eq!(two.device.calibration().nonlinearity, Some(vec![0.93, 2.9e-6]));
    // (1000) / (0.93 + 0.0029).
    assert!((two.device.calibration().linear(1000.0).unwrap() - 1000.0 / 0.9329).abs() < 1e-9);
}

/// Truth: bytes written here by the data sheets' layouts.
#[test]
fn frames_are_read_strictly() {
    let text = |text: &[u8]| [&[5, 3][..], text].concat();
    assert_eq!(slot_text(3, &text(b"-1.5e-05\0\0\0\0\0\0\0")).unwrap(), "-1.5e-05");
    assert_eq!(slot_text(3, &text(b" 0.123456789012")).unwrap(), "0.123456789012");
    assert_eq!(slot_number(3, &text(b"-1.5e-05 \0\0\xff\xff\xff\xff")).unwrap(), -1.5e-5);
    assert_eq!(slot_order(3, &text(b"7\0\0\0\0\0\0\0\0\0\0\0\0\0\0")).unwrap(), 7);
    for bad in [
        &b""[..],
        b"\x05",
        b"\x05\x03",
        b"\x05\x031.0\0\0\0\0\0\0\0\0\0\0\0",
        b"\x05\x031.0\0\0\0\0\0\0\0\0\0\0\0\0\0",
        b"\x05\x041.0\0\0\0\0\0\0\0\0\0\0\0\0",
        b"\x06\x031.0\0\0\0\0\0\0\0\0\0\0\0\0",
        b"\x05\x03\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0",
        b"\x05\x031.0\xff\0\0\0\0\0\0\0\0\0\0\0",
        b"\x05\x03\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff",
    ] {
        assert!(slot_number(3, bad).is_err(), "{bad:?}");
    }
    let mut told = [0; 16];
    told[2..6].copy_from_slice(&20_000_u32.to_le_bytes());
    assert_eq!(status(&told).unwrap().integration, 20_000);
    assert_eq!(status(&told).unwrap().speed, Speed::Full);
    told[14] = 0x80;
    assert_eq!(status(&told).unwrap().speed, Speed::High);
    told[14] = 0x40;
    assert!(status(&told).is_err() && status(&[0; 15]).is_err() && status(&[0; 17]).is_err());
    // Version 2.1.5 of a register, low byte first.
    assert_eq!(firmware(&[4, 0x15, 0x20]).unwrap(), [2, 1, 5]);
    assert_eq!(firmware(&[0xfe, 0x15, 0x3f]).unwrap(), [3, 0xf1, 5]);
    assert!(firmware(&[5, 0, 0]).is_err() && firmware(&[4, 0]).is_err());

    assert_eq!(set_integration(&named("usb4000"), 20_000), [2, 0x20, 0x4e, 0, 0]);
    assert_eq!(set_integration(&named("usb2000"), 20_000), [2, 20, 0, 0, 0]);
    assert_eq!((command::INITIALISE, command::SPECTRUM, command::STATUS), (1, 9, 0xfe));

    let end = |name: &str, at: usize, bytes: &[u8]| {
        let mut answer = [0; 17];
        answer[..2].copy_from_slice(&[5, 17]);
        answer[2 + at..2 + at + bytes.len()].copy_from_slice(bytes);
        saturation(&named(name), &answer).unwrap()
    };
    assert_eq!(end("usb4000", 4, &[0x31, 0xd4]), Some(54_321));
    assert_eq!(end("usb4000", 4, &[0, 0]), None);
    assert_eq!(end("nirquest256", 4, &[0x61, 0xea, 0, 0]), Some(60_001));
    assert_eq!(end("nirquest256", 4, &[0xff; 4]), None);
    assert_eq!(end("apex", 0, &[0x1b, 0xf6]), Some(63_003));
    assert_eq!(end("apex", 0, &[0x00, 0x80]), None);
    assert_eq!(end("apex", 0, &[0xff, 0xff]), None);
    assert_eq!(end("hr4000", 4, &[1, 1]), None);
    assert_eq!(named("hr4000").slot_17, Saturation::Unused);

    // A USB2000: 64 low bytes, 64 high ones, and something on the four wires without a bit.
    let usb2000 = named("usb2000");
    let mut frame = vec![0; 4097];
    frame[4096] = MARK;
    (frame[0], frame[64]) = (0x34, 0xf2);
    (frame[63], frame[127]) = (0xff, 0x0f);
    (frame[128], frame[192]) = (0x01, 0x90);
    let counts = spectrum(&usb2000, &frame).unwrap();
    assert_eq!((counts.len(), counts[0], counts[63], counts[64]), (2048, 0x234, 0xfff, 1));
    // An HR4000: bit 13 turned over, no more than 14 bits, 3648 of 3840 values.
    let hr4000 = named("hr4000");
    let mut frame = vec![0; 7681];
    frame[7680] = MARK;
    frame[..4].copy_from_slice(&[0x05, 0x20, 0xff, 0x1f]);
    let counts = spectrum(&hr4000, &frame).unwrap();
    assert_eq!((counts.len(), counts[0], counts[1], counts[2]), (3648, 5, 0x3fff, 0x2000));
    frame[5] = 0x40;
    let error = spectrum(&hr4000, &frame).unwrap_err().to_string();
    assert!(error.contains("24576 counts at pixel 2"), "{error}");
    // A QE65000: bit 15 turned over.
    let qe65000 = named("qe65000");
    let mut frame = vec![0; 2561];
    frame[2560] = MARK;
    frame[..4].copy_from_slice(&[0x05, 0x80, 0xff, 0x7f]);
    let counts = spectrum(&qe65000, &frame).unwrap();
    assert_eq!((counts.len(), counts[0], counts[1], counts[2]), (1044, 5, 0xffff, 0x8000));
    for model in Model::ALL {
        let mut frame = vec![0; model.frame_length()];
        if model.ends_with_mark {
            assert!(spectrum(&model, &frame).is_err(), "{}", model.name);
            *frame.last_mut().unwrap() = MARK;
        }
        assert_eq!(spectrum(&model, &frame).unwrap().len(), model.pixels);
        assert!(spectrum(&model, &frame[1..]).is_err(), "{}", model.name);
        frame.push(MARK);
        assert!(spectrum(&model, &frame).is_err(), "{}", model.name);
        assert!(spectrum(&model, &[]).is_err());
    }
}

/// Truth: the instrument's account, for each answer that is silent, late, cut, torn, repeated, altered, preceded by garbage or stalled once.
#[test]
fn a_torn_answer_is_followed_by_a_clean_one() {
    let late = |ms| Kind::Late(Duration::from_millis(ms));
    let kinds = [
        Kind::Silence,
        late(300),
        late(1100),
        late(2500),
        Kind::Half,
        Kind::LostPacket,
        Kind::RepeatedPacket,
        Kind::Twice,
        Kind::WrongEnd,
        Kind::Before(vec![0x69; 64]),
        Kind::Before(vec![0x05, 0x00]),
        Kind::Say(vec![0xff; 17]),
        Kind::Stall,
    ];
    let (mut right, mut wrong) = (0, 0);
    for name in ["usb2000", "usb4000", "jaz", "nirquest512"] {
        for on in ["0500", "0501", "fe", "09", "0511"] {
            for nth in 1..5 {
                for kind in &kinds {
                    // The Jaz has no mark at the end: an altered byte is one of its counts, which nobody can see.
                    if name == "jaz" && *kind == Kind::WrongEnd {
                        continue;
                    }
                    for runs in [Runs::Freely, Runs::Ahead, Runs::Asked] {
                        let of = sim::OoiSettings::of(named(name));
                        let settings = sim::OoiSettings { runs, ..of };
                        let context = format!("{name} {on} {nth} {kind:?} {runs:?}");
                        let faults = vec![Fault::new(on, nth, kind.clone())];
                        let mut bench = match Bench::with(settings, faults) {
                            Ok(bench) => bench,
                            Err(error) => {
                                assert!(on != "09", "{context}: {error}");
                                wrong += 1;
                                continue;
                            }
                        };
                        for integration_s in [0.02, 0.02, 0.2, 0.016] {
                            match bench.expose(integration_s) {
                                Ok(_) => right += 1,
                                Err(error) => {
                                    eprintln!("{context}: {error}");
                                    wrong += 1;
                                }
                            }
                        }
                    }
                }
            }
        }
    }
    eprintln!("{right} right, {wrong} errors");
    // One fault is mended by the second try, but for an answer that is late by more than two of them wait.
    assert!(wrong * 50 < right, "{right} right, {wrong} errors");
}

/// A spectrum that stays the same, value by value, is a copy: no noise repeats in 2048 pixels. Truth: by construction.
#[test]
fn a_copy_is_told_and_a_spectrum_without_mark_too() {
    let on = |kind: Kind| {
        let settings = sim::OoiSettings::of(named("usb2000plus"));
        Bench::with(settings, vec![Fault::new("09", 0, kind)]).unwrap()
    };
    let expose = |mut bench: Bench| {
        let within = bench.within(60);
        bench.device.expose(0.1, &within).unwrap_err().to_string()
    };
    let mut frame = vec![0; 4097];
    frame[4096] = MARK;
    let error = expose(on(Kind::Say(frame)));
    assert!(error.contains("the same spectrum came twice"), "{error}");
    let error = expose(on(Kind::WrongEnd));
    assert!(error.contains("found `33`, expected 69, the mark at a spectrum's end"), "{error}");
    let error = expose(on(Kind::Half));
    assert!(error.contains("no answer within") && error.contains("(2048 bytes)"), "{error}");
    let error = expose(on(Kind::LostPacket));
    assert!(error.contains("a spectrum of 3585 bytes from endpoint 82"), "{error}");
    assert!(error.contains("USB2000+ sends 4097 there"), "{error}");
    let error = expose(on(Kind::Stall));
    assert!(error.contains("it stalled"), "{error}");
    let mut bench = Bench::new(sim::OoiSettings::of(named("usb2000plus")));
    bench.device.line_mut().unplug();
    let within = bench.within(60);
    let error = bench.device.expose(0.1, &within).unwrap_err().to_string();
    assert!(error.contains("is gone"), "{error}");
}

/// Truth: the numbers in `Model::ALL`: each model is an option of the driver, a number of the catalogue, and a simulated instrument that is opened by its name.
#[test]
fn each_model_is_found_by_its_number_and_opened_by_its_name() {
    let driver = DRIVERS.into_iter().find(|driver| driver.name == "ocean").unwrap();
    let option = driver.options.iter().find(|option| option.name == "model").unwrap();
    let OptionKind::Word(words) = option.kind else { panic!("{option:?}") };
    for model in Model::ALL {
        assert!(words.contains(&model.option), "{}", model.option);
        let id = driver.ids.iter().find(|id| id.product == Some(model.product)).unwrap();
        assert_eq!((id.vendor, id.name), (0x2457, model.title));
        let clock = Arc::new(VirtualClock::new());
        let within = Deadline::after(clock, Duration::from_secs(20));
        let options = [format!("model={}", model.option), "lamp=0.5".to_owned()];
        let mut address = Address::parse("sim-ocean", &options).unwrap();
        assert_eq!(address.wire(), Wire::Transfers);
        let line = address.connect(&within).unwrap();
        let AnyDevice::Spectrometer(mut device) = address.open(line, &within).unwrap() else {
            panic!("no spectrometer")
        };
        assert_eq!(device.identity(&within).unwrap().model, model.name);
        assert_eq!(device.expose(0.05, &within).unwrap().counts.len(), model.pixels);
        let real = Address::parse("ocean", &options[..1]).unwrap();
        assert_eq!(real.wire(), Wire::Transfers);
        let mut far = Address::parse("ocean:tcp:127.0.0.1:1", &options[..1]).unwrap();
        let error = far.connect(&within).unwrap_err().to_string();
        assert!(error.contains("it has no network"), "{error}");
    }
    assert_eq!(words.len(), 5 + Model::ALL.len());
    // The address by which `devices list` says that one is opened is one that opens it, whatever serial number its descriptor has.
    let plugged = |vendor, product| Plugged {
        bus: Bus::Usb,
        path: "/dev/bus/usb/001/007".to_owned(),
        ids: Some([vendor, product]),
        name: None,
        serial: Some("P0000001".to_owned()),
        access: Access::Granted,
    };
    let address = plugged(0x2457, 0x1022).address().unwrap();
    assert_eq!(Address::parse(&address, &[]).unwrap().to_string(), "ocean");
    assert_eq!(plugged(0x1313, 0x8078).address().unwrap(), "pm100:P0000001");
    assert_eq!(Address::parse("ocean", &[]).unwrap().wire(), Wire::Bytes);
}

/// Truth: the recording that was made: a driver that hears it again says the same and reads the same spectrum, by the address that the recording names.
#[test]
fn a_recording_is_heard_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("nirquest.rec");
    let header = Header {
        device: "Ocean Optics NIRQuest256".into(),
        source: "sunglint's simulated instrument".into(),
        host: None,
        recorded: None,
        synthetic: true,
    };
    let options = ["model=nirquest256".to_owned()];
    let session = |line: &mut dyn FnMut(&mut Address, &Deadline) -> Line| {
        let clock = Arc::new(VirtualClock::new());
        let within = Deadline::after(clock, Duration::from_secs(60));
        let mut address = Address::parse("sim-ocean", &options).unwrap();
        let line = line(&mut address, &within);
        let AnyDevice::Spectrometer(mut device) = address.open(line, &within).unwrap() else {
            panic!("no spectrometer")
        };
        device.expose(0.05, &within).unwrap().counts
    };
    let live = session(&mut |address, within| {
        let line = address.connect(within).unwrap();
        line.recorded(&path, &header, Overwrite::Refuse).unwrap()
    });
    let mut rest = None;
    let again = session(&mut |address, _| {
        let recording = Recording::read(&path).unwrap();
        let (line, left) = Line::replay(recording, address.wire());
        rest = Some(left);
        line
    });
    assert_eq!(live.len(), 256);
    assert_eq!(live, again);
    rest.unwrap().finish().unwrap();
}

/// How often what fails on a line of transfers.
#[derive(Debug, Clone, Copy)]
struct Rates {
    delay: f64,
    silence: f64,
    torn: f64,
    lost: f64,
    repeated: f64,
    again: f64,
    garbage: f64,
    stall: f64,
    gone: f64,
}

/// Faults that have happened.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Happened {
    delays: u32,
    silences: u32,
    torn: u32,
    lost: u32,
    repeated: u32,
    again: u32,
    garbage: u32,
    stalls: u32,
    gone: bool,
}

/// A bus that spoils what comes from the instrument: it holds it back, loses it, cuts it, loses or repeats a packet of it, gives it again to the next read, puts garbage before it, or stalls.
struct Bad {
    inner: sim::Ooi,
    rates: Rates,
    state: u64,
    packet: usize,
    waiting: BTreeMap<u8, Vec<u8>>,
    happened: Happened,
}

impl Bad {
    /// xorshift64*: the seed alone decides.
    fn random(&mut self) -> f64 {
        self.state ^= self.state >> 12;
        self.state ^= self.state << 25;
        self.state ^= self.state >> 27;
        (self.state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn happens(&mut self, rate: f64) -> bool {
        self.random() < rate
    }
}

impl Transfers for Bad {
    fn transfer(
        &mut self,
        transfer: &Transfer,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, TransportError> {
        let rates = self.rates;
        if self.happened.gone || self.happens(rates.gone) {
            self.happened.gone = true;
            return Err(TransportError::disconnected("the spoilt bus"));
        }
        let Transfer::BulkIn { endpoint, length } = transfer else {
            return self.inner.transfer(transfer, deadline);
        };
        if let Some(left) = self.waiting.remove(endpoint) {
            return Ok(left[..left.len().min(*length)].to_vec());
        }
        let got = self.inner.transfer(transfer, deadline)?;
        if got.is_empty() {
            return Ok(got);
        }
        if self.happens(rates.delay) {
            self.happened.delays += 1;
            let wait = self.random() * 1.5;
            // What the host no longer waits for stays for its next read.
            if let Err(expired) = deadline.sleep(Duration::from_secs_f64(wait)) {
                self.waiting.insert(*endpoint, got);
                return Err(expired.into());
            }
        }
        if self.happens(rates.silence) {
            self.happened.silences += 1;
            loop {
                deadline.sleep(Duration::from_secs(1))?;
            }
        }
        if self.happens(rates.stall) {
            self.happened.stalls += 1;
            return Err(TransportError::Stalled { transfer: transfer.to_string() });
        }
        let mut spoilt = got;
        if self.happens(rates.again) {
            self.happened.again += 1;
            self.waiting.insert(*endpoint, spoilt.clone());
        }
        let packets = spoilt.len() / self.packet;
        let nth = (self.random() * packets as f64) as usize * self.packet;
        // One of these at a time: a packet that is lost in the spectrum in which another came twice is not seen by anybody.
        if packets > 0 && self.happens(rates.lost) {
            self.happened.lost += 1;
            spoilt.drain(nth..nth + self.packet);
        } else if packets > 0 && self.happens(rates.repeated) {
            self.happened.repeated += 1;
            let packet = spoilt[nth..nth + self.packet].to_vec();
            spoilt.splice(nth..nth, packet);
        } else if self.happens(rates.torn) {
            self.happened.torn += 1;
            let left = (self.random() * spoilt.len() as f64) as usize;
            spoilt.truncate(left);
        } else if self.happens(rates.garbage) {
            self.happened.garbage += 1;
            let count = 1 + (self.random() * 600.0) as usize;
            let garbage: Vec<u8> = (0..count).map(|_| (self.random() * 256.0) as u8).collect();
            self.waiting.insert(*endpoint, spoilt);
            spoilt = garbage;
        }
        // What does not fit stays for the next read.
        if spoilt.len() > *length {
            let rest = spoilt.split_off(*length);
            self.waiting.entry(*endpoint).or_default().splice(0..0, rest);
        }
        Ok(spoilt)
    }
}

fn name(error: &DeviceError) -> &'static str {
    match error {
        DeviceError::Transport { .. } => "transport",
        DeviceError::TooSlow { .. } => "too slow",
        DeviceError::Protocol { .. } => "protocol",
        DeviceError::NotTaken { .. } => "not taken",
        other => panic!("no such error can come of a bad line: {other}"),
    }
}

/// One life on a bad line. Panics on a wrong spectrum or a missed deadline.
fn life(rates: Rates, seed: u64) -> (Result<(), &'static str>, Happened) {
    let clock = Arc::new(VirtualClock::new());
    let within = |s| Deadline::after(clock.clone(), Duration::from_secs(s));
    let place = usize::try_from(seed).unwrap();
    let model = Model::ALL[place % Model::ALL.len()];
    let can_be_slow = model.layout == Layout::Words && model.tells_status;
    let high_speed = model.layout == Layout::Words && !(can_be_slow && seed.is_multiple_of(5));
    let settings = sim::OoiSettings {
        high_speed,
        runs: [Runs::Freely, Runs::Ahead, Runs::Asked][place / 16 % 3],
        in_order: seed % 7 < 4,
        seed,
        ..sim::OoiSettings::of(model)
    };
    let packet = if high_speed { 512 } else { 64 };
    let line = Bad {
        inner: sim::Ooi::new(settings),
        rates,
        state: seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1,
        packet,
        waiting: BTreeMap::new(),
        happened: Happened::default(),
    };
    let grace = Duration::from_millis(1);
    let bounded = |start: Duration, s: u64| {
        let took = clock.now() - start;
        assert!(took <= Duration::from_secs(s) + grace, "seed {seed}: it took {took:?}");
    };
    let device = Ooi::open(line, model, OoiSettings::default(), &within(20));
    bounded(Duration::ZERO, 20);
    let mut device = match device {
        Ok(device) => device,
        Err(error) => return (Err(name(&error)), Happened::default()),
    };
    let mut end = Ok(());
    for integration_s in [0.02, 0.3, 0.3, 0.016, 0.016, 1.2] {
        let called = clock.now();
        let taken = device.expose(integration_s, &within(20));
        bounded(called, 20);
        match taken {
            Ok(spectrum) => check(&spectrum, &device.line().inner, called, integration_s),
            // A call that failed leaves nothing behind: the next one is right or an error, too.
            Err(error) => end = Err(name(&error)),
        }
    }
    (end, device.into_line().happened)
}

/// Truth: the instruments' own account: each spectrum is one that was given, of the integration that was asked for, begun after the call.
#[test]
fn a_thousand_seeds_on_a_spoiling_bus() {
    let rates = Rates {
        delay: 0.01,
        silence: 0.003,
        torn: 0.004,
        lost: 0.01,
        repeated: 0.01,
        again: 0.01,
        garbage: 0.004,
        stall: 0.003,
        gone: 0.0,
    };
    let mut ends: BTreeMap<String, u32> = BTreeMap::new();
    let mut sum = Happened::default();
    for seed in 0..1000 {
        let gone = if seed % 3 == 0 { 0.0005 } else { 0.0 };
        let (end, happened) = life(Rates { gone, ..rates }, seed);
        *ends.entry(format!("{end:?}")).or_default() += 1;
        sum.delays += happened.delays;
        sum.silences += happened.silences;
        sum.torn += happened.torn;
        sum.lost += happened.lost;
        sum.repeated += happened.repeated;
        sum.again += happened.again;
        sum.garbage += happened.garbage;
        sum.stalls += happened.stalls;
    }
    eprintln!("{ends:?}\n{sum:?}");
    let right = ends.get("Ok(())").copied().unwrap_or(0);
    assert!((400..1000).contains(&right), "{ends:?}");
    let least = [sum.delays, sum.silences, sum.torn, sum.lost, sum.repeated, sum.again];
    assert!(least.iter().chain([&sum.garbage, &sum.stalls]).all(|n| *n > 50), "{sum:?}");
    assert_eq!(life(rates, 4), life(rates, 4), "the same seed, the same run");
}
