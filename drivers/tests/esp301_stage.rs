//! The ESP301 stage with a simulated controller: what is right, what goes wrong, bad lines, recorded conversations.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::turning::{Case, Counterpart as _, Desk, Rig, Trial, fixtures, thousand, usual};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, RotationStage, Side};
use sunglint_drivers::newport::esp::{Esp, LinkSettings, open};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::esp301::{Esp301, Esp301Settings};
use sunglint_drivers::transport::Bytes;
use sunglint_drivers::turning::{Turning, TurningSettings};

fn after(clock: &Arc<VirtualClock>, s: u64) -> Deadline {
    Deadline::after(clock.clone(), Duration::from_secs(s))
}

fn settings() -> TurningSettings {
    TurningSettings { tolerance_deg: 0.001, ..TurningSettings::default() }
}

fn desk(device: Esp301) -> Result<Desk<Esp<InMemory<Esp301>>, Esp301>, DeviceError> {
    let line = InMemory::new(device);
    let open = |d: &Deadline| open(line, LinkSettings::default(), settings(), d);
    Desk::new(open, |stage| &mut stage.axis_mut().line_mut().device)
}

/// Truth: the simulated controller's own place; 10,000 of its counts are 1°.
#[test]
fn it_homes_and_turns_to_absolute_angles() {
    let mut desk = desk(Esp301::new(Esp301Settings::default())).unwrap();
    let d = desk.within(60);
    let identity = desk.stage.identity(&d).unwrap();
    assert_eq!(identity.model, "ESP301 with URS75BPP, SN1263");
    assert_eq!(identity.firmware.as_deref(), Some("3.0.1 6/1/99"));
    let told = desk.stage.settings(&d).unwrap();
    assert!(told.iter().any(|s| s.name == "speed_deg_per_s" && s.value.to_string() == "20"));
    desk.homes_and_turns(0.0, &[0.5, 12.3456, -33.25, 100.0], "home it again");
}

/// Truth: the simulated controller's own place, switches and errors.
#[test]
fn what_goes_wrong_is_named_and_it_stands_then() {
    let limits = Some([Esp301::REFERENCE - 100_000, Esp301::REFERENCE + 600_000]);
    let limited = Esp301::new(Esp301Settings { limits, ..Esp301Settings::default() });
    let obstacle = (50_000, "FOLLOWING ERROR THRESHOLD EXCEEDED (code 103)");
    let trial = Trial { far_deg: 50.0, too_short_s: 1, beyond_deg: 15.0, obstacle };
    desk(limited).unwrap().battery(trial, |desk| {
        let error = desk.stage.move_to(70.0, &desk.within(60)).unwrap_err();
        assert!(matches!(*error.error, DeviceError::LimitHit { side: Side::Right, .. }), "{error}");
        assert_eq!(error.done, Some(60.0));
    });
}

/// Truth: by construction: an axis in millimetres, a motor that stays off, an axis that is not there.
#[test]
fn an_axis_that_cannot_turn_is_refused() {
    let refused = |device: Esp301| match desk(device) {
        Err(error) => error.to_string(),
        Ok(_) => panic!("it cannot turn"),
    };
    let linear = Esp301::new(Esp301Settings { unit: 2, ..Esp301Settings::default() });
    let error = refused(linear);
    assert!(error.contains("unit 2, expected 7 (degrees): set it with 1SN7"), "{error}");
    let mut off = Esp301::new(Esp301Settings::default());
    off.no_power = true;
    let error = refused(off);
    assert!(error.contains("motor_on was set to 1, the device says 0"), "{error}");
    let line = InMemory::new(Esp301::new(Esp301Settings::default()));
    let link = LinkSettings { axis: 2, ..LinkSettings::default() };
    let clock = Arc::new(VirtualClock::new());
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
        (device.deg(), device.is_standing())
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
    let device = || Esp301::new(Esp301Settings::default());
    let limits = Some([-150_000, -100_000]);
    let limited = Esp301::new(Esp301Settings { limits, ..Esp301Settings::default() });
    let mut cases = usual(device, "10.0000 deg", 4, 14);
    cases.extend([
        Case::new(
            "limit",
            limited,
            "move, at Some(\"5.0000\"): Newport ESP controller: the right limit switch stopped it at 5.0000 deg on the way to 10.0000 deg",
        ),
        Case::new(
            "obstacle",
            device(),
            "home: Newport ESP controller refused to search its reference: AXIS-1 FOLLOWING ERROR THRESHOLD EXCEEDED (code 103)",
        )
        .with(|d| d.set_obstacle(Some(-1_000))),
    ]);
    fixtures("esp301", "Newport ESP301", boxed, cases);
}
