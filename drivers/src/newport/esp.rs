//! An axis of an ESP301 or ESP300. Its unit must be degrees (`1SN7`); nothing else of its settings is changed, but the motor is switched on.

use super::link::Link;
use super::{COUNTS_PER_DEG, counts, degrees};
use crate::clock::Deadline;
use crate::device::{DeviceError, Identity, Origin, Setting, Side, Value};
use crate::reply::{ReplyError, integer};
use crate::transport::Bytes;
use crate::turning::{Axis, AxisState, Turning, TurningSettings};
use std::time::Duration;

/// The device, in messages.
pub(crate) const DEVICE: &str = "Newport ESP controller";
/// Number of the unit degree.
const DEGREES: i32 = 7;
/// The controller keeps so many errors.
const MOST_ERRORS: usize = 16;

/// Codes of commands that came spoilt: the line's fault, not the axis'.
const SPOILT: [i32; 6] = [6, 7, 9, 37, 38, 40];

/// A rotation stage on an ESP controller.
pub type Stage<T> = Turning<Esp<T>>;

/// How to speak to a controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LinkSettings {
    /// Axis, from 1.
    pub axis: u8,
    /// Kind of the reference search, 0 to 6 as the manual numbers them (`OR`); `None` for the one that the controller is set to.
    pub home_mode: Option<u8>,
    /// How long an answer may take.
    pub reply_within: Duration,
}

impl Default for LinkSettings {
    fn default() -> Self {
        Self { axis: 1, home_mode: None, reply_within: Duration::from_millis(500) }
    }
}

/// An error that the controller kept (`TB?`).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EspError {
    /// Code: 0 for none, less than 100 for the controller, axis × 100 + code for an axis.
    pub code: i32,
    /// Message of the controller.
    pub message: String,
}

/// An answer to `TB?` (`104, 451322, AXIS-1 POSITIVE HARDWARE LIMIT`).
///
/// # Errors
/// Anything else.
pub fn kept_error(line: &str) -> Result<EspError, ReplyError> {
    let wrong = || ReplyError::new(line, "an error: code, time, message");
    let mut parts = line.splitn(3, ',').map(str::trim);
    let mut next = || parts.next().filter(|part| !part.is_empty()).ok_or_else(wrong);
    let code = integer(next()?).ok().filter(|code| *code >= 0).ok_or_else(wrong)?;
    integer(next()?).map_err(|_| wrong())?;
    let message = next()?.to_owned();
    // Both say so, or the line is spoilt.
    match (code == 0) == message.contains("NO ERROR") {
        true => Ok(EspError { code, message }),
        false => Err(wrong()),
    }
}

/// An axis of a controller on a line.
#[derive(Debug)]
pub struct Esp<T> {
    link: Link<T>,
    settings: LinkSettings,
    fault: Option<String>,
    limit: Option<Side>,
}

/// Opens the stage: asks for the version and the unit, and switches the motor on. Nothing moves.
///
/// # Errors
/// A controller that does not answer, an axis that has another unit or no motor, or see [`DeviceError`].
pub fn open<T: Bytes>(
    line: T,
    settings: LinkSettings,
    turning: TurningSettings,
    deadline: &Deadline,
) -> Result<Stage<T>, DeviceError> {
    let is_version: fn(&str) -> bool = |line| line.contains("Version");
    let times = [settings.reply_within, Duration::ZERO];
    let link = Link::new(line, DEVICE, "\r", ("VE?".to_owned(), is_version), times);
    let mut axis = Esp { link, settings, fault: None, limit: None };
    axis.link.version(deadline)?;
    axis.clear(deadline)?;
    let unit = axis.link.steady(&axis.text("SN?"), integer, deadline)?;
    if unit != DEGREES {
        return Err(axis.link.protocol(format!(
            "axis {} has unit {unit}, expected {DEGREES} (degrees): set it with {}SN{DEGREES}, and save it with SM",
            settings.axis, settings.axis
        )));
    }
    let is_on = |axis: &mut Esp<T>| axis.link.steady(&axis.text("MO?"), flag, deadline);
    if !is_on(&mut axis)? {
        axis.set("MO", deadline)?;
        if !is_on(&mut axis)? {
            let (asked, got) = ("1".to_owned(), "0".to_owned());
            return Err(DeviceError::NotTaken { device: DEVICE, name: "motor_on", asked, got });
        }
    }
    Turning::new(axis, turning)
}

fn flag(line: &str) -> Result<bool, ReplyError> {
    match line {
        "0" => Ok(false),
        "1" => Ok(true),
        _ => Err(ReplyError::new(line, "0 or 1")),
    }
}

impl<T: Bytes> Esp<T> {
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
        format!("{}{command}", self.settings.axis)
    }

    /// The next error that the controller kept; keeping it in mind where it is one of the axis.
    fn error(&mut self, deadline: &Deadline) -> Result<Option<EspError>, DeviceError> {
        let error = self.link.ask("TB?", kept_error, deadline)?;
        if error.code == 0 {
            return Ok(None);
        }
        let own = error.code / 100 == i32::from(self.settings.axis);
        match error.code % 100 {
            4 | 6 if own => self.limit = Some(Side::Right),
            5 | 7 if own => self.limit = Some(Side::Left),
            _ if own || (error.code < 100 && !SPOILT.contains(&error.code)) => {
                self.fault = Some(format!("{} (code {})", error.message, error.code));
            }
            // Another axis'.
            _ => {}
        }
        Ok(Some(error))
    }

    /// Forgets errors of before.
    fn clear(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        for _ in 0..MOST_ERRORS {
            if self.error(deadline)?.is_none() {
                (self.fault, self.limit) = (None, None);
                return Ok(());
            }
        }
        Err(self.link.protocol(format!("{MOST_ERRORS} errors and no end of them")))
    }

    /// Sends a setter, and asks whether it was taken; once more if it came spoilt.
    fn set(&mut self, command: &str, deadline: &Deadline) -> Result<(), DeviceError> {
        let text = self.text(command);
        let mut again = true;
        loop {
            self.link.tell(&text, deadline)?;
            match self.error(deadline)? {
                None => return Ok(()),
                Some(error) if again && SPOILT.contains(&error.code) => {
                    again = false;
                    self.clear(deadline)?;
                }
                Some(error) => {
                    let said = format!("{} (code {})", error.message, error.code);
                    return Err(DeviceError::Rejected { device: DEVICE, request: text, said });
                }
            }
        }
    }
}

impl<T: Bytes> Axis for Esp<T> {
    const DEVICE: &'static str = DEVICE;
    // The controller may be set to another position at its reference (SH).
    const HOME_IS_ZERO: bool = false;
    const SEARCH_IS_TOLD: bool = false;

    fn counts_per_deg(&self) -> f64 {
        COUNTS_PER_DEG
    }

    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        let version = self.link.version(deadline)?;
        let (model, firmware) = version.split_once("Version").unwrap_or((&version, ""));
        let text = |line: &str| match line.is_empty() {
            true => Err(ReplyError::new(line, "the stage's name")),
            false => Ok(line.to_owned()),
        };
        let stage = self.link.steady(&self.text("ID?"), text, deadline)?;
        Ok(Identity {
            vendor: "Newport".into(),
            model: format!("{} with {stage}", model.trim()),
            // The stage's stands in its name.
            serial: None,
            firmware: Some(firmware.trim().to_owned()),
            driver: "esp301",
        })
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let speed = self.link.steady(&self.text("VA?"), crate::reply::number, deadline)?;
        let axis = Value::Integer(self.settings.axis.into());
        Ok(vec![
            Setting { name: "axis", value: axis, origin: Origin::Configured },
            Setting {
                name: "speed_deg_per_s",
                value: Value::Number(speed),
                origin: Origin::ReadBack,
            },
        ])
    }

    fn state(&mut self, deadline: &Deadline) -> Result<AxisState, DeviceError> {
        let moving = !self.link.ask(&self.text("MD?"), flag, deadline)?;
        let counter = self.link.ask(&self.text("TP?"), counts, deadline)?;
        if !moving {
            self.error(deadline)?;
        }
        let (limit, fault) = (self.limit, self.fault.clone());
        Ok(AxisState { counter, moving, referenced: None, limit, fault })
    }

    fn start(&mut self, target: i32, deadline: &Deadline) -> Result<(), DeviceError> {
        self.clear(deadline)?;
        self.set(&format!("PA{}", degrees(target)), deadline)
    }

    fn search(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.clear(deadline)?;
        let mode = self.settings.home_mode.map_or(String::new(), |mode| mode.to_string());
        self.set(&format!("OR{mode}"), deadline)
    }

    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.link.tell(&self.text("ST"), deadline)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the manual's form; a code and its words that contradict each other are a spoilt line.
    #[test]
    fn kept_errors_are_read_strictly() {
        let error = kept_error("0, 100, NO ERROR DETECTED").unwrap();
        assert_eq!(error.code, 0);
        let error = kept_error("104, 451322, AXIS-1 POSITIVE HARDWARE LIMIT DETECTED").unwrap();
        assert_eq!((error.code, error.message.starts_with("AXIS-1")), (104, true));
        for wrong in [
            "",
            "0",
            "0, 100",
            "4, 100, NO ERROR DETECTED",
            "0, 1, LIMIT",
            "x, 1, A",
            "-1, 1, A",
            "1, x, A",
            "1, 1, ",
        ] {
            assert!(kept_error(wrong).is_err(), "{wrong}");
        }
    }
}
