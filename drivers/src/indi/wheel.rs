//! A filter wheel.

use super::client::Wanted;
use super::property::{Event, State, Vector};
use super::session::{Kind, Session, SessionSettings};
use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, FilterWheel, Identity, Interrupted, Origin, Setting, Value,
};
use crate::transport::{Bytes, TransportError};
use std::time::Duration;
use sunglint_numerics::measured::Interval;

const DEVICE: &str = "INDI filter wheel";
const SLOT: &str = "FILTER_SLOT";
const VALUE: &str = "FILTER_SLOT_VALUE";
const KIND: Kind =
    Kind { label: DEVICE, what: "filter wheel", interface: 1 << 4, required: &[SLOT] };
/// More slots than any wheel has.
const MOST_SLOTS: f64 = 1000.0;
/// Time in which what has come by itself is read, and the same from a server that never stops.
const READ: Duration = Duration::from_millis(2);
const READ_MOST: Duration = Duration::from_millis(50);

/// A filter wheel on an INDI server, or the wheel that a camera has within.
#[derive(Debug)]
pub struct Wheel<T> {
    session: Session<T>,
    slots: u32,
}

impl<T: Bytes> Wheel<T> {
    /// Connects to the wheel of that name.
    ///
    /// # Errors
    /// See [`DeviceError`]; [`DeviceError::Unknown`] if the server has none of that name ([`devices`](super::devices) lists them).
    pub fn open(
        line: T,
        device: &str,
        settings: SessionSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let mut wheel = Self { session: Session::new(line, device, KIND, settings), slots: 0 };
        wheel.session.define(deadline)?;
        wheel.read_slots()?;
        Ok(wheel)
    }

    /// Goes on over a new line to the server, from scratch; gives the old one.
    ///
    /// # Errors
    /// The errors of [`open`](Self::open).
    pub fn reconnect(&mut self, line: T, deadline: &Deadline) -> Result<T, DeviceError> {
        let old = self.session.client.replace_line(line);
        self.session.define(deadline)?;
        self.read_slots()?;
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

    /// The filters' names, that of slot 1 first, as the driver has them; empty if it has none.
    pub fn names(&self) -> Vec<String> {
        let Some(names) = self.session.property("FILTER_NAME") else { return Vec::new() };
        let text = |member: &super::property::Member| names.text(&member.name).map(str::to_owned);
        names.members.iter().filter_map(text).collect()
    }

    fn read_slots(&mut self) -> Result<(), DeviceError> {
        let range = self.session.require(SLOT)?.member(VALUE).and_then(|member| member.range);
        let range = range.map(Interval::to_array);
        match range {
            Some([least, most])
                if least == 1.0 && most.fract() == 0.0 && (1.0..=MOST_SLOTS).contains(&most) =>
            {
                self.slots = most as u32;
                Ok(())
            }
            found => Err(self.session.protocol(format!(
                "its slots are {found:?}, expected 1 to a number up to {MOST_SLOTS}"
            ))),
        }
    }

    fn slot_of(&self, vector: &Vector) -> Result<u32, DeviceError> {
        match vector.number(VALUE) {
            Some(slot) if slot.fract() == 0.0 && (1.0..=f64::from(self.slots)).contains(&slot) => {
                Ok(slot as u32)
            }
            found => Err(self
                .session
                .protocol(format!("its slot is {found:?}, expected 1 to {}", self.slots))),
        }
    }

    /// The slot in the beam by what was said last; `None` while it turns.
    fn stands(&self) -> Result<Option<u32>, DeviceError> {
        let now = self.session.require(SLOT)?;
        if now.state == State::Busy { Ok(None) } else { self.slot_of(now).map(Some) }
    }

    fn is_slot(&self, event: &Event) -> bool {
        matches!(event, Event::Changed(place, _) | Event::Defined(place)
            if place.device == self.session.device && place.name == SLOT)
    }

    fn turn_to(&mut self, slot: u32, deadline: &Deadline) -> Result<u32, DeviceError> {
        if !(1..=self.slots).contains(&slot) {
            let (asked, most) = (slot.into(), self.slots.into());
            return Err(DeviceError::OutOfRange { name: "slot", asked, least: 1.0, most });
        }
        let wanted = Wanted::Numbers(&[(VALUE, f64::from(slot))]);
        let after = self.session.change(SLOT, wanted, deadline)?;
        let got = self.slot_of(&after)?;
        if got != slot {
            let (asked, got) = (slot.to_string(), got.to_string());
            return Err(DeviceError::NotTaken { device: DEVICE, name: "slot", asked, got });
        }
        Ok(got)
    }
}

impl<T: Bytes> Device for Wheel<T> {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        self.session.identity()
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let slot = self.slot(deadline)?;
        let mut settings = vec![Setting {
            name: "slot",
            value: Value::Integer(slot.into()),
            origin: Origin::ReadBack,
        }];
        if let Some(name) = self.names().into_iter().nth(slot as usize - 1) {
            let value = Value::Text(name);
            settings.push(Setting { name: "filter", value, origin: Origin::ReadBack });
        }
        Ok(settings)
    }
}

impl<T: Bytes> FilterWheel for Wheel<T> {
    fn slots(&self) -> u32 {
        self.slots
    }

    fn names(&self) -> Vec<String> {
        Wheel::names(self)
    }

    fn slot(&mut self, deadline: &Deadline) -> Result<u32, DeviceError> {
        let soon = deadline.at_most(self.session.settings.answer_within);
        self.session.require(SLOT)?;
        let now = self.session.client.refresh(&self.session.device, SLOT, &soon)?;
        if now.state == State::Busy {
            let reason = "it is turning: no filter is in the beam";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        self.slot_of(&now)
    }

    /// Asks for the slot anew: what the server said before its answer has then come.
    fn look(&mut self, deadline: &Deadline) -> Result<Vec<Option<u32>>, DeviceError> {
        let soon = deadline.at_most(self.session.settings.answer_within);
        self.session.require(SLOT)?;
        let device = self.session.device.clone();
        let mut stood = self.heard(deadline)?;
        self.session.client.get_properties(Some((&device, Some(SLOT))), &soon)?;
        loop {
            let event = self.session.client.event(&soon)?;
            if matches!(&event, Event::Lost(lost) if *lost == device) {
                // Said as such.
                self.session.require(SLOT)?;
            }
            if self.is_slot(&event) {
                stood.push(self.stands()?);
                if matches!(event, Event::Defined(_)) {
                    return Ok(stood);
                }
            }
        }
    }

    fn heard(&mut self, deadline: &Deadline) -> Result<Vec<Option<u32>>, DeviceError> {
        let all = deadline.at_most(READ_MOST);
        let mut stood = Vec::new();
        loop {
            match self.session.client.event(&all.at_most(READ)) {
                Ok(event) if self.is_slot(&event) => stood.push(self.stands()?),
                Ok(_) => {}
                Err(DeviceError::Transport { source: TransportError::Timeout { .. }, .. }) => {
                    return Ok(stood);
                }
                Err(error) => return Err(error),
            }
        }
    }

    fn select(&mut self, slot: u32, deadline: &Deadline) -> Result<u32, Interrupted<Option<u32>>> {
        self.turn_to(slot, deadline).map_err(|error| {
            // A wheel that is still turning has no filter in the beam.
            let asked =
                !matches!(error, DeviceError::Awaited { .. } | DeviceError::Transport { .. });
            let grace = deadline.grace(self.session.settings.answer_within);
            let now = if asked { self.slot(&grace).ok() } else { None };
            Interrupted::new(now, error)
        })
    }
}
