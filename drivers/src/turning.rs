//! Rotation stages on controllers that are sent to a target and asked where they are: the part that all their protocols
//! share.
//!
//! A protocol is an [`Axis`]: one reading, one command at a time. [`Turning`] makes a
//! [`RotationStage`] of it: it converts angles to counts, reads until two readings agree, waits for the end of a move by asking,
//! notices a stage that stands short of its target, and stops the motor after whatever goes wrong.

use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, Identity, Interrupted, Origin, RotationStage, Scale, Setting, Side, Value,
};
use std::time::Duration;
use sunglint_numerics::measured::Interval;

/// One reading of an axis.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AxisState {
    /// The counter, in the axis' own counts.
    pub counter: i32,
    /// Whether it moves or searches its reference.
    pub moving: bool,
    /// Whether it has its reference; `None` if the controller does not say.
    pub referenced: Option<bool>,
    /// The limit switch that is pressed, where the controller says it.
    pub limit: Option<Side>,
    /// Trouble that the controller tells, in words.
    pub fault: Option<String>,
}

/// An axis of a controller.
pub trait Axis: Send {
    /// The controller, in messages.
    const DEVICE: &'static str;
    /// Whether a reference search leaves the counter at zero.
    const HOME_IS_ZERO: bool;
    /// Whether a search counts only if the controller told that it ran ([`has_searched`](Self::has_searched)); otherwise one
    /// that was seen to move counts too.
    const SEARCH_IS_TOLD: bool;

    /// Counts of a degree.
    fn counts_per_deg(&self) -> f64;

    /// Asks the controller who it is.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError>;

    /// Settings of the controller, for metadata.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError>;

    /// Reads once where it is and what it does.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn state(&mut self, deadline: &Deadline) -> Result<AxisState, DeviceError>;

    /// Sends it to a value of its counter; it need not move yet when this returns.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn start(&mut self, target: i32, deadline: &Deadline) -> Result<(), DeviceError>;

    /// Begins the search of the reference.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn search(&mut self, deadline: &Deadline) -> Result<(), DeviceError>;

    /// Whether the controller has told, since the search was asked for, that it runs or has ended.
    fn has_searched(&mut self) -> bool {
        false
    }

    /// Says once that it shall stop.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError>;
}

/// Settings of a stage, whatever its protocol.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TurningSettings {
    /// Whether angles grow while the counter falls.
    pub inverted: bool,
    /// The angle at which the counter is 0, deg.
    pub zero_deg: f64,
    /// Angles between which it may stand, deg; `None` if it turns freely.
    pub travel_deg: Option<Interval>,
    /// How far from its target a stage that stands may be, deg.
    pub tolerance_deg: f64,
    /// How often a moving stage is asked where it is.
    pub poll: Duration,
    /// How long it may stand still on its way, or before a search begins.
    pub stall_after: Duration,
    /// How long stopping may take after a failed move: a call ends at most this long after its deadline.
    pub stop_within: Duration,
}

impl Default for TurningSettings {
    /// A stage that turns freely and stands exactly where it was sent.
    fn default() -> Self {
        Self {
            inverted: false,
            zero_deg: 0.0,
            travel_deg: None,
            tolerance_deg: 0.0,
            poll: Duration::from_millis(50),
            stall_after: Duration::from_secs(1),
            stop_within: Duration::from_secs(3),
        }
    }
}

/// A rotation stage. Angles are rounded once, from the angle to the counter, and never added up.
#[derive(Debug)]
pub struct Turning<A> {
    axis: A,
    settings: TurningSettings,
    /// How far from its target it may stand, counts.
    tolerance: u32,
    /// Whether the counter's zero is the reference, for an axis that does not say so itself.
    referenced: bool,
    /// Where it stood at the end of the last search or move, for such an axis: one that lost its power comes back elsewhere.
    left_at: Option<i32>,
}

/// How far from zero the counter may be after a search, deg.
const HOME_WITHIN_DEG: f64 = 0.5;

impl<A: Axis> Turning<A> {
    /// A stage on this axis; nothing is asked.
    ///
    /// # Errors
    /// Settings without sense ([`DeviceError::OutOfRange`]).
    pub fn new(axis: A, settings: TurningSettings) -> Result<Self, DeviceError> {
        let scale = axis.counts_per_deg();
        let within = |name, asked: f64, least, most| match (least..=most).contains(&asked) {
            true => Ok(()),
            false => Err(DeviceError::OutOfRange { name, asked, least, most }),
        };
        within("counts_per_deg", scale, f64::MIN_POSITIVE, f64::MAX)?;
        within("tolerance_deg", settings.tolerance_deg, 0.0, 360.0)?;
        within("zero_deg", settings.zero_deg, -1e9, 1e9)?;
        // A cast of a number that is too large gives the largest.
        let tolerance = (settings.tolerance_deg * scale).ceil() as u32;
        Ok(Self { axis, settings, tolerance, referenced: false, left_at: None })
    }

    /// Takes the counter as it is: for a stage that was referenced before, or cannot be.
    pub fn trust_counter(&mut self) {
        self.referenced = true;
    }

    /// The axis.
    pub fn axis(&self) -> &A {
        &self.axis
    }

    /// The axis; what is done with it behind the stage's back, the stage does not know.
    pub fn axis_mut(&mut self) -> &mut A {
        &mut self.axis
    }

    /// The axis.
    pub fn into_axis(self) -> A {
        self.axis
    }

    fn scale(&self) -> Scale {
        let TurningSettings { inverted, zero_deg, travel_deg, .. } = self.settings;
        Scale { counts_per_deg: self.axis.counts_per_deg(), inverted, zero_deg, travel_deg }
    }

    fn protocol(reason: String) -> DeviceError {
        DeviceError::Protocol { device: A::DEVICE, reason }
    }

    fn near(&self, one: i32, other: i32) -> bool {
        one.abs_diff(other) <= self.tolerance
    }

    /// Reads until two readings in a row agree: a line without checksums may spoil one of them.
    fn steady(&mut self, deadline: &Deadline) -> Result<AxisState, DeviceError> {
        let mut last = self.axis.state(deadline)?;
        let (mut moving, mut standing) = (0, 0);
        while standing < 4 {
            let next = self.axis.state(deadline)?;
            let same = self.near(next.counter, last.counter)
                && (next.moving, next.referenced) == (last.moving, last.referenced);
            if same {
                // A fault may be told once only.
                let fault = next.fault.clone().or(last.fault);
                return Ok(AxisState { fault, ..next });
            }
            (moving, standing) = if next.moving { (moving + 1, 0) } else { (0, standing + 1) };
            // It turns, and the last reading is as good as any.
            if moving >= 3 {
                return Ok(next);
            }
            last = next;
        }
        Err(Self::protocol("its counter reads differently each time though it stands".into()))
    }

    /// Whether angles mean something.
    fn require_reference(&mut self, state: &AxisState) -> Result<(), DeviceError> {
        let device = A::DEVICE;
        let fail = |reason| Err(DeviceError::NotReady { device, reason });
        match state.referenced {
            Some(true) => Ok(()),
            Some(false) if self.referenced => Ok(()),
            Some(false) => fail(
                "its angle is not known yet (it has no reference since it was switched on): home it (or trust its counter) first",
            ),
            None if !self.referenced => {
                fail("its angle is not known yet: home it (or trust its counter) first")
            }
            None => match self.left_at {
                Some(at) if !state.moving && !self.near(at, state.counter) => {
                    self.referenced = false;
                    self.left_at = None;
                    fail(
                        "it does not stand where it was left (power lost, turned by hand, or by another program): home it again",
                    )
                }
                _ => Ok(()),
            },
        }
    }

    fn pause(&self, action: &'static str, deadline: &Deadline) -> Result<(), DeviceError> {
        let slept = deadline.sleep(self.settings.poll);
        slept.map_err(|expired| DeviceError::expired(A::DEVICE, action, expired))
    }

    fn target(&mut self, angle_deg: f64, deadline: &Deadline) -> Result<i32, DeviceError> {
        let target = self.scale().counter(angle_deg)?;
        let state = self.steady(deadline)?;
        self.require_reference(&state)?;
        Ok(target)
    }

    /// Goes to a value of the counter, waits until it stands there, and gives where it stands.
    fn go(&mut self, target: i32, deadline: &Deadline) -> Result<i32, DeviceError> {
        self.left_at = None;
        self.axis.start(target, deadline)?;
        let mut last = None;
        let mut moved = deadline.now();
        loop {
            let state = self.steady(deadline)?;
            if !state.moving {
                faulty::<A>(&state, "to move")?;
                if self.near(state.counter, target) {
                    break;
                }
            }
            let now = deadline.now();
            if state.moving || last != Some(state.counter) {
                moved = now;
            } else if now.saturating_sub(moved) >= self.settings.stall_after {
                return Err(self.stuck(&state, target));
            }
            last = Some(state.counter);
            self.pause("the move", deadline)?;
        }
        // Once more: that it stands, and has not lost its reference on the way.
        let state = self.steady(deadline)?;
        self.require_reference(&state)?;
        if state.moving || !self.near(state.counter, target) {
            return Err(self.stuck(&state, target));
        }
        self.left_at = Some(state.counter);
        Ok(state.counter)
    }

    /// Why it stands short of its target.
    fn stuck(&self, state: &AxisState, target: i32) -> DeviceError {
        let (at_deg, target_deg) = (self.scale().angle(state.counter), self.scale().angle(target));
        let ahead = if state.counter < target { Side::Right } else { Side::Left };
        match state.limit {
            Some(side) if side == ahead => {
                DeviceError::LimitHit { device: A::DEVICE, side, at_deg, target_deg }
            }
            _ => DeviceError::Stalled { device: A::DEVICE, at_deg, target_deg },
        }
    }

    /// Searches the reference and gives the counter at which it stands then. A search counts if it was seen to run, or
    /// told to have run, and if the controller, where it says so, has its reference then.
    fn reference(&mut self, deadline: &Deadline) -> Result<i32, DeviceError> {
        (self.referenced, self.left_at) = (false, None);
        self.axis.search(deadline)?;
        let begun = deadline.now();
        let mut ran = false;
        loop {
            let state = self.steady(deadline)?;
            ran |= (state.moving && !A::SEARCH_IS_TOLD) || self.axis.has_searched();
            if !state.moving {
                faulty::<A>(&state, "to search its reference")?;
                if ran && state.referenced != Some(false) {
                    break;
                }
                if deadline.now().saturating_sub(begun) >= self.settings.stall_after {
                    let what = if ran { "end at its reference" } else { "begin" };
                    return Err(Self::protocol(format!(
                        "its reference search did not {what}: is the motor on, and the switch free?"
                    )));
                }
            }
            self.pause("the reference search", deadline)?;
        }
        let state = self.steady(deadline)?;
        let off_deg = f64::from(state.counter) / self.axis.counts_per_deg();
        if A::HOME_IS_ZERO && off_deg.abs() > HOME_WITHIN_DEG {
            return Err(Self::protocol(format!(
                "its reference search ended {off_deg:.4} deg from zero, expected at most {HOME_WITHIN_DEG} deg"
            )));
        }
        if state.moving {
            return Err(Self::protocol("it moves after its reference search".into()));
        }
        (self.referenced, self.left_at) = (state.referenced.is_none(), Some(state.counter));
        Ok(state.counter)
    }

    /// Ends search and motion, waits for standstill, and gives the state there.
    fn halt(&mut self, deadline: &Deadline) -> Result<AxisState, DeviceError> {
        self.left_at = None;
        loop {
            // Again and again: a stop that the line swallowed must not be the last one.
            self.axis.stop(deadline)?;
            let state = self.steady(deadline)?;
            if !state.moving {
                if state.referenced.is_none() && self.referenced {
                    self.left_at = Some(state.counter);
                }
                return Ok(state);
            }
            self.pause("stopping", deadline)?;
        }
    }

    /// Stops after `error` and says where it stands.
    fn stopped_by(
        &mut self,
        error: DeviceError,
        action: &'static str,
        deadline: &Deadline,
    ) -> Interrupted<Option<f64>> {
        // An answer that the end of the deadline cut off is no silence.
        let error = match (&error, deadline.remaining()) {
            (DeviceError::Transport { source, .. }, Err(expired)) if source.is_timeout() => {
                DeviceError::expired(A::DEVICE, action, expired)
            }
            _ => error,
        };
        let grace = deadline.grace(self.settings.stop_within);
        // A controller that lost its power on the way begins to count anew, and does not say so.
        let may_have_lost_power = matches!(error, DeviceError::Stalled { .. });
        let stopped = self.halt(&grace).map(|state| {
            if may_have_lost_power && state.referenced.is_none() {
                self.referenced = false;
            }
            self.require_reference(&state).is_ok().then(|| self.scale().angle(state.counter))
        });
        Interrupted::stopped(A::DEVICE, error, stopped)
    }
}

/// The error of an axis that tells trouble.
fn faulty<A: Axis>(state: &AxisState, request: &str) -> Result<(), DeviceError> {
    match &state.fault {
        None => Ok(()),
        Some(message) => Err(DeviceError::Declined {
            device: A::DEVICE,
            request: request.to_owned(),
            message: message.clone(),
        }),
    }
}

impl<A: Axis> Device for Turning<A> {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        self.axis.identity(deadline)
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let scale = self.scale();
        let configured = |name, value| Setting { name, value, origin: Origin::Configured };
        let mut settings = self.axis.settings(deadline)?;
        settings.extend(scale.settings());
        settings.push(configured("tolerance_deg", Value::Number(self.settings.tolerance_deg)));
        Ok(settings)
    }
}

impl<A: Axis> RotationStage for Turning<A> {
    fn travel_deg(&self) -> Option<Interval> {
        self.settings.travel_deg
    }

    fn angle_deg(&mut self, deadline: &Deadline) -> Result<f64, DeviceError> {
        let state = self.steady(deadline)?;
        self.require_reference(&state)?;
        Ok(self.scale().angle(state.counter))
    }

    fn home(&mut self, deadline: &Deadline) -> Result<f64, Interrupted<Option<f64>>> {
        match self.reference(deadline) {
            Ok(counter) => Ok(self.scale().angle(counter)),
            Err(error) => Err(self.stopped_by(error, "the reference search", deadline)),
        }
    }

    fn move_to(
        &mut self,
        angle_deg: f64,
        deadline: &Deadline,
    ) -> Result<f64, Interrupted<Option<f64>>> {
        // Nothing moves before this, and nothing has to be stopped.
        let target = self.target(angle_deg, deadline).map_err(|e| Interrupted::new(None, e))?;
        match self.go(target, deadline) {
            Ok(counter) => Ok(self.scale().angle(counter)),
            Err(error) => Err(self.stopped_by(error, "the move", deadline)),
        }
    }

    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.halt(deadline).map(|_| ())
    }
}
