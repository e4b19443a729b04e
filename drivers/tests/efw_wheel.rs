//! The wheel's driver on our simulated wheel.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, FilterWheel as _, Value};
use sunglint_drivers::simulated::efw::{Efw, EfwSettings, Kind};
use sunglint_drivers::simulated::script::{Fault, Script};
use sunglint_drivers::transport::{Transfer, Transfers as _};
use sunglint_drivers::zwo::report::{FROM_WHEEL, Position, ROOM, Request, State};
use sunglint_drivers::zwo::{Wheel, WheelSettings};

fn within(clock: &Arc<VirtualClock>, seconds: u64) -> Deadline {
    Deadline::after(clock.clone(), Duration::from_secs(seconds))
}

fn open(faults: Vec<Fault<Kind>>) -> (Wheel<Efw>, Arc<VirtualClock>) {
    let clock = Arc::new(VirtualClock::new());
    let mut hid = Efw::new(EfwSettings::default());
    hid.faults = Script::new(faults);
    let wheel = Wheel::open(hid, WheelSettings::default(), &within(&clock, 5)).unwrap();
    (wheel, clock)
}

/// Truth: the simulated wheel's own slot, and its 2.1 s a slot, forwards, polled each 0.5 s. From every slot to every other.
#[test]
fn every_slot_is_reached_one_at_a_time() {
    let (mut wheel, clock) = open(Vec::new());
    assert_eq!((wheel.slots(), wheel.slot(&within(&clock, 5)).unwrap()), (7, 1));
    let mut at = 1;
    for step in 1..7 {
        for _ in 0..7 {
            let to = (at - 1 + step) % 7 + 1;
            let start = clock.now();
            assert_eq!(wheel.select(to, &within(&clock, 60)).unwrap(), to);
            assert_eq!(wheel.hid_mut().slot(clock.now()).map(u32::from), Some(to));
            assert_eq!(clock.now() - start, Duration::from_millis(2500) * step, "{at} to {to}");
            at = to;
        }
    }
    assert_eq!(wheel.select(at, &within(&clock, 1)).unwrap(), at, "nothing to do");
    let settings = wheel.settings(&within(&clock, 5)).unwrap();
    assert_eq!(settings[1].value, Value::Integer(at.into()));
    assert_eq!(wheel.identity(&within(&clock, 5)).unwrap().model, "EFW-S-0");
    for slot in [0, 8, 256 + 3] {
        let error = wheel.select(slot, &within(&clock, 60)).unwrap_err();
        assert!(matches!(*error.error, DeviceError::OutOfRange { .. }), "{slot}: {error}");
    }
}

/// Truth: the captured report of a fault (status 6, error 12), which the simulated wheel sends after the jump that its
/// describer saw fail.
#[test]
fn a_long_jump_ends_in_the_fault_state_and_is_told() {
    let (mut wheel, clock) = open(Vec::new());
    let deadline = within(&clock, 60);
    let mut say = |data: [u8; 16]| {
        let set = Transfer::FeatureSet { data: data.to_vec() };
        wheel.hid_mut().transfer(&set, &deadline).unwrap();
    };
    say(Request::Move(7).emit());
    say(Request::Position.emit());
    let get = Transfer::FeatureGet { report: FROM_WHEEL, length: ROOM };
    let report = wheel.hid_mut().transfer(&get, &deadline).unwrap();
    let position = Position::parse(&report).unwrap();
    assert_eq!((position.state, position.error, position.slots), (State::Fault, 12, [7, 1, 7]));
    let error = wheel.select(2, &deadline).unwrap_err();
    assert!(error.to_string().contains("cut its power") && error.to_string().contains("code 12"));
    assert_eq!(error.done, None);
}

/// Truth: the simulated wheel's own slot. What ends early says where the wheel stands.
#[test]
fn what_ends_early_says_where() {
    let (mut wheel, clock) = open(Vec::new());
    let interrupted = wheel.select(5, &within(&clock, 6)).unwrap_err();
    assert!(matches!(*interrupted.error, DeviceError::TooSlow { .. }), "{interrupted}");
    assert_eq!(interrupted.done, None, "it still turns");
    clock.sleep(Duration::from_secs(2));
    assert_eq!(wheel.slot(&within(&clock, 5)).unwrap(), 4);
    assert_eq!(wheel.hid_mut().slot(clock.now()), Some(4));
    let cancel = Cancel::new();
    cancel.cancel();
    let interrupted = wheel.select(6, &within(&clock, 60).with_cancel(&cancel)).unwrap_err();
    assert!(matches!(*interrupted.error, DeviceError::Cancelled { .. }), "{interrupted}");
    assert_eq!(interrupted.done, Some(4));
    let (mut wheel, clock) = open(vec![Fault::new("move", 2, Kind::Deaf)]);
    let start = clock.now();
    let interrupted = wheel.select(3, &within(&clock, 600)).unwrap_err();
    assert_eq!(interrupted.done, Some(2));
    assert!(clock.now() - start < Duration::from_secs(24), "given up after one slot's time");
}
