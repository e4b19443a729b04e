//! The Acton driver against our simulated SP2150, on a virtual clock.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::acton::reply::{self, Answer};
use sunglint_drivers::acton::{LinkSettings, Mono, MonoSettings, Motion};
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, Monochromator as _, Value};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::script::{Fault, Script};
use sunglint_drivers::simulated::sp2150::{Kind, Sp2150, Sp2150Settings};

struct Bench {
    clock: Arc<VirtualClock>,
    mono: Mono<InMemory<Sp2150>>,
}

impl Bench {
    fn new(echoes: bool, motion: Motion, faults: Vec<Fault<Kind>>) -> Self {
        let clock = Arc::new(VirtualClock::new());
        let mut device = Sp2150::new(Sp2150Settings { echoes, ..Sp2150Settings::default() });
        device.faults = Script::new(faults);
        let within = Deadline::after(clock.clone(), Duration::from_secs(20));
        let settings = MonoSettings { motion, ..MonoSettings::default() };
        let line = InMemory::new(device);
        let mono = Mono::open(line, LinkSettings::default(), settings, &within).unwrap();
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

/// Truth: the simulated motor: steps of 0.005 nm, 60 nm/s, with and without an echo.
#[test]
fn it_goes_there_in_the_time_of_its_way() {
    for echoes in [true, false] {
        let mut bench = Bench::new(echoes, Motion::Goto, Vec::new());
        let start = bench.clock.now();
        assert_eq!(bench.mono.move_to(546.7, &bench.within(60)).unwrap(), 546.7);
        let took = (bench.clock.now() - start).as_secs_f64();
        assert!((9.1..9.3).contains(&took), "{took} s for 546.7 nm at 60 nm/s");
        assert_eq!(bench.mono.move_to(435.833, &bench.within(60)).unwrap(), 435.835);
        assert!((bench.truth_nm() - 435.835).abs() < 1e-9);
        let identity = bench.mono.identity(&bench.within(5)).unwrap();
        assert_eq!(identity.model, "SP-2-150i");
        assert_eq!(identity.serial.as_deref(), Some("21531234"));
        let settings = bench.mono.settings(&bench.within(5)).unwrap();
        let said: Vec<String> =
            settings.iter().map(|s| format!("{}={}", s.name, s.value)).collect();
        let echo = if echoes { "echo=on" } else { "echo=off" };
        let about = "grating_about=1200 g/mm BLZ=  500NM";
        let expected = ["wavelength_nm=435.835", "grating=1", about, "speed_nm_min=100", echo];
        assert_eq!(said, expected);
    }
}

/// Truth: the instrument's own grating, 20 s for it; its list.
#[test]
fn a_grating_takes_its_time_and_is_read_back() {
    let mut bench = Bench::new(true, Motion::Goto, Vec::new());
    let numbers: Vec<u8> = bench.mono.gratings().iter().map(|grating| grating.number).collect();
    assert_eq!(numbers, [1, 2]);
    let start = bench.clock.now();
    let got = bench.mono.set_own("grating", "2", &bench.within(60)).unwrap();
    assert_eq!((got, bench.mono.line().device.grating()), (Value::Integer(2), 2));
    assert!(bench.clock.now() - start >= Duration::from_secs(20));
    assert_eq!(bench.mono.move_to(1600.0, &bench.within(60)).unwrap(), 1600.0);
    for bad in ["3", "0", "-1", "blue", ""] {
        let error = bench.mono.set_own("grating", bad, &bench.within(60)).unwrap_err();
        assert!(error.to_string().contains("expected one of 1 (1200 g/mm"), "{error}");
    }
    let speed = bench.mono.set_own("speed_nm_min", "1500", &bench.within(5)).unwrap();
    assert_eq!(speed, Value::Number(1500.0));
    let error = bench.mono.set_own("speed_nm_min", "5000", &bench.within(5)).unwrap_err();
    assert!(matches!(error, DeviceError::NotTaken { .. }), "{error}");
    for bad in ["0", "-5", "NaN", "fast", "inf"] {
        assert!(bench.mono.set_own("speed_nm_min", bad, &bench.within(5)).is_err(), "{bad}");
    }
}

/// Truth: by construction: its words are in the error, and nothing has moved.
#[test]
fn what_it_does_not_understand_is_a_typed_error() {
    let mut bench = Bench::new(true, Motion::Goto, Vec::new());
    let failed = bench.mono.move_to(1500.0, &bench.within(60)).unwrap_err();
    assert_eq!(
        failed.to_string(),
        "SP2150 monochromator refused 1500.000 GOTO: it says `1500.000 GOTO GOTO ?`"
    );
    assert_eq!((failed.done, bench.truth_nm()), (Some(0.0), 0.0));
    let failed = bench.mono.move_to(f64::NAN, &bench.within(60)).unwrap_err();
    assert!(matches!(*failed.error, DeviceError::OutOfRange { .. }), "{failed}");
    // One that says that it did it, and did not.
    let mut bench = Bench::new(false, Motion::Goto, fault("GOTO", 0, Kind::Idle));
    let failed = bench.mono.move_to(500.0, &bench.within(60)).unwrap_err();
    assert!(matches!(*failed.error, DeviceError::NotTaken { .. }), "{failed}");
}

/// Truth: the motor, for each reply that is silent, late or cut in half once.
#[test]
fn a_torn_reply_is_followed_by_a_clean_one() {
    for echoes in [true, false] {
        for on in ["?NM", "GOTO", "MODEL", "SERIAL", "?GRATINGS", "MONO-?DONE", ">NM", "MONO-STOP"]
        {
            let motion =
                if on.contains('>') || on.contains("MONO") { Motion::Scan } else { Motion::Goto };
            for nth in 1..4 {
                for kind in [900, 1100, 1500]
                    .map(|ms| Kind::Late(Duration::from_millis(ms)))
                    .into_iter()
                    .chain([Kind::Silence, Kind::Half, Kind::Say("ok"), Kind::Say("\u{7f}")])
                {
                    let mut bench = Bench::new(echoes, motion, fault(on, nth, kind));
                    let context = format!("{on} {nth} {kind:?} echo {echoes}");
                    bench.mono.set_speed_nm_min(1200.0, &bench.within(10)).unwrap();
                    for nm in [300.0, 350.5, 20.005] {
                        let moved = bench.mono.move_to(nm, &bench.within(200));
                        let got = moved.unwrap_or_else(|error| panic!("{context}: {error}"));
                        assert!((got - nm).abs() < 1e-9, "{context}: {got}");
                        assert!((bench.truth_nm() - nm).abs() < 1e-9, "{context}");
                        let device = &bench.mono.line().device;
                        assert!(!device.is_moving(bench.clock.now()), "{context}");
                    }
                }
            }
        }
    }
}

/// Truth: the clock and the motor. A `GOTO` goes on and that is said; a scan is stopped and its place told.
#[test]
fn a_deadline_or_a_token_within_a_move() {
    let mut bench = Bench::new(true, Motion::Goto, Vec::new());
    let start = bench.clock.now();
    let failed = bench.mono.move_to(1200.0, &bench.within(4)).unwrap_err();
    assert!(bench.clock.now() - start <= Duration::from_millis(7_050));
    assert!(failed.to_string().contains("the move took longer than 4.000 s"), "{failed}");
    assert!(failed.to_string().contains("may still be turning"), "{failed}");
    assert_eq!(failed.done, None);
    assert_eq!(bench.mono.wavelength_nm(&bench.within(30)).unwrap(), 1200.0);

    for echoes in [true, false] {
        let mut bench = Bench::new(echoes, Motion::Scan, Vec::new());
        bench.mono.set_speed_nm_min(600.0, &bench.within(5)).unwrap();
        let failed = bench.mono.move_to(500.0, &bench.within(10)).unwrap_err();
        assert!(failed.to_string().contains("the move took longer than"), "{failed}");
        let at = failed.done.unwrap();
        // 10 nm/s for nearly 10 s.
        assert!((90.0..105.0).contains(&at), "{at}");
        assert!((at - bench.truth_nm()).abs() < 1e-9);
        bench.clock.sleep(Duration::from_secs(10));
        assert!((at - bench.truth_nm()).abs() < 1e-9, "it stands");
    }
    let cancel = Cancel::new();
    cancel.cancel();
    let failed = bench.mono.move_to(500.0, &bench.within(60).with_cancel(&cancel)).unwrap_err();
    assert!(matches!(*failed.error, DeviceError::Cancelled { .. }), "{failed}");
}

/// Truth: the layouts of the sources, written by hand.
#[test]
fn answers_are_read_strictly() {
    let good =
        |command: &str, echoes, text: &str| match Answer::parse(command, echoes, text.as_bytes()) {
            Ok(Answer::Good(body)) => body,
            other => panic!("{text}: {other:?}"),
        };
    assert_eq!(good("?NM", true, "?NM 999.989 nm  ok\r\n"), "999.989 nm");
    assert_eq!(good("?NM", false, " 999.989 nm  ok\r\n"), "999.989 nm");
    assert_eq!(good("5 GOTO", true, "5 GOTO  ok\r\n"), "");
    assert_eq!(good("5 GOTO", false, " ok\r\n"), "");
    let refused = Answer::parse("XY", true, b"XY XY ? \r\n").unwrap();
    assert_eq!(refused, Answer::NotUnderstood("XY XY ?".into()));
    for (echoes, bad) in [
        (true, "999.989 nm  ok\r\n"),
        (false, "?NM 999.989 nm  ok\r\n"),
        (true, "?NM 999.989 nm\r\n"),
        (true, "?NM 999.989 nmok\r\n"),
        (true, "?NM \u{0} ok\r\n"),
        (true, ""),
    ] {
        assert!(Answer::parse("?NM", echoes, bad.as_bytes()).is_err(), "{bad}");
    }
    assert_eq!(reply::wavelength_nm("546.700 nm"), Ok(546.7));
    for bad in ["546.700", "nm", "inf nm", "546.700 nm/min", "5 46 nm", "1"] {
        assert!(reply::wavelength_nm(bad).is_err(), "{bad}");
    }
    // As nplab's driver shows a list of a 2300i.
    let list =
        "\u{1a}1  300 g/mm BLZ=  500NM \r\n 2  300 g/mm BLZ=  1.0UM \r\n 4  Not Installed     \r\n";
    let gratings = reply::gratings(list).unwrap();
    assert_eq!(gratings.len(), 2);
    assert_eq!((gratings[1].number, gratings[1].about.as_str()), (2, "300 g/mm BLZ=  1.0UM"));
    for bad in ["", "x", "12 300 g/mm", " 4  Not Installed"] {
        assert!(reply::gratings(bad).is_err(), "{bad}");
    }
    assert!(reply::model("546.700 nm").is_err() && reply::model("SP-2-150i").is_ok());
    assert!(reply::grating("0").is_err() && reply::is_done("2").is_err());
    assert!(reply::speed_nm_min("0 nm/min").is_err());
}

fn name(error: &DeviceError) -> &'static str {
    match error {
        DeviceError::Transport { .. } => "transport",
        DeviceError::TooSlow { .. } => "too slow",
        DeviceError::Protocol { .. } => "protocol",
        DeviceError::Rejected { .. } => "rejected",
        DeviceError::NotTaken { .. } => "not taken",
        DeviceError::NotStopped { .. } => "not stopped",
        other => panic!("no such error can come of a bad line: {other}"),
    }
}

/// One life on a bad line. Panics on a wrong number or a missed deadline.
fn life(faults: Faults, seed: u64) -> (Result<(), &'static str>, Injected) {
    let clock = Arc::new(VirtualClock::new());
    let within = |s| Deadline::after(clock.clone(), Duration::from_secs(s));
    let echoes = seed.is_multiple_of(2);
    let motion = if seed % 4 < 2 { Motion::Goto } else { Motion::Scan };
    let device = Sp2150::new(Sp2150Settings { echoes, ..Sp2150Settings::default() });
    let line = Faulty::new(InMemory::new(device), faults, seed);
    let settings = MonoSettings { motion, ..MonoSettings::default() };
    let grace = settings.stop_within + Duration::from_millis(50);
    let bounded = |start: Duration, s: u64| {
        let took = clock.now() - start;
        assert!(took <= Duration::from_secs(s) + grace, "seed {seed}: it took {took:?}");
    };
    let mono = Mono::open(line, LinkSettings::default(), settings, &within(20));
    bounded(Duration::ZERO, 20);
    let mut mono = match mono {
        Ok(mono) => mono,
        Err(error) => return (Err(name(&error)), Injected::default()),
    };
    if let Err(error) = mono.set_speed_nm_min(1800.0, &within(20)) {
        return (Err(name(&error)), mono.into_line().injected());
    }
    let mut end = Ok(());
    for target in [546.07, 700.0, 435.83, 1013.98] {
        let start = clock.now();
        let moved = mono.move_to(target, &within(120));
        bounded(start, 120);
        let device = &mono.line().inner().device;
        let truth = device.wavelength_nm(clock.now());
        match moved {
            Ok(nm) => {
                assert!(
                    (nm - target).abs() <= settings.tolerance_nm,
                    "seed {seed}: {nm} for {target}"
                );
                assert!((nm - truth).abs() < 6e-4, "seed {seed}: {nm}, it is at {truth}");
                assert!(!device.is_moving(clock.now()), "seed {seed}");
            }
            Err(failed) => {
                end = Err(name(&failed.error));
                if let Some(nm) = failed.done {
                    assert!((nm - truth).abs() < 6e-4, "seed {seed}: {nm}, it is at {truth}");
                }
                break;
            }
        }
    }
    (end, mono.into_line().injected())
}

/// Truth: the simulated motor and the clock. Every life ends right or with a named error, in time.
#[test]
fn a_thousand_seeds_end_right_or_with_a_named_error() {
    let mild = Faults {
        delay: 0.02,
        longest_delay: Duration::from_millis(1500),
        drop: 0.000_05,
        flip: 0.000_05,
        short_read: 0.2,
        silence: 0.002,
        disconnect: 0.0,
    };
    let bad = Faults { delay: 0.05, drop: 0.000_5, flip: 0.000_5, ..mild };
    let breaking = Faults { disconnect: 0.001, ..mild };
    let mut ends: BTreeMap<(&str, String), u32> = BTreeMap::new();
    let mut sum = Injected::default();
    for seed in 0..1500 {
        let (kind, faults) =
            [("mild", mild), ("bad", bad), ("breaking", breaking)][seed as usize % 3];
        let (end, injected) = life(faults, seed);
        *ends.entry((kind, format!("{end:?}"))).or_default() += 1;
        sum.drops += injected.drops;
        sum.flips += injected.flips;
        sum.delays += injected.delays;
    }
    eprintln!("{ends:#?}\n{sum:?}");
    let right = |kind| ends.get(&(kind, "Ok(())".into())).copied().unwrap_or(0);
    assert!(sum.drops > 200 && sum.flips > 200 && sum.delays > 300, "{sum:?}");
    assert!(right("mild") > 300, "{ends:?}");
    assert!(right("bad") > 20 && right("breaking") < 500, "{ends:?}");
    assert_eq!(life(bad, 4), life(bad, 4), "the same seed, the same run");
    for seed in 0..4 {
        assert_eq!(life(Faults::NONE, seed).0, Ok(()));
    }
}
