//! A simulated Thorlabs power meter with a photodiode sensor: USBTMC messages, SCPI, ranges, a zero to be found, and faults
//! of its own.
//!
//! Questions and answers are laid out as in the makers' manuals. An answer that was not fetched stays in front of the next,
//! as the manuals warn; clearing the buffers takes it away.

use super::power::{PowerSource, mean_w};
use super::script::Script;
use crate::clock::Deadline;
use crate::transport::{Transfer, Transfers, TransportError};
use crate::usbtmc::{
    CHECK_CLEAR_STATUS, HEADER, IN, INITIATE_CLEAR, OUT, STATUS_PENDING, STATUS_SUCCESS,
};
use std::collections::VecDeque;
use std::fmt;
use std::time::Duration;
use sunglint_numerics::measured::Interval;

/// Properties of the meter and its sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Pm100Settings {
    /// The answer to `*IDN?`.
    pub instrument: String,
    /// The answer to `SYST:SENS:IDN?`.
    pub sensor: String,
    /// The ends of the ranges, W, from the smallest.
    pub ranges_w: Vec<f64>,
    /// The shortest and longest wavelength, nm.
    pub wavelengths_nm: Interval,
    /// Power that the sensor shows in the dark before it is zeroed, W.
    pub dark_w: f64,
    /// Whether a key has switched it to dBm.
    pub shows_dbm: bool,
    /// Complaints that wait from the start.
    pub complaints: Vec<&'static str>,
    /// How often it says that clearing its buffers is not done yet.
    pub clearing: u32,
    /// How long a measurement takes.
    pub measurement: Duration,
    /// How long zeroing takes.
    pub zeroing: Duration,
}

impl Default for Pm100Settings {
    /// A PM100D with an S120C, 400–1100 nm, six ranges to 50 mW, in the dark at zero, 3 ms a measurement.
    fn default() -> Self {
        Self {
            instrument: "Thorlabs,PM100D,P0000001,2.6.0".into(),
            sensor: "S120C,180101101,24-Jan-2018,1,18,289".into(),
            ranges_w: vec![500e-9, 5e-6, 50e-6, 500e-6, 5e-3, 50e-3],
            wavelengths_nm: Interval::new(400.0, 1100.0),
            dark_w: 0.0,
            shows_dbm: false,
            complaints: Vec::new(),
            clearing: 0,
            measurement: Duration::from_millis(3),
            zeroing: Duration::from_secs(1),
        }
    }
}

/// Faults at a question.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// There is no answer.
    Silence,
    /// The answer comes so much later.
    Late(Duration),
    /// The answer carries the tag before the request's.
    WrongTag,
    /// The second half of the message is lost.
    Short,
    /// The meter refuses the read until its endpoint is set going again.
    Stall,
    /// The answer comes in parts of four bytes.
    Parts,
    /// It says this instead.
    Say(&'static str),
}

/// The meter: a transport for drivers.
pub struct Pm100 {
    settings: Pm100Settings,
    source: Box<dyn PowerSource>,
    /// Faults of the meter, and the questions at which they occur.
    pub faults: Script<Kind>,
    complaints: VecDeque<&'static str>,
    wavelength_nm: f64,
    /// The range's place; `None` if the meter chooses.
    range: Option<usize>,
    averaging: u32,
    shows_dbm: bool,
    relative: bool,
    zero_w: f64,
    zeroing: Option<Duration>,
    /// Answer that waits to be fetched, and the time from which on it can be.
    answer: Vec<u8>,
    ready: Duration,
    fault: Option<Kind>,
    request: Option<(u8, usize)>,
    halted: bool,
    /// How often clearing is still to be asked for.
    clearing: u32,
}

impl fmt::Debug for Pm100 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pm100").field("settings", &self.settings).finish_non_exhaustive()
    }
}

const UNKNOWN: &str = "-113,\"Undefined header\"";
const OUT_OF_RANGE: &str = "-222,\"Data out of range\"";
const QUEUE: usize = 30;

impl Pm100 {
    /// A meter that has just been switched on, under this light.
    pub fn new(settings: Pm100Settings, source: impl PowerSource + 'static) -> Self {
        Self {
            source: Box::new(source),
            faults: Script::default(),
            complaints: settings.complaints.iter().copied().collect(),
            wavelength_nm: 635.0,
            range: None,
            averaging: 1,
            shows_dbm: settings.shows_dbm,
            relative: false,
            zero_w: 0.0,
            zeroing: None,
            answer: Vec::new(),
            ready: Duration::ZERO,
            fault: None,
            request: None,
            halted: false,
            clearing: 0,
            settings,
        }
    }

    /// The wavelength in use, nm: the truth for tests.
    pub fn wavelength_nm(&self) -> f64 {
        self.wavelength_nm
    }

    /// Returns the power that the sensor gives, W: the mean over its measurements.
    pub fn shown_w(&mut self, now: Duration) -> f64 {
        let window = self.settings.measurement * (self.averaging - 1);
        mean_w(self.source.as_mut(), now, window) + self.settings.dark_w - self.zero_w
    }

    fn range_w(&mut self, now: Duration) -> f64 {
        let last = self.settings.ranges_w.last().copied().unwrap_or(0.0);
        let ends = self.settings.ranges_w.clone();
        match self.range {
            Some(place) => ends.get(place).copied().unwrap_or(last),
            None => {
                let shown = self.shown_w(now).abs();
                ends.into_iter().find(|end| *end >= shown).unwrap_or(last)
            }
        }
    }

    fn power(&mut self, now: Duration) -> String {
        let shown_w = self.shown_w(now);
        if shown_w.abs() > self.range_w(now) {
            return "9.90000000E+37".into();
        }
        let shown = if self.shows_dbm { 10.0 * (shown_w / 1e-3).log10() } else { shown_w };
        format!("{shown:.8E}")
    }

    fn end_zeroing(&mut self, now: Duration) {
        if self.zeroing.is_some_and(|since| now.saturating_sub(since) >= self.settings.zeroing) {
            self.zeroing = None;
            self.zero_w = self.source.power_w(now) + self.settings.dark_w;
        }
    }

    fn ask(&mut self, question: &str, argument: &str, now: Duration) -> Option<String> {
        let [shortest, longest] = self.settings.wavelengths_nm.to_array();
        let ends = (self.settings.ranges_w.first(), self.settings.ranges_w.last());
        let number = |value: f64| format!("{value:.6E}");
        Some(match (question, argument) {
            ("*IDN?", "") => self.settings.instrument.clone(),
            ("SYST:SENS:IDN?" | "SYST:SENSOR:IDN?", "") => self.settings.sensor.clone(),
            ("SYST:ERR?", "") => self.complaints.pop_front().unwrap_or("0,\"No error\"").to_owned(),
            ("MEAS:POW?", "") => self.power(now),
            ("SENS:CORR:WAV?", "") => number(self.wavelength_nm),
            ("SENS:CORR:WAV?", "MIN") => number(shortest),
            ("SENS:CORR:WAV?", "MAX") => number(longest),
            ("SENS:POW:RANG?", "") => number(self.range_w(now)),
            ("SENS:POW:RANG?", "MIN") => number(*ends.0?),
            ("SENS:POW:RANG?", "MAX") => number(*ends.1?),
            ("SENS:POW:RANG:AUTO?", "") => u8::from(self.range.is_none()).to_string(),
            ("SENS:POW:UNIT?", "") => if self.shows_dbm { "DBM" } else { "W" }.to_owned(),
            ("SENS:POW:REF:STAT?", "") => u8::from(self.relative).to_string(),
            ("SENS:AVER:COUN?", "") => self.averaging.to_string(),
            ("SENS:CORR:LOSS:INP:MAGN?", "") => number(0.0),
            ("SENS:CORR:COLL:ZERO:STAT?", "") => {
                self.end_zeroing(now);
                u8::from(self.zeroing.is_some()).to_string()
            }
            _ => return None,
        })
    }

    fn tell(&mut self, command: &str, argument: &str, now: Duration) -> Result<(), &'static str> {
        let number = argument.parse::<f64>().ok();
        let flag = match argument {
            "0" | "OFF" => Some(false),
            "1" | "ON" => Some(true),
            _ => None,
        };
        let [shortest, longest] = self.settings.wavelengths_nm.to_array();
        match command {
            "SENS:CORR:WAV" => {
                let nm = number.filter(|nm| (shortest..=longest).contains(nm));
                self.wavelength_nm = nm.ok_or(OUT_OF_RANGE)?;
            }
            "SENS:POW:RANG" => {
                let asked = number.ok_or(OUT_OF_RANGE)?;
                let mut ends = self.settings.ranges_w.iter();
                let place = ends.position(|end| *end >= asked * (1.0 - 1e-9));
                self.range = Some(place.ok_or(OUT_OF_RANGE)?);
            }
            "SENS:POW:RANG:AUTO" => {
                let last = self.settings.ranges_w.len() - 1;
                self.range = if flag.ok_or(OUT_OF_RANGE)? { None } else { Some(last) };
            }
            "SENS:POW:UNIT" => match argument {
                "W" => self.shows_dbm = false,
                "DBM" => self.shows_dbm = true,
                _ => return Err(OUT_OF_RANGE),
            },
            "SENS:POW:REF:STAT" => self.relative = flag.ok_or(OUT_OF_RANGE)?,
            "SENS:AVER:COUN" => {
                let count = argument.parse().ok().filter(|count| (1..=3000).contains(count));
                self.averaging = count.ok_or(OUT_OF_RANGE)?;
            }
            "SENS:CORR:COLL:ZERO:INIT" => self.zeroing = Some(now),
            "SENS:CORR:COLL:ZERO:ABOR" => self.zeroing = None,
            _ => return Err(UNKNOWN),
        }
        Ok(())
    }

    fn hear(&mut self, line: &str, now: Duration) {
        let line = line.trim();
        let upper = line.to_ascii_uppercase();
        let (command, argument) = upper.split_once(' ').unwrap_or((&upper, ""));
        let fault = self.faults.at(line);
        if !command.ends_with('?') {
            if let Err(complaint) = self.tell(command, argument.trim(), now) {
                self.complain(complaint);
            }
            return;
        }
        let answer = self.ask(command, argument.trim(), now);
        let answer = match (&fault, answer) {
            (Some(Kind::Silence), _) => return,
            (Some(Kind::Say(words)), _) => (*words).to_owned(),
            (_, Some(answer)) => answer,
            (_, None) => return self.complain(UNKNOWN),
        };
        let takes = match &fault {
            Some(Kind::Late(time)) => *time,
            _ if command == "MEAS:POW?" => self.settings.measurement * self.averaging,
            _ => Duration::from_millis(1),
        };
        self.ready = now + takes;
        self.fault = fault;
        self.answer.extend(answer.bytes());
        self.answer.push(b'\n');
    }

    fn complain(&mut self, complaint: &'static str) {
        if self.complaints.len() < QUEUE {
            self.complaints.push_back(complaint);
        }
    }

    fn message_out(&mut self, data: &[u8], now: Duration) {
        let Some((head, rest)) = data.split_first_chunk::<HEADER>() else { return };
        let length = u32::from_le_bytes([head[4], head[5], head[6], head[7]]) as usize;
        match head[0] {
            OUT => {
                let payload = rest.get(..length).unwrap_or(rest);
                self.hear(&String::from_utf8_lossy(payload), now);
            }
            IN => self.request = Some((head[1], length)),
            _ => {}
        }
    }

    fn message_in(&mut self, room: usize, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        let waits = |deadline: &Deadline| loop {
            if let Err(expired) = deadline.sleep(Duration::from_secs(1)) {
                return TransportError::from(expired);
            }
        };
        let Some((tag, most)) = self.request else { return Err(waits(deadline)) };
        if self.answer.is_empty() {
            return Err(waits(deadline));
        }
        deadline.sleep(self.ready.saturating_sub(deadline.now()))?;
        self.request = None;
        let most = if self.fault == Some(Kind::Parts) { most.min(4) } else { most };
        let part: Vec<u8> = self.answer.drain(..most.min(self.answer.len())).collect();
        let tag = if self.fault == Some(Kind::WrongTag) { tag.wrapping_sub(1) } else { tag };
        let mut message = vec![IN, tag, !tag, 0];
        message.extend((part.len() as u32).to_le_bytes());
        message.extend([u8::from(self.answer.is_empty()), 0, 0, 0]);
        message.extend(part);
        message.resize(message.len().next_multiple_of(4), 0);
        if self.fault == Some(Kind::Short) {
            message.truncate(message.len() / 2);
        }
        if self.answer.is_empty() {
            self.fault = None;
        }
        message.truncate(room);
        Ok(message)
    }

    fn clear(&mut self) {
        self.clearing = self.settings.clearing;
        self.answer.clear();
        self.request = None;
        self.fault = None;
    }
}

impl Transfers for Pm100 {
    fn transfer(
        &mut self,
        transfer: &Transfer,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, TransportError> {
        deadline.remaining()?;
        let stalled = || TransportError::Stalled { transfer: transfer.to_string() };
        match transfer {
            Transfer::BulkOut { data, .. } => {
                self.message_out(data, deadline.now());
                Ok(Vec::new())
            }
            Transfer::BulkIn { .. } if self.halted => Err(stalled()),
            Transfer::BulkIn { .. } if self.fault == Some(Kind::Stall) => {
                self.fault = None;
                self.halted = true;
                Err(stalled())
            }
            // What is left while it clears, in a short packet.
            Transfer::BulkIn { .. } if self.clearing > 0 => Ok(vec![0; 4]),
            Transfer::BulkIn { length, .. } => self.message_in(*length, deadline),
            Transfer::ClearHalt { endpoint } => {
                if endpoint & 0x80 != 0 {
                    self.halted = false;
                }
                Ok(Vec::new())
            }
            Transfer::ControlIn { request_type: 0xa1, request: INITIATE_CLEAR, .. } => {
                self.clear();
                Ok(vec![STATUS_SUCCESS])
            }
            Transfer::ControlIn { request_type: 0xa1, request: CHECK_CLEAR_STATUS, .. } => {
                match self.clearing.checked_sub(1) {
                    None => Ok(vec![STATUS_SUCCESS, 0]),
                    Some(left) => {
                        self.clearing = left;
                        // Bit 0: something is to be fetched first.
                        Ok(vec![STATUS_PENDING, u8::from(left > 0)])
                    }
                }
            }
            _ => Err(stalled()),
        }
    }
}
