//! A rotation stage on a TMCL module: its settings, its angles, and its traits. How it moves is in `motion`.

use super::DEVICE;
use super::link::{Link, LinkSettings};
use super::tmcl::{Axis, Command};
use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, Identity, Interrupted, Origin, RotationStage, Scale, Setting, Value,
};
use crate::transport::Bytes;
use std::time::Duration;
use sunglint_numerics::measured::Interval;

/// From which side a target is approached, so that the gear's backlash is always taken up in the same direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Approach {
    /// From wherever it stands.
    Direct,
    /// From smaller angles, by at least `by_deg`: more than the backlash.
    FromBelow {
        /// How far below the target the approach begins, deg.
        by_deg: f64,
    },
    /// From larger angles, by at least `by_deg`.
    FromAbove {
        /// How far above the target the approach begins, deg.
        by_deg: f64,
    },
}

/// How the module searches its reference. Speeds are in the module's own unit (see its manual).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Search {
    /// Axis parameter 193: which switches are used, as the module's manual numbers them (1: the left one, TMCM-142
    /// firmware manual V1.06).
    pub mode: i32,
    /// Axis parameter 194.
    pub speed: i32,
    /// Axis parameter 195.
    pub switch_speed: i32,
    /// How far from zero the counter may be when the search has ended, deg; further away, the search is not believed.
    pub tolerance_deg: f64,
}

/// Settings that the driver needs for a stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StageSettings {
    /// The motor's number on the module.
    pub motor: u8,
    /// Full steps of a motor turn: 200 for 1.8°.
    pub full_steps_per_turn: u32,
    /// Turns of the motor for one turn of the stage.
    pub gear: f64,
    /// Whether angles grow while the module's counter falls.
    pub inverted: bool,
    /// The angle at which the module's counter is 0, deg.
    pub zero_deg: f64,
    /// Angles between which it may stand, deg, the approach included; `None` if it turns freely.
    pub travel_deg: Option<Interval>,
    /// From which side targets are approached.
    pub approach: Approach,
    /// How the reference is searched; `None` if the stage has no switch.
    pub search: Option<Search>,
    /// How often a moving stage is asked where it is.
    pub poll: Duration,
    /// How long it may stand still on its way.
    pub stall_after: Duration,
    /// How long stopping may take after a failed move: a call ends at most this long after its deadline.
    pub stop_within: Duration,
}

impl Default for StageSettings {
    /// Motor 0, 200 full steps, no gear, nothing known of switches and limits.
    fn default() -> Self {
        Self {
            motor: 0,
            full_steps_per_turn: 200,
            gear: 1.0,
            inverted: false,
            zero_deg: 0.0,
            travel_deg: None,
            approach: Approach::Direct,
            search: None,
            poll: Duration::from_millis(50),
            stall_after: Duration::from_secs(1),
            stop_within: Duration::from_secs(3),
        }
    }
}

/// A rotation stage.
///
/// Angles are rounded once, from the angle to the module's counter (`round((angle − zero) · microsteps per degree)`), and
/// never added up: a thousand steps of 0.5° end where one move of 500° would.
///
/// The counter counts the steps that the motor was sent. A motor that loses steps against an obstacle without a switch is
/// not seen by it; what is seen is a counter that stands still.
#[derive(Debug)]
pub struct Stage<T> {
    pub(super) link: Link<T>,
    pub(super) settings: StageSettings,
    version: u32,
    microsteps_per_deg: f64,
    /// Whether the counter's zero is the reference.
    pub(super) referenced: bool,
    /// The target of the last finished move, where the module must still stand.
    pub(super) commanded: Option<i32>,
    /// Whether the last finished move took up the backlash from the approach's side.
    pub(super) taken_up: bool,
    /// Whether the right and left switches stop the motor.
    pub(super) switches: [bool; 2],
}

impl<T: Bytes> Stage<T> {
    /// Asks the module who it is, and for its microsteps and switches. Nothing moves.
    ///
    /// # Errors
    /// Settings without sense ([`DeviceError::OutOfRange`]); a module that does not answer, or see [`DeviceError`].
    pub fn open(
        line: T,
        link: LinkSettings,
        settings: StageSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let mut link = Link::new(line, link);
        let version = link.version(deadline)?;
        let mut get =
            |axis: Axis| link.ask(Command::Get, axis.number(), settings.motor, 0, deadline);
        let exponent = get(Axis::Microsteps)?;
        let switches = [get(Axis::RightLimitDisabled)? == 0, get(Axis::LeftLimitDisabled)? == 0];
        // Modules go to 256 microsteps (2^8); beyond 2^15 the answer is no exponent.
        let exponent = u32::try_from(exponent).ok().filter(|n| *n <= 15).ok_or_else(|| {
            let reason = format!("microstep resolution {exponent}, expected 0 to 15");
            DeviceError::Protocol { device: DEVICE, reason }
        })?;
        let per_turn = f64::from(settings.full_steps_per_turn) * f64::from(1_u32 << exponent);
        let microsteps_per_deg = per_turn * settings.gear / 360.0;
        if !(microsteps_per_deg.is_finite() && microsteps_per_deg > 0.0) {
            return Err(DeviceError::OutOfRange {
                name: "gear and full_steps_per_turn (microsteps per degree)",
                asked: microsteps_per_deg,
                least: f64::MIN_POSITIVE,
                most: f64::MAX,
            });
        }
        Ok(Self {
            link,
            settings,
            version,
            microsteps_per_deg,
            referenced: false,
            commanded: None,
            taken_up: false,
            switches,
        })
    }

    /// Takes the module's counter as it is: for a stage without switch, or one that was homed before and has not lost its
    /// power or its steps since.
    pub fn trust_counter(&mut self) {
        self.referenced = true;
    }

    /// Microsteps of one degree.
    pub fn microsteps_per_deg(&self) -> f64 {
        self.microsteps_per_deg
    }

    /// The line to the module.
    pub fn line(&self) -> &T {
        self.link.line()
    }

    /// The line to the module; what is said on it behind the stage's back, the stage does not know.
    pub fn line_mut(&mut self) -> &mut T {
        self.link.line_mut()
    }

    /// The line to the module.
    pub fn into_line(self) -> T {
        self.link.into_line()
    }

    pub(super) fn get(&mut self, axis: Axis, deadline: &Deadline) -> Result<i32, DeviceError> {
        self.link.ask(Command::Get, axis.number(), self.settings.motor, 0, deadline)
    }

    /// Sets and reads back.
    pub(super) fn set(
        &mut self,
        axis: Axis,
        name: &'static str,
        value: i32,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        self.link.ask(Command::Set, axis.number(), self.settings.motor, value, deadline)?;
        let got = self.get(axis, deadline)?;
        if got == value {
            return Ok(());
        }
        let (asked, got) = (value.to_string(), got.to_string());
        Err(DeviceError::NotTaken { device: DEVICE, name, asked, got })
    }

    /// Sets the speed of moves, in the module's own unit, and gives the speed that it then has.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn set_max_speed(&mut self, speed: i32, deadline: &Deadline) -> Result<i32, DeviceError> {
        self.set(Axis::MaxSpeed, "max_speed", speed, deadline).map(|()| speed)
    }

    pub(super) fn scale(&self) -> Scale {
        let StageSettings { inverted, zero_deg, travel_deg, .. } = self.settings;
        Scale { counts_per_deg: self.microsteps_per_deg, inverted, zero_deg, travel_deg }
    }
}

impl<T: Bytes> Device for Stage<T> {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        self.version = self.link.version(deadline)?;
        let (number, major, minor) =
            (self.version >> 16, self.version >> 8 & 0xff, self.version & 0xff);
        let model = if number == 0 { "TMCL module".into() } else { format!("TMCM-{number}") };
        Ok(Identity {
            vendor: "Trinamic".into(),
            model,
            // The protocol has none.
            serial: None,
            firmware: Some(format!("{major}.{minor:02}")),
            driver: "tmcl",
        })
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let mut settings = Vec::new();
        let mut configured =
            |name, value| settings.push(Setting { name, value, origin: Origin::Configured });
        configured("motor", Value::Integer(self.settings.motor.into()));
        configured("full_steps_per_turn", Value::Integer(self.settings.full_steps_per_turn.into()));
        configured("gear", Value::Number(self.settings.gear));
        settings.extend(self.scale().settings());
        let mut configured =
            |name, value| settings.push(Setting { name, value, origin: Origin::Configured });
        let (side, by_deg) = match self.settings.approach {
            Approach::Direct => ("direct", 0.0),
            Approach::FromBelow { by_deg } => ("from below", by_deg),
            Approach::FromAbove { by_deg } => ("from above", by_deg),
        };
        configured("approach", Value::Text(side.into()));
        configured("approach_deg", Value::Number(by_deg));
        for (name, axis) in [
            ("microstep_exponent", Axis::Microsteps),
            ("max_speed_units", Axis::MaxSpeed),
            ("max_acceleration_units", Axis::MaxAcceleration),
            ("max_current_units", Axis::MaxCurrent),
            ("standby_current_units", Axis::StandbyCurrent),
            ("right_limit_disabled", Axis::RightLimitDisabled),
            ("left_limit_disabled", Axis::LeftLimitDisabled),
        ] {
            let value = Value::Integer(self.get(axis, deadline)?.into());
            settings.push(Setting { name, value, origin: Origin::ReadBack });
        }
        Ok(settings)
    }

    fn own_settings(&self) -> &'static [(&'static str, &'static str)] {
        &[("max_speed_units", "the speed of moves, in the module's own unit")]
    }

    fn set_own(&mut self, name: &str, value: &str, d: &Deadline) -> Result<Value, DeviceError> {
        let unknown = |name, asked: &str, known: &str| {
            let (asked, known) = (asked.to_owned(), known.to_owned());
            Err(DeviceError::Unknown { name, asked, known })
        };
        match (name, value.parse()) {
            ("max_speed_units", Ok(speed)) => {
                self.set_max_speed(speed, d).map(|speed| Value::Integer(speed.into()))
            }
            ("max_speed_units", Err(_)) => unknown("max_speed_units", value, "the whole numbers"),
            _ => unknown("setting", name, "max_speed_units"),
        }
    }
}

impl<T: Bytes> RotationStage for Stage<T> {
    fn travel_deg(&self) -> Option<Interval> {
        self.settings.travel_deg
    }

    fn angle_deg(&mut self, deadline: &Deadline) -> Result<f64, DeviceError> {
        self.require_reference(deadline)?;
        let counter = self.steady_counter(deadline)?;
        Ok(self.scale().angle(counter))
    }

    fn home(&mut self, deadline: &Deadline) -> Result<f64, Interrupted<Option<f64>>> {
        match self.search(deadline) {
            Ok(counter) => Ok(self.scale().angle(counter)),
            Err(error) => Err(self.stopped_by(error, deadline)),
        }
    }

    fn move_to(
        &mut self,
        angle_deg: f64,
        deadline: &Deadline,
    ) -> Result<f64, Interrupted<Option<f64>>> {
        // Nothing moves before the plan is made, and nothing has to be stopped if there is none.
        let plan = self.plan(angle_deg, deadline).map_err(|error| Interrupted::new(None, error))?;
        for target in &plan {
            if let Err(error) = self.go(*target, deadline) {
                return Err(self.stopped_by(error, deadline));
            }
        }
        self.taken_up = true;
        match self.steady_counter(deadline) {
            Ok(counter) if Some(&counter) == plan.last() => Ok(self.scale().angle(counter)),
            Ok(counter) => {
                let error = self.stalled(counter, plan.last().copied().unwrap_or(counter));
                Err(self.stopped_by(error, deadline))
            }
            Err(error) => Err(self.stopped_by(error, deadline)),
        }
    }

    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.halt(deadline).map(|_| ())
    }
}
