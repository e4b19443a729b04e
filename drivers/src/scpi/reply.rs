//! Answers of instruments as they come over a line: where one ends, its text, its number, its complaints.

use crate::reply::{ReplyError, integer, number};
use std::fmt;

/// The longest answer, bytes; a longer one is no answer to a question of this driver.
pub const LONGEST_REPLY: usize = 64 << 10;

/// Cuts a list at its commas, not at those within quotes; quotes around a field are taken off.
pub(crate) fn fields(text: &str) -> Vec<String> {
    let mut fields = vec![String::new()];
    let mut quoted = false;
    for character in text.chars() {
        match (character, fields.last_mut()) {
            ('"', _) => quoted = !quoted,
            (',', _) if !quoted => fields.push(String::new()),
            (other, Some(field)) => field.push(other),
            (_, None) => {}
        }
    }
    fields.iter().map(|field| field.trim().to_owned()).collect()
}

/// Whether it is printable ASCII.
pub(crate) fn is_text(text: &str) -> bool {
    text.bytes().all(|byte| (b' '..=b'~').contains(&byte))
}

/// The answer to `SYST:ERR?`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Complaint {
    /// SCPI's number; 0 is no error.
    pub code: i32,
    /// The instrument's words.
    pub text: String,
}

impl Complaint {
    /// Reads `0,"No error"`.
    ///
    /// # Errors
    /// Anything else.
    pub fn parse(text: &str) -> Result<Self, ReplyError> {
        let error = || ReplyError::new(text, "a number and words such as `0,\"No error\"`");
        let (code, words) = text.split_once(',').ok_or_else(error)?;
        let words = words.trim().strip_prefix('"').and_then(|words| words.strip_suffix('"'));
        let words = words.filter(|_| is_text(text)).ok_or_else(error)?;
        Ok(Self { code: integer(code.trim()).map_err(|_| error())?, text: words.to_owned() })
    }
}

impl fmt::Display for Complaint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {}", self.code, self.text)
    }
}

/// Reader of one answer, byte by byte: it knows where a block of data (`#<d><length><bytes>`, IEEE 488.2 8.7.9) ends, in which an end of line is data.
#[derive(Debug, Clone)]
pub struct Framer {
    end: u8,
    bytes: Vec<u8>,
}

impl Framer {
    /// A reader of an answer that ends with the byte `end`.
    pub fn new(end: u8) -> Self {
        Self { end, bytes: Vec::new() }
    }

    /// Bytes that have come so far.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The bytes.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    /// Takes the next byte and returns whether the answer is whole.
    ///
    /// # Errors
    /// An answer of more than [`LONGEST_REPLY`] bytes, whether they have come or are announced.
    pub fn push(&mut self, byte: u8) -> Result<bool, ReplyError> {
        let too_long = |bytes: &[u8]| {
            let start = bytes.get(..bytes.len().min(20)).unwrap_or_default();
            Err(ReplyError::new(&String::from_utf8_lossy(start), "an answer of at most 64 KiB"))
        };
        if self.bytes.len() >= LONGEST_REPLY {
            return too_long(&self.bytes);
        }
        self.bytes.push(byte);
        match block(&self.bytes) {
            Block::None | Block::Spoilt => Ok(byte == self.end),
            Block::Head => Ok(false),
            Block::Of { start, length } if length > LONGEST_REPLY - start => too_long(&self.bytes),
            Block::Of { start, length } => {
                Ok(self.bytes.len() > start + length && byte == self.end)
            }
        }
    }
}

/// Beginning of an answer, if it is a block.
enum Block {
    None,
    /// The header is not whole yet.
    Head,
    /// It begins like a block and goes on otherwise: a line.
    Spoilt,
    Of {
        start: usize,
        length: usize,
    },
}

fn block(bytes: &[u8]) -> Block {
    let (digits, rest) = match bytes {
        [b'#'] => return Block::Head,
        // `#0` is a block up to the end of the message: a line.
        [b'#', digits @ b'1'..=b'9', rest @ ..] => (usize::from(digits - b'0'), rest),
        _ => return Block::None,
    };
    let head = rest.get(..digits.min(rest.len())).unwrap_or_default();
    if !head.iter().all(u8::is_ascii_digit) {
        return Block::Spoilt;
    }
    if head.len() < digits {
        return Block::Head;
    }
    // Nine digits at most.
    let length = head.iter().fold(0, |sum, digit| sum * 10 + usize::from(digit - b'0'));
    Block::Of { start: 2 + digits, length }
}

/// The text of an answer: without its line's end, and of a block what is in it.
///
/// # Errors
/// Bytes that are not printable ASCII; a block that is not whole, or with something behind it.
pub fn text_of(answer: &[u8]) -> Result<String, ReplyError> {
    let show = || String::from_utf8_lossy(answer).into_owned();
    let content = match block(answer) {
        Block::None => {
            let ends = |byte: &u8| matches!(byte, b'\r' | b'\n');
            let length = answer.iter().rposition(|byte| !ends(byte)).map_or(0, |last| last + 1);
            answer.get(..length).unwrap_or_default()
        }
        Block::Of { start, length } => {
            let end = start.saturating_add(length);
            let whole = ReplyError::new(&show(), "a block of as many bytes as it says");
            let rest = answer.get(end..).ok_or_else(|| whole.clone())?;
            if !rest.iter().all(|byte| matches!(byte, b'\r' | b'\n')) {
                return Err(whole);
            }
            answer.get(start..end).ok_or(whole)?
        }
        Block::Head | Block::Spoilt => {
            return Err(ReplyError::new(&show(), "a block of data, `#`, digits, bytes"));
        }
    };
    match std::str::from_utf8(content) {
        Ok(text) if is_text(text) => Ok(text.trim().to_owned()),
        _ => Err(ReplyError::new(&show(), "printable text")),
    }
}

/// A number at the beginning of a text, as instruments write it (`+1.2E-9`), and what is behind it. An `E` without digits behind it belongs to a unit.
pub fn number_at_start(text: &str) -> Option<(f64, &str)> {
    let bytes = text.as_bytes();
    let digits = |from: usize| {
        bytes.get(from..).unwrap_or_default().iter().take_while(|b| b.is_ascii_digit()).count()
    };
    let mut end = usize::from(matches!(bytes.first(), Some(b'+' | b'-')));
    end += digits(end);
    if bytes.get(end) == Some(&b'.') {
        end += 1 + digits(end + 1);
    }
    if let Some(b'e' | b'E') = bytes.get(end) {
        let sign = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
        let power = digits(end + 1 + sign);
        if power > 0 {
            end += 1 + sign + power;
        }
    }
    let (own, rest) = text.split_at_checked(end)?;
    Some((number(own).ok()?, rest))
}

/// Number that an instrument gives, by the rules of SCPI-99 (volume 1, 7.2.1).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Given {
    /// A number.
    Number(f64),
    /// Beyond the range: ±9.9E37, or what the device's file says.
    Over,
    /// Not a number: 9.91E37.
    NotANumber,
}

impl Given {
    /// Sorts a number; `overflow` is the magnitude from which on it means too much.
    pub fn of(number: f64, overflow: f64) -> Self {
        /// SCPI's sign for "not a number".
        const NOT_A_NUMBER: f64 = 9.91e37;
        if (number.abs() / NOT_A_NUMBER - 1.0).abs() < 1e-4 {
            Self::NotANumber
        } else if number.abs() >= overflow {
            Self::Over
        } else {
            Self::Number(number)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn framed(bytes: &[u8]) -> Vec<usize> {
        let mut framer = Framer::new(b'\n');
        let mut ends = Vec::new();
        for (i, byte) in bytes.iter().enumerate() {
            if framer.push(*byte).unwrap() {
                ends.push(i + 1);
                framer = Framer::new(b'\n');
            }
        }
        ends
    }

    /// Truth: IEEE 488.2's definite blocks, laid out by hand: a line's end within one is data.
    #[test]
    fn answers_end_where_they_should() {
        assert_eq!(framed(b"1.2E-9A,12.3,0\r\n3\n"), [16, 18]);
        assert_eq!(framed(b"#15a\nb\nc\n7\n"), [9, 11]);
        assert_eq!(framed(b"#212abcdefghijkl\n"), [17]);
        assert_eq!(framed(b"#1x\n"), [4], "a spoilt header is a line");
        assert_eq!(text_of(b"#13abc\n").unwrap(), "abc");
        assert_eq!(text_of(b" 1.5 \r\n").unwrap(), "1.5");
        for bad in [&b"#14abc\n"[..], b"#13abcd\n", b"#", b"#2", b"\xff\n", b"a\tb"] {
            assert!(text_of(bad).is_err(), "{bad:?}");
        }
        let mut framer = Framer::new(b'\n');
        let announced: Result<Vec<bool>, _> =
            b"#9999999999".iter().map(|byte| framer.push(*byte)).collect();
        assert!(announced.unwrap_err().to_string().contains("64 KiB"));
    }

    /// Truth: the numbers themselves, as the compiler reads them; SCPI-99's three.
    #[test]
    fn numbers_end_at_their_unit() {
        assert_eq!(number_at_start("+1.2E-9A,12"), Some((1.2e-9, "A,12")));
        assert_eq!(number_at_start("5EUR"), Some((5.0, "EUR")));
        assert_eq!(number_at_start("3."), Some((3.0, "")));
        for bad in ["", "A", "-", ".5", "E5", "1E9999"] {
            assert_eq!(number_at_start(bad), None, "{bad}");
        }
        let of = |number| Given::of(number, 9.9e37);
        assert_eq!(of(9.91e37), Given::NotANumber);
        assert_eq!((of(9.9e37), of(-9.9e37)), (Given::Over, Given::Over));
        assert_eq!(of(-1e-12), Given::Number(-1e-12));
        assert_eq!(Given::of(1e10, 1e10), Given::Over);
    }
}
