//! The Elliptec mount with a simulated one: what is right, what goes wrong, bad lines, recorded conversations.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::turning::{Case, Counterpart as _, Desk, Rig, Trial, fixtures, thousand, usual};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, RotationStage};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::elliptec::{Elliptec, ElliptecSettings, Trouble};
use sunglint_drivers::thorlabs::elliptec::{Elliptec as Axis, LinkSettings, open};
use sunglint_drivers::transport::Bytes;
use sunglint_drivers::turning::{Turning, TurningSettings};

fn after(clock: &Arc<VirtualClock>, s: u64) -> Deadline {
    Deadline::after(clock.clone(), Duration::from_secs(s))
}

fn settings() -> TurningSettings {
    TurningSettings { tolerance_deg: 0.01, ..TurningSettings::default() }
}

fn desk(device: ElliptecSettings) -> Result<Desk<Axis<InMemory<Elliptec>>, Elliptec>, DeviceError> {
    let link = LinkSettings { address: device.address, ..LinkSettings::default() };
    let line = InMemory::new(Elliptec::new(device));
    let open = |d: &Deadline| open(line, link, settings(), d);
    Desk::new(open, |stage| &mut stage.axis_mut().line_mut().device)
}

/// Truth: the simulated mount's own place; 143,360 pulses are 360°. With firmware that says it is busy, and with one that
/// says nothing during a move; at another address too.
#[test]
fn it_homes_and_turns_to_absolute_angles() {
    for (says_busy, address) in [(true, 0), (false, 0), (true, 11)] {
        let settings = ElliptecSettings { says_busy, address, ..ElliptecSettings::default() };
        let mut desk = desk(settings).unwrap();
        let d = desk.within(60);
        let identity = desk.stage.identity(&d).unwrap();
        assert_eq!(
            (identity.model.as_str(), identity.serial.as_deref()),
            ("ELL14", Some("11400519"))
        );
        let told = desk.stage.settings(&d).unwrap();
        assert!(told.iter().any(|s| s.name == "speed_percent" && s.value.to_string() == "100"));
        let mut angles: Vec<f64> = (1..=36).map(|i| f64::from(i) * 10.25).collect();
        angles.push(-45.0);
        // Turned by hand, or without power for a moment: its angle is not believed any more.
        desk.homes_and_turns(0.0, &angles, "home it again");
        desk.stage.stop(&d).unwrap();
    }
}

/// Truth: the simulated mount's own place and faults.
#[test]
fn what_goes_wrong_is_named_and_it_stands_then() {
    let slow = ElliptecSettings { speed: 3_000, ..ElliptecSettings::default() };
    let obstacle = (20_000, "mechanical timeout");
    let trial = Trial { far_deg: 90.0, too_short_s: 2, beyond_deg: 10.0, obstacle };
    desk(slow).unwrap().battery(trial, |desk| {
        let error = desk.stage.move_to(f64::NAN, &desk.within(60)).unwrap_err();
        assert!(matches!(*error.error, DeviceError::OutOfRange { .. }), "{error}");
        desk.device().trouble.refuses = Some(12);
        let (error, _) = desk.fails(45.0);
        assert!(error.contains("out of its travel"), "{error}");
        desk.device().trouble = Trouble { no_search: true, ..Trouble::default() };
        let error = desk.stage.home(&desk.within(60)).unwrap_err();
        assert!(error.to_string().contains("did not begin"), "{error}");
        // Its old reference is not believed after a search that failed.
        assert!(desk.stage.angle_deg(&desk.within(60)).is_err());
        desk.device().trouble = Trouble::default();
    });
}

/// Truth: what a slider and a linear stage say of themselves; other addresses stay silent.
#[test]
fn what_is_no_rotation_mount_is_refused() {
    for (model, travel, word) in
        [(9, 31, "a slider"), (20, 60, "a linear stage"), (99, 28, "a travel of 28")]
    {
        let device = ElliptecSettings { model, travel, ..ElliptecSettings::default() };
        let Err(error) = desk(device) else { panic!("{word} is no rotation mount") };
        let error = error.to_string();
        assert!(error.contains(word), "{error}");
    }
    let clock = Arc::new(VirtualClock::new());
    let line = InMemory::new(Elliptec::new(ElliptecSettings::default()));
    let link = LinkSettings { address: 3, ..LinkSettings::default() };
    let error = open(line, link, settings(), &after(&clock, 10)).unwrap_err();
    assert!(error.to_string().contains("no answer"), "{error}");
}

struct Elliptecs;

impl Rig for Elliptecs {
    type Axis = Axis<Faulty<InMemory<Elliptec>>>;
    const WITHIN_DEG: f64 = 0.013;

    fn open(faults: Faults, seed: u64, d: &Deadline) -> Result<Turning<Self::Axis>, DeviceError> {
        let device =
            ElliptecSettings { says_busy: seed.is_multiple_of(2), ..ElliptecSettings::default() };
        let line = Faulty::new(InMemory::new(Elliptec::new(device)), faults, seed);
        open(line, LinkSettings::default(), settings(), d)
    }

    fn truth(stage: &Turning<Self::Axis>) -> (f64, bool) {
        let device = &stage.axis().line().inner().device;
        (device.deg(), device.is_standing())
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
    let device = || Elliptec::new(ElliptecSettings::default());
    let silent = ElliptecSettings { says_busy: false, ..ElliptecSettings::default() };
    // 10° are 3982.22 pulses, rounded.
    let good = "9.9994 deg";
    let mut cases = usual(device, good, 9, 9);
    cases.extend([
        Case::new("silent_in_motion", Elliptec::new(silent), good),
        Case::new(
            "refused",
            device(),
            "home: Elliptec module refused to search its reference: it is isolated",
        )
        .with(|d| d.trouble.refuses = Some(5)),
        Case::new(
            "obstacle",
            device(),
            "home: Elliptec module refused to search its reference: mechanical timeout: it is blocked, or the motor's frequency is not tuned",
        )
        .with(|d| d.set_obstacle(Some(-1_000))),
        Case::new(
            "power_lost",
            device(),
            "move, at None: Elliptec module: it stands still at 0.0000 deg on the way to 9.9994 deg: check for an obstacle, the motor's current and its supply",
        )
        .before(31, Elliptec::power_cycle),
    ]);
    fixtures("elliptec", "Thorlabs ELL14", boxed, cases);
}
