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

/// In messages.
const DEVICE: &str = "recording";
/// Behind the end of every recording.
const END: Duration = Duration::from_secs(100 * 365 * 86_400);
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
struct Opened(Box<dyn Camera>);

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
            *camera = Some(Opened(Catalogue.camera(plan, deadline)?));
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
            Some(camera) => act(camera.0.as_mut()),
            None => Err(DeviceError::NotReady { device: DEVICE, reason: "it is not open" }),
        }
    }

    /// The next frame; `None` at the end.
    fn next(&self, exposure_s: f64, deadline: &Deadline) -> Result<Option<Frame>, DeviceError> {
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
        self.camera().as_ref().map_or(&[], |camera| camera.0.own_settings())
    }

    fn set_own(&mut self, name: &str, value: &str, d: &Deadline) -> Result<Value, DeviceError> {
        self.with(|camera| camera.set_own(name, value, d))
    }
}

impl Camera for Film {
    fn sensor_px(&self) -> [u32; 2] {
        self.camera().as_ref().map_or([0, 0], |camera| camera.0.sensor_px())
    }

    fn limits(&self) -> Option<Limits> {
        self.camera().as_ref().and_then(|camera| camera.0.limits())
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
