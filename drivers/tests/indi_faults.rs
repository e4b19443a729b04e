//! Camera, rotator and wheel on lines that fail: a thousand seeds each, on a virtual clock.
//!
//! INDI has no check sums: it relies on TCP, which delivers what was sent in its order, or breaks. The first two kinds of
//! line do what TCP can: delays, pieces of any size, and the end. There every run must end right or with a named error,
//! its frames right to the pixel. The third loses and flips bytes, which TCP prevents: what the protocol can tell (lengths, names,
//! what was set read back) must be right there too, or an error; a flipped bit of a pixel's own base64 nobody can tell.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{
    Camera as _, DeviceError, FilterWheel as _, RotationStage as _, Window,
};
use sunglint_drivers::indi::{
    CameraSettings, RotatorSettings, SessionSettings, open_camera, open_rotator, open_wheel,
};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::simulated::indi::{CameraSpec, Ramp, Server, ServerSettings, Simulated};
use sunglint_formats::Frame;

/// Aborts and last questions take their own time after a deadline: two seconds to stop, five to ask, a stream's window back.
const GRACE: Duration = Duration::from_millis(9_100);

const SLOW: Faults = Faults {
    delay: 0.1,
    longest_delay: Duration::from_millis(400),
    short_read: 0.3,
    drop: 0.0,
    flip: 0.0,
    silence: 0.0,
    disconnect: 0.0,
};
const BREAKING: Faults = Faults { disconnect: 0.005, ..SLOW };
const LOSING: Faults = Faults { drop: 2e-6, flip: 2e-6, silence: 0.002, ..SLOW };

fn name(error: &DeviceError) -> &'static str {
    match error {
        DeviceError::Transport { .. } => "transport",
        DeviceError::Awaited { .. } => "awaited",
        DeviceError::Protocol { .. } => "protocol",
        DeviceError::Declined { .. } => "declined",
        DeviceError::Lost { .. } => "lost",
        DeviceError::NotTaken { .. } => "not taken",
        DeviceError::NotReady { .. } => "not ready",
        DeviceError::NotStopped { .. } => "not stopped",
        DeviceError::Unknown { .. } => "unknown",
        DeviceError::OutOfRange { .. } => "out of range",
        other => panic!("no such error can come of a bad line: {other}"),
    }
}

struct Run {
    clock: Arc<VirtualClock>,
    seed: u64,
    /// Whether bytes are what they were.
    sound: bool,
}

impl Run {
    fn within(&self, s: u64) -> Deadline {
        Deadline::after(self.clock.clone(), Duration::from_secs(s))
    }

    /// Runs a call and holds it to its deadline.
    fn timed<R>(&self, s: u64, what: &str, call: impl FnOnce(Deadline) -> R) -> R {
        let start = self.clock.now();
        let result = call(self.within(s));
        let took = self.clock.now() - start;
        assert!(took <= Duration::from_secs(s) + GRACE, "seed {}: {what} took {took:?}", self.seed);
        result
    }

    fn line(&self, faults: Faults) -> Faulty<Simulated> {
        let camera = CameraSpec { sensor_px: [40, 30], ..CameraSpec::default() };
        let settings = ServerSettings { camera: Some(camera), ..ServerSettings::default() };
        Faulty::new(Simulated::new(Server::new(settings, Ramp)), faults, self.seed)
    }

    /// Truth: the scene's formula at each pixel of the sensor.
    fn check(&self, frame: &Frame, window: Window, exposure_s: f64, shift: u32) {
        let size = [0, 1].map(|axis| (window.size_px[axis] / window.binning[axis]) as usize);
        assert_eq!(frame.pixels.dim(), (size[1], size[0]), "seed {}", self.seed);
        assert_eq!(frame.origin, window.origin_px, "seed {}", self.seed);
        if !self.sound {
            return;
        }
        assert_eq!(frame.exposure_s, exposure_s, "seed {}", self.seed);
        for ((row, column), &pixel) in frame.pixels.indexed_iter() {
            let [x, y] = [window.origin_px[0] + column as u32, window.origin_px[1] + row as u32];
            let truth = Ramp::adu(x, y, exposure_s) >> shift;
            assert_eq!(pixel, truth, "seed {} at {column}, {row}", self.seed);
        }
    }

    fn camera(&self, line: &mut Faulty<Simulated>) -> Result<(), DeviceError> {
        let opened = self.timed(20, "open", |d| {
            open_camera(line, "Simulated Camera", CameraSettings::default(), &d)
        });
        let mut camera = opened?;
        for (i, exposure_s) in [0.1, 0.5, 0.02].into_iter().enumerate() {
            let window = Window {
                origin_px: [1 + i as u32, 2],
                size_px: [30 - i as u32, 20],
                binning: [1, 1],
            };
            let has = self.timed(10, "window", |d| camera.set_window(window, &d))?;
            assert!(!self.sound || has == window, "seed {}", self.seed);
            let window = has;
            let frame = self.timed(10, "expose", |d| camera.expose(exposure_s, &d))?;
            self.check(&frame, window, exposure_s, 0);
        }
        let window = camera.window();
        let mut count = 0;
        let mut take = |frame: Frame| {
            self.check(&frame, window, 0.03, 8);
            count += 1;
            if count == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let streamed = self.timed(10, "stream", |d| camera.stream(0.03, &mut take, &d));
        match streamed {
            Ok(taken) => assert_eq!(taken, 3),
            Err(interrupted) => {
                assert_eq!(interrupted.done, count, "seed {}", self.seed);
                return Err(*interrupted.error);
            }
        }
        // A stream puts the window back.
        let frame = self.timed(10, "expose", |d| camera.expose(0.2, &d))?;
        self.check(&frame, window, 0.2, 0);
        Ok(())
    }

    fn rotator(&self, line: &mut Faulty<Simulated>) -> Result<(), DeviceError> {
        let opened = self.timed(20, "open", |d| {
            open_rotator(line, "Simulated Rotator", RotatorSettings::default(), &d)
        });
        let mut rotator = opened?;
        for target in [3.5, 30.0, 12.25] {
            let moved = self.timed(20, "move", |d| rotator.move_to(target, &d));
            let server = &rotator.line().inner().server;
            // A server that has never heard of its client's device has no angle.
            let truth = server
                .vector("Simulated Rotator", "ABS_ROTATOR_ANGLE")
                .and_then(|vector| vector.number("ANGLE"));
            match moved {
                Ok(angle) => {
                    assert!((angle - target).abs() <= 0.05, "seed {}", self.seed);
                    if self.sound {
                        assert_eq!(truth, Some(target), "seed {}", self.seed);
                    }
                }
                Err(interrupted) => {
                    if self.sound && interrupted.done.is_some() {
                        assert_eq!(interrupted.done, truth, "seed {}", self.seed);
                        assert!(server.is_at_rest(), "seed {}: said to be stopped", self.seed);
                    }
                    return Err(*interrupted.error);
                }
            }
        }
        let angle = self.timed(10, "angle", |d| rotator.angle_deg(&d))?;
        assert!(!self.sound || angle == 12.25, "seed {}", self.seed);
        Ok(())
    }

    fn wheel(&self, line: &mut Faulty<Simulated>) -> Result<(), DeviceError> {
        let opened = self.timed(20, "open", |d| {
            open_wheel(line, "Simulated Wheel", SessionSettings::default(), &d)
        });
        let mut wheel = opened?;
        for slot in [3, 5, 1, 4] {
            match self.timed(10, "select", |d| wheel.select(slot, &d)) {
                Ok(got) => {
                    assert_eq!(got, slot, "seed {}", self.seed);
                    let server = &wheel.line().inner().server;
                    let truth = server.vector("Simulated Wheel", "FILTER_SLOT").unwrap();
                    if self.sound {
                        assert_eq!(truth.number("FILTER_SLOT_VALUE"), Some(f64::from(slot)));
                    }
                }
                Err(interrupted) => return Err(*interrupted.error),
            }
        }
        let slot = self.timed(10, "slot", |d| wheel.slot(&d))?;
        assert!(!self.sound || slot == 4, "seed {}", self.seed);
        Ok(())
    }
}

type Driver = fn(&Run, &mut Faulty<Simulated>) -> Result<(), DeviceError>;

fn run(driver: Driver, faults: Faults, seed: u64) -> (&'static str, Injected, Duration) {
    let clock = Arc::new(VirtualClock::new());
    let run = Run {
        clock: clock.clone(),
        seed,
        sound: faults.drop + faults.flip + faults.silence == 0.0,
    };
    let mut line = run.line(faults);
    let end = match driver(&run, &mut line) {
        Ok(()) => "right",
        Err(error) => name(&error),
    };
    (end, line.injected(), clock.now())
}

/// Truth: the simulated devices' own state, the scene's formula, the clock. Each kind of line gets a third of the seeds; the
/// slow one must always end right, for its delays are shorter than the driver's patience.
fn a_thousand_seeds(driver: Driver) {
    let mut ends: BTreeMap<(&str, &str), u32> = BTreeMap::new();
    let mut sum = Injected::default();
    for seed in 0..1000 {
        let (kind, faults) =
            [("slow", SLOW), ("breaking", BREAKING), ("losing", LOSING)][seed as usize % 3];
        let (end, injected, _) = run(driver, faults, seed);
        *ends.entry((kind, end)).or_default() += 1;
        sum.delays += injected.delays;
        sum.drops += injected.drops;
        sum.flips += injected.flips;
        sum.short_reads += injected.short_reads;
        sum.silences += injected.silences;
    }
    eprintln!("{ends:?}\n{sum:?}");
    let count = |kind, end| ends.get(&(kind, end)).copied().unwrap_or(0);
    assert_eq!(count("slow", "right"), 334, "{ends:?}");
    // The faults did happen: some runs break, some do not.
    assert!(count("breaking", "transport") > 10 && count("breaking", "right") > 10, "{ends:?}");
    assert!((10..333).contains(&count("losing", "right")), "{ends:?}");
    assert!(
        sum.delays > 1000 && sum.short_reads > 1000 && sum.drops > 2 && sum.flips > 2,
        "{sum:?}"
    );
}

#[test]
fn a_camera_on_a_thousand_lines() {
    a_thousand_seeds(Run::camera);
}

#[test]
fn a_rotator_on_a_thousand_lines() {
    a_thousand_seeds(Run::rotator);
}

#[test]
fn a_wheel_on_a_thousand_lines() {
    a_thousand_seeds(Run::wheel);
}

/// Truth: without faults every run is right; the same seed gives the same run, to the nanosecond.
#[test]
fn no_faults_no_errors_and_seeds_repeat() {
    for driver in [Run::camera as Driver, Run::rotator, Run::wheel] {
        assert_eq!(run(driver, Faults::NONE, 1).0, "right");
        for seed in 0..5 {
            assert_eq!(run(driver, LOSING, seed), run(driver, LOSING, seed), "seed {seed}");
        }
    }
}
