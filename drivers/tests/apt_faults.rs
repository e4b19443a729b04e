//! The APT stage on a line that fails, and its parser on bytes that nobody should send.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_xoshiro::Xoshiro256PlusPlus;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{DeviceError, RotationStage as _};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::apt::{Apt, AptSettings};
use sunglint_drivers::thorlabs::apt::message::{HEADER, HOST, MOST_DATA, parse};
use sunglint_drivers::thorlabs::apt::{LinkSettings, Stage, StageSettings};
use sunglint_testkit::Campaign;

const REFERENCE: i64 = -2_048_000;

fn name(error: &DeviceError) -> &'static str {
    match error {
        DeviceError::Transport { .. } => "transport",
        DeviceError::TooSlow { .. } => "too slow",
        DeviceError::Protocol { .. } => "protocol",
        DeviceError::Declined { .. } => "declined",
        DeviceError::NotTaken { .. } => "not taken",
        DeviceError::NotReady { .. } => "not ready",
        DeviceError::LimitHit { .. } => "limit hit",
        DeviceError::Stalled { .. } => "stalled",
        DeviceError::Unknown { .. } => "unknown",
        DeviceError::NotStopped { .. } => "not stopped",
        other => panic!("no such error can come of a bad line: {other}"),
    }
}

/// One life of a stage on a bad line. Panics on a wrong number or a missed deadline.
fn run(faults: Faults, seed: u64) -> (Result<(), &'static str>, Injected, Duration) {
    let clock = Arc::new(VirtualClock::new());
    let within = |s| Deadline::after(clock.clone(), Duration::from_secs(s));
    let line = Faulty::new(InMemory::new(Apt::new(AptSettings::default())), faults, seed);
    let grace = StageSettings::default().stop_within + Duration::from_millis(50);
    let bounded = |start: Duration, s: u64| {
        let took = clock.now() - start;
        assert!(took <= Duration::from_secs(s) + grace, "seed {seed}: it took {took:?}");
    };
    let stage = Stage::open(line, LinkSettings::default(), StageSettings::default(), &within(5));
    let mut stage = match stage {
        Ok(stage) => stage,
        Err(error) => {
            bounded(Duration::ZERO, 5);
            return (Err(name(&error)), Injected::default(), clock.now());
        }
    };
    let start = clock.now();
    let mut end = Ok(());
    match stage.home(&within(30)) {
        Ok(angle) => {
            assert_eq!(angle, 0.0, "seed {seed}");
            assert_eq!(stage.line().inner().device.place(), REFERENCE, "seed {seed}");
        }
        Err(interrupted) => end = Err(name(&interrupted.error)),
    }
    bounded(start, 30);
    for target in [3.5_f64, 30.0, 12.5, 100.0, 12.5] {
        if end.is_err() {
            break;
        }
        let start = clock.now();
        let moved = stage.move_to(target, &within(30));
        let device = &stage.line().inner().device;
        // Truth: the stage's own place; 409,600 microsteps are 3°.
        let place = (device.place() - REFERENCE) as f64 * 3.0 / 409_600.0;
        match moved {
            Ok(angle) => {
                assert!(device.is_standing(), "seed {seed}");
                assert!((angle - target).abs() < 4e-6, "seed {seed}: {angle} for {target}");
                assert!((angle - place).abs() < 1e-9, "seed {seed}: {angle}, it is at {place}");
            }
            Err(interrupted) => {
                end = Err(name(&interrupted.error));
                if let Some(at) = interrupted.done {
                    assert!((at - place).abs() < 1e-9, "seed {seed}: {at}, it is at {place}");
                    assert!(device.is_standing(), "seed {seed}: said to be stopped");
                }
            }
        }
        bounded(start, 30);
    }
    (end, stage.into_line().injected(), clock.now())
}

/// Truth: the stage's own place, and the clock. Every run ends right or with a named error, in time.
#[test]
fn a_thousand_seeds_end_right_or_with_a_named_error() {
    let mild = Faults {
        delay: 0.05,
        longest_delay: Duration::from_millis(200),
        drop: 0.000_1,
        flip: 0.000_1,
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
    let breaking = Faults { disconnect: 0.001, ..mild };
    let mut ends: BTreeMap<(&str, String), u32> = BTreeMap::new();
    let mut sum = Injected::default();
    for seed in 0..1000 {
        let (kind, faults) =
            [("mild", mild), ("bad", bad), ("breaking", breaking)][seed as usize % 3];
        let (end, injected, _) = run(faults, seed);
        *ends.entry((kind, format!("{end:?}"))).or_default() += 1;
        sum.drops += injected.drops;
        sum.flips += injected.flips;
        sum.silences += injected.silences;
    }
    eprintln!("{ends:#?}\n{sum:?}");
    let right = |kind| ends.get(&(kind, "Ok(())".into())).copied().unwrap_or(0);
    assert!(sum.drops > 500 && sum.flips > 500 && sum.silences > 100, "{sum:?}");
    // Repetition helps: most mild runs are right; the others are not all errors.
    assert!(right("mild") > 280, "{ends:?}");
    assert!(right("bad") < 300 && right("breaking") < 300, "{ends:?}");
    assert_eq!(run(bad, 4), run(bad, 4), "the same seed, the same run");
    assert_eq!(run(Faults::NONE, 1).0, Ok(()));
}

/// All messages of bytes, and how many bytes were passed over between them.
fn messages(bytes: &[u8], whom: u8) -> (u64, u64) {
    let (mut at, mut found, mut passed) = (0, 0, 0);
    while let Some(rest) = bytes.get(at..).filter(|rest| !rest.is_empty()) {
        match parse(rest, whom) {
            Ok(Some((message, taken))) => {
                assert!((HEADER..=HEADER + MOST_DATA).contains(&taken));
                assert_eq!(message.emit(), rest[..taken], "what is read is what was there");
                found += 1;
                at += taken;
            }
            Ok(None) => break,
            Err(_) => {
                passed += 1;
                at += 1;
            }
        }
    }
    (found, passed)
}

/// A million messages, most of them spoilt: no panic, and what is read is byte for byte what was there. Truth: the bytes.
#[test]
fn campaign_apt_parser() {
    let mut campaign = Campaign::start("apt_parser", 1_000_000);
    let (mut sound, mut most) = (0_u64, 0);
    for seed in campaign.seeds() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        // Headers that are nearly right, so that all branches are taken.
        let number: u16 = [0x0481, 0x0491, 0x0006, 0x0464, 0x0444, 0x0212, random.random()]
            [random.random_range(0..7)];
        let length: u8 = [14, 84, 0, random.random()][random.random_range(0..4)];
        let destination: u8 = [0x81, 0x01, random.random()][random.random_range(0..3)];
        let source: u8 = [0x50, 0x22, random.random()][random.random_range(0..3)];
        let [low, high] = number.to_le_bytes();
        let second: u8 = if random.random_range(0..9) == 0 { random.random() } else { 0 };
        let mut bytes = vec![low, high, length, second, destination, source];
        let more = random.random_range(0..200);
        bytes.extend((0..more).map(|_| random.random::<u8>()));
        let (found, passed) = messages(&bytes, HOST);
        assert!(found + passed <= bytes.len() as u64);
        sound += u64::from(found > 0);
        most = most.max(passed);
    }
    assert!(sound * 20 > campaign.seeds().end, "some are right: {sound}");
    campaign.largest("bytes_passed_over", most as f64);
    campaign.finish();
}

proptest! {
    /// Any bytes to anybody.
    #[test]
    fn any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..300), whom in 0_u8..0x80) {
        messages(&bytes, whom);
    }
}
