//! The Standa stage with a simulated controller: what is right, what goes wrong, bad lines, recorded conversations.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::turning::{Case, Counterpart as _, Desk, Rig, Trial, fixtures, thousand, usual};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::catalogue::Address;
use sunglint_drivers::clock::{Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, RotationStage};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::standa::{Standa, StandaSettings};
use sunglint_drivers::standa::{LinkSettings, Standa as Axis, open};
use sunglint_drivers::transport::Bytes;
use sunglint_drivers::turning::{Turning, TurningSettings};

fn after(clock: &Arc<VirtualClock>, s: u64) -> Deadline {
    Deadline::after(clock.clone(), Duration::from_secs(s))
}

fn desk(device: StandaSettings) -> Desk<Axis<InMemory<Standa>>, Standa> {
    let microsteps = 1 << (device.mode - 1);
    let link = LinkSettings { microsteps, ..LinkSettings::new(25_600.0) };
    let line = InMemory::new(Standa::new(device));
    let open = |d: &Deadline| open(line, link, TurningSettings::default(), d);
    Desk::new(open, |stage| &mut stage.axis_mut().line_mut().device).unwrap()
}

/// Truth: the simulated controller's own place; 25,600 counts are 1°. With firmware that says whether it has its reference, and with one that does not; a
/// stepper with 256 and with 8 microsteps, and a DC motor.
#[test]
fn it_homes_and_turns_to_absolute_angles() {
    let cases = [
        (true, 3, 9, "no reference"),
        (false, 3, 4, "home it again"),
        (true, 1, 9, "no reference"),
    ];
    for (tells, kind, mode, lost) in cases {
        let settings = StandaSettings { tells, kind, mode, ..Default::default() };
        let mut desk = desk(settings);
        let d = desk.within(60);
        let identity = desk.stage.identity(&d).unwrap();
        assert_eq!(
            (identity.model.as_str(), identity.serial.as_deref(), identity.firmware.as_deref()),
            ("8SMC5-US", Some("12345"), Some("4.7.8"))
        );
        let told = desk.stage.settings(&d).unwrap();
        let has = |name: &str, value: &str| {
            told.iter().any(|s| s.name == name && s.value.to_string() == value)
        };
        let (microsteps, speed) = match (kind, mode) {
            (3, 9) => ("256", "2000"),
            (3, _) => ("8", "64000"),
            _ => ("1", "512000"),
        };
        assert!(has("microsteps", microsteps) && has("speed_steps_s", speed), "{told:?}");
        assert!(has("stage", "8MR190-2-28") && has("supply_v", "36"), "{told:?}");
        desk.homes_and_turns(0.0, &[0.5, 12.345, -33.25, 100.0], lost);
    }
}

/// Truth: the simulated controller's own place and faults.
#[test]
fn what_goes_wrong_is_named_and_it_stands_then() {
    let obstacle = (1_280_000, "alarm: its steps and its encoder do not agree");
    let trial = Trial { far_deg: 90.0, too_short_s: 1, beyond_deg: 15.0, obstacle };
    desk(StandaSettings::default()).battery(trial, |desk| {
        // A home that ends where it begins is not taken for one, although the counter is near zero there.
        desk.stage.move_to(0.25, &desk.within(60)).unwrap();
        desk.device().no_search = true;
        let error = desk.stage.home(&desk.within(60)).unwrap_err().to_string();
        assert!(error.contains("its last command (number 6) ended with an error"), "{error}");
        desk.device().no_search = false;
        desk.stage.home(&desk.within(60)).unwrap();
    });
}

/// Truth: by construction: steps that are divided otherwise than the user's number says, and a user who does not say how far a count turns.
#[test]
fn what_must_be_said_is_asked_for() {
    let clock = Arc::new(VirtualClock::new());
    let settings = StandaSettings { mode: 4, ..Default::default() };
    let line = InMemory::new(Standa::new(settings));
    let settings = TurningSettings::default();
    let error = open(line, LinkSettings::new(1.0), settings, &after(&clock, 10)).unwrap_err();
    assert!(error.to_string().contains("microsteps: found 256, expected one of 8, by"), "{error}");
    let address = Address::parse("standa:/dev/null", &[]).unwrap();
    let line =
        sunglint_drivers::catalogue::Line::bytes(InMemory::new(Standa::new(Default::default())));
    let error = address.open(line, &after(&clock, 10)).unwrap_err();
    assert!(error.to_string().contains("counts_per_deg=NUMBER"), "{error}");
}

/// Truth: by construction: half a command of a program that was ended is on the line, and another device's words.
#[test]
fn what_others_left_on_the_line_is_emptied() {
    let clock = Arc::new(VirtualClock::new());
    for rest in [&b"move\x01"[..], b"g", b"GET / HTTP/1.1\r\n", b"smov\0\0\0", b"gets", b"\0\0\0"] {
        let mut line = InMemory::new(Standa::new(StandaSettings::default()));
        line.send(rest, &after(&clock, 1)).unwrap();
        let link = LinkSettings::new(25_600.0);
        let stage = open(line, link, TurningSettings::default(), &after(&clock, 10));
        let mut stage = stage.unwrap_or_else(|error| panic!("{}: {error}", rest.escape_ascii()));
        assert_eq!(stage.home(&after(&clock, 60)).unwrap(), 0.0);
    }
}

struct Standas;

impl Rig for Standas {
    type Axis = Axis<Faulty<InMemory<Standa>>>;
    const WITHIN_DEG: f64 = 0.5 / 25_600.0;

    fn open(faults: Faults, seed: u64, d: &Deadline) -> Result<Turning<Self::Axis>, DeviceError> {
        let tells = !seed.is_multiple_of(4);
        let settings = StandaSettings { tells, ..StandaSettings::default() };
        let line = Faulty::new(InMemory::new(Standa::new(settings)), faults, seed);
        open(line, LinkSettings::new(25_600.0), TurningSettings::default(), d)
    }

    fn truth(stage: &Turning<Self::Axis>) -> (f64, bool) {
        let device = &stage.axis().line().inner().device;
        (device.deg(), device.is_standing())
    }

    fn injected(stage: Turning<Self::Axis>) -> Injected {
        stage.into_axis().into_line().injected()
    }
}

/// Truth: the controller's own place, and the clock. Every run ends right or with a named error, in time.
#[test]
fn a_thousand_seeds_end_right_or_with_a_named_error() {
    thousand::<Standas>(200);
}

fn boxed(line: Box<dyn Bytes>, d: &Deadline) -> Result<Box<dyn RotationStage>, DeviceError> {
    let reply_within = Duration::from_millis(150);
    let link = LinkSettings { reply_within, ..LinkSettings::new(25_600.0) };
    Ok(Box::new(open(line, link, TurningSettings::default(), d)?))
}

/// Truth: the named ends; the recordings in the repository, byte for byte.
#[test]
fn every_recording_ends_as_it_says() {
    let device = || Standa::new(StandaSettings::default());
    let older = StandaSettings { tells: false, ..StandaSettings::default() };
    let good = "10.0000 deg";
    let mut cases = usual(device, good, 4, 6);
    cases.extend([
        Case::new("older_firmware", Standa::new(older), good),
        Case::new(
            "refused",
            device(),
            "home: Standa controller refused to search its reference: its last command (number 6) ended with an error",
        )
        .with(|d| d.no_search = true),
        Case::new(
            "obstacle",
            device(),
            "home: Standa controller refused to search its reference: alarm: its steps and its encoder do not agree: check for an obstacle and the load",
        )
        .with(|d| d.set_obstacle(Some(-25_600))),
        Case::new(
            "power_lost",
            device(),
            "home: Standa controller: its reference search did not end at its reference: is the motor on, and the switch free?",
        )
        .before(12, Standa::power_cycle),
    ]);
    fixtures("standa", "Standa 8SMC5", boxed, cases);
}
