//! A simulated SP2150 monochromator of Princeton Instruments (Acton).
//!
//! It is of the same sources as [the driver](crate::acton). It answers a `GOTO` at its end and hears nothing before. What
//! it says to a word that it does not know, and to a wavelength beyond its range, is a guess (that ends with `?`, as the sources say);
//! so are its speeds.

use super::line::Speaker;
use super::script::Script;
use std::time::Duration;

/// Properties of the instrument.
#[derive(Debug, Clone, PartialEq)]
pub struct Sp2150Settings {
    /// Model, as it names itself.
    pub model: String,
    /// Serial number.
    pub serial: String,
    /// Whether it echoes what it hears.
    pub echoes: bool,
    /// Grooves (1/mm) and blaze of the gratings, that of number 1 first.
    pub gratings: Vec<(u32, &'static str)>,
    /// Speed of `GOTO` with a grating of 1200 lines, nm/s.
    pub slew_nm_s: f64,
    /// How long a grating takes.
    pub grating_takes: Duration,
    /// How long it takes to answer.
    pub latency: Duration,
}

impl Default for Sp2150Settings {
    /// 1200 lines blazed at 500 nm and 600 at 1 µm, 60 nm/s, 20 s for a grating, with an echo.
    fn default() -> Self {
        Self {
            model: "SP-2-150i".into(),
            serial: "21531234".into(),
            echoes: true,
            gratings: vec![(1200, "500NM"), (600, "1.0UM")],
            slew_nm_s: 60.0,
            grating_takes: Duration::from_secs(20),
            latency: Duration::from_millis(10),
        }
    }
}

/// Fault at a line, named by its text without parameters (`GOTO`, `?NM`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// No answer.
    Silence,
    /// An answer later than it should be.
    Late(Duration),
    /// The first half of an answer.
    Half,
    /// This instead of an answer, and nothing done.
    Say(&'static str),
    /// It says that it did it, and stands where it stood.
    Idle,
}

/// A move from a place, with a speed.
#[derive(Debug, Clone, Copy)]
struct Leg {
    /// nm.
    from: f64,
    /// nm.
    to: f64,
    since: Duration,
    /// nm/s.
    speed: f64,
}

impl Leg {
    fn at(self, now: Duration) -> f64 {
        let way = self.to - self.from;
        let gone = now.saturating_sub(self.since).as_secs_f64() * self.speed;
        if gone >= way.abs() { self.to } else { self.from + gone * way.signum() }
    }

    fn end(self) -> Duration {
        self.since + Duration::from_secs_f64((self.to - self.from).abs() / self.speed)
    }
}

/// The instrument.
#[derive(Debug, Clone)]
pub struct Sp2150 {
    settings: Sp2150Settings,
    /// Faults that are to come.
    pub faults: Script<Kind>,
    heard: Vec<u8>,
    leg: Leg,
    busy_until: Duration,
    grating: usize,
    /// nm/min.
    speed: f64,
}

impl Sp2150 {
    /// An instrument that has been switched on, at 0 nm.
    pub fn new(settings: Sp2150Settings) -> Self {
        Self {
            settings,
            faults: Script::default(),
            heard: Vec::new(),
            leg: Leg { from: 0.0, to: 0.0, since: Duration::ZERO, speed: 1.0 },
            busy_until: Duration::ZERO,
            grating: 0,
            speed: 100.0,
        }
    }

    /// Where it stands, nm: the truth for tests.
    pub fn wavelength_nm(&self, now: Duration) -> f64 {
        self.leg.at(now)
    }

    /// Whether it moves.
    pub fn is_moving(&self, now: Duration) -> bool {
        now < self.leg.end().max(self.busy_until)
    }

    /// Number of the grating, from 1.
    pub fn grating(&self) -> usize {
        self.grating + 1
    }

    fn grooves(&self) -> f64 {
        f64::from(self.settings.gratings.get(self.grating).map_or(1200, |grating| grating.0))
    }

    /// Steps of the motor, nm.
    fn step(&self) -> f64 {
        0.005 * 1200.0 / self.grooves()
    }

    /// Sends it off; `None` beyond its range.
    fn drive(&mut self, nm: f64, speed: f64, now: Duration) -> Option<()> {
        let reach = 1400.0 * 1200.0 / self.grooves();
        if !(0.0..=reach).contains(&nm) {
            return None;
        }
        let to = (nm / self.step()).round() * self.step();
        self.leg = Leg { from: self.leg.at(now), to, since: now, speed };
        Some(())
    }

    fn list(&self) -> String {
        let mut list = String::from("\r\n");
        for number in 0..9 {
            let arrow = if number == self.grating { '\u{1a}' } else { ' ' };
            let about = match self.settings.gratings.get(number) {
                Some((grooves, blaze)) => format!("{grooves:>4} g/mm BLZ= {blaze:>6}"),
                None => "Not Installed    ".to_owned(),
            };
            list += &format!("{arrow}{}  {about} \r\n", number + 1);
        }
        list
    }

    /// Carries a word out; gives what it says, or `None` where it does not understand.
    fn word(&mut self, word: &str, parameter: Option<f64>, now: Duration) -> Option<String> {
        let nothing = Some(String::new());
        match (word, parameter) {
            ("GOTO" | "<GOTO>", Some(nm)) => {
                let speed = self.settings.slew_nm_s * 1200.0 / self.grooves();
                self.drive(nm, speed, now)?;
                self.busy_until = self.leg.end();
                nothing
            }
            ("NM" | "<NM>", Some(nm)) => {
                self.drive(nm, self.speed / 60.0, now)?;
                self.busy_until = self.leg.end();
                nothing
            }
            (">NM", Some(nm)) => self.drive(nm, self.speed / 60.0, now).map(|()| String::new()),
            ("MONO-STOP", None) => {
                let at = (self.leg.at(now) / self.step()).round() * self.step();
                self.leg = Leg { from: at, to: at, ..self.leg };
                nothing
            }
            ("MONO-?DONE", None) => Some(u8::from(now >= self.leg.end()).to_string()),
            ("?NM", None) => Some(format!("{:.3} nm", self.leg.at(now))),
            ("NM/MIN", Some(speed)) if speed > 0.0 && speed <= 2000.0 => {
                self.speed = speed;
                nothing
            }
            ("?NM/MIN", None) => Some(format!("{:.3} nm/min", self.speed)),
            ("GRATING", Some(number)) => {
                let installed = self.settings.gratings.len();
                let number = (1..=installed).find(|known| *known as f64 == number)?;
                self.busy_until = now + self.settings.grating_takes;
                self.grating = number - 1;
                let at = self.leg.at(now);
                self.leg = Leg { from: at, to: at, ..self.leg };
                nothing
            }
            ("?GRATING", None) => Some(self.grating().to_string()),
            ("?GRATINGS", None) => Some(self.list()),
            ("MODEL", None) => Some(self.settings.model.clone()),
            ("SERIAL", None) => Some(self.settings.serial.clone()),
            _ => None,
        }
    }

    /// Carries a line out: words with their parameters before them.
    fn line(&mut self, line: &str, now: Duration) -> Result<String, String> {
        let (mut said, mut parameter) = (String::new(), None);
        for word in line.split_whitespace() {
            if let Ok(number) = crate::reply::number(word) {
                parameter = Some(number);
                continue;
            }
            let name = word.to_ascii_uppercase();
            said += &self.word(&name, parameter.take(), now).ok_or_else(|| word.to_owned())?;
        }
        Ok(said)
    }

    fn answer(&mut self, line: &[u8], now: Duration) -> Option<(Duration, Vec<u8>)> {
        let line: String = line.iter().map(|byte| char::from(*byte)).collect();
        let words = line.split_whitespace().filter(|word| crate::reply::number(word).is_err());
        let fault = self.faults.at(&words.collect::<Vec<_>>().join(" "));
        let begin = now.max(self.busy_until);
        if fault == Some(Kind::Silence) {
            return None;
        }
        let echo = if self.settings.echoes { line.as_str() } else { "" };
        let answer = match fault {
            Some(Kind::Say(words)) => format!("{echo} {words}\r\n"),
            Some(Kind::Idle) => format!("{echo}  ok\r\n"),
            _ => match self.line(&line, begin) {
                Ok(said) => format!("{echo} {said}  ok\r\n"),
                Err(word) => format!("{echo} {word} ? \r\n"),
            },
        };
        let due = begin.max(self.busy_until) + self.settings.latency;
        let bytes: Vec<u8> = answer.chars().map(|c| u8::try_from(c).unwrap_or(b'?')).collect();
        Some(match fault {
            Some(Kind::Late(time)) => (due + time, bytes),
            Some(Kind::Half) => (due, bytes[..bytes.len() / 2].to_vec()),
            _ => (due, bytes),
        })
    }
}

impl Speaker for Sp2150 {
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)> {
        /// Most bytes that it remembers of a line without end.
        const MOST: usize = 128;
        let mut said = Vec::new();
        for byte in bytes {
            if *byte != b'\r' {
                self.heard.truncate(MOST);
                self.heard.push(*byte);
                continue;
            }
            let line = std::mem::take(&mut self.heard);
            said.extend(self.answer(&line, now));
        }
        said
    }
}
