//! The APT stage with a simulated one: in memory on a virtual clock, and through a real pty.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, RotationStage as _, Side};
use sunglint_drivers::simulated::apt::{Apt, AptSettings};
use sunglint_drivers::simulated::{InMemory, serve};
use sunglint_drivers::thorlabs::apt::{LinkSettings, Model, Stage, StageSettings};

type Simulated = Stage<InMemory<Apt>>;

fn after(clock: &Arc<VirtualClock>, s: u64) -> Deadline {
    Deadline::after(clock.clone(), Duration::from_secs(s))
}

fn open(clock: &Arc<VirtualClock>, apt: AptSettings, settings: StageSettings) -> Simulated {
    let line = InMemory::new(Apt::new(apt));
    Stage::open(line, LinkSettings::default(), settings, &after(clock, 5)).unwrap()
}

fn clock() -> Arc<VirtualClock> {
    Arc::new(VirtualClock::new())
}

/// Truth: the simulated stage's own place; 409,600 microsteps are 3° (K10CR1).
#[test]
fn it_homes_and_turns_to_absolute_angles() {
    let clock = clock();
    let mut stage = open(&clock, AptSettings::default(), StageSettings::default());
    let d = after(&clock, 600);
    let identity = stage.identity(&d).unwrap();
    assert_eq!((identity.model.as_str(), identity.serial.as_deref()), ("K10CR1", Some("55123456")));
    assert_eq!(identity.firmware.as_deref(), Some("1.2.3"));
    let error = stage.angle_deg(&d).unwrap_err();
    assert!(error.to_string().contains("home it"), "{error}");
    assert!(stage.move_to(1.0, &d).unwrap_err().to_string().contains("home it"));
    assert!(stage.line().device.is_standing(), "it was not sent anywhere");
    assert_eq!(stage.home(&d).unwrap(), 0.0);
    assert_eq!(stage.line().device.place(), -2_048_000);
    let mut angle = 0.0;
    for i in 1..=720 {
        // A turn in steps of 0.5°: 68,266.67 microsteps each, rounded from the angle, never added up.
        angle = f64::from(i) * 0.5;
        let at = stage.move_to(angle, &d).unwrap();
        let place = stage.line().device.place() + 2_048_000;
        assert_eq!(place, (angle * 409_600.0 / 3.0).round() as i64);
        assert!((at - angle).abs() < 0.5 * 3.0 / 409_600.0 + 1e-12);
    }
    // A microstep is 7e-6°; 1e-9 is for the order of two divisions, here and below.
    let near =
        |found: f64, truth: f64| assert!((found - truth).abs() < 1e-9, "{found}, not {truth}");
    assert_eq!(angle, 360.0);
    near(stage.angle_deg(&d).unwrap(), 360.0);
    // Ten turns back, more than 50 messages: the keep-alive keeps it speaking.
    near(stage.move_to(-3_240.0, &after(&clock, 600)).unwrap(), -3_240.0);
    let settings = stage.settings(&d).unwrap();
    assert_eq!(settings[0].name, "counts_per_deg");
    assert!(settings.iter().any(|s| s.name == "max_speed_units"));
    stage.line_mut().device.power_cycle();
    let error = stage.angle_deg(&d).unwrap_err();
    assert!(matches!(error, DeviceError::NotReady { .. }), "{error}");
}

/// Truth: the maker's counts per degree (1919.64 for PRM1Z8), a servo that rests 4 counts from its target; a gear of 66
/// for HDR50; the model that the controller names.
#[test]
fn models_have_their_scales() {
    let clock = clock();
    let servo = AptSettings {
        model: "KDC101".into(),
        servo: true,
        speed: 48_000,
        reference: -10_000,
        error: 4,
        ..AptSettings::default()
    };
    let settings = StageSettings { model: Some(Model::Prm1z8), ..StageSettings::default() };
    let mut stage = open(&clock, servo, settings);
    assert_eq!(stage.home(&after(&clock, 60)).unwrap(), 0.0);
    let at = stage.move_to(45.0, &after(&clock, 60)).unwrap();
    let place = stage.line().device.place() + 10_000;
    assert_eq!(place, (45.0_f64 * 1_919.641_857_862_339).round() as i64 + 4);
    // The stage says where it is, not where it was sent.
    assert!((at - place as f64 / 1_919.641_857_862_339).abs() < 1e-9 && at != 45.0, "{at}");
    let bsc = AptSettings { model: "BSC201".into(), ..AptSettings::default() };
    let settings = StageSettings {
        model: Some(Model::Hdr50),
        inverted: true,
        zero_deg: 10.0,
        ..Default::default()
    };
    let mut stage = open(&clock, bsc.clone(), settings);
    assert_eq!(stage.home(&after(&clock, 600)).unwrap(), 10.0);
    stage.move_to(12.0, &after(&clock, 60)).unwrap();
    // 409,600 microsteps × 66 / 360° = 75,093.33 a degree, the other way round.
    assert_eq!(stage.line().device.place() + 2_048_000, -150_187);
    let line = InMemory::new(Apt::new(bsc));
    let error = Stage::open(line, LinkSettings::default(), Default::default(), &after(&clock, 5));
    let error = error.unwrap_err().to_string();
    assert!(
        error.contains("found a BSC201") && error.contains("give counts_per_deg=NUMBER"),
        "{error}"
    );
}

/// Truth: counts of a turn as pylablib 1.4.3 and Thorlabs' data sheets have them; the simulated stage's own place.
#[test]
fn every_named_model_has_its_scale() {
    for (model, controller, turn) in [
        (Model::K10cr2, "K10CR2", 49_152_000.0),
        (Model::Nr360, "KST101", 27_033_600.0),
        (Model::Nr360Coarse, "BSC001", 1_689_600.0),
        (Model::Ddr100, "KBD101", 3_276_800.0),
        (Model::Ddr05, "KBD101", 2_000_000.0),
        (Model::Ddr25, "BBD301", 1_440_000.0),
    ] {
        let clock = clock();
        let servo = controller.contains("BD");
        let apt = AptSettings {
            model: controller.into(),
            servo,
            speed: turn as i64 / 36,
            reference: -1_000,
            error: if servo { 5 } else { 0 },
            ..AptSettings::default()
        };
        let settings = StageSettings { model: Some(model), ..Default::default() };
        let mut stage = open(&clock, apt, settings);
        assert_eq!(stage.home(&after(&clock, 60)).unwrap(), 0.0, "{model:?}");
        let at = stage.move_to(45.0, &after(&clock, 60)).unwrap();
        let place = stage.line().device.place() + 1_000;
        assert_eq!(place, (turn / 8.0) as i64 + if servo { 5 } else { 0 }, "{model:?}");
        assert!((at - place as f64 * 360.0 / turn).abs() < 1e-9, "{model:?}: {at}");
        let named = Model::named(model.name());
        assert_eq!(named, Some(model));
        let said = stage.settings(&after(&clock, 60)).unwrap();
        assert!(said.iter().any(|s| s.name == "model" && s.value.to_string() == model.name()));
    }
}

/// Truth: a stage that names itself is taken as it is; another one is never guessed, and never refused with its counts.
#[test]
fn unknown_stages_need_their_counts_of_a_degree() {
    let open = |controller: &str, settings: StageSettings| {
        let clock = clock();
        let servo = controller.starts_with("KDC");
        let apt = AptSettings { model: controller.into(), servo, error: 3, ..Default::default() };
        let line = InMemory::new(Apt::new(apt));
        let mut stage = Stage::open(line, LinkSettings::default(), settings, &after(&clock, 5))
            .unwrap_or_else(|e| panic!("{e}"));
        stage.trust_counter();
        stage.move_to(1.0, &after(&clock, 60)).map_err(|e| e.to_string())
    };
    let refused = |controller: &str, model: Option<Model>| {
        let clock = clock();
        let line =
            InMemory::new(Apt::new(AptSettings { model: controller.into(), ..Default::default() }));
        let settings = StageSettings { model, ..Default::default() };
        let error = Stage::open(line, LinkSettings::default(), settings, &after(&clock, 5));
        error.unwrap_err().to_string()
    };
    for controller in ["XYZ001", "KST101", "KDC101", "K10CR3"] {
        let error = refused(controller, None);
        assert!(error.contains(&format!("found a {controller}")), "{error}");
        assert!(error.contains("ddr100") && error.contains("counts_per_deg=NUMBER"), "{error}");
    }
    let error = refused("K10CR2", Some(Model::K10cr1));
    assert!(error.contains("found k10cr1, expected one of k10cr2"), "{error}");
    let error = refused("KDC101", Some(Model::K10cr2));
    assert!(error.contains("found k10cr2") && error.contains("on a KDC101"), "{error}");
    let error = refused("K10CR1", Some(Model::Prm1z8));
    assert!(error.contains("expected one of k10cr1"), "{error}");
    for nonsense in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = refused("X", Some(Model::Other { counts_per_deg: nonsense, servo: None }));
        assert!(error.contains("counts_per_deg"), "{error}");
    }
    let other = |counts_per_deg, servo| Some(Model::Other { counts_per_deg, servo });
    let with = |model, tolerance_deg| StageSettings { model, tolerance_deg, ..Default::default() };
    // 3 counts off: a servo of 1000 counts a degree may be 5 off, a stepper none, unless it is said.
    assert_eq!(open("KDC101", with(other(1_000.0, None), None)), Ok(1.003));
    assert!(
        open("XYZ001", with(other(1_000.0, None), None))
            .unwrap_err()
            .contains("stands still at 1.003")
    );
    assert_eq!(open("XYZ001", with(other(1_000.0, None), Some(0.003))), Ok(1.003));
    assert_eq!(open("KDC10X", with(other(1_000.0, Some(true)), None)), Ok(1.003));
}

/// Truth: the simulated stage's own place, its switches and obstacles.
#[test]
fn what_goes_wrong_is_named_and_it_stands_then() {
    let clock = clock();
    let limited = AptSettings { limits: Some([-2_100_000, 1_000_000]), ..AptSettings::default() };
    let settings =
        StageSettings { travel_deg: Some([-5.0, 90.0].into()), ..StageSettings::default() };
    let mut stage = open(&clock, limited, settings);
    stage.home(&after(&clock, 60)).unwrap();
    let error = stage.move_to(90.1, &after(&clock, 60)).unwrap_err();
    assert!(error.to_string().contains("found 90.1, expected -5 to 90"), "{error}");
    let error = stage.move_to(60.0, &after(&clock, 60)).unwrap_err();
    let at = 3_048_000.0 * 3.0 / 409_600.0;
    assert!((error.done.unwrap() - at).abs() < 1e-9, "{error:?}");
    assert!(matches!(*error.error, DeviceError::LimitHit { side: Side::Right, .. }), "{error}");
    stage.line_mut().device.trouble.obstacle = Some(0);
    let error = stage.move_to(10.0, &after(&clock, 60)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::Stalled { .. }), "{error}");
    assert!((error.done.unwrap() - 15.0).abs() < 1e-9, "{error:?}");
    stage.line_mut().device.trouble.obstacle = None;
    stage.line_mut().device.trouble.complains = true;
    let error = stage.move_to(10.0, &after(&clock, 60)).unwrap_err();
    assert!(error.to_string().contains("the channel is busy"), "{error}");
    stage.line_mut().device.trouble = Default::default();
    // Too slow: it was stopped on its way, and says where.
    let begun = clock.now();
    let error = stage.move_to(2.0, &after(&clock, 1)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::TooSlow { .. }), "{error}");
    assert!(stage.line().device.is_standing());
    let place = (stage.line().device.place() + 2_048_000) as f64 * 3.0 / 409_600.0;
    assert!((error.done.unwrap() - place).abs() < 1e-9 && place < 14.9 && place > 2.1, "{place}");
    assert!(clock.now() - begun < Duration::from_secs(4));
    let cancel = Cancel::new();
    cancel.cancel();
    let error = stage.move_to(2.0, &after(&clock, 60).with_cancel(&cancel)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::Cancelled { .. }), "{error}");
    // A search that does not begin, though the old reference still holds, and one that does not end.
    stage.line_mut().device.trouble.no_search = true;
    let error = stage.home(&after(&clock, 60)).unwrap_err();
    assert!(error.to_string().contains("did not begin"), "{error}");
    stage.line_mut().device.trouble = Default::default();
    stage.line_mut().device.trouble.endless_search = true;
    let error = stage.home(&after(&clock, 5)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::TooSlow { .. }), "{error}");
    assert!(stage.line().device.is_standing() && error.done.is_none());
    stage.line_mut().device.trouble.dead = true;
    let error = stage.home(&after(&clock, 5)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::NotStopped { .. }), "{error}");
    let mut off = Apt::new(AptSettings::default());
    off.trouble.disabled = true;
    let line = InMemory::new(off);
    let error = Stage::open(line, LinkSettings::default(), Default::default(), &after(&clock, 5));
    assert!(error.unwrap_err().to_string().contains("channel_enabled was set to 1"));
}

/// The same through serialport and a real pty, which has no RTS and CTS. Truth: the stage at the other end.
#[test]
fn through_a_real_pty() {
    let pty = crate::common::pty();
    let mut device = pty.device;
    let cancel = Cancel::new();
    let deadline = crate::common::within(60.0).with_cancel(&cancel);
    let apt = Apt::new(AptSettings { speed: 20_000_000, ..AptSettings::default() });
    let server = std::thread::spawn(move || serve(apt, &mut device, &deadline).unwrap());
    let settings = StageSettings { poll: Duration::from_millis(20), ..StageSettings::default() };
    let mut stage =
        Stage::open(pty.host, LinkSettings::default(), settings, &crate::common::within(10.0))
            .unwrap();
    assert_eq!(stage.home(&crate::common::within(20.0)).unwrap(), 0.0);
    for target in [30.0, -4.5] {
        let at = stage.move_to(target, &crate::common::within(20.0)).unwrap();
        assert!((at - target).abs() < 1e-9, "{at}");
    }
    stage.stop(&crate::common::within(5.0)).unwrap();
    cancel.cancel();
    let apt = server.join().unwrap();
    // 4.5° are 614,400 microsteps.
    assert_eq!(apt.place(), -2_048_000 - 614_400);
}
