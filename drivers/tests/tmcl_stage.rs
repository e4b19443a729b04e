//! The TMCL stage on the simulated module: angles, backlash, limits, search, cancel. The truth is the module's own motor.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, Origin, RotationStage as _, Side, Value};
use sunglint_drivers::simulated::tmcl::{Module, ModuleSettings};
use sunglint_drivers::simulated::{InMemory, serve};
use sunglint_drivers::trinamic::tmcl::{Command, Status};
use sunglint_drivers::trinamic::{Approach, LinkSettings, Search, Stage, StageSettings};

struct Desk {
    clock: Arc<VirtualClock>,
    stage: Stage<InMemory<Module>>,
}

impl Desk {
    fn new(module: ModuleSettings, settings: StageSettings) -> Self {
        let clock = Arc::new(VirtualClock::new());
        let line = InMemory::new(Module::new(module));
        let deadline = Deadline::after(clock.clone(), Duration::from_secs(5));
        let stage = Stage::open(line, LinkSettings::default(), settings, &deadline).unwrap();
        Self { clock, stage }
    }

    fn within(&self, seconds: u64) -> Deadline {
        Deadline::after(self.clock.clone(), Duration::from_secs(seconds))
    }

    fn module(&self) -> &Module {
        &self.stage.line().device
    }
}

const FREE: [i64; 2] = [-1_000_000, 1_000_000];

/// Truth: `round(51,200 · angle / 360)`, in exact integers: 0.5° is 71.11 microsteps, and a thousand of them end at
/// 71,111, where steps that are added up end at 71,000.
#[test]
fn half_degrees_do_not_add_up_their_rounding() {
    let module = ModuleSettings { switches: FREE, speed: 500_000, ..ModuleSettings::default() };
    let mut desk = Desk::new(module, StageSettings::default());
    desk.stage.trust_counter();
    for i in 1..=1000_i64 {
        let angle = desk.stage.move_to(i as f64 * 0.5, &desk.within(10)).unwrap();
        // Half a microstep rounds away from zero; integers: (2 · 51,200 · i / 720 + 1) / 2.
        let steps = (2 * 51_200 * i + 720) / (2 * 720);
        assert_eq!(desk.module().motor(), steps, "{} deg", i as f64 * 0.5);
        assert!((angle - i as f64 * 0.5).abs() <= 0.5 * 360.0 / 51_200.0 + 1e-12);
    }
    assert_eq!(desk.module().motor(), 71_111);
}

/// Truth: the play of the simulated gear. Approached from below, the output stands at the same place wherever it came
/// from; approached directly it does not, by the whole backlash.
#[test]
fn backlash_is_taken_up_from_one_side() {
    let module = ModuleSettings { switches: FREE, backlash: 100, ..ModuleSettings::default() };
    let outputs = |approach| {
        let settings = StageSettings { approach, ..StageSettings::default() };
        let mut desk = Desk::new(module.clone(), settings);
        desk.stage.trust_counter();
        let mut outputs = Vec::new();
        // From below, from above, by a little from below after that, and again from where it stands.
        for from in [0.0, 40.0, 19.9, 20.0] {
            desk.stage.move_to(from, &desk.within(60)).unwrap();
            desk.stage.move_to(20.0, &desk.within(60)).unwrap();
            outputs.push(desk.module().output());
        }
        outputs
    };
    // 20° are 2844 microsteps; the output lags by 100 when it was pushed upward.
    assert_eq!(outputs(Approach::FromBelow { by_deg: 1.0 }), [2744; 4]);
    assert_eq!(outputs(Approach::FromAbove { by_deg: 1.0 }), [2844; 4]);
    let direct = outputs(Approach::Direct);
    assert!(direct.contains(&2744) && direct.contains(&2844), "{direct:?}");
}

fn searching() -> StageSettings {
    StageSettings {
        search: Some(Search { mode: 1, speed: 5_000, switch_speed: 500, tolerance_deg: 0.5 }),
        zero_deg: -90.0,
        ..StageSettings::default()
    }
}

/// Truth: the switch of the simulated module at −12,800 microsteps, a quarter turn; the angle there is configured as −90°,
/// so that 0° is where the motor stood at first.
#[test]
fn angles_count_from_the_reference() {
    let module = ModuleSettings { switches: [-12_800, 25_600], ..ModuleSettings::default() };
    let mut desk = Desk::new(module, searching());
    let unknown = desk.stage.move_to(0.0, &desk.within(5)).unwrap_err();
    assert!(matches!(*unknown.error, DeviceError::NotReady { .. }), "{unknown}");
    assert_eq!(desk.module().motor(), 0, "nothing moves before it is homed");
    let deadline = desk.within(60);
    assert_eq!(desk.stage.home(&deadline).unwrap(), -90.0);
    // 12,800 microsteps at 5,000/s, found within a poll of 50 ms and a few answers of 10 ms.
    let took = deadline.elapsed().as_secs_f64();
    assert!((2.56..2.9).contains(&took), "{took} s");
    assert_eq!(desk.stage.move_to(0.0, &desk.within(60)).unwrap(), 0.0);
    assert_eq!(desk.module().motor(), 0);
    assert_eq!(desk.stage.angle_deg(&desk.within(5)).unwrap(), 0.0);
    // A module that lost its power says 0 for everything: no angle is made of that.
    desk.stage.move_to(10.0, &desk.within(60)).unwrap();
    desk.stage.line_mut().device.power_cycle();
    for _ in 0..2 {
        let error = desk.stage.angle_deg(&desk.within(5)).unwrap_err();
        assert!(error.to_string().contains("home it"), "{error}");
    }
    let refused = desk.stage.move_to(20.0, &desk.within(5)).unwrap_err();
    assert!(matches!(*refused.error, DeviceError::NotReady { .. }), "{refused}");
    assert_eq!(desk.stage.home(&desk.within(60)).unwrap(), -90.0);
}

/// Truth: the switches, at ±5,000 microsteps (35.16°): the error names the side and where it stands, within the poll.
#[test]
fn a_limit_switch_is_no_target() {
    let module = ModuleSettings { switches: [-5_000, 5_000], ..ModuleSettings::default() };
    for (target, side, at) in [(90.0, Side::Right, 35.156_25), (-90.0, Side::Left, -35.156_25)] {
        let mut desk = Desk::new(module.clone(), StageSettings::default());
        desk.stage.trust_counter();
        let deadline = desk.within(600);
        let interrupted = desk.stage.move_to(target, &deadline).unwrap_err();
        assert_eq!(interrupted.done, Some(at));
        match *interrupted.error {
            DeviceError::LimitHit { side: found, at_deg, target_deg, .. } => {
                assert_eq!((found, at_deg), (side, at));
                assert!((target_deg - target).abs() < 1e-9);
            }
            other => panic!("{other}"),
        }
        // 0.5 s of motion; found long before the deadline of ten minutes.
        assert!(deadline.elapsed() < Duration::from_secs(2), "{:?}", deadline.elapsed());
        // Away from the pressed switch it goes.
        assert_eq!(desk.stage.move_to(0.0, &desk.within(60)).unwrap(), 0.0);
    }
}

/// Truth: the obstacle at 3,000 microsteps (21.09°).
#[test]
fn an_obstacle_is_a_stall() {
    let mut desk = Desk::new(
        ModuleSettings { switches: FREE, ..ModuleSettings::default() },
        StageSettings::default(),
    );
    desk.stage.trust_counter();
    desk.stage.line_mut().device.trouble.obstacle = Some(3_000);
    let deadline = desk.within(60);
    let interrupted = desk.stage.move_to(90.0, &deadline).unwrap_err();
    assert_eq!(interrupted.done, Some(21.093_75));
    assert!(matches!(*interrupted.error, DeviceError::Stalled { .. }), "{interrupted}");
    assert!(deadline.elapsed() < Duration::from_secs(3), "{:?}", deadline.elapsed());
}

/// Truth: 100 microsteps/s for 1 s. The motor is stopped, and the angle told is the motor's.
#[test]
fn a_deadline_and_a_token_stop_the_motor() {
    let module = ModuleSettings { switches: FREE, speed: 100, ..ModuleSettings::default() };
    let mut desk = Desk::new(module, StageSettings::default());
    desk.stage.trust_counter();
    let interrupted = desk.stage.move_to(90.0, &desk.within(1)).unwrap_err();
    assert!(matches!(*interrupted.error, DeviceError::TooSlow { .. }), "{interrupted}");
    assert!(desk.module().is_standing());
    let motor = desk.module().motor();
    // A second, less the first frame's way and plus the stop's.
    assert!((90..=110).contains(&motor), "{motor}");
    assert_eq!(interrupted.done, Some(motor as f64 * 360.0 / 51_200.0));
    let cancel = Cancel::new();
    cancel.cancel();
    let interrupted = desk.stage.move_to(90.0, &desk.within(60).with_cancel(&cancel)).unwrap_err();
    assert!(matches!(*interrupted.error, DeviceError::Cancelled { .. }), "{interrupted}");
}

/// A module that dies on the way cannot be stopped, and that is said.
#[test]
fn a_motor_that_cannot_be_stopped_is_told() {
    struct Dies(InMemory<Module>, u32);
    impl sunglint_drivers::transport::Bytes for Dies {
        fn send(
            &mut self,
            bytes: &[u8],
            deadline: &Deadline,
        ) -> Result<(), sunglint_drivers::transport::TransportError> {
            self.1 += 1;
            self.0.device.trouble.dead = self.1 > 8;
            self.0.send(bytes, deadline)
        }
        fn receive(
            &mut self,
            buffer: &mut [u8],
            deadline: &Deadline,
        ) -> Result<usize, sunglint_drivers::transport::TransportError> {
            self.0.receive(buffer, deadline)
        }
        fn discard(
            &mut self,
            deadline: &Deadline,
        ) -> Result<Vec<u8>, sunglint_drivers::transport::TransportError> {
            self.0.discard(deadline)
        }
    }
    let clock = Arc::new(VirtualClock::new());
    let within = |s| Deadline::after(clock.clone(), Duration::from_secs(s));
    let module = ModuleSettings { speed: 100, ..ModuleSettings::default() };
    let line = Dies(InMemory::new(Module::new(module)), 0);
    let mut stage =
        Stage::open(line, LinkSettings::default(), StageSettings::default(), &within(5)).unwrap();
    stage.trust_counter();
    let start = clock.now();
    let interrupted = stage.move_to(90.0, &within(60)).unwrap_err();
    assert!(interrupted.done.is_none());
    let message = interrupted.to_string();
    assert!(message.contains("no answer within") && message.contains("cut its power"), "{message}");
    assert!(clock.now() - start < Duration::from_secs(10), "silence is found long before 60 s");
}

#[test]
fn limits_of_travel_are_refused_before_anything_moves() {
    let settings = StageSettings {
        travel_deg: Some([0.0, 180.0].into()),
        approach: Approach::FromBelow { by_deg: 2.0 },
        inverted: true,
        ..StageSettings::default()
    };
    let mut desk =
        Desk::new(ModuleSettings { switches: FREE, ..ModuleSettings::default() }, settings);
    desk.stage.trust_counter();
    // 1° is within, but not its approach from −1°.
    for angle in [-0.1, 180.1, 1.0, f64::NAN, f64::INFINITY] {
        let refused = desk.stage.move_to(angle, &desk.within(5)).unwrap_err();
        assert!(matches!(*refused.error, DeviceError::OutOfRange { .. }), "{angle}: {refused}");
    }
    assert_eq!(desk.module().motor(), 0);
    // Inverted: angles grow while the counter falls. 2844.4 microsteps are 20°.
    desk.stage.move_to(20.0, &desk.within(60)).unwrap();
    assert_eq!(desk.module().motor(), -2844);
}

/// Truth: TMCL's status codes as pytrinamic names them, and the module's number and version as configured.
#[test]
fn refusals_identity_and_settings() {
    let mut desk = Desk::new(ModuleSettings::default(), StageSettings::default());
    let identity = desk.stage.identity(&desk.within(5)).unwrap();
    assert_eq!(
        (identity.model.as_str(), identity.firmware.as_deref()),
        ("TMCM-1110", Some("1.09"))
    );
    assert_eq!(desk.stage.set_max_speed(777, &desk.within(5)).unwrap(), 777);
    let refused = desk.stage.set_max_speed(-1, &desk.within(5)).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "Trinamic stage refused the axis parameter 4 of motor 0 = -1: the module does not take this value (code 4)"
    );
    let settings = desk.stage.settings(&desk.within(5)).unwrap();
    let speed = settings.iter().find(|setting| setting.name == "max_speed_units").unwrap();
    assert_eq!((&speed.value, speed.origin), (&Value::Integer(777), Origin::ReadBack));
    let mut line = desk.stage.into_line();
    line.device.trouble.endless_search = true;
    let deadline = Deadline::after(desk.clock.clone(), Duration::from_secs(5));
    let mut stage = Stage::open(line, LinkSettings::default(), searching(), &deadline).unwrap();
    let endless = stage.home(&deadline).unwrap_err();
    assert!(matches!(*endless.error, DeviceError::TooSlow { .. }), "{endless}");
    let mut line = stage.into_line();
    line.device.trouble.endless_search = false;
    line.device.trouble.refuse = Some((Command::Search, Some(0), Status::NotAvailable));
    let deadline = Deadline::after(desk.clock.clone(), Duration::from_secs(60));
    let mut stage = Stage::open(line, LinkSettings::default(), searching(), &deadline).unwrap();
    let refused = stage.home(&deadline).unwrap_err();
    assert!(refused.to_string().contains("not available on this module (code 6)"), "{refused}");
}

/// The simulated module on a real pty, spoken to through serialport.
#[test]
fn the_whole_way_through_a_pty() {
    let pty = crate::common::pty();
    let cancel = Cancel::new();
    let deadline = crate::common::within(60.0).with_cancel(&cancel);
    let mut device = pty.device;
    let module = Module::new(ModuleSettings {
        switches: [-2_000, 60_000],
        speed: 100_000,
        ..ModuleSettings::default()
    });
    let server = std::thread::spawn(move || serve(module, &mut device, &deadline).unwrap());
    let mut stage =
        Stage::open(pty.host, LinkSettings::default(), searching(), &crate::common::within(10.0))
            .unwrap();
    assert_eq!(stage.home(&crate::common::within(20.0)).unwrap(), -90.0);
    let angle = stage.move_to(0.0, &crate::common::within(20.0)).unwrap();
    assert_eq!(angle, 0.0);
    cancel.cancel();
    // From the switch at −2,000 a quarter turn of 12,800.
    assert_eq!(server.join().unwrap().motor(), 10_800);
}
