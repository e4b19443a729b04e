//! Answers of the meter, parsed strictly: what is not understood is an error that shows it, never a guess.

pub use crate::reply::ReplyError;
use crate::reply::{integer, number, power_w};
use std::fmt;

/// The longest line of a meter, bytes, its end included: the list of a head's wavelengths is the longest known.
pub const LONGEST_LINE: usize = 512;

/// A whole line of the meter.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Line {
    /// `*…`: done, with what was asked, without space around it.
    Good(String),
    /// `?…`: refused, in the meter's words.
    Refused(String),
}

impl Line {
    /// Reads a line with its end.
    ///
    /// # Errors
    /// It does not end with LF, is not printable ASCII, or begins with neither `*` nor `?`.
    pub fn parse(bytes: &[u8]) -> Result<Self, ReplyError> {
        let text = String::from_utf8_lossy(bytes);
        let error = |expected| Err(ReplyError::new(&text, expected));
        let Some(line) = bytes.strip_suffix(b"\n") else { return error("a line with its end") };
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        if line.len() >= LONGEST_LINE || !line.iter().all(|byte| (b' '..=b'~').contains(byte)) {
            return error("a line of printable ASCII");
        }
        let body = || String::from_utf8_lossy(&line[1..]).trim().to_owned();
        match line.first() {
            Some(b'*') => Ok(Self::Good(body())),
            Some(b'?') => Ok(Self::Refused(body())),
            _ => error("an answer that begins with `*` or `?`"),
        }
    }
}

/// A reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reading {
    /// In the unit that `$SI` says.
    Value(f64),
    /// More than the range holds.
    Over,
}

impl Reading {
    /// The answer to `$SP`.
    ///
    /// # Errors
    /// Neither a number nor `OVER`.
    pub fn parse(text: &str) -> Result<Self, ReplyError> {
        match text {
            "OVER" => Ok(Self::Over),
            _ => number(text)
                .map(Self::Value)
                .map_err(|_| ReplyError::new(text, "a reading such as `1.300E-5`, or `OVER`")),
        }
    }
}

/// The answer to `$II`: the instrument.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Instrument {
    /// Kind of the instrument (`VEGA`, `NOVAII`).
    pub id: String,
    /// Serial number.
    pub serial: String,
    /// Name of the instrument; several words in some.
    pub name: String,
}

impl Instrument {
    /// Reads `VEGA 222222 VEGA`.
    ///
    /// # Errors
    /// Fewer than three words, or a serial number that is none.
    pub fn parse(text: &str) -> Result<Self, ReplyError> {
        let error = || ReplyError::new(text, "an instrument such as `VEGA 222222 VEGA`");
        let mut words = text.split_ascii_whitespace();
        let id = words.next().ok_or_else(error)?;
        let serial = words.next().ok_or_else(error)?;
        let name = words.collect::<Vec<_>>().join(" ");
        let known = id.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-+_".contains(&byte));
        let letter = id.bytes().next().is_some_and(|byte| byte.is_ascii_alphabetic());
        let numbered = serial.bytes().all(|byte| byte.is_ascii_digit());
        // Two letters begin the answer about a head.
        if !known || !letter || !numbered || name.is_empty() || id.len() <= 2 {
            return Err(error());
        }
        Ok(Self { id: id.to_owned(), serial: serial.to_owned(), name })
    }
}

/// The answer to `$HI`: the head.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Head {
    /// Kind of the head, two letters: `SI` photodiode, `TH` thermopile, `PY` pyroelectric, `XX` none …
    pub kind: String,
    /// Serial number.
    pub serial: String,
    /// Name of the head (`PD300`).
    pub name: String,
    /// Capabilities of the head, bit by bit: 0 power, 1 energy, 18 temperature, 31 frequency; others are reserved.
    pub capabilities: u32,
}

impl Head {
    /// Reads `SI 123456 PD300 80000001`; without a head, `XX` and whatever follows it.
    ///
    /// # Errors
    /// Anything else.
    pub fn parse(text: &str) -> Result<Self, ReplyError> {
        let error = || ReplyError::new(text, "a head such as `SI 123456 PD300 80000001`");
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        let kind = words.first().copied().unwrap_or_default();
        if kind.len() != 2 || !kind.bytes().all(|byte| byte.is_ascii_uppercase()) {
            return Err(error());
        }
        if kind == "XX" {
            let none = || String::new();
            return Ok(Self { kind: kind.into(), serial: none(), name: none(), capabilities: 0 });
        }
        let [_, serial, name @ .., capabilities] = words.as_slice() else { return Err(error()) };
        let hexadecimal = capabilities.bytes().all(|byte| byte.is_ascii_hexdigit());
        let numbered = serial.bytes().all(|byte| byte.is_ascii_digit());
        if capabilities.len() != 8 || !hexadecimal || !numbered || name.is_empty() {
            return Err(error());
        }
        let capabilities = u32::from_str_radix(capabilities, 16).map_err(|_| error())?;
        let name = name.join(" ");
        Ok(Self { kind: kind.into(), serial: (*serial).to_owned(), name, capabilities })
    }

    /// Whether there is one.
    pub fn is_there(&self) -> bool {
        self.kind != "XX"
    }

    /// Whether it measures power.
    pub fn measures_power(&self) -> bool {
        self.capabilities & 1 == 1
    }
}

/// A choice out of the meter's list, as `$FQ`, `$MA` and `$AQ` answer: `1 OUT IN` is the first of two.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Choice {
    /// The one that is set, from 0.
    pub index: usize,
    /// All that there are.
    pub names: Vec<String>,
}

impl Choice {
    /// Reads `1 OUT IN`.
    ///
    /// # Errors
    /// No number in front, or one that is not in the list.
    pub fn parse(text: &str) -> Result<Self, ReplyError> {
        let error = || ReplyError::new(text, "a number and names, such as `1 OUT IN`");
        let (number, names) = text.split_once(' ').ok_or_else(error)?;
        let number = integer(number).map_err(|_| error())?;
        let names: Vec<String> = names.split_ascii_whitespace().map(str::to_owned).collect();
        let index = usize::try_from(number).ok().and_then(|number| number.checked_sub(1));
        let index = index.filter(|index| *index < names.len()).ok_or_else(error)?;
        Ok(Self { index, names })
    }

    /// The name that is set.
    pub fn name(&self) -> &str {
        self.names.get(self.index).map_or("", String::as_str)
    }
}

/// The answer to `$AR`: the ranges by name, and which is set.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ranges {
    /// The names as the meter lists them: `dBm` and `AUTO` first where it has them, then from the largest to the smallest.
    pub names: Vec<String>,
    /// How many names stand before the largest range, whose number is 0: `AUTO` is −1, `dBm` −2.
    before: usize,
    /// The number that is set.
    number: i32,
}

impl Ranges {
    /// Reads `3 AUTO 30.0mW 3.00mW 300uW 30.0uW`.
    ///
    /// # Errors
    /// No number in front, a number that is not in the list, or a range that is no power.
    pub fn parse(text: &str) -> Result<Self, ReplyError> {
        let error = || ReplyError::new(text, "a number and ranges, such as `0 AUTO 30.0mW 3.00mW`");
        let (number, names) = text.split_once(' ').ok_or_else(error)?;
        let number = integer(number).map_err(|_| error())?;
        let names: Vec<String> = names.split_ascii_whitespace().map(str::to_owned).collect();
        // Counted from the word, wherever it stands: meters that know dBm list it before.
        let before = names.iter().position(|name| name == "AUTO").map_or(0, |place| place + 1);
        let powers = names.get(before..).unwrap_or_default();
        if powers.is_empty() || powers.iter().any(|name| power_w(name).is_err()) {
            return Err(error());
        }
        let ranges = Self { names, before, number };
        if ranges.place(number).is_none() {
            return Err(error());
        }
        Ok(ranges)
    }

    fn place(&self, number: i32) -> Option<usize> {
        let place = i64::try_from(self.before).ok()? + i64::from(number);
        usize::try_from(place).ok().filter(|place| *place < self.names.len())
    }

    /// The name that is set.
    pub fn name(&self) -> &str {
        self.place(self.number).map_or("", |place| &self.names[place])
    }

    /// The number that `$WN` takes for a name.
    pub fn number_of(&self, name: &str) -> Option<i32> {
        let place = self.names.iter().position(|known| known == name)?;
        Some(i32::try_from(place).ok()? - i32::try_from(self.before).ok()?)
    }

    /// The number that is set.
    pub fn number(&self) -> i32 {
        self.number
    }

    /// Whether readings are in dBm now.
    pub fn is_dbm(&self) -> bool {
        self.number < -1
    }

    /// The end of the range that is set, W; of the largest, if the meter chooses.
    pub fn end_w(&self) -> Option<f64> {
        let place = if self.number < 0 { self.before } else { self.place(self.number)? };
        power_w(self.names.get(place)?).ok()
    }

    /// The end of the largest range, W.
    pub fn largest_w(&self) -> Option<f64> {
        let powers = self.names.get(self.before..)?.iter().filter_map(|name| power_w(name).ok());
        powers.reduce(f64::max)
    }
}

/// The answer to `$AW`: the wavelengths that the head knows.
#[derive(Debug, Clone, PartialEq)]
pub enum Wavelengths {
    /// Any between two ends; the meter keeps a few.
    Continuous {
        /// The ends, nm.
        range_nm: [f64; 2],
        /// The slot in use, from 0.
        index: usize,
        /// The slots, nm; `None` for an empty one.
        slots: Vec<Option<f64>>,
    },
    /// One of a list of names (`633`, `10.6u`, `<800`).
    Discrete(Choice),
}

impl Wavelengths {
    /// Reads `CONTINUOUS 350 1100 2 633 532 NONE` or `DISCRETE 1 633 1064`.
    ///
    /// # Errors
    /// Anything else; ends in the wrong order; a slot in use that is empty or beyond the ends.
    pub fn parse(text: &str) -> Result<Self, ReplyError> {
        let expected = "wavelengths such as `CONTINUOUS 350 1100 2 633 532 NONE`";
        let error = || ReplyError::new(text, expected);
        let (kind, rest) = text.split_once(' ').ok_or_else(error)?;
        match kind {
            "DISCRETE" => Choice::parse(rest.trim()).map(Self::Discrete).map_err(|_| error()),
            "CONTINUOUS" => {
                let words: Vec<&str> = rest.split_ascii_whitespace().collect();
                let [least, most, index, slots @ ..] = words.as_slice() else {
                    return Err(error());
                };
                let nm = |word: &str| number(word).ok().filter(|nm| *nm > 0.0).ok_or_else(error);
                let range_nm = [nm(least)?, nm(most)?];
                let index = integer(index).ok().and_then(|number| usize::try_from(number).ok());
                let index = index.and_then(|number| number.checked_sub(1)).ok_or_else(error)?;
                let slots: Vec<Option<f64>> = slots
                    .iter()
                    .map(|word| if *word == "NONE" { Ok(None) } else { nm(word).map(Some) })
                    .collect::<Result<_, _>>()?;
                let in_use = slots.get(index).copied().flatten().ok_or_else(error)?;
                if !(range_nm[0]..=range_nm[1]).contains(&in_use) {
                    return Err(error());
                }
                Ok(Self::Continuous { range_nm, index, slots })
            }
            _ => Err(error()),
        }
    }

    /// The wavelength in use, nm; `None` if it is a name that is no number.
    pub fn in_use_nm(&self) -> Option<f64> {
        match self {
            Self::Continuous { index, slots, .. } => slots.get(*index).copied().flatten(),
            Self::Discrete(choice) => name_nm(choice.name()),
        }
    }
}

/// The wavelength of a name that is a number of nanometres.
pub(crate) fn name_nm(name: &str) -> Option<f64> {
    number(name.strip_suffix("nm").or(name.strip_suffix("NM")).unwrap_or(name)).ok()
}

/// How zeroing stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Zeroing {
    /// None was asked for.
    NotStarted,
    /// Under way.
    Running,
    /// Done.
    Done,
    /// Failed, or was stopped.
    Failed,
}

impl Zeroing {
    /// The answer to `$ZQ`, by its key word.
    ///
    /// # Errors
    /// None of the words.
    pub fn parse(text: &str) -> Result<Self, ReplyError> {
        let upper = text.to_ascii_uppercase();
        let words = [
            ("NOT STARTED", Self::NotStarted),
            ("IN PROGRESS", Self::Running),
            ("COMPLETED", Self::Done),
            ("FAILED", Self::Failed),
            ("ABORTED", Self::Failed),
        ];
        let mut found = words.iter().filter(|(word, _)| upper.contains(word));
        match (found.next(), found.next()) {
            (Some((_, state)), None) => Ok(*state),
            _ => Err(ReplyError::new(text, "NOT STARTED, IN PROGRESS, COMPLETED or FAILED")),
        }
    }
}

impl fmt::Display for Zeroing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotStarted => "not started",
            Self::Running => "in progress",
            Self::Done => "completed",
            Self::Failed => "failed",
        })
    }
}
