//! Simulated spectrometers of Ocean Optics on the older USB protocol, each of the [models](Model).
//!
//! They look at the mercury-argon lamp of [`ocean`](super::ocean). What is in their memory is made up. The table of models is the driver's, which a test holds against seabreeze's; commands are read and frames are
//! made here, not by the driver's code.
//!
//! They are transports for drivers: transfers end with a short packet, or where the host's buffer is full; a packet that is longer than what is left of the buffer is an error,
//! and what came before a time ran out is given, as libusb does it.

use super::ocean::{Ocean, OceanSettings};
use super::script::Script;
use crate::clock::Deadline;
use crate::ocean::ooi::{Layout, Model, Saturation};
use crate::transport::{Transfer, Transfers, TransportError};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

/// When an instrument integrates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Runs {
    /// All the time: a spectrum that is asked for is of the integration that is under way.
    Freely,
    /// Once ahead: a spectrum that is asked for was integrated after the one before it was fetched.
    Ahead,
    /// When it is asked.
    Asked,
}

/// Properties of the instrument.
#[derive(Debug, Clone, PartialEq)]
pub struct OoiSettings {
    /// The model.
    pub model: Model,
    /// Texts of the slots 0 to 16 of its memory.
    pub texts: BTreeMap<u8, String>,
    /// Value at which its converter ends, which slot 17 says where the model has it there; 0 says nothing, and it ends where the model does.
    pub saturation: Option<u16>,
    /// Whether its bus is of high speed.
    pub high_speed: bool,
    /// Version of the gate array, as its register has it.
    pub firmware: u16,
    /// When it integrates.
    pub runs: Runs,
    /// Whether a command waits until the spectrum before it is there.
    pub in_order: bool,
    /// Time of integration after it was switched on, µs.
    pub integration_at_first_us: u32,
    /// Light of the lamp; 1 saturates in 0.1 s.
    pub lamp: f64,
    /// Counts of a dark current of a converter of 65535, 1/s.
    pub dark_counts_s: f64,
    /// How long it takes to answer, and to read a spectrum out.
    pub latency: Duration,
    /// Seed of the noise.
    pub seed: u64,
}

impl OoiSettings {
    /// An instrument of that model.
    pub fn of(model: Model) -> Self {
        let scale = 2068.0 / model.pixels as f64;
        let infrared = model.name.starts_with("NIRQuest");
        let coefficients = if infrared {
            [890.0, 0.4 * scale, -6.1e-6 * scale.powi(2), 0.0]
        } else {
            [198.4, 0.452 * scale, -1.83e-5 * scale.powi(2), -4.1e-10 * scale.powi(3)]
        };
        let nonlinearity = [0.93, 2.9e-6, -6.7e-11, 9.8e-16, -9.0e-21, 4.7e-26, -1.3e-31, 1.5e-37];
        let mut texts = BTreeMap::from([
            (0, format!("SIM{:04X}", model.product)),
            (5, "0.0020".to_owned()),
            (14, "7".to_owned()),
            (15, "synthetic".to_owned()),
        ]);
        texts.extend((1..).zip(coefficients.map(|c| format!("{c:.6e}"))));
        texts.extend((6..).zip(nonlinearity.map(|c: f64| format!("{c:.6e}"))));
        let saturation = match model.slot_17 {
            Saturation::Unused => None,
            Saturation::Word { .. } => Some(54_321),
            Saturation::Long { .. } => Some(60_001),
            Saturation::FirstWord => Some(63_003),
        };
        Self {
            model,
            texts,
            saturation,
            high_speed: model.layout == Layout::Words,
            firmware: 0x2015,
            runs: Runs::Freely,
            in_order: true,
            integration_at_first_us: model.integration_us[0].max(10_000),
            lamp: 1.0,
            dark_counts_s: 400.0,
            latency: Duration::from_millis(4),
            seed: 1,
        }
    }

    /// Value at which its converter ends.
    fn end(&self) -> u16 {
        self.saturation.filter(|end| *end > 0).unwrap_or(self.model.saturation)
    }

    /// The light before its detector.
    fn light(&self) -> Ocean {
        let text = |slot| self.texts.get(&slot).and_then(|text| text.parse().ok()).unwrap_or(0.0);
        let [a, b, c, d]: [f64; 4] = [1, 2, 3, 4].map(text);
        // The polynomial around the first pixel.
        let first = f64::from(self.model.first_pixel);
        let shifted = [
            a + first * (b + first * (c + first * d)),
            b + first * (2.0 * c + first * 3.0 * d),
            c + 3.0 * first * d,
            d,
        ];
        let part = f64::from(self.end()) / 65_535.0;
        Ocean::new(OceanSettings {
            pixels: self.model.pixels,
            coefficients: shifted.map(|c| c as f32).to_vec(),
            dark_counts: 1_500.0 * part,
            dark_counts_s: self.dark_counts_s * part,
            noise_counts: (12.0 * part).max(1.0),
            lamp: self.lamp * part,
            saturation: self.end(),
            seed: self.seed,
            ..OceanSettings::default()
        })
    }
}

/// Fault at a command, named by its first bytes (`09`, `0500`, `fe`).
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Kind {
    /// No answer, and nothing done.
    Silence,
    /// An answer later than it should be.
    Late(Duration),
    /// The first half of an answer.
    Half,
    /// The answer without its second packet.
    LostPacket,
    /// The answer with its first packet twice.
    RepeatedPacket,
    /// The answer twice.
    Twice,
    /// Another byte in place of the last.
    WrongEnd,
    /// These bytes in place of the answer.
    Say(Vec<u8>),
    /// These bytes in a packet before the answer.
    Before(Vec<u8>),
    /// The endpoint of the answer refuses all until it is set going again; the answer is lost.
    Stall,
}

/// A spectrum that was given: the truth for tests.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Given {
    /// When its integration began.
    pub since: Duration,
    /// Time of its integration, µs.
    pub us: u32,
    /// Counts of the detector's pixels.
    pub counts: Vec<u16>,
}

/// How many of them are kept.
const KEPT: usize = 32;

/// A packet that waits in an endpoint, and from when on.
type Waiting = (Duration, Vec<u8>);

/// The instrument.
#[derive(Debug, Clone)]
pub struct Ooi {
    settings: OoiSettings,
    /// Faults that are to come.
    pub faults: Script<Kind>,
    light: Ocean,
    waiting: BTreeMap<u8, VecDeque<Waiting>>,
    stalled: BTreeSet<u8>,
    gone: bool,
    trigger: u16,
    set_us: u32,
    /// The integration that runs or is held: its time, µs, and when it began.
    running: (u32, Duration),
    busy_until: Duration,
    given: VecDeque<Given>,
}

impl Ooi {
    /// An instrument that has been switched on.
    pub fn new(settings: OoiSettings) -> Self {
        Self {
            light: settings.light(),
            faults: Script::default(),
            waiting: BTreeMap::new(),
            stalled: BTreeSet::new(),
            gone: false,
            trigger: 0,
            set_us: settings.integration_at_first_us,
            running: (settings.integration_at_first_us, Duration::ZERO),
            busy_until: Duration::ZERO,
            given: VecDeque::new(),
            settings,
        }
    }

    /// The last spectra that it gave, the last one last: the truth for tests.
    pub fn given(&self) -> &VecDeque<Given> {
        &self.given
    }

    /// Counts of a pixel after an integration without noise, however many: the truth for tests.
    pub fn expected(&self, pixel: usize, us: u32) -> f64 {
        self.light.expected(pixel, us)
    }

    /// Time of integration that is set, µs.
    pub fn set_us(&self) -> u32 {
        self.set_us
    }

    /// Lets another program choose what begins an integration; but for 0 none ever begins.
    pub fn trigger(&mut self, mode: u16) {
        self.trigger = mode;
    }

    /// Sets the time of integration as another program would, µs.
    pub fn set_by_another(&mut self, us: u32, now: Duration) {
        self.change(us, now);
    }

    /// Pulls the cable out.
    pub fn unplug(&mut self) {
        self.gone = true;
    }

    /// Cuts the power and gives it back.
    pub fn power_cycle(&mut self) {
        let (faults, given) = (self.faults.clone(), self.given.clone());
        *self = Self { faults, given, ..Self::new(self.settings.clone()) };
    }

    fn packet(&self) -> usize {
        if self.settings.high_speed { 512 } else { 64 }
    }

    /// Brings the integration that runs up to now.
    fn advance(&mut self, now: Duration) {
        let time = |us: u32| Duration::from_micros(u64::from(us));
        let (us, since) = self.running;
        let end = since + time(us);
        if self.settings.runs != Runs::Freely || end > now {
            return;
        }
        // From here on each is of the time that is set.
        let each = u128::from(self.set_us.max(1));
        let whole = (now - end).as_micros() / each;
        let since = end + time(self.set_us) * u32::try_from(whole).unwrap_or(u32::MAX);
        self.running = (self.set_us, since);
    }

    /// Takes a spectrum that is asked for at `now`, and gives its counts and when it is there.
    fn take(&mut self, now: Duration) -> (Vec<u16>, Duration) {
        let time = |us: u32| Duration::from_micros(u64::from(us));
        self.advance(now);
        if self.settings.runs == Runs::Asked {
            self.running = (self.set_us, now);
        }
        let (us, since) = self.running;
        let end = (since + time(us)).max(now);
        self.running = (self.set_us, end);
        let counts = self.light.counts(us);
        if self.given.len() == KEPT {
            self.given.pop_front();
        }
        self.given.push_back(Given { since, us, counts: counts.clone() });
        (counts, end)
    }

    /// Bytes of a spectrum.
    fn frame(&self, counts: &[u16]) -> Vec<u8> {
        let model = &self.settings.model;
        let mut counts = counts.to_vec();
        counts.resize(model.values, 0);
        let mut bytes = Vec::new();
        match model.layout {
            Layout::Words => {
                for count in counts {
                    bytes.extend((count ^ model.flipped).to_le_bytes());
                }
            }
            Layout::Halves => {
                for packet in counts.chunks(64) {
                    bytes.extend(packet.iter().map(|count| count.to_le_bytes()[0]));
                    // Something is on the four wires that the converter does not have.
                    bytes.extend(packet.iter().map(|count| count.to_le_bytes()[1] | 0xa0));
                }
            }
        }
        if model.ends_with_mark {
            bytes.push(0x69);
        }
        bytes
    }

    fn slot(&self, number: u8) -> Vec<u8> {
        let mut answer = vec![0x05, number];
        match self.settings.texts.get(&number) {
            Some(text) => {
                answer.extend(text.bytes().take(15));
                answer.resize(17, 0);
            }
            None => answer.resize(17, 0xff),
        }
        if number == 17
            && let Some(value) = self.settings.saturation
        {
            let [low, high] = value.to_le_bytes();
            // The answer's own two bytes stand before the slot's.
            match self.settings.model.slot_17 {
                Saturation::Unused => {}
                Saturation::Word { .. } => answer[6..8].copy_from_slice(&[low, high]),
                Saturation::Long { .. } => answer[6..10].copy_from_slice(&[low, high, 0, 0]),
                Saturation::FirstWord => answer[2..4].copy_from_slice(&[low, high]),
            }
        }
        answer
    }

    fn status(&self) -> Vec<u8> {
        let mut answer = Vec::new();
        // At most 3840.
        answer.extend((self.settings.model.values as u16).to_le_bytes());
        answer.extend(self.set_us.to_le_bytes());
        let speed = if self.settings.high_speed { 0x80 } else { 0x00 };
        answer.extend([0, self.trigger.to_le_bytes()[0], 0, 15, 1, 0, 0, 0, speed, 0]);
        answer
    }

    fn set(&mut self, value: u32, now: Duration) {
        let model = self.settings.model;
        let [least, most] = model.integration_us;
        if let Some(us) = value.checked_mul(model.unit_us)
            && (least..=most).contains(&us)
        {
            self.change(us, now);
        }
    }

    fn change(&mut self, us: u32, now: Duration) {
        self.advance(now);
        self.set_us = us;
        // One that has yet to begin is of the new time.
        if self.running.1 > now {
            self.running.0 = us;
        }
    }

    /// Puts an answer into an endpoint in packets.
    fn say(&mut self, endpoint: u8, due: Duration, packets: Vec<Vec<u8>>) {
        let waiting = self.waiting.entry(endpoint).or_default();
        waiting.extend(packets.into_iter().map(|packet| (due, packet)));
    }

    fn packets(&self, bytes: &[u8]) -> Vec<Vec<u8>> {
        bytes.chunks(self.packet()).map(<[u8]>::to_vec).collect()
    }

    fn hear(&mut self, bytes: &[u8], now: Duration) {
        let key: String = bytes.iter().take(2).map(|byte| format!("{byte:02x}")).collect();
        let fault = self.faults.at(&key);
        if fault == Some(Kind::Silence) {
            return;
        }
        let begin = if self.settings.in_order { now.max(self.busy_until) } else { now };
        let ends = self.settings.model.endpoints;
        let mut due = begin + self.settings.latency;
        let mut answers: Vec<(u8, Vec<u8>)> = Vec::new();
        match *bytes {
            [0x0a, low, high] => self.trigger = u16::from_le_bytes([low, high]),
            [0x02, a, b, c, d] => self.set(u32::from_le_bytes([a, b, c, d]), begin),
            [0x05, number] => answers.push((ends.answers, self.slot(number))),
            [0x6b, 0x04] => {
                let [low, high] = self.settings.firmware.to_le_bytes();
                answers.push((ends.answers, vec![0x04, low, high]));
            }
            [0xfe] if self.settings.model.tells_status => {
                answers.push((ends.answers, self.status()));
            }
            [0x09] if self.trigger == 0 => {
                let (counts, end) = self.take(now.max(self.busy_until));
                self.busy_until = end;
                due = end + self.settings.latency;
                let mut frame = self.frame(&counts);
                let by_answers = self.settings.model.tells_status && !self.settings.high_speed;
                match ends.beginnings {
                    _ if by_answers => answers.push((ends.answers, frame)),
                    None => answers.push((ends.spectra, frame)),
                    Some(endpoint) => {
                        let rest = frame.split_off(2048);
                        answers.extend([(endpoint, frame), (ends.spectra, rest)]);
                    }
                }
            }
            _ => {}
        }
        self.answer(answers, due, fault);
    }

    /// Gives the answers, as the fault lets them come.
    fn answer(&mut self, answers: Vec<(u8, Vec<u8>)>, due: Duration, fault: Option<Kind>) {
        let Some((last, _)) = answers.last() else { return };
        let last = *last;
        let mut due = due;
        match &fault {
            Some(Kind::Late(time)) => due += *time,
            Some(Kind::Stall) => {
                self.stalled.insert(last);
                return;
            }
            Some(Kind::Say(bytes)) => {
                let packets = self.packets(bytes);
                self.say(last, due, packets);
                return;
            }
            Some(Kind::Before(bytes)) => {
                let packets = self.packets(bytes);
                self.say(answers[0].0, due, packets);
            }
            _ => {}
        }
        let twice = if fault == Some(Kind::Twice) { 2 } else { 1 };
        for _ in 0..twice {
            for (endpoint, bytes) in &answers {
                let mut packets = self.packets(bytes);
                // A fault is one of the last piece.
                if *endpoint == last {
                    match &fault {
                        Some(Kind::Half) => packets = self.packets(&bytes[..bytes.len() / 2]),
                        Some(Kind::LostPacket) if packets.len() > 1 => {
                            packets.remove(1);
                        }
                        Some(Kind::LostPacket) => packets.clear(),
                        Some(Kind::RepeatedPacket) => packets.insert(0, packets[0].clone()),
                        Some(Kind::WrongEnd) => {
                            if let Some(byte) = packets.last_mut().and_then(|last| last.last_mut())
                            {
                                *byte ^= 0x5a;
                            }
                        }
                        _ => {}
                    }
                }
                self.say(*endpoint, due, packets);
            }
        }
    }

    fn read(
        &mut self,
        endpoint: u8,
        length: usize,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, TransportError> {
        let most = self.packet();
        let waiting = self.waiting.entry(endpoint).or_default();
        let mut got = Vec::new();
        loop {
            let due = waiting.front().map_or(Duration::MAX, |(due, _)| *due);
            let wait = due.saturating_sub(deadline.now());
            if let Err(expired) = deadline.sleep(wait) {
                // What came before is given, as libusb does it.
                return if got.is_empty() { Err(expired.into()) } else { Ok(got) };
            }
            let Some((_, packet)) = waiting.front() else { continue };
            if packet.len() > length - got.len() {
                let what = "the simulated instrument".to_owned();
                let source = std::io::Error::other("a packet is longer than its buffer (overflow)");
                return Err(TransportError::Io { action: "talk to", what, source });
            }
            let ends = packet.len() < most;
            got.extend(waiting.pop_front().map(|(_, packet)| packet).unwrap_or_default());
            if ends || got.len() == length {
                return Ok(got);
            }
        }
    }
}

impl Transfers for Ooi {
    fn transfer(
        &mut self,
        transfer: &Transfer,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, TransportError> {
        deadline.remaining()?;
        if self.gone {
            return Err(TransportError::disconnected("the simulated instrument"));
        }
        let ends = self.settings.model.endpoints;
        let incoming = [Some(ends.answers), Some(ends.spectra), ends.beginnings];
        let stalled = || TransportError::Stalled { transfer: transfer.to_string() };
        match transfer {
            Transfer::BulkOut { endpoint, data } if *endpoint == ends.commands => {
                self.hear(data, deadline.now());
                Ok(Vec::new())
            }
            Transfer::BulkIn { endpoint, .. } if self.stalled.contains(endpoint) => Err(stalled()),
            Transfer::BulkIn { endpoint, length } if incoming.contains(&Some(*endpoint)) => {
                self.read(*endpoint, *length, deadline)
            }
            Transfer::ClearHalt { endpoint } => {
                self.stalled.remove(endpoint);
                Ok(Vec::new())
            }
            _ => {
                let what = "the simulated instrument".to_owned();
                Err(TransportError::Unsupported { what, transfer: transfer.to_string() })
            }
        }
    }
}
