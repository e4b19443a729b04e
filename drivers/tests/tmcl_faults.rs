//! The TMCL stage on a line that fails: a thousand seeds on a virtual clock.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{DeviceError, RotationStage as _};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::tmcl::{Module, ModuleSettings};
use sunglint_drivers::trinamic::{Approach, LinkSettings, Search, Stage, StageSettings};

const SWITCH: i64 = -20_000;

fn stage_settings() -> StageSettings {
    StageSettings {
        approach: Approach::FromBelow { by_deg: 2.0 },
        search: Some(Search { mode: 1, speed: 5_000, switch_speed: 1_000, tolerance_deg: 0.5 }),
        ..StageSettings::default()
    }
}

/// How a run ended.
#[derive(Debug, PartialEq)]
enum End {
    Right,
    Error(&'static str),
}

fn name(error: &DeviceError) -> &'static str {
    match error {
        DeviceError::Transport { .. } => "transport",
        DeviceError::TooSlow { .. } => "too slow",
        DeviceError::Protocol { .. } => "protocol",
        DeviceError::Refused { .. } => "refused",
        DeviceError::NotTaken { .. } => "not taken",
        DeviceError::NotReady { .. } => "not ready",
        DeviceError::LimitHit { .. } => "limit hit",
        DeviceError::Stalled { .. } => "stalled",
        DeviceError::NotStopped { .. } => "not stopped",
        other => panic!("no such error can come of a bad line: {other}"),
    }
}

/// One life of a stage on a bad line. Panics on a wrong number or a missed deadline.
fn run(faults: Faults, seed: u64) -> (End, Injected, Duration) {
    let clock = Arc::new(VirtualClock::new());
    let within = |s| Deadline::after(clock.clone(), Duration::from_secs(s));
    let settings = ModuleSettings { switches: [SWITCH, 60_000], ..ModuleSettings::default() };
    let line = Faulty::new(InMemory::new(Module::new(settings)), faults, seed);
    let grace = StageSettings::default().stop_within + Duration::from_millis(50);
    let bounded = |start: Duration, s: u64, what: &str| {
        let took = clock.now() - start;
        assert!(took <= Duration::from_secs(s) + grace, "seed {seed}: {what} took {took:?}");
    };
    let mut stage = match Stage::open(line, LinkSettings::default(), stage_settings(), &within(5)) {
        Ok(stage) => stage,
        Err(error) => {
            bounded(Duration::ZERO, 5, "open");
            return (End::Error(name(&error)), Injected::default(), clock.now());
        }
    };
    let start = clock.now();
    let mut end = End::Right;
    match stage.home(&within(30)) {
        Ok(angle) => assert_eq!(angle, 0.0, "seed {seed}"),
        Err(interrupted) => end = End::Error(name(&interrupted.error)),
    }
    bounded(start, 30, "home");
    for target in [3.5_f64, 30.0, 12.5, 200.0, 12.5] {
        if end != End::Right {
            break;
        }
        let start = clock.now();
        // 200° take 2.9 s at 10,000 of 142.2 microsteps a degree.
        match stage.move_to(target, &within(20)) {
            Ok(angle) => {
                // Truth: the module's own motor, counted from its switch; 51,200 microsteps a turn.
                let steps = (target * 51_200.0 / 360.0).round() as i64;
                let module = &stage.line().inner().device;
                assert!(module.is_standing(), "seed {seed}");
                assert_eq!(module.motor(), SWITCH + steps, "seed {seed} at {target} deg");
                // A step is 0.007 deg; 1e-9 is for the order of two divisions.
                assert!((angle - steps as f64 * 360.0 / 51_200.0).abs() < 1e-9, "seed {seed}");
            }
            Err(interrupted) => {
                end = End::Error(name(&interrupted.error));
                // What it says about where it stands is true as well.
                let module = &stage.line().inner().device;
                if let Some(at_deg) = interrupted.done {
                    let truth = (module.motor() - SWITCH) as f64 * 360.0 / 51_200.0;
                    assert!((at_deg - truth).abs() < 1e-9, "seed {seed}: {at_deg} is {truth}");
                    assert!(module.is_standing(), "seed {seed}: said to be stopped");
                }
            }
        }
        bounded(start, 20, "move");
    }
    let line = stage.into_line();
    (end, line.injected(), clock.now())
}

/// Truth: the simulated motor's own place, and the clock. Every run ends right or with a named error, in time. Three kinds
/// of line, so that all faults matter: a mildly bad one that retries must get through, a bad one, and one that breaks.
#[test]
fn a_thousand_seeds_end_right_or_with_a_named_error() {
    let mild = Faults {
        delay: 0.05,
        longest_delay: Duration::from_millis(200),
        drop: 0.000_2,
        flip: 0.000_2,
        short_read: 0.2,
        silence: 0.000_5,
        disconnect: 0.0,
    };
    let bad = Faults {
        delay: 0.1,
        longest_delay: Duration::from_millis(500),
        drop: 0.001,
        flip: 0.001,
        short_read: 0.5,
        silence: 0.002,
        disconnect: 0.0,
    };
    let breaking = Faults { disconnect: 0.002, ..mild };
    let mut ends: std::collections::BTreeMap<(&str, String), u32> = Default::default();
    let mut sum = Injected::default();
    for seed in 0..1000 {
        let (kind, faults) =
            [("mild", mild), ("bad", bad), ("breaking", breaking)][seed as usize % 3];
        let (end, injected, _) = run(faults, seed);
        *ends.entry((kind, format!("{end:?}"))).or_default() += 1;
        sum.delays += injected.delays;
        sum.drops += injected.drops;
        sum.flips += injected.flips;
        sum.short_reads += injected.short_reads;
        sum.silences += injected.silences;
    }
    eprintln!("{ends:#?}\n{sum:?}");
    let right = |kind| ends.get(&(kind, "Right".into())).copied().unwrap_or(0);
    // The faults did happen, and repetition helps: nearly every mild run is right, no kind is all errors or all right.
    assert!(sum.drops > 500 && sum.flips > 500 && sum.silences > 100 && sum.delays > 5000);
    assert!(right("mild") > 300, "{ends:?}");
    assert!(right("breaking") < 300, "{ends:?}");
    assert!(right("bad") < 330, "{ends:?}");
}

/// Truth: without faults every run is right; the same seed gives the same run, to the nanosecond.
#[test]
fn no_faults_no_errors_and_seeds_repeat() {
    assert_eq!(run(Faults::NONE, 1).0, End::Right);
    let faults = Faults { drop: 0.002, flip: 0.002, short_read: 0.3, ..Faults::NONE };
    for seed in 0..20 {
        assert_eq!(run(faults, seed), run(faults, seed), "seed {seed}");
    }
}

/// A million frames of noise, of which one in 256 has a right sum: no panic, and what is read is what was there.
/// A device that only makes noise is told as such, in time and in bounded memory.
#[test]
fn noise_is_no_module() {
    use rand::{Rng as _, SeedableRng as _};
    use sunglint_drivers::transport::{Bytes, TransportError};
    use sunglint_drivers::trinamic::tmcl::{Frame, Reply, Request};
    let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(7);
    let mut right = 0;
    for i in 0..1_000_000 {
        let mut bytes = [0; 12];
        random.fill_bytes(&mut bytes);
        let length = if i % 10 == 0 { i / 10 % 13 } else { 9 };
        if let Ok(frame) = Frame::new(&bytes[..length]) {
            right += 1;
            assert_eq!(Request::parse(&frame).emit().bytes()[..], bytes[..length]);
            assert_eq!(Reply::parse(&frame).emit().bytes()[..], bytes[..length]);
        }
    }
    // 907,692 frames of nine bytes, 1 in 256 right: 3546 ± 60; five sigma.
    assert!((3250..3850).contains(&right), "{right}");

    struct Noise(rand_xoshiro::Xoshiro256PlusPlus);
    impl Bytes for Noise {
        fn send(&mut self, _: &[u8], _: &Deadline) -> Result<(), TransportError> {
            Ok(())
        }
        fn receive(&mut self, buffer: &mut [u8], d: &Deadline) -> Result<usize, TransportError> {
            d.sleep(Duration::from_millis(1))?;
            self.0.fill_bytes(buffer);
            Ok(buffer.len())
        }
        fn discard(&mut self, _: &Deadline) -> Result<Vec<u8>, TransportError> {
            Ok(Vec::new())
        }
    }
    for seed in 0..100 {
        let clock = Arc::new(VirtualClock::new());
        let deadline = Deadline::after(clock.clone(), Duration::from_secs(5));
        let noise = Noise(rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(seed));
        let error = Stage::open(noise, LinkSettings::default(), stage_settings(), &deadline)
            .err()
            .unwrap_or_else(|| panic!("seed {seed}: noise is no stage"));
        assert!(!name(&error).is_empty());
        assert!(clock.now() < Duration::from_secs(5), "seed {seed}");
    }
}
