//! Frames of the Ocean Binary Protocol.

use super::md5;
use crate::reply::ReplyError;

/// Bytes before the data.
pub const HEAD: usize = 44;
/// Bytes behind the data: the checksum and the end.
pub const TAIL: usize = 20;
/// Most data of a frame, bytes: 32 times a spectrum.
pub const MOST_DATA: usize = 1 << 17;
/// Data that fits into the head, bytes.
const IMMEDIATE: usize = 16;
const START: [u8; 2] = [0xc1, 0xc0];
const VERSION: u16 = 0x1100;
/// Version of the protocol's successor, which has other messages.
const VERSION_2: u16 = 0x2000;
const END: [u8; 4] = [0xc5, 0xc4, 0xc3, 0xc2];

/// Flags of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Flags(pub u16);

impl Flags {
    /// An answer.
    pub const RESPONSE: u16 = 0x01;
    /// It did what it was told.
    pub const ACK: u16 = 0x02;
    /// The host wants to know that it did it.
    pub const ASK_ACK: u16 = 0x04;
    /// It did not.
    pub const NACK: u16 = 0x08;
    /// The hardware failed.
    pub const EXCEPTION: u16 = 0x10;

    /// Whether any of these is set.
    pub fn any(self, bits: u16) -> bool {
        self.0 & bits != 0
    }
}

/// Numbers of messages.
pub mod message {
    /// Serial number, text.
    pub const SERIAL: u32 = 0x0000_0100;
    /// Longest serial number, u8.
    pub const SERIAL_LENGTH: u32 = 0x0000_0101;
    /// Product number on USB, u16.
    pub const PRODUCT: u32 = 0x0000_0e01;
    /// Spectrum of the HDX and the FX.
    pub const SPECTRUM_HDX: u32 = 0x0010_1000;
    /// Spectrum of the others.
    pub const SPECTRUM: u32 = 0x0010_1100;
    /// Time of integration, µs, u32.
    pub const INTEGRATION: u32 = 0x0011_0000;
    /// Sets it.
    pub const SET_INTEGRATION: u32 = 0x0011_0010;
    /// Number of coefficients of the wavelength, u8.
    pub const COEFFICIENTS: u32 = 0x0018_0100;
    /// One of them, f32, by its place, u8.
    pub const COEFFICIENT: u32 = 0x0018_0101;
    /// Number of coefficients of the nonlinearity, u8.
    pub const NONLINEARITIES: u32 = 0x0018_1100;
}

/// Error "the answer will take a while".
pub const DEFERRED: u16 = 255;

/// Meaning of an error.
pub fn meaning(error: u16) -> &'static str {
    match error {
        0 => "no reason given",
        1 => "a protocol that it does not speak",
        2 => "a message that it does not know",
        3 => "a wrong checksum",
        4 => "a message that is too long",
        5 => "data of another length than the message has",
        6 => "data that it does not take",
        7 => "it is not ready for this message",
        8 => "a kind of checksum that it does not know",
        9 => "it has started anew by itself",
        10 => "commands came over too many of its ports",
        11 => "it has no memory left for it",
        12 => "it does not have what was asked for",
        13 => "a fault within it, perhaps a lasting one",
        100 => "it could not decrypt it",
        101 => "firmware of an invalid layout",
        102 => "a packet of the wrong size",
        103 => "firmware for another hardware",
        104 => "firmware for another layout of its memory",
        DEFERRED => "the answer is put off",
        _ => "an error that has no name here",
    }
}

/// A frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    /// Flags of the frame.
    pub flags: Flags,
    /// Error of a refusal.
    pub error: u16,
    /// Number of the message.
    pub message: u32,
    /// Number that an answer repeats.
    pub regarding: u32,
    /// Whether it has a checksum.
    pub checked: bool,
    /// Data of the message.
    pub data: Vec<u8>,
}

impl Frame {
    /// A message of the host.
    pub fn new(message: u32, regarding: u32, data: &[u8]) -> Self {
        let data = data.to_vec();
        Self { flags: Flags(0), error: 0, message, regarding, checked: false, data }
    }

    /// Bytes of the message.
    pub fn emit(&self) -> Vec<u8> {
        let short = self.data.len() <= IMMEDIATE;
        let mut bytes = Vec::with_capacity(HEAD + self.data.len() + TAIL);
        bytes.extend(START);
        bytes.extend(VERSION.to_le_bytes());
        bytes.extend(self.flags.0.to_le_bytes());
        bytes.extend(self.error.to_le_bytes());
        bytes.extend(self.message.to_le_bytes());
        bytes.extend(self.regarding.to_le_bytes());
        bytes.extend([0; 6]);
        bytes.push(u8::from(self.checked));
        // At most 16.
        bytes.push(if short { self.data.len() as u8 } else { 0 });
        let immediate = if short { self.data.as_slice() } else { &[] };
        bytes.extend(immediate);
        bytes.resize(HEAD - 4, 0);
        let payload = if short { 0 } else { self.data.len() };
        bytes.extend(u32::try_from(payload + TAIL).unwrap_or(u32::MAX).to_le_bytes());
        if !short {
            bytes.extend(&self.data);
        }
        let sum = if self.checked { md5(&bytes) } else { [0; 16] };
        bytes.extend(sum);
        bytes.extend(END);
        bytes
    }
}

fn word(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn long(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

/// Reads the frame at the beginning of `bytes`, and gives it with its length; `None` while it is not all there.
///
/// # Errors
/// Bytes that are no frame of this protocol; a checksum that is not that of the bytes.
pub fn parse(bytes: &[u8]) -> Result<Option<(Frame, usize)>, ReplyError> {
    let wrong = |found: &[u8], expected| {
        Err(ReplyError::new(&crate::recording::hex_excerpt(found), expected))
    };
    let begin = bytes.len().min(2);
    if bytes[..begin] != START[..begin] {
        return wrong(&bytes[..begin], "c1 c0, the beginning of a frame");
    }
    if bytes.len() >= 4 {
        match word(bytes, 2) {
            VERSION => {}
            VERSION_2 => {
                return wrong(&bytes[2..4], "version 1100 (it speaks OBP 2, which is not driven)");
            }
            _ => return wrong(&bytes[2..4], "00 11, the version"),
        }
    }
    if bytes.len() < HEAD {
        return Ok(None);
    }
    let (kind, immediate) = (bytes[22], usize::from(bytes[23]));
    let remaining = usize::try_from(long(bytes, HEAD - 4)).unwrap_or(usize::MAX);
    if kind > 1 {
        return wrong(&[kind], "00 or 01, the kind of checksum");
    }
    if immediate > IMMEDIATE || !(TAIL..=TAIL + MOST_DATA).contains(&remaining) {
        return wrong(&bytes[23..HEAD], "lengths of data that fit into a frame");
    }
    if immediate > 0 && remaining > TAIL {
        return wrong(&bytes[23..HEAD], "data in the head or behind it, not both");
    }
    let whole = HEAD + remaining;
    if bytes.len() < whole {
        return Ok(None);
    }
    let (payload, tail) = bytes[HEAD..whole].split_at(remaining - TAIL);
    if tail[16..] != END {
        return wrong(&tail[16..], "c5 c4 c3 c2, the end of a frame");
    }
    if kind == 1 && tail[..16] != md5(&bytes[..whole - TAIL]) {
        return wrong(&tail[..16], "the MD5 of its bytes");
    }
    let data = if immediate > 0 { &bytes[24..24 + immediate] } else { payload };
    let frame = Frame {
        flags: Flags(word(bytes, 4)),
        error: word(bytes, 6),
        message: long(bytes, 8),
        regarding: long(bytes, 12),
        checked: kind == 1,
        data: data.to_vec(),
    };
    Ok(Some((frame, whole)))
}
