//! A simulated Standa 8SMC5 with one motor.
//!
//! It is made after the maker's description of the protocol (version 20.3, in libximc) and what libximc 2.14.30 and pylablib 1.4.3 ask for, which drive it in our tests.
//! Assumed, because no document that we have says it: that an unfinished command is forgotten after 400 ms, that an alarm ends every command of motion
//! with an error, that `zero` leaves the flag of a homed position.

use super::line::Speaker;
use super::motor::{Ended, Motor};
use crate::standa::message::{ALARM, HOME, HOMED, NAMED, Name, SLIPPED, checked, message};
use std::time::Duration;

/// After this pause an unfinished command is forgotten.
const FORGETS: Duration = Duration::from_millis(400);

/// Properties of the controller and its motor.
#[derive(Debug, Clone, PartialEq)]
pub struct StandaSettings {
    /// Kind of the motor: 1 DC, 3 stepper.
    pub kind: u8,
    /// Division of a step: 1 full steps, 2 halves, up to 9 for 256.
    pub mode: u8,
    /// Speed, counts/s.
    pub speed: i64,
    /// Where the reference is, counts from where it stands at first.
    pub reference: i64,
    /// Whether it has its reference at first, where it stands.
    pub referenced: bool,
    /// Whether its status tells that it has one, as newer firmware does.
    pub tells: bool,
    /// Serial number.
    pub serial: u32,
    /// Time that it takes to answer.
    pub latency: Duration,
}

impl Default for StandaSettings {
    /// A stepper with 256 microsteps of 100 steps a degree at 20°/s, its reference 15° in reverse.
    fn default() -> Self {
        Self {
            kind: 3,
            mode: 9,
            speed: 512_000,
            reference: -384_000,
            referenced: false,
            tells: true,
            serial: 12_345,
            latency: Duration::from_millis(3),
        }
    }
}

/// The controller. Its motor has an encoder: an obstacle raises an alarm.
#[derive(Debug, Clone)]
pub struct Standa {
    settings: StandaSettings,
    motor: Motor,
    /// It answers nothing.
    pub dead: bool,
    /// A home ends where it begins, with an error.
    pub no_search: bool,
    /// Place at which the counter is zero.
    origin: i64,
    /// Number of the last command of motion.
    command: u8,
    failed: bool,
    flags: u32,
    heard: Vec<u8>,
    heard_at: Duration,
}

/// Bytes of data behind each command that it knows.
const COMMANDS: [(&Name, usize); 19] = [
    (b"gent", 0),
    (b"geng", 0),
    (b"gets", 0),
    (b"gpos", 0),
    (b"gmov", 0),
    (b"geti", 0),
    (b"gser", 0),
    (b"gfwv", 0),
    (b"gsti", 0),
    (b"move", 12),
    (b"movr", 12),
    (b"spos", 20),
    (b"smov", 24),
    (b"zero", 0),
    (b"home", 0),
    (b"stop", 0),
    (b"sstp", 0),
    (b"pwof", 0),
    (b"loft", 0),
];

impl Standa {
    /// A controller that has just been switched on.
    pub fn new(settings: StandaSettings) -> Self {
        let mut motor = Motor::new(settings.speed, settings.reference, None);
        if settings.referenced {
            motor.assume_reference();
        }
        Self {
            settings,
            motor,
            dead: false,
            no_search: false,
            origin: 0,
            command: 0,
            failed: false,
            flags: 0,
            heard: Vec::new(),
            heard_at: Duration::ZERO,
        }
    }

    /// Where it stands, counts from where it stood when it was switched on: the truth for tests.
    pub fn place(&self) -> i64 {
        self.motor.place()
    }

    /// Whether it stands.
    pub fn is_standing(&self) -> bool {
        !self.motor.is_moving()
    }

    /// Puts something in its way, or takes it out.
    pub fn set_obstacle(&mut self, place: Option<i64>) {
        self.motor.obstacle = place;
    }

    /// Cuts the power and gives it back; its counter begins anew.
    pub fn power_cycle(&mut self) {
        self.motor.power_cycle();
        self.origin = self.motor.place();
        (self.command, self.failed, self.flags) = (0, false, 0);
        self.heard.clear();
    }

    fn microsteps(&self) -> i64 {
        match self.settings.kind {
            3 => 1 << (self.settings.mode.clamp(1, 9) - 1),
            _ => 1,
        }
    }

    fn advance(&mut self, now: Duration) {
        if self.motor.advance(now) == Some(Ended::Short) {
            self.failed = true;
            self.flags |= ALARM | SLIPPED;
        }
    }

    /// Begins a command of motion; whether it may.
    fn begin(&mut self, command: u8) -> bool {
        self.command = command;
        self.failed = self.flags & ALARM != 0;
        !self.failed
    }

    fn go(&mut self, place: i64, now: Duration) {
        let offset = self.motor.place() - i64::from(self.motor.counter());
        self.motor.go(place - offset, now);
    }

    /// Full steps and microsteps of a number of counts, as bytes.
    fn counts(&self, counts: i64) -> [u8; 6] {
        let divided = self.microsteps();
        // As the controller's own 32 bits.
        let [a, b, c, d] = ((counts / divided) as i32).to_le_bytes();
        let [e, f] = ((counts % divided) as i16).to_le_bytes();
        [a, b, c, d, e, f]
    }

    fn status(&self) -> Vec<u8> {
        let moving = self.motor.is_moving();
        let speed = if moving { self.motor.speed } else { 0 };
        let run = if moving { 0x80 } else { 0 };
        let failed = if self.failed && !moving { 0x40 } else { 0 };
        let homed = if self.settings.tells && self.motor.is_referenced() { HOMED } else { 0 };
        let mut data = vec![u8::from(moving) * 3, self.command | run | failed, 3, 4, 0];
        data.extend(self.counts(self.motor.place() - self.origin));
        data.extend(self.motor.place().to_le_bytes());
        data.extend(self.counts(speed));
        for value in [400_i16, 3600, 50, 500, 251] {
            data.extend(value.to_le_bytes());
        }
        data.extend((self.flags | homed | NAMED).to_le_bytes());
        data.extend(0_u32.to_le_bytes());
        data.extend([0; 5]);
        data
    }

    /// The data of the reply, or an error's letters.
    fn carry_out(&mut self, name: Name, data: &[u8], now: Duration) -> Result<Vec<u8>, Name> {
        let counts = || {
            let (steps, rest) = data.split_first_chunk::<4>()?;
            let (part, _) = rest.split_first_chunk::<2>()?;
            let (steps, part) = (i32::from_le_bytes(*steps), i16::from_le_bytes(*part));
            let divided = self.microsteps();
            let good = divided == 1 || i64::from(part).abs() < divided;
            let part = if divided == 1 { 0 } else { i64::from(part) };
            good.then_some(i64::from(steps) * divided + part)
        };
        let mut reply = Vec::new();
        match &name {
            b"gent" => reply = [&[self.settings.kind, 1][..], &[0; 6]].concat(),
            b"geng" => {
                reply = [&[0; 13][..], &[self.settings.mode, 200, 0], &[0; 12]].concat();
            }
            b"gets" => reply = self.status(),
            b"gpos" => {
                reply.extend(self.counts(self.motor.place() - self.origin));
                reply.extend(self.motor.place().to_le_bytes());
                reply.extend([0; 6]);
            }
            b"gmov" => {
                let [a, b, c, d, part, _] = self.counts(self.motor.speed);
                reply = [&[a, b, c, d, part, 232, 3, 232, 3][..], &[0; 15]].concat();
            }
            b"geti" => {
                reply = [&b"XIMCSM8SMC5-US"[..], &[2, 3, 8, 0], &[0; 12]].concat();
            }
            b"gser" => reply = self.settings.serial.to_le_bytes().into(),
            b"gfwv" => reply = vec![4, 7, 8, 0],
            b"gsti" => {
                reply = [&b"Standa"[..], &[0; 10], b"8MR190-2-28", &[0; 37]].concat();
            }
            b"move" | b"movr" => {
                let counts = counts().ok_or(*b"errv")?;
                let (number, from) = match &name {
                    b"move" => (1, self.origin),
                    _ => (2, self.motor.place()),
                };
                if self.begin(number) {
                    self.go(from + counts, now);
                }
            }
            b"home" => {
                if self.begin(HOME) {
                    self.failed = self.no_search;
                    if !self.no_search {
                        self.motor.search(now);
                    }
                }
            }
            b"stop" | b"sstp" => {
                self.motor.stop(now);
                (self.command, self.failed) = (if &name == b"stop" { 5 } else { 8 }, false);
                if &name == b"stop" {
                    self.flags = 0;
                }
            }
            b"zero" => self.origin = self.motor.place(),
            b"spos" => {
                let counts = counts().ok_or(*b"errv")?;
                // Flag 1: the position stays.
                if data.get(14).is_some_and(|flags| flags & 1 == 0) {
                    self.origin = self.motor.place() - counts;
                }
            }
            b"smov" => {
                let (steps, part) = match data {
                    [a, b, c, d, part, ..] => (u32::from_le_bytes([*a, *b, *c, *d]), *part),
                    _ => return Err(*b"errd"),
                };
                let speed = i64::from(steps) * self.microsteps() + i64::from(part);
                self.motor.speed = Some(speed).filter(|speed| *speed > 0).ok_or(*b"errv")?;
            }
            b"pwof" | b"loft" => {}
            _ => return Err(*b"errc"),
        }
        Ok(reply)
    }

    /// The first whole command in what it heard, carried out; the reply. `None` if more has to come.
    fn take(&mut self, now: Duration) -> Option<Vec<u8>> {
        if self.heard.first() == Some(&0) {
            self.heard.remove(0);
            return Some(vec![0]);
        }
        let name = *self.heard.first_chunk::<4>()?;
        let Some((_, count)) = COMMANDS.iter().find(|(known, _)| **known == name) else {
            self.heard.clear();
            return Some(b"errc".into());
        };
        let end = if *count == 0 { 4 } else { 4 + count + 2 };
        if self.heard.len() < end {
            return None;
        }
        let whole: Vec<u8> = self.heard.drain(..end).collect();
        let rest = whole.get(4..).unwrap_or_default();
        let data = if *count == 0 { Ok(rest) } else { checked(rest) };
        let done = match data {
            Ok(data) => self.carry_out(name, data, now),
            Err(_) => Err(*b"errd"),
        };
        Some(match done {
            Ok(data) => message(name, &data),
            Err(error) => {
                self.heard.clear();
                error.into()
            }
        })
    }
}

impl Speaker for Standa {
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)> {
        self.advance(now);
        if now.saturating_sub(self.heard_at) > FORGETS {
            self.heard.clear();
        }
        self.heard_at = now;
        self.heard.extend_from_slice(bytes);
        let mut said = Vec::new();
        while let Some(reply) = self.take(now) {
            if !self.dead {
                said.push((now + self.settings.latency, reply));
            }
        }
        said
    }
}
