//! The Time Tagger's driver on a line that fails, and its parser on bytes that nobody should send.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::swabian::{BIN_PS, Known, count, settings};
use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_xoshiro::Xoshiro256PlusPlus;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{DeviceError, PhotonCounter as _};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::simulated::swabian::{Simulated, TaggerSpec};
use sunglint_drivers::swabian::TimeTagger;
use sunglint_drivers::swabian::frame::{Bin, Frame, FrameError, MOST_PAYLOAD, Parser, emit};
use sunglint_formats::{CountFlags, CountRecord};
use sunglint_testkit::Campaign;

fn name(error: &DeviceError) -> &'static str {
    match error {
        DeviceError::Transport { .. } => "transport",
        DeviceError::Protocol { .. } => "protocol",
        DeviceError::Declined { .. } => "declined",
        DeviceError::NotReady { .. } => "not ready",
        DeviceError::TooSlow { .. } => "too slow",
        other => panic!("no such error can come of a bad line: {other}"),
    }
}

/// Panics on a wrong number. Truth: the light's own counts.
fn check(records: &[CountRecord], next_ps: &mut Option<i64>, seed: u64) {
    for record in records {
        let truth = [1, 2, -3].map(|channel| count(record.start_ps, channel));
        assert_eq!(record.counts, truth, "seed {seed}");
        assert_eq!(record.missed, [0; 3], "seed {seed}");
        let gap = next_ps.is_some_and(|next| next != record.start_ps);
        assert_eq!(record.flags.contains(CountFlags::GAP), gap, "seed {seed}");
        assert!(!gap, "seed {seed}: the line lost a bin and it was not noticed as such");
        *next_ps = Some(record.start_ps + BIN_PS);
    }
}

/// One life of a counter on a bad line; how it ended.
fn run(faults: Faults, seed: u64) -> (Result<(), &'static str>, Injected) {
    let clock = Arc::new(VirtualClock::new());
    let within = |ms| Deadline::after(clock.clone(), Duration::from_millis(ms));
    let line = Faulty::new(Simulated::new(TaggerSpec::default(), Known), faults, seed);
    let bounded = |begun: Duration, ms: u64| {
        let took = clock.now() - begun;
        assert!(took <= Duration::from_millis(ms), "seed {seed}: it took {took:?}");
    };
    let mut tagger = match TimeTagger::open(line, settings(), &within(5000)) {
        Ok(tagger) => tagger,
        Err(error) => {
            bounded(Duration::ZERO, 5000);
            return (Err(name(&error)), Injected::default());
        }
    };
    let mut end = tagger.set_dead_time_ps(1, 30_000, &within(2000)).and_then(|got_ps| {
        assert_eq!(got_ps, 30_000, "seed {seed}");
        tagger.start(BIN_PS, &within(2000))
    });
    let mut next_ps = None;
    for _ in 0..5 {
        if end.is_err() {
            break;
        }
        let begun = clock.now();
        match tagger.read(10, &within(3000)) {
            Ok(records) => check(&records, &mut next_ps, seed),
            Err(interrupted) => {
                check(&interrupted.done, &mut next_ps, seed);
                end = Err(*interrupted.error);
            }
        }
        bounded(begun, 3000);
    }
    let end = end.and_then(|()| tagger.stop(&within(2000)));
    (end.map_err(|error| name(&error)), tagger.into_line().injected())
}

/// Truth: the light's own counts and the clock: each run ends right or with a named error, in time, and no bin is wrong,
/// missing or twice. Delays and short reads alone harm nothing.
#[test]
fn a_thousand_seeds_end_right_or_with_a_named_error() {
    let slow = Faults {
        delay: 0.05,
        longest_delay: Duration::from_millis(50),
        short_read: 0.5,
        ..Faults::NONE
    };
    let mild = Faults { drop: 0.000_05, flip: 0.000_05, silence: 0.001, ..slow };
    let bad = Faults { drop: 0.000_5, flip: 0.000_5, silence: 0.005, disconnect: 0.002, ..slow };
    let mut ends: BTreeMap<(&str, String), u32> = BTreeMap::new();
    let mut sum = Injected::default();
    for seed in 0..1000 {
        let (kind, faults) = [("slow", slow), ("mild", mild), ("bad", bad)][seed as usize % 3];
        let (end, injected) = run(faults, seed);
        *ends.entry((kind, format!("{end:?}"))).or_default() += 1;
        sum.drops += injected.drops;
        sum.flips += injected.flips;
        sum.silences += injected.silences;
    }
    eprintln!("{ends:#?}\n{sum:?}");
    let right = |kind| ends.get(&(kind, "Ok(())".into())).copied().unwrap_or(0);
    assert_eq!(right("slow"), 334, "{ends:?}");
    // The faults did happen, and some runs got through all the same.
    assert!(sum.drops > 100 && sum.flips > 100 && sum.silences > 20, "{sum:?}");
    assert!(right("mild") > 50 && right("bad") < 50, "{ends:?}");
}

fn frames(random: &mut Xoshiro256PlusPlus) -> Vec<Frame> {
    let count = random.random_range(1..6);
    (0..count)
        .map(|i| match random.random_range(0..3) {
            0 => Frame::Json(serde_json::json!({"id": i, "ok": {"text": "µ", "n": [1, -2, 0.5]}})),
            1 => {
                let n = random.random_range(0..5);
                Frame::Bin(Bin {
                    start_ps: random.random_range(-1 << 60..1 << 60),
                    width_ps: random.random_range(1..1 << 60),
                    read_ns: random.random(),
                    flags: random.random_range(0..8),
                    counts: (0..n).map(|_| random.random()).collect(),
                    missed: (0..n).map(|_| random.random()).collect(),
                })
            }
            _ => {
                let n = random.random_range(0..20);
                Frame::Tags((0..n).map(|_| random.random()).collect())
            }
        })
        .collect()
}

fn read(pieces: &[&[u8]]) -> (Vec<Frame>, Option<FrameError>) {
    let mut parser = Parser::new();
    let mut found = Vec::new();
    for piece in pieces {
        parser.feed(piece);
        loop {
            match parser.frame() {
                Ok(Some(frame)) => found.push(frame),
                Ok(None) => break,
                Err(error) => return (found, Some(error)),
            }
        }
        assert!(parser.held_bytes() < MOST_PAYLOAD + 13 + piece.len(), "bounded memory");
    }
    (found, None)
}

/// A million streams of frames, most of them spoilt: in one piece and in two they read the same, and what is read before the
/// first error is what was written. Truth: the frames before they were spoilt. A spoilt frame gets through a CRC of 32 bits
/// once in four thousand million times.
#[test]
fn campaign_swabian_parser() {
    let mut campaign = Campaign::start("swabian_parser", 1_000_000);
    let (mut wrong, mut errors) = (0_u64, 0_u64);
    for seed in campaign.seeds() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let written = frames(&mut random);
        let mut bytes: Vec<u8> =
            written.iter().zip(0..).flat_map(|(frame, number)| emit(frame, number)).collect();
        match seed % 4 {
            0 => {}
            1 => {
                let at = random.random_range(0..bytes.len());
                bytes[at] ^= 1 << random.random_range(0..8_u32);
            }
            2 => {
                let at = random.random_range(0..bytes.len());
                bytes.remove(at);
            }
            _ => {
                let at = random.random_range(0..bytes.len());
                random.fill_bytes(&mut bytes[at..]);
            }
        }
        let at = random.random_range(0..=bytes.len());
        let whole = read(&[&bytes]);
        assert_eq!(read(&[&bytes[..at], &bytes[at..]]), whole, "seed {seed}");
        let (found, error) = whole;
        errors += u64::from(error.is_some());
        wrong += u64::from(!written.starts_with(&found));
        assert!(seed % 4 != 0 || (found == written && error.is_none()), "seed {seed}");
    }
    let n = campaign.seeds().end;
    // Three of four are spoilt; those whose announced length grew are not wrong yet but wait for more.
    assert!(errors * 2 > n, "{errors} errors in {n}");
    campaign.largest("wrong_frames", wrong as f64);
    campaign.finish();
}

proptest! {
    /// Any bytes in any pieces: no panic, bounded memory, the same however they are cut.
    #[test]
    fn any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..400), cut in 0..400_usize, number in 0_u32..2) {
        let cut = cut.min(bytes.len());
        prop_assert_eq!(read(&[&bytes]), read(&[&bytes[..cut], &bytes[cut..]]));
        // The same as the payload of a good frame, of each kind.
        for kind in *b"JCT" {
            let mut frame = (bytes.len() as u32).to_le_bytes().to_vec();
            frame.push(kind);
            frame.extend(number.to_le_bytes());
            frame.extend(&bytes);
            let mut crc = flate2::Crc::new();
            crc.update(&frame);
            frame.extend(crc.sum().to_le_bytes());
            let (found, error) = read(&[&frame]);
            prop_assert!(found.len() + usize::from(error.is_some()) == 1);
        }
    }
}
