//! The frames that the bridge sends: strictly parsed, in bounded memory, each with its number and checksum.
//!
//! A frame that is damaged, missing or twice ends the conversation: there is no way to be sure of what comes after it.

use crate::tags::RECORD_BYTES;
use flate2::Crc;
use serde_json::Value;

/// The version of requests and frames.
pub const PROTOCOL: u64 = 1;
/// The longest payload, bytes: 65,536 tags.
pub const MOST_PAYLOAD: usize = 65_536 * RECORD_BYTES;
/// The most channels of a bin.
pub const MOST_CHANNELS: usize = 64;

/// Bytes before the payload, and behind it.
const HEAD: usize = 9;
const TAIL: usize = 4;
/// Bytes of a bin before its counts.
const BIN_HEAD: usize = 32;

/// The bits of [`Bin::flags`].
pub const BIN_OVERFLOW: u32 = 1;
/// The counter reported an error in the bin.
pub const BIN_ERROR: u32 = 2;
/// Reports of missed events were lost themselves.
pub const BIN_LOST: u32 = 4;

/// A finished bin as the bridge sends it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Bin {
    /// Start on the counter's clock, ps.
    pub start_ps: i64,
    /// Length, ps.
    pub width_ps: i64,
    /// When the bridge read it from the vendor's library: the computer's clock, ns since 1970 (Unix time).
    pub read_ns: i64,
    /// [`BIN_OVERFLOW`], [`BIN_ERROR`], [`BIN_LOST`].
    pub flags: u32,
    /// Events of each channel.
    pub counts: Vec<u64>,
    /// Events of each channel that the counter says it missed.
    pub missed: Vec<u64>,
}

/// One frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Frame {
    /// An answer, or an error that nobody asked for.
    Json(Value),
    /// A finished bin.
    Bin(Bin),
    /// Whole 16-byte records (see [`tags`](crate::tags)).
    Tags(Vec<[u8; RECORD_BYTES]>),
}

/// Fault in a frame.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FrameError {
    /// A payload that is too long.
    #[error("frame {number} announces {length} bytes, expected at most {MOST_PAYLOAD}")]
    TooLong {
        /// The frame's number.
        number: u32,
        /// Length that the frame announces, bytes.
        length: u32,
    },
    /// A kind that is not defined.
    #[error("frame {number} is of kind 0x{kind:02x}, expected J, C or T")]
    Kind {
        /// The frame's number.
        number: u32,
        /// The kind.
        kind: u8,
    },
    /// A frame that is missing or twice.
    #[error("frame {found} came, expected frame {expected}")]
    Number {
        /// The number that came.
        found: u32,
        /// The number that is due.
        expected: u32,
    },
    /// A checksum that does not fit.
    #[error("the checksum of frame {number} is {found:08x}, expected {expected:08x}")]
    Checksum {
        /// The frame's number.
        number: u32,
        /// Checksum that came.
        found: u32,
        /// Checksum of the bytes that came.
        expected: u32,
    },
    /// A payload that is not what its kind says.
    #[error("frame {number}: {reason}")]
    Payload {
        /// The frame's number.
        number: u32,
        /// Description of the fault.
        reason: String,
    },
}

/// Frames out of bytes that come in pieces.
#[derive(Debug, Default)]
pub struct Parser {
    held: Vec<u8>,
    start: usize,
    number: u32,
    failed: Option<FrameError>,
}

impl Parser {
    /// A parser that waits for frame 0.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes bytes. Take the frames out between two pieces, so that memory stays bounded.
    pub fn feed(&mut self, bytes: &[u8]) {
        if self.failed.is_some() {
            return;
        }
        if self.start > 0 {
            self.held.drain(..self.start);
            self.start = 0;
        }
        self.held.extend_from_slice(bytes);
    }

    /// Bytes that are held: less than a frame, and the last piece.
    pub fn held_bytes(&self) -> usize {
        self.held.len() - self.start
    }

    /// The next frame, if all of it is there.
    ///
    /// # Errors
    /// The first thing that is wrong; it stays so.
    pub fn frame(&mut self) -> Result<Option<Frame>, FrameError> {
        if let Some(error) = &self.failed {
            return Err(error.clone());
        }
        self.next().inspect_err(|error| {
            self.held = Vec::new();
            self.start = 0;
            self.failed = Some(error.clone());
        })
    }

    fn next(&mut self) -> Result<Option<Frame>, FrameError> {
        let bytes = &self.held[self.start..];
        let (Some(length), Some(&kind), Some(number)) =
            (word(bytes, 0), bytes.get(4), word(bytes, 5))
        else {
            return Ok(None);
        };
        if number != self.number {
            return Err(FrameError::Number { found: number, expected: self.number });
        }
        if !matches!(kind, b'J' | b'C' | b'T') {
            return Err(FrameError::Kind { number, kind });
        }
        let size = length as usize;
        if size > MOST_PAYLOAD {
            return Err(FrameError::TooLong { number, length });
        }
        let Some(found) = word(bytes, HEAD + size) else { return Ok(None) };
        let expected = checksum(&bytes[..HEAD + size]);
        if found != expected {
            return Err(FrameError::Checksum { number, found, expected });
        }
        let frame = payload(kind, &bytes[HEAD..HEAD + size])
            .map_err(|reason| FrameError::Payload { number, reason })?;
        self.start += HEAD + size + TAIL;
        self.number = self.number.wrapping_add(1);
        Ok(Some(frame))
    }
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|word| u32::from_le_bytes(*word))
}

fn long(bytes: &[u8], at: usize) -> Option<u64> {
    bytes.get(at..)?.first_chunk().map(|word| u64::from_le_bytes(*word))
}

/// CRC-32 as zlib has it.
pub(crate) fn checksum(bytes: &[u8]) -> u32 {
    let mut crc = Crc::new();
    crc.update(bytes);
    crc.sum()
}

fn payload(kind: u8, bytes: &[u8]) -> Result<Frame, String> {
    match kind {
        b'J' => serde_json::from_slice(bytes).map(Frame::Json).map_err(|error| error.to_string()),
        b'C' => bin(bytes).map(Frame::Bin),
        _ => match bytes.as_chunks() {
            (records, []) => Ok(Frame::Tags(records.to_vec())),
            _ => Err(format!("{} bytes of tags, expected whole records of 16", bytes.len())),
        },
    }
}

fn bin(bytes: &[u8]) -> Result<Bin, String> {
    let channels = word(bytes, 28).filter(|n| *n as usize <= MOST_CHANNELS);
    let fits = channels.filter(|n| bytes.len() == BIN_HEAD + 16 * *n as usize);
    let (Some(n), Some(start), Some(width), Some(read), Some(flags)) =
        (fits, long(bytes, 0), long(bytes, 8), long(bytes, 16), word(bytes, 24))
    else {
        return Err(format!(
            "a bin of {} bytes and {channels:?} channels, expected 32 + 16 for each channel",
            bytes.len()
        ));
    };
    if flags & !(BIN_OVERFLOW | BIN_ERROR | BIN_LOST) != 0 {
        return Err(format!("a bin with flags {flags:#x}, expected 0 to 7"));
    }
    let width_ps = width.cast_signed();
    let start_ps = start.cast_signed();
    if width_ps <= 0 || start_ps.checked_add(width_ps).is_none() {
        return Err(format!("a bin of {width_ps} ps from {start_ps} ps"));
    }
    let (words, _) = bytes[BIN_HEAD..].as_chunks();
    let values: Vec<u64> = words.iter().map(|word| u64::from_le_bytes(*word)).collect();
    let (counts, missed) = values.split_at(n as usize);
    let (counts, missed) = (counts.to_vec(), missed.to_vec());
    Ok(Bin { start_ps, width_ps, read_ns: read.cast_signed(), flags, counts, missed })
}

/// The bytes of a frame: for the simulated bridge and for tests. What is longer than a frame may be is not cut: the
/// parser refuses it.
pub fn emit(frame: &Frame, number: u32) -> Vec<u8> {
    let (kind, payload) = match frame {
        Frame::Json(value) => (b'J', value.to_string().into_bytes()),
        Frame::Tags(records) => (b'T', records.as_flattened().to_vec()),
        Frame::Bin(bin) => (b'C', bin_bytes(bin)),
    };
    let length = u32::try_from(payload.len()).unwrap_or(u32::MAX);
    let mut bytes = length.to_le_bytes().to_vec();
    bytes.push(kind);
    bytes.extend(number.to_le_bytes());
    bytes.extend(payload);
    let crc = checksum(&bytes);
    bytes.extend(crc.to_le_bytes());
    bytes
}

fn bin_bytes(bin: &Bin) -> Vec<u8> {
    let mut bytes = Vec::new();
    for value in [bin.start_ps, bin.width_ps, bin.read_ns] {
        bytes.extend(value.to_le_bytes());
    }
    bytes.extend(bin.flags.to_le_bytes());
    bytes.extend((bin.counts.len() as u32).to_le_bytes());
    for value in bin.counts.iter().chain(&bin.missed) {
        bytes.extend(value.to_le_bytes());
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: Python 3.11's `struct` and `zlib.crc32` made these bytes from the layout in `bridge/swabian.py`.
    #[test]
    fn frames_are_pythons() {
        // struct.pack("<IcI", 2, b"J", 0) + b"{}" + struct.pack("<I", zlib.crc32(all before))
        let json = [2, 0, 0, 0, b'J', 0, 0, 0, 0, b'{', b'}'];
        let mut parser = Parser::new();
        parser.feed(&json);
        assert_eq!(parser.frame(), Ok(None));
        let crc = checksum(&json);
        // zlib.crc32(b"123456789") is the check value of CRC-32/ISO-HDLC.
        assert_eq!(checksum(b"123456789"), 0xcbf4_3926);
        parser.feed(&crc.to_le_bytes());
        assert_eq!(parser.frame(), Ok(Some(Frame::Json(serde_json::json!({})))));
        assert_eq!((parser.frame(), parser.held_bytes()), (Ok(None), 0));
    }

    #[test]
    fn what_is_wrong_is_named_and_stays_wrong() {
        let bin = Bin {
            start_ps: -5,
            width_ps: 10,
            read_ns: 7,
            flags: BIN_OVERFLOW,
            counts: vec![1, u64::MAX],
            missed: vec![0, 3],
        };
        let good = emit(&Frame::Bin(bin.clone()), 0);
        let read = |bytes: &[u8]| {
            let mut parser = Parser::new();
            parser.feed(bytes);
            let frame = parser.frame();
            if frame.is_err() {
                assert_eq!(parser.frame(), frame);
                assert_eq!(parser.held_bytes(), 0);
            }
            frame.map_err(|error| error.to_string())
        };
        assert_eq!(read(&good), Ok(Some(Frame::Bin(bin.clone()))));
        let changed = |at: usize, value: u8| {
            let mut bytes = good.clone();
            bytes[at] = value;
            read(&bytes).unwrap_err()
        };
        assert!(changed(2, 0x20).contains("announces 2097216 bytes, expected at most 1048576"));
        assert!(changed(4, b'X').contains("kind 0x58"));
        assert_eq!(changed(5, 1), "frame 1 came, expected frame 0");
        assert!(changed(50, 9).contains("the checksum of frame 0"));
        let other = |bin: Bin| read(&emit(&Frame::Bin(bin), 0)).unwrap_err();
        assert!(other(Bin { width_ps: 0, ..bin.clone() }).contains("a bin of 0 ps from -5 ps"));
        assert!(other(Bin { flags: 8, ..bin.clone() }).contains("flags 0x8"));
        assert!(other(Bin { missed: vec![1], ..bin.clone() }).contains("a bin of 56 bytes"));
        let late = Bin { start_ps: i64::MAX - 3, ..bin };
        assert!(other(late).contains("a bin of 10 ps from 9223372036854775804 ps"));
        let tags = Frame::Tags(vec![[3; 16]]);
        assert_eq!(read(&emit(&tags, 0)), Ok(Some(tags)));
    }
}
