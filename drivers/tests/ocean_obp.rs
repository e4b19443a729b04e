//! The OBP driver against our simulated HDX, on a virtual clock.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::catalogue::{Address, AnyDevice};
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, Spectrometer as _, Spectrum};
use sunglint_drivers::ocean::obp::{Flags, Frame, HEAD, MOST_DATA, TAIL, meaning, message, parse};
use sunglint_drivers::ocean::{Bulk, LinkSettings, Model, Obp, ObpSettings};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::simulated::ocean::{Kind, LINES, Ocean, OceanSettings};
use sunglint_drivers::simulated::script::{Fault, Script};
use sunglint_drivers::simulated::{InMemory, Speaker as _};
use sunglint_drivers::transport::{Bytes, Transfer, Transfers, TransportError};

struct Bench {
    clock: Arc<VirtualClock>,
    device: Obp<InMemory<Ocean>>,
}

impl Bench {
    fn new(settings: OceanSettings, faults: Vec<Fault<Kind>>) -> Self {
        Self::try_new(settings, faults).unwrap()
    }

    fn try_new(settings: OceanSettings, faults: Vec<Fault<Kind>>) -> Result<Self, DeviceError> {
        let clock = Arc::new(VirtualClock::new());
        let mut device = Ocean::new(settings);
        device.faults = Script::new(faults);
        let within = Deadline::after(clock.clone(), Duration::from_secs(20));
        let (link, settings) = (LinkSettings::default(), ObpSettings::default());
        let device = Obp::open(InMemory::new(device), link, settings, &within)?;
        Ok(Self { clock, device })
    }

    fn within(&self, seconds: u64) -> Deadline {
        Deadline::after(self.clock.clone(), Duration::from_secs(seconds))
    }

    /// A spectrum whose integration is the one that was asked for, and began after the call: by the simulated instrument's own account and its light.
    fn expose(&mut self, integration_s: f64) -> Result<Spectrum, DeviceError> {
        let called = self.clock.now();
        let spectrum = self.device.expose(integration_s, &self.within(60))?;
        check(&spectrum, &self.device.line().device, called, integration_s);
        Ok(spectrum)
    }
}

fn check(spectrum: &Spectrum, device: &Ocean, called: Duration, integration_s: f64) {
    let us = (integration_s * 1e6).round() as u32;
    let (since, of_us) = device.last();
    assert_eq!(of_us, us, "a spectrum of the old integration");
    assert!(since >= called, "it began at {since:?}, the call at {called:?}");
    assert_eq!(spectrum.integration_s, f64::from(us) / 1e6);
    assert_eq!(spectrum.counts.len(), spectrum.wavelength_nm.len());
    for (pixel, counts) in spectrum.counts.iter().enumerate() {
        let expected = device.expected(pixel, us).min(65_535.0);
        // Six sigma of the simulated noise: 12 counts and the light's.
        let most = 6.0 * (144.0 + (expected - 1500.0).max(0.0) / 10.0).sqrt() + 1.0;
        assert!((counts - expected).abs() <= most, "pixel {pixel}: {counts}, expected {expected}");
    }
}

/// Truth: the lamp's lines (NIST), the instrument's own account of which light is in a spectrum.
#[test]
fn a_lamps_lines_stand_where_they_are() {
    let mut bench = Bench::new(OceanSettings::default(), Vec::new());
    let identity = bench.device.identity(&bench.within(5)).unwrap();
    assert_eq!((identity.model.as_str(), identity.serial.as_deref()), ("HDX", Some("HDX01042")));
    let spectrum = bench.expose(0.05).unwrap();
    assert!(!spectrum.is_saturated());
    for (line, strength) in LINES.iter().filter(|(_, strength)| *strength > 3e5) {
        let near = |nm: &f64| (nm - line).abs() < 3.0;
        let (mut sum, mut first) = (0.0, 0.0);
        for (nm, counts) in spectrum.wavelength_nm.iter().zip(&spectrum.counts) {
            if near(nm) {
                let light = counts - 1520.0;
                sum += light;
                first += light * nm;
            }
        }
        let middle = first / sum;
        assert!((middle - line).abs() < 0.05, "{line} nm ({strength}): found at {middle}");
    }
    // Ten times as long, ten times the light: now it is at its end.
    let bright = bench.expose(0.5).unwrap();
    assert!(bright.is_saturated());
    assert_eq!(bright.saturation_counts, Some(65_535.0));
    let settings = bench.device.settings(&bench.within(5)).unwrap();
    let said: Vec<String> = settings.iter().map(|s| format!("{}={}", s.name, s.value)).collect();
    assert_eq!(said[0], "pixels=2068");
    assert_eq!(said[4], "integration_us=500000");
}

/// Truth: the instrument's own account, in each of its ways: it integrates all the time and answers the first question after a change with the old time, or begins
/// with the question; it tells its time or not; it repeats numbers or not.
#[test]
fn no_spectrum_is_of_an_old_integration_or_began_before_the_call() {
    for bits in 0..8 {
        let settings = OceanSettings {
            runs_free: bits & 1 == 0,
            tells_integration: bits & 2 == 0,
            repeats: bits & 4 == 0,
            ..OceanSettings::default()
        };
        let mut bench = Bench::new(settings, Vec::new());
        for integration_s in [0.01, 2.0, 2.0, 0.006, 0.1, 0.1, 0.5, 0.006, 3.0, 0.01] {
            for pause_ms in [0, 3, 777] {
                bench.clock.sleep(Duration::from_millis(pause_ms));
                bench.expose(integration_s).unwrap();
            }
        }
    }
}

/// Truth: by construction: a deadline that passes within an integration, or between the change and the first spectrum, leaves nothing old behind.
#[test]
fn what_was_interrupted_is_not_handed_out_later() {
    for ms in [1, 3, 7, 12, 40, 150, 900, 1005, 1012, 1500, 1990] {
        for cancelled in [false, true] {
            let mut bench = Bench::new(OceanSettings::default(), Vec::new());
            bench.expose(1.0).unwrap();
            let cancel = Cancel::new();
            let within = Deadline::after(bench.clock.clone(), Duration::from_millis(ms));
            if cancelled {
                cancel.cancel();
            }
            let start = bench.clock.now();
            let failed = bench.device.expose(0.02, &within.with_cancel(&cancel));
            assert!(bench.clock.now() - start <= Duration::from_millis(ms));
            if failed.is_err() {
                bench.expose(1.0).unwrap_or_else(|error| panic!("{ms} ms: {error}"));
                bench.expose(0.02).unwrap_or_else(|error| panic!("{ms} ms: {error}"));
            }
        }
    }
}

/// Truth: by construction: an instrument that was switched off and on has its first time again, and somebody else may set another.
#[test]
fn an_integration_that_somebody_else_changed_is_set_again() {
    let mut bench = Bench::new(OceanSettings::default(), Vec::new());
    bench.expose(0.3).unwrap();
    bench.device.line_mut().device.power_cycle();
    bench.expose(0.3).unwrap();
    let now = bench.clock.now();
    let mut other = Frame::new(message::SET_INTEGRATION, 0, &20_000_u32.to_le_bytes());
    other.flags = Flags(0);
    bench.device.line_mut().device.hear(&other.emit(), now);
    assert_eq!(bench.device.line().device.set_us(), 20_000);
    bench.expose(0.3).unwrap();
}

/// Truth: the model's limits, and the instrument's own refusals with their names.
#[test]
fn what_it_does_not_take_is_a_typed_error() {
    let mut bench = Bench::new(OceanSettings::default(), Vec::new());
    for bad in [0.0, -1.0, 0.005, 10.1, f64::NAN, f64::INFINITY, 1e300] {
        let error = bench.device.expose(bad, &bench.within(60)).unwrap_err();
        assert!(matches!(error, DeviceError::OutOfRange { .. }), "{error}");
    }
    for (error, word) in [(7, "not ready"), (13, "a fault within it"), (999, "no name here")] {
        let on = "00101000";
        let faults = vec![Fault::new(on, 0, Kind::Nack(error))];
        let mut bench = Bench::new(OceanSettings::default(), faults);
        let refused = bench.device.expose(0.1, &bench.within(60)).unwrap_err();
        assert!(refused.to_string().contains(word), "{refused}");
        assert!(refused.to_string().contains("the message 00101000"), "{refused}");
        assert!(matches!(refused, DeviceError::Refused { .. }));
    }
    let faults = vec![Fault::new("00110010", 0, Kind::Nack(6))];
    let mut bench = Bench::new(OceanSettings::default(), faults);
    let refused = bench.device.expose(0.1, &bench.within(60)).unwrap_err();
    assert!(refused.to_string().contains("data that it does not take (code 6)"), "{refused}");
    for code in (0..=13).chain(100..=104).chain([255]) {
        assert!(!meaning(code).contains("no name"), "{code}");
    }
    // Another model than it says, or none.
    let strange = OceanSettings { product: Some(0x1234), ..OceanSettings::default() };
    let error = Bench::try_new(strange, Vec::new()).err().unwrap();
    let expected = "model: found product 1234, expected one of HDX, FX, STS, VENTANA";
    assert_eq!(error.to_string(), expected);
    let silent = OceanSettings { product: None, ..OceanSettings::default() };
    assert!(Bench::try_new(silent, Vec::new()).err().unwrap().to_string().contains("none told"));
    let flat = OceanSettings { coefficients: vec![500.0, 0.0], ..OceanSettings::default() };
    let error = Bench::try_new(flat, Vec::new()).err().unwrap();
    assert!(error.to_string().contains("do not rise"), "{error}");
    for coefficients in [vec![500.0], vec![f32::NAN, 1.0], vec![0.0, 0.1], vec![1.0; 9]] {
        let bad = OceanSettings { coefficients, ..OceanSettings::default() };
        assert!(Bench::try_new(bad, Vec::new()).is_err());
    }
    let other = OceanSettings { pixels: 1024, ..OceanSettings::default() };
    let mut bench = Bench::new(other, Vec::new());
    let error = bench.device.expose(0.1, &bench.within(60)).unwrap_err();
    assert!(error.to_string().contains("a spectrum of 2048 bytes, HDX has 2068 pixels"), "{error}");
}

/// Truth: the instrument's account, for each answer that is silent, late, cut, put off, short or of a wrong checksum once.
#[test]
fn a_torn_answer_is_followed_by_a_clean_one() {
    let late = |ms| Kind::Late(Duration::from_millis(ms));
    let kinds = [
        Kind::Silence,
        late(300),
        late(1100),
        late(2500),
        Kind::Half,
        Kind::Deferred,
        Kind::WrongSum,
        Kind::Short,
    ];
    for repeats in [true, false] {
        for on in ["00000100", "00000e01", "00110000", "00110010", "00101000", "00180101"] {
            for nth in 1..4 {
                for kind in kinds {
                    let settings =
                        OceanSettings { repeats, checked: true, ..OceanSettings::default() };
                    let context = format!("{on} {nth} {kind:?}");
                    let faults = vec![Fault::new(on, nth, kind)];
                    let clock = Arc::new(VirtualClock::new());
                    let within = |s| Deadline::after(clock.clone(), Duration::from_secs(s));
                    let mut device = Ocean::new(settings);
                    device.faults = Script::new(faults);
                    let line = InMemory::new(device);
                    let link = LinkSettings::default();
                    let device = Obp::open(line, link, ObpSettings::default(), &within(20));
                    // A piece of a serial number or a number of the wrong length is told, not guessed, and two answers are waited for, no third.
                    let hopeless = kind == Kind::Short || kind == late(2500);
                    if hopeless && device.is_err() {
                        continue;
                    }
                    let device = device.unwrap_or_else(|error| panic!("{context}: {error}"));
                    let mut bench = Bench { clock, device };
                    for integration_s in [0.05, 0.4, 0.4, 0.01] {
                        match bench.expose(integration_s) {
                            Ok(_) => {}
                            Err(DeviceError::Protocol { .. }) if kind == Kind::Short => {}
                            Err(DeviceError::Transport { .. }) if kind == late(2500) => {}
                            Err(error) => panic!("{context}: {error}"),
                        }
                    }
                }
            }
        }
    }
}

/// The simulated instrument behind bulk endpoints, in packets.
struct OnUsb {
    device: InMemory<Ocean>,
}

impl Transfers for OnUsb {
    fn transfer(&mut self, t: &Transfer, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        match t {
            Transfer::BulkOut { endpoint: 1, data } => {
                self.device.send(data, deadline).map(|()| Vec::new())
            }
            Transfer::BulkIn { endpoint: 0x81, length } => {
                let mut packet = vec![0; 512.min(*length)];
                let count = self.device.receive(&mut packet, deadline)?;
                packet.truncate(count);
                Ok(packet)
            }
            other => panic!("{other:?}"),
        }
    }
}

/// Truth: the same instrument, over bulk transfers of 512 bytes.
#[test]
fn the_same_frames_over_bulk_endpoints() {
    let clock = Arc::new(VirtualClock::new());
    let within = |s| Deadline::after(clock.clone(), Duration::from_secs(s));
    let usb = OnUsb { device: InMemory::new(Ocean::new(OceanSettings::default())) };
    let line = Bulk::new(usb, sunglint_drivers::ocean::ENDPOINTS);
    let (link, settings) = (LinkSettings::default(), ObpSettings::default());
    let mut device = Obp::open(line, link, settings, &within(10)).unwrap();
    let spectrum = device.expose(0.1, &within(10)).unwrap();
    assert_eq!(spectrum.counts.len(), 2068);
    assert!(spectrum.counts.iter().all(|counts| *counts > 1000.0));
}

/// Truth: bytes written by hand after the layout of the sources; the MD5 of RFC 1321 (`md5` is tested with its digests).
#[test]
fn frames_are_the_protocols_bytes() {
    let mut set = Frame::new(message::SET_INTEGRATION, 7, &100_000_u32.to_le_bytes());
    set.flags = Flags(Flags::ASK_ACK);
    let mut expected = vec![0xc1, 0xc0, 0x00, 0x11, 0x04, 0x00, 0x00, 0x00];
    expected.extend([0x10, 0x00, 0x11, 0x00, 0x07, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 4]);
    expected.extend([0xa0, 0x86, 0x01, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 20, 0, 0, 0]);
    expected.extend([0; 16]);
    expected.extend([0xc5, 0xc4, 0xc3, 0xc2]);
    assert_eq!(set.emit(), expected);
    assert_eq!(expected.len(), HEAD + TAIL);
    assert_eq!(parse(&expected).unwrap().unwrap(), (set, 64));
    for length in [0, 1, 16, 17, 4136] {
        for checked in [false, true] {
            let data: Vec<u8> = (0..length).map(|i| (i * 7) as u8).collect();
            let mut frame = Frame::new(message::SPECTRUM_HDX, 1, &data);
            frame.checked = checked;
            let bytes = frame.emit();
            for cut in 0..bytes.len() {
                assert_eq!(parse(&bytes[..cut]), Ok(None), "{cut} of {length}");
            }
            assert_eq!(parse(&bytes).unwrap().unwrap(), (frame, bytes.len()));
            if checked {
                for at in (4..bytes.len() - 4).step_by(13) {
                    let mut spoilt = bytes.clone();
                    spoilt[at] ^= 4;
                    assert!(!matches!(parse(&spoilt), Ok(Some(_))), "byte {at} of {length}");
                }
            }
        }
    }
    let mut newer = expected.clone();
    newer[3] = 0x20;
    assert!(parse(&newer).unwrap_err().to_string().contains("OBP 2"));
    let mut huge = expected.clone();
    huge[40..44].copy_from_slice(&u32::try_from(TAIL + MOST_DATA + 1).unwrap().to_le_bytes());
    assert!(parse(&huge).is_err());
}

/// Truth: the catalogue's own forms; a serial line is refused.
#[test]
fn addresses_say_where_it_is() {
    let mut address = Address::parse("ocean:/dev/ttyUSB0", &[]).unwrap();
    let clock = Arc::new(VirtualClock::new());
    let within = Deadline::after(clock, Duration::from_secs(1));
    let error = address.connect(&within).unwrap_err();
    assert!(error.to_string().contains("ocean:tcp:"), "{error}");
    let options = ["lamp=0".to_owned(), "checksum=yes".to_owned(), "model=hdx".to_owned()];
    let mut address = Address::parse("sim-ocean", &options).unwrap();
    let line = address.connect(&within).unwrap();
    let AnyDevice::Spectrometer(mut device) = address.open(line, &within).unwrap() else {
        panic!("a spectrometer")
    };
    let dark = device.expose(0.02, &within).unwrap();
    let mean = dark.counts.iter().sum::<f64>() / dark.counts.len() as f64;
    // 1500 counts, and 400 a second; 12 counts of noise in 2068 pixels.
    assert!((mean - 1508.0).abs() < 2.0, "{mean}");
    assert_eq!(Model::named("sts").unwrap().pixels, 1024);
}

fn name(error: &DeviceError) -> &'static str {
    match error {
        DeviceError::Transport { .. } => "transport",
        DeviceError::TooSlow { .. } => "too slow",
        DeviceError::Protocol { .. } => "protocol",
        DeviceError::Refused { .. } => "refused",
        DeviceError::NotTaken { .. } => "not taken",
        DeviceError::Unknown { .. } => "unknown",
        other => panic!("no such error can come of a bad line: {other}"),
    }
}

/// One life on a bad line. Panics on a wrong spectrum or a missed deadline.
fn life(faults: Faults, checked: bool, seed: u64) -> (Result<(), &'static str>, Injected) {
    let clock = Arc::new(VirtualClock::new());
    let within = |s| Deadline::after(clock.clone(), Duration::from_secs(s));
    let settings = OceanSettings {
        checked,
        repeats: seed.is_multiple_of(2),
        tells_integration: seed % 4 < 2,
        runs_free: !seed.is_multiple_of(5),
        seed,
        ..OceanSettings::default()
    };
    let line = Faulty::new(InMemory::new(Ocean::new(settings)), faults, seed);
    let grace = Duration::from_millis(1);
    let bounded = |start: Duration, s: u64| {
        let took = clock.now() - start;
        assert!(took <= Duration::from_secs(s) + grace, "seed {seed}: it took {took:?}");
    };
    let device = Obp::open(line, LinkSettings::default(), ObpSettings::default(), &within(20));
    bounded(Duration::ZERO, 20);
    let mut device = match device {
        Ok(device) => device,
        Err(error) => return (Err(name(&error)), Injected::default()),
    };
    let mut end = Ok(());
    for integration_s in [0.02, 0.3, 0.3, 0.01, 0.01, 1.2] {
        let called = clock.now();
        let taken = device.expose(integration_s, &within(20));
        bounded(called, 20);
        match taken {
            Ok(spectrum) => {
                check(&spectrum, &device.line().inner().device, called, integration_s);
            }
            // A call that failed leaves nothing behind: the next one is right or an error, too.
            Err(error) => end = Err(name(&error)),
        }
    }
    (end, device.into_line().injected())
}

fn thousand(faults: Faults, checked: bool, least_right: u32) -> Injected {
    let breaking = Faults { disconnect: 0.002, ..faults };
    let mut ends: BTreeMap<String, u32> = BTreeMap::new();
    let mut sum = Injected::default();
    for seed in 0..1000 {
        let faults = if seed % 3 == 0 { breaking } else { faults };
        let (end, injected) = life(faults, checked, seed);
        *ends.entry(format!("{end:?}")).or_default() += 1;
        sum.drops += injected.drops;
        sum.flips += injected.flips;
        sum.silences += injected.silences;
        sum.delays += injected.delays;
    }
    eprintln!("{ends:?}\n{sum:?}");
    let right = ends.get("Ok(())").copied().unwrap_or(0);
    assert!((least_right..1000).contains(&right), "{ends:?}");
    assert_eq!(life(faults, checked, 4), life(faults, checked, 4), "the same seed, the same run");
    sum
}

/// Truth: the instrument's own account. A line that loses time and pieces, and alters nothing, as TCP and USB do not.
#[test]
fn a_thousand_seeds_on_a_losing_line() {
    let faults = Faults {
        delay: 0.03,
        longest_delay: Duration::from_millis(1500),
        drop: 0.0,
        flip: 0.0,
        short_read: 0.2,
        silence: 0.004,
        disconnect: 0.0,
    };
    let sum = thousand(faults, false, 400);
    assert!(sum.silences > 100 && sum.delays > 500, "{sum:?}");
}

/// The same with bytes altered and lost, where answers have a checksum.
#[test]
fn a_thousand_seeds_on_a_spoiling_line_with_checksums() {
    let faults = Faults {
        delay: 0.01,
        longest_delay: Duration::from_millis(1500),
        drop: 0.000_01,
        flip: 0.000_01,
        short_read: 0.2,
        silence: 0.001,
        disconnect: 0.0,
    };
    let sum = thousand(faults, true, 300);
    assert!(sum.drops > 200 && sum.flips > 200, "{sum:?}");
}
