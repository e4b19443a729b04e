//! Answers of an Acton monochromator.

use crate::reply::{ReplyError, integer, number};

/// Longest line of an answer, bytes.
pub const LONGEST_LINE: usize = 256;
/// Most lines of an answer: nine gratings, and what is around them.
pub const MOST_LINES: usize = 16;

/// End of an answer that has come so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// More lines will come.
    NotYet,
    /// It did it.
    Ok,
    /// It did not understand.
    NotUnderstood,
}

/// Whether a line ends an answer.
pub fn end_of(line: &str) -> End {
    let line = line.trim();
    if line.ends_with('?') {
        return End::NotUnderstood;
    }
    match line.strip_suffix("ok") {
        Some(before) if before.is_empty() || before.ends_with(char::is_whitespace) => End::Ok,
        _ => End::NotYet,
    }
}

/// A whole answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Answer {
    /// It did it, and says this.
    Good(String),
    /// It did not understand; its words.
    NotUnderstood(String),
}

impl Answer {
    /// Reads all lines of the answer to `command`, behind the echo where there is one.
    ///
    /// # Errors
    /// Other characters than text, another echo, or no end.
    pub fn parse(command: &str, echoes: bool, bytes: &[u8]) -> Result<Self, ReplyError> {
        let text = text(bytes)?;
        let end = end_of(&text);
        let body = text.trim();
        let body = match end {
            End::NotYet => return Err(ReplyError::new(body, "` ok` at the end of it")),
            End::NotUnderstood => return Ok(Self::NotUnderstood(body.to_owned())),
            // Its last two letters, which are there.
            End::Ok => body.strip_suffix("ok").unwrap_or(body),
        };
        let body = match (body.strip_prefix(command), echoes) {
            (Some(rest), true) => rest,
            (None, false) => body,
            (None, true) => return Err(ReplyError::new(body, "the command's echo before it")),
            (Some(_), false) => return Err(ReplyError::new(body, "no echo before it")),
        };
        Ok(Self::Good(body.trim().to_owned()))
    }
}

/// The text of bytes: what can be printed, ends of lines, and the arrow before the grating in use.
///
/// # Errors
/// Any other byte.
pub fn text(bytes: &[u8]) -> Result<String, ReplyError> {
    let printed = |byte: &u8| matches!(*byte, b' '..=b'~' | b'\r' | b'\n' | b'\t' | ARROW);
    let text: String = bytes.iter().map(|byte| char::from(*byte)).collect();
    match bytes.iter().all(printed) {
        true => Ok(text),
        false => Err(ReplyError::new(&text, "text")),
    }
}

/// The arrow before the grating in use.
const ARROW: u8 = 0x1a;

fn with_unit(body: &str, unit: &str, expected: &'static str) -> Result<f64, ReplyError> {
    let value = body.strip_suffix(unit).and_then(|value| number(value.trim_end()).ok());
    value.ok_or_else(|| ReplyError::new(body, expected))
}

/// A wavelength (`546.700 nm`), nm.
///
/// # Errors
/// Anything else.
pub fn wavelength_nm(body: &str) -> Result<f64, ReplyError> {
    with_unit(body, "nm", "a wavelength such as `546.700 nm`")
}

/// A speed (`100.000 nm/min`), nm/min.
///
/// # Errors
/// Anything else, or not more than zero.
pub fn speed_nm_min(body: &str) -> Result<f64, ReplyError> {
    let expected = "a speed such as `100.000 nm/min`";
    let speed = with_unit(body, "nm/min", expected)?;
    if speed > 0.0 { Ok(speed) } else { Err(ReplyError::new(body, expected)) }
}

/// Whether a move has ended (`1`) or not (`0`).
///
/// # Errors
/// Anything else.
pub fn is_done(body: &str) -> Result<bool, ReplyError> {
    match body {
        "1" => Ok(true),
        "0" => Ok(false),
        other => Err(ReplyError::new(other, "1 or 0")),
    }
}

/// The number of a grating, 1 to 9.
///
/// # Errors
/// Anything else.
pub fn grating(body: &str) -> Result<u8, ReplyError> {
    let number = integer(body).ok().and_then(|number| u8::try_from(number).ok());
    let number = number.filter(|number| (1..=9).contains(number));
    number.ok_or_else(|| ReplyError::new(body, "the number of a grating, 1 to 9"))
}

/// The model's name (`SP-2-150i`).
///
/// # Errors
/// Text that does not begin with a letter, or has spaces in it: the answer to another question.
pub fn model(body: &str) -> Result<String, ReplyError> {
    let letter = body.starts_with(|first: char| first.is_ascii_alphabetic());
    let name = body.len() >= 2 && body.bytes().all(|byte| byte.is_ascii_graphic());
    if letter && name {
        Ok(body.to_owned())
    } else {
        Err(ReplyError::new(body, "the model's name"))
    }
}

/// A grating that is installed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Grating {
    /// Number, from 1.
    pub number: u8,
    /// Grooves and blaze, in the instrument's words (`1200 g/mm BLZ=  500NM`).
    pub about: String,
}

/// Gratings that are installed, by the list that the instrument prints.
///
/// # Errors
/// A line that is none of a grating; none at all.
pub fn gratings(body: &str) -> Result<Vec<Grating>, ReplyError> {
    let mut installed = Vec::new();
    for line in body.lines() {
        let line = line.trim_matches(|c: char| c.is_whitespace() || c == char::from(ARROW));
        if line.is_empty() {
            continue;
        }
        let expected = "a number and a grating, such as `1 1200 g/mm BLZ=  500NM`";
        let (digits, about) =
            line.split_once(' ').ok_or_else(|| ReplyError::new(line, expected))?;
        let number = grating(digits).map_err(|_| ReplyError::new(line, expected))?;
        let about = about.trim();
        if !about.eq_ignore_ascii_case("not installed") {
            installed.push(Grating { number, about: about.to_owned() });
        }
    }
    match installed.is_empty() {
        true => Err(ReplyError::new(body, "a list of gratings")),
        false => Ok(installed),
    }
}
