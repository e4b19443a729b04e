//! Question and answer with a device.

use super::message::{LONGEST_LINE, Line, Reply, command, fault, parse, warnings};
use super::{DEVICE, Stage};
use crate::clock::Deadline;
use crate::device::{DeviceError, Identity, Origin, Setting, Value};
use crate::reply::{ReplyError, integer};
use crate::transport::Bytes;
use crate::turning::{Axis, AxisState, Turning, TurningSettings};
use crate::twice::{Trouble, twice};
use std::time::Duration;

/// So many lines without the reply are no leftovers but another device.
const MOST_LINES: usize = 64;

/// How to speak to a device.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkSettings {
    /// Address of the device on its line, 1 to 99.
    pub device: u8,
    /// Axis, 1 to 9.
    pub axis: u8,
    /// Microsteps of a degree.
    pub counts_per_deg: f64,
    /// How long an answer may take.
    pub reply_within: Duration,
}

impl LinkSettings {
    /// The first axis of the first device; a microstep is a `counts_per_deg`th of a degree.
    pub fn new(counts_per_deg: f64) -> Self {
        Self { device: 1, axis: 1, counts_per_deg, reply_within: Duration::from_millis(500) }
    }
}

/// An axis of a device on a line.
#[derive(Debug)]
pub struct Zaber<T> {
    line: T,
    link: LinkSettings,
    number: u8,
    /// Whether a reply had a checksum: all have one then.
    checked: bool,
    searched: bool,
}

/// Opens the stage: asks the device who it is. Nothing moves.
///
/// # Errors
/// A device that does not answer, settings without sense, or see [`DeviceError`].
pub fn open<T: Bytes>(
    line: T,
    link: LinkSettings,
    settings: TurningSettings,
    deadline: &Deadline,
) -> Result<Stage<T>, DeviceError> {
    let axis = Zaber { line, link, number: 0, checked: false, searched: false };
    let mut stage = Turning::new(axis, settings)?;
    let axes = stage.axis_mut().whole(0, "get system.axiscount", deadline)?;
    if !(1..=axes).contains(&i32::from(link.axis)) {
        let (name, asked, known) = ("axis", link.axis.to_string(), format!("1 to {axes}"));
        return Err(DeviceError::Unknown { name, asked, known });
    }
    Ok(stage)
}

fn protocol(reason: String) -> DeviceError {
    DeviceError::Protocol { device: DEVICE, reason }
}

fn spoilt(text: &str, error: &ReplyError) -> DeviceError {
    protocol(format!("the answer to {text}: {error}"))
}

impl<T: Bytes> Zaber<T> {
    /// The line.
    pub fn line(&self) -> &T {
        &self.line
    }

    /// The line; what is said on it directly, the axis does not know.
    pub fn line_mut(&mut self) -> &mut T {
        &mut self.line
    }

    /// The line.
    pub fn into_line(self) -> T {
        self.line
    }

    fn once(&mut self, axis: u8, text: &str, deadline: &Deadline) -> Result<Reply, Trouble> {
        self.number = (self.number + 1) % 100;
        let step = deadline.at_most(self.link.reply_within);
        self.line.send(&command(self.link.device, axis, self.number, text), &step)?;
        let mut last = None;
        for _ in 0..MOST_LINES {
            let bytes = match self.line.receive_until(b'\n', LONGEST_LINE, &step) {
                Ok(bytes) => bytes,
                // Somebody who speaks, but not so, is not silent.
                Err(error) if error.is_timeout() => {
                    return Err(match last {
                        Some(error) => Trouble::Again(spoilt(text, &error)),
                        None => error.into(),
                    });
                }
                Err(error) => return Err(error.into()),
            };
            let (reply, checked) = match parse(&bytes) {
                Ok((Line::Reply(reply), checked)) => (reply, checked),
                Ok((Line::Unasked, _)) => continue,
                Err(error) => {
                    last = Some(error);
                    continue;
                }
            };
            let ours = (reply.device, reply.axis, reply.number)
                == (self.link.device, axis, Some(self.number));
            if !ours {
                // A late one, or another device's.
                continue;
            }
            if self.checked && !checked {
                let shown = String::from_utf8_lossy(&bytes);
                last = Some(ReplyError::new(&shown, "a reply with a checksum, as those before"));
                continue;
            }
            self.checked |= checked;
            return Ok(reply);
        }
        Err(Trouble::Again(protocol(format!(
            "{MOST_LINES} lines without the answer to {text}: is this a Zaber device?"
        ))))
    }

    /// Asks, once more where that may help, and gives the reply of a command that was taken.
    fn ask(&mut self, axis: u8, text: &str, deadline: &Deadline) -> Result<Reply, DeviceError> {
        twice(DEVICE, deadline, || {
            let reply = self.once(axis, text, deadline)?;
            match reply.taken {
                true => Ok(reply),
                // The device says so of a message whose checksum was wrong, too, where it says anything.
                false => Err(Trouble::Again(DeviceError::Rejected {
                    device: DEVICE,
                    request: text.to_owned(),
                    said: reply.data,
                })),
            }
        })
    }

    /// A whole number, twice the same where replies have no checksum.
    fn whole(&mut self, axis: u8, text: &str, deadline: &Deadline) -> Result<i32, DeviceError> {
        let mut last = None;
        for _ in 0..4 {
            let reply = self.ask(axis, text, deadline)?;
            let value = integer(&reply.data).map_err(|error| spoilt(text, &error))?;
            if self.checked || last == Some(value) {
                return Ok(value);
            }
            last = Some(value);
        }
        Err(protocol(format!("the answer to {text} reads differently each time")))
    }

    fn own(&mut self, text: &str, deadline: &Deadline) -> Result<Reply, DeviceError> {
        self.ask(self.link.axis, text, deadline)
    }
}

impl<T: Bytes> Axis for Zaber<T> {
    const DEVICE: &'static str = DEVICE;
    // A stage may have a position of its own at its reference (limit.home.preset).
    const HOME_IS_ZERO: bool = false;
    const SEARCH_IS_TOLD: bool = true;

    fn counts_per_deg(&self) -> f64 {
        self.link.counts_per_deg
    }

    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        let id = self.whole(0, "get deviceid", deadline)?;
        let serial = self.ask(0, "get system.serial", deadline)?.data;
        let firmware = self.ask(0, "get version", deadline)?.data;
        Ok(Identity {
            vendor: "Zaber".into(),
            model: format!("device {id}"),
            serial: Some(serial),
            firmware: Some(firmware),
            driver: "zaber",
        })
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let (counts, axis) = (self.link.counts_per_deg, self.link.axis);
        let speed = self.whole(axis, "get maxspeed", deadline)?;
        Ok(vec![
            Setting {
                name: "counts_per_deg",
                value: Value::Number(counts),
                origin: Origin::Configured,
            },
            Setting {
                name: "axis",
                value: Value::Integer(axis.into()),
                origin: Origin::Configured,
            },
            Setting {
                name: "max_speed_units",
                value: Value::Integer(speed.into()),
                origin: Origin::ReadBack,
            },
            Setting {
                name: "checksums",
                value: Value::Flag(self.checked),
                origin: Origin::ReadBack,
            },
        ])
    }

    fn state(&mut self, deadline: &Deadline) -> Result<AxisState, DeviceError> {
        let reply = self.own("get pos", deadline)?;
        let counter = integer(&reply.data).map_err(|error| spoilt("get pos", &error))?;
        let flags = match reply.warning.as_str() {
            "--" => Vec::new(),
            // The gravest hides the others.
            _ => {
                let all = self.own("warnings", deadline)?;
                let mut flags = warnings(&all.data).map_err(|error| spoilt("warnings", &error))?;
                flags.push(reply.warning);
                flags
            }
        };
        let referenced = !flags.iter().any(|flag| ["WR", "WH", "FH"].contains(&flag.as_str()));
        let fault = flags.iter().find_map(|flag| Some(format!("{flag}, {}", fault(flag)?)));
        Ok(AxisState {
            counter,
            moving: reply.busy,
            referenced: Some(referenced),
            limit: None,
            fault,
        })
    }

    fn start(&mut self, target: i32, deadline: &Deadline) -> Result<(), DeviceError> {
        // A fault of before would be taken for one of this move.
        self.own("warnings clear", deadline)?;
        self.own(&format!("move abs {target}"), deadline).map(|_| ())
    }

    fn search(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.searched = false;
        self.own("warnings clear", deadline)?;
        self.own("home", deadline)?;
        // It took the command, with its number and checksum.
        self.searched = true;
        Ok(())
    }

    fn has_searched(&mut self) -> bool {
        self.searched
    }

    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.own("stop", deadline).map(|_| ())
    }
}
