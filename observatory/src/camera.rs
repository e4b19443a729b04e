//! A camera's thread: frames from start to start, whatever else happens.

use super::plan::CameraPlan;
use super::pointing::Pointing;
use super::worker::{READY, SOON, Worker};
use hifitime::Epoch;
use std::time::Duration;
use sunglint_drivers::clock::clock_offset_s;
use sunglint_drivers::device::{Camera, DeviceError, Window};
use sunglint_formats::Frame;
use sunglint_formats::session::{FRAME_NUMBER, TargetKind, What};
use sunglint_formats::toml::Positive;

/// How much longer than its exposure and the longest readout so far a frame may take.
const LATE: Duration = Duration::from_secs(5);
/// Readout of a camera that has given no frame.
const READOUT: Duration = Duration::from_secs(10);
/// A difference between clocks that is no step, s.
const STEP_S: f64 = super::clock::STEP_S;

/// A camera at work.
#[derive(Debug)]
pub struct CameraWork {
    plan: CameraPlan,
    pointing: Pointing,
    /// The last frame's number.
    number: u64,
    /// The longest time from the end of an exposure to its frame so far.
    readout: Option<Duration>,
    /// The frame type that the camera was told.
    told: Option<&'static str>,
}

impl CameraWork {
    /// A camera as planned.
    pub fn new(plan: CameraPlan, pointing: Pointing) -> Self {
        Self { plan, pointing, number: 0, readout: None, told: None }
    }

    /// Opens the camera and takes frames until the night is over.
    pub fn run(&mut self, worker: &mut Worker) -> Result<(), DeviceError> {
        let mut camera = worker.opener.camera(&self.plan, &worker.within(READY))?;
        self.prepare(camera.as_mut(), worker).map_err(|error| worker.setting(error))?;
        worker.opened(camera.as_mut())?;
        self.told = None;
        let first = worker.clock.clock.now();
        let mut begun = None;
        while !worker.is_over() {
            if let Some(interval) = self.plan.interval_s.map(Positive::get) {
                wait_for_turn(worker, first, interval, &mut begun)?;
                if worker.is_over() {
                    break;
                }
            }
            let exposure_s = self.plan.exposure_s.get();
            self.tell_type(camera.as_mut(), worker)?;
            let readout = self.readout.unwrap_or(READOUT);
            let most = seconds(exposure_s).saturating_add(readout).saturating_add(LATE);
            let (asked, asked_at) = (worker.clock.utc(), worker.clock.clock.now());
            let mut frame = match camera.expose(exposure_s, &worker.within(most)) {
                Err(error @ DeviceError::NotOurs { .. }) => {
                    self.refuse(&error.to_string(), worker);
                    // Whoever took it may have set it, too.
                    self.prepare(camera.as_mut(), worker).map_err(|error| worker.setting(error))?;
                    self.told = None;
                    continue;
                }
                taken => taken?,
            };
            let took = worker.clock.clock.now().saturating_sub(asked_at);
            let late = took.saturating_sub(seconds(exposure_s));
            self.readout = Some(self.readout.map_or(late, |longest| longest.max(late)));
            if worker.clock.is_live() {
                without_step(&mut frame, asked, clock_offset_s());
            }
            if begun.is_none() || worker.lost_at.is_some() {
                worker.works();
            }
            begun.get_or_insert(0);
            self.hand_over(frame, worker);
        }
        Ok(())
    }

    /// Tells the camera what the next frame is taken for, so that its driver closes the shutter for a dark one.
    fn tell_type(
        &mut self,
        camera: &mut dyn Camera,
        worker: &mut Worker,
    ) -> Result<(), DeviceError> {
        const NAME: &str = "frame_type";
        let schedule = worker.schedule.get();
        let target = schedule.at(worker.clock.utc());
        let dark = target.is_some_and(|target| target.target_kind == TargetKind::Dark);
        let wanted = if dark { "dark" } else { "light" };
        if self.told == Some(wanted) || !camera.own_settings().iter().any(|(n, _)| *n == NAME) {
            return Ok(());
        }
        camera.set_own(NAME, wanted, &worker.within(SOON))?;
        self.told = Some(wanted);
        Ok(())
    }

    /// A frame that is not what was asked for: counted, and told now and then.
    fn refuse(&self, error: &str, worker: &Worker) {
        let frames = worker.status.refused(&worker.name, error);
        if frames <= 16 || frames.is_power_of_two() {
            let (device, error) = (worker.name.clone(), error.to_owned());
            let what = What::FramesRefused { device, frames, error };
            worker.disk.event(worker.clock.utc(), what);
        }
    }

    fn prepare(&self, camera: &mut dyn Camera, worker: &Worker) -> Result<(), DeviceError> {
        let plan = &self.plan;
        if let Some([x, y, columns, rows]) = plan.window_px {
            let binning = [plan.binning.unwrap_or(1); 2];
            let window = Window { origin_px: [x, y], size_px: [columns, rows], binning };
            camera.set_window(window, &worker.within(SOON))?;
        }
        if let Some(gain) = plan.gain {
            camera.set_gain(gain.get(), &worker.within(SOON))?;
        }
        if let Some(temperature) = plan.temperature_c {
            camera.set_temperature_c(temperature.get(), &worker.within(SOON))?;
        }
        Ok(())
    }

    /// Puts the filter, the cooler's and the converter's settings into a header: as the device says them, else as planned.
    fn say_settings(&self, frame: &mut Frame) {
        if let Some(planned) = &self.plan.filter {
            match frame.header.text("FILTER").map(str::to_owned) {
                Some(wheel) if wheel.trim() == planned => {}
                Some(_) => frame.header.set(
                    "FILTPLAN",
                    planned.as_str(),
                    "planned; the wheel stood at FILTER",
                ),
                None => {
                    frame.header.set("FILTER", planned.as_str(), "as planned; no wheel said it")
                }
            }
        }
        if let Some(temperature) = self.plan.temperature_c {
            frame.header.set("SET-TEMP", temperature.get(), "deg C, asked of the cooler");
        }
        if let Some(gain) = self.plan.gain.filter(|_| frame.header.get("GAIN").is_none()) {
            frame.header.set("GAIN", gain.get(), "in the camera's own steps");
        }
        // In another gain the station's number says nothing.
        if frame.gain_e_per_adu.is_none() && self.plan.gain.is_none() {
            frame.gain_e_per_adu = self.pointing.gain_e_per_adu();
        }
    }

    fn hand_over(&mut self, mut frame: Frame, worker: &Worker) {
        let half = hifitime::Duration::from_seconds(0.5 * frame.exposure_s);
        let middle: Epoch = frame.start + half;
        if worker.opener.keeps_numbers() {
            let number = frame.header.integer(FRAME_NUMBER).and_then(|n| u64::try_from(n).ok());
            self.number = number.unwrap_or(self.number + 1).max(self.number + 1);
        } else {
            self.number += 1;
            frame.header.set(
                "CAMERA",
                self.plan.name.as_str(),
                "the camera's name in this session",
            );
            self.say_settings(&mut frame);
            let schedule = worker.schedule.get();
            self.pointing.describe(schedule.at(middle), middle, self.told, &mut frame);
        }
        worker.status.frame(&worker.name, self.number, &frame);
        worker.reached(frame.start + half * 2);
        worker.disk.frame(&worker.name, self.number, frame);
    }
}

/// Takes a step of the computer's clock, s, out of a frame's time: its driver stamps with that clock. Of a driver on another computer,
/// whose clock did not step, the time is left. The header says it.
fn without_step(frame: &mut Frame, asked: Epoch, step_s: f64) {
    let ahead_s = (frame.start - asked).to_seconds();
    if step_s.abs() <= STEP_S || (ahead_s - step_s).abs() >= ahead_s.abs() {
        return;
    }
    frame.start -= hifitime::Duration::from_seconds(step_s);
    let comment = "s, step of the driver's clock, taken off DATE-OBS";
    frame.header.set("CLKSTEP", step_s, comment);
}

/// Waits for the next frame's turn on a grid of `interval_s` from `first`; turns that have passed are left out.
fn wait_for_turn(
    worker: &Worker,
    first: Duration,
    interval_s: f64,
    begun: &mut Option<u64>,
) -> Result<(), DeviceError> {
    let Some(turn) = *begun else {
        *begun = None;
        return Ok(());
    };
    let passed_s = worker.clock.clock.now().saturating_sub(first).as_secs_f64();
    // A turn that is a thousandth late is still this one.
    let next = (turn + 1).max((passed_s / interval_s - 1e-3).ceil() as u64);
    let at = first.saturating_add(seconds(next as f64 * interval_s));
    let mut wait = at.saturating_sub(worker.clock.clock.now());
    if let Some(end) = worker.end {
        wait = wait.min(worker.clock.until(end));
    }
    *begun = Some(next);
    // Cut short by Ctrl-C alone, which the caller sees.
    let _ = worker.within(Duration::MAX).sleep(wait);
    Ok(())
}

/// Seconds that a plan gives: above zero.
pub(crate) fn seconds(s: f64) -> Duration {
    Duration::try_from_secs_f64(s).unwrap_or(Duration::MAX)
}
