//! A simulated Zaber device with one axis, on the ASCII protocol.
//!
//! It is made after Zaber's protocol manual and what zaber-motion 10.3.0 asks for, which drives it in our tests.

use super::line::{Speaker, Turns};
use super::motor::{Ended, Motor};
use std::time::Duration;

/// Properties of the device.
#[derive(Debug, Clone, PartialEq)]
pub struct ZaberSettings {
    /// Address, 1 to 99.
    pub address: u8,
    /// Whether its replies have checksums (comm.checksum).
    pub checksums: bool,
    /// Whether it tells the end of a motion unasked (comm.alert).
    pub alerts: bool,
    /// Speed, microsteps/s.
    pub speed: i64,
    /// Where the reference is, microsteps from where it stands at first.
    pub reference: i64,
    /// Whether it has its reference at first, where it stands.
    pub referenced: bool,
    /// Position at the reference (limit.home.preset).
    pub preset: i32,
    /// How long it takes to answer.
    pub latency: Duration,
}

impl Default for ZaberSettings {
    /// Address 1, 20,000 microsteps a second, its reference 15,000 in reverse, with checksums.
    fn default() -> Self {
        Self {
            address: 1,
            checksums: true,
            alerts: false,
            speed: 20_000,
            reference: -15_000,
            referenced: false,
            preset: 0,
            latency: Duration::from_millis(3),
        }
    }
}

/// The device.
#[derive(Debug, Clone)]
pub struct Zaber {
    settings: ZaberSettings,
    motor: Motor,
    /// It answers nothing.
    pub dead: bool,
    /// It refuses motion with this reason.
    pub refuses: Option<&'static str>,
    flags: Vec<&'static str>,
    heard: Vec<u8>,
}

impl Zaber {
    /// A device that has just been switched on.
    pub fn new(settings: ZaberSettings) -> Self {
        let mut motor = Motor::new(settings.speed, settings.reference, None);
        if settings.referenced {
            motor.assume_reference();
        }
        Self { settings, motor, dead: false, refuses: None, flags: Vec::new(), heard: Vec::new() }
    }

    /// Where it stands, microsteps from where it stood when it was switched on: the truth for tests.
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

    /// Cuts the power and gives it back.
    pub fn power_cycle(&mut self) {
        self.motor.power_cycle();
        self.flags.clear();
    }

    fn advance(&mut self, now: Duration) -> Option<Ended> {
        let ended = self.motor.advance(now)?;
        if ended == Ended::Short {
            self.flags = vec!["FS"];
        }
        Some(ended)
    }

    /// All flags, the gravest first.
    fn all_flags(&self) -> Vec<&'static str> {
        let mut flags = self.flags.clone();
        if !self.motor.is_referenced() {
            flags.push("WR");
        }
        flags
    }

    fn counter(&self) -> i32 {
        let preset = if self.motor.is_referenced() { self.settings.preset } else { 0 };
        self.motor.counter().wrapping_add(preset)
    }

    fn emit(&self, first: char, body: &str) -> Vec<u8> {
        let sum = body.bytes().fold(0_u8, u8::wrapping_add).wrapping_neg();
        match self.settings.checksums {
            true => format!("{first}{body}:{sum:02X}\r\n").into_bytes(),
            false => format!("{first}{body}\r\n").into_bytes(),
        }
    }

    fn state(&self) -> String {
        let state = if self.motor.is_moving() { "BUSY" } else { "IDLE" };
        format!("{state} {}", self.all_flags().first().unwrap_or(&"--"))
    }

    /// The answer to one line, without its end.
    fn line(&mut self, line: &str, now: Duration) -> Option<Vec<u8>> {
        let body = line.trim_end_matches('\r').strip_prefix('/')?;
        let body = match body.rsplit_once(':') {
            Some((body, sum)) => {
                let right = body.bytes().fold(0_u8, u8::wrapping_add).wrapping_neg();
                let sum = u8::from_str_radix(sum, 16).ok().filter(|_| sum.len() == 2);
                // A message that the line spoilt is dropped.
                Some(body).filter(|_| sum == Some(right))?
            }
            None => body,
        };
        let mut words: Vec<&str> = body.split(' ').filter(|word| !word.is_empty()).collect();
        let mut number = |digits: usize| {
            let word = words.first()?;
            let good = word.len() <= digits && word.bytes().all(|byte| byte.is_ascii_digit());
            let value: u8 = word.parse().ok().filter(|_| good)?;
            words.remove(0);
            Some(value)
        };
        let device = number(2).unwrap_or(0);
        let axis = number(1).unwrap_or(0);
        let id = number(2);
        if device != 0 && device != self.settings.address {
            return None;
        }
        let done = if axis > 1 { Err("BADAXIS") } else { self.command(&words, axis, now) };
        let (flag, data) = match &done {
            Ok(data) => ("OK", data.as_str()),
            Err(reason) => ("RJ", *reason),
        };
        let id = id.map_or(String::new(), |id| format!(" {id:02}"));
        let address = self.settings.address;
        Some(self.emit('@', &format!("{address:02} {axis}{id} {flag} {} {data}", self.state())))
    }

    fn command(&mut self, words: &[&str], axis: u8, now: Duration) -> Result<String, &'static str> {
        let whole = |text: &str| text.parse::<i64>().map_err(|_| "BADDATA");
        if matches!(words.first(), Some(&"move" | &"home"))
            && let Some(reason) = self.refuses
        {
            return Err(reason);
        }
        Ok(match words {
            [] => "0".into(),
            ["get", "pos"] => self.counter().to_string(),
            ["get", "deviceid"] if axis == 0 => "50081".into(),
            ["get", "system.serial"] if axis == 0 => "12345".into(),
            ["get", "version"] if axis == 0 => "7.35".into(),
            ["get", "system.axiscount"] if axis == 0 => "1".into(),
            ["get", "comm.word.size.max"] => "50".into(),
            ["get", "comm.command.packets.max"] => "1".into(),
            ["get", "maxspeed"] => self.settings.speed.to_string(),
            ["warnings"] | ["warnings", "clear"] => {
                let flags = self.all_flags();
                if words.len() == 2 {
                    self.flags.clear();
                }
                let mut text = format!("{:02}", flags.len());
                for flag in flags {
                    text = format!("{text} {flag}");
                }
                text
            }
            ["home"] => {
                self.motor.search(now);
                self.flags.clear();
                "0".into()
            }
            ["move", "abs", to] => {
                let to = whole(to)?;
                if !self.motor.is_referenced() {
                    return Err("BADDATA");
                }
                self.motor.go(to - i64::from(self.settings.preset), now);
                self.flags.clear();
                "0".into()
            }
            ["move", "rel", by] => {
                let to = i64::from(self.motor.counter()) + whole(by)?;
                self.motor.go(to, now);
                "0".into()
            }
            ["stop"] => {
                self.motor.stop(now);
                "0".into()
            }
            _ => return Err("BADCOMMAND"),
        })
    }
}

impl Speaker for Zaber {
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)> {
        /// The longest line that it takes.
        const MOST: usize = 200;
        let _ = self.advance(now);
        let mut said = Vec::new();
        for byte in bytes {
            if *byte != b'\n' {
                self.heard.push(*byte);
                if self.heard.len() > MOST {
                    self.heard.clear();
                }
                continue;
            }
            let line = String::from_utf8_lossy(&std::mem::take(&mut self.heard)).into_owned();
            if let Some(answer) = self.line(&line, now)
                && !self.dead
            {
                said.push((now + self.settings.latency, answer));
            }
        }
        said
    }

    fn due(&self) -> Option<Duration> {
        self.motor.ends()
    }

    fn speak(&mut self, now: Duration) -> Vec<(Duration, Vec<u8>)> {
        let ended = self.advance(now);
        if ended.is_none() || self.dead || !self.settings.alerts {
            return Vec::new();
        }
        let alert = format!("{:02} 1 {}", self.settings.address, self.state());
        let information = format!("{:02} 0 a word", self.settings.address);
        vec![(now, self.emit('#', &information)), (now, self.emit('!', &alert))]
    }
}

impl Turns for Zaber {
    fn place_at(&self, now: Duration) -> i64 {
        self.motor.place_at(now)
    }
}
