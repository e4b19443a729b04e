//! An SMC100 or CONEX-CC controller, which drives one stage. Several SMC100 share one line, each with its address.

use super::link::Link;
use super::{COUNTS_PER_DEG, counts, degrees};
use crate::clock::Deadline;
use crate::device::{DeviceError, Identity, Origin, Setting, Side, Value};
use crate::reply::{ReplyError, number};
use crate::transport::Bytes;
use crate::turning::{Axis, AxisState, Turning, TurningSettings};
use std::time::Duration;

/// The device, in messages.
pub(crate) const DEVICE: &str = "Newport SMC100 or CONEX-CC";

/// A rotation stage on such a controller.
pub type Stage<T> = Turning<Smc100<T>>;

/// How to speak to a controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LinkSettings {
    /// Address of the controller, 1 to 31.
    pub address: u8,
    /// How long an answer may take.
    pub reply_within: Duration,
    /// Time from one line to the next: controllers that share a line lose lines that come faster (other drivers wait 60 ms).
    pub gap: Duration,
}

impl Default for LinkSettings {
    fn default() -> Self {
        let [reply_within, gap] = [500, 60].map(Duration::from_millis);
        Self { address: 1, reply_within, gap }
    }
}

/// State of a controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Doing {
    /// It has no reference since it was switched on.
    NotReferenced,
    /// The settings are being changed.
    Configuration,
    /// It searches its reference.
    Homing,
    /// It moves.
    Moving,
    /// It stands, with its motor on.
    Ready,
    /// It stands, with its motor off.
    Disabled,
}

/// An answer to `TS`: error bits, and what it does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Status {
    /// Error bits.
    pub errors: u16,
    /// State of the controller.
    pub doing: Doing,
}

/// The six digits behind `1TS`.
///
/// # Errors
/// Anything else; a state that the protocol does not have.
pub fn status(digits: &str) -> Result<Status, ReplyError> {
    let wrong = || ReplyError::new(digits, "four digits of errors and two of a state");
    let good = digits.len() == 6 && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
    let (errors, state) = Some(digits).filter(|_| good).ok_or_else(wrong)?.split_at(4);
    let errors = u16::from_str_radix(errors, 16).map_err(|_| wrong())?;
    let doing = match u8::from_str_radix(state, 16).map_err(|_| wrong())? {
        0x0a..=0x11 => Doing::NotReferenced,
        0x14 => Doing::Configuration,
        0x1e | 0x1f => Doing::Homing,
        0x28 | 0x46 | 0x47 => Doing::Moving,
        0x32..=0x35 => Doing::Ready,
        0x3c..=0x3e => Doing::Disabled,
        _ => return Err(wrong()),
    };
    Ok(Status { errors, doing })
}

const NEGATIVE_END: u16 = 1;
const POSITIVE_END: u16 = 2;

/// Errors beside the ends of the travel, in words; from memory.
const ERRORS: [(u16, &str); 8] = [
    (0x0004, "peak current limit"),
    (0x0008, "mean current limit"),
    (0x0010, "short circuit"),
    (0x0020, "following error: check for an obstacle and the load"),
    (0x0040, "the reference search took too long"),
    (0x0080, "wrong stage"),
    (0x0100, "supply voltage too low"),
    (0x0200, "too much output power"),
];

/// Why a command was not taken, by the letter of `TE`.
pub fn refusal(letter: char) -> Option<&'static str> {
    Some(match letter {
        '@' => return None,
        'A' => "it does not know the command",
        'B' => "wrong address",
        'C' => "a number is missing or out of range",
        'D' => "not allowed",
        'E' => "it searches its reference already",
        'F' => "unknown stage",
        'G' => "beyond its travel",
        'H' => "not allowed without a reference: home it first",
        'I' => "not allowed during configuration",
        'J' => "not allowed while its motor is off",
        'K' => "not allowed while it is ready",
        'L' => "not allowed while it searches its reference",
        'M' => "not allowed while it moves",
        'N' => "it stands beyond its software limits",
        'S' => "communication took too long",
        'U' => "its memory failed",
        'V' => "it failed while it carried the command out",
        'W' => "not allowed on this version",
        _ => "an error that this program does not know",
    })
}

/// A controller on a line.
#[derive(Debug)]
pub struct Smc100<T> {
    link: Link<T>,
    settings: LinkSettings,
    searched: bool,
}

/// Opens the stage: asks for the version and the state. Nothing moves.
///
/// # Errors
/// A controller that does not answer or is being configured, or see [`DeviceError`].
pub fn open<T: Bytes>(
    line: T,
    settings: LinkSettings,
    turning: TurningSettings,
    deadline: &Deadline,
) -> Result<Stage<T>, DeviceError> {
    let question = format!("{}VE", settings.address);
    // The answer repeats the question; that it is this controller's is seen from the state below.
    let is_version: fn(&str) -> bool = |line| {
        let name = line.trim_start_matches(|c: char| c.is_ascii_digit());
        name.len() > 2 && name.starts_with("VE")
    };
    let times = [settings.reply_within, settings.gap];
    let link = Link::new(line, DEVICE, "\r\n", (question, is_version), times);
    let mut axis = Smc100 { link, settings, searched: false };
    axis.link.version(deadline)?;
    axis.steady("TS", status, deadline)?;
    Turning::new(axis, turning)
}

impl<T: Bytes> Smc100<T> {
    /// The line.
    pub fn line(&self) -> &T {
        &self.link.line
    }

    /// The line; what is said on it directly, the axis does not know.
    pub fn line_mut(&mut self) -> &mut T {
        &mut self.link.line
    }

    /// The line.
    pub fn into_line(self) -> T {
        self.link.line
    }

    fn text(&self, command: &str) -> String {
        format!("{}{command}", self.settings.address)
    }

    fn ask<V>(
        &mut self,
        command: &str,
        parse: impl Fn(&str) -> Result<V, ReplyError>,
        deadline: &Deadline,
    ) -> Result<V, DeviceError> {
        let question = self.text(command);
        self.link.ask(&question, |line| behind(&question, line).and_then(&parse), deadline)
    }

    fn steady<V: PartialEq>(
        &mut self,
        command: &str,
        parse: impl Fn(&str) -> Result<V, ReplyError>,
        deadline: &Deadline,
    ) -> Result<V, DeviceError> {
        let question = self.text(command);
        self.link.steady(&question, |line| behind(&question, line).and_then(&parse), deadline)
    }

    fn refused(
        &mut self,
        deadline: &Deadline,
    ) -> Result<Option<(char, &'static str)>, DeviceError> {
        let letter = |data: &str| {
            let mut letters = data.chars();
            match (letters.next(), letters.next()) {
                (Some(letter @ '@'..='Z'), None) => Ok(letter),
                _ => Err(ReplyError::new(data, "a letter, or @ for no error")),
            }
        };
        let letter = self.ask("TE", letter, deadline)?;
        Ok(refusal(letter).map(|reason| (letter, reason)))
    }

    /// Sends a setter, and gives why it was not taken.
    fn set(
        &mut self,
        command: &str,
        deadline: &Deadline,
    ) -> Result<Option<(char, &'static str)>, DeviceError> {
        // An error of before would be taken for this one's.
        self.refused(deadline)?;
        let text = self.text(command);
        self.link.tell(&text, deadline)?;
        self.refused(deadline)
    }

    fn rejected(&self, command: &str, (letter, reason): (char, &'static str)) -> DeviceError {
        DeviceError::Refused {
            device: DEVICE,
            request: self.text(command),
            code: u32::from(letter).into(),
            reason,
        }
    }
}

/// The text behind the question that an answer repeats.
fn behind<'a>(question: &str, line: &'a str) -> Result<&'a str, ReplyError> {
    let data = line.strip_prefix(question).map(str::trim);
    data.ok_or_else(|| ReplyError::new(line, "an answer that repeats the question"))
}

impl<T: Bytes> Axis for Smc100<T> {
    const DEVICE: &'static str = DEVICE;
    const HOME_IS_ZERO: bool = false;
    const SEARCH_IS_TOLD: bool = false;

    fn counts_per_deg(&self) -> f64 {
        COUNTS_PER_DEG
    }

    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        let version = self.link.version(deadline)?;
        let model = behind(&self.link_question(), &version).unwrap_or(&version).to_owned();
        let text = |data: &str| Ok(data.to_owned());
        let stage = self.steady("ID?", text, deadline)?;
        Ok(Identity {
            vendor: "Newport".into(),
            model: format!("{model} with {stage}"),
            // The stage's stands in its name, the version in the controller's.
            serial: None,
            firmware: None,
            driver: "smc100",
        })
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let speed = self.steady("VA?", number, deadline)?;
        let address = Value::Integer(self.settings.address.into());
        Ok(vec![
            Setting { name: "address", value: address, origin: Origin::Configured },
            Setting {
                name: "speed_deg_per_s",
                value: Value::Number(speed),
                origin: Origin::ReadBack,
            },
        ])
    }

    fn state(&mut self, deadline: &Deadline) -> Result<AxisState, DeviceError> {
        let Status { errors, doing } = self.ask("TS", status, deadline)?;
        let counter = self.ask("TP", counts, deadline)?;
        let limit = match errors & (NEGATIVE_END | POSITIVE_END) {
            NEGATIVE_END => Some(Side::Left),
            POSITIVE_END => Some(Side::Right),
            _ => None,
        };
        let mut fault =
            ERRORS.iter().find(|(bit, _)| errors & bit != 0).map(|(_, words)| (*words).to_owned());
        match doing {
            Doing::Configuration => {
                fault = Some("it is being configured: end that (PW0) first".to_owned());
            }
            Doing::Disabled => {
                fault.get_or_insert_with(|| "its motor is off (MM1 switches it on)".to_owned());
            }
            _ => {}
        }
        let moving = matches!(doing, Doing::Homing | Doing::Moving);
        let referenced =
            !matches!(doing, Doing::NotReferenced | Doing::Homing | Doing::Configuration);
        let referenced = Some(referenced);
        Ok(AxisState { counter, moving, referenced, limit, fault })
    }

    fn start(&mut self, target: i32, deadline: &Deadline) -> Result<(), DeviceError> {
        let command = format!("PA{}", degrees(target));
        match self.set(&command, deadline)? {
            None => Ok(()),
            Some(refused) => Err(self.rejected(&command, refused)),
        }
    }

    fn search(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.searched = false;
        match self.set("OR", deadline)? {
            None => Ok(()),
            // It has its reference since it was switched on, and searches it once only.
            Some(('K', _)) => {
                self.searched = true;
                Ok(())
            }
            Some(refused) => Err(self.rejected("OR", refused)),
        }
    }

    fn has_searched(&mut self) -> bool {
        self.searched
    }

    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        let text = self.text("ST");
        self.link.tell(&text, deadline)
    }
}

impl<T: Bytes> Smc100<T> {
    fn link_question(&self) -> String {
        self.text("VE")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: states as open drivers have them.
    #[test]
    fn states_are_read_strictly() {
        assert_eq!(status("00000A"), Ok(Status { errors: 0, doing: Doing::NotReferenced }));
        assert_eq!(status("002033"), Ok(Status { errors: 0x20, doing: Doing::Ready }));
        assert_eq!(status("000028").map(|s| s.doing), Ok(Doing::Moving));
        for wrong in ["", "00003", "0000333", "0000ZZ", "000000", "000036", "+00033"] {
            assert!(status(wrong).is_err(), "{wrong}");
        }
        assert!(refusal('@').is_none() && refusal('H').is_some_and(|words| words.contains("home")));
        assert_eq!(behind("1TP", "1TP10.5"), Ok("10.5"));
        assert!(behind("1TP", "2TP10.5").is_err());
    }
}
