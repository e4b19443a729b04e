//! A rotator.

use super::session::{Place, Session, SessionSettings};
use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, Identity, Interrupted, Origin, RotationStage, Setting, Value,
};
use crate::transport::Bytes;
use std::time::Duration;
use sunglint_numerics::measured::Interval;

const DEVICE: &str = "Alpaca rotator";
/// Angles that servers give, deg.
const ANGLES: [f64; 2] = [-360.0, 360.0];
/// How far from its target it may stand, deg.
const TOLERANCE_DEG: f64 = 0.1;

/// A rotator of an Alpaca server. Its angles are the server's position angles, 0 to 360.
#[derive(Debug)]
pub struct Rotator<T> {
    session: Session<T>,
}

impl<T: Bytes> Rotator<T> {
    /// Opens the rotator.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn open(
        line: T,
        place: &Place,
        settings: SessionSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let session = Session::open(line, place, [DEVICE, "rotator"], settings, deadline)?;
        Ok(Self { session })
    }

    fn turn_to(&mut self, angle_deg: f64, deadline: &Deadline) -> Result<f64, DeviceError> {
        if !(0.0..360.0).contains(&angle_deg) {
            let name = "angle, deg";
            return Err(DeviceError::OutOfRange {
                name,
                asked: angle_deg,
                least: 0.0,
                most: 360.0,
            });
        }
        let parameters = [("Position", angle_deg.to_string())];
        let put = self.session.put("moveabsolute", &parameters, deadline);
        put.map_err(|fail| fail.error(DEVICE, &format!("{angle_deg} deg")))?;
        let near = |a: f64, b: f64, most: f64| {
            let off = (a - b).rem_euclid(360.0);
            off.min(360.0 - off) <= most
        };
        let got = self.session.settle(
            "turning",
            deadline,
            |session, d| match session.flag("ismoving", d)? {
                true => Ok(None),
                false => session.number("position", ANGLES, d).map(Some),
            },
            |at| near(at, angle_deg, TOLERANCE_DEG),
            |a, b| near(a, b, 0.1 * TOLERANCE_DEG),
        )?;
        if !near(got, angle_deg, TOLERANCE_DEG) {
            let (asked, got) = (angle_deg.to_string(), got.to_string());
            return Err(DeviceError::NotTaken { device: DEVICE, name: "angle, deg", asked, got });
        }
        Ok(got)
    }
}

impl<T: Bytes> Device for Rotator<T> {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        self.session.identity(deadline)
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let origin = Origin::ReadBack;
        let angle = self.angle_deg(deadline)?;
        let mut settings = vec![Setting { name: "angle_deg", value: Value::Number(angle), origin }];
        if let Some(reverse) = self.session.optional("reverse", deadline)?.and_then(|v| v.as_bool())
        {
            settings.push(Setting { name: "reversed", value: Value::Flag(reverse), origin });
        }
        Ok(settings)
    }
}

impl<T: Bytes> RotationStage for Rotator<T> {
    fn travel_deg(&self) -> Option<Interval> {
        None
    }

    fn angle_deg(&mut self, deadline: &Deadline) -> Result<f64, DeviceError> {
        self.session.number("position", ANGLES, deadline)
    }

    fn home(&mut self, _: &Deadline) -> Result<f64, Interrupted<Option<f64>>> {
        let reason = "Alpaca rotators have no home: turn it to a mark and sync it there";
        Err(Interrupted::new(None, DeviceError::NotReady { device: DEVICE, reason }))
    }

    fn move_to(
        &mut self,
        angle_deg: f64,
        deadline: &Deadline,
    ) -> Result<f64, Interrupted<Option<f64>>> {
        self.turn_to(angle_deg, deadline).map_err(|error| {
            if matches!(error, DeviceError::OutOfRange { .. }) {
                return Interrupted::new(None, error);
            }
            let grace = deadline.grace(Duration::from_secs(2));
            let stopped = self.stop(&grace).map(|()| self.angle_deg(&grace).ok());
            Interrupted::stopped(DEVICE, error, stopped)
        })
    }

    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        let put = self.session.put("halt", &[], deadline);
        put.map_err(|fail| fail.error(DEVICE, "to stop"))
    }
}
