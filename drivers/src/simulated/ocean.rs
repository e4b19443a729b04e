//! A simulated HDX spectrometer of Ocean Optics, on OBP.
//!
//! It looks at a mercury-argon lamp. The lines' wavelengths are NIST's, rounded to a picometre or ten; how strong they are against one
//! another, the dark level and the noise are guesses. Its frames are those of [`ocean::obp`](crate::ocean::obp), which seabreeze reads.
//!
//! It integrates all the time. A spectrum is asked for within an integration, ends it, and has its light; the first spectrum after a change of the time of
//! integration is still of the old time.

use super::line::Speaker;
use super::script::Script;
use crate::ocean::obp::{Flags, Frame, message, parse};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::time::Duration;

/// Lines of mercury and argon, nm in air, and counts a second at their middle.
pub const LINES: [(f64, f64); 24] = [
    (253.652, 9.0e5),
    (296.728, 6.0e4),
    (302.150, 9.0e4),
    (313.155, 2.2e5),
    (334.148, 4.0e4),
    (365.015, 3.6e5),
    (404.656, 2.9e5),
    (435.833, 6.2e5),
    (546.074, 7.4e5),
    (576.960, 1.6e5),
    (579.066, 1.7e5),
    (696.543, 2.6e5),
    (706.722, 1.9e5),
    (727.294, 1.1e5),
    (738.398, 2.1e5),
    (750.387, 3.8e5),
    (763.511, 5.6e5),
    (772.376, 3.0e5),
    (794.818, 1.6e5),
    (811.531, 4.1e5),
    (826.452, 1.4e5),
    (842.465, 2.2e5),
    (912.297, 2.4e5),
    (922.450, 5.0e4),
];

/// Properties of the instrument.
#[derive(Debug, Clone, PartialEq)]
pub struct OceanSettings {
    /// Serial number.
    pub serial: String,
    /// Product number; `None` for one that does not tell it.
    pub product: Option<u16>,
    /// Pixels.
    pub pixels: usize,
    /// Coefficients of the wavelength, nm at pixel 0 and on.
    pub coefficients: Vec<f32>,
    /// Shortest and longest integration, µs.
    pub integration_us: [u32; 2],
    /// Time of integration after it was switched on, µs.
    pub integration_at_first_us: u32,
    /// Counts without light.
    pub dark_counts: f64,
    /// Counts of a dark current, 1/s.
    pub dark_counts_s: f64,
    /// Width of a line at half its height, nm.
    pub width_nm: f64,
    /// Light of the lamp, 1 for [`LINES`].
    pub lamp: f64,
    /// Noise of the readout, counts rms; the light's own comes beside it, at 10 electrons a count.
    pub noise_counts: f64,
    /// Whether its answers have a checksum.
    pub checked: bool,
    /// Whether its answers repeat the number of their question.
    pub repeats: bool,
    /// Whether it tells its time of integration.
    pub tells_integration: bool,
    /// Whether it integrates all the time; one that does not begins with the question.
    pub runs_free: bool,
    /// How long it takes to answer, and to read a spectrum out.
    pub latency: Duration,
    /// Value at which the converter ends.
    pub saturation: u16,
    /// Seed of the noise.
    pub seed: u64,
}

impl Default for OceanSettings {
    fn default() -> Self {
        Self {
            serial: "HDX01042".into(),
            product: Some(0x2003),
            pixels: 2068,
            coefficients: vec![198.4, 0.452, -1.83e-5, -4.1e-10],
            integration_us: [6_000, 10_000_000],
            integration_at_first_us: 10_000,
            dark_counts: 1_500.0,
            dark_counts_s: 400.0,
            width_nm: 1.1,
            lamp: 1.0,
            noise_counts: 12.0,
            checked: false,
            repeats: true,
            tells_integration: true,
            runs_free: true,
            latency: Duration::from_millis(4),
            saturation: 65_535,
            seed: 1,
        }
    }
}

impl OceanSettings {
    /// Wavelength of a pixel, nm.
    pub fn wavelength_nm(&self, pixel: usize) -> f64 {
        let place = pixel as f64;
        self.coefficients.iter().rev().fold(0.0, |sum, c| sum * place + f64::from(*c))
    }

    /// Light and dark current of a pixel, counts/s.
    fn rate(&self, pixel: usize) -> f64 {
        let nm = self.wavelength_nm(pixel);
        let light = LINES.iter().map(|(line, strength)| {
            let off = (nm - line) / self.width_nm;
            // Half the height at half the width.
            strength * (-4.0 * std::f64::consts::LN_2 * off * off).exp()
        });
        self.dark_counts_s + self.lamp * light.sum::<f64>()
    }
}

/// Fault at a message, named by its number (`00101000`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// No answer.
    Silence,
    /// An answer later than it should be.
    Late(Duration),
    /// The first half of an answer.
    Half,
    /// A refusal with this error, and nothing done.
    Nack(u16),
    /// A refusal "put off", then the answer.
    Deferred,
    /// A checksum that is not that of the bytes.
    WrongSum,
    /// Half the data.
    Short,
}

/// The instrument.
#[derive(Debug, Clone)]
pub struct Ocean {
    settings: OceanSettings,
    /// Faults that are to come.
    pub faults: Script<Kind>,
    heard: Vec<u8>,
    /// Time of integration that is set, µs.
    set_us: u32,
    /// Time of the integration that runs, µs, and when it began.
    running: (u32, Duration),
    /// The next spectrum is of the integration that ran at the change.
    old: bool,
    busy_until: Duration,
    taken: u64,
    /// When the integration of the last spectrum began, and its time, µs.
    last: (Duration, u32),
    /// Light and dark current of each pixel, counts/s.
    rates: Vec<f64>,
}

impl Ocean {
    /// An instrument that has been switched on.
    pub fn new(settings: OceanSettings) -> Self {
        let rates = (0..settings.pixels).map(|pixel| settings.rate(pixel)).collect();
        Self {
            rates,
            faults: Script::default(),
            heard: Vec::new(),
            set_us: settings.integration_at_first_us,
            running: (settings.integration_at_first_us, Duration::ZERO),
            old: false,
            busy_until: Duration::ZERO,
            taken: 0,
            last: (Duration::ZERO, 0),
            settings,
        }
    }

    /// When the integration of the last spectrum that it gave began, and its time, µs: the truth for tests.
    pub fn last(&self) -> (Duration, u32) {
        self.last
    }

    /// How many spectra it has given.
    pub fn taken(&self) -> u64 {
        self.taken
    }

    /// Time of integration that is set, µs.
    pub fn set_us(&self) -> u32 {
        self.set_us
    }

    /// Cuts the power and gives it back.
    pub fn power_cycle(&mut self) {
        let (faults, taken) = (self.faults.clone(), self.taken);
        *self = Self { faults, taken, ..Self::new(self.settings.clone()) };
    }

    /// Counts of a pixel after an integration without noise, however many: the truth for tests.
    pub fn expected(&self, pixel: usize, us: u32) -> f64 {
        let rate = self.rates.get(pixel).copied().unwrap_or(0.0);
        self.settings.dark_counts + rate * f64::from(us) / 1e6
    }

    /// A spectrum of that integration, with noise, as far as 16 bits go.
    fn spectrum(&mut self, us: u32) -> Vec<u8> {
        self.counts(us).into_iter().flat_map(u16::to_le_bytes).collect()
    }

    /// The counts of a spectrum of that integration, with noise, up to the converter's end.
    pub(super) fn counts(&mut self, us: u32) -> Vec<u16> {
        self.taken += 1;
        let seed = self.settings.seed.wrapping_mul(0x9e37_79b9).wrapping_add(self.taken);
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        // The sum of twelve even numbers less six is nearly normal.
        let mut normal = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
        let mut all = Vec::with_capacity(self.settings.pixels);
        for pixel in 0..self.settings.pixels {
            let expected = self.expected(pixel, us);
            let light = (expected - self.settings.dark_counts).max(0.0) / 10.0;
            let counts = expected + (self.settings.noise_counts.powi(2) + light).sqrt() * normal();
            let counts = counts.round().clamp(0.0, f64::from(self.settings.saturation));
            // 0 to 65535.
            all.push(counts as u16);
        }
        all
    }

    /// Takes another time of integration, µs; whether it has it.
    pub(super) fn change(&mut self, us: u32) -> bool {
        let [least, most] = self.settings.integration_us;
        if !(least..=most).contains(&us) {
            return false;
        }
        if us != self.set_us {
            self.old = true;
            self.set_us = us;
        }
        true
    }

    /// Gives a spectrum and when it is there.
    pub(super) fn take(&mut self, now: Duration) -> (Vec<u8>, Duration) {
        let time = |us: u32| Duration::from_micros(u64::from(us));
        let (mut us, mut since) = self.running;
        if !self.settings.runs_free && !self.old {
            (us, since) = (self.set_us, now);
        } else if !self.old {
            // The one that runs now.
            us = self.set_us;
            let passed = now.saturating_sub(since).as_micros() / u128::from(us.max(1));
            since += time(us) * u32::try_from(passed).unwrap_or(u32::MAX);
        }
        let end = (since + time(us)).max(now);
        self.old = false;
        self.last = (since, us);
        self.running = (self.set_us, end);
        (self.spectrum(us), end)
    }

    /// Carries a message out: the data of its answer and when it is there, or the error.
    fn carry_out(&mut self, frame: &Frame, now: Duration) -> Result<(Vec<u8>, Duration), u16> {
        let data = frame.data.as_slice();
        let empty = |answer: Vec<u8>| if data.is_empty() { Ok((answer, now)) } else { Err(5) };
        match frame.message {
            message::SERIAL => empty(self.settings.serial.clone().into_bytes()),
            message::SERIAL_LENGTH => empty(vec![16]),
            message::PRODUCT => match self.settings.product {
                Some(product) => empty(product.to_le_bytes().to_vec()),
                None => Err(2),
            },
            message::COEFFICIENTS => {
                empty(vec![u8::try_from(self.settings.coefficients.len()).unwrap_or(u8::MAX)])
            }
            message::NONLINEARITIES => empty(vec![0]),
            message::COEFFICIENT => match *data {
                [place] => match self.settings.coefficients.get(usize::from(place)) {
                    Some(value) => Ok((value.to_le_bytes().to_vec(), now)),
                    None => Err(6),
                },
                _ => Err(5),
            },
            message::INTEGRATION if self.settings.tells_integration => {
                empty(self.set_us.to_le_bytes().to_vec())
            }
            message::SET_INTEGRATION => {
                let us = data.try_into().map(u32::from_le_bytes).map_err(|_| 5_u16)?;
                if self.change(us) { Ok((Vec::new(), now)) } else { Err(6) }
            }
            message::SPECTRUM_HDX | message::SPECTRUM if data.is_empty() => Ok(self.take(now)),
            message::SPECTRUM_HDX | message::SPECTRUM => Err(5),
            _ => Err(2),
        }
    }

    fn answer(&mut self, question: &Frame, now: Duration) -> Vec<(Duration, Vec<u8>)> {
        let fault = self.faults.at(&format!("{:08x}", question.message));
        let begin = now.max(self.busy_until);
        if fault == Some(Kind::Silence) {
            return Vec::new();
        }
        let done = match fault {
            Some(Kind::Nack(error)) => Err(error),
            _ => self.carry_out(question, begin),
        };
        let regarding = if self.settings.repeats { question.regarding } else { 0 };
        let mut answer = Frame::new(question.message, regarding, &[]);
        answer.checked = self.settings.checked;
        answer.flags = Flags(Flags::RESPONSE);
        let mut due = begin;
        match done {
            Ok((mut data, end)) => {
                if fault == Some(Kind::Short) {
                    data.truncate(data.len() / 2);
                }
                (answer.data, due) = (data, end);
                if question.flags.any(Flags::ASK_ACK) {
                    answer.flags.0 |= Flags::ACK;
                }
                // A message that only sets something is answered where that was asked for.
                if question.message == message::SET_INTEGRATION
                    && !question.flags.any(Flags::ASK_ACK)
                {
                    return Vec::new();
                }
            }
            Err(error) => {
                answer.flags.0 |= Flags::NACK;
                answer.error = error;
            }
        }
        self.busy_until = due;
        due += self.settings.latency;
        let mut bytes = answer.emit();
        match fault {
            Some(Kind::Late(time)) => due += time,
            Some(Kind::Half) => bytes.truncate(bytes.len() / 2),
            Some(Kind::WrongSum) => {
                let at = bytes.len() - 20;
                bytes[at] ^= 1;
            }
            Some(Kind::Deferred) => {
                let mut first = Frame::new(question.message, regarding, &[]);
                first.flags = Flags(Flags::RESPONSE | Flags::NACK);
                first.error = crate::ocean::obp::DEFERRED;
                return vec![(begin + self.settings.latency, first.emit()), (due, bytes)];
            }
            _ => {}
        }
        vec![(due, bytes)]
    }
}

impl Speaker for Ocean {
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)> {
        self.heard.extend_from_slice(bytes);
        let mut said = Vec::new();
        loop {
            match parse(&self.heard) {
                Ok(Some((frame, taken))) => {
                    self.heard.drain(..taken);
                    said.extend(self.answer(&frame, now));
                }
                Ok(None) => return said,
                // On to what may be the beginning of a frame.
                Err(_) => {
                    let next = self.heard.iter().skip(1).position(|byte| *byte == 0xc1);
                    let skip = next.map_or(self.heard.len(), |at| at + 1);
                    self.heard.drain(..skip);
                    if self.heard.is_empty() {
                        return said;
                    }
                }
            }
        }
    }
}
