//! A focuser.

use super::client::Wanted;
use super::property::{State, Vector};
use super::session::{Kind, Session, SessionSettings};
use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, Focuser as _, Identity, Interrupted, Origin, Setting, Value, check_steps,
};
use crate::transport::Bytes;
use std::time::Duration;

const DEVICE: &str = "INDI focuser";
const PLACE: &str = "ABS_FOCUS_POSITION";
const VALUE: &str = "FOCUS_ABSOLUTE_POSITION";
const ABORT: (&str, &str) = ("FOCUS_ABORT_MOTION", "ABORT");
const TEMPERATURE: (&str, &str) = ("FOCUS_TEMPERATURE", "TEMPERATURE");
const KIND: Kind = Kind { label: DEVICE, what: "focuser", interface: 1 << 3, required: &[PLACE] };
/// Time between two questions after a move.
const POLL: Duration = Duration::from_millis(100);
/// How long an abort, or the rest of a move, may take: some drivers have no abort (the simulator of 1.9.9), and some hear nothing until a move has ended.
const ABORT_WITHIN: Duration = Duration::from_secs(15);
/// Steps that a focuser may be off and still be there.
const THERE: i64 = 1;

/// A focuser on an INDI server, with absolute positions.
#[derive(Debug)]
pub struct Focuser<T> {
    session: Session<T>,
    range: [i64; 2],
}

impl<T: Bytes> Focuser<T> {
    /// Connects to the focuser of that name.
    ///
    /// # Errors
    /// See [`DeviceError`]; [`DeviceError::Unknown`] if the server has none of that name ([`devices`](super::devices) lists them).
    pub fn open(
        line: T,
        device: &str,
        settings: SessionSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let mut session = Session::new(line, device, KIND, settings);
        session.define(deadline)?;
        let range = session.require(PLACE)?.range(VALUE).map(|range| range.to_array());
        let range = match range {
            Some([least, most]) if least < most && least >= -1e9 && most <= 1e9 => {
                [least.ceil() as i64, most.floor() as i64]
            }
            found => {
                let reason = format!("its positions are {found:?}, expected two numbers");
                return Err(session.protocol(reason));
            }
        };
        Ok(Self { session, range })
    }

    fn steps(&self, vector: &Vector) -> Result<i64, DeviceError> {
        let found = vector.number(VALUE).filter(|n| n.abs() <= 1e9);
        let found = found.map(|n| n.round() as i64);
        found.ok_or_else(|| self.session.protocol("it does not say its position".into()))
    }

    fn refresh(&mut self, deadline: &Deadline) -> Result<Vector, DeviceError> {
        let soon = deadline.at_most(self.session.settings.answer_within);
        self.session.require(PLACE)?;
        self.session.client.refresh(&self.session.device, PLACE, &soon)
    }

    /// Waits until it moves no more, and gives where it stands.
    fn rest(&mut self, deadline: &Deadline) -> Result<i64, DeviceError> {
        loop {
            let now = self.refresh(deadline)?;
            if now.state != State::Busy {
                return self.steps(&now);
            }
            deadline
                .sleep(POLL)
                .map_err(|expired| DeviceError::expired(DEVICE, "coming to rest", expired))?;
        }
    }

    fn go(&mut self, position: i64, deadline: &Deadline) -> Result<i64, DeviceError> {
        check_steps(position, self.range)?;
        // A driver may answer Ok with the old position to a move to where it stands, and Alert to none at all.
        let now = self.refresh(deadline)?;
        if now.state != State::Busy && self.steps(&now)? == position {
            return Ok(position);
        }
        let wanted = Wanted::Numbers(&[(VALUE, position as f64)]);
        self.session.change(PLACE, wanted, deadline)?;
        // The first value after a command may still be the old one: position and state count.
        let mut stood = None;
        loop {
            let now = self.refresh(deadline)?;
            let got = self.steps(&now)?;
            if now.state != State::Busy {
                if (got - position).abs() <= THERE {
                    return Ok(got);
                }
                if stood == Some(got) {
                    let (asked, got) = (position.to_string(), got.to_string());
                    let name = "position, steps";
                    return Err(DeviceError::NotTaken { device: DEVICE, name, asked, got });
                }
                stood = Some(got);
            }
            deadline
                .sleep(POLL)
                .map_err(|expired| DeviceError::expired(DEVICE, "moving", expired))?;
        }
    }
}

impl<T: Bytes> Device for Focuser<T> {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        self.session.identity()
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let origin = Origin::ReadBack;
        let position = self.position(deadline)?;
        let mut settings = vec![
            Setting { name: "position_steps", value: Value::Integer(position), origin },
            Setting { name: "most_steps", value: Value::Integer(self.range[1]), origin },
        ];
        if let Some(temperature) = self.temperature_c(deadline)? {
            let value = Value::Number(temperature);
            settings.push(Setting { name: "temperature_c", value, origin });
        }
        Ok(settings)
    }
}

impl<T: Bytes> crate::device::Focuser for Focuser<T> {
    fn range(&self) -> [i64; 2] {
        self.range
    }

    fn position(&mut self, deadline: &Deadline) -> Result<i64, DeviceError> {
        let now = self.refresh(deadline)?;
        self.steps(&now)
    }

    fn move_to(
        &mut self,
        position: i64,
        deadline: &Deadline,
    ) -> Result<i64, Interrupted<Option<i64>>> {
        self.go(position, deadline).map_err(|error| {
            let harmless =
                matches!(error, DeviceError::OutOfRange { .. } | DeviceError::Lost { .. });
            if harmless {
                return Interrupted::new(None, error);
            }
            let grace = deadline.grace(ABORT_WITHIN);
            // One that cannot be stopped comes to rest where it was sent to.
            let rests = match self.stop(&grace) {
                Err(DeviceError::NotReady { .. }) => self.rest(&grace),
                stopped => stopped.and_then(|()| self.position(&grace)),
            };
            match rests {
                Ok(at) => Interrupted::new(Some(at), error),
                Err(_) => {
                    let source = Box::new(error);
                    Interrupted::new(None, DeviceError::NotStopped { device: DEVICE, source })
                }
            }
        })
    }

    fn temperature_c(&mut self, _: &Deadline) -> Result<Option<f64>, DeviceError> {
        // It is sent when it changes.
        let found = self.session.property(TEMPERATURE.0).and_then(|v| v.number(TEMPERATURE.1));
        Ok(found.filter(|c| c.is_finite()))
    }

    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        let (name, member) = ABORT;
        if self.session.property(name).is_none() {
            let reason = "it cannot be stopped (FOCUS_ABORT_MOTION)";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        let device = self.session.device.clone();
        // The switch springs back: that it was answered at all is what counts.
        let wanted = Wanted::Switches(&[(member, true)]);
        self.session.client.pulse(&device, name, wanted, deadline).map(drop)
    }
}
