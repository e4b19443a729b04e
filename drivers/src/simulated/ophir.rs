//! A simulated Ophir meter with a photodiode head, its removable filter, ranges, a zero to be found, and faults of its own.
//!
//! The layout of its answers is that of pymeasure's tests and of pylablib's parser, whose host drives it in our tests. How
//! it behaves beyond that (the time of zeroing, the words of `$ZQ` and `$AQ`) is made up.

use super::line::Speaker;
use super::power::{PowerSource, mean_w};
use super::script::Script;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::SplitMix64;
use std::fmt;
use std::time::Duration;

/// The part of the light that a PD300's filter lets through, as the simulated head has it.
pub const FILTER: f64 = 0.01;

/// The times of `$AQ`: names, and seconds.
const AVERAGING: [(&str, f64); 4] = [("NONE", 0.0), ("0.5s", 0.5), ("1s", 1.0), ("3s", 3.0)];

/// The wavelengths that a head knows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum HeadWavelengths {
    /// Any between two ends.
    Continuous {
        /// The ends, nm.
        range_nm: [u32; 2],
        /// The slots that the meter keeps, nm.
        slots: Vec<Option<u32>>,
    },
    /// Names only.
    Discrete(Vec<&'static str>),
}

/// Properties of the meter and its head.
#[derive(Debug, Clone, PartialEq)]
pub struct OphirSettings {
    /// The answer to `$II`: id, serial number, name.
    pub instrument: String,
    /// The answer to `$VE`.
    pub version: String,
    /// The answer to `$HI`; `XX` for no head.
    pub head: String,
    /// Ranges from the largest to the smallest.
    pub ranges: Vec<(&'static str, f64)>,
    /// Whether the meter lists dBm before `AUTO`.
    pub knows_dbm: bool,
    /// The wavelengths that the head knows.
    pub wavelengths: HeadWavelengths,
    /// The range that is set at first, by its number: −1 for `AUTO`, −2 for dBm.
    pub range: i32,
    /// Whether the filter is on the head: the truth, which the meter does not know.
    pub filter_is_on: bool,
    /// Power that the head shows in the dark before it is zeroed, W.
    pub dark_w: f64,
    /// How long it takes to answer.
    pub latency: Duration,
    /// How long zeroing takes.
    pub zeroing: Duration,
    /// Time from one measurement to the next, between which it tells the last one; zero for a meter that measures when it is asked.
    pub update: Duration,
    /// The largest part of that time by which one may be longer or shorter.
    pub update_jitter: f64,
}

impl Default for OphirSettings {
    /// A Vega with a PD300 without its filter, in the dark at zero, 350–1100 nm, seven ranges from 30 mW. It answers after
    /// 20 ms and measures 15 times a second, to within 5 % of that time.
    fn default() -> Self {
        Self {
            instrument: "VEGA 222222 VEGA".into(),
            version: "VG1.32".into(),
            head: "SI 123456 PD300 80000001".into(),
            ranges: vec![
                ("30.0mW", 30e-3),
                ("3.00mW", 3e-3),
                ("300uW", 300e-6),
                ("30.0uW", 30e-6),
                ("3.00uW", 3e-6),
                ("300nW", 300e-9),
                ("30.0nW", 30e-9),
            ],
            knows_dbm: false,
            wavelengths: HeadWavelengths::Continuous {
                range_nm: [350, 1100],
                slots: vec![Some(633), Some(532), Some(1064), None, None, None],
            },
            range: -1,
            filter_is_on: false,
            dark_w: 0.0,
            latency: Duration::from_millis(20),
            zeroing: Duration::from_secs(5),
            update: Duration::from_nanos(66_666_667),
            update_jitter: 0.05,
        }
    }
}

/// Faults at a command.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// The meter does not hear it.
    Silence,
    /// It does it, and answers so much later.
    Late(Duration),
    /// It does it, and the second half of its answer is lost.
    Half,
    /// It says this instead (`?COM ERROR`).
    Say(&'static str),
}

/// The meter.
pub struct Ophir {
    settings: OphirSettings,
    /// The light.
    source: Box<dyn PowerSource>,
    /// Faults of the meter, and the commands at which they occur.
    pub faults: Script<Kind>,
    heard: Vec<u8>,
    range: i32,
    slot: usize,
    believes_filter: bool,
    averaging: usize,
    mains: usize,
    zero_w: f64,
    zeroing: Option<Duration>,
    zeroed: bool,
    measured: Measured,
    told: Measured,
    /// End of the next measurement.
    next: Duration,
}

/// A measurement of the simulated meter: the truth for tests.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Measured {
    /// Number of the measurement, from 1.
    pub number: u64,
    /// When it ended, on the clock of the calls.
    pub at: Duration,
    /// The light on the head, W: the mean over the averaging time before `at`.
    pub light_w: f64,
}

impl fmt::Debug for Ophir {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Ophir").field("settings", &self.settings).finish_non_exhaustive()
    }
}

type Answer = Result<String, &'static str>;

impl Ophir {
    /// A meter that has just been switched on, under this light.
    pub fn new(settings: OphirSettings, source: impl PowerSource + 'static) -> Self {
        Self {
            range: settings.range,
            settings,
            source: Box::new(source),
            faults: Script::default(),
            heard: Vec::new(),
            slot: 0,
            believes_filter: false,
            averaging: 0,
            mains: 0,
            zero_w: 0.0,
            zeroing: None,
            zeroed: false,
            measured: Measured::default(),
            told: Measured::default(),
            next: Duration::ZERO,
        }
    }

    /// The wavelength in use, nm, of a continuous head: the truth for tests.
    pub fn wavelength_nm(&self) -> Option<u32> {
        match &self.settings.wavelengths {
            HeadWavelengths::Continuous { slots, .. } => slots.get(self.slot).copied().flatten(),
            HeadWavelengths::Discrete(_) => None,
        }
    }

    /// The name of the range that is set.
    pub fn range(&self) -> &str {
        match usize::try_from(self.range) {
            Ok(number) => self.settings.ranges.get(number).map_or("", |(name, _)| name),
            Err(_) if self.range == -1 => "AUTO",
            Err(_) => "dBm",
        }
    }

    /// The measurement that the last `$SP` told.
    pub fn told(&self) -> Measured {
        self.told
    }

    /// Measures every `period` from now on, as after a change of its mode.
    pub fn set_update(&mut self, period: Duration) {
        self.settings.update = period;
    }

    /// Goes on to the last measurement that has ended.
    fn measure(&mut self, now: Duration) -> Measured {
        /// More of them in a row that nobody has seen are not gone through.
        const MOST: u32 = 10_000;
        let period = self.settings.update;
        let (mut number, mut at) = (self.measured.number, self.measured.at);
        if period.is_zero() {
            (number, at) = (number + 1, now);
        } else if now > self.next + period * MOST {
            self.next = now;
        }
        while !period.is_zero() && self.next <= now {
            (number, at) = (number + 1, self.next);
            let mut random = SplitMix64::seed_from_u64(number);
            let part = self.settings.update_jitter * random.random_range(-1.0..=1.0);
            self.next += period.mul_f64(1.0 + part);
        }
        if number != self.measured.number {
            let window = Duration::from_secs_f64(AVERAGING[self.averaging].1);
            let light_w = mean_w(self.source.as_mut(), at, window);
            self.measured = Measured { number, at, light_w };
        }
        self.measured
    }

    /// Returns the power that the head gives, as the meter believes it, W; the mean over its averaging time.
    pub fn shown_w(&mut self, now: Duration) -> f64 {
        let light_w = self.measure(now).light_w;
        let diode_w = light_w * if self.settings.filter_is_on { FILTER } else { 1.0 };
        let shown_w = diode_w + self.settings.dark_w - self.zero_w;
        if self.believes_filter { shown_w / FILTER } else { shown_w }
    }

    fn power(&mut self, now: Duration) -> String {
        let shown_w = self.shown_w(now);
        self.told = self.measured;
        if self.range == -2 {
            return format!("{:.3}", 10.0 * (shown_w / 1e-3).log10());
        }
        let largest = self.settings.ranges.first().map_or(0.0, |(_, end)| *end);
        let place = usize::try_from(self.range).ok();
        let end = place.map_or(largest, |number| self.settings.ranges[number].1);
        if shown_w.abs() > end { "OVER".into() } else { format!("{shown_w:.3E}") }
    }

    fn set_range(&mut self, number: &str) -> Answer {
        let least = if self.settings.knows_dbm { -2 } else { -1 };
        let most = i32::try_from(self.settings.ranges.len()).unwrap_or(i32::MAX);
        let number = number.parse().ok().filter(|number| (least..most).contains(number));
        self.range = number.ok_or("BAD PARAM")?;
        Ok(String::new())
    }

    fn ranges(&self) -> String {
        let before: &[&str] = if self.settings.knows_dbm { &["dBm", "AUTO"] } else { &["AUTO"] };
        let names =
            before.iter().copied().chain(self.settings.ranges.iter().map(|(name, _)| *name));
        format!("{} {}", self.range, names.collect::<Vec<_>>().join(" "))
    }

    fn wavelengths(&self) -> String {
        let number = self.slot + 1;
        match &self.settings.wavelengths {
            HeadWavelengths::Discrete(names) => format!("DISCRETE {number} {}", names.join(" ")),
            HeadWavelengths::Continuous { range_nm: [least, most], slots } => {
                let slot = |slot: &Option<u32>| slot.map_or("NONE".into(), |nm| nm.to_string());
                let slots: Vec<String> = slots.iter().map(slot).collect();
                format!("CONTINUOUS {least} {most} {number} {}", slots.join(" "))
            }
        }
    }

    fn set_wavelength(&mut self, how: &str, argument: &str) -> Answer {
        let number = argument.parse::<u32>().ok();
        match (how, &mut self.settings.wavelengths) {
            ("WL", HeadWavelengths::Continuous { range_nm: ends, slots }) => {
                let nm = number.filter(|nm| (ends[0]..=ends[1]).contains(nm)).ok_or("BAD PARAM")?;
                *slots.get_mut(self.slot).ok_or("BAD PARAM")? = Some(nm);
            }
            ("WI", HeadWavelengths::Continuous { slots, .. }) => {
                let place = number.and_then(|number| usize::try_from(number).ok()?.checked_sub(1));
                let known = |place: &usize| slots.get(*place).copied().flatten().is_some();
                self.slot = place.filter(known).ok_or("BAD PARAM")?;
            }
            ("WW", HeadWavelengths::Discrete(names)) => {
                let place = names.iter().position(|name| *name == argument);
                self.slot = place.ok_or("BAD PARAM")?;
            }
            _ => return Err("BAD COMMAND"),
        }
        Ok(String::new())
    }

    /// Sets out of a list, if there is an argument, and tells what is set.
    fn choose(place: &mut usize, names: &[&str], argument: &str) -> Answer {
        if !argument.is_empty() {
            let number = argument.parse::<usize>().ok().and_then(|number| number.checked_sub(1));
            *place = number.filter(|place| *place < names.len()).ok_or("BAD PARAM")?;
        }
        Ok(format!("{} {}", *place + 1, names.join(" ")))
    }

    fn zero(&mut self, what: &str, now: Duration) -> Answer {
        if self.zeroing.is_some_and(|since| now.saturating_sub(since) >= self.settings.zeroing) {
            self.zeroing = None;
            self.zeroed = true;
            let raw_w =
                self.source.power_w(now) * if self.settings.filter_is_on { FILTER } else { 1.0 };
            self.zero_w = raw_w + self.settings.dark_w;
        }
        match what {
            "ZE" => self.zeroing = Some(now),
            "ZA" => self.zeroing = None,
            "ZS" => return Ok("SAVED".into()),
            _ => {
                let state = match (self.zeroing, self.zeroed) {
                    (Some(_), _) => "ZEROING IN PROGRESS",
                    (None, true) => "ZEROING COMPLETED",
                    (None, false) => "ZEROING NOT STARTED",
                };
                return Ok(state.into());
            }
        }
        Ok(String::new())
    }

    fn carry_out(&mut self, command: &str, now: Duration) -> Answer {
        let command = command.strip_prefix('$').ok_or("COM ERROR")?;
        let (name, argument) = command.split_at_checked(2).ok_or("COM ERROR")?;
        let argument = argument.trim();
        let has_head = !self.settings.head.starts_with("XX");
        let needs_head = ["SP", "AR", "RN", "WN", "GU", "SX", "AW", "WI", "WL", "WW", "FQ", "SI"];
        if !has_head && needs_head.contains(&name) {
            return Err("NO HEAD");
        }
        match name {
            "II" => Ok(self.settings.instrument.clone()),
            "VE" => Ok(self.settings.version.clone()),
            "HI" => Ok(self.settings.head.clone()),
            "HT" => Ok(self.settings.head.chars().take(2).collect()),
            "FP" | "MM" | "RE" => Ok(String::new()),
            "SP" => Ok(self.power(now)),
            "SI" => Ok(if self.range == -2 { "dBm" } else { "W" }.into()),
            "AR" => Ok(self.ranges()),
            "RN" => Ok(self.range.to_string()),
            "WN" => self.set_range(argument),
            "GU" => Ok(self.range.max(0).to_string()),
            "AW" => Ok(self.wavelengths()),
            "WL" | "WI" | "WW" => self.set_wavelength(name, argument),
            "FQ" => {
                let mut place = usize::from(self.believes_filter);
                let answer = Self::choose(&mut place, &["OUT", "IN"], argument);
                self.believes_filter = place == 1;
                answer
            }
            "AQ" => Self::choose(&mut self.averaging, &AVERAGING.map(|(name, _)| name), argument),
            "MA" => Self::choose(&mut self.mains, &["50Hz", "60Hz"], argument),
            "ZE" | "ZQ" | "ZA" | "ZS" => self.zero(name, now),
            "BC" => Ok("1".into()),
            "BR" => Ok("1 9600 19200 38400 300 1200 4800".into()),
            _ => Err("BAD COMMAND"),
        }
    }

    fn answer(&mut self, line: &[u8], now: Duration) -> Option<(Duration, Vec<u8>)> {
        let command = String::from_utf8_lossy(line).trim().to_owned();
        if command.is_empty() {
            return None;
        }
        let fault = self.faults.at(&command);
        if fault == Some(Kind::Silence) {
            return None;
        }
        let answer = match self.carry_out(&command, now) {
            Ok(body) => format!("*{body}\r\n"),
            Err(words) => format!("?{words}\r\n"),
        };
        let due = now + self.settings.latency;
        Some(match fault {
            Some(Kind::Late(time)) => (due + time, answer.into_bytes()),
            Some(Kind::Half) => (due, answer.as_bytes()[..answer.len() / 2].to_vec()),
            Some(Kind::Say(words)) => (due, format!("{words}\r\n").into_bytes()),
            _ => (due, answer.into_bytes()),
        })
    }
}

impl Speaker for Ophir {
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)> {
        /// Most bytes that a meter remembers of a line without end.
        const MOST: usize = 128;
        let mut said = Vec::new();
        for byte in bytes {
            if *byte != b'\n' {
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
