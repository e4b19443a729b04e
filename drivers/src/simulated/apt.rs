//! A simulated Thorlabs rotation stage on the APT protocol, with a reference, limit switches, and faults of its own.
//!
//! The stage's messages are those of [`thorlabs::apt`](crate::thorlabs::apt), which are checked against thorlabs-apt-protocol. How it
//! behaves (both moving bits set while it moves, as seen on K10CR1; the end of a move told unasked; silence after 50
//! messages about states without a sign of life of the host; its counter at zero after a search, lost with the power) is
//! as Thorlabs' document and other drivers describe it, not as measured on one.

use super::line::{Speaker, Turns};
use crate::thorlabs::apt::message::{Body, HEADER, HOST, Id, Message, StateBits, parse};
use std::time::Duration;

/// After this pause an unfinished message is forgotten.
const FORGET: Duration = Duration::from_millis(20);
/// Messages about states that it sends without a sign of life of the host.
const MOST_UNHEARD: u32 = 50;

/// Properties of the stage.
#[derive(Debug, Clone, PartialEq)]
pub struct AptSettings {
    /// Address of the stage.
    pub address: u8,
    /// Model of the stage, as it names itself (8 characters).
    pub model: String,
    /// Serial number of the stage.
    pub serial: u32,
    /// Whether it speaks as controllers of servo motors do.
    pub servo: bool,
    /// Speed of the stage, counts/s.
    pub speed: i64,
    /// Where the reference is, counts from where it stands at first.
    pub reference: i64,
    /// Where the reverse and forward limit switches close, counts from where it stands at first.
    pub limits: Option<[i64; 2]>,
    /// How far from its target a servo comes to rest, counts.
    pub error: i64,
    /// How long it takes to answer.
    pub latency: Duration,
}

impl Default for AptSettings {
    /// A K10CR1 that turns 10 degrees a second, its reference 15 degrees in reverse, answers after 3 ms.
    fn default() -> Self {
        Self {
            address: 0x50,
            model: "K10CR1".into(),
            serial: 55_123_456,
            servo: false,
            speed: 1_365_333,
            reference: -2_048_000,
            limits: None,
            error: 0,
            latency: Duration::from_millis(3),
        }
    }
}

/// Faults of the stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Trouble {
    /// It answers nothing.
    pub dead: bool,
    /// The motor cannot pass this place, counts from where it stood at first.
    pub obstacle: Option<i64>,
    /// A search never ends.
    pub endless_search: bool,
    /// It does not begin a search.
    pub no_search: bool,
    /// The channel cannot be switched on.
    pub disabled: bool,
    /// Moves are answered with a complaint.
    pub complains: bool,
}

#[derive(Debug, Clone, Copy)]
struct Leg {
    from: i64,
    to: i64,
    since: Duration,
    homing: bool,
}

/// The stage and its controller.
#[derive(Debug, Clone)]
pub struct Apt {
    settings: AptSettings,
    /// Faults of the stage; may be changed while it runs.
    pub trouble: Trouble,
    place: i64,
    /// The counter is the place less this.
    offset: i64,
    homed: bool,
    enabled: bool,
    leg: Option<Leg>,
    heard: Vec<u8>,
    heard_at: Duration,
    unheard: u32,
}

impl Apt {
    /// A stage that has just been switched on.
    pub fn new(settings: AptSettings) -> Self {
        Self {
            settings,
            trouble: Trouble::default(),
            place: 0,
            offset: 0,
            homed: false,
            enabled: true,
            leg: None,
            heard: Vec::new(),
            heard_at: Duration::ZERO,
            unheard: 0,
        }
    }

    /// Where it stands, counts from where it stood when it was switched on: the truth for tests.
    pub fn place(&self) -> i64 {
        self.place
    }

    /// Whether it stands.
    pub fn is_standing(&self) -> bool {
        self.leg.is_none()
    }

    /// Cuts the power and gives it back: it stands where it stood, and has forgotten where that is.
    pub fn power_cycle(&mut self) {
        let (place, trouble) = (self.place, self.trouble);
        *self = Self { place, offset: place, trouble, ..Self::new(self.settings.clone()) };
    }

    /// Lets it turn until `now`, and gives what it says about that.
    pub fn advance(&mut self, now: Duration) -> Option<Message> {
        let leg = self.leg?;
        self.place = self.place_at(now);
        if self.place != leg.to || (leg.homing && self.trouble.endless_search) {
            return None;
        }
        self.leg = None;
        if !leg.homing {
            self.unheard += 1;
            return Some(self.state(Id::MoveCompleted));
        }
        if self.place != self.settings.reference {
            return None;
        }
        self.offset = self.place;
        self.homed = true;
        Some(self.short(Id::Homed, 0))
    }

    /// Sends it off; switches and obstacles end its way.
    fn drive(&mut self, to: i64, homing: bool, now: Duration) {
        let mut end = to;
        if let Some([reverse, forward]) = self.settings.limits {
            end = end.clamp(reverse.min(self.place), forward.max(self.place));
        }
        if let Some(obstacle) = self.trouble.obstacle
            && (self.place.min(end)..=self.place.max(end)).contains(&obstacle)
        {
            end = obstacle;
        }
        self.leg = Some(Leg { from: self.place, to: end, since: now, homing });
    }

    fn short(&self, id: Id, second: u8) -> Message {
        Message::short(id, 1, second, HOST, self.settings.address)
    }

    fn state(&self, id: Id) -> Message {
        let mut bits = 0;
        let [reverse, forward] = self.settings.limits.unwrap_or([i64::MIN, i64::MAX]);
        for (bit, set) in [
            (StateBits::FORWARD_LIMIT, self.place >= forward),
            (StateBits::REVERSE_LIMIT, self.place <= reverse),
            (0x30, self.leg.is_some()),
            (StateBits::HOMING, self.leg.is_some_and(|leg| leg.homing)),
            (StateBits::HOMED, self.homed),
            (StateBits::ENABLED, self.enabled),
        ] {
            bits |= if set { bit } else { 0 };
        }
        // A counter of 32 bits runs over.
        let counter = (self.place - self.offset) as i32;
        let mut data = vec![1, 0];
        let alone = match id {
            Id::Counter => Some(counter.to_le_bytes()),
            Id::StatusBits => Some(u32::to_le_bytes(bits)),
            _ => None,
        };
        if let Some(alone) = alone {
            data.extend(alone);
            return Message::long(id, &data, HOST, self.settings.address);
        }
        data.extend(counter.to_le_bytes());
        data.extend(if self.settings.servo { 0_i32 } else { counter }.to_le_bytes());
        data.extend(bits.to_le_bytes());
        Message::long(id, &data, HOST, self.settings.address)
    }

    fn info(&self) -> Message {
        let mut data = vec![0; 84];
        data[..4].copy_from_slice(&self.settings.serial.to_le_bytes());
        for (to, from) in data[4..12].iter_mut().zip(self.settings.model.bytes()) {
            *to = from;
        }
        // Type 16, firmware 1.2.3, one channel.
        data[12] = 16;
        data[14..17].copy_from_slice(&[3, 2, 1]);
        data[82] = 1;
        Message::long(Id::Info, &data, HOST, self.settings.address)
    }

    fn parameters(&self, id: Id, first: i32, second: i32, third: i32) -> Message {
        let mut data = vec![1, 0];
        for value in [first, second, third] {
            data.extend(value.to_le_bytes());
        }
        Message::long(id, &data, HOST, self.settings.address)
    }

    fn complaint(&self, id: Id) -> Message {
        let mut data = vec![0; 68];
        data[..2].copy_from_slice(&(id as u16).to_le_bytes());
        data[2] = 12;
        let words = b"the channel is busy";
        data[4..4 + words.len()].copy_from_slice(words);
        Message::long(Id::RichResponse, &data, HOST, self.settings.address)
    }

    /// Handles a message that comes at `now`, and returns the messages that the stage sends.
    pub fn handle(&mut self, message: &Message, now: Duration) -> Vec<Message> {
        let mut said: Vec<Message> = self.advance(now).into_iter().collect();
        if self.trouble.dead {
            return Vec::new();
        }
        let second = match message.body {
            Body::Short(_, second) => second,
            Body::Long(_) => 0,
        };
        let general = matches!(message.id, Id::RequestInfo | Id::Alive | Id::NoFlashProgramming);
        if !general && message.channel() != 1 {
            return said;
        }
        let counts = self.settings.speed as i32;
        said.extend(match message.id {
            Id::RequestInfo => Some(self.info()),
            Id::RequestEnabled => {
                let on = self.enabled && !self.trouble.disabled;
                Some(self.short(Id::Enabled, if on { 1 } else { 2 }))
            }
            Id::RequestSpeeds => Some(self.parameters(Id::Speeds, 0, 20_000, counts)),
            Id::RequestHoming => Some(self.parameters(Id::Homing, 0x0001_0002, counts, 0)),
            Id::RequestCounter => self.told(Id::Counter),
            Id::RequestStatusBits => self.told(Id::StatusBits),
            Id::RequestStatus if !self.settings.servo => self.told(Id::Status),
            Id::RequestServoStatus if self.settings.servo => self.told(Id::ServoStatus),
            _ => self.carry_out(message, second, now),
        });
        said
    }

    fn told(&mut self, id: Id) -> Option<Message> {
        self.unheard += 1;
        (self.unheard <= MOST_UNHEARD).then(|| self.state(id))
    }

    fn carry_out(&mut self, message: &Message, second: u8, now: Duration) -> Option<Message> {
        match message.id {
            Id::Alive => self.unheard = 0,
            Id::SetEnabled if matches!(second, 1 | 2) => self.enabled = second == 1,
            Id::Home | Id::MoveAbsolute if self.trouble.complains => {
                return Some(self.complaint(message.id));
            }
            Id::Home if !self.trouble.no_search => {
                self.homed = false;
                self.drive(self.settings.reference, true, now);
            }
            Id::MoveAbsolute => {
                let target = message.long_at(2)?;
                let to = i64::from(target) + self.offset + self.settings.error;
                self.drive(to, false, now);
            }
            Id::StopMove => {
                self.leg = None;
                self.unheard += 1;
                return Some(self.state(Id::MoveStopped));
            }
            _ => {}
        }
        None
    }
}

impl Speaker for Apt {
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)> {
        if now.saturating_sub(self.heard_at) > FORGET {
            self.heard.clear();
        }
        self.heard_at = now;
        self.heard.extend_from_slice(bytes);
        let mut said = Vec::new();
        loop {
            match parse(&self.heard, self.settings.address) {
                Ok(Some((message, taken))) => {
                    self.heard.drain(..taken);
                    for answer in self.handle(&message, now) {
                        said.push((now + self.settings.latency, answer.emit()));
                    }
                }
                Ok(None) => return said,
                // What it does not understand it passes over.
                Err(_) => {
                    let header = self.heard.len().min(HEADER);
                    self.heard.drain(..header);
                }
            }
        }
    }
}

impl Turns for Apt {
    fn place_at(&self, now: Duration) -> i64 {
        let Some(leg) = self.leg else { return self.place };
        let way = leg.to - leg.from;
        let time = i128::try_from(now.saturating_sub(leg.since).as_nanos()).unwrap_or(i128::MAX);
        let gone = i128::from(self.settings.speed).saturating_mul(time) / 1_000_000_000;
        // At most the way, which is 64 bits.
        leg.from + way.signum() * gone.min(i128::from(way.abs())) as i64
    }
}
