//! A simulated TMCL module with one motor, limit switches, a reference search, backlash, and faults of its own.
//!
//! The module's frames are those of [`trinamic::tmcl`](crate::trinamic::tmcl), which are checked against pytrinamic. How a module
//! behaves (a switch stops the motor and the position is never reached; the search ends at the left switch with the counter
//! at 0; an unfinished frame is forgotten after a pause) is as Trinamic's manuals describe it, not as measured on one.

use super::line::{Speaker, Turns};
use crate::trinamic::tmcl::{Axis, Command, Frame, LENGTH, Reply, Request, Status};
use std::collections::HashMap;
use std::time::Duration;

/// After this pause an unfinished frame is forgotten.
const FORGET: Duration = Duration::from_millis(20);

/// Properties of the module.
#[derive(Debug, Clone, PartialEq)]
pub struct ModuleSettings {
    /// Address of the module.
    pub address: u8,
    /// The host's address, which its replies carry.
    pub host: u8,
    /// Number and version of the module, as command 136 gives them.
    pub version: u32,
    /// A full step has 2 to this power microsteps.
    pub microstep_exponent: i32,
    /// Speed of moves at first, microsteps/s.
    pub speed: i32,
    /// Where the left and right switches close, microsteps from where it stands at first.
    pub switches: [i64; 2],
    /// How far the gear's output follows the motor late after a reversal, microsteps.
    pub backlash: i64,
    /// How long it takes to answer.
    pub latency: Duration,
}

impl Default for ModuleSettings {
    /// A TMCM-1110 with firmware 1.09 at address 1: 256 microsteps, 10,000 microsteps/s, switches a motor turn away on
    /// either side, no backlash, an answer after 10 ms (a frame at 9600 baud takes 9.4 ms).
    fn default() -> Self {
        Self {
            address: 1,
            host: 2,
            version: 1110 << 16 | 0x0109,
            microstep_exponent: 8,
            speed: 10_000,
            switches: [-51_200, 51_200],
            backlash: 0,
            latency: Duration::from_millis(10),
        }
    }
}

/// Faults of the module.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trouble {
    /// It does not answer requests whose sum is wrong, instead of saying so.
    pub silent_on_bad_checksum: bool,
    /// It answers this command (and kind, if given) with this status.
    pub refuse: Option<(Command, Option<u8>, Status)>,
    /// It answers nothing.
    pub dead: bool,
    /// The sums of its answers are wrong.
    pub bad_checksums: bool,
    /// The motor cannot pass this place in either direction, microsteps from where it stood at first.
    pub obstacle: Option<i64>,
    /// A search never ends.
    pub endless_search: bool,
}

/// A straight piece of motion.
#[derive(Debug, Clone, Copy)]
struct Leg {
    from: i64,
    to: i64,
    speed: i64,
    since: Duration,
}

impl Leg {
    fn at(&self, now: Duration) -> i64 {
        let way = self.to - self.from;
        let time = i128::try_from(now.saturating_sub(self.since).as_nanos()).unwrap_or(i128::MAX);
        let gone = (i128::from(self.speed).saturating_mul(time) / 1_000_000_000)
            .min(i128::from(way.abs()));
        // At most the way, which is 64 bits.
        self.from + way.signum() * (gone as i64)
    }
}

/// The module: requests in, replies out, and a motor that turns meanwhile.
#[derive(Debug, Clone)]
pub struct Module {
    settings: ModuleSettings,
    /// Faults of the module; may be changed while it runs.
    pub trouble: Trouble,
    parameters: HashMap<u8, i32>,
    /// Where the motor, and the gear's output behind it, stand: microsteps from where they stood at first.
    motor: i64,
    output: i64,
    /// The counter is the motor's place less this.
    offset: i64,
    target: i32,
    leg: Option<Leg>,
    searching: bool,
    heard: Vec<u8>,
    heard_at: Duration,
}

impl Module {
    /// A module that has just been switched on: it stands, and its counter is 0.
    pub fn new(settings: ModuleSettings) -> Self {
        let parameters = HashMap::from([
            (Axis::MaxSpeed.number(), settings.speed),
            (Axis::MaxAcceleration.number(), 10_000),
            (Axis::MaxCurrent.number(), 128),
            (Axis::StandbyCurrent.number(), 8),
            (Axis::RightLimitDisabled.number(), 0),
            (Axis::LeftLimitDisabled.number(), 0),
            (Axis::Microsteps.number(), settings.microstep_exponent),
            (Axis::SearchMode.number(), 1),
            (Axis::SearchSpeed.number(), 5_000),
            (Axis::SwitchSpeed.number(), 1_000),
        ]);
        Self {
            settings,
            trouble: Trouble::default(),
            parameters,
            motor: 0,
            output: 0,
            offset: 0,
            target: 0,
            leg: None,
            searching: false,
            heard: Vec::new(),
            heard_at: Duration::ZERO,
        }
    }

    /// Where the motor stands, microsteps from where it stood when the module was switched on.
    pub fn motor(&self) -> i64 {
        self.motor
    }

    /// Where the gear's output stands, which follows the motor by the backlash: the truth for tests.
    pub fn output(&self) -> i64 {
        self.output
    }

    /// The counter.
    pub fn counter(&self) -> i64 {
        self.motor - self.offset
    }

    /// Whether the motor stands.
    pub fn is_standing(&self) -> bool {
        self.leg.is_none()
    }

    /// Cuts the power and gives it back: counter and target are 0, the motor stands where it stood.
    pub fn power_cycle(&mut self) {
        let (motor, output) = (self.motor, self.output);
        *self = Self {
            motor,
            output,
            offset: motor,
            trouble: self.trouble.clone(),
            ..Self::new(self.settings.clone())
        };
    }

    fn parameter(&self, axis: Axis) -> i32 {
        self.parameters.get(&axis.number()).copied().unwrap_or(0)
    }

    /// Lets the motor turn until `now`.
    pub fn advance(&mut self, now: Duration) {
        let Some(leg) = self.leg else { return };
        self.motor = leg.at(now);
        // The output is pushed by the motor from below, and pulled from above with the backlash between.
        self.output = self.output.clamp(self.motor - self.settings.backlash, self.motor);
        if self.motor != leg.to {
            return;
        }
        self.leg = None;
        if self.searching && !self.trouble.endless_search && self.presses_left() {
            self.searching = false;
            self.offset = self.motor;
            self.target = 0;
        }
    }

    fn presses_left(&self) -> bool {
        self.motor <= self.settings.switches[0]
    }

    fn presses_right(&self) -> bool {
        self.motor >= self.settings.switches[1]
    }

    /// Sends the motor off; switches and obstacles end its way.
    fn drive(&mut self, to: i64, speed: i32, now: Duration) {
        let mut end = to;
        if end > self.motor && self.parameter(Axis::RightLimitDisabled) == 0 {
            end = end.min(self.settings.switches[1]).max(self.motor);
        }
        if end < self.motor && self.parameter(Axis::LeftLimitDisabled) == 0 {
            end = end.max(self.settings.switches[0]).min(self.motor);
        }
        if let Some(place) = self.trouble.obstacle
            && (self.motor.min(end)..=self.motor.max(end)).contains(&place)
        {
            end = place;
        }
        let speed = i64::from(speed);
        let leg = Leg { from: self.motor, to: end, speed, since: now };
        self.leg = (end != self.motor && speed > 0).then_some(leg);
    }

    /// Handles a frame of nine bytes that comes at `now`, and returns the module's reply; `None` for silence.
    pub fn handle(&mut self, bytes: &[u8], now: Duration) -> Option<[u8; LENGTH]> {
        self.advance(now);
        if self.trouble.dead {
            return None;
        }
        let request = match Frame::new(bytes) {
            Ok(frame) => Request::parse(&frame),
            Err(_) if self.trouble.silent_on_bad_checksum => return None,
            Err(_) => {
                let command = bytes.get(1).copied().unwrap_or(0).into();
                return Some(self.reply(command, Status::WrongChecksum, 0));
            }
        };
        if request.module != self.settings.address {
            return None;
        }
        let refuse = self.trouble.refuse.filter(|(command, kind, _)| {
            *command == request.command && kind.is_none_or(|kind| kind == request.kind)
        });
        let (status, value) = match refuse {
            Some((_, _, status)) => (status, 0),
            None => self.carry_out(&request, now),
        };
        Some(self.reply(request.command, status, value))
    }

    fn reply(&self, command: Command, status: Status, value: i32) -> [u8; LENGTH] {
        let (host, module) = (self.settings.host, self.settings.address);
        let mut bytes = *Reply { host, module, status, command, value }.emit().bytes();
        if self.trouble.bad_checksums {
            bytes[LENGTH - 1] ^= 0x55;
        }
        bytes
    }

    fn carry_out(&mut self, request: &Request, now: Duration) -> (Status, i32) {
        const DONE: Status = Status::Success;
        if request.motor != 0 && request.command != Command::Version {
            return (Status::InvalidValue, 0);
        }
        match (request.command, request.kind) {
            (Command::Version, 1) => (DONE, self.settings.version.cast_signed()),
            (Command::Stop, _) => {
                self.leg = None;
                self.searching = false;
                (DONE, 0)
            }
            (Command::Move, 0) => {
                self.searching = false;
                self.target = request.value;
                let to = i64::from(request.value) + self.offset;
                self.drive(to, self.parameter(Axis::MaxSpeed), now);
                (DONE, request.value)
            }
            (Command::Search, 0) => {
                self.searching = true;
                let far = self.settings.switches[0];
                self.drive(far, self.parameter(Axis::SearchSpeed), now);
                if self.leg.is_none() {
                    // It stands on the switch: a moment of search all the same.
                    let since = now;
                    self.leg = Some(Leg { from: far + 1, to: far, speed: 100, since });
                }
                (DONE, 0)
            }
            (Command::Search, 1) => {
                if self.searching {
                    self.leg = None;
                }
                self.searching = false;
                (DONE, 0)
            }
            (Command::Search, 2) => (DONE, i32::from(self.searching)),
            (Command::Get, kind) => self.get(kind),
            (Command::Set, kind) => self.set(kind, request.value),
            (Command::Move | Command::Search | Command::Version, _) => (Status::WrongType, 0),
            _ => (Status::InvalidCommand, 0),
        }
    }

    fn get(&self, kind: u8) -> (Status, i32) {
        let Some(axis) = Axis::ALL.into_iter().find(|axis| axis.number() == kind) else {
            return (Status::WrongType, 0);
        };
        let counter = i32::try_from(self.counter()).unwrap_or(i32::MAX);
        let value = match axis {
            Axis::TargetPosition => self.target,
            Axis::ActualPosition => counter,
            Axis::ActualSpeed => self.leg.map_or(0, |leg| {
                i32::try_from(leg.speed * (leg.to - leg.from).signum()).unwrap_or(i32::MAX)
            }),
            Axis::PositionReached => i32::from(!self.searching && counter == self.target),
            Axis::RightLimit => i32::from(self.presses_right()),
            Axis::LeftLimit => i32::from(self.presses_left()),
            stored => self.parameter(stored),
        };
        (Status::Success, value)
    }

    fn set(&mut self, kind: u8, value: i32) -> (Status, i32) {
        if !self.parameters.contains_key(&kind) {
            return (Status::WrongType, 0);
        }
        let range = if kind == Axis::Microsteps.number() { 0..=8 } else { 0..=i32::MAX };
        if !range.contains(&value) {
            return (Status::InvalidValue, 0);
        }
        self.parameters.insert(kind, value);
        (Status::Success, value)
    }
}

impl Speaker for Module {
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)> {
        if now.saturating_sub(self.heard_at) > FORGET {
            self.heard.clear();
        }
        self.heard_at = now;
        self.heard.extend_from_slice(bytes);
        let due = now + self.settings.latency;
        let mut said = Vec::new();
        while self.heard.len() >= LENGTH {
            let frame: Vec<u8> = self.heard.drain(..LENGTH).collect();
            said.extend(self.handle(&frame, now).map(|reply| (due, reply.to_vec())));
        }
        said
    }
}

impl Turns for Module {
    fn place_at(&self, now: Duration) -> i64 {
        self.leg.map_or(self.motor, |leg| leg.at(now))
    }
}
