//! Options that a driver may have to be given: `NAME=VALUE`.

use super::{AddressError, Driver};
use std::collections::BTreeMap;
use sunglint_formats::nearest_names;
use sunglint_numerics::measured::Interval;

/// Kind of values that an option takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OptionKind {
    /// A number between two ends.
    Number(f64, f64),
    /// A whole number between two ends.
    Integer(i64, i64),
    /// Yes or no.
    Flag,
    /// Two numbers, the smaller first, with a comma between.
    Pair,
    /// A time in UTC (`2026-11-24T21:00:00Z`).
    Utc,
    /// Text: the name of a file, a name out of a file.
    Text,
    /// One of these words, or one of them with a positive number behind a colon where it ends with one.
    Word(&'static [&'static str]),
}

impl OptionKind {
    pub(super) fn flag(text: &str) -> Option<bool> {
        match text {
            "yes" | "true" | "on" => Some(true),
            "no" | "false" | "off" => Some(false),
            _ => None,
        }
    }

    pub(super) fn pair(text: &str) -> Option<Interval> {
        let (least, most) = text.split_once(',')?;
        let [least, most]: [f64; 2] = [least.trim().parse().ok()?, most.trim().parse().ok()?];
        (least.is_finite() && most.is_finite() && least < most)
            .then_some(Interval::new(least, most))
    }

    /// The word, and the number behind it.
    pub(super) fn word(text: &str) -> (&str, Option<f64>) {
        match text.split_once(':') {
            Some((word, number)) => {
                (word, number.parse().ok().filter(|n: &f64| *n > 0.0 && n.is_finite()))
            }
            None => (text, None),
        }
    }

    /// Whether it is a value; if not, what it should be.
    pub(super) fn check(self, text: &str) -> Result<(), String> {
        let (good, expected) = match self {
            Self::Number(least, most) => (
                text.parse().is_ok_and(|n: f64| (least..=most).contains(&n)),
                format!("a number, {least} to {most}"),
            ),
            Self::Integer(least, most) => (
                text.parse().is_ok_and(|n: i64| (least..=most).contains(&n)),
                format!("a whole number, {least} to {most}"),
            ),
            Self::Flag => (Self::flag(text).is_some(), "yes or no".to_owned()),
            Self::Pair => {
                (Self::pair(text).is_some(), "two numbers FROM,TO, FROM the smaller".to_owned())
            }
            Self::Utc => (
                sunglint_formats::time::parse_utc(text).is_ok(),
                "a time in UTC, such as 2026-11-24T21:00:00Z".to_owned(),
            ),
            Self::Text => (!text.is_empty(), "a name".to_owned()),
            Self::Word(words) => {
                let (word, number) = Self::word(text);
                let is = |known: &&str| match known.strip_suffix(':') {
                    Some(known) => known == word && number.is_some(),
                    None => *known == text,
                };
                let forms: Vec<String> = words
                    .iter()
                    .map(|word| {
                        if word.ends_with(':') {
                            format!("{word}NUMBER")
                        } else {
                            (*word).to_owned()
                        }
                    })
                    .collect();
                (words.iter().any(is), format!("one of {}", forms.join(", ")))
            }
        };
        if good { Ok(()) } else { Err(expected) }
    }
}

/// An option of a driver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OptionSpec {
    /// Name of the option, with its unit.
    pub name: &'static str,
    /// Kind of values that the option takes.
    pub kind: OptionKind,
    /// Value of the option if it is not given; empty if it then has none.
    pub default: &'static str,
    /// Meaning of the option.
    pub about: &'static str,
}

/// The options that were given.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Options(BTreeMap<&'static str, String>);

impl Options {
    pub fn parse(driver: &Driver, given: &[String]) -> Result<Self, AddressError> {
        let mut options = Self::default();
        for text in given {
            let names = || driver.options.iter().map(|spec| spec.name);
            let Some((name, value)) = text.split_once('=') else {
                let expected = format!("NAME=VALUE, the name one of {}", list(names()));
                return Err(AddressError::new("option", text, expected));
            };
            let (name, value) = (name.trim(), value.trim());
            let Some(spec) = driver.options.iter().find(|spec| spec.name == name) else {
                let nearest = nearest_names(name, names(), 2);
                let expected = if nearest.is_empty() {
                    format!("NAME=VALUE, the name one of {}", list(names()))
                } else {
                    format!("NAME=VALUE; nearest: {}", nearest.join(", "))
                };
                return Err(AddressError::new(
                    format!("option of {}", driver.name),
                    name,
                    expected,
                ));
            };
            spec.kind
                .check(value)
                .map_err(|expected| AddressError::new(format!("option {name}"), value, expected))?;
            if options.0.insert(spec.name, value.to_owned()).is_some() {
                return Err(AddressError::new(format!("option {name}"), text, "it once"));
            }
        }
        Ok(options)
    }

    pub fn get(&self, name: &str) -> Option<&str> {
        self.0.get(name).map(String::as_str)
    }

    pub fn set(&mut self, name: &'static str, value: String) {
        self.0.insert(name, value);
    }

    pub fn given(&self) -> Vec<String> {
        self.0.iter().map(|(name, value)| format!("{name}={value}")).collect()
    }
}

fn list<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.collect();
    if names.is_empty() { "none: this driver has no options".to_owned() } else { names.join(", ") }
}
