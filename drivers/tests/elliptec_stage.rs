//! The Elliptec mount with a simulated one: what is right, what goes wrong, bad lines, recorded conversations.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::turning::{Cable, Case, Rig, fixtures, thousand};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, RotationStage};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::elliptec::{Elliptec, ElliptecSettings, Trouble};
use sunglint_drivers::thorlabs::elliptec::{LinkSettings, Stage, open};
use sunglint_drivers::transport::Bytes;
use sunglint_drivers::turning::{Turning, TurningSettings};

type Simulated = Stage<InMemory<Elliptec>>;

const REFERENCE: i64 = -35_840;

fn after(clock: &Arc<VirtualClock>, s: u64) -> Deadline {
    Deadline::after(clock.clone(), Duration::from_secs(s))
}

fn settings() -> TurningSettings {
    TurningSettings { tolerance_deg: 0.01, ..TurningSettings::default() }
}

fn stage(clock: &Arc<VirtualClock>, device: ElliptecSettings) -> Result<Simulated, DeviceError> {
    let link = LinkSettings { address: device.address, ..LinkSettings::default() };
    let line = InMemory::new(Elliptec::new(device));
    open(line, link, settings(), &after(clock, 10))
}

fn device(stage: &mut Simulated) -> &mut Elliptec {
    &mut stage.axis_mut().line_mut().device
}

/// Truth: the simulated mount's own place; 143,360 pulses are 360°. With firmware that says it is busy, and with one that
/// says nothing during a move; at another address too.
#[test]
fn it_homes_and_turns_to_absolute_angles() {
    for (says_busy, address) in [(true, 0), (false, 0), (true, 11)] {
        let clock = Arc::new(VirtualClock::new());
        let settings = ElliptecSettings { says_busy, address, ..ElliptecSettings::default() };
        let mut stage = stage(&clock, settings).unwrap();
        let d = after(&clock, 600);
        let identity = stage.identity(&d).unwrap();
        assert_eq!(
            (identity.model.as_str(), identity.serial.as_deref()),
            ("ELL14", Some("11400519"))
        );
        let error = stage.angle_deg(&d).unwrap_err();
        assert!(error.to_string().contains("home it"), "{error}");
        assert_eq!(stage.home(&d).unwrap(), 0.0);
        assert_eq!(device(&mut stage).place(), REFERENCE);
        for i in 1..=36 {
            let angle = f64::from(i) * 10.25;
            let at = stage.move_to(angle, &d).unwrap();
            let place = device(&mut stage).place() - REFERENCE;
            assert_eq!(place, (angle * 143_360.0 / 360.0).round() as i64);
            assert!((at - place as f64 * 360.0 / 143_360.0).abs() < 1e-9, "{at}");
        }
        assert!((stage.move_to(-45.0, &d).unwrap() + 45.0).abs() < 1e-9);
        let told = stage.settings(&d).unwrap();
        assert!(told.iter().any(|s| s.name == "speed_percent" && s.value.to_string() == "100"));
        // Turned by hand, or without power for a moment: its angle is not believed any more.
        device(&mut stage).power_cycle();
        let error = stage.angle_deg(&d).unwrap_err();
        assert!(error.to_string().contains("home it again"), "{error}");
        stage.stop(&d).unwrap();
    }
}

/// Truth: the simulated mount's own place and faults.
#[test]
fn what_goes_wrong_is_named_and_it_stands_then() {
    let clock = Arc::new(VirtualClock::new());
    let slow = ElliptecSettings { speed: 3_000, ..ElliptecSettings::default() };
    let mut stage = stage(&clock, slow).unwrap();
    stage.home(&after(&clock, 60)).unwrap();
    let error = stage.move_to(f64::NAN, &after(&clock, 60)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::OutOfRange { .. }), "{error}");
    // Too slow: it was stopped on its way, and says where.
    let begun = clock.now();
    let error = stage.move_to(90.0, &after(&clock, 2)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::TooSlow { .. }), "{error}");
    assert!(device(&mut stage).is_standing() && clock.now() - begun < Duration::from_secs(4));
    let place = (device(&mut stage).place() - REFERENCE) as f64 * 360.0 / 143_360.0;
    assert!((error.done.unwrap() - place).abs() < 1e-9 && place > 10.0, "{error:?}, {place}");
    let cancel = Cancel::new();
    cancel.cancel();
    let error = stage.move_to(2.0, &after(&clock, 60).with_cancel(&cancel)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::Cancelled { .. }), "{error}");
    device(&mut stage).set_obstacle(Some(REFERENCE + 20_000));
    let error = stage.move_to(90.0, &after(&clock, 60)).unwrap_err();
    assert!(error.to_string().contains("mechanical timeout"), "{error}");
    assert!((error.done.unwrap() - 20_000.0 * 360.0 / 143_360.0).abs() < 1e-9, "{error:?}");
    device(&mut stage).set_obstacle(None);
    device(&mut stage).trouble.refuses = Some(12);
    let error = stage.move_to(90.0, &after(&clock, 60)).unwrap_err();
    assert!(error.to_string().contains("out of its travel"), "{error}");
    device(&mut stage).trouble = Trouble { no_search: true, ..Trouble::default() };
    let error = stage.home(&after(&clock, 60)).unwrap_err();
    assert!(error.to_string().contains("did not begin"), "{error}");
    // Its old reference is not believed after a search that failed.
    assert!(stage.angle_deg(&after(&clock, 60)).is_err());
    device(&mut stage).trouble = Trouble { dead: true, ..Trouble::default() };
    let error = stage.home(&after(&clock, 30)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::NotStopped { .. }), "{error}");
}

/// Truth: what a slider and a linear stage say of themselves; other addresses stay silent.
#[test]
fn what_is_no_rotation_mount_is_refused() {
    let clock = Arc::new(VirtualClock::new());
    for (model, travel, word) in
        [(9, 31, "a slider"), (20, 60, "a linear stage"), (99, 28, "a travel of 28")]
    {
        let device = ElliptecSettings { model, travel, ..ElliptecSettings::default() };
        let error = stage(&clock, device).unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
    let line = InMemory::new(Elliptec::new(ElliptecSettings::default()));
    let link = LinkSettings { address: 3, ..LinkSettings::default() };
    let error = open(line, link, settings(), &after(&clock, 10)).unwrap_err();
    assert!(error.to_string().contains("no answer"), "{error}");
}

struct Elliptecs;

impl Rig for Elliptecs {
    type Axis = sunglint_drivers::thorlabs::elliptec::Elliptec<Faulty<InMemory<Elliptec>>>;
    const WITHIN_DEG: f64 = 0.013;

    fn open(faults: Faults, seed: u64, d: &Deadline) -> Result<Turning<Self::Axis>, DeviceError> {
        let device =
            ElliptecSettings { says_busy: seed.is_multiple_of(2), ..ElliptecSettings::default() };
        let line = Faulty::new(InMemory::new(Elliptec::new(device)), faults, seed);
        open(line, LinkSettings::default(), settings(), d)
    }

    fn truth(stage: &Turning<Self::Axis>) -> (f64, bool) {
        let device = &stage.axis().line().inner().device;
        ((device.place() - REFERENCE) as f64 * 360.0 / 143_360.0, device.is_standing())
    }

    fn injected(stage: Turning<Self::Axis>) -> Injected {
        stage.into_axis().into_line().injected()
    }
}

/// Truth: the mount's own place, and the clock. Every run ends right or with a named error, in time.
#[test]
fn a_thousand_seeds_end_right_or_with_a_named_error() {
    thousand::<Elliptecs>(290);
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
        device: Elliptec::new(ElliptecSettings::default()),
        cable: Cable::Good,
        before: None,
        end,
    };
    let with = |name, end, change: fn(&mut Elliptec)| {
        let mut case = case(name, end);
        change(&mut case.device);
        case
    };
    let silent = ElliptecSettings { says_busy: false, ..ElliptecSettings::default() };
    // 10° are 3982.22 pulses, rounded.
    let good = "9.9994 deg";
    let cases = vec![
        case("good", good),
        Case { device: Elliptec::new(silent), ..case("silent_in_motion", good) },
        with(
            "refused",
            "home: Elliptec module refused to search its reference: it is isolated",
            |d| d.trouble.refuses = Some(5),
        ),
        with(
            "obstacle",
            "home: Elliptec module refused to search its reference: mechanical timeout: it is blocked, or the motor's frequency is not tuned",
            |d| d.set_obstacle(Some(-1_000)),
        ),
        with("silence", "open: no answer but 0 bytes", |d| d.trouble.dead = true),
        Case { cable: Cable::Flip(9), ..case("spoilt", good) },
        Case {
            cable: Cable::Cut(9),
            ..case("disconnect", "home: gone after 0 bytes; not stopped")
        },
        Case {
            before: Some((31, Elliptec::power_cycle)),
            ..case(
                "power_lost",
                "move, at None: Elliptec module: it stands still at 0.0000 deg on the way to 9.9994 deg: check for an obstacle, the motor's current and its supply",
            )
        },
    ];
    fixtures("elliptec", "Thorlabs ELL14", boxed, cases);
}
