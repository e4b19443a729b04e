//! Question and answer with a controller.

use super::message::{
    ALARM, Engine, HOME, HOMED, LEFT, NAMED, Name, RIGHT, SLIPPED, STATUS, Status, checked,
    message, shown, target, text,
};
use super::{DEVICE, Stage};
use crate::clock::Deadline;
use crate::device::{DeviceError, Identity, Origin, Setting, Side, Value};
use crate::reply::ReplyError;
use crate::transport::{Bytes, TransportError};
use crate::turning::{Axis, AxisState, Turning, TurningSettings};
use crate::twice::{Trouble, twice};
use std::time::Duration;

/// Silence after which a line is taken to be empty.
const QUIET: Duration = Duration::from_millis(50);
/// More zeros than the longest command has bytes, in pieces.
const ROUNDS: usize = 40;
/// More zeros than any line holds between two replies.
const MOST_ZEROS: usize = 512;

/// Settings of the line to a controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkSettings {
    /// Counts of a degree: microsteps of a stepper, encoder counts of a DC motor.
    pub counts_per_deg: f64,
    /// Microsteps of a full step for which that holds. A stepper with another division is refused.
    pub microsteps: i32,
    /// Longest time for an answer.
    pub reply_within: Duration,
}

impl LinkSettings {
    /// A count is a `counts_per_deg`th of a degree; steps are divided by 256.
    pub fn new(counts_per_deg: f64) -> Self {
        Self { counts_per_deg, microsteps: 256, reply_within: Duration::from_millis(500) }
    }
}

/// Stage of the search of the reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Search {
    /// Not asked for.
    None,
    /// Asked for.
    Asked,
    /// Seen to run.
    Runs,
    /// Ended, and the counter set to zero there.
    Ended,
    /// Broken off: the counter may not have been set to zero, though the controller says that it was homed.
    Broken,
}

/// A motor on a controller.
#[derive(Debug)]
pub struct Standa<T> {
    line: T,
    link: LinkSettings,
    engine: Engine,
    /// Whether something may be left on the line.
    unsure: bool,
    search: Search,
    /// Whether this controller says if its position is tied to its reference.
    tells: bool,
}

/// Opens the stage: empties the line, and asks for the kind of motor and the division of its steps. Nothing moves.
///
/// # Errors
/// A controller that does not answer, or divides steps otherwise than `link` says ([`DeviceError::Unknown`]); settings without sense, or see
/// [`DeviceError`].
pub fn open<T: Bytes>(
    line: T,
    link: LinkSettings,
    settings: TurningSettings,
    deadline: &Deadline,
) -> Result<Stage<T>, DeviceError> {
    let engine = Engine { stepper: false, microsteps: 1, steps: 0 };
    let mut axis = Standa { line, link, engine, unsure: true, search: Search::None, tells: false };
    let [kind, settings_of] = Engine::DATA;
    let kind = axis.ask(*b"gent", &[], kind, deadline)?;
    let settings_of = axis.ask(*b"geng", &[], settings_of, deadline)?;
    axis.engine = Engine::parse(&kind, &settings_of).map_err(|error| spoilt(*b"geng", &error))?;
    if axis.engine.stepper && axis.engine.microsteps != link.microsteps {
        return Err(DeviceError::Unknown {
            name: "microsteps",
            asked: link.microsteps.to_string(),
            known: format!(
                "{}, by which the controller divides a step: counts_per_deg has to be for these",
                axis.engine.microsteps
            ),
        });
    }
    Turning::new(axis, settings)
}

fn protocol(reason: String) -> DeviceError {
    DeviceError::Protocol { device: DEVICE, reason }
}

fn letters(name: Name) -> String {
    name.escape_ascii().to_string()
}

fn spoilt(name: Name, error: &ReplyError) -> DeviceError {
    protocol(format!("the answer to {}: {error}", letters(name)))
}

impl<T: Bytes> Standa<T> {
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

    /// Listens until it is quiet.
    fn heard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        let mut heard = Vec::new();
        let mut buffer = [0; 256];
        while heard.len() < MOST_ZEROS {
            match self.line.receive(&mut buffer, &deadline.at_most(QUIET)) {
                Ok(count) => heard.extend(buffer.iter().take(count)),
                Err(error) if error.is_timeout() && deadline.remaining().is_ok() => break,
                Err(error) => return Err(error.with_got_so_far(&heard)),
            }
        }
        Ok(heard)
    }

    /// Empties the line: a controller in the middle of a command takes zeros for the rest of it; one that waits for a command gives them back.
    /// Late bytes come before them.
    fn synchronise(&mut self, deadline: &Deadline) -> Result<(), Trouble> {
        let (mut clean, mut silent, mut last) = (0, Duration::ZERO, Vec::new());
        for _ in 0..ROUNDS {
            let zeros: &[u8] = if silent.is_zero() { &[0] } else { &[0; 32] };
            self.line.send(zeros, deadline)?;
            let heard = self.heard(deadline)?;
            if heard.is_empty() {
                (clean, silent) = (0, silent + QUIET);
                if silent >= self.link.reply_within {
                    let got_so_far = Vec::new();
                    return Err(TransportError::Timeout { after: silent, got_so_far }.into());
                }
                continue;
            }
            silent = Duration::ZERO;
            clean = if heard.iter().all(|byte| *byte == 0) { clean + 1 } else { 0 };
            if clean == 2 {
                self.unsure = false;
                return Ok(());
            }
            last = heard;
        }
        let error = shown(&last, "zeros, as they were sent");
        Err(Trouble::Again(protocol(format!("{error}: is this an 8SMC4 or 8SMC5?"))))
    }

    fn once(
        &mut self,
        name: Name,
        data: &[u8],
        count: usize,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, Trouble> {
        if self.unsure {
            self.synchronise(deadline)?;
        }
        // Until its answer is whole.
        self.unsure = true;
        let step = deadline.at_most(self.link.reply_within);
        self.line.send(&message(name, data), &step)?;
        let mut said = Name::default();
        // Zeros from before are none of it.
        for _ in 0..MOST_ZEROS {
            self.line.receive_exact(&mut said[..1], &step)?;
            if said[0] != 0 {
                break;
            }
        }
        self.line.receive_exact(&mut said[1..], &step)?;
        let refused = |said: &str| DeviceError::Rejected {
            device: DEVICE,
            request: letters(name),
            said: said.to_owned(),
        };
        match &said {
            b"errv" => {
                self.unsure = false;
                return Err(Trouble::Final(refused("errv, a value out of range")));
            }
            // A spoilt line, too, makes these.
            b"errc" => return Err(Trouble::Again(refused("errc, a command it does not know"))),
            b"errd" => return Err(Trouble::Again(refused("errd, data that came spoilt"))),
            _ if said != name => {
                let error = shown(&said, "the command's letters");
                return Err(Trouble::Again(spoilt(name, &error)));
            }
            _ => {}
        }
        let mut reply = vec![0; if count == 0 { 0 } else { count + 2 }];
        self.line.receive_exact(&mut reply, &step)?;
        if count > 0 {
            let data = checked(&reply).map_err(|error| Trouble::Again(spoilt(name, &error)))?;
            reply = data.to_vec();
        }
        self.unsure = false;
        Ok(reply)
    }

    /// Asks, once more where that may help, and gives `count` bytes of data. All that is asked may be asked twice.
    fn ask(
        &mut self,
        name: Name,
        data: &[u8],
        count: usize,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, DeviceError> {
        twice(DEVICE, deadline, || self.once(name, data, count, deadline))
    }

    fn order(&mut self, name: Name, deadline: &Deadline) -> Result<(), DeviceError> {
        self.ask(name, &[], 0, deadline).map(|_| ())
    }

    fn status(&mut self, deadline: &Deadline) -> Result<Status, DeviceError> {
        let data = self.ask(*b"gets", &[], STATUS, deadline)?;
        Status::parse(&data).map_err(|error| spoilt(*b"gets", &error))
    }
}

impl<T: Bytes> Axis for Standa<T> {
    const DEVICE: &'static str = DEVICE;
    const HOME_IS_ZERO: bool = true;
    const SEARCH_IS_TOLD: bool = true;

    fn counts_per_deg(&self) -> f64 {
        self.link.counts_per_deg
    }

    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        // Maker, its sign, model, and the version of the hardware.
        let about = self.ask(*b"geti", &[], 30, deadline)?;
        let serial = self.ask(*b"gser", &[], 4, deadline)?;
        let firmware = self.ask(*b"gfwv", &[], 4, deadline)?;
        let serial = serial.first_chunk().map(|bytes| u32::from_le_bytes(*bytes).to_string());
        let firmware = match firmware.as_slice() {
            [major, minor, low, high] => {
                Some(format!("{major}.{minor}.{}", u16::from_le_bytes([*low, *high])))
            }
            _ => None,
        };
        let model = text(about.get(6..14).unwrap_or_default());
        Ok(Identity { vendor: "Standa".into(), model, serial, firmware, driver: "standa" })
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let status = self.status(deadline)?;
        let speed = self.ask(*b"gmov", &[], 24, deadline)?;
        let speed = match speed.as_slice() {
            [a, b, c, d, part, ..] => {
                let steps = f64::from(u32::from_le_bytes([*a, *b, *c, *d]));
                steps + f64::from(*part) / f64::from(self.engine.microsteps)
            }
            _ => return Err(protocol("the answer to gmov has no speed".into())),
        };
        let read = |name, value| Setting { name, value, origin: Origin::ReadBack };
        let counts = Value::Number(self.link.counts_per_deg);
        let mut all = vec![
            Setting { name: "counts_per_deg", value: counts, origin: Origin::Configured },
            read("microsteps", Value::Integer(self.engine.microsteps.into())),
            read("steps_per_turn", Value::Integer(self.engine.steps.into())),
            read("speed_steps_s", Value::Number(speed)),
            read("supply_v", Value::Number(status.supply_v)),
            read("temperature_c", Value::Number(status.temperature_c)),
        ];
        if status.flags & NAMED != 0 {
            let about = self.ask(*b"gsti", &[], 64, deadline)?;
            all.push(read("stage", Value::Text(text(about.get(16..40).unwrap_or_default()))));
        }
        Ok(all)
    }

    fn state(&mut self, deadline: &Deadline) -> Result<AxisState, DeviceError> {
        let mut status = self.status(deadline)?;
        if matches!(self.search, Search::Asked | Search::Runs) && status.command == HOME {
            self.search = Search::Runs;
            if !status.is_busy() && status.fault().is_none() {
                self.order(*b"zero", deadline)?;
                self.search = Search::Ended;
                status = self.status(deadline)?;
                self.tells = false;
            }
        }
        let homed = status.flags & HOMED != 0;
        self.tells |= homed;
        let unset = matches!(self.search, Search::Asked | Search::Runs | Search::Broken);
        let referenced = match (unset, self.tells) {
            (true, _) => Some(false),
            (false, true) => Some(homed),
            (false, false) => None,
        };
        let counter = self.engine.counter(status.steps, status.microsteps);
        Ok(AxisState {
            counter: counter.map_err(|error| spoilt(*b"gets", &error))?,
            moving: status.is_busy(),
            referenced,
            limit: match (status.inputs & LEFT != 0, status.inputs & RIGHT != 0) {
                (true, false) => Some(Side::Left),
                (false, true) => Some(Side::Right),
                _ => None,
            },
            fault: status.fault(),
        })
    }

    fn start(&mut self, counter: i32, deadline: &Deadline) -> Result<(), DeviceError> {
        // An alarm of before keeps it from moving.
        if self.status(deadline)?.flags & (ALARM | SLIPPED) != 0 {
            self.order(*b"stop", deadline)?;
        }
        let (steps, microsteps) = self.engine.split(counter);
        self.ask(*b"move", &target(steps, microsteps), 0, deadline).map(|_| ())
    }

    fn search(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.search = Search::Broken;
        // Ends an alarm; and a status that still tells the command before this one is not taken for the end of this search.
        self.order(*b"stop", deadline)?;
        self.order(*b"home", deadline)?;
        self.search = Search::Asked;
        Ok(())
    }

    fn has_searched(&mut self) -> bool {
        matches!(self.search, Search::Runs | Search::Ended)
    }

    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        if matches!(self.search, Search::Asked | Search::Runs) {
            self.search = Search::Broken;
        }
        // With its ramp: a hard stop may lose steps.
        self.order(*b"sstp", deadline)
    }
}
