//! Answers of Elliptec modules.

use crate::reply::ReplyError;

/// The longest line, bytes, with its end.
pub const LONGEST_LINE: usize = 64;

/// Information that a module gives about itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Info {
    /// Number of the model: 14 for an ELL14.
    pub model: u8,
    /// Serial number.
    pub serial: String,
    /// Year in which it was made.
    pub year: u16,
    /// Firmware's release.
    pub firmware: u8,
    /// Travel, deg or mm.
    pub travel: u16,
    /// Pulses of the whole travel of a rotation mount (a turn), or of a mm.
    pub pulses: u32,
}

impl Info {
    /// Name of the stage's kind where it is known to be no rotation mount.
    pub fn other_kind(&self) -> Option<&'static str> {
        match self.model {
            6 | 9 | 12 => Some("a slider"),
            7 | 10 | 17 | 20 => Some("a linear stage"),
            15 => Some("an iris"),
            3 | 5 => Some("a polarisation controller"),
            _ => None,
        }
    }
}

/// One answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Reply {
    /// `IN`: who it is.
    Info(Info),
    /// `GS`: its state.
    Status(u8),
    /// `PO`: its position, pulses.
    Position(i32),
    /// `GV`: its speed, percent.
    Speed(u8),
    /// Another one of the protocol.
    Other,
}

/// Busy.
pub const BUSY: u8 = 9;

/// A state in words.
pub fn status(code: u8) -> &'static str {
    match code {
        0 => "no error",
        1 => "a command came without its end",
        2 => "mechanical timeout: it is blocked, or the motor's frequency is not tuned",
        3 => "it does not know the command",
        4 => "value out of range",
        5 => "it is isolated",
        6 => "it is out of isolation",
        7 => "initialising failed",
        8 => "thermal error",
        9 => "busy",
        10 => "sensor error",
        11 => "motor error",
        12 => "out of its travel",
        13 => "too much current",
        _ => "an error that the protocol does not name",
    }
}

fn hex(text: &str) -> Option<u32> {
    let good = text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'A'..=b'F'));
    u32::from_str_radix(text, 16).ok().filter(|_| good)
}

/// One line: the address (0 to 15) and the answer.
///
/// # Errors
/// Anything that the protocol does not know: another length, small letters, digits that are none.
pub fn parse(line: &[u8]) -> Result<(u8, Reply), ReplyError> {
    let shown = String::from_utf8_lossy(line);
    let wrong = |expected| ReplyError::new(&shown, expected);
    let text = line.strip_suffix(b"\r\n").and_then(|text| std::str::from_utf8(text).ok());
    let text =
        text.filter(|text| text.is_ascii()).ok_or_else(|| wrong("a line of ASCII with CR LF"))?;
    let address = text.get(..1).and_then(hex).and_then(|address| u8::try_from(address).ok());
    let address = address.ok_or_else(|| wrong("an address, 0 to F"))?;
    let (name, data) = (text.get(1..3).unwrap_or(""), text.get(3..).unwrap_or(""));
    let digits = |from: usize, to: usize| data.get(from..to).and_then(hex);
    let byte = |from: usize| digits(from, from + 2).and_then(|byte| u8::try_from(byte).ok());
    let reply = match (name, data.len()) {
        ("GS", 2) => byte(0).map(Reply::Status),
        ("PO", 8) => digits(0, 8).map(|pulses| Reply::Position(pulses.cast_signed())),
        ("GV", 2) => byte(0).filter(|percent| *percent <= 100).map(Reply::Speed),
        ("IN", 30) => info(data),
        ("HO" | "GJ" | "BO", 8) => digits(0, 8).map(|_| Reply::Other),
        ("BS", 2) => byte(0).map(|_| Reply::Other),
        ("I1" | "I2" | "I3", 22) => Some(Reply::Other),
        _ => None,
    };
    reply.map(|reply| (address, reply)).ok_or_else(|| wrong("an answer of the protocol"))
}

fn info(data: &str) -> Option<Reply> {
    let part = |from: usize, to: usize| data.get(from..to);
    let byte = |from: usize| part(from, from + 2).and_then(hex).and_then(|b| u8::try_from(b).ok());
    let serial = part(2, 10).filter(|s| s.bytes().all(|b| b.is_ascii_alphanumeric()))?;
    let year = part(10, 14).filter(|y| y.bytes().all(|b| b.is_ascii_digit()))?;
    // The last bit of hardware says which thread it has; nobody asks.
    byte(16)?;
    Some(Reply::Info(Info {
        model: byte(0)?,
        serial: serial.to_owned(),
        year: year.parse().ok()?,
        firmware: byte(14)?,
        travel: part(18, 22).and_then(hex).and_then(|t| u16::try_from(t).ok())?,
        pulses: part(22, 30).and_then(hex)?,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: lines as the packages elliptec 0.1.0 and pylablib 1.4.3 read them: an ELL14 of 143,360 pulses a turn.
    #[test]
    fn lines_are_read_strictly() {
        let info = Info {
            model: 14,
            serial: "11400519".into(),
            year: 2021,
            firmware: 0x16,
            travel: 360,
            pulses: 143_360,
        };
        let line = b"0IN0E1140051920211601016800023000\r\n";
        assert_eq!(parse(line), Ok((0, Reply::Info(info))));
        assert_eq!(parse(b"AGS09\r\n"), Ok((10, Reply::Status(BUSY))));
        assert_eq!(parse(b"0POFFFFFFFF\r\n"), Ok((0, Reply::Position(-1))));
        assert_eq!(parse(b"0GV64\r\n"), Ok((0, Reply::Speed(100))));
        assert_eq!(parse(b"0HO00000000\r\n"), Ok((0, Reply::Other)));
        for wrong in [
            &b"0GS0\r\n"[..],
            b"0GS000\r\n",
            b"0gs00\r\n",
            b"GGS00\r\n",
            b"0PO0000200\r\n",
            b"0POffffffff\r\n",
            b"0PO+0000200\r\n",
            b"0GV65\r\n",
            b"0GS00\n",
            b"\r\n",
            b"",
            b"0IN\r\n",
            b"0XX00\r\n",
            b"0PO\xff0000000\r\n",
            b"0IN0E11400519 0211601016800023000\r\n",
        ] {
            assert!(parse(wrong).is_err(), "{}", wrong.escape_ascii());
        }
    }
}
