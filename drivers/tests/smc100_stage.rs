//! The SMC100 stage with a simulated controller: what is right, what goes wrong, bad lines, recorded conversations.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::turning::{Cable, Case, Rig, fixtures, thousand};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, RotationStage, Side};
use sunglint_drivers::newport::smc100::{LinkSettings, Smc100 as Axis, Stage, open};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::smc100::{Smc100, Smc100Settings};
use sunglint_drivers::transport::Bytes;
use sunglint_drivers::turning::{Turning, TurningSettings};

const REFERENCE: i64 = -150_000;

fn after(clock: &Arc<VirtualClock>, s: u64) -> Deadline {
    Deadline::after(clock.clone(), Duration::from_secs(s))
}

fn settings() -> TurningSettings {
    TurningSettings { tolerance_deg: 0.001, ..TurningSettings::default() }
}

type Simulated = Stage<InMemory<Smc100>>;

fn stage(clock: &Arc<VirtualClock>, device: Smc100Settings) -> Simulated {
    let link = LinkSettings { address: device.address, ..LinkSettings::default() };
    let line = InMemory::new(Smc100::new(device));
    open(line, link, settings(), &after(clock, 10)).unwrap()
}

fn device(stage: &mut Simulated) -> &mut Smc100 {
    &mut stage.axis_mut().line_mut().device
}

/// Truth: the simulated controller's own place; 10,000 of its counts are 1°. It searches its reference once only.
#[test]
fn it_homes_and_turns_to_absolute_angles() {
    for address in [1, 12] {
        let clock = Arc::new(VirtualClock::new());
        let mut stage = stage(&clock, Smc100Settings { address, ..Smc100Settings::default() });
        let d = after(&clock, 600);
        assert_eq!(stage.identity(&d).unwrap().model, "SMC_CC_017 with URS100CC");
        assert!(stage.angle_deg(&d).unwrap_err().to_string().contains("home it"));
        assert_eq!(stage.home(&d).unwrap(), 0.0);
        assert_eq!(device(&mut stage).place(), REFERENCE);
        for angle in [0.5, 12.3456, -33.25, 100.0] {
            assert!((stage.move_to(angle, &d).unwrap() - angle).abs() < 1e-9);
            assert_eq!(device(&mut stage).place() - REFERENCE, (angle * 10_000.0).round() as i64);
        }
        assert!((stage.home(&d).unwrap() - 100.0).abs() < 1e-9, "it has its reference, and stays");
        assert!(stage.settings(&d).unwrap().iter().any(|s| s.name == "speed_deg_per_s"));
        device(&mut stage).power_cycle();
        let error = stage.angle_deg(&d).unwrap_err();
        assert!(error.to_string().contains("no reference"), "{error}");
    }
}

/// Truth: the simulated controller's own place, ends and states.
#[test]
fn what_goes_wrong_is_named_and_it_stands_then() {
    let clock = Arc::new(VirtualClock::new());
    let limits = Some([REFERENCE - 100_000, REFERENCE + 600_000]);
    let mut stage = stage(&clock, Smc100Settings { limits, ..Smc100Settings::default() });
    stage.home(&after(&clock, 60)).unwrap();
    let begun = clock.now();
    let error = stage.move_to(50.0, &after(&clock, 1)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::TooSlow { .. }), "{error}");
    assert!(device(&mut stage).is_standing() && clock.now() - begun < Duration::from_secs(4));
    let place = (device(&mut stage).place() - REFERENCE) as f64 / 10_000.0;
    assert!((error.done.unwrap() - place).abs() < 1e-4 && place > 10.0, "{error:?}, {place}");
    let cancel = Cancel::new();
    cancel.cancel();
    let error = stage.move_to(2.0, &after(&clock, 60).with_cancel(&cancel)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::Cancelled { .. }), "{error}");
    let error = stage.move_to(70.0, &after(&clock, 60)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::LimitHit { side: Side::Right, .. }), "{error}");
    device(&mut stage).set_obstacle(Some(REFERENCE + 50_000));
    let error = stage.move_to(2.0, &after(&clock, 60)).unwrap_err();
    assert!(error.to_string().contains("following error"), "{error}");
    assert_eq!(error.done, Some(5.0));
    device(&mut stage).set_obstacle(None);
    device(&mut stage).says = Some(0x3c);
    let error = stage.move_to(2.0, &after(&clock, 60)).unwrap_err();
    assert!(error.to_string().contains("refused 1PA2.00000: not allowed (code 68)"), "{error}");
    device(&mut stage).says = Some(0x14);
    let error = stage.move_to(2.0, &after(&clock, 60)).unwrap_err();
    assert!(error.to_string().contains("no reference"), "{error}");
    device(&mut stage).says = None;
    device(&mut stage).dead = true;
    let error = stage.home(&after(&clock, 60)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::NotStopped { .. }), "{error}");
}

struct Smcs;

impl Rig for Smcs {
    type Axis = Axis<Faulty<InMemory<Smc100>>>;
    const WITHIN_DEG: f64 = 0.0011;

    fn open(faults: Faults, seed: u64, d: &Deadline) -> Result<Turning<Self::Axis>, DeviceError> {
        let device = Smc100::new(Smc100Settings::default());
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
    thousand::<Smcs>(200);
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
        device: Smc100::new(Smc100Settings::default()),
        cable: Cable::Good,
        before: None,
        end,
    };
    let with = |name, end, change: fn(&mut Smc100)| {
        let mut case = case(name, end);
        change(&mut case.device);
        case
    };
    let good = "10.0000 deg";
    let cases = vec![
        case("good", good),
        with(
            "obstacle",
            "home: Newport SMC100 or CONEX-CC refused to search its reference: following error: check for an obstacle and the load",
            |d| d.set_obstacle(Some(-1_000)),
        ),
        with(
            "configuration",
            "home: Newport SMC100 or CONEX-CC refused to search its reference: it is being configured: end that (PW0) first",
            |d| d.says = Some(0x14),
        ),
        with("silence", "open: no answer but 0 bytes", |d| d.dead = true),
        Case { cable: Cable::Flip(4), ..case("spoilt", good) },
        Case {
            cable: Cable::Cut(9),
            ..case("disconnect", "home: gone after 0 bytes; not stopped")
        },
    ];
    fixtures("smc100", "Newport SMC100", boxed, cases);
}
