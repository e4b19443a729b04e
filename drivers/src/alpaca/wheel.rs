//! A filter wheel.

use super::session::{Place, Session, SessionSettings};
use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, FilterWheel, Identity, Interrupted, Origin, Setting, Value,
};
use crate::transport::Bytes;

const DEVICE: &str = "Alpaca filter wheel";

/// A filter wheel of an Alpaca server.
#[derive(Debug)]
pub struct Wheel<T> {
    session: Session<T>,
    names: Vec<String>,
}

impl<T: Bytes> Wheel<T> {
    /// Opens the wheel.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn open(
        line: T,
        place: &Place,
        settings: SessionSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let mut session = Session::open(line, place, [DEVICE, "filterwheel"], settings, deadline)?;
        let names = session.texts("names", deadline)?;
        if names.is_empty() {
            return Err(session.protocol("it has no slots".into()));
        }
        Ok(Self { session, names })
    }

    /// The slot in the beam, from 1; `None` while it turns.
    fn position(&mut self, deadline: &Deadline) -> Result<Option<u32>, DeviceError> {
        let most = i64::from(self.slots()) - 1;
        let position = self.session.integer("position", [-1, most], deadline)?;
        Ok(u32::try_from(position).ok().map(|position| position + 1))
    }

    fn turn_to(&mut self, slot: u32, deadline: &Deadline) -> Result<u32, DeviceError> {
        if !(1..=self.slots()).contains(&slot) {
            let (asked, most) = (slot.into(), self.slots().into());
            return Err(DeviceError::OutOfRange { name: "slot", asked, least: 1.0, most });
        }
        let parameters = [("Position", (slot - 1).to_string())];
        let put = self.session.put("position", &parameters, deadline);
        put.map_err(|fail| fail.error(DEVICE, &format!("slot {slot}")))?;
        let most = i64::from(self.slots()) - 1;
        let got = self.session.settle(
            "turning",
            deadline,
            |session, deadline| {
                let now = session.integer("position", [-1, most], deadline)?;
                Ok(u32::try_from(now).ok().map(|now| now + 1))
            },
            |got| got == slot,
            |a, b| a == b,
        )?;
        if got != slot {
            let (asked, got) = (slot.to_string(), got.to_string());
            return Err(DeviceError::NotTaken { device: DEVICE, name: "slot", asked, got });
        }
        Ok(got)
    }
}

impl<T: Bytes> Device for Wheel<T> {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        self.session.identity(deadline)
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let slot = self.slot(deadline)?;
        let origin = Origin::ReadBack;
        let mut settings =
            vec![Setting { name: "slot", value: Value::Integer(slot.into()), origin }];
        if let Some(name) = self.names.get(slot as usize - 1) {
            settings.push(Setting { name: "filter", value: Value::Text(name.clone()), origin });
        }
        Ok(settings)
    }
}

impl<T: Bytes> FilterWheel for Wheel<T> {
    fn slots(&self) -> u32 {
        // At most a hundred names are taken.
        self.names.len() as u32
    }

    fn names(&self) -> Vec<String> {
        self.names.clone()
    }

    fn slot(&mut self, deadline: &Deadline) -> Result<u32, DeviceError> {
        let reason = "it is turning: no filter is in the beam";
        self.position(deadline)?.ok_or(DeviceError::NotReady { device: DEVICE, reason })
    }

    fn look(&mut self, deadline: &Deadline) -> Result<Vec<Option<u32>>, DeviceError> {
        self.position(deadline).map(|position| vec![position])
    }

    fn select(&mut self, slot: u32, deadline: &Deadline) -> Result<u32, Interrupted<Option<u32>>> {
        self.turn_to(slot, deadline).map_err(|error| {
            let grace = deadline.grace(self.session.settings.answer_within);
            let asked = !matches!(error, DeviceError::Transport { .. });
            let now = if asked { self.slot(&grace).ok() } else { None };
            Interrupted::new(now, error)
        })
    }
}
