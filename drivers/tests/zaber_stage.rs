//! The Zaber stage with a simulated device: what is right, what goes wrong, bad lines, recorded conversations.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::turning::{Case, Counterpart as _, Desk, Rig, Trial, fixtures, thousand, usual};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::catalogue::Address;
use sunglint_drivers::clock::{Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, RotationStage};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::zaber::{Zaber, ZaberSettings};
use sunglint_drivers::transport::Bytes;
use sunglint_drivers::turning::{Turning, TurningSettings};
use sunglint_drivers::zaber::{LinkSettings, Zaber as Axis, open};

fn after(clock: &Arc<VirtualClock>, s: u64) -> Deadline {
    Deadline::after(clock.clone(), Duration::from_secs(s))
}

fn desk(device: ZaberSettings) -> Desk<Axis<InMemory<Zaber>>, Zaber> {
    let link = LinkSettings { device: device.address, ..LinkSettings::new(1_000.0) };
    let line = InMemory::new(Zaber::new(device));
    let open = |d: &Deadline| open(line, link, TurningSettings::default(), d);
    Desk::new(open, |stage| &mut stage.axis_mut().line_mut().device).unwrap()
}

/// Truth: the simulated device's own place; 1000 microsteps are 1°. With checksums and without, with alerts, and with a
/// position of its own at the reference.
#[test]
fn it_homes_and_turns_to_absolute_angles() {
    for (checksums, alerts, address, preset) in
        [(true, false, 1, 0), (false, true, 1, 0), (true, true, 42, 5_000)]
    {
        let settings = ZaberSettings { checksums, alerts, address, preset, ..Default::default() };
        let mut desk = desk(settings);
        let d = desk.within(60);
        let identity = desk.stage.identity(&d).unwrap();
        assert_eq!(
            (identity.model.as_str(), identity.serial.as_deref()),
            ("device 50081", Some("12345"))
        );
        let told = desk.stage.settings(&d).unwrap();
        let has = |name: &str, value: &str| {
            told.iter().any(|s| s.name == name && s.value.to_string() == value)
        };
        assert!(
            has("checksums", if checksums { "on" } else { "off" })
                && has("max_speed_units", "20000")
        );
        let home_deg = f64::from(preset) / 1_000.0;
        desk.homes_and_turns(home_deg, &[0.5, 12.345, -33.25, 100.0], "no reference");
    }
}

/// Truth: the simulated device's own place and faults.
#[test]
fn what_goes_wrong_is_named_and_it_stands_then() {
    let obstacle = (50_000, "FS, stalled and stopped");
    let trial = Trial { far_deg: 90.0, too_short_s: 1, beyond_deg: 15.0, obstacle };
    desk(ZaberSettings::default()).battery(trial, |desk| {
        desk.device().refuses = Some("PARKED");
        let (error, at) = desk.fails(10.0);
        assert!(error.contains("refused move abs 10000: it says `PARKED`"), "{error}");
        assert_eq!(at, Some(90.0));
        desk.device().refuses = None;
    });
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
    type Axis = Axis<Faulty<InMemory<Zaber>>>;
    const WITHIN_DEG: f64 = 0.0005;

    fn open(faults: Faults, seed: u64, d: &Deadline) -> Result<Turning<Self::Axis>, DeviceError> {
        let checksums = !seed.is_multiple_of(4);
        let settings = ZaberSettings { checksums, alerts: true, ..ZaberSettings::default() };
        let line = Faulty::new(InMemory::new(Zaber::new(settings)), faults, seed);
        open(line, LinkSettings::new(1_000.0), TurningSettings::default(), d)
    }

    fn truth(stage: &Turning<Self::Axis>) -> (f64, bool) {
        let device = &stage.axis().line().inner().device;
        (device.deg(), device.is_standing())
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
    let device = || Zaber::new(ZaberSettings::default());
    let plain = ZaberSettings { checksums: false, alerts: true, ..ZaberSettings::default() };
    let good = "10.0000 deg";
    let mut cases = usual(device, good, 4, 6);
    cases.extend([
        Case::new("without_checksums", Zaber::new(plain), good),
        Case::new("refused", device(), "home: Zaber device refused home: it says `PARKED`")
            .with(|d| d.refuses = Some("PARKED")),
        Case::new(
            "obstacle",
            device(),
            "home: Zaber device refused to search its reference: FS, stalled and stopped: check for an obstacle and the load",
        )
        .with(|d| d.set_obstacle(Some(-1_000))),
        Case::new(
            "power_lost",
            device(),
            "home: Zaber device: its reference search did not end at its reference: is the motor on, and the switch free?",
        )
        .before(12, Zaber::power_cycle),
    ]);
    fixtures("zaber", "Zaber, device 50081", boxed, cases);
}
