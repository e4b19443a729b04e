//! A focuser.

use super::session::{Place, Session, SessionSettings};
use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, Focuser as _, Identity, Interrupted, Origin, Setting, Value,
};
use crate::transport::Bytes;
use std::time::Duration;

const DEVICE: &str = "Alpaca focuser";
/// Positions that fit into ASCOM's type.
const POSITIONS: [i64; 2] = [i32::MIN as i64, i32::MAX as i64];
/// Steps that a focuser may be off and still be there.
const THERE: i64 = 1;

/// A focuser of an Alpaca server, with absolute positions.
#[derive(Debug)]
pub struct Focuser<T> {
    session: Session<T>,
    most: i64,
}

impl<T: Bytes> Focuser<T> {
    /// Opens the focuser.
    ///
    /// # Errors
    /// See [`DeviceError`]; [`DeviceError::NotReady`] if it has no absolute positions.
    pub fn open(
        line: T,
        place: &Place,
        settings: SessionSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let mut session = Session::open(line, place, [DEVICE, "focuser"], settings, deadline)?;
        if !session.flag("absolute", deadline)? {
            let reason = "it moves by steps from where it stands, without a position: it cannot be focused by a curve";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        let most = session.integer("maxstep", [1, i64::from(i32::MAX)], deadline)?;
        Ok(Self { session, most })
    }

    fn go(&mut self, position: i64, deadline: &Deadline) -> Result<i64, DeviceError> {
        crate::device::check_steps(position, [0, self.most])?;
        let parameters = [("Position", position.to_string())];
        let put = self.session.put("move", &parameters, deadline);
        put.map_err(|fail| fail.error(DEVICE, &format!("position {position}")))?;
        let got = self.session.settle(
            "moving",
            deadline,
            |session, d| match session.flag("ismoving", d)? {
                true => Ok(None),
                false => session.integer("position", POSITIONS, d).map(Some),
            },
            |at| at == position,
            |a, b| a == b,
        )?;
        if (got - position).abs() > THERE {
            let (asked, got) = (position.to_string(), got.to_string());
            return Err(DeviceError::NotTaken {
                device: DEVICE,
                name: "position, steps",
                asked,
                got,
            });
        }
        Ok(got)
    }
}

impl<T: Bytes> Device for Focuser<T> {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        self.session.identity(deadline)
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let origin = Origin::ReadBack;
        let position = self.position(deadline)?;
        let mut settings =
            vec![Setting { name: "position_steps", value: Value::Integer(position), origin }];
        let mut add = |name, value| settings.push(Setting { name, value, origin });
        add("most_steps", Value::Integer(self.most));
        if let Some(size) = self.session.optional_number("stepsize", deadline)? {
            add("step_um", Value::Number(size));
        }
        if let Some(on) = self.session.optional("tempcomp", deadline)?.and_then(|v| v.as_bool()) {
            add("temperature_compensation", Value::Flag(on));
        }
        if let Some(temperature) = self.session.optional_number("temperature", deadline)? {
            add("temperature_c", Value::Number(temperature));
        }
        Ok(settings)
    }
}

impl<T: Bytes> crate::device::Focuser for Focuser<T> {
    fn range(&self) -> [i64; 2] {
        [0, self.most]
    }

    fn position(&mut self, deadline: &Deadline) -> Result<i64, DeviceError> {
        self.session.integer("position", POSITIONS, deadline)
    }

    fn move_to(
        &mut self,
        position: i64,
        deadline: &Deadline,
    ) -> Result<i64, Interrupted<Option<i64>>> {
        self.go(position, deadline).map_err(|error| {
            if matches!(error, DeviceError::OutOfRange { .. }) {
                return Interrupted::new(None, error);
            }
            let grace = deadline.grace(Duration::from_secs(2));
            match self.stop(&grace) {
                Ok(()) => Interrupted::new(self.position(&grace).ok(), error),
                Err(_) => {
                    let source = Box::new(error);
                    Interrupted::new(None, DeviceError::NotStopped { device: DEVICE, source })
                }
            }
        })
    }

    fn temperature_c(&mut self, deadline: &Deadline) -> Result<Option<f64>, DeviceError> {
        self.session.optional_number("temperature", deadline)
    }

    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        match self.session.put("halt", &[], deadline) {
            Ok(()) => Ok(()),
            Err(fail) => Err(fail.error(DEVICE, "to stop")),
        }
    }
}
