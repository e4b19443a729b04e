//! One card of a header: 80 characters with a keyword, a value and a comment.

use super::{CARD, escape};
use crate::error::{EncodeError, excerpt};
use std::fmt;

/// A card of a header.
#[derive(Debug, Clone, PartialEq)]
pub struct Card {
    /// `EXPTIME`; a `HIERARCH` keyword without that word (`ESO DET DIT`); empty for a comment without keyword.
    pub keyword: String,
    /// The value.
    pub value: CardValue,
    /// The comment after the slash; empty if there is none. By custom it names the unit.
    pub comment: String,
}

/// The value of a card.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum CardValue {
    /// A value that is said to be unknown.
    Undefined,
    /// `T` or `F`.
    Logical(bool),
    /// A whole number.
    Integer(i64),
    /// A real number, or a whole one beyond 64 bits.
    Real(f64),
    /// Text; blanks at its end do not count.
    Text(String),
    /// The text of a COMMENT, a HISTORY, or another card without a value.
    Commentary(String),
    /// A value that is none of these (a complex number, or a writer's mistake), as it stands in the file.
    Other(String),
}

impl CardValue {
    /// The number, if it is one.
    pub fn real(&self) -> Option<f64> {
        match self {
            Self::Integer(value) => Some(*value as f64),
            Self::Real(value) => Some(*value),
            _ => None,
        }
    }

    /// The whole number, if it is one (`5.` counts).
    pub fn integer(&self) -> Option<i64> {
        match self {
            Self::Integer(value) => Some(*value),
            // 2^63 itself does not fit.
            Self::Real(value) if value.fract() == 0.0 && value.abs() < 9.2e18 => {
                Some(*value as i64)
            }
            _ => None,
        }
    }

    /// The text, if it is one.
    pub fn text(&self) -> Option<&str> {
        match self {
            Self::Text(value) => Some(value),
            _ => None,
        }
    }

    /// The truth value, if it is one.
    pub fn logical(&self) -> Option<bool> {
        match self {
            Self::Logical(value) => Some(*value),
            _ => None,
        }
    }
}

/// Formats the value for an error message.
impl fmt::Display for CardValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Undefined => f.write_str("no value"),
            Self::Logical(value) => f.write_str(if *value { "T" } else { "F" }),
            Self::Integer(value) => write!(f, "{value}"),
            Self::Real(value) => write!(f, "{value:?}"),
            Self::Text(text) => write!(f, "the text {}", excerpt(text)),
            Self::Commentary(_) => f.write_str("no value"),
            Self::Other(text) => f.write_str(&excerpt(text)),
        }
    }
}

impl From<bool> for CardValue {
    fn from(value: bool) -> Self {
        Self::Logical(value)
    }
}

impl From<i64> for CardValue {
    fn from(value: i64) -> Self {
        Self::Integer(value)
    }
}

impl From<f64> for CardValue {
    fn from(value: f64) -> Self {
        Self::Real(value)
    }
}

impl From<&str> for CardValue {
    fn from(value: &str) -> Self {
        Self::Text(value.trim_end_matches(' ').to_owned())
    }
}

impl From<String> for CardValue {
    fn from(value: String) -> Self {
        value.as_str().into()
    }
}

/// Whether a keyword fits the eight characters of the standard.
pub(super) fn is_standard_keyword(keyword: &str) -> bool {
    (1..=8).contains(&keyword.len())
        && keyword.bytes().all(|b| matches!(b, b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'_'))
}

impl Card {
    /// Reads a card. Bytes that are not printable ASCII become `?`. A `CONTINUE` is given as any other card; the header
    /// joins them.
    pub(super) fn parse(bytes: &[u8]) -> Self {
        let text: String = bytes
            .iter()
            .map(|&b| if (0x20..0x7f).contains(&b) { char::from(b) } else { '?' })
            .collect();
        let (keyword, rest) = text.split_at(8.min(text.len()));
        let keyword = keyword.trim_end();
        if let Some(value) = rest.strip_prefix("= ")
            && !matches!(keyword, "COMMENT" | "HISTORY" | "CONTINUE" | "")
        {
            return Self::with_value(keyword, value);
        }
        if keyword == "CONTINUE" {
            return Self::with_value(keyword, rest);
        }
        if keyword == "HIERARCH"
            && let Some((name, value)) = rest.split_once('=')
            && !name.trim().is_empty()
        {
            return Self::with_value(name.trim(), value);
        }
        let value = CardValue::Commentary(rest.trim_end().to_owned());
        Self { keyword: keyword.to_owned(), value, comment: String::new() }
    }

    fn with_value(keyword: &str, field: &str) -> Self {
        let (value, comment) = parse_value(field);
        Self { keyword: keyword.to_owned(), value, comment }
    }

    /// Writes the card, in as many cards of 80 bytes as it needs; its text with escapes if that is said.
    pub(super) fn encode(&self, escaped: bool, out: &mut Vec<u8>) -> Result<(), EncodeError> {
        if let CardValue::Commentary(text) = &self.value {
            return self.encode_commentary(text, escaped, out);
        }
        let standard = is_standard_keyword(&self.keyword);
        let start = if standard {
            format!("{:<8}= ", self.keyword)
        } else {
            check_ascii(&self.keyword, &self.keyword)?;
            if self.keyword.contains('=') || self.keyword.trim() != self.keyword {
                let expected = "a keyword without `=` and without blanks at its ends";
                return Err(EncodeError::new(&self.keyword, excerpt(&self.keyword), expected));
            }
            format!("HIERARCH {} = ", self.keyword)
        };
        let value = match &self.value {
            CardValue::Text(text) => {
                let text = match escaped {
                    true => &escape::escaped(text).collect(),
                    false => text,
                };
                check_ascii(&self.keyword, text)?;
                let quoted = format!("'{:<8}'", text.replace('\'', "''"));
                if start.len() + quoted.len() > CARD {
                    if standard {
                        return self.encode_long_text(&start, text, out);
                    }
                    return Err(EncodeError::new(
                        &self.keyword,
                        format!("a text of {} characters", text.len()),
                        "a text that fits into one card beside a keyword of more than 8 characters",
                    ));
                }
                format!("{quoted:<20}")
            }
            other => format!("{:>20}", encode_number(&self.keyword, other)?),
        };
        push_card(&self.keyword, format!("{start}{value}"), &self.comment, out)
    }

    fn encode_commentary(
        &self,
        text: &str,
        escaped: bool,
        out: &mut Vec<u8>,
    ) -> Result<(), EncodeError> {
        if !self.keyword.is_empty() && !is_standard_keyword(&self.keyword) {
            let expected = "a keyword of at most 8 capitals, digits, - and _";
            return Err(EncodeError::new(&self.keyword, excerpt(&self.keyword), expected));
        }
        let mut push_line =
            |line: &str| push_card(&self.keyword, format!("{:<8}{line}", self.keyword), "", out);
        let mut line = String::new();
        if escaped {
            // The cards of a long text are read one by one, so each escape must be whole in one.
            for piece in escape::escaped(text) {
                if line.len() + piece.len() > CARD - 8 {
                    push_line(&line)?;
                    line.clear();
                }
                line.push_str(&piece);
            }
        } else {
            check_ascii(&self.keyword, text)?;
            let mut rest = text;
            while rest.len() > CARD - 8 {
                let (start, more) = rest.split_at(CARD - 8);
                push_line(start)?;
                rest = more;
            }
            line.push_str(rest);
        }
        push_line(&line)
    }

    /// The long-string convention: pieces that end with `&`, on CONTINUE cards.
    fn encode_long_text(
        &self,
        start: &str,
        text: &str,
        out: &mut Vec<u8>,
    ) -> Result<(), EncodeError> {
        const PIECE: usize = CARD - 10 - 3; // two quotes and the ampersand
        let mut pieces = vec![String::new()];
        for c in text.chars() {
            let width = if c == '\'' { 2 } else { 1 };
            if pieces.last().is_some_and(|piece| piece.len() + width > PIECE) {
                pieces.push(String::new());
            }
            if let Some(piece) = pieces.last_mut() {
                piece.push(c);
                if c == '\'' {
                    piece.push(c);
                }
            }
        }
        let last = pieces.len() - 1;
        for (i, piece) in pieces.iter().enumerate() {
            let start = if i == 0 { start } else { "CONTINUE  " };
            let (more, comment) = if i < last { ("&", "") } else { ("", self.comment.as_str()) };
            push_card(&self.keyword, format!("{start}'{piece}{more}'"), comment, out)?;
        }
        Ok(())
    }
}

fn encode_number(keyword: &str, value: &CardValue) -> Result<String, EncodeError> {
    Ok(match value {
        CardValue::Undefined => String::new(),
        CardValue::Logical(value) => (if *value { "T" } else { "F" }).to_owned(),
        CardValue::Integer(value) => value.to_string(),
        CardValue::Real(value) if value.is_finite() => format!("{value:?}").to_uppercase(),
        CardValue::Real(value) => {
            return Err(EncodeError::new(keyword, value.to_string(), "a finite number"));
        }
        CardValue::Other(text) | CardValue::Text(text) | CardValue::Commentary(text) => {
            check_ascii(keyword, text)?;
            text.clone()
        }
    })
}

fn check_ascii(keyword: &str, text: &str) -> Result<(), EncodeError> {
    match text.chars().find(|c| !matches!(c, ' '..='~')) {
        None => Ok(()),
        Some(c) => Err(EncodeError::new(
            keyword,
            format!("the character {}", c.escape_unicode()),
            "printable ASCII (a FITS header holds nothing else)",
        )),
    }
}

/// Fills a card up; the comment is cut where the card ends.
fn push_card(
    keyword: &str,
    mut card: String,
    comment: &str,
    out: &mut Vec<u8>,
) -> Result<(), EncodeError> {
    if card.len() > CARD {
        let expected = "a keyword and a value that fit into 80 characters";
        return Err(EncodeError::new(keyword, excerpt(&card), expected));
    }
    if !comment.is_empty() && card.len() + 4 <= CARD {
        card.push_str(" / ");
        let room = CARD - card.len();
        card.extend(
            comment.chars().map(|c| if matches!(c, ' '..='~') { c } else { '?' }).take(room),
        );
    }
    out.extend_from_slice(format!("{card:<CARD$}").as_bytes());
    Ok(())
}

fn parse_value(field: &str) -> (CardValue, String) {
    let field = field.trim();
    if let Some(quoted) = field.strip_prefix('\'') {
        let mut text = String::new();
        let mut rest = quoted;
        while let Some(end) = rest.find('\'') {
            text.push_str(&rest[..end]);
            rest = &rest[end + 1..];
            if let Some(after) = rest.strip_prefix('\'') {
                text.push('\'');
                rest = after;
            } else {
                return (CardValue::from(text), comment_of(rest));
            }
        }
        return (CardValue::Other(field.to_owned()), String::new());
    }
    let (token, comment) = match field.find('/') {
        Some(slash) => (field[..slash].trim_end(), comment_of(&field[slash..])),
        None => (field, String::new()),
    };
    let value = match token {
        "" => CardValue::Undefined,
        "T" => CardValue::Logical(true),
        "F" => CardValue::Logical(false),
        _ => number(token).unwrap_or_else(|| CardValue::Other(token.to_owned())),
    };
    (value, comment)
}

fn comment_of(rest: &str) -> String {
    let rest = rest.trim_start();
    rest.strip_prefix('/').unwrap_or(rest).trim().to_owned()
}

fn number(token: &str) -> Option<CardValue> {
    if let Ok(value) = token.parse::<i64>() {
        return Some(CardValue::Integer(value));
    }
    // `nan` and `inf` are numbers to Rust, not to FITS; `D` is an exponent to FITS, not to Rust.
    let plain = token
        .bytes()
        .all(|b| matches!(b, b'0'..=b'9' | b'+' | b'-' | b'.' | b'E' | b'e' | b'D' | b'd'));
    let value = token.replace(['D', 'd'], "E").parse::<f64>().ok()?;
    (plain && value.is_finite()).then_some(CardValue::Real(value))
}
