//! The ESP301 stage with a simulated controller: what is right, what goes wrong, bad lines, recorded conversations.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::turning::{Cable, Case, Rig, fixtures, thousand};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, RotationStage, Side};
use sunglint_drivers::newport::esp::{Esp, LinkSettings, Stage, open};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::esp301::{Esp301, Esp301Settings};
use sunglint_drivers::transport::Bytes;
use sunglint_drivers::turning::{Turning, TurningSettings};

const REFERENCE: i64 = -150_000;

fn after(clock: &Arc<VirtualClock>, s: u64) -> Deadline {
    Deadline::after(clock.clone(), Duration::from_secs(s))
}

fn settings() -> TurningSettings {
    TurningSettings { tolerance_deg: 0.001, ..TurningSettings::default() }
}

type Simulated = Stage<InMemory<Esp301>>;

fn stage(clock: &Arc<VirtualClock>, device: Esp301) -> Result<Simulated, DeviceError> {
    open(InMemory::new(device), LinkSettings::default(), settings(), &after(clock, 10))
}

fn device(stage: &mut Simulated) -> &mut Esp301 {
    &mut stage.axis_mut().line_mut().device
}

/// Truth: the simulated controller's own place; 10,000 of its counts are 1°.
#[test]
fn it_homes_and_turns_to_absolute_angles() {
    let clock = Arc::new(VirtualClock::new());
    let mut stage = stage(&clock, Esp301::new(Esp301Settings::default())).unwrap();
    let d = after(&clock, 600);
    let identity = stage.identity(&d).unwrap();
    assert_eq!(identity.model, "ESP301 with URS75BPP, SN1263");
    assert_eq!(identity.firmware.as_deref(), Some("3.0.1 6/1/99"));
    assert!(stage.angle_deg(&d).unwrap_err().to_string().contains("home it"));
    assert_eq!(stage.home(&d).unwrap(), 0.0);
    assert_eq!(device(&mut stage).place(), REFERENCE);
    for angle in [0.5, 12.3456, -33.25, 100.0] {
        assert!((stage.move_to(angle, &d).unwrap() - angle).abs() < 1e-9);
        assert_eq!(device(&mut stage).place() - REFERENCE, (angle * 10_000.0).round() as i64);
    }
    let told = stage.settings(&d).unwrap();
    assert!(told.iter().any(|s| s.name == "speed_deg_per_s" && s.value.to_string() == "20"));
    device(&mut stage).power_cycle();
    let error = stage.angle_deg(&d).unwrap_err();
    assert!(error.to_string().contains("home it again"), "{error}");
}

/// Truth: the simulated controller's own place, switches and errors.
#[test]
fn what_goes_wrong_is_named_and_it_stands_then() {
    let clock = Arc::new(VirtualClock::new());
    let limits = Some([REFERENCE - 100_000, REFERENCE + 600_000]);
    let limited = Esp301::new(Esp301Settings { limits, ..Esp301Settings::default() });
    let mut stage = stage(&clock, limited).unwrap();
    stage.home(&after(&clock, 60)).unwrap();
    let begun = clock.now();
    let error = stage.move_to(50.0, &after(&clock, 1)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::TooSlow { .. }), "{error}");
    assert!(device(&mut stage).is_standing() && clock.now() - begun < Duration::from_secs(3));
    let place = (device(&mut stage).place() - REFERENCE) as f64 / 10_000.0;
    assert!((error.done.unwrap() - place).abs() < 1e-4 && place > 15.0, "{error:?}, {place}");
    let cancel = Cancel::new();
    cancel.cancel();
    let error = stage.move_to(2.0, &after(&clock, 60).with_cancel(&cancel)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::Cancelled { .. }), "{error}");
    let error = stage.move_to(70.0, &after(&clock, 60)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::LimitHit { side: Side::Right, .. }), "{error}");
    assert_eq!(error.done, Some(60.0));
    device(&mut stage).set_obstacle(Some(REFERENCE + 50_000));
    let error = stage.move_to(2.0, &after(&clock, 60)).unwrap_err();
    assert!(error.to_string().contains("FOLLOWING ERROR THRESHOLD EXCEEDED (code 103)"), "{error}");
    assert_eq!(error.done, Some(5.0));
    device(&mut stage).set_obstacle(None);
    assert_eq!(stage.move_to(2.0, &after(&clock, 60)).unwrap(), 2.0, "the old fault is over");
    device(&mut stage).dead = true;
    let error = stage.home(&after(&clock, 60)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::NotStopped { .. }), "{error}");
}

/// Truth: by construction: an axis in millimetres, a motor that stays off, an axis that is not there.
#[test]
fn an_axis_that_cannot_turn_is_refused() {
    let clock = Arc::new(VirtualClock::new());
    let linear = Esp301::new(Esp301Settings { unit: 2, ..Esp301Settings::default() });
    let error = stage(&clock, linear).unwrap_err().to_string();
    assert!(error.contains("unit 2, expected 7 (degrees): set it with 1SN7"), "{error}");
    let mut off = Esp301::new(Esp301Settings::default());
    off.no_power = true;
    let error = stage(&clock, off).unwrap_err().to_string();
    assert!(error.contains("motor_on was set to 1, the device says 0"), "{error}");
    let line = InMemory::new(Esp301::new(Esp301Settings::default()));
    let link = LinkSettings { axis: 2, ..LinkSettings::default() };
    let error = open(line, link, settings(), &after(&clock, 10)).unwrap_err().to_string();
    assert!(error.contains("no answer"), "{error}");
}

struct Esps;

impl Rig for Esps {
    type Axis = Esp<Faulty<InMemory<Esp301>>>;
    const WITHIN_DEG: f64 = 0.0011;

    fn open(faults: Faults, seed: u64, d: &Deadline) -> Result<Turning<Self::Axis>, DeviceError> {
        let device = Esp301::new(Esp301Settings::default());
        let line = Faulty::new(InMemory::new(device), faults, seed);
        open(line, LinkSettings::default(), settings(), d)
    }

    fn truth(stage: &Turning<Self::Axis>) -> (f64, bool) {
        let device = &stage.axis().line().inner().device;
        ((device.place() - REFERENCE) as f64 / 10_000.0, device.is_standing())
    }

    fn injected(stage: Turning<Self::Axis>) -> Injected {
        stage.into_axis().into_line().injected()
    }
}

/// Truth: the controller's own place, and the clock. Every run ends right or with a named error, in time.
#[test]
fn a_thousand_seeds_end_right_or_with_a_named_error() {
    thousand::<Esps>(200);
}

fn boxed(line: Box<dyn Bytes>, d: &Deadline) -> Result<Box<dyn RotationStage>, DeviceError> {
    let link = LinkSettings { reply_within: Duration::from_millis(150), ..Default::default() };
    Ok(Box::new(open(line, link, settings(), d)?))
}

/// Truth: the named ends; the recordings in the repository, byte for byte.
#[test]
fn every_recording_ends_as_it_says() {
    let case = |name, end| Case {
        name,
        device: Esp301::new(Esp301Settings::default()),
        cable: Cable::Good,
        before: None,
        end,
    };
    let with = |name, end, change: fn(&mut Esp301)| {
        let mut case = case(name, end);
        change(&mut case.device);
        case
    };
    let good = "10.0000 deg";
    let limits = Some([-150_000, -100_000]);
    let limited = Esp301::new(Esp301Settings { limits, ..Esp301Settings::default() });
    let cases = vec![
        case("good", good),
        Case {
            device: limited,
            ..case(
                "limit",
                "move, at Some(\"5.0000\"): Newport ESP controller: the right limit switch stopped it at 5.0000 deg on the way to 10.0000 deg",
            )
        },
        with(
            "obstacle",
            "home: Newport ESP controller refused to search its reference: AXIS-1 FOLLOWING ERROR THRESHOLD EXCEEDED (code 103)",
            |d| d.set_obstacle(Some(-1_000)),
        ),
        with("silence", "open: no answer but 0 bytes", |d| d.dead = true),
        Case { cable: Cable::Flip(4), ..case("spoilt", good) },
        Case {
            cable: Cable::Cut(14),
            ..case("disconnect", "home: gone after 0 bytes; not stopped")
        },
    ];
    fixtures("esp301", "Newport ESP301", boxed, cases);
}
