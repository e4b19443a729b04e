//! The Zaber stage with a simulated device: what is right, what goes wrong, bad lines, recorded conversations.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::turning::{Cable, Case, Rig, fixtures, thousand};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::catalogue::Address;
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, RotationStage};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::zaber::{Zaber, ZaberSettings};
use sunglint_drivers::transport::Bytes;
use sunglint_drivers::turning::{Turning, TurningSettings};
use sunglint_drivers::zaber::{LinkSettings, Stage, open};

const REFERENCE: i64 = -15_000;

fn after(clock: &Arc<VirtualClock>, s: u64) -> Deadline {
    Deadline::after(clock.clone(), Duration::from_secs(s))
}

fn stage(clock: &Arc<VirtualClock>, device: ZaberSettings) -> Stage<InMemory<Zaber>> {
    let link = LinkSettings { device: device.address, ..LinkSettings::new(1_000.0) };
    let line = InMemory::new(Zaber::new(device));
    open(line, link, TurningSettings::default(), &after(clock, 10)).unwrap()
}

fn device(stage: &mut Stage<InMemory<Zaber>>) -> &mut Zaber {
    &mut stage.axis_mut().line_mut().device
}

/// Truth: the simulated device's own place; 1000 microsteps are 1°. With checksums and without, with alerts, and with a
/// position of its own at the reference.
#[test]
fn it_homes_and_turns_to_absolute_angles() {
    for (checksums, alerts, address, preset) in
        [(true, false, 1, 0), (false, true, 1, 0), (true, true, 42, 5_000)]
    {
        let clock = Arc::new(VirtualClock::new());
        let settings = ZaberSettings { checksums, alerts, address, preset, ..Default::default() };
        let mut stage = stage(&clock, settings);
        let d = after(&clock, 600);
        let identity = stage.identity(&d).unwrap();
        assert_eq!(
            (identity.model.as_str(), identity.serial.as_deref()),
            ("device 50081", Some("12345"))
        );
        assert!(stage.angle_deg(&d).unwrap_err().to_string().contains("home it"));
        let home = f64::from(preset) / 1_000.0;
        assert_eq!(stage.home(&d).unwrap(), home);
        assert_eq!(device(&mut stage).place(), REFERENCE);
        for angle in [0.5, 12.345, -33.25, 100.0] {
            assert!((stage.move_to(angle, &d).unwrap() - angle).abs() < 1e-12);
            let place = device(&mut stage).place() - REFERENCE + i64::from(preset);
            assert_eq!(place, (angle * 1_000.0).round() as i64);
        }
        let told = stage.settings(&d).unwrap();
        let has = |name: &str, value: &str| {
            told.iter().any(|s| s.name == name && s.value.to_string() == value)
        };
        assert!(
            has("checksums", if checksums { "on" } else { "off" })
                && has("max_speed_units", "20000")
        );
        device(&mut stage).power_cycle();
        let error = stage.angle_deg(&d).unwrap_err();
        assert!(error.to_string().contains("no reference"), "{error}");
    }
}

/// Truth: the simulated device's own place and faults.
#[test]
fn what_goes_wrong_is_named_and_it_stands_then() {
    let clock = Arc::new(VirtualClock::new());
    let mut stage = stage(&clock, ZaberSettings::default());
    stage.home(&after(&clock, 60)).unwrap();
    let begun = clock.now();
    let error = stage.move_to(90.0, &after(&clock, 1)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::TooSlow { .. }), "{error}");
    assert!(device(&mut stage).is_standing() && clock.now() - begun < Duration::from_secs(3));
    let place = (device(&mut stage).place() - REFERENCE) as f64 / 1_000.0;
    assert!((error.done.unwrap() - place).abs() < 1e-9 && place > 15.0, "{error:?}, {place}");
    let cancel = Cancel::new();
    cancel.cancel();
    let error = stage.move_to(2.0, &after(&clock, 60).with_cancel(&cancel)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::Cancelled { .. }), "{error}");
    device(&mut stage).set_obstacle(Some(REFERENCE + 50_000));
    let error = stage.move_to(90.0, &after(&clock, 60)).unwrap_err();
    assert!(error.to_string().contains("FS, stalled and stopped"), "{error}");
    assert_eq!(error.done, Some(50.0));
    device(&mut stage).set_obstacle(None);
    assert_eq!(stage.move_to(90.0, &after(&clock, 60)).unwrap(), 90.0, "the old fault is over");
    device(&mut stage).refuses = Some("PARKED");
    let error = stage.move_to(10.0, &after(&clock, 60)).unwrap_err();
    assert!(error.to_string().contains("refused move abs 10000: it says `PARKED`"), "{error}");
    assert_eq!(error.done, Some(90.0));
    device(&mut stage).refuses = None;
    device(&mut stage).dead = true;
    let error = stage.home(&after(&clock, 60)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::NotStopped { .. }), "{error}");
}

/// Truth: by construction: a device with one axis; a user who does not say how far a microstep turns.
#[test]
fn what_must_be_said_is_asked_for() {
    let clock = Arc::new(VirtualClock::new());
    let line = InMemory::new(Zaber::new(ZaberSettings::default()));
    let link = LinkSettings { axis: 2, ..LinkSettings::new(1.0) };
    let error = open(line, link, TurningSettings::default(), &after(&clock, 10)).unwrap_err();
    assert!(error.to_string().contains("axis: found 2, expected one of 1 to 1"), "{error}");
    let address = Address::parse("zaber:/dev/null", &[]).unwrap();
    let line =
        sunglint_drivers::catalogue::Line::bytes(InMemory::new(Zaber::new(Default::default())));
    let error = address.open(line, &after(&clock, 10)).unwrap_err();
    assert!(error.to_string().contains("counts_per_deg=NUMBER"), "{error}");
}

struct Zabers;

impl Rig for Zabers {
    type Axis = sunglint_drivers::zaber::Zaber<Faulty<InMemory<Zaber>>>;
    const WITHIN_DEG: f64 = 0.0005;

    fn open(faults: Faults, seed: u64, d: &Deadline) -> Result<Turning<Self::Axis>, DeviceError> {
        let checksums = !seed.is_multiple_of(4);
        let settings = ZaberSettings { checksums, alerts: true, ..ZaberSettings::default() };
        let line = Faulty::new(InMemory::new(Zaber::new(settings)), faults, seed);
        open(line, LinkSettings::new(1_000.0), TurningSettings::default(), d)
    }

    fn truth(stage: &Turning<Self::Axis>) -> (f64, bool) {
        let device = &stage.axis().line().inner().device;
        ((device.place() - REFERENCE) as f64 / 1_000.0, device.is_standing())
    }

    fn injected(stage: Turning<Self::Axis>) -> Injected {
        stage.into_axis().into_line().injected()
    }
}

/// Truth: the device's own place, and the clock. Every run ends right or with a named error, in time.
#[test]
fn a_thousand_seeds_end_right_or_with_a_named_error() {
    thousand::<Zabers>(200);
}

fn boxed(line: Box<dyn Bytes>, d: &Deadline) -> Result<Box<dyn RotationStage>, DeviceError> {
    let link =
        LinkSettings { reply_within: Duration::from_millis(150), ..LinkSettings::new(1_000.0) };
    Ok(Box::new(open(line, link, TurningSettings::default(), d)?))
}

/// Truth: the named ends; the recordings in the repository, byte for byte.
#[test]
fn every_recording_ends_as_it_says() {
    let case = |name, end| Case {
        name,
        device: Zaber::new(ZaberSettings::default()),
        cable: Cable::Good,
        before: None,
        end,
    };
    let with = |name, end, change: fn(&mut Zaber)| {
        let mut case = case(name, end);
        change(&mut case.device);
        case
    };
    let plain = ZaberSettings { checksums: false, alerts: true, ..ZaberSettings::default() };
    let good = "10.0000 deg";
    let cases = vec![
        case("good", good),
        Case { device: Zaber::new(plain), ..case("without_checksums", good) },
        with("refused", "home: Zaber device refused home: it says `PARKED`", |d| {
            d.refuses = Some("PARKED")
        }),
        with(
            "obstacle",
            "home: Zaber device refused to search its reference: FS, stalled and stopped: check for an obstacle and the load",
            |d| d.set_obstacle(Some(-1_000)),
        ),
        with("silence", "open: no answer but 0 bytes", |d| d.dead = true),
        Case { cable: Cable::Flip(4), ..case("spoilt", good) },
        Case {
            cable: Cable::Cut(6),
            ..case("disconnect", "home: gone after 0 bytes; not stopped")
        },
        Case {
            before: Some((12, Zaber::power_cycle)),
            ..case(
                "power_lost",
                "home: Zaber device: its reference search did not end at its reference: is the motor on, and the switch free?",
            )
        },
    ];
    fixtures("zaber", "Zaber, device 50081", boxed, cases);
}
