//! A rotator.

use super::client::Wanted;
use super::property::Vector;
use super::session::{Kind, Session, SessionSettings, check_range};
use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, Identity, Interrupted, Origin, RotationStage, Setting, Value,
};
use crate::transport::Bytes;
use std::time::Duration;
use sunglint_numerics::measured::Interval;

const DEVICE: &str = "INDI rotator";
const ANGLE: (&str, &str) = ("ABS_ROTATOR_ANGLE", "ANGLE");
const SYNC: (&str, &str) = ("SYNC_ROTATOR_ANGLE", "ANGLE");
const HOME: (&str, &str) = ("ROTATOR_HOME", "HOME");
const ABORT: (&str, &str) = ("ROTATOR_ABORT_MOTION", "ABORT");
const KIND: Kind =
    Kind { label: DEVICE, what: "rotator", interface: 1 << 12, required: &[ANGLE.0] };

/// How a rotator is used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RotatorSettings {
    /// How its server is spoken to.
    pub session: SessionSettings,
    /// How far from its target it may stand, deg: half a step of its motor, at least.
    pub tolerance_deg: f64,
    /// How long an abort may take after the deadline of a move.
    pub abort_within: Duration,
}

impl Default for RotatorSettings {
    fn default() -> Self {
        Self {
            session: SessionSettings::default(),
            tolerance_deg: 0.05,
            abort_within: Duration::from_secs(2),
        }
    }
}

/// A rotator on an INDI server. Its angles are the driver's: which way they grow, and from where, is set there.
#[derive(Debug)]
pub struct Rotator<T> {
    session: Session<T>,
    settings: RotatorSettings,
}

impl<T: Bytes> Rotator<T> {
    /// Connects to the rotator of that name.
    ///
    /// # Errors
    /// See [`DeviceError`]; [`DeviceError::Unknown`] if the server has none of that name ([`devices`](super::devices) lists them).
    pub fn open(
        line: T,
        device: &str,
        settings: RotatorSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let mut session = Session::new(line, device, KIND, settings.session);
        session.define(deadline)?;
        Ok(Self { session, settings })
    }

    /// Goes on over a new line to the server, from scratch; gives the old one.
    ///
    /// # Errors
    /// The errors of [`open`](Self::open).
    pub fn reconnect(&mut self, line: T, deadline: &Deadline) -> Result<T, DeviceError> {
        let old = self.session.client.replace_line(line);
        self.session.define(deadline)?;
        Ok(old)
    }

    /// The line.
    pub fn line(&self) -> &T {
        self.session.client.line()
    }

    /// The line.
    pub fn into_line(self) -> T {
        self.session.client.into_line()
    }

    /// Says that it stands at `angle_deg` now, deg, and gives what it says then.
    ///
    /// # Errors
    /// A rotator that cannot; see [`DeviceError`].
    pub fn sync(&mut self, angle_deg: f64, deadline: &Deadline) -> Result<f64, DeviceError> {
        let (name, member) = SYNC;
        let Some(vector) = self.session.property(name) else {
            let reason = "its angle cannot be set without turning (SYNC_ROTATOR_ANGLE)";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        };
        check_range("angle, deg", angle_deg, vector.range(member))?;
        let soon = deadline.at_most(self.settings.session.answer_within);
        self.session.change(name, Wanted::Numbers(&[(member, angle_deg)]), &soon)?;
        let angle = self.angle_deg(deadline)?;
        self.check_there(angle, angle_deg)?;
        Ok(angle)
    }

    fn angle_of(&self, vector: &Vector) -> Result<f64, DeviceError> {
        vector
            .number(ANGLE.1)
            .ok_or_else(|| self.session.protocol("it does not say its angle".into()))
    }

    /// Whether it stands where it should; 359.99° is near 0°.
    fn check_there(&self, angle_deg: f64, wanted_deg: f64) -> Result<(), DeviceError> {
        let off = (angle_deg - wanted_deg).rem_euclid(360.0);
        if off.min(360.0 - off) <= self.settings.tolerance_deg {
            return Ok(());
        }
        let (asked, got) = (wanted_deg.to_string(), angle_deg.to_string());
        Err(DeviceError::NotTaken { device: DEVICE, name: "angle, deg", asked, got })
    }

    fn turn_to(&mut self, angle_deg: f64, deadline: &Deadline) -> Result<f64, DeviceError> {
        let (name, member) = ANGLE;
        check_range("angle, deg", angle_deg, self.session.require(name)?.range(member))?;
        let wanted = Wanted::Numbers(&[(member, angle_deg)]);
        let after = self.session.change(name, wanted, deadline)?;
        let angle = self.angle_of(&after)?;
        self.check_there(angle, angle_deg)?;
        Ok(angle)
    }

    fn find_home(&mut self, deadline: &Deadline) -> Result<f64, DeviceError> {
        let (name, member) = HOME;
        if self.session.property(name).is_none() {
            let reason = "it has no home (ROTATOR_HOME): turn it to a mark and sync it";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        let device = self.session.device.clone();
        let wanted = Wanted::Switches(&[(member, true)]);
        self.session.client.pulse(&device, name, wanted, deadline)?;
        self.angle_deg(deadline)
    }

    /// Stops what a failed call may have set going, and asks where it stands.
    fn after_failure(
        &mut self,
        error: DeviceError,
        deadline: &Deadline,
    ) -> Interrupted<Option<f64>> {
        let harmless = matches!(
            error,
            DeviceError::OutOfRange { .. }
                | DeviceError::NotReady { .. }
                | DeviceError::Lost { .. }
        );
        if harmless {
            return Interrupted::new(None, error);
        }
        let grace = deadline.grace(self.settings.abort_within);
        if self.stop(&grace).is_err() {
            let source = Box::new(error);
            return Interrupted::new(None, DeviceError::NotStopped { device: DEVICE, source });
        }
        Interrupted::new(self.angle_deg(&grace).ok(), error)
    }
}

impl<T: Bytes> Device for Rotator<T> {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        self.session.identity()
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let angle = self.angle_deg(deadline)?;
        let origin = Origin::ReadBack;
        let mut settings = vec![Setting { name: "angle_deg", value: Value::Number(angle), origin }];
        if let Some(reverse) = self.session.property("ROTATOR_REVERSE")
            && let Some(on) = reverse.is_on("INDI_ENABLED")
        {
            settings.push(Setting { name: "reversed", value: Value::Flag(on), origin });
        }
        Ok(settings)
    }
}

impl<T: Bytes> RotationStage for Rotator<T> {
    fn travel_deg(&self) -> Option<Interval> {
        self.session.property(ANGLE.0)?.range(ANGLE.1)
    }

    fn angle_deg(&mut self, deadline: &Deadline) -> Result<f64, DeviceError> {
        let soon = deadline.at_most(self.settings.session.answer_within);
        self.session.require(ANGLE.0)?;
        let now = self.session.client.refresh(&self.session.device, ANGLE.0, &soon)?;
        self.angle_of(&now)
    }

    fn home(&mut self, deadline: &Deadline) -> Result<f64, Interrupted<Option<f64>>> {
        self.find_home(deadline).map_err(|error| self.after_failure(error, deadline))
    }

    fn move_to(
        &mut self,
        angle_deg: f64,
        deadline: &Deadline,
    ) -> Result<f64, Interrupted<Option<f64>>> {
        self.turn_to(angle_deg, deadline).map_err(|error| self.after_failure(error, deadline))
    }

    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        let (name, member) = ABORT;
        if self.session.property(name).is_none() {
            let reason = "it cannot be stopped (ROTATOR_ABORT_MOTION)";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        let device = self.session.device.clone();
        // The switch springs back: that it was answered at all is what counts.
        let wanted = Wanted::Switches(&[(member, true)]);
        self.session.client.pulse(&device, name, wanted, deadline).map(drop)
    }
}
