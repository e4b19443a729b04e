//! One device on its own thread: opened, watched, and opened again after a failure.

use super::disk::Disk;
use super::opener::Opener;
use super::schedule::SharedSchedule;
use super::status::{State, Status};
use hifitime::Epoch;
use serde_json::{Value as Json, to_value};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock};
use sunglint_drivers::device::{Device, DeviceError};
use sunglint_formats::session::What;

/// How long opening a device may take, and an answer.
pub(crate) const READY: Duration = Duration::from_secs(30);
pub(crate) const SOON: Duration = Duration::from_secs(10);
/// How much longer than the night, or than what was begun in it, a call to a device may take.
const AFTER: Duration = Duration::from_millis(300);
/// The waits before a device is tried again: the first, and the longest.
const AGAIN: [Duration; 2] = [Duration::from_secs(1), Duration::from_secs(5)];

/// A device's thread: what it is told, and what it remembers.
#[derive(Debug, Clone)]
pub struct Worker {
    /// The device's name.
    pub name: String,
    /// Clock of the device.
    pub clock: DeviceClock,
    /// Where it comes from.
    pub opener: Arc<dyn Opener>,
    /// Set by Ctrl-C.
    pub cancel: Cancel,
    /// Where its data go.
    pub disk: Disk,
    /// Where the telescope looks.
    pub schedule: Arc<SharedSchedule>,
    /// When cameras begin; `None`: at once.
    pub from: Option<Epoch>,
    /// When the night ends; `None`: when it is stopped.
    pub end: Option<Epoch>,
    /// Where it says how it goes.
    pub status: Arc<Status>,
    /// When it was lost, on its own clock.
    pub lost_at: Option<Duration>,
    /// How long it is waited before the next try.
    pub again_in: Duration,
    /// Whether the last error will come again for ever.
    pub permanent: bool,
}

impl Worker {
    /// Whether the night is over, by the device's own time.
    pub fn is_over(&self) -> bool {
        self.cancel.is_cancelled()
            || self.schedule.is_over()
            || self.end.is_some_and(|end| self.clock.utc() >= end)
    }

    /// A deadline on the device's clock, which Ctrl-C and the night's end cut short.
    pub fn within(&self, time: Duration) -> Deadline {
        self.within_of(time, Duration::ZERO)
    }

    /// The same for what takes `busy` by itself, such as an exposure: that may end after the night.
    pub fn within_of(&self, time: Duration, busy: Duration) -> Deadline {
        let end = self.end.filter(|_| self.clock.is_live());
        let most = end.map_or(Duration::MAX, |end| self.clock.until(end).max(busy));
        let time = time.min(most.saturating_add(AFTER));
        Deadline::after(self.clock.clock.clone(), time).with_cancel(&self.cancel)
    }

    /// The same, for what is done in good order after Ctrl-C.
    pub fn even_so(&self, time: Duration) -> Deadline {
        Deadline::after(self.clock.clock.clone(), time)
    }

    /// Tells the status how far the device's time has come.
    pub fn reached(&self, utc: Epoch) {
        if !self.clock.is_live() {
            self.status.reached(utc);
        }
    }

    /// The device was opened: says who it is.
    pub fn opened(&mut self, device: &mut dyn Device) -> Result<(), DeviceError> {
        let identity = device.identity(&self.within(SOON))?;
        let settings = device.settings(&self.within(SOON))?;
        // Texts and numbers always have JSON.
        let Ok(Json::Object(identity)) = to_value(identity) else { return Ok(()) };
        let settings = settings
            .into_iter()
            .map(|s| (s.name.to_owned(), to_value(s.value).unwrap_or_default()))
            .collect();
        let utc = self.clock.utc();
        let device = self.name.clone();
        self.disk.event(utc, What::Device { device, identity, settings });
        Ok(())
    }

    /// The error of a setting, which may be one that comes again for ever.
    pub fn setting(&mut self, error: DeviceError) -> DeviceError {
        self.permanent |= error.is_permanent_setting();
        error
    }

    /// The device delivers: a failure before is over.
    pub fn works(&mut self) {
        self.again_in = AGAIN[0];
        if let Some(lost_at) = self.lost_at.take() {
            let after_s = (self.clock.clock.now().saturating_sub(lost_at)).as_secs_f64();
            let device = self.name.clone();
            self.disk.event(self.clock.utc(), What::DeviceBack { device, after_s });
        }
        self.status.set_state(&self.name, State::Running);
    }

    /// Runs `work` until the night is over: again after each failure, with a wait that doubles up to 5 s. A device that can
    /// never do what is asked ends there.
    pub fn supervise(mut self, mut work: impl FnMut(&mut Self) -> Result<(), DeviceError>) {
        self.again_in = AGAIN[0];
        while !self.is_over() {
            self.status.set_state(&self.name, State::Opening);
            let Err(error) = work(&mut self) else { break };
            if self.is_over() {
                break;
            }
            let now = self.clock.clock.now();
            self.lost_at.get_or_insert(now);
            let permanent = self.permanent || error.is_permanent();
            let error = error.to_string();
            if permanent {
                self.status.set_state(&self.name, State::Failed { error: error.clone() });
                let device = self.name.clone();
                self.disk.event(self.clock.utc(), What::DeviceFailed { device, error });
                return;
            }
            self.status.set_state(&self.name, State::Lost { error: error.clone() });
            let again_in_s = self.again_in.as_secs_f64();
            let device = self.name.clone();
            self.disk.event(self.clock.utc(), What::DeviceLost { device, error, again_in_s });
            let wait =
                self.end.map_or(self.again_in, |end| self.again_in.min(self.clock.until(end)));
            // Cut short by Ctrl-C alone.
            let _ = self.within(Duration::MAX).sleep(wait);
            self.again_in = (self.again_in * 2).min(AGAIN[1]);
            self.reached(self.clock.utc());
        }
        self.status.set_state(&self.name, State::Ended);
    }
}
