//! The wheel: where it stands, and how it turns.

use super::DEVICE;
use super::report::{FROM_WHEEL, Info, Position, ROOM, Request};
use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, FilterWheel, Identity, Interrupted, Origin, Setting, Value,
};
use crate::reply::ReplyError;
use crate::transport::{Transfer, Transfers};
use std::time::Duration;

/// Settings that the driver needs for a wheel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WheelSettings {
    /// How long an answer may take.
    pub reply_within: Duration,
    /// How often a turning wheel is asked where it is.
    pub poll: Duration,
    /// How long one slot may take; the wheel stops and aligns itself on each, about 2 s.
    pub slot_within: Duration,
    /// How long asking where it stands may take after a failed move: a call ends at most this long after its deadline.
    pub grace: Duration,
}

impl Default for WheelSettings {
    fn default() -> Self {
        Self {
            reply_within: Duration::from_secs(1),
            poll: Duration::from_millis(500),
            slot_within: Duration::from_secs(20),
            grace: Duration::from_secs(1),
        }
    }
}

/// A filter wheel. It turns one slot at a time, forwards, as that is all that is known to work.
#[derive(Debug)]
pub struct Wheel<T> {
    hid: T,
    settings: WheelSettings,
    info: Info,
    count: u8,
}

impl<T: Transfers> Wheel<T> {
    /// Asks the wheel who it is and how many slots it has. Nothing turns; a wheel that is still turning (it does when it is
    /// plugged in) is waited for.
    ///
    /// # Errors
    /// A wheel in its fault state; one that does not answer, or see [`DeviceError`].
    pub fn open(hid: T, settings: WheelSettings, deadline: &Deadline) -> Result<Self, DeviceError> {
        let info = Info { version: [0; 3], name: String::new() };
        let mut wheel = Self { hid, settings, info, count: 0 };
        wheel.info = wheel.ask(Request::Info, Info::parse, deadline)?;
        let position = wheel.position(deadline)?;
        wheel.count = position.count;
        wheel.wait(None, position, deadline)?;
        Ok(wheel)
    }

    /// The HID device.
    pub fn hid(&self) -> &T {
        &self.hid
    }

    /// The HID device; what is said on it behind the driver's back, the driver does not know.
    pub fn hid_mut(&mut self) -> &mut T {
        &mut self.hid
    }

    /// The HID device.
    pub fn into_hid(self) -> T {
        self.hid
    }

    fn tell(&mut self, request: Request, deadline: &Deadline) -> Result<(), DeviceError> {
        let data = request.emit().to_vec();
        let step = deadline.at_most(self.settings.reply_within);
        self.hid
            .transfer(&Transfer::FeatureSet { data }, &step)
            .map(|_| ())
            .map_err(|error| DeviceError::transport(DEVICE, error))
    }

    /// Asks, and once more if there is no answer, or none to that.
    fn ask<V>(
        &mut self,
        request: Request,
        parse: impl Fn(&[u8]) -> Result<V, ReplyError>,
        deadline: &Deadline,
    ) -> Result<V, DeviceError> {
        match self.ask_once(request, &parse, deadline) {
            Err(error) if may_ask_again(&error) && deadline.remaining().is_ok() => {
                self.ask_once(request, &parse, deadline)
            }
            done => done,
        }
    }

    fn ask_once<V>(
        &mut self,
        request: Request,
        parse: impl Fn(&[u8]) -> Result<V, ReplyError>,
        deadline: &Deadline,
    ) -> Result<V, DeviceError> {
        self.tell(request, deadline)?;
        let step = deadline.at_most(self.settings.reply_within);
        let get = Transfer::FeatureGet { report: FROM_WHEEL, length: ROOM };
        let report = self.hid.transfer(&get, &step);
        let report = report.map_err(|error| DeviceError::transport(DEVICE, error))?;
        parse(&report).map_err(|error| DeviceError::Protocol {
            device: DEVICE,
            reason: format!("the answer to {request:?}: {error}"),
        })
    }

    /// Where it says it stands.
    ///
    /// # Errors
    /// The wheel's fault state ([`DeviceError::Refused`] with the wheel's number), another number of slots than before, or see
    /// [`DeviceError`].
    pub fn position(&mut self, deadline: &Deadline) -> Result<Position, DeviceError> {
        let count = self.count;
        let known = |report: &[u8]| {
            let position = Position::parse(report)?;
            // A wheel does not grow slots: such a report is spoilt.
            if count != 0 && position.count != count {
                let found = format!("{} slots", position.count);
                return Err(ReplyError::new(&found, "as many slots as before"));
            }
            Ok(position)
        };
        let position = self.ask(Request::Position, known, deadline)?;
        if position.has_failed() {
            let [_, _, target] = position.slots;
            return Err(DeviceError::Refused {
                device: DEVICE,
                request: format!("slot {target}"),
                code: position.error.into(),
                reason: "it is in its fault state: free the wheel, cut its power and give it back",
            });
        }
        Ok(position)
    }

    /// Waits until it stands: on `wanted`, if given. One that already stands elsewhere has not begun to turn yet.
    fn wait(
        &mut self,
        wanted: Option<u8>,
        first: Position,
        deadline: &Deadline,
    ) -> Result<u8, DeviceError> {
        let mut position = first;
        loop {
            match position.arrived() {
                Some(slot) if wanted.is_none_or(|wanted| wanted == slot) => return Ok(slot),
                _ => {}
            }
            let waited = deadline.sleep(self.settings.poll).and_then(|()| deadline.remaining());
            waited.map_err(|expired| DeviceError::expired(DEVICE, "turning by a slot", expired))?;
            position = self.position(deadline)?;
        }
    }

    /// Turns by one slot, forwards.
    fn step(&mut self, from: u8, deadline: &Deadline) -> Result<u8, DeviceError> {
        let next = from % self.count + 1;
        self.tell(Request::Move(next), deadline)?;
        let step = deadline.at_most(self.settings.slot_within);
        let position = self.position(&step)?;
        self.wait(Some(next), position, &step)
    }

    fn turn(&mut self, slot: u8, deadline: &Deadline) -> Result<u8, DeviceError> {
        let position = self.position(deadline)?;
        let mut at = self.wait(None, position, deadline)?;
        while at != slot {
            at = self.step(at, deadline)?;
        }
        Ok(at)
    }
}

/// Whether the wheel said nothing, or something else; it has then done nothing.
fn may_ask_again(error: &DeviceError) -> bool {
    match error {
        DeviceError::Protocol { .. } => true,
        DeviceError::Transport { source, .. } => source.is_timeout(),
        _ => false,
    }
}

impl<T: Transfers> Device for Wheel<T> {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        self.info = self.ask(Request::Info, Info::parse, deadline)?;
        let [a, b, c] = self.info.version;
        Ok(Identity {
            vendor: "ZWO".into(),
            model: self.info.name.clone(),
            // The reports that are known hold none.
            serial: None,
            firmware: Some(format!("{a}.{b}.{c}")),
            driver: "efw",
        })
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let slot = self.slot(deadline)?;
        let read = |name, value| Setting { name, value, origin: Origin::ReadBack };
        Ok(vec![
            read("slots", Value::Integer(self.count.into())),
            read("slot", Value::Integer(slot.into())),
        ])
    }
}

impl<T: Transfers> FilterWheel for Wheel<T> {
    fn slots(&self) -> u32 {
        self.count.into()
    }

    /// The slot in the beam; a turning wheel is waited for.
    fn slot(&mut self, deadline: &Deadline) -> Result<u32, DeviceError> {
        let position = self.position(deadline)?;
        self.wait(None, position, deadline).map(u32::from)
    }

    fn select(&mut self, slot: u32, deadline: &Deadline) -> Result<u32, Interrupted<Option<u32>>> {
        let wanted = u8::try_from(slot).ok().filter(|slot| (1..=self.count).contains(slot));
        let Some(wanted) = wanted else {
            let [asked, most] = [slot, self.count.into()].map(f64::from);
            let error = DeviceError::OutOfRange { name: "slot", asked, least: 1.0, most };
            return Err(Interrupted::new(None, error));
        };
        self.turn(wanted, deadline).map(u32::from).map_err(|error| {
            let grace = deadline.grace(self.settings.grace);
            let at = self.position(&grace).ok().and_then(|position| position.arrived());
            Interrupted::new(at.map(u32::from), error)
        })
    }
}
