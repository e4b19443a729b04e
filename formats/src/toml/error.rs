//! Errors that serde finds, kept in pieces until the place is known.

use super::units::other_unit;
use crate::error::{ParseError, nearest_names};
use serde::de::{Expected, Unexpected};
use std::fmt;
use std::path::Path;

/// An error on its way up through the tree: each level adds what it knows.
#[derive(Debug)]
pub(super) struct Error {
    pub kind: Kind,
    /// Byte of the source at which the value (or the key) begins; the innermost level that knows it sets it.
    pub at: Option<usize>,
    /// The value as a person would call it.
    pub value: Option<String>,
    /// The way to the value, innermost first.
    pub path: Vec<Step>,
}

/// One step into the tree.
#[derive(Debug)]
pub(super) enum Step {
    Key(String),
    Index(usize),
}

#[derive(Debug)]
pub(super) enum Kind {
    /// The value is not what the field wants.
    Value { found: String, expected: String },
    /// The table has a key that the struct does not.
    UnknownKey { key: String, known: &'static [&'static str] },
    /// The struct has a key that the table does not.
    MissingKey(&'static str),
    /// The text is not one of the variants.
    UnknownVariant { found: String, known: &'static [&'static str] },
    /// Whatever else a `Deserialize` says.
    Other(String),
}

impl Error {
    fn new(kind: Kind) -> Self {
        Self { kind, at: None, value: None, path: Vec::new() }
    }

    /// The place, unless a deeper level knew it.
    pub fn at(mut self, byte: usize, value: String) -> Self {
        if self.at.is_none() {
            self.at = Some(byte);
            self.value = Some(value);
        }
        self
    }

    /// The step by which the level above came here.
    pub fn within(mut self, step: Step) -> Self {
        self.path.push(step);
        self
    }

    /// The error for people. `source` is the text of the file.
    pub fn finish(self, file: &Path, source: &str) -> ParseError {
        let mut steps = self.path;
        steps.reverse();
        let value = self.value;
        let found_or = |found: String| value.clone().unwrap_or(found);
        let (found, expected, hint) = match self.kind {
            Kind::Value { found, expected } => (found_or(found), for_people(&expected), None),
            Kind::UnknownKey { key, known } => {
                let (expected, hint) = suggest(&key, known);
                steps.push(Step::Key(key));
                ("an unknown key".to_owned(), expected, hint)
            }
            Kind::MissingKey(key) => {
                steps.push(Step::Key(key.to_owned()));
                ("no such key".to_owned(), "one: it is required".to_owned(), None)
            }
            Kind::UnknownVariant { found, known } => {
                let (expected, hint) = suggest(&found, known);
                (found_or(format!("\"{found}\"")), expected.replace('`', "\""), hint)
            }
            Kind::Other(message) => {
                (found_or("it".to_owned()), "a valid value".to_owned(), Some(message))
            }
        };
        let mut error = ParseError::new(file, found, expected);
        if let Some(byte) = self.at {
            error = error.at_line(crate::read::line_of(source, byte));
        }
        if !steps.is_empty() {
            error = error.in_field(dotted(&steps));
        }
        match hint {
            Some(hint) => error.with_hint(hint),
            None => error,
        }
    }
}

/// `channel[2].dead_time_ns`.
fn dotted(steps: &[Step]) -> String {
    let mut text = String::new();
    for step in steps {
        match step {
            Step::Key(key) if text.is_empty() => text.push_str(key),
            Step::Key(key) => {
                text.push('.');
                text.push_str(key);
            }
            Step::Index(index) => text.push_str(&format!("[{index}]")),
        }
    }
    text
}

/// Returns the names that were expected instead of an unknown one, and the hint.
fn suggest(unknown: &str, known: &[&'static str]) -> (String, Option<String>) {
    if let Some((name, hint)) = other_unit(unknown, known) {
        return (format!("`{name}`"), Some(hint));
    }
    let quoted: Vec<String> = known.iter().map(|name| format!("`{name}`")).collect();
    let expected = match quoted.as_slice() {
        [] => "no key at all".to_owned(),
        [one] => one.clone(),
        [rest @ .., last] => format!("{} or {last}", rest.join(", ")),
    };
    let nearest = nearest_names(unknown, known.iter().copied(), 1);
    (expected, nearest.first().map(|name| format!("did you mean `{name}`?")))
}

/// serde's name of a type in plain words.
fn for_people(expected: &str) -> String {
    let plain = match expected {
        "f64" | "f32" => "a number",
        "u8" => "a whole number from 0 to 255",
        "u16" => "a whole number from 0 to 65535",
        "u32" => "a whole number from 0 to 4294967295",
        "u64" | "usize" | "u128" => "a whole number of 0 or above",
        "i8" | "i16" | "i32" | "i64" | "isize" | "i128" => "a whole number",
        "a nonzero u8" | "a nonzero u16" | "a nonzero u32" | "a nonzero u64"
        | "a nonzero usize" => "a whole number above 0",
        "a string" | "a borrowed string" | "path string" => "text in quotes",
        "a boolean" => "true or false",
        "a sequence" => "an array",
        "a map" => "a table",
        other if other.starts_with("struct ") => "a table",
        other if other.starts_with("tuple struct ") => "an array",
        other
            if other.starts_with("an array of length ")
                || other.starts_with("a tuple of size ") =>
        {
            let n = other.rsplit(' ').next().unwrap_or("");
            return format!("an array of {n}");
        }
        other => other,
    };
    plain.to_owned()
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.kind)
    }
}

impl std::error::Error for Error {}

impl serde::de::Error for Error {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self::new(Kind::Other(message.to_string()))
    }

    fn invalid_type(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::new(Kind::Value { found: found.to_string(), expected: expected.to_string() })
    }

    fn invalid_value(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::invalid_type(found, expected)
    }

    fn invalid_length(length: usize, expected: &dyn Expected) -> Self {
        Self::new(Kind::Value {
            found: format!("{length} elements"),
            expected: expected.to_string(),
        })
    }

    fn unknown_variant(found: &str, known: &'static [&'static str]) -> Self {
        Self::new(Kind::UnknownVariant { found: found.to_owned(), known })
    }

    fn unknown_field(key: &str, known: &'static [&'static str]) -> Self {
        Self::new(Kind::UnknownKey { key: key.to_owned(), known })
    }

    fn missing_field(key: &'static str) -> Self {
        Self::new(Kind::MissingKey(key))
    }

    fn duplicate_field(key: &'static str) -> Self {
        Self::new(Kind::Other(format!("`{key}` stands there twice")))
    }
}
