//! Commands of OOI and the frames that answer them, as bytes.

use super::Model;
use crate::reply::{ReplyError, number};

/// First bytes of commands.
pub mod command {
    /// Begins a session.
    pub const INITIALISE: u8 = 0x01;
    /// Sets the time of integration.
    pub const INTEGRATION: u8 = 0x02;
    /// Asks for a slot of the memory.
    pub const SLOT: u8 = 0x05;
    /// Asks for a spectrum.
    pub const SPECTRUM: u8 = 0x09;
    /// Chooses what begins an integration; 0 is nothing from outside.
    pub const TRIGGER: u8 = 0x0a;
    /// Asks for a register of the gate array.
    pub const REGISTER: u8 = 0x6b;
    /// Asks for the status.
    pub const STATUS: u8 = 0xfe;
}

/// Slots of the memory.
pub mod slot {
    /// Serial number, text.
    pub const SERIAL: u8 = 0;
    /// First of the four coefficients of the wavelength, text.
    pub const WAVELENGTH: u8 = 1;
    /// Part of stray light, text.
    pub const STRAY_LIGHT: u8 = 5;
    /// First of the eight coefficients of the nonlinearity, text.
    pub const NONLINEARITY: u8 = 6;
    /// Order of that polynomial, text.
    pub const NONLINEARITY_ORDER: u8 = 14;
    /// Where the converter saturates, bytes; models differ in where these stand.
    pub const SATURATION: u8 = 17;
}

/// Last byte of a frame.
pub const MARK: u8 = 0x69;
/// Bytes of a slot's answer.
pub const SLOT_LENGTH: usize = 17;
/// Bytes of a status.
pub const STATUS_LENGTH: usize = 16;

/// Layout of the values in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// Words, the low byte first.
    Words,
    /// Packets of 64 bytes: 64 low bytes, the 64 high bytes of the same values, and so on.
    Halves,
}

/// Where slot 17 says at which value the converter saturates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Saturation {
    /// It does not.
    Unused,
    /// A word at that byte of the slot; 0 says nothing.
    Word {
        /// The byte.
        at: usize,
    },
    /// Four bytes there; 0, or more than the converter has, says nothing.
    Long {
        /// The byte.
        at: usize,
    },
    /// A word at the beginning; what is not above 32768 and within the model's own end says nothing.
    FirstWord,
}

/// Speed of the bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Speed {
    /// 12 Mbit/s: packets of 64 bytes.
    Full,
    /// 480 Mbit/s: packets of 512 bytes.
    High,
}

impl Speed {
    /// Most bytes of a packet.
    pub fn packet(self) -> usize {
        match self {
            Self::Full => 64,
            Self::High => 512,
        }
    }
}

/// Status of the instrument, as far as it is used.
///
/// # Source
/// The maker's data sheet of the Apex (892-00000-000-05-201302), command FE.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Status {
    /// Time of integration as the instrument counts it: µs by the data sheet.
    pub integration: u32,
    /// Speed of the bus.
    pub speed: Speed,
}

fn wrong<V>(found: &[u8], expected: &'static str) -> Result<V, ReplyError> {
    Err(ReplyError::new(&crate::recording::hex_excerpt(found), expected))
}

/// Bytes that set a time of integration.
pub fn set_integration(model: &Model, us: u32) -> [u8; 5] {
    let [a, b, c, d] = (us / model.unit_us).to_le_bytes();
    [command::INTEGRATION, a, b, c, d]
}

/// Reads the answer of a slot: its 15 bytes.
///
/// # Errors
/// Another length, another command's answer, another slot.
pub fn slot_bytes(slot: u8, answer: &[u8]) -> Result<[u8; 15], ReplyError> {
    let [command::SLOT, of, data @ ..] = answer else {
        return wrong(answer, "05, the answer of a slot");
    };
    if *of != slot {
        return wrong(answer, "the answer of the slot that was asked for");
    }
    match data.try_into() {
        Ok(data) => Ok(data),
        Err(_) => wrong(answer, "17 bytes, the answer of a slot"),
    }
}

/// Reads the text of a slot: up to the first zero, without blanks around it.
///
/// # Errors
/// Those of [`slot_bytes`]; bytes that are no text, or none (it was not written).
pub fn slot_text(slot: u8, answer: &[u8]) -> Result<String, ReplyError> {
    let bytes = slot_bytes(slot, answer)?;
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    let good = |byte: &u8| byte.is_ascii_graphic() || *byte == b' ';
    let text: String = bytes[..end].iter().map(|byte| char::from(*byte)).collect();
    let text = text.trim();
    if text.is_empty() || !bytes[..end].iter().all(good) {
        return wrong(&bytes, "text in the slot (was it ever written?)");
    }
    Ok(text.to_owned())
}

/// Reads the number of a slot.
///
/// # Errors
/// Those of [`slot_text`]; text that is no decimal number.
pub fn slot_number(slot: u8, answer: &[u8]) -> Result<f64, ReplyError> {
    number(&slot_text(slot, answer)?)
}

/// Reads the order of a polynomial: up to 7.
///
/// # Errors
/// Those of [`slot_number`]; another number.
pub fn slot_order(slot: u8, answer: &[u8]) -> Result<u8, ReplyError> {
    let order = slot_number(slot, answer)?;
    match (0..=7_u8).find(|whole| f64::from(*whole) == order) {
        Some(order) => Ok(order),
        None => wrong(answer, "an order of 0 to 7"),
    }
}

/// Reads the value at which the converter saturates; `None` where the slot does not say it.
///
/// # Errors
/// Those of [`slot_bytes`].
pub fn saturation(model: &Model, answer: &[u8]) -> Result<Option<u16>, ReplyError> {
    let bytes = slot_bytes(slot::SATURATION, answer)?;
    let word = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
    Ok(match model.slot_17 {
        Saturation::Unused => None,
        Saturation::Word { at } => Some(word(at)).filter(|value| *value > 0),
        Saturation::Long { at } => match word(at + 2) {
            0 => Some(word(at)).filter(|value| *value > 0),
            _ => None,
        },
        Saturation::FirstWord => {
            Some(word(0)).filter(|value| *value > 0x8000 && *value <= model.saturation)
        }
    })
}

/// Reads a status.
///
/// # Errors
/// Another length; a speed that has no name.
pub fn status(answer: &[u8]) -> Result<Status, ReplyError> {
    if answer.len() != STATUS_LENGTH {
        return wrong(answer, "16 bytes, the status");
    }
    let speed = match answer[14] {
        0x00 => Speed::Full,
        0x80 => Speed::High,
        _ => return wrong(&answer[14..15], "00 or 80, the speed of the bus"),
    };
    let integration = u32::from_le_bytes([answer[2], answer[3], answer[4], answer[5]]);
    Ok(Status { integration, speed })
}

/// Reads the version of the gate array: its three numbers.
///
/// # Errors
/// Another length, another command's answer. (A Flame-S begins its answer with FE, others with the register's number.)
pub fn firmware(answer: &[u8]) -> Result<[u8; 3], ReplyError> {
    match answer {
        [0x04 | 0xfe, low, high] => Ok([high >> 4, (high << 4) | (low >> 4), low & 0x0f]),
        _ => wrong(answer, "the version of the gate array, three bytes from 04 or fe"),
    }
}

/// Reads a frame: the counts of the detector's pixels.
///
/// # Errors
/// Another length; no mark at the end where the model has one; a value that its converter does not have.
pub fn spectrum(model: &Model, frame: &[u8]) -> Result<Vec<u16>, ReplyError> {
    if frame.len() != model.frame_length() {
        let found = format!("{} bytes", frame.len());
        return Err(ReplyError::new(&found, "as many as a spectrum of this model has"));
    }
    if model.ends_with_mark && frame.last() != Some(&MARK) {
        return wrong(&frame[frame.len() - 1..], "69, the mark at a spectrum's end");
    }
    let most = 0xffff_u16 >> (16 - model.bits.clamp(1, 16));
    let mut counts = Vec::with_capacity(model.pixels);
    for pixel in 0..model.pixels.min(model.values) {
        let value = match model.layout {
            Layout::Words => u16::from_le_bytes([frame[2 * pixel], frame[2 * pixel + 1]]),
            Layout::Halves => {
                let low = pixel / 64 * 128 + pixel % 64;
                // The high bits are those of whatever is on the wires.
                u16::from_le_bytes([frame[low], frame[low + 64]]) & most
            }
        };
        let value = value ^ model.flipped;
        if value > most {
            let found = format!("{value} counts at pixel {pixel}");
            return Err(ReplyError::new(&found, "no more than its converter has"));
        }
        counts.push(value);
    }
    Ok(counts)
}
