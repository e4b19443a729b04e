//! A simulated Newport ESP301 with one axis, in degrees, of 0.0001° a count.
//!
//! It is made after Newport's manual and pymeasure 0.16.0's `esp300.py`, which drives it in our tests.

use super::line::Speaker;
use super::motor::{Ended, Motor};
use std::collections::VecDeque;
use std::time::Duration;

/// Counts of a degree.
const COUNTS: f64 = 10_000.0;

/// Properties of the controller.
#[derive(Debug, Clone, PartialEq)]
pub struct Esp301Settings {
    /// Speed, counts/s.
    pub speed: i64,
    /// Where the reference is, counts from where it stands at first.
    pub reference: i64,
    /// Where its hardware limits are, counts from where it stands at first.
    pub limits: Option<[i64; 2]>,
    /// Number of the axis' unit; 7 is degrees.
    pub unit: u8,
    /// How long it takes to answer.
    pub latency: Duration,
}

impl Default for Esp301Settings {
    /// An axis that turns 20 degrees a second, its reference 15 degrees in reverse.
    fn default() -> Self {
        Self {
            speed: 200_000,
            reference: -150_000,
            limits: None,
            unit: 7,
            latency: Duration::from_millis(3),
        }
    }
}

/// The controller.
#[derive(Debug, Clone)]
pub struct Esp301 {
    settings: Esp301Settings,
    motor: Motor,
    /// It answers nothing.
    pub dead: bool,
    /// The motor cannot be switched on.
    pub no_power: bool,
    on: bool,
    target: f64,
    errors: VecDeque<u16>,
    heard: Vec<u8>,
}

impl Esp301 {
    /// A controller that has just been switched on, its motor off.
    pub fn new(settings: Esp301Settings) -> Self {
        let motor = Motor::new(settings.speed, settings.reference, settings.limits);
        let (errors, heard) = (VecDeque::new(), Vec::new());
        Self {
            settings,
            motor,
            dead: false,
            no_power: false,
            on: false,
            target: 0.0,
            errors,
            heard,
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

    /// Cuts the power and gives it back.
    pub fn power_cycle(&mut self) {
        self.motor.power_cycle();
        (self.on, self.target) = (false, 0.0);
    }

    fn fail(&mut self, code: u16) {
        // It keeps ten.
        if self.errors.len() < 10 {
            self.errors.push_back(code);
        }
    }

    fn advance(&mut self, now: Duration) {
        if self.motor.advance(now) == Some(Ended::Short) {
            let [low, high] = self.motor.at_limit();
            self.fail(if high {
                104
            } else if low {
                105
            } else {
                103
            });
        }
    }

    fn position(&self) -> f64 {
        f64::from(self.motor.counter()) / COUNTS
    }

    /// Carries out one command, and gives the answer.
    fn command(&mut self, text: &str, now: Duration) -> Option<String> {
        let text = text.trim().to_ascii_uppercase();
        let letters = text.trim_start_matches(|c: char| c.is_ascii_digit());
        let axis: Option<u8> = text.get(..text.len() - letters.len()).and_then(|a| a.parse().ok());
        let (name, data) = letters.split_at_checked(2)?;
        let message = |code: u16| match code {
            0 => "NO ERROR DETECTED",
            6 => "COMMAND DOES NOT EXIST",
            9 => "AXIS NUMBER OUT OF RANGE",
            37 => "AXIS NUMBER MISSING",
            38 => "COMMAND PARAMETER MISSING",
            101 => "AXIS-1 PARAMETER OUT OF RANGE",
            103 => "AXIS-1 FOLLOWING ERROR THRESHOLD EXCEEDED",
            104 => "AXIS-1 POSITIVE HARDWARE LIMIT DETECTED",
            105 => "AXIS-1 NEGATIVE HARDWARE LIMIT DETECTED",
            113 => "AXIS-1 MOTOR NOT ENABLED",
            _ => "AN ERROR",
        };
        match (name, data) {
            ("VE", "?" | "") => return Some("ESP301 Version 3.0.1 6/1/99".to_owned()),
            ("TE", "?" | "") => return Some(self.errors.pop_front().unwrap_or(0).to_string()),
            ("TB", "?" | "") => {
                let code = self.errors.pop_front().unwrap_or(0);
                return Some(format!("{code}, {}, {}", now.as_millis() / 400, message(code)));
            }
            ("ST", "") if axis.is_none() => {
                self.motor.stop(now);
                return None;
            }
            _ => {}
        }
        match axis {
            None => {
                self.fail(37);
                return None;
            }
            Some(1) => {}
            Some(_) => {
                self.fail(9);
                return None;
            }
        }
        let number: Option<f64> = data.parse().ok().filter(|n: &f64| n.is_finite());
        match (name, data) {
            ("ID", "?" | "") => return Some("URS75BPP, SN1263".to_owned()),
            ("TP", "?" | "") => return Some(format!("{:.4}", self.position())),
            ("MD", "?" | "") => return Some(u8::from(!self.motor.is_moving()).to_string()),
            ("MO", "?") => return Some(u8::from(self.on).to_string()),
            ("SN", "?") => return Some(self.settings.unit.to_string()),
            ("PA" | "DP", "?") => return Some(format!("{:.4}", self.target)),
            ("VA", "?") => return Some(format!("{:.4}", self.motor.speed as f64 / COUNTS)),
            ("SH", "?") => return Some("0.0000".to_owned()),
            ("MO", "") => self.on = !self.no_power,
            ("MF", "") => self.on = false,
            ("ST", "") => self.motor.stop(now),
            ("WS", _) => {}
            ("SN", _) => match number {
                Some(unit) if (0.0..=11.0).contains(&unit) => self.settings.unit = unit as u8,
                _ => self.fail(101),
            },
            ("PA" | "PR" | "OR", _) if !self.on => self.fail(113),
            ("PA" | "PR", _) => match number {
                Some(to) if to.abs() < 100_000.0 => {
                    let from = if name == "PR" { self.position() } else { 0.0 };
                    self.target = from + to;
                    self.motor.go((self.target * COUNTS).round() as i64, now);
                }
                Some(_) => self.fail(101),
                None => self.fail(38),
            },
            ("OR", "" | "0" | "1" | "2" | "3" | "4" | "5" | "6") => {
                self.target = 0.0;
                self.motor.search(now);
            }
            _ => self.fail(6),
        }
        None
    }
}

impl Speaker for Esp301 {
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)> {
        /// The longest line that it takes.
        const MOST: usize = 80;
        self.advance(now);
        let mut said = Vec::new();
        for byte in bytes {
            if !matches!(byte, b'\r' | b'\n') {
                self.heard.push(*byte);
                if self.heard.len() > MOST {
                    self.heard.clear();
                    self.fail(6);
                }
                continue;
            }
            let line = String::from_utf8_lossy(&std::mem::take(&mut self.heard)).into_owned();
            for text in line.split(';') {
                if let Some(answer) = self.command(text, now)
                    && !self.dead
                {
                    said.push((now + self.settings.latency, format!("{answer}\r\n").into_bytes()));
                }
            }
        }
        said
    }
}
