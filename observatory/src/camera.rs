//! A camera's thread: frames from start to start, whatever else happens.

use super::plan::CameraPlan;
use super::pointing::Pointing;
use super::worker::{READY, SOON, Worker};
use hifitime::Epoch;
use std::time::Duration;
use sunglint_drivers::device::{Camera, DeviceError, Window};
use sunglint_formats::Frame;
use sunglint_formats::session::FRAME_NUMBER;
use sunglint_formats::toml::Positive;

/// How much longer than its exposure a frame may take.
const FRAME: Duration = Duration::from_secs(30);

/// A camera at work.
#[derive(Debug)]
pub struct CameraWork {
    plan: CameraPlan,
    pointing: Pointing,
    /// The last frame's number.
    number: u64,
}

impl CameraWork {
    /// A camera as planned.
    pub fn new(plan: CameraPlan, pointing: Pointing) -> Self {
        Self { plan, pointing, number: 0 }
    }

    /// Opens the camera and takes frames until the night is over.
    pub fn run(&mut self, worker: &mut Worker) -> Result<(), DeviceError> {
        let mut camera = worker.opener.camera(&self.plan, &worker.within(READY))?;
        self.prepare(camera.as_mut(), worker)?;
        worker.opened(camera.as_mut())?;
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
            let most = FRAME.saturating_add(seconds(exposure_s));
            let frame = camera.expose(exposure_s, &worker.within(most))?;
            if begun.is_none() || worker.lost_at.is_some() {
                worker.works();
            }
            begun.get_or_insert(0);
            self.hand_over(frame, worker);
        }
        Ok(())
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
            if let Some(filter) = &self.plan.filter {
                frame.header.set("FILTER", filter.as_str(), "");
            }
            self.pointing.describe(worker.schedule.at(middle), middle, &mut frame.header);
        }
        worker.status.frame(&worker.name, self.number, &frame);
        worker.reached(frame.start + half * 2);
        worker.disk.frame(&worker.name, self.number, frame);
    }
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
