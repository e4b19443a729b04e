//! How a stage moves, finds its reference, and is stopped.

use super::DEVICE;
use super::stage::{Approach, Stage};
use super::tmcl::{Axis, Command};
use crate::clock::Deadline;
use crate::device::{DeviceError, Interrupted, Side};
use crate::transport::Bytes;

/// Kinds of the reference search command.
const START: u8 = 0;
const STOP: u8 = 1;
const IS_RUNNING: u8 = 2;
/// The kind of an absolute move.
const ABSOLUTE: u8 = 0;

impl<T: Bytes> Stage<T> {
    /// Whether angles mean something: the counter's zero is the reference, and the module has not forgotten it since.
    pub(super) fn require_reference(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        if !self.referenced {
            let reason = "its angle is not known yet: home it (or trust its counter) first";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        // A module that lost its power comes back with counter and target at 0.
        if let Some(commanded) = self.commanded
            && self.get(Axis::TargetPosition, deadline)? != commanded
        {
            self.referenced = false;
            self.commanded = None;
            let reason = "it has forgotten where it was sent (power lost, or another program moved it): home it again";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        Ok(())
    }

    /// The counter, read until two readings agree: the sum of eight bits lets through one in 256 of what the line spoils
    /// in more than one place.
    pub(super) fn steady_counter(&mut self, deadline: &Deadline) -> Result<i32, DeviceError> {
        let mut last = self.get(Axis::ActualPosition, deadline)?;
        for _ in 0..3 {
            let next = self.get(Axis::ActualPosition, deadline)?;
            if next == last {
                return Ok(next);
            }
            last = next;
        }
        // Four readings that all differ: it turns, and the last is as good as any.
        match self.get(Axis::ActualSpeed, deadline)? {
            0 => {
                let reason = "its counter reads differently each time though it stands".to_owned();
                Err(DeviceError::Protocol { device: DEVICE, reason })
            }
            _ => Ok(last),
        }
    }

    pub(super) fn stalled(&self, counter: i32, target: i32) -> DeviceError {
        let (at_deg, target_deg) = (self.scale().angle(counter), self.scale().angle(target));
        DeviceError::Stalled { device: DEVICE, at_deg, target_deg }
    }

    /// The counter's values to visit, the target last.
    pub(super) fn plan(
        &mut self,
        angle_deg: f64,
        deadline: &Deadline,
    ) -> Result<Vec<i32>, DeviceError> {
        let target = self.scale().counter(angle_deg)?;
        self.require_reference(deadline)?;
        let start_deg = match self.settings.approach {
            Approach::Direct => return Ok(vec![target]),
            Approach::FromBelow { by_deg } => angle_deg - by_deg,
            Approach::FromAbove { by_deg } => angle_deg + by_deg,
        };
        // The start of the approach obeys the limits too: a target nearer to them cannot be approached.
        let start = self.scale().counter(start_deg)?;
        let at = self.steady_counter(deadline)?;
        let upward = i64::from(target) - i64::from(start);
        let way = i64::from(target) - i64::from(at);
        let right_side = way.signum() == upward.signum() && way.abs() >= upward.abs();
        let goes_on = self.taken_up && (way == 0 || way.signum() == upward.signum());
        Ok(if right_side || goes_on { vec![target] } else { vec![start, target] })
    }

    /// Goes to a value of the counter and waits until it is there.
    pub(super) fn go(&mut self, target: i32, deadline: &Deadline) -> Result<(), DeviceError> {
        let motor = self.settings.motor;
        self.commanded = None;
        self.taken_up = false;
        self.link.ask(Command::Move, ABSOLUTE, motor, target, deadline)?;
        let taken = self.get(Axis::TargetPosition, deadline)?;
        if taken != target {
            let (asked, got) = (target.to_string(), taken.to_string());
            let name = "target_position";
            return Err(DeviceError::NotTaken { device: DEVICE, name, asked, got });
        }
        let mut last = None;
        let mut moved = deadline.now();
        loop {
            let at = self.get(Axis::ActualPosition, deadline)?;
            if at == target && self.get(Axis::PositionReached, deadline)? != 0 {
                self.commanded = Some(target);
                return Ok(());
            }
            let now = deadline.now();
            if last != Some(at) {
                last = Some(at);
                moved = now;
            } else if at != target && self.get(Axis::ActualSpeed, deadline)? == 0 {
                if let Some(side) = self.pressed(at < target, deadline)? {
                    let (at_deg, target_deg) = (self.scale().angle(at), self.scale().angle(target));
                    return Err(DeviceError::LimitHit { device: DEVICE, side, at_deg, target_deg });
                }
                if now.saturating_sub(moved) >= self.settings.stall_after {
                    return Err(self.stalled(at, target));
                }
            }
            self.pause("the move", deadline)?;
        }
    }

    fn pause(&self, action: &'static str, deadline: &Deadline) -> Result<(), DeviceError> {
        deadline
            .sleep(self.settings.poll)
            .map_err(|expired| DeviceError::expired(DEVICE, action, expired))
    }

    /// The switch that stops a motor on its way to the right (or left), if it is pressed.
    fn pressed(&mut self, right: bool, deadline: &Deadline) -> Result<Option<Side>, DeviceError> {
        let (axis, side, stops) = match right {
            true => (Axis::RightLimit, Side::Right, self.switches[0]),
            false => (Axis::LeftLimit, Side::Left, self.switches[1]),
        };
        Ok(if stops && self.get(axis, deadline)? != 0 { Some(side) } else { None })
    }

    /// Searches the reference and gives the counter at which it stands then.
    pub(super) fn search(&mut self, deadline: &Deadline) -> Result<i32, DeviceError> {
        let Some(search) = self.settings.search else {
            let reason =
                "no reference search is configured: name its mode and speeds, or trust its counter";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        };
        let motor = self.settings.motor;
        self.referenced = false;
        self.commanded = None;
        self.taken_up = false;
        self.set(Axis::SearchMode, "reference_search_mode", search.mode, deadline)?;
        self.set(Axis::SearchSpeed, "reference_search_speed", search.speed, deadline)?;
        self.set(Axis::SwitchSpeed, "reference_switch_speed", search.switch_speed, deadline)?;
        self.link.ask(Command::Search, START, motor, 0, deadline)?;
        let running =
            |this: &mut Self| this.link.ask(Command::Search, IS_RUNNING, motor, 0, deadline);
        // "Not running" is also what a module says that never began, or that was reset.
        if running(self)? == 0 {
            let reason = "its reference search did not begin".to_owned();
            return Err(DeviceError::Protocol { device: DEVICE, reason });
        }
        while running(self)? != 0 {
            self.pause("the reference search", deadline)?;
        }
        let mut at = self.steady_counter(deadline)?;
        while self.get(Axis::ActualSpeed, deadline)? != 0 {
            self.pause("the reference search", deadline)?;
            at = self.steady_counter(deadline)?;
        }
        let off_deg = f64::from(at) / self.microsteps_per_deg();
        if off_deg.abs() > search.tolerance_deg {
            let reason = format!(
                "its reference search ended {off_deg:.4} deg from zero, expected at most {} deg: was it stopped, or does this mode not set zero?",
                search.tolerance_deg
            );
            return Err(DeviceError::Protocol { device: DEVICE, reason });
        }
        self.referenced = true;
        Ok(at)
    }

    /// Ends search and motion, waits for standstill, and gives the counter there.
    pub(super) fn halt(&mut self, deadline: &Deadline) -> Result<i32, DeviceError> {
        let motor = self.settings.motor;
        self.commanded = None;
        self.taken_up = false;
        if self.settings.search.is_some() {
            self.link.ask(Command::Search, STOP, motor, 0, deadline)?;
        }
        self.link.ask(Command::Stop, 0, motor, 0, deadline)?;
        while self.get(Axis::ActualSpeed, deadline)? != 0 {
            self.pause("stopping", deadline)?;
        }
        self.steady_counter(deadline)
    }

    /// Stops after `error` and says where it stands.
    pub(super) fn stopped_by(
        &mut self,
        error: DeviceError,
        deadline: &Deadline,
    ) -> Interrupted<Option<f64>> {
        let grace = deadline.grace(self.settings.stop_within);
        let stopped = self.halt(&grace);
        let stopped = stopped.map(|counter| self.referenced.then(|| self.scale().angle(counter)));
        Interrupted::stopped(DEVICE, error, stopped)
    }
}
