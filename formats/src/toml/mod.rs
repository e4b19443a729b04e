//! TOML for what people write: stations, instruments, plans. Every error has the file, the line and the dotted key.
//!
//! A plain `#[derive(Deserialize)] #[serde(deny_unknown_fields)]` struct is enough; [`Document::parse`] turns what
//! serde says into a [`ParseError`](crate::ParseError). An unknown key is answered with the nearest known one, and a
//! key that differs only in its unit (`dead_time_us` for `dead_time_ns`) with the factor. [`Positive`], [`Fraction`]
//! and their like check numbers where they stand; [`Document::error_at`] makes the same error later, for checks across
//! keys.
//!
//! ```
//! use serde::Deserialize;
//! use sunglint_formats::toml::{Document, NonNegative};
//!
//! #[derive(Deserialize)]
//! #[serde(deny_unknown_fields)]
//! struct Channel {
//!     dead_time_ns: NonNegative,
//! }
//!
//! let document = Document::new("lab.toml", "dead_time_us = 0.022\n")?;
//! let error = document.parse::<Channel>().err().expect("the unit is wrong");
//! assert_eq!(
//!     error.to_string(),
//!     "lab.toml:1: dead_time_us: found an unknown key, expected `dead_time_ns` \
//!      (did you mean `dead_time_ns`? 1 us is 1000 ns: multiply the value by 1000)"
//! );
//! # Ok::<(), sunglint_formats::ParseError>(())
//! ```
//!
//! A field that serde reads through a buffer (`flatten`, untagged and internally tagged enums) loses the place of its
//! parts: the error then has the line of the whole.

mod deserializer;
mod document;
mod error;
mod numbers;
mod units;

use std::fmt::Write as _;

pub use document::Document;
pub use numbers::{Finite, Fraction, LatitudeDeg, LongitudeDeg, NonNegative, Positive, Within};

/// A text as a basic string of TOML 1.0, quotation marks and all: whatever is in it is read back the same.
///
/// ```
/// use sunglint_formats::toml::quoted;
///
/// assert_eq!(quoted("black \"paint\"\u{7f}"), r#""black \"paint\"\u007F""#);
/// ```
#[must_use]
pub fn quoted(text: &str) -> String {
    let mut made = String::with_capacity(text.len() + 2);
    made.push('"');
    for c in text.chars() {
        match c {
            '"' | '\\' => made.extend(['\\', c]),
            c if c.is_ascii_control() => {
                let _ = write!(made, "\\u{:04X}", u32::from(c));
            }
            c => made.push(c),
        }
    }
    made.push('"');
    made
}

#[cfg(test)]
mod tests {
    use super::quoted;

    /// Truth: the reader of the package `toml`: each character of the first 0x3000, alone and between others, is read back.
    #[test]
    fn what_is_quoted_is_read_back() {
        for c in (0..0x3000).filter_map(char::from_u32) {
            for text in [c.to_string(), format!("a{c}\\{c}\"b")] {
                let table: ::toml::Table = format!("name = {}", quoted(&text)).parse().unwrap();
                assert_eq!(table["name"].as_str(), Some(&*text), "U+{:04X}", u32::from(c));
            }
        }
    }
}
