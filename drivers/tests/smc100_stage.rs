//! The SMC100 stage with a simulated controller: what is right, what goes wrong, bad lines, recorded conversations.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::turning::{Case, Counterpart as _, Desk, Rig, Trial, fixtures, thousand, usual};
use std::time::Duration;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{Device as _, DeviceError, RotationStage, Side};
use sunglint_drivers::newport::smc100::{LinkSettings, Smc100 as Axis, open};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::smc100::{Smc100, Smc100Settings};
use sunglint_drivers::transport::Bytes;
use sunglint_drivers::turning::{Turning, TurningSettings};

fn settings() -> TurningSettings {
    TurningSettings { tolerance_deg: 0.001, ..TurningSettings::default() }
}

fn desk(device: Smc100Settings) -> Desk<Axis<InMemory<Smc100>>, Smc100> {
    let link = LinkSettings { address: device.address, ..LinkSettings::default() };
    let line = InMemory::new(Smc100::new(device));
    let open = |d: &Deadline| open(line, link, settings(), d);
    Desk::new(open, |stage| &mut stage.axis_mut().line_mut().device).unwrap()
}

/// Truth: the simulated controller's own place; 10,000 of its counts are 1°. It searches its reference once only.
#[test]
fn it_homes_and_turns_to_absolute_angles() {
    for address in [1, 12] {
        let mut desk = desk(Smc100Settings { address, ..Smc100Settings::default() });
        let d = desk.within(600);
        assert_eq!(desk.stage.identity(&d).unwrap().model, "SMC_CC_017 with URS100CC");
        assert!(desk.stage.settings(&d).unwrap().iter().any(|s| s.name == "speed_deg_per_s"));
        desk.homes_and_turns(0.0, &[0.5, 12.3456, -33.25, 100.0], "no reference");
        desk.stage.home(&desk.within(600)).unwrap();
        desk.stage.move_to(100.0, &desk.within(600)).unwrap();
        let again = desk.stage.home(&desk.within(600)).unwrap();
        assert!((again - 100.0).abs() < 1e-9, "it has its reference, and stays");
    }
}

/// Truth: the simulated controller's own place, ends and states.
#[test]
fn what_goes_wrong_is_named_and_it_stands_then() {
    let limits = Some([Smc100::REFERENCE - 100_000, Smc100::REFERENCE + 600_000]);
    let obstacle = (50_000, "following error");
    let trial = Trial { far_deg: 50.0, too_short_s: 1, beyond_deg: 10.0, obstacle };
    desk(Smc100Settings { limits, ..Smc100Settings::default() }).battery(trial, |desk| {
        let error = desk.stage.move_to(70.0, &desk.within(60)).unwrap_err();
        assert!(matches!(*error.error, DeviceError::LimitHit { side: Side::Right, .. }), "{error}");
        desk.device().says = Some(0x3c);
        let (error, _) = desk.fails(2.0);
        assert!(error.contains("refused 1PA2.00000: not allowed (code 68)"), "{error}");
        desk.device().says = Some(0x14);
        let (error, _) = desk.fails(2.0);
        assert!(error.contains("no reference"), "{error}");
        desk.device().says = None;
    });
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
        (device.deg(), device.is_standing())
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
    let device = || Smc100::new(Smc100Settings::default());
    let mut cases = usual(device, "10.0000 deg", 4, 9);
    cases.extend([
        Case::new(
            "obstacle",
            device(),
            "home: Newport SMC100 or CONEX-CC refused to search its reference: following error: check for an obstacle and the load",
        )
        .with(|d| d.set_obstacle(Some(-1_000))),
        Case::new(
            "configuration",
            device(),
            "home: Newport SMC100 or CONEX-CC refused to search its reference: it is being configured: end that (PW0) first",
        )
        .with(|d| d.says = Some(0x14)),
    ]);
    fixtures("smc100", "Newport SMC100", boxed, cases);
}
