//! Recordings of a frame grabber as the cameras of a night: films and numbered images, at their own times, as fast as they can be read.

use super::opener::{Catalogue, Opener};
use super::plan::{CameraPlan, CounterPlan, Plan};
use hifitime::Epoch;
use std::collections::HashMap;
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use sunglint_drivers::clock::{Clock as _, Deadline, DeviceClock, VirtualClock};
use sunglint_drivers::device::{
    Camera, Device, DeviceError, Identity, Interrupted, Limits, PhotonCounter, Setting, Value,
    Window,
};
use sunglint_formats::Frame;
use sunglint_formats::time::format_utc;

/// In messages.
const DEVICE: &str = "recording";
/// Behind the end of every recording.
const END: Duration = Duration::from_secs(100 * 365 * 86_400);
/// Cards with which a grabber counts frames that were lost, or that repeat the one before.
const LOST: [(&str, &str); 2] = [("GRABLOST", "lost"), ("GRABDUBL", "doubled")];
/// A frame of another exposure than the plan says is not the plan's: beyond this part of it.
const EXPOSURE: f64 = 1e-6;

/// The opener of a night whose cameras are recordings. A camera that is opened again goes on where it was.
#[derive(Debug)]
pub struct Films {
    start: Epoch,
    reels: HashMap<String, Reel>,
}

#[derive(Debug, Clone, Default)]
struct Reel {
    clock: VirtualClock,
    camera: Arc<Mutex<Option<Opened>>>,
}

/// The driver's camera.
struct Opened {
    camera: Box<dyn Camera>,
    /// Frames that were lost and doubled, as far as it was said.
    said: [i64; 2],
    /// A frame before which that had to be said.
    kept: Option<Frame>,
}

impl std::fmt::Debug for Opened {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Opened")
    }
}

impl Films {
    /// The recordings that a plan names as its cameras; its clocks begin when the plan does.
    pub fn new(plan: &Plan) -> Self {
        let reels = plan.cameras.iter().map(|camera| (camera.name.clone(), Reel::default()));
        Self { start: plan.from, reels: reels.collect() }
    }

    /// When a night without an end of its own ends: never, but a camera's clock jumps there once its recording is over.
    pub(super) fn end(start: Epoch) -> Epoch {
        start + hifitime::Duration::from_seconds(0.5 * END.as_secs_f64())
    }
}

impl Opener for Films {
    fn clock(&self, device: &str) -> DeviceClock {
        let clock = self.reels.get(device).map(|reel| reel.clock.clone()).unwrap_or_default();
        DeviceClock { clock: Arc::new(clock), zero_utc: Some(self.start) }
    }

    fn camera(
        &self,
        plan: &CameraPlan,
        deadline: &Deadline,
    ) -> Result<Box<dyn Camera>, DeviceError> {
        let reel = self.reels.get(&plan.name).cloned().unwrap_or_default();
        let film = Film { start: self.start, reel };
        let mut camera = film.camera();
        if camera.is_none() {
            let opened = Catalogue.camera(plan, deadline)?;
            *camera = Some(Opened { camera: opened, said: [0; 2], kept: None });
        }
        drop(camera);
        Ok(Box::new(film))
    }

    fn counter(
        &self,
        plan: &CounterPlan,
        _: &Deadline,
    ) -> Result<Box<dyn PhotonCounter>, DeviceError> {
        let known = "a camera: a night of recordings has no counters".to_owned();
        Err(DeviceError::Unknown { name: "device", asked: plan.device.clone(), known })
    }
}

/// A recording as a camera.
struct Film {
    start: Epoch,
    reel: Reel,
}

impl Film {
    fn camera(&self) -> MutexGuard<'_, Option<Opened>> {
        self.reel.camera.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn with<V>(
        &self,
        act: impl FnOnce(&mut dyn Camera) -> Result<V, DeviceError>,
    ) -> Result<V, DeviceError> {
        match self.camera().as_mut() {
            Some(opened) => act(opened.camera.as_mut()),
            None => Err(DeviceError::NotReady { device: DEVICE, reason: "it is not open" }),
        }
    }

    /// Tells once what is missing before a frame, and keeps that for the next call.
    fn complete(&self, frame: Frame) -> Result<Frame, DeviceError> {
        let mut camera = self.camera();
        let Some(opened) = camera.as_mut() else { return Ok(frame) };
        let counts = LOST.map(|(card, _)| frame.header.integer(card).unwrap_or(0));
        if counts.into_iter().zip(opened.said).all(|(count, said)| count <= said) {
            return Ok(frame);
        }
        let (start, before) = (format_utc(frame.start, 3), opened.said);
        (opened.said, opened.kept) = (counts, Some(frame));
        let what: Vec<String> = (0..LOST.len())
            .filter(|&i| counts[i] > before[i])
            .map(|i| format!("{} {} ({} so far)", counts[i] - before[i], LOST[i].1, counts[i]))
            .collect();
        let what = format!("frames of the recording before {start}: {}", what.join(", "));
        Err(DeviceError::NotOurs { device: DEVICE, what })
    }

    /// The next frame; `None` at the end.
    fn next(&self, exposure_s: f64, deadline: &Deadline) -> Result<Option<Frame>, DeviceError> {
        if let Some(kept) = self.camera().as_mut().and_then(|opened| opened.kept.take()) {
            return Ok(Some(kept));
        }
        self.with(|camera| {
            let mut next = None;
            let mut take = |frame: Frame| {
                next = Some(frame);
                ControlFlow::Break(())
            };
            let taken = camera.stream(exposure_s, &mut take, deadline);
            taken.map_err(|interrupted: Interrupted<u64>| *interrupted.error)?;
            Ok(next)
        })
    }

    /// Moves the clock to a time, where that lies ahead.
    fn wait_until(&self, then: Epoch) {
        let clock =
            DeviceClock { clock: Arc::new(self.reel.clock.clone()), zero_utc: Some(self.start) };
        self.reel.clock.sleep(clock.until(then));
    }
}

impl Device for Film {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        self.with(|camera| camera.identity(deadline))
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        self.with(|camera| camera.settings(deadline))
    }

    fn own_settings(&self) -> &'static [(&'static str, &'static str)] {
        self.camera().as_ref().map_or(&[], |camera| camera.camera.own_settings())
    }

    fn set_own(&mut self, name: &str, value: &str, d: &Deadline) -> Result<Value, DeviceError> {
        self.with(|camera| camera.set_own(name, value, d))
    }
}

impl Camera for Film {
    fn sensor_px(&self) -> [u32; 2] {
        self.camera().as_ref().map_or([0, 0], |camera| camera.camera.sensor_px())
    }

    fn limits(&self) -> Option<Limits> {
        self.camera().as_ref().and_then(|camera| camera.camera.limits())
    }

    fn set_window(&mut self, window: Window, d: &Deadline) -> Result<Window, DeviceError> {
        self.with(|camera| camera.set_window(window, d))
    }

    fn set_gain(&mut self, gain: f64, d: &Deadline) -> Result<f64, DeviceError> {
        self.with(|camera| camera.set_gain(gain, d))
    }

    fn set_temperature_c(&mut self, celsius: f64, d: &Deadline) -> Result<f64, DeviceError> {
        self.with(|camera| camera.set_temperature_c(celsius, d))
    }

    fn expose(&mut self, exposure_s: f64, deadline: &Deadline) -> Result<Frame, DeviceError> {
        let next = self
            .next(exposure_s, deadline)
            .map_err(|error| DeviceError::Damaged { device: DEVICE, reason: error.to_string() })?;
        let Some(frame) = next else {
            self.reel.clock.sleep(END);
            return Err(DeviceError::NotReady { device: DEVICE, reason: "it is over" });
        };
        let frame = self.complete(frame)?;
        self.wait_until(frame.start + hifitime::Duration::from_seconds(frame.exposure_s));
        if (frame.exposure_s - exposure_s).abs() > EXPOSURE * exposure_s {
            let what = format!(
                "it was exposed {} s by its recording, {exposure_s} s by the plan",
                frame.exposure_s
            );
            return Err(DeviceError::NotOurs { device: DEVICE, what });
        }
        Ok(frame)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]
mod tests {
    use super::*;
    use ndarray::Array2;
    use sunglint_formats::fits::Header;
    use sunglint_formats::time::parse_utc;

    fn first() -> Epoch {
        parse_utc("2026-11-24T21:00:00Z").unwrap()
    }

    /// Frames of 20 ms, each with the counts of lost and doubled ones that it says.
    struct Counted(std::vec::IntoIter<(f64, [i64; 2])>);

    impl Device for Counted {
        fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
            Err(DeviceError::NotReady { device: DEVICE, reason: "not tried" })
        }

        fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
            Ok(Vec::new())
        }
    }

    impl Camera for Counted {
        fn sensor_px(&self) -> [u32; 2] {
            [1, 1]
        }

        fn set_window(&mut self, window: Window, _: &Deadline) -> Result<Window, DeviceError> {
            Ok(window)
        }

        fn set_gain(&mut self, gain: f64, _: &Deadline) -> Result<f64, DeviceError> {
            Ok(gain)
        }

        fn set_temperature_c(&mut self, celsius: f64, _: &Deadline) -> Result<f64, DeviceError> {
            Ok(celsius)
        }

        fn expose(&mut self, exposure_s: f64, _: &Deadline) -> Result<Frame, DeviceError> {
            let over = DeviceError::NotReady { device: DEVICE, reason: "over" };
            let (since_s, counts) = self.0.next().ok_or(over)?;
            let mut header = Header::default();
            for ((card, _), count) in LOST.into_iter().zip(counts) {
                if count > 0 {
                    header.set(card, count, "");
                }
            }
            Ok(Frame {
                pixels: Array2::zeros((1, 1)),
                origin: [0, 0],
                binning: [1, 1],
                bayer: None,
                start: first() + hifitime::Duration::from_seconds(since_s),
                exposure_s,
                gain_e_per_adu: None,
                temperature_c: None,
                saturation_adu: None,
                header,
            })
        }

        fn stream(
            &mut self,
            exposure_s: f64,
            take: &mut dyn FnMut(Frame) -> ControlFlow<()>,
            deadline: &Deadline,
        ) -> Result<u64, Interrupted<u64>> {
            let frame = self.expose(exposure_s, deadline);
            let _ = take(frame.map_err(|error| Interrupted::new(0, error))?);
            Ok(1)
        }
    }

    /// What is missing before a frame is said once, with the number of frames, and no frame is lost by that: all three come.
    #[test]
    fn frames_that_a_recording_lacks_are_said_once() {
        let frames = vec![(0.0, [0, 0]), (0.1, [3, 0]), (0.2, [3, 1])].into_iter();
        let reel = Reel::default();
        let opened = Opened { camera: Box::new(Counted(frames)), said: [0; 2], kept: None };
        *reel.camera.lock().unwrap() = Some(opened);
        let mut film = Film { start: first(), reel };
        let mut next = || {
            let frame = film.expose(0.02, &Deadline::within(Duration::from_secs(5)));
            let since_ms = |frame: Frame| (1e3 * (frame.start - first()).to_seconds()).round();
            frame.map(since_ms).map_err(|e| e.to_string())
        };
        let start =
            "recording: the frame is not ours: frames of the recording before 2026-11-24T21:00:00";
        assert_eq!(next(), Ok(0.0));
        assert_eq!(next(), Err(format!("{start}.100Z: 3 lost (3 so far)")));
        assert_eq!(next(), Ok(100.0));
        assert_eq!(next(), Err(format!("{start}.200Z: 1 doubled (1 so far)")));
        assert_eq!(next(), Ok(200.0));
    }
}
