//! How a stage moves, finds its reference, and is stopped.

use super::DEVICE;
use super::link::protocol;
use super::message::{Id, Message, State, StateBits};
use super::stage::Stage;
use crate::clock::Deadline;
use crate::device::{DeviceError, Interrupted, Side};
use crate::transport::Bytes;

/// The kind of stop: at once.
const AT_ONCE: u8 = 1;

impl<T: Bytes> Stage<T> {
    /// An answer that comes twice the same.
    pub(super) fn twice(
        &mut self,
        question: Id,
        answer: Id,
        deadline: &Deadline,
    ) -> Result<Message, DeviceError> {
        let mut last = self.link.ask(question, answer, deadline)?;
        for _ in 0..3 {
            let next = self.link.ask(question, answer, deadline)?;
            if next == last {
                return Ok(next);
            }
            last = next;
        }
        Err(protocol(format!("{last} reads differently each time")))
    }

    fn state(&mut self, deadline: &Deadline) -> Result<State, DeviceError> {
        let (question, answer) = match self.servo {
            true => (Id::RequestServoStatus, Id::ServoStatus),
            false => (Id::RequestStatus, Id::Status),
        };
        let message = self.link.ask(question, answer, deadline)?;
        State::of(&message).ok_or_else(|| protocol(format!("{message} without a state")))
    }

    /// The state, read until two readings in a row agree, or are as far apart as a servo may hunt.
    pub(super) fn steady(&mut self, deadline: &Deadline) -> Result<State, DeviceError> {
        const MATTERS: u32 = StateBits::MOVING | StateBits::HOMING | StateBits::HOMED;
        let tolerance = self.tolerance;
        let mut last = self.state(deadline)?;
        let (mut moving, mut standing) = (0, 0);
        while standing < 4 {
            let next = self.state(deadline)?;
            let same = next.counter.abs_diff(last.counter) <= tolerance
                && next.bits.0 & MATTERS == last.bits.0 & MATTERS;
            if same {
                return Ok(next);
            }
            (moving, standing) = match next.bits.is_moving() {
                true => (moving + 1, 0),
                false => (0, standing + 1),
            };
            // It turns, and the last reading is as good as any.
            if moving >= 3 {
                return Ok(next);
            }
            last = next;
        }
        Err(protocol("its counter reads differently each time though it stands".into()))
    }

    /// Whether angles mean something: the controller forgets its reference with its power.
    pub(super) fn require_reference(&self, state: State) -> Result<(), DeviceError> {
        if self.trusted || state.bits.any(StateBits::HOMED) {
            return Ok(());
        }
        let reason = "its angle is not known yet (it was not homed since it was switched on): home it (or trust its counter) first";
        Err(DeviceError::NotReady { device: DEVICE, reason })
    }

    /// The counter's value for an angle, of a stage that may be sent there.
    pub(super) fn target(
        &mut self,
        angle_deg: f64,
        deadline: &Deadline,
    ) -> Result<i32, DeviceError> {
        let target = self.scale().counter(angle_deg)?;
        let state = self.steady(deadline)?;
        self.require_reference(state)?;
        Ok(target)
    }

    fn pause(&self, action: &'static str, deadline: &Deadline) -> Result<(), DeviceError> {
        let slept = deadline.sleep(self.settings.poll);
        slept.map_err(|expired| DeviceError::expired(DEVICE, action, expired))
    }

    /// Goes to a value of the counter, waits until it stands there, and gives where it stands.
    pub(super) fn go(&mut self, target: i32, deadline: &Deadline) -> Result<i32, DeviceError> {
        let go = self.link.long(Id::MoveAbsolute, &target.to_le_bytes());
        self.link.tell(&go, deadline)?;
        let mut last = None;
        let mut moved = deadline.now();
        loop {
            // Twice the same: one message alone may be spoilt.
            let state = self.steady(deadline)?;
            let near = state.counter.abs_diff(target) <= self.tolerance;
            if near && !state.bits.is_moving() {
                return self.rest(target, deadline);
            }
            let now = deadline.now();
            if state.bits.is_moving() || last != Some(state.counter) {
                moved = now;
            } else if now.saturating_sub(moved) >= self.settings.stall_after {
                return Err(self.stuck(state, target));
            }
            last = Some(state.counter);
            self.pause("the move", deadline)?;
        }
    }

    /// Looks once more that it stands, and has not lost its reference on the way.
    fn rest(&mut self, target: i32, deadline: &Deadline) -> Result<i32, DeviceError> {
        let state = self.steady(deadline)?;
        self.require_reference(state)?;
        if state.counter.abs_diff(target) > self.tolerance {
            return Err(self.stuck(state, target));
        }
        Ok(state.counter)
    }

    /// Why it stands short of its target.
    fn stuck(&self, state: State, target: i32) -> DeviceError {
        let (at_deg, target_deg) = (self.scale().angle(state.counter), self.scale().angle(target));
        let forward = state.counter < target;
        let (bit, side) = match forward {
            true => (StateBits::FORWARD_LIMIT, Side::Right),
            false => (StateBits::REVERSE_LIMIT, Side::Left),
        };
        match state.bits.any(bit) {
            true => DeviceError::LimitHit { device: DEVICE, side, at_deg, target_deg },
            false => DeviceError::Stalled { device: DEVICE, at_deg, target_deg },
        }
    }

    /// Searches the reference and gives the counter at which it stands then. A search counts if it was seen to run (or told to
    /// have ended), and the stage says then that it is homed, stands, and is at zero.
    pub(super) fn search(&mut self, deadline: &Deadline) -> Result<i32, DeviceError> {
        self.link.take_homed();
        let home = self.link.short(Id::Home, 0);
        self.link.tell(&home, deadline)?;
        let begun = deadline.now();
        let mut ran = false;
        loop {
            let state = self.steady(deadline)?;
            ran |= state.bits.is_moving() || self.link.take_homed();
            let done = state.bits.any(StateBits::HOMED) && !state.bits.is_moving();
            if ran && done {
                break;
            }
            let waited = deadline.now().saturating_sub(begun);
            if !state.bits.is_moving() && waited >= self.settings.stall_after {
                let what = if ran { "end" } else { "begin" };
                return Err(protocol(format!(
                    "its reference search did not {what}: is the channel on, and the switch free?"
                )));
            }
            self.pause("the reference search", deadline)?;
        }
        let state = self.steady(deadline)?;
        // Half a degree: the search itself sets the counter to zero.
        let off_deg = f64::from(state.counter) / self.scale().counts_per_deg;
        if off_deg.abs() > 0.5 {
            return Err(protocol(format!(
                "its reference search ended {off_deg:.4} deg from zero, expected at most 0.5 deg"
            )));
        }
        Ok(state.counter)
    }

    /// Ends search and motion, waits for standstill, and gives the state there.
    pub(super) fn halt(&mut self, deadline: &Deadline) -> Result<State, DeviceError> {
        let stop = self.link.short(Id::StopMove, AT_ONCE);
        loop {
            // Again and again: a stop that the line swallowed must not be the last one.
            self.link.tell(&stop, deadline)?;
            let state = self.steady(deadline)?;
            if !state.bits.is_moving() {
                return Ok(state);
            }
            self.pause("stopping", deadline)?;
        }
    }

    /// Stops after `error` and says where it stands.
    pub(super) fn stopped_by(
        &mut self,
        error: DeviceError,
        deadline: &Deadline,
    ) -> Interrupted<Option<f64>> {
        let grace = deadline.grace(self.settings.stop_within);
        let stopped = self.halt(&grace).map(|state| {
            self.require_reference(state).is_ok().then(|| self.scale().angle(state.counter))
        });
        Interrupted::stopped(DEVICE, error, stopped)
    }
}
