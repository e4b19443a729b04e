//! The CM110 driver against our simulated instrument, on a virtual clock.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::catalogue::{Address, AnyDevice};
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, Monochromator as _, Value};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::cm110::{Cm110, Cm110Settings, Kind};
use sunglint_drivers::simulated::script::{Fault, Script};
use sunglint_drivers::spectral_products::frame::{Answer, Command, Query, Status, Unit};
use sunglint_drivers::spectral_products::{LinkSettings, Mono, MonoSettings};
use sunglint_drivers::transport::Bytes;
use sunglint_numerics::measured::Interval;

type InMemoryMono = Mono<InMemory<Cm110>>;

struct Bench {
    clock: Arc<VirtualClock>,
    mono: InMemoryMono,
}

impl Bench {
    fn new(faults: Vec<Fault<Kind>>) -> Self {
        let clock = Arc::new(VirtualClock::new());
        let mut device = Cm110::new(Cm110Settings::default());
        device.faults = Script::new(faults);
        let within = Deadline::after(clock.clone(), Duration::from_secs(10));
        let (link, settings) = (LinkSettings::default(), MonoSettings::default());
        let mono = Mono::open(InMemory::new(device), link, settings, &within).unwrap();
        Self { clock, mono }
    }

    fn within(&self, seconds: u64) -> Deadline {
        Deadline::after(self.clock.clone(), Duration::from_secs(seconds))
    }

    fn truth_nm(&self) -> f64 {
        self.mono.line().device.wavelength_nm(self.clock.now())
    }
}

fn fault(on: &str, nth: u32, kind: Kind) -> Vec<Fault<Kind>> {
    vec![Fault::new(on, nth, kind)]
}

/// Truth: the simulated motor, and arithmetic: 100 nm/s, tenths of a nanometre.
#[test]
fn it_goes_there_in_the_time_of_its_way() {
    let mut bench = Bench::new(Vec::new());
    let start = bench.clock.now();
    assert_eq!(bench.mono.move_to(550.0, &bench.within(60)).unwrap(), 550.0);
    let took = (bench.clock.now() - start).as_secs_f64();
    assert!((5.5..5.7).contains(&took), "{took} s for 550 nm");
    assert_eq!(bench.truth_nm(), 550.0);
    // The nearest tenth, from either side: there is no backlash.
    assert_eq!(bench.mono.move_to(699.96, &bench.within(60)).unwrap(), 700.0);
    assert_eq!(bench.mono.move_to(546.07, &bench.within(60)).unwrap(), 546.1);
    assert_eq!(bench.mono.wavelength_nm(&bench.within(5)).unwrap(), 546.1);
    let identity = bench.mono.identity(&bench.within(5)).unwrap();
    assert_eq!(identity.serial.as_deref(), Some("11042"));
    let settings = bench.mono.settings(&bench.within(5)).unwrap();
    let said: Vec<String> = settings.iter().map(|s| format!("{}={}", s.name, s.value)).collect();
    let expected =
        ["wavelength_nm=546.1", "grating=1", "grooves_per_mm=1200", "blaze_nm=500", "gratings=2"];
    assert_eq!(said, expected);
}

/// Truth: the instrument's own grating, and 15 s for it.
#[test]
fn a_grating_takes_its_time_and_is_read_back() {
    let mut bench = Bench::new(Vec::new());
    let start = bench.clock.now();
    let got = bench.mono.set_own("grating", "2", &bench.within(60)).unwrap();
    assert_eq!((got, bench.mono.line().device.grating()), (Value::Integer(2), 2));
    assert!(bench.clock.now() - start >= Duration::from_secs(15));
    // 600 lines reach twice as far.
    assert_eq!(bench.mono.move_to(2500.0, &bench.within(60)).unwrap(), 2500.0);
    for bad in ["3", "0", "-1", "blue", ""] {
        let error = bench.mono.set_own("grating", bad, &bench.within(60)).unwrap_err();
        assert!(error.to_string().contains("expected one of 1, 2"), "{error}");
    }
    let error = bench.mono.set_own("slit", "1", &bench.within(60)).unwrap_err();
    assert_eq!(error.to_string(), "setting: found slit, expected one of grating");
}

/// Truth: the instrument's own status (1500 nm is the reach of 1200 lines), and the driver's range.
#[test]
fn what_it_does_not_take_is_a_typed_error_and_nothing_moves() {
    let mut bench = Bench::new(Vec::new());
    let failed = bench.mono.move_to(1600.0, &bench.within(60)).unwrap_err();
    assert_eq!(
        failed.to_string(),
        "CM110 monochromator refused to go to 16000: the value is larger than it takes (code 130)"
    );
    assert!(matches!(*failed.error, DeviceError::Refused { code: 0x82, .. }));
    assert_eq!((failed.done, bench.truth_nm()), (Some(0.0), 0.0));
    for nm in [-1.0, 7000.0, f64::NAN, f64::INFINITY] {
        let failed = bench.mono.move_to(nm, &bench.within(60)).unwrap_err();
        assert!(matches!(*failed.error, DeviceError::OutOfRange { .. }), "{failed}");
    }
    let options = ["range_nm=300,800".to_owned()];
    let mut address = Address::parse("sim-cm110", &options).unwrap();
    let within = bench.within(10);
    let line = address.connect(&within).unwrap();
    let AnyDevice::Monochromator(mut mono) = address.open(line, &within).unwrap() else {
        panic!("a monochromator")
    };
    assert_eq!(mono.range_nm(), Some(Interval::new(300.0, 800.0)));
    let failed = mono.move_to(299.9, &within).unwrap_err();
    assert_eq!(failed.to_string(), "wavelength_nm: found 299.9, expected 300 to 800");
}

/// Truth: the motor. Each reply once silent, late, cut in half; each reading of a wavelength around 700 nm has the echo's byte in it.
#[test]
fn a_torn_reply_is_followed_by_a_clean_one() {
    let mut cases = Vec::new();
    for on in ["56 0", "16", "27", "56 19", "56 14"] {
        for nth in 1..4 {
            for late in [50, 450, 550, 900, 1400] {
                cases.push((on, nth, Kind::Late(Duration::from_millis(late))));
            }
            cases.push((on, nth, Kind::Silence));
            cases.push((on, nth, Kind::Half));
        }
    }
    for (on, nth, kind) in cases {
        let clock = Arc::new(VirtualClock::new());
        let within = |s| Deadline::after(clock.clone(), Duration::from_secs(s));
        let mut device = Cm110::new(Cm110Settings::default());
        device.faults = Script::new(fault(on, nth, kind));
        let (link, settings) = (LinkSettings::default(), MonoSettings::default());
        let line = InMemory::new(device);
        let mut mono = Mono::open(line, link, settings, &within(10)).unwrap();
        for nm in [700.0, 691.2, 716.7] {
            let got =
                mono.move_to(nm, &within(60)).unwrap_or_else(|e| panic!("{on} {kind:?}: {e}"));
            assert_eq!((got, mono.line().device.wavelength_nm(clock.now())), (nm, nm));
            assert_eq!(mono.wavelength_nm(&within(10)).unwrap(), nm, "{on} {nth} {kind:?}");
            assert_eq!(mono.identity(&within(10)).unwrap().serial.unwrap(), "11042");
        }
    }
}

/// Truth: the clock. The move goes on, the error says so, and the next call waits for its end.
#[test]
fn a_deadline_or_a_token_within_a_move_is_said_with_what_still_turns() {
    let mut bench = Bench::new(Vec::new());
    let start = bench.clock.now();
    let failed = bench.mono.move_to(1000.0, &bench.within(4)).unwrap_err();
    let took = bench.clock.now() - start;
    assert!(took <= Duration::from_secs(6), "{took:?}");
    assert!(failed.to_string().contains("the move took longer than 4.000 s"), "{failed}");
    assert!(failed.to_string().contains("may still be turning"), "{failed}");
    assert_eq!(failed.done, None);
    assert!(bench.mono.line().device.is_moving(bench.clock.now()));
    assert_eq!(bench.mono.wavelength_nm(&bench.within(10)).unwrap(), 1000.0);
    assert_eq!(bench.truth_nm(), 1000.0);

    let cancel = Cancel::new();
    cancel.cancel();
    let failed = bench.mono.move_to(500.0, &bench.within(60).with_cancel(&cancel)).unwrap_err();
    assert!(matches!(*failed.error, DeviceError::Cancelled { .. }), "{failed}");
    assert_eq!((failed.done, bench.truth_nm()), (Some(1000.0), 1000.0));
}

/// Truth: by construction: a motor that stops half way is no arrival, and is told within the time of its way.
#[test]
fn a_stuck_motor_ends_in_an_error_by_the_distance() {
    let mut bench = Bench::new(fault("16", 1, Kind::Stuck));
    let start = bench.clock.now();
    let failed = bench.mono.move_to(500.0, &bench.within(300)).unwrap_err();
    // 500 nm at 25 nm/s, and looks after it.
    assert!(bench.clock.now() - start < Duration::from_secs(40), "{failed}");
    assert!(failed.to_string().contains("may still be turning"), "{failed}");
    // A status that says that there is nothing to do, though it stands elsewhere.
    let mut bench = Bench::new(fault("16", 0, Kind::Status(0x40)));
    let failed = bench.mono.move_to(500.0, &bench.within(300)).unwrap_err();
    assert!(matches!(*failed.error, DeviceError::NotTaken { .. }), "{failed}");
    assert_eq!(failed.done, Some(0.0));
}

/// Truth: by construction: an instrument that was switched off and on speaks in nanometres, and 55 is not taken for 5.5 nm.
#[test]
fn a_unit_that_changed_is_noticed() {
    let mut bench = Bench::new(Vec::new());
    bench.mono.move_to(550.0, &bench.within(60)).unwrap();
    let deadline = bench.within(1);
    bench.mono.line_mut().send(&[50, 1], &deadline).unwrap();
    bench.clock.sleep(Duration::from_millis(10));
    bench.mono.line_mut().discard(&deadline).unwrap();
    let error = bench.mono.wavelength_nm(&bench.within(10)).unwrap_err();
    assert!(error.to_string().contains("its unit is no longer"), "{error}");
    assert!(bench.mono.move_to(600.0, &bench.within(10)).is_err());
    assert_eq!(bench.truth_nm(), 550.0, "it was not sent off in another unit");
}

/// Truth: the bytes of the protocol, written by hand.
#[test]
fn frames_are_the_protocols_bytes() {
    assert_eq!(Command::Goto(5500).emit(), [16, 0x15, 0x7c]);
    assert_eq!(Command::Ask(Query::Serial).emit(), [56, 19]);
    assert_eq!(Command::Units(Unit::Angstrom).emit(), [50, 2]);
    assert_eq!(Command::Select(2).emit(), [26, 2]);
    let answer = Answer::parse(&[0x15, 0x7c, 2, 24]).unwrap();
    assert_eq!((answer.value, answer.status.unit()), (Some(5500), Some(Unit::Angstrom)));
    let small = Status(0xa1);
    assert!(small.refused().unwrap().contains("smaller"));
    assert_eq!(small.unit(), Some(Unit::Nanometre));
    for bad in [&[][..], &[24], &[0, 0, 2], &[0x15, 0x7c, 2, 25], &[7, 24], &[1, 2, 3, 4, 24]] {
        assert!(Answer::parse(bad).is_err(), "{bad:?}");
    }
}

fn name(error: &DeviceError) -> &'static str {
    match error {
        DeviceError::Transport { .. } => "transport",
        DeviceError::TooSlow { .. } => "too slow",
        DeviceError::Protocol { .. } => "protocol",
        DeviceError::Refused { .. } => "refused",
        DeviceError::NotTaken { .. } => "not taken",
        DeviceError::NotStopped { .. } => "not stopped",
        DeviceError::Unknown { .. } => "unknown",
        other => panic!("no such error can come of a bad line: {other}"),
    }
}

/// One life on a bad line. Panics on a wrong number or a missed deadline.
fn life(faults: Faults, seed: u64) -> (Result<(), &'static str>, Injected, u32) {
    let clock = Arc::new(VirtualClock::new());
    let within = |s| Deadline::after(clock.clone(), Duration::from_secs(s));
    let line = Faulty::new(InMemory::new(Cm110::new(Cm110Settings::default())), faults, seed);
    let settings = MonoSettings::default();
    let grace = settings.look_within + Duration::from_millis(50);
    let bounded = |start: Duration, s: u64| {
        let took = clock.now() - start;
        assert!(took <= Duration::from_secs(s) + grace, "seed {seed}: it took {took:?}");
    };
    let mono = Mono::open(line, LinkSettings::default(), settings, &within(10));
    bounded(Duration::ZERO, 10);
    let mut mono = match mono {
        Ok(mono) => mono,
        Err(error) => return (Err(name(&error)), Injected::default(), 0),
    };
    let mut end = Ok(());
    for target in [546.1, 700.0, 435.8, 1013.9, 691.3] {
        let start = clock.now();
        let moved = mono.move_to(target, &within(90));
        bounded(start, 90);
        let device = &mono.line().inner().device;
        let truth = device.wavelength_nm(clock.now());
        // The one fault that no reading shows: "go to" spoilt into "this is".
        if device.calibrated() > 0 {
            return (Err("calibrated"), mono.into_line().injected(), 1);
        }
        match moved {
            Ok(nm) => {
                // One tenth beside the target is taken: a spoilt lowest bit may send it there.
                assert!((nm - target).abs() < 0.11, "seed {seed}: {nm} for {target}");
                assert!((nm - truth).abs() < 1e-9, "seed {seed}: {nm}, it is at {truth}");
            }
            Err(failed) => {
                end = Err(name(&failed.error));
                if let Some(nm) = failed.done {
                    assert!((nm - truth).abs() < 1e-9, "seed {seed}: {nm}, it is at {truth}");
                }
                break;
            }
        }
    }
    (end, mono.into_line().injected(), 0)
}

/// Truth: the simulated motor and the clock. Every life ends right or with a named error, in time.
#[test]
fn a_thousand_seeds_end_right_or_with_a_named_error() {
    let mild = Faults {
        delay: 0.05,
        longest_delay: Duration::from_millis(900),
        drop: 0.000_3,
        flip: 0.000_3,
        short_read: 0.2,
        silence: 0.003,
        disconnect: 0.0,
    };
    let bad = Faults { delay: 0.1, drop: 0.003, flip: 0.003, silence: 0.01, ..mild };
    let breaking = Faults { disconnect: 0.001, ..mild };
    let mut ends: BTreeMap<(&str, String), u32> = BTreeMap::new();
    let (mut sum, mut calibrated) = (Injected::default(), 0);
    for seed in 0..1500 {
        let (kind, faults) =
            [("mild", mild), ("bad", bad), ("breaking", breaking)][seed as usize % 3];
        let (end, injected, spoilt) = life(faults, seed);
        *ends.entry((kind, format!("{end:?}"))).or_default() += 1;
        sum.drops += injected.drops;
        sum.flips += injected.flips;
        sum.silences += injected.silences;
        calibrated += spoilt;
    }
    eprintln!("{ends:#?}\n{sum:?}");
    let right = |kind| ends.get(&(kind, "Ok(())".into())).copied().unwrap_or(0);
    assert!(sum.drops > 200 && sum.flips > 200 && sum.silences > 200, "{sum:?}");
    assert!(right("mild") > 450, "{ends:?}");
    assert!(right("bad") > 100 && right("breaking") < 500, "{ends:?}");
    assert!(calibrated < 8, "{calibrated}");
    assert_eq!(life(bad, 4), life(bad, 4), "the same seed, the same run");
    assert_eq!(life(Faults::NONE, 1).0, Ok(()));
}

/// The work of `devices move` and `devices read`, on the computer's clock: 5 nm are 50 ms. Truth: the target; the lamp's lines are in the other tests.
#[test]
fn a_session_moves_and_reads_the_simulated_instruments() {
    use sunglint_drivers::session::{Peer, ReadOptions, Reading, Session, SessionOptions, Target};
    use sunglint_numerics::progress::Silent;
    for name in ["sim-cm110", "sim-sp2150"] {
        let address = Address::parse(name, &[]).unwrap();
        let kind = address.driver.kind;
        let peer = Peer::live(&Cancel::new());
        let mut device = Session::start(&peer, address, &SessionOptions::default()).unwrap();
        let moves = device.travel(&[Target::parse("5", kind).unwrap()], &Silent);
        assert!(moves.failed.is_none(), "{moves:?}");
        assert_eq!(moves.at.wavelength_nm(), Some(5.0));
        let read = device.read(&ReadOptions::default(), &Silent).unwrap();
        assert!(matches!(read.readings[0], Reading::Wavelength { wavelength_nm: 5.0, .. }));
    }
    let address = Address::parse("sim-ocean", &[]).unwrap();
    let peer = Peer::live(&Cancel::new());
    let mut device = Session::start(&peer, address, &SessionOptions::default()).unwrap();
    let options = ReadOptions { exposure_s: 0.02, ..ReadOptions::default() };
    let read = device.read(&options, &Silent).unwrap();
    let Reading::Spectrum(spectrum) = &read.readings[0] else { panic!("a spectrum") };
    assert_eq!((spectrum.counts.len(), spectrum.integration_s), (2068, 0.02));
}
