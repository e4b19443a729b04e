//! A simulated CM110 monochromator of Spectral Products.
//!
//! It is of the same sources as [the driver](crate::spectral_products), and takes more than that sends: steps, calibration, a
//! reset. It waits for the arguments of a command for ever, answers a slew when it is done, and hears nothing
//! before: what is sent meanwhile is done after. How fast it turns and how long a grating takes is a guess.

use super::line::Speaker;
use super::script::Script;
use std::time::Duration;

/// A grating.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grating {
    /// Grooves, 1/mm.
    pub grooves_per_mm: u16,
    /// Blaze, nm.
    pub blaze_nm: u16,
}

impl Grating {
    /// Largest wavelength that its angle reaches, tenths of a nanometre: the drive's is 1500 nm for 1200 lines.
    fn reach(self) -> i64 {
        15_000 * 1200 / i64::from(self.grooves_per_mm.max(1))
    }
}

/// Properties of the instrument.
#[derive(Debug, Clone, PartialEq)]
pub struct Cm110Settings {
    /// Serial number.
    pub serial: u16,
    /// Gratings, that of number 1 first.
    pub gratings: Vec<Grating>,
    /// Speed of a slew of a grating of 1200 lines, nm/s.
    pub slew_nm_s: f64,
    /// How long a grating takes.
    pub grating_takes: Duration,
    /// Unit after it was switched on: 0, 1 or 2.
    pub unit: u8,
    /// How long it takes to answer.
    pub latency: Duration,
}

impl Default for Cm110Settings {
    /// 1200 lines blazed at 500 nm and 600 at 1000 nm, 100 nm/s, 15 s for a grating, in nanometres.
    fn default() -> Self {
        Self {
            serial: 11_042,
            gratings: vec![
                Grating { grooves_per_mm: 1200, blaze_nm: 500 },
                Grating { grooves_per_mm: 600, blaze_nm: 1000 },
            ],
            slew_nm_s: 100.0,
            grating_takes: Duration::from_secs(15),
            unit: 1,
            latency: Duration::from_millis(5),
        }
    }
}

/// Fault at a command, named by its number (`16`, `56 0`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// No answer.
    Silence,
    /// An answer later than it should be.
    Late(Duration),
    /// The first half of an answer.
    Half,
    /// A status of this, and nothing done.
    Status(u8),
    /// The motor stands still half way, and the end is never told.
    Stuck,
}

/// The instrument.
#[derive(Debug, Clone)]
pub struct Cm110 {
    settings: Cm110Settings,
    /// Faults that are to come.
    pub faults: Script<Kind>,
    heard: Vec<u8>,
    /// Where the motor stands at the end of what it does, tenths of a nanometre of the present grating.
    motor: i64,
    /// Where the motor stood before, and when it began.
    from: (i64, Duration),
    /// Until when it moves.
    busy_until: Duration,
    /// Difference of the position that it believes from that of the motor, tenths of a nanometre.
    offset: i64,
    grating: usize,
    unit: u8,
    step: i8,
    dead: bool,
    calibrated: u32,
}

impl Cm110 {
    /// An instrument that has been switched on, at 0 nm.
    pub fn new(settings: Cm110Settings) -> Self {
        Self {
            faults: Script::default(),
            heard: Vec::new(),
            motor: 0,
            from: (0, Duration::ZERO),
            busy_until: Duration::ZERO,
            offset: 0,
            grating: 0,
            unit: settings.unit,
            step: 1,
            dead: false,
            calibrated: 0,
            settings,
        }
    }

    /// Where the motor stands, nm: the truth for tests.
    pub fn wavelength_nm(&self, now: Duration) -> f64 {
        let (from, since) = self.from;
        let whole = self.busy_until.saturating_sub(since).as_secs_f64();
        let part = now.saturating_sub(since).as_secs_f64() / whole.max(1e-9);
        (from as f64 + (self.motor - from) as f64 * part.min(1.0)) / 10.0
    }

    /// Whether it moves.
    pub fn is_moving(&self, now: Duration) -> bool {
        now < self.busy_until
    }

    /// Number of the grating, from 1.
    pub fn grating(&self) -> usize {
        self.grating + 1
    }

    /// How often it was told what its wavelength is.
    pub fn calibrated(&self) -> u32 {
        self.calibrated
    }

    fn installed(&self) -> Grating {
        self.settings
            .gratings
            .get(self.grating)
            .copied()
            .unwrap_or(Grating { grooves_per_mm: 1200, blaze_nm: 500 })
    }

    /// Tenths of a nanometre in its unit.
    fn scale(&self) -> i64 {
        match self.unit {
            0 => 100,
            1 => 10,
            _ => 1,
        }
    }

    fn slew(&mut self, to: i64, now: Duration) -> u8 {
        let reach = self.installed().reach();
        if to > reach {
            return 0x80;
        }
        if to < 0 {
            return 0xa0;
        }
        let to = to - self.offset;
        if to == self.motor {
            return 0x40;
        }
        // Coarser gratings turn as fast, over more wavelength.
        let speed = self.settings.slew_nm_s * 1200.0 / f64::from(self.installed().grooves_per_mm);
        let way_nm = (to - self.motor).abs() as f64 / 10.0;
        self.from = (self.motor, now);
        self.busy_until = now + Duration::from_secs_f64(way_nm / speed);
        self.motor = to;
        0
    }

    fn query(&self, number: u8) -> Option<u16> {
        let position = (self.motor + self.offset).max(0);
        let scale = self.scale();
        let value = match number {
            // It shows whole units.
            0 => (position + scale / 2) / scale,
            1 => 1,
            2 => i64::from(self.installed().grooves_per_mm),
            3 => i64::from(self.installed().blaze_nm),
            4 => self.grating() as i64,
            5 => 1000,
            6 => i64::from(self.step.cast_unsigned()),
            13 => self.settings.gratings.len() as i64,
            14 => i64::from(self.unit),
            19 => i64::from(self.settings.serial),
            _ => return None,
        };
        u16::try_from(value).ok()
    }

    /// Carries a whole command out; gives the number that it answers with, and the status.
    fn carry_out(&mut self, command: &[u8], now: Duration) -> (Option<u16>, u8) {
        let word = |high: u8, low: u8| i64::from(u16::from_be_bytes([high, low]));
        let scale = self.scale();
        let status = match *command {
            [16, high, low] => self.slew(word(high, low) * scale, now),
            [12, _, _, high, low] => self.slew(word(high, low) * scale, now),
            [18, high, low] => {
                self.offset = word(high, low) * scale - self.motor;
                self.calibrated += 1;
                0
            }
            [54] => self.slew(self.motor + self.offset + i64::from(self.step) * scale, now),
            [55, size] => {
                self.step = (size & 0x7f) as i8;
                if size > 0x80 {
                    self.step = -self.step;
                }
                0
            }
            [50, unit @ 0..=2] => {
                self.unit = unit;
                0
            }
            [50, _] => 0x80,
            [26, 0] => 0xa0,
            [26, number] if usize::from(number) <= self.settings.gratings.len() => {
                // It goes to the same wavelength with the other grating.
                self.grating = usize::from(number) - 1;
                self.motor = self.motor.min(self.installed().reach());
                self.from = (self.motor, now);
                self.busy_until = now + self.settings.grating_takes;
                0
            }
            [26, _] => 0x80,
            [255, 255, 255] => {
                self.offset = 0;
                self.unit = self.settings.unit;
                self.slew(0, now)
            }
            [56, number] => match self.query(number) {
                Some(value) => return (Some(value), 0),
                None => 0x80,
            },
            _ => 0x80,
        };
        (None, status)
    }

    /// Bytes of the command that begins so; `None` for a number that it does not know.
    fn length(first: u8) -> Option<usize> {
        Some(match first {
            27 | 54 | 1 | 7 => 1,
            26 | 50 | 51 | 52 | 55 | 56 => 2,
            13 | 16 | 18 | 255 => 3,
            12 => 5,
            _ => return None,
        })
    }

    fn answer(&mut self, command: &[u8], now: Duration) -> Option<(Duration, Vec<u8>)> {
        let name: Vec<String> = command.iter().map(u8::to_string).collect();
        let fault = self.faults.at(&name.join(" "));
        let begin = now.max(self.busy_until);
        if self.dead || fault == Some(Kind::Silence) {
            return None;
        }
        if command == [27] {
            return Some((begin + self.settings.latency, vec![27]));
        }
        let (value, status) = match fault {
            Some(Kind::Status(status)) => (None, status),
            _ => self.carry_out(command, begin),
        };
        if fault == Some(Kind::Stuck) {
            self.dead = true;
            self.motor = i64::midpoint(self.from.0, self.motor);
            return None;
        }
        let done = self.busy_until.max(begin) + self.settings.latency;
        let mut bytes = value.map_or(Vec::new(), |value| value.to_be_bytes().to_vec());
        bytes.extend([status | self.unit, 24]);
        Some(match fault {
            Some(Kind::Late(time)) => (done + time, bytes),
            Some(Kind::Half) => (done, bytes[..bytes.len() / 2].to_vec()),
            _ => (done, bytes),
        })
    }
}

impl Speaker for Cm110 {
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)> {
        let mut said = Vec::new();
        for byte in bytes {
            self.heard.push(*byte);
            let Some(length) = Self::length(self.heard[0]) else {
                // A number that is no command: passed over.
                self.heard.clear();
                continue;
            };
            if self.heard.len() == length {
                let command = std::mem::take(&mut self.heard);
                said.extend(self.answer(&command, now));
            }
        }
        said
    }
}
