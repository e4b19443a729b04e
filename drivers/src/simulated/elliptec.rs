//! A simulated Elliptec rotation mount (ELL14), on a line that it may share.
//!
//! It is made after Thorlabs' protocol manual as the packages elliptec 0.1.0 and pylablib 1.4.3 use it, and both drive it. How a
//! real one behaves during a move is not known to us: it can answer `GS09`, or nothing ([`ElliptecSettings::says_busy`]).

use super::line::{Speaker, Turns};
use super::motor::{Ended, Motor};
use std::time::Duration;

/// After this pause an unfinished command is forgotten.
const FORGETS: Duration = Duration::from_secs(2);
/// Time for which it tries to pass an obstacle.
const TRIES: Duration = Duration::from_millis(500);

/// Properties of the mount.
#[derive(Debug, Clone, PartialEq)]
pub struct ElliptecSettings {
    /// Address, 0 to 15.
    pub address: u8,
    /// Number of its model.
    pub model: u8,
    /// Travel, deg (or mm of another model).
    pub travel: u16,
    /// Pulses of a turn.
    pub pulses: u32,
    /// Speed, pulses/s.
    pub speed: i64,
    /// Where the reference is, pulses from where it stands at first.
    pub reference: i64,
    /// Whether it says that it is busy during a move; otherwise it says nothing.
    pub says_busy: bool,
    /// How long it takes to answer.
    pub latency: Duration,
}

impl Default for ElliptecSettings {
    /// An ELL14 at address 0 that turns once a second, its reference a quarter of a turn away.
    fn default() -> Self {
        Self {
            address: 0,
            model: 14,
            travel: 360,
            pulses: 143_360,
            speed: 143_360,
            reference: -35_840,
            says_busy: true,
            latency: Duration::from_millis(3),
        }
    }
}

/// Faults of the mount.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Trouble {
    /// It answers nothing.
    pub dead: bool,
    /// It does not begin a search.
    pub no_search: bool,
    /// Moves are answered with this state, and it stays where it is.
    pub refuses: Option<u8>,
}

/// The mount.
#[derive(Debug, Clone)]
pub struct Elliptec {
    settings: ElliptecSettings,
    /// Faults of the mount; may be changed while it runs.
    pub trouble: Trouble,
    motor: Motor,
    status: u8,
    speed_percent: u8,
    /// When it gives up at an obstacle.
    gives_up: Option<Duration>,
    heard: Vec<u8>,
    heard_at: Duration,
}

/// Digits behind a command, for each that it knows.
const COMMANDS: [(&[u8; 2], usize); 12] = [
    (b"in", 0),
    (b"gs", 0),
    (b"gp", 0),
    (b"gv", 0),
    (b"go", 0),
    (b"st", 0),
    (b"ho", 1),
    (b"ma", 8),
    (b"mr", 8),
    (b"sv", 2),
    (b"so", 8),
    (b"ca", 1),
];

impl Elliptec {
    /// A mount that has just been switched on.
    pub fn new(settings: ElliptecSettings) -> Self {
        let motor = Motor::new(settings.speed, settings.reference, None);
        Self {
            settings,
            trouble: Trouble::default(),
            motor,
            status: 0,
            speed_percent: 100,
            gives_up: None,
            heard: Vec::new(),
            heard_at: Duration::ZERO,
        }
    }

    /// Where it stands, pulses from where it stood when it was switched on: the truth for tests.
    pub fn place(&self) -> i64 {
        self.motor.place()
    }

    /// Whether it stands.
    pub fn is_standing(&self) -> bool {
        !self.motor.is_moving() && self.gives_up.is_none()
    }

    /// Puts something in its way, or takes it out.
    pub fn set_obstacle(&mut self, place: Option<i64>) {
        self.motor.obstacle = place;
    }

    /// Cuts the power and gives it back.
    pub fn power_cycle(&mut self) {
        self.motor.power_cycle();
        self.gives_up = None;
    }

    fn line(&self, text: &str) -> Vec<u8> {
        format!("{:X}{text}\r\n", self.settings.address).into_bytes()
    }

    fn position(&self) -> Vec<u8> {
        self.line(&format!("PO{:08X}", self.motor.counter()))
    }

    /// Lets it turn until `now`, and gives what it says about that.
    fn advance(&mut self, now: Duration) -> Option<Vec<u8>> {
        if self.gives_up.is_some_and(|at| at <= now) {
            self.gives_up = None;
            return Some(self.line("GS02"));
        }
        match self.motor.advance(now)? {
            Ended::There | Ended::Referenced => Some(self.position()),
            Ended::Short => {
                self.gives_up = Some(now + TRIES);
                None
            }
        }
    }

    /// Carries out a command for it.
    fn command(&mut self, name: &[u8], data: &str, now: Duration) -> Option<Vec<u8>> {
        let busy = !self.is_standing();
        if busy && name != b"st" {
            return self.settings.says_busy.then(|| self.line("GS09"));
        }
        let number = u32::from_str_radix(data, 16).unwrap_or(0);
        let moves = matches!(name, b"ho" | b"ma" | b"mr");
        if let Some(status) = self.trouble.refuses.filter(|_| moves) {
            return Some(self.line(&format!("GS{status:02X}")));
        }
        Some(match name {
            b"in" => {
                let ElliptecSettings { model, travel, pulses, .. } = self.settings;
                self.line(&format!("IN{model:02X}1140051920211601{travel:04X}{pulses:08X}"))
            }
            b"gs" => {
                let status = std::mem::take(&mut self.status);
                self.line(&format!("GS{status:02X}"))
            }
            b"gp" => self.position(),
            b"gv" => self.line(&format!("GV{:02X}", self.speed_percent)),
            b"go" => self.line("HO00000000"),
            b"sv" => match number {
                1..=100 => {
                    // At most 100.
                    self.speed_percent = number as u8;
                    self.motor.speed = self.settings.speed * i64::from(number) / 100;
                    self.line("GS00")
                }
                _ => self.line("GS04"),
            },
            b"st" => {
                self.motor.stop(now);
                self.gives_up = None;
                self.line("GS00")
            }
            b"ho" => {
                if !self.trouble.no_search {
                    self.motor.search(now);
                }
                return None;
            }
            b"ma" => {
                self.motor.go(number.cast_signed().into(), now);
                return None;
            }
            b"mr" => {
                let to = i64::from(self.motor.counter()) + i64::from(number.cast_signed());
                self.motor.go(to, now);
                return None;
            }
            _ => self.line("GS03"),
        })
    }

    /// The first whole command in what it heard: whether it is for it, the command and its digits. `None` if more has to come.
    fn take(&mut self) -> Option<(bool, [u8; 2], String)> {
        loop {
            let address = *self.heard.first()?;
            if !matches!(address, b'0'..=b'9' | b'A'..=b'F') {
                self.heard.remove(0);
                continue;
            }
            let name: [u8; 2] = self.heard.get(1..3)?.try_into().ok()?;
            let mine = char::from(address).to_digit(16) == Some(self.settings.address.into());
            let Some((_, digits)) = COMMANDS.iter().find(|(known, _)| **known == name) else {
                self.heard.drain(..1);
                // Others' commands that it does not know are no matter of its own.
                if mine && name.iter().all(u8::is_ascii_lowercase) {
                    self.heard.drain(..2);
                    return Some((true, *b"??", String::new()));
                }
                continue;
            };
            let end = 3 + digits;
            let given = self.heard.get(3..end.min(self.heard.len())).unwrap_or_default();
            if let Some(bad) = given.iter().position(|byte| !byte.is_ascii_hexdigit()) {
                self.heard.drain(..3 + bad);
                return Some((mine, *b"??", String::new()));
            }
            if self.heard.len() < end {
                return None;
            }
            let command: Vec<u8> = self.heard.drain(..end).collect();
            let data = String::from_utf8_lossy(command.get(3..).unwrap_or_default()).into_owned();
            return Some((mine, name, data));
        }
    }
}

impl Speaker for Elliptec {
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)> {
        if !self.heard.is_empty() && now.saturating_sub(self.heard_at) > FORGETS {
            self.heard.clear();
            self.status = 1;
        }
        self.heard_at = now;
        self.heard.extend_from_slice(bytes);
        let mut said = self.speak(now);
        while let Some((mine, name, data)) = self.take() {
            if !mine || self.trouble.dead {
                continue;
            }
            if let Some(line) = self.command(&name, &data, now) {
                said.push((now + self.settings.latency, line));
            }
        }
        said
    }

    fn due(&self) -> Option<Duration> {
        self.motor.ends().into_iter().chain(self.gives_up).min()
    }

    fn speak(&mut self, now: Duration) -> Vec<(Duration, Vec<u8>)> {
        let mut said = Vec::new();
        while let Some(due) = self.due().filter(|due| *due <= now) {
            if let Some(line) = self.advance(due) {
                said.push((now, line));
            }
        }
        let _ = self.advance(now);
        if self.trouble.dead { Vec::new() } else { said }
    }
}

impl Turns for Elliptec {
    fn place_at(&self, now: Duration) -> i64 {
        self.motor.place_at(now)
    }
}
