//! A simulated Newport SMC100, in degrees, of 0.0001° a count.
//!
//! It is made after Newport's manual as open drivers have it. No program that we did not write has driven it.

use super::line::Speaker;
use super::motor::{Ended, Motor};
use std::time::Duration;

/// Counts of a degree.
const COUNTS: f64 = 10_000.0;

/// Properties of the controller.
#[derive(Debug, Clone, PartialEq)]
pub struct Smc100Settings {
    /// Address, 1 to 31.
    pub address: u8,
    /// Speed, counts/s.
    pub speed: i64,
    /// Where the reference is, counts from where it stands at first.
    pub reference: i64,
    /// Where the ends of its travel are, counts from where it stands at first.
    pub limits: Option<[i64; 2]>,
    /// Whether it has its reference at first, where it stands.
    pub referenced: bool,
    /// How long it takes to answer.
    pub latency: Duration,
}

impl Default for Smc100Settings {
    /// Address 1, 20 degrees a second, its reference 15 degrees in reverse.
    fn default() -> Self {
        Self {
            address: 1,
            speed: 200_000,
            reference: -150_000,
            limits: None,
            referenced: false,
            latency: Duration::from_millis(3),
        }
    }
}

/// The controller.
#[derive(Debug, Clone)]
pub struct Smc100 {
    settings: Smc100Settings,
    motor: Motor,
    /// It answers nothing.
    pub dead: bool,
    /// State that it says instead of its own.
    pub says: Option<u8>,
    error: char,
    bits: u16,
    heard: Vec<u8>,
}

impl Smc100 {
    /// A controller that has just been switched on.
    pub fn new(settings: Smc100Settings) -> Self {
        let mut motor = Motor::new(settings.speed, settings.reference, settings.limits);
        if settings.referenced {
            motor.assume_reference();
        }
        Self { settings, motor, dead: false, says: None, error: '@', bits: 0, heard: Vec::new() }
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

    /// Cuts the power and gives it back.
    pub fn power_cycle(&mut self) {
        self.motor.power_cycle();
        (self.error, self.bits) = ('@', 0);
    }

    fn state(&self) -> u8 {
        let own =
            match (self.motor.is_searching(), self.motor.is_moving(), self.motor.is_referenced()) {
                (true, ..) => 0x1e,
                (_, true, _) => 0x28,
                (_, _, true) => 0x33,
                _ => 0x0a,
            };
        self.says.unwrap_or(own)
    }

    fn advance(&mut self, now: Duration) {
        if self.motor.advance(now) == Some(Ended::Short) {
            let [low, high] = self.motor.at_limit();
            self.bits = if high {
                2
            } else if low {
                1
            } else {
                0x20
            };
        }
    }

    fn command(&mut self, name: &str, data: &str, now: Duration) -> Option<String> {
        let number: Option<f64> = data.parse().ok().filter(|n: &f64| n.is_finite());
        let state = self.state();
        match (name, data) {
            ("VE", "") => return Some(" SMC_CC_017".to_owned()),
            ("ID", "?") => return Some("URS100CC".to_owned()),
            ("VA", "?") => return Some(format!("{:.4}", self.motor.speed as f64 / COUNTS)),
            ("TP", "") => return Some(format!("{:.4}", f64::from(self.motor.counter()) / COUNTS)),
            ("TS", "") => return Some(format!("{:04X}{state:02X}", self.bits)),
            ("TE", "") => return Some(std::mem::replace(&mut self.error, '@').to_string()),
            ("ST", "") => self.motor.stop(now),
            ("OR", "") => match state {
                0x0a => {
                    self.bits = 0;
                    self.motor.search(now);
                }
                0x1e => self.error = 'L',
                0x28 => self.error = 'M',
                _ => self.error = 'K',
            },
            ("PA" | "PR", _) => match (state, number) {
                (0x33, Some(to)) if to.abs() < 100_000.0 => {
                    let from = if name == "PR" { self.motor.counter() } else { 0 };
                    self.bits = 0;
                    self.motor.go((to * COUNTS).round() as i64 + i64::from(from), now);
                }
                (0x33, _) => self.error = 'C',
                (0x0a, _) => self.error = 'H',
                (0x1e, _) => self.error = 'L',
                (0x28, _) => self.error = 'M',
                _ => self.error = 'D',
            },
            _ => self.error = 'A',
        }
        None
    }
}

impl Speaker for Smc100 {
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)> {
        /// The longest line that it takes.
        const MOST: usize = 80;
        self.advance(now);
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
            let Some(text) = line.strip_suffix('\r') else { continue };
            let letters = text.trim_start_matches(|c: char| c.is_ascii_digit());
            let address = text.get(..text.len() - letters.len());
            if address.and_then(|a| a.parse().ok()) != Some(self.settings.address) {
                continue;
            }
            let Some((name, data)) = letters.split_at_checked(2) else { continue };
            if let Some(answer) = self.command(name, data.trim(), now)
                && !self.dead
            {
                let question = format!("{}{name}{}", self.settings.address, data.trim());
                said.push((
                    now + self.settings.latency,
                    format!("{question}{answer}\r\n").into_bytes(),
                ));
            }
        }
        said
    }
}
