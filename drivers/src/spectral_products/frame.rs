//! Commands to a CM110 and its answers, as bytes.

use crate::reply::ReplyError;

/// End of an answer: the work is done.
pub const DONE: u8 = 24;
/// The echo: command and answer.
pub const ECHO: u8 = 27;

/// Unit in which wavelengths are told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// Hundredths of a micrometre.
    Micrometre,
    /// Nanometres.
    Nanometre,
    /// Tenths of a nanometre.
    Angstrom,
}

impl Unit {
    /// The unit of a number.
    pub fn of(number: u8) -> Option<Self> {
        [Self::Micrometre, Self::Nanometre, Self::Angstrom].get(usize::from(number)).copied()
    }

    /// Number of the unit.
    pub fn number(self) -> u8 {
        match self {
            Self::Micrometre => 0,
            Self::Nanometre => 1,
            Self::Angstrom => 2,
        }
    }

    /// Nanometres in one of them.
    pub fn nm(self) -> f64 {
        match self {
            Self::Micrometre => 10.0,
            Self::Nanometre => 1.0,
            Self::Angstrom => 0.1,
        }
    }
}

/// Questions that it answers with a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Query {
    /// Wavelength at which it stands, in its unit.
    Position,
    /// Grooves of the grating, 1/mm.
    Ruling,
    /// Blaze of the grating, nm.
    Blaze,
    /// Number of the grating, from 1.
    Grating,
    /// How many gratings it has.
    Gratings,
    /// The unit.
    Units,
    /// Serial number.
    Serial,
}

impl Query {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Position,
        Self::Ruling,
        Self::Blaze,
        Self::Grating,
        Self::Gratings,
        Self::Units,
        Self::Serial,
    ];

    /// Number of the question.
    pub fn number(self) -> u8 {
        match self {
            Self::Position => 0,
            Self::Ruling => 2,
            Self::Blaze => 3,
            Self::Grating => 4,
            Self::Gratings => 13,
            Self::Units => 14,
            Self::Serial => 19,
        }
    }

    /// In messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Position => "its wavelength",
            Self::Ruling => "the grooves of the grating",
            Self::Blaze => "the blaze of the grating",
            Self::Grating => "the number of the grating",
            Self::Gratings => "how many gratings it has",
            Self::Units => "its unit",
            Self::Serial => "its serial number",
        }
    }
}

/// Commands, but for the echo.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// Go to a wavelength, in the unit.
    Goto(u16),
    /// Answer a question.
    Ask(Query),
    /// Take a unit.
    Units(Unit),
    /// Turn a grating in.
    Select(u8),
}

impl Command {
    /// Bytes of the command.
    pub fn emit(self) -> Vec<u8> {
        match self {
            Self::Goto(place) => {
                let [high, low] = place.to_be_bytes();
                vec![16, high, low]
            }
            Self::Ask(query) => vec![56, query.number()],
            Self::Units(unit) => vec![50, unit.number()],
            Self::Select(grating) => vec![26, grating],
        }
    }

    /// Bytes of its answer.
    pub fn answer_bytes(self) -> usize {
        if matches!(self, Self::Ask(_)) { 4 } else { 2 }
    }
}

impl std::fmt::Display for Command {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Goto(place) => write!(f, "to go to {place}"),
            Self::Ask(query) => write!(f, "to tell {}", query.name()),
            Self::Units(unit) => write!(f, "to take the unit {unit:?}"),
            Self::Select(grating) => write!(f, "to turn in grating {grating}"),
        }
    }
}

/// The byte that says how a command went.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Status(pub u8);

impl Status {
    /// It did not take the command.
    pub const REFUSED: u8 = 0x80;
    /// There was nothing to do: it is there already.
    pub const IDLE: u8 = 0x40;
    /// The refused value is too small; too large otherwise.
    pub const SMALL: u8 = 0x20;

    /// Whether it did not take the command, and why.
    pub fn refused(self) -> Option<&'static str> {
        let reason = match self.0 & Self::SMALL {
            0 => "the value is larger than it takes",
            _ => "the value is smaller than it takes",
        };
        (self.0 & Self::REFUSED != 0).then_some(reason)
    }

    /// The unit in use.
    pub fn unit(self) -> Option<Unit> {
        Unit::of(self.0 & 7)
    }
}

/// An answer: a number, if one was asked for, and the status.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Answer {
    /// The number.
    pub value: Option<u16>,
    /// The status.
    pub status: Status,
}

impl Answer {
    /// Reads an answer.
    ///
    /// # Errors
    /// Another length, another end than 24, or a status with a unit that there is not.
    pub fn parse(bytes: &[u8]) -> Result<Self, ReplyError> {
        let (value, status) = match *bytes {
            [status, DONE] => (None, status),
            [high, low, status, DONE] => (Some(u16::from_be_bytes([high, low])), status),
            _ => {
                let found = crate::recording::hex_excerpt(bytes);
                return Err(ReplyError::new(&found, "a status and 18 (hex), behind a number"));
            }
        };
        if Status(status).unit().is_none() {
            return Err(ReplyError::new(&format!("{status:02x}"), "a status with a unit"));
        }
        Ok(Self { value, status: Status(status) })
    }
}
