//! A simulated ZWO filter wheel: reports as they were captured from a real one, and a wheel that turns meanwhile.
//!
//! While it turns, the first and third slot of its report are the target and the second is where it comes from, as in the
//! captured reports. A long jump ends in the fault state, as its describer saw (1 to 7 in one go).

use super::script::Script;
use crate::clock::Deadline;
use crate::transport::{Transfer, Transfers, TransportError};
use crate::zwo::report::{FROM_WHEEL, Info, Position, ROOM, Request, State};
use std::time::Duration;

/// Properties of the wheel.
#[derive(Debug, Clone, PartialEq)]
pub struct EfwSettings {
    /// Who it says it is.
    pub info: Info,
    /// How many slots it has.
    pub count: u8,
    /// Where it stands at first.
    pub slot: u8,
    /// How long a slot takes.
    pub per_slot: Duration,
    /// How long it takes to begin.
    pub begin: Duration,
    /// The longest jump that it masters, slots.
    pub longest_jump: u8,
}

impl Default for EfwSettings {
    /// The wheel that was captured: `EFW-S-0`, seven slots; 2 s a slot after 100 ms, jumps of up to five.
    fn default() -> Self {
        Self {
            info: Info { version: [3, 0, 9], name: "EFW-S-0".into() },
            count: 7,
            slot: 1,
            per_slot: Duration::from_secs(2),
            begin: Duration::from_millis(100),
            longest_jump: 5,
        }
    }
}

/// Faults at a request (`info`, `position`, `move`).
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// On the way to that slot it jams, and goes to its fault state.
    Jam,
    /// It turns and never arrives.
    Endless,
    /// It does not hear it.
    Deaf,
    /// It says this instead.
    Say(Vec<u8>),
    /// It says nothing.
    Silence,
    /// It is unplugged.
    Unplug,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Motion {
    Standing,
    Turning { to: u8, since: Duration, takes: Option<Duration> },
    Jammed { to: u8 },
}

/// The wheel: a transport for drivers.
#[derive(Debug, Clone)]
pub struct Efw {
    settings: EfwSettings,
    /// Faults of the wheel, and the requests at which they occur.
    pub faults: Script<Kind>,
    slot: u8,
    motion: Motion,
    asked: Option<Request>,
    answer: Option<Kind>,
    gone: bool,
}

impl Efw {
    /// A wheel that stands.
    pub fn new(settings: EfwSettings) -> Self {
        Self {
            slot: settings.slot,
            settings,
            faults: Script::default(),
            motion: Motion::Standing,
            asked: None,
            answer: None,
            gone: false,
        }
    }

    /// The slot in the beam; `None` while it turns or is jammed: the truth for tests.
    pub fn slot(&mut self, now: Duration) -> Option<u8> {
        self.advance(now);
        (self.motion == Motion::Standing).then_some(self.slot)
    }

    fn advance(&mut self, now: Duration) {
        if let Motion::Turning { to, since, takes: Some(takes) } = self.motion
            && now.saturating_sub(since) >= takes
        {
            self.slot = to;
            self.motion = Motion::Standing;
        }
    }

    fn drive(&mut self, to: u8, fault: Option<Kind>, now: Duration) {
        let known = (1..=self.settings.count).contains(&to);
        if !known || self.motion != Motion::Standing || fault == Some(Kind::Deaf) {
            return;
        }
        // Forwards only.
        let slots = (to + self.settings.count - self.slot) % self.settings.count;
        if fault == Some(Kind::Jam) || slots > self.settings.longest_jump {
            self.motion = Motion::Jammed { to };
            return;
        }
        let takes = self.settings.begin + self.settings.per_slot * u32::from(slots);
        let takes = (fault != Some(Kind::Endless)).then_some(takes);
        if slots > 0 {
            self.motion = Motion::Turning { to, since: now, takes };
        }
    }

    fn position(&self, now: Duration) -> Position {
        let (at, count) = (self.slot, self.settings.count);
        let (state, error, slots) = match self.motion {
            Motion::Standing => (State::Standing, 0, [at; 3]),
            Motion::Turning { since, .. } if now.saturating_sub(since) < self.settings.begin => {
                (State::Standing, 0, [at; 3])
            }
            Motion::Turning { to, .. } => (State::Moving, 0, [to, at, to]),
            Motion::Jammed { to } => (State::Fault, 12, [to, at, to]),
        };
        Position { state, error, slots, count }
    }

    fn hear(&mut self, data: &[u8], now: Duration) {
        let Some(request) = Request::parse(data) else { return };
        let fault = self.faults.at(match request {
            Request::Info => "info",
            Request::Position => "position",
            Request::Move(_) => "move",
        });
        if fault == Some(Kind::Unplug) {
            self.gone = true;
            return;
        }
        match request {
            Request::Move(to) => self.drive(to, fault, now),
            asked => {
                self.asked = Some(asked);
                self.answer = fault;
            }
        }
    }
}

impl Transfers for Efw {
    fn transfer(
        &mut self,
        transfer: &Transfer,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, TransportError> {
        deadline.remaining()?;
        let now = deadline.now();
        self.advance(now);
        if let Transfer::FeatureSet { data } = transfer
            && !self.gone
        {
            self.hear(data, now);
        }
        if self.gone {
            return Err(TransportError::disconnected("the simulated wheel"));
        }
        match transfer {
            Transfer::FeatureSet { .. } => Ok(Vec::new()),
            Transfer::FeatureGet { report: FROM_WHEEL, length: ROOM } => {
                match (self.answer.take(), self.asked) {
                    (Some(Kind::Say(report)), _) => Ok(report),
                    (Some(Kind::Silence), _) => loop {
                        deadline.sleep(Duration::from_secs(1))?;
                    },
                    (_, Some(Request::Info)) => Ok(self.settings.info.emit().to_vec()),
                    _ => Ok(self.position(now).emit().to_vec()),
                }
            }
            other => Err(TransportError::Unsupported {
                what: "the simulated wheel".to_owned(),
                transfer: other.to_string(),
            }),
        }
    }
}
