//! Simulated instruments that speak SCPI: a picoammeter, a multimeter, a supply; and a Prologix GPIB adapter before any of them.
//!
//! Written from IEEE 488.2 and SCPI-99: headers in short and long form, compound messages, an error queue that can overflow, ±9.9E37 for more than the range holds,
//! `FETC?` that repeats the last value. The commands are those of the makers' manuals, from memory.

use super::line::Speaker;
use super::script::Script;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::collections::VecDeque;
use std::fmt;
use std::time::Duration;

/// Instrument that is simulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Model {
    /// A Keithley 6485.
    Picoammeter,
    /// A Keithley 2000, as a voltmeter.
    Multimeter,
    /// A Rigol DP832, its channel 1.
    Supply,
}

/// Properties of a simulated instrument.
#[derive(Debug, Clone, PartialEq)]
pub struct ScpiSettings {
    /// The instrument.
    pub model: Model,
    /// Noise of a measurement, as a part of its value, rms.
    pub noise: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// How long a measurement takes, and the time from one to the next where it measures by itself.
    pub measurement: Duration,
    /// How long any answer takes.
    pub latency: Duration,
    /// Error numbers that wait from the start.
    pub complaints: Vec<i32>,
}

impl Default for ScpiSettings {
    /// A picoammeter with noise of 0.1 %, 20 ms a measurement.
    fn default() -> Self {
        Self {
            model: Model::Picoammeter,
            noise: 1e-3,
            seed: 0,
            measurement: Duration::from_millis(20),
            latency: Duration::from_millis(1),
            complaints: Vec::new(),
        }
    }
}

/// Faults at a message.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// There is no answer.
    Silence,
    /// The answer comes so much later.
    Late(Duration),
    /// The second half of the answer is lost, its end too.
    Half,
    /// It says this instead.
    Say(&'static str),
}

/// Most errors that the queue holds.
const QUEUE: usize = 10;
/// SCPI's sign for more than the range holds.
const OVER: f64 = 9.9e37;
/// Largest voltage of the supply, V, and current, A.
const SUPPLY: [f64; 2] = [32.0, 3.2];

/// A simulated instrument.
pub struct Instrument {
    settings: ScpiSettings,
    signal: Box<dyn FnMut(Duration) -> f64 + Send>,
    /// Faults of the instrument, and the messages at which they occur.
    pub faults: Script<Kind>,
    errors: VecDeque<i32>,
    /// Bytes of a message without its end.
    heard: Vec<u8>,
    busy_until: Duration,
    /// Time at which the last answer is due.
    due: Duration,
    overlaps: u32,
    random: Xoshiro256PlusPlus,
    /// The last reading and its time; `None` before the first.
    last: Option<(f64, Duration)>,
    /// The end of the range; `None` if the instrument chooses.
    range: Option<f64>,
    nplc: f64,
    zero_check: bool,
    continuous: bool,
    elements: Vec<&'static str>,
    volts: f64,
    limit_a: f64,
    on: bool,
    event_enable: i64,
}

impl fmt::Debug for Instrument {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Instrument").field("settings", &self.settings).finish_non_exhaustive()
    }
}

impl Instrument {
    /// An instrument that has just been switched on; `signal` is what is at its input, A or V, at a time.
    pub fn new(
        settings: ScpiSettings,
        signal: impl FnMut(Duration) -> f64 + Send + 'static,
    ) -> Self {
        Self {
            signal: Box::new(signal),
            faults: Script::default(),
            errors: settings.complaints.iter().copied().collect(),
            heard: Vec::new(),
            busy_until: Duration::ZERO,
            due: Duration::ZERO,
            overlaps: 0,
            random: Xoshiro256PlusPlus::seed_from_u64(settings.seed),
            last: None,
            range: None,
            nplc: 1.0,
            zero_check: settings.model == Model::Picoammeter,
            continuous: settings.model == Model::Multimeter,
            elements: vec!["READ", "UNIT", "TIME", "STAT"],
            volts: 0.0,
            limit_a: 3.2,
            on: false,
            event_enable: 0,
            settings,
        }
    }

    /// Voltage that the supply is set to, V: the truth for tests.
    pub fn volts(&self) -> f64 {
        self.volts
    }

    /// Whether the supply's output is on: the truth for tests.
    pub fn is_on(&self) -> bool {
        self.on
    }

    /// End of the chosen range; `None` where the instrument chooses: the truth for tests.
    pub fn range(&self) -> Option<f64> {
        self.range
    }

    /// How often a message came while an answer was still due.
    pub fn overlaps(&self) -> u32 {
        self.overlaps
    }

    /// Errors in the queue.
    pub fn waiting(&self) -> usize {
        self.errors.len()
    }

    fn complain(&mut self, code: i32) {
        match self.errors.len() {
            count if count < QUEUE => self.errors.push_back(code),
            // The newest makes room for the sign that some were lost (SCPI-99 21.8.1).
            _ => {
                self.errors.pop_back();
                self.errors.push_back(-350);
            }
        }
    }

    fn identity(&self) -> &'static str {
        match self.settings.model {
            Model::Picoammeter => "KEITHLEY INSTRUMENTS INC.,MODEL 6485,1234567,B03   Sep 25 2002",
            Model::Multimeter => "KEITHLEY INSTRUMENTS INC.,MODEL 2000,1234567,A20 /A02",
            Model::Supply => "RIGOL TECHNOLOGIES,DP832,DP8A123456789,00.01.14",
        }
    }

    fn noisy(&mut self, value: f64) -> f64 {
        // The sum of twelve uniform numbers is close to a Gaussian of variance 1.
        let sum: f64 = (0..12).map(|_| self.random.random::<f64>()).sum();
        value * (1.0 + self.settings.noise * (sum - 6.0))
    }

    /// A measurement in the middle of which it is `at`.
    fn measured(&mut self, at: Duration) -> f64 {
        let input = if self.zero_check { 0.0 } else { (self.signal)(at) };
        let value = self.noisy(input);
        match self.range {
            Some(end) if value.abs() > end => OVER.copysign(value),
            _ => value,
        }
    }

    fn shown(&self, (value, at): (f64, Duration)) -> String {
        let unit = if self.settings.model == Model::Picoammeter { "A" } else { "V" };
        if self.settings.model == Model::Multimeter {
            return nr3(value, 8);
        }
        let has = |element| self.elements.contains(&element);
        let mut parts = Vec::new();
        if has("READ") {
            let unit = if has("UNIT") { unit } else { "" };
            parts.push(format!("{}{unit}", nr3(value, 6)));
        }
        if has("TIME") {
            parts.push(nr3(at.as_secs_f64(), 6));
        }
        if has("STAT") {
            parts.push(nr3(f64::from(u8::from(value.abs() >= OVER)), 6));
        }
        parts.join(",")
    }

    /// Carries out one command of a message at `now`; what it answers, and until when it is busy.
    fn carry_out(&mut self, header: &str, rest: &str, now: Duration) -> (Option<String>, Duration) {
        let asked = header.ends_with('?');
        let of = |spec: &str| is(header, spec);
        let model = self.settings.model;
        let meter = model != Model::Supply;
        let mut until = now;
        let answer = if of("*IDN?") {
            Some(self.identity().to_owned())
        } else if of("*CLS") {
            self.errors.clear();
            None
        } else if of("*RST") {
            let settings = self.settings.clone();
            self.range = None;
            self.nplc = 1.0;
            self.zero_check = settings.model == Model::Picoammeter;
            (self.volts, self.limit_a, self.on) = (0.0, SUPPLY[1], false);
            None
        } else if of("*OPC?") {
            Some("1".to_owned())
        } else if of("*ESE") {
            self.event_enable = self.number(rest).unwrap_or(self.event_enable as f64) as i64;
            None
        } else if of("*ESE?") {
            Some(self.event_enable.to_string())
        } else if of("SYSTem:ERRor[:NEXT]?") {
            let code = self.errors.pop_front().unwrap_or(0);
            Some(format!("{code},\"{}\"", words(code)))
        } else if meter && of("READ?") {
            if self.continuous {
                // Initiated already.
                self.complain(-213);
                return (None, until);
            }
            until = now + self.settings.measurement;
            let value = self.measured(now + self.settings.measurement / 2);
            self.last = Some((value, until));
            Some(self.shown((value, until)))
        } else if meter && (of("FETCh?") || of("[SENSe:]DATA[:LATest]?")) {
            if self.continuous {
                self.free_run(now);
            }
            match self.last {
                Some(last) => Some(self.shown(last)),
                None => {
                    // Data corrupt or stale.
                    self.complain(-230);
                    None
                }
            }
        } else if meter && of("TRACe:DATA?") {
            let shown = self.last.map(|last| self.shown(last)).unwrap_or_default();
            let length = shown.len().to_string();
            Some(format!("#{}{length}{shown}", length.len()))
        } else if meter && of("INITiate[:IMMediate]") {
            if self.continuous {
                self.complain(-213);
            } else {
                until = now + self.settings.measurement;
                let value = self.measured(now + self.settings.measurement / 2);
                self.last = Some((value, until));
            }
            None
        } else if model == Model::Multimeter && of("INITiate:CONTinuous") {
            if let Some(on) = self.flag(rest) {
                self.continuous = on;
            }
            None
        } else if model == Model::Multimeter && of("[SENSe:]FUNCtion") {
            let name = rest.trim_matches(['"', '\'']).to_ascii_uppercase();
            if !["VOLT:DC", "VOLT"].contains(&name.as_str()) {
                self.complain(-224);
            }
            None
        } else if meter && of("FORMat:ELEMents") {
            const ELEMENTS: [&str; 4] = ["READ", "UNIT", "TIME", "STAT"];
            let wanted: Option<Vec<&'static str>> = rest
                .split(',')
                .map(|word| {
                    let word = word.trim().to_ascii_uppercase();
                    ELEMENTS.into_iter().find(|known| word.starts_with(known))
                })
                .collect();
            match wanted {
                Some(wanted) => self.elements = wanted,
                None => self.complain(-224),
            }
            None
        } else if model == Model::Picoammeter && of("SYSTem:ZCHeck[:STATe]") {
            if let Some(on) = self.flag(rest) {
                self.zero_check = on;
            }
            None
        } else if meter && self.is_function(header, "RANGe[:UPPer]") {
            let ends: &[f64] = match model {
                Model::Picoammeter => {
                    &[2.1e-9, 2.1e-8, 2.1e-7, 2.1e-6, 2.1e-5, 2.1e-4, 2.1e-3, 2.1e-2]
                }
                _ => &[0.1, 1.0, 10.0, 100.0, 1000.0],
            };
            if let Some(asked) = self.number(rest) {
                // The smallest that holds it.
                match ends.iter().find(|end| asked.abs() <= **end * 1.000_001) {
                    Some(end) => self.range = Some(*end),
                    None => self.complain(-222),
                }
            }
            None
        } else if meter && self.is_function(header, "RANGe[:UPPer]?") {
            let value = (self.signal)(now).abs();
            Some(nr3(self.range.unwrap_or(value.max(1e-10)), 6))
        } else if meter && self.is_function(header, "RANGe:AUTO") {
            match self.flag(rest) {
                Some(true) => self.range = None,
                Some(false) => {
                    self.range = self.range.or(Some(if model == Model::Picoammeter {
                        2.1e-2
                    } else {
                        1000.0
                    }))
                }
                None => {}
            }
            None
        } else if meter && self.is_function(header, "RANGe:AUTO?") {
            Some(u8::from(self.range.is_none()).to_string())
        } else if meter && self.is_function(header, "NPLCycles") {
            match self.number(rest) {
                Some(nplc) if (0.01..=50.0).contains(&nplc) => self.nplc = nplc,
                Some(_) => self.complain(-222),
                None => {}
            }
            None
        } else if meter && self.is_function(header, "NPLCycles?") {
            Some(format!("{:.2}", self.nplc))
        } else if !meter && of("[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude]") {
            self.set_supply(rest, 0);
            None
        } else if !meter && of("[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude]?") {
            Some(format!("{:.2}", self.volts))
        } else if !meter && of("[SOURce:]CURRent[:LEVel][:IMMediate][:AMPLitude]") {
            self.set_supply(rest, 1);
            None
        } else if !meter && of("[SOURce:]CURRent[:LEVel][:IMMediate][:AMPLitude]?") {
            Some(format!("{:.3}", self.limit_a))
        } else if !meter && of("OUTPut[:STATe]") {
            match rest.split_once(',') {
                Some((channel, state)) if channel.trim().eq_ignore_ascii_case("CH1") => {
                    if let Some(on) = self.flag(state.trim()) {
                        self.on = on;
                    }
                }
                _ => self.complain(-224),
            }
            None
        } else if !meter && of("OUTPut[:STATe]?") {
            Some(if self.on { "ON" } else { "OFF" }.to_owned())
        } else if !meter && of("MEASure[:SCALar]:VOLTage[:DC]?") {
            Some(format!("{:.3}", if self.on { self.volts } else { 0.0 }))
        } else {
            self.complain(-113);
            None
        };
        debug_assert!(asked || answer.is_none(), "{header}");
        (answer, until)
    }

    fn is_function(&self, header: &str, spec: &str) -> bool {
        let function = match self.settings.model {
            Model::Picoammeter => "[SENSe:]CURRent[:DC]:",
            _ => "[SENSe:]VOLTage:DC:",
        };
        is(header, &format!("{function}{spec}"))
    }

    /// The value that it shows while it measures by itself: of the last measurement that has ended.
    fn free_run(&mut self, now: Duration) {
        let period = self.settings.measurement;
        let count = u32::try_from(now.as_nanos() / period.as_nanos().max(1)).unwrap_or(u32::MAX);
        let end = period * count;
        if count > 0 && self.last.is_none_or(|(_, at)| at < end) {
            let value = self.measured(end.saturating_sub(period / 2));
            self.last = Some((value, end));
        }
    }

    fn number(&mut self, text: &str) -> Option<f64> {
        if text.is_empty() {
            self.complain(-109);
            return None;
        }
        let number = text.parse().ok().filter(|number: &f64| number.is_finite());
        if number.is_none() {
            self.complain(-104);
        }
        number
    }

    fn flag(&mut self, text: &str) -> Option<bool> {
        match text.to_ascii_uppercase().as_str() {
            "ON" | "1" => Some(true),
            "OFF" | "0" => Some(false),
            _ => {
                self.complain(-224);
                None
            }
        }
    }

    fn set_supply(&mut self, text: &str, which: usize) {
        match self.number(text) {
            Some(value) if (0.0..=SUPPLY[which]).contains(&value) => match which {
                0 => self.volts = (value * 100.0).round() / 100.0,
                _ => self.limit_a = (value * 1000.0).round() / 1000.0,
            },
            Some(_) => self.complain(-222),
            None => {}
        }
    }

    /// Answers a whole message.
    fn answer(&mut self, message: &str, now: Duration) -> Option<(Duration, Vec<u8>)> {
        let fault = self.faults.at(message);
        let begun = self.busy_until.max(now);
        if now < self.due && message.contains('?') {
            self.overlaps += 1;
        }
        let mut until = begun + self.settings.latency;
        let mut answers = Vec::new();
        let mut path = String::new();
        for command in commands(message) {
            let (header, rest) = command.split_once(' ').unwrap_or((command, ""));
            let header = match header.strip_prefix(':') {
                Some(root) => root.to_owned(),
                None if header.starts_with('*') => header.to_owned(),
                None => format!("{path}{header}"),
            };
            if !header.starts_with('*') {
                let end = header.rfind(':').map_or(0, |colon| colon + 1);
                path = header.get(..end).unwrap_or_default().to_owned();
            }
            let (answer, busy) = self.carry_out(&header, rest.trim(), until);
            until = until.max(busy);
            answers.extend(answer);
        }
        self.busy_until = until;
        if answers.is_empty() || fault == Some(Kind::Silence) {
            return None;
        }
        let answer = format!("{}\n", answers.join(";"));
        let (due, bytes) = match fault {
            Some(Kind::Late(time)) => (until + time, answer.into_bytes()),
            Some(Kind::Half) => (until, answer.as_bytes()[..answer.len() / 2].to_vec()),
            Some(Kind::Say(words)) => (until, format!("{words}\n").into_bytes()),
            _ => (until, answer.into_bytes()),
        };
        self.due = due;
        Some((due, bytes))
    }
}

/// Commands of a message, parted by `;` outside of quotes.
fn commands(message: &str) -> Vec<&str> {
    let mut quote = None;
    let parts = message.split(|character: char| {
        match (quote, character) {
            (None, '"' | '\'') => quote = Some(character),
            (Some(open), close) if open == close => quote = None,
            _ => {}
        }
        quote.is_none() && character == ';'
    });
    parts.map(str::trim).filter(|part| !part.is_empty()).collect()
}

/// Whether a header is that of the manual: `[SENSe:]CURRent[:DC]:RANGe?`. Capitals are the short form, brackets what may be left out; a number 1 behind a word may stand there.
fn is(header: &str, spec: &str) -> bool {
    let asked = header.ends_with('?');
    let Some(bare) = spec.strip_suffix('?').or((!spec.ends_with('?')).then_some(spec)) else {
        return false;
    };
    if asked != spec.ends_with('?') {
        return false;
    }
    let mut nodes = Vec::new();
    let mut optional = false;
    let mut word = String::new();
    let mut end = |word: &mut String, optional: bool| {
        if !word.is_empty() {
            nodes.push((std::mem::take(word), optional));
        }
    };
    for character in bare.chars() {
        match character {
            '[' => {
                end(&mut word, false);
                optional = true;
            }
            ']' => {
                end(&mut word, true);
                optional = false;
            }
            ':' => end(&mut word, optional),
            other => word.push(other),
        }
    }
    end(&mut word, optional);
    let said: Vec<&str> = header.trim_end_matches('?').split(':').collect();
    fits(&said, &nodes)
}

fn fits(said: &[&str], nodes: &[(String, bool)]) -> bool {
    let Some(((node, optional), behind)) = nodes.split_first() else { return said.is_empty() };
    let taken = said.split_first().is_some_and(|(first, rest)| {
        let first = first.strip_suffix('1').unwrap_or(first);
        let short: String = node.chars().take_while(|c| !c.is_ascii_lowercase()).collect();
        (first.eq_ignore_ascii_case(&short) || first.eq_ignore_ascii_case(node))
            && fits(rest, behind)
    });
    taken || (*optional && fits(said, behind))
}

/// Words of an error (SCPI-99 21.8).
fn words(code: i32) -> &'static str {
    match code {
        0 => "No error",
        -104 => "Data type error",
        -109 => "Missing parameter",
        -113 => "Undefined header",
        -213 => "Init ignored",
        -222 => "Data out of range",
        -224 => "Illegal parameter value",
        -230 => "Data corrupt or stale",
        -350 => "Queue overflow",
        _ => "Device-specific error",
    }
}

/// A number as such instruments write it (NR3): `+1.200000E-09`.
fn nr3(value: f64, digits: usize) -> String {
    let text = format!("{value:+.digits$E}");
    let (mantissa, power) = text.split_once('E').unwrap_or((&text, "0"));
    let (sign, power) = match power.strip_prefix('-') {
        Some(power) => ('-', power),
        None => ('+', power),
    };
    format!("{mantissa}E{sign}{power:0>2}")
}

impl Speaker for Instrument {
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)> {
        /// Most bytes that the input buffer holds.
        const MOST: usize = 1024;
        let mut said = Vec::new();
        for byte in bytes {
            if *byte != b'\n' {
                self.heard.truncate(MOST);
                self.heard.push(*byte);
                continue;
            }
            let line = std::mem::take(&mut self.heard);
            let message = String::from_utf8_lossy(&line).trim().to_owned();
            if !message.is_empty() {
                said.extend(self.answer(&message, now));
            }
        }
        said
    }
}

/// A Prologix GPIB adapter with one device on its bus.
#[derive(Debug)]
pub struct Adapter<D> {
    /// The device.
    pub device: D,
    at: u8,
    address: u8,
    auto: bool,
    read_timeout: Duration,
    heard: Vec<u8>,
    escaped: bool,
    /// Whether the line begins with a `+` that was not escaped, and with two.
    pluses: u8,
    /// Answers that the device has and nobody fetched.
    answers: VecDeque<(Duration, Vec<u8>)>,
}

impl<D: Speaker> Adapter<D> {
    /// An adapter with the device at a GPIB address.
    pub fn new(at: u8, device: D) -> Self {
        Self {
            device,
            at,
            address: 0,
            auto: true,
            read_timeout: Duration::from_millis(500),
            heard: Vec::new(),
            escaped: false,
            pluses: 0,
            answers: VecDeque::new(),
        }
    }

    fn read(&mut self, now: Duration) -> Vec<(Duration, Vec<u8>)> {
        let in_time = |(due, _): &(Duration, Vec<u8>)| *due <= now + self.read_timeout;
        if self.address != self.at || !self.answers.front().is_some_and(in_time) {
            return Vec::new();
        }
        self.answers.pop_front().map(|(due, bytes)| (due.max(now), bytes)).into_iter().collect()
    }

    fn command(&mut self, command: &str, now: Duration) -> Vec<(Duration, Vec<u8>)> {
        let mut words = command.split_whitespace();
        let (name, value) = (words.next().unwrap_or_default(), words.next());
        let number = |text: Option<&str>| text.and_then(|text| text.parse::<u64>().ok());
        let say = |text: String| vec![(now, format!("{text}\r\n").into_bytes())];
        match (name, value) {
            ("addr", None) => return say(self.address.to_string()),
            ("addr", value) => {
                let address = number(value).and_then(|number| u8::try_from(number).ok());
                self.address = address.filter(|address| *address <= 30).unwrap_or(self.address);
            }
            ("auto", None) => return say(u8::from(self.auto).to_string()),
            ("auto", value) => self.auto = value == Some("1"),
            ("read_tmo_ms", value) => {
                self.read_timeout =
                    Duration::from_millis(number(value).unwrap_or(500).clamp(1, 3000));
            }
            ("read", _) => return self.read(now),
            ("clr", _) if self.address == self.at => self.answers.clear(),
            ("ver", _) => {
                return say("Prologix GPIB-ETHERNET Controller version 01.06.06.00".into());
            }
            (
                "mode" | "eoi" | "eos" | "eot_enable" | "eot_char" | "savecfg" | "ifc" | "clr"
                | "loc",
                _,
            ) => {}
            _ => return say("Unrecognized command".to_owned()),
        }
        Vec::new()
    }

    fn line(&mut self, now: Duration) -> Vec<(Duration, Vec<u8>)> {
        let mut line = std::mem::take(&mut self.heard);
        if std::mem::take(&mut self.pluses) >= 2 {
            let command = String::from_utf8_lossy(line.get(2..).unwrap_or_default()).into_owned();
            return self.command(&command, now);
        }
        if line.is_empty() || self.address != self.at {
            return Vec::new();
        }
        line.push(b'\n');
        self.answers.extend(self.device.hear(&line, now));
        if self.auto { self.read(now) } else { Vec::new() }
    }
}

impl<D: Speaker> Speaker for Adapter<D> {
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)> {
        /// Most bytes of a line.
        const MOST: usize = 1024;
        let mut said = Vec::new();
        for byte in bytes {
            match (self.escaped, *byte) {
                (false, 0x1b) => self.escaped = true,
                (false, b'\n' | b'\r') => said.extend(self.line(now)),
                (escaped, byte) => {
                    self.escaped = false;
                    if !escaped && byte == b'+' && self.heard.len() == usize::from(self.pluses) {
                        self.pluses = self.pluses.saturating_add(1).min(2);
                    }
                    self.heard.truncate(MOST);
                    self.heard.push(byte);
                }
            }
        }
        said
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: SCPI-99's rule of short and long forms, by hand.
    #[test]
    fn headers_are_those_of_the_manual() {
        let spec = "[SENSe:]CURRent[:DC]:RANGe[:UPPer]?";
        for good in ["CURR:RANG?", "sens:current:dc:rang:upper?", "SENS1:CURR:RANG:UPP?"] {
            assert!(is(good, spec), "{good}");
        }
        for bad in ["CURR:RANG", "CURRE:RANG?", "RANG?", "CURR:RANG:AUTO?", "CURR:DC:DC:RANG?", ""]
        {
            assert!(!is(bad, spec), "{bad}");
        }
        assert!(is("OUTP", "OUTPut[:STATe]") && is("FETC?", "FETCh?"));
        assert_eq!(nr3(1.2e-9, 6), "+1.200000E-09");
        assert_eq!(nr3(-9.9e37, 6), "-9.900000E+37");
        assert_eq!(commands("A 'x;y';B?"), ["A 'x;y'", "B?"]);
    }

    fn ask(instrument: &mut impl Speaker, message: &str, at_ms: u64) -> String {
        let said = instrument.hear(format!("{message}\n").as_bytes(), Duration::from_millis(at_ms));
        said.iter().map(|(_, bytes)| String::from_utf8_lossy(bytes).trim().to_owned()).collect()
    }

    /// Truth: SCPI's rules: what is unknown is in the queue, once; a full queue says that it is; compound messages go on in their branch.
    #[test]
    fn the_error_queue_and_compound_messages() {
        let mut it = Instrument::new(ScpiSettings::default(), |_| 1e-9);
        assert_eq!(ask(&mut it, "NONSENSE?", 0), "");
        assert_eq!(ask(&mut it, "SYST:ERR?", 1), "-113,\"Undefined header\"");
        assert_eq!(ask(&mut it, "SYST:ERR?", 2), "0,\"No error\"");
        for _ in 0..12 {
            ask(&mut it, "X", 3);
        }
        assert_eq!(it.waiting(), QUEUE);
        ask(&mut it, "CURR:RANG 2E-9;RANG:AUTO?", 4);
        assert_eq!(it.range(), Some(2.1e-9));
        assert_eq!(ask(&mut it, "CURR:RANG:AUTO?;*OPC?", 5), "0;1");
        assert_eq!(ask(&mut it, "*CLS;:SYST:ERR?", 6), "0,\"No error\"");
    }
}
