//! Question and answer with a module, among what it says unasked.

use super::reply::{BUSY, Info, LONGEST_LINE, Reply, parse, status};
use super::{DEVICE, Stage};
use crate::clock::Deadline;
use crate::device::{DeviceError, Identity, Origin, Setting, Value};
use crate::transport::Bytes;
use crate::turning::{Axis, AxisState, Turning, TurningSettings};
use crate::twice::{Trouble, twice};
use std::time::Duration;

/// A module that got half a command forgets it after this time.
const FORGETS: Duration = Duration::from_secs(2);
/// So many lines are no leftovers but another device.
const MOST_LINES: usize = 64;

/// How to speak to a module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LinkSettings {
    /// Address of the module, 0 to 15.
    pub address: u8,
    /// How long an answer may take; the longest takes 40 ms at 9600 baud.
    pub reply_within: Duration,
    /// How long a module may be silent during a move. A turn takes 1 s at full speed.
    pub silent_for: Duration,
    /// Whether the reference is searched anticlockwise.
    pub anticlockwise: bool,
}

impl Default for LinkSettings {
    fn default() -> Self {
        Self {
            address: 0,
            reply_within: Duration::from_millis(500),
            silent_for: Duration::from_secs(15),
            anticlockwise: false,
        }
    }
}

/// A move or search whose end was not told yet.
#[derive(Debug, Clone, Copy)]
struct Pending {
    search: bool,
    /// When something was heard last, or it began.
    heard: Duration,
}

/// A module on a line.
#[derive(Debug)]
pub struct Elliptec<T> {
    line: T,
    link: LinkSettings,
    info: Option<Info>,
    counts_per_deg: f64,
    in_step: bool,
    /// Whether the last question got no answer: the module may wait for the rest of a command.
    torn: bool,
    pending: Option<Pending>,
    fault: Option<String>,
    searched: bool,
    counter: i32,
}

/// Opens the stage: asks the module who it is and for the pulses of its turn, twice. Nothing moves.
///
/// # Errors
/// A module that does not answer or is no rotation mount, settings without sense, or see [`DeviceError`].
pub fn open<T: Bytes>(
    line: T,
    link: LinkSettings,
    settings: TurningSettings,
    deadline: &Deadline,
) -> Result<Stage<T>, DeviceError> {
    let mut module = Elliptec {
        line,
        link,
        info: None,
        counts_per_deg: 1.0,
        in_step: false,
        torn: false,
        pending: None,
        fault: None,
        searched: false,
        counter: 0,
    };
    let info = module.steady_info(deadline)?;
    let refused = |reason: String| Err(DeviceError::Protocol { device: DEVICE, reason });
    if let Some(kind) = info.other_kind() {
        return refused(format!(
            "the module at address {:X} is an ELL{}, {kind}, no rotation mount",
            link.address, info.model
        ));
    }
    if info.travel != 360 || info.pulses == 0 {
        return refused(format!(
            "an ELL{} says {} pulses and a travel of {}, expected the pulses of a turn and 360 degrees",
            info.model, info.pulses, info.travel
        ));
    }
    module.counts_per_deg = f64::from(info.pulses) / 360.0;
    module.info = Some(info);
    Turning::new(module, settings)
}

fn protocol(reason: String) -> DeviceError {
    DeviceError::Protocol { device: DEVICE, reason }
}

impl<T: Bytes> Elliptec<T> {
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

    fn send(&mut self, command: &str, step: &Deadline) -> Result<(), Trouble> {
        let text = format!("{:X}{command}", self.link.address);
        Ok(self.line.send(text.as_bytes(), step)?)
    }

    /// The module's next line; those of other modules are passed over.
    fn next(&mut self, step: &Deadline) -> Result<Reply, Trouble> {
        for _ in 0..MOST_LINES {
            let line = self.line.receive_until(b'\n', LONGEST_LINE, step)?;
            let (address, reply) = parse(&line).map_err(|error| {
                self.in_step = false;
                Trouble::Again(protocol(error.to_string()))
            })?;
            if address == self.link.address {
                self.torn = false;
                if let Some(pending) = &mut self.pending {
                    pending.heard = step.now();
                }
                return Ok(reply);
            }
        }
        Err(Trouble::Final(protocol(format!(
            "{MOST_LINES} lines of other modules: is address {:X} right?",
            self.link.address
        ))))
    }

    /// Replies that came unasked.
    fn note(&mut self, reply: &Reply) {
        match reply {
            // The end of a search is told by a position, and only so: silence may be a command that was lost.
            Reply::Position(_) => {
                self.searched |= self.pending.is_some_and(|pending| pending.search);
                self.pending = None;
            }
            Reply::Status(0) => self.pending = None,
            Reply::Status(BUSY | 1 | 3) | Reply::Info(_) | Reply::Speed(_) | Reply::Other => {}
            Reply::Status(code) => {
                self.fault = Some(status(*code).to_owned());
                self.pending = None;
            }
        }
    }

    /// Brings the line into step: what is older than the answer is passed over. `None`: it is busy.
    fn synchronise(&mut self, deadline: &Deadline) -> Result<Option<Info>, Trouble> {
        self.in_step = false;
        if std::mem::take(&mut self.torn) && self.pending.is_none() {
            deadline.sleep(FORGETS).map_err(|expired| Trouble::Transport(expired.into()))?;
        }
        let step = deadline.at_most(self.link.reply_within);
        self.send("in", &step)?;
        let (mut last, mut heard) = (None, false);
        for _ in 0..MOST_LINES {
            match self.next(&step) {
                Ok(Reply::Info(info)) => {
                    if self.info.as_ref().is_some_and(|known| *known != info) {
                        return Err(Trouble::Again(protocol(format!(
                            "the module at address {:X} says it is ELL{} {}, another one than before",
                            self.link.address, info.model, info.serial
                        ))));
                    }
                    self.in_step = true;
                    return Ok(Some(info));
                }
                Ok(Reply::Status(BUSY)) => return Ok(None),
                Ok(reply) => {
                    heard = true;
                    self.note(&reply);
                }
                Err(Trouble::Again(error)) => last = Some(error),
                // Somebody who speaks, but not so, is not silent.
                Err(Trouble::Transport(error)) if error.is_timeout() => {
                    self.torn = !heard;
                    return Err(match last {
                        Some(error) => Trouble::Again(error),
                        None => Trouble::Transport(error),
                    });
                }
                Err(error) => return Err(error),
            }
        }
        Err(Trouble::Final(protocol(format!(
            "{MOST_LINES} lines without an answer: is this an Elliptec module?"
        ))))
    }

    /// Asks, on a line that is in step, and gives the answer that `take` takes; others came unasked.
    fn ask<V>(
        &mut self,
        command: &str,
        take: impl Fn(&Reply) -> Option<V>,
        deadline: &Deadline,
    ) -> Result<V, Trouble> {
        // Until the answer is here, whatever interrupts this leaves the line in doubt.
        self.in_step = false;
        let mut clean = true;
        let step = deadline.at_most(self.link.reply_within);
        self.send(command, &step)?;
        for _ in 0..MOST_LINES {
            let reply = match self.next(&step) {
                Err(Trouble::Transport(error)) if error.is_timeout() => {
                    self.torn = true;
                    return Err(Trouble::Transport(error));
                }
                reply => reply?,
            };
            if let Some(value) = take(&reply) {
                // The answer may be an older one where something came unasked.
                self.in_step = clean;
                return Ok(value);
            }
            self.note(&reply);
            clean = false;
        }
        Err(Trouble::Again(protocol(format!("{MOST_LINES} lines without the answer to {command}"))))
    }

    /// Who it is, twice the same: the pulses of a turn rest on it.
    fn steady_info(&mut self, deadline: &Deadline) -> Result<Info, DeviceError> {
        let mut last = None;
        for _ in 0..4 {
            let found = twice(DEVICE, deadline, || self.synchronise(deadline))?;
            let Some(info) = found else {
                let reason = "it is busy: wait until it stands, then open it again";
                return Err(DeviceError::NotReady { device: DEVICE, reason });
            };
            if last.as_ref() == Some(&info) {
                return Ok(info);
            }
            last = Some(info);
        }
        Err(protocol("it says each time that it is another module".into()))
    }

    fn moving(&self) -> AxisState {
        let counter = self.counter;
        AxisState { counter, moving: true, referenced: None, limit: None, fault: None }
    }

    /// The state, if it is silent or busy in a move; otherwise the trouble.
    fn busy(&self, trouble: Trouble, now: Duration) -> Result<AxisState, Trouble> {
        let silent = matches!(&trouble, Trouble::Transport(error) if error.is_timeout());
        match self.pending {
            Some(pending) if silent && now.saturating_sub(pending.heard) < self.link.silent_for => {
                Ok(self.moving())
            }
            _ => Err(trouble),
        }
    }

    fn look(&mut self, deadline: &Deadline) -> Result<AxisState, Trouble> {
        if !self.in_step {
            match self.synchronise(deadline) {
                Ok(Some(_)) => {}
                Ok(None) => return Ok(self.moving()),
                Err(trouble) => {
                    // A deadline that is over is no silence.
                    deadline.remaining().map_err(|expired| Trouble::Transport(expired.into()))?;
                    return self.busy(trouble, deadline.now());
                }
            }
        }
        let code = self.ask(
            "gs",
            |reply| match reply {
                Reply::Status(code) => Some(*code),
                _ => None,
            },
            deadline,
        )?;
        let mut fault = None;
        match code {
            BUSY => return Ok(self.moving()),
            0 => self.pending = None,
            1 | 3 => return Err(Trouble::Again(protocol(status(code).to_owned()))),
            7 | 10 => {
                let (request, message) = ("its position".to_owned(), status(code).to_owned());
                return Err(Trouble::Final(DeviceError::Declined {
                    device: DEVICE,
                    request,
                    message,
                }));
            }
            code => {
                self.pending = None;
                fault = Some(status(code).to_owned());
            }
        }
        let counter = self.ask(
            "gp",
            |reply| match reply {
                Reply::Position(counter) => Some(*counter),
                _ => None,
            },
            deadline,
        )?;
        if !self.in_step {
            return Err(Trouble::Again(protocol("it says what it was not asked for".into())));
        }
        self.counter = counter;
        let fault = fault.or(self.fault.take());
        Ok(AxisState { counter, moving: false, referenced: None, limit: None, fault })
    }

    fn begin(
        &mut self,
        command: &str,
        search: bool,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        (self.fault, self.searched, self.in_step) = (None, false, false);
        let step = deadline.at_most(self.link.reply_within);
        self.pending = Some(Pending { search, heard: deadline.now() });
        self.send(command, &step).map_err(failed)
    }
}

fn failed(trouble: Trouble) -> DeviceError {
    match trouble {
        Trouble::Transport(error) => DeviceError::transport(DEVICE, error),
        Trouble::Again(error) | Trouble::Final(error) => error,
    }
}

impl<T: Bytes> Axis for Elliptec<T> {
    const DEVICE: &'static str = DEVICE;
    const HOME_IS_ZERO: bool = true;
    const SEARCH_IS_TOLD: bool = true;

    fn counts_per_deg(&self) -> f64 {
        self.counts_per_deg
    }

    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        let info = self.steady_info(deadline)?;
        Ok(Identity {
            vendor: "Thorlabs".into(),
            model: format!("ELL{}", info.model),
            serial: Some(info.serial),
            firmware: Some(format!("{:02X}", info.firmware)),
            driver: "elliptec",
        })
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let mut last = None;
        for _ in 0..4 {
            let speed = twice(DEVICE, deadline, || {
                if !self.in_step && self.synchronise(deadline)?.is_none() {
                    return Err(Trouble::Again(protocol("it is busy".into())));
                }
                self.ask(
                    "gv",
                    |reply| match reply {
                        Reply::Speed(percent) => Some(*percent),
                        _ => None,
                    },
                    deadline,
                )
            })?;
            if last == Some(speed) {
                let read = |name, value| Setting { name, value, origin: Origin::ReadBack };
                return Ok(vec![
                    read("counts_per_deg", Value::Number(self.counts_per_deg)),
                    read("speed_percent", Value::Integer(speed.into())),
                ]);
            }
            last = Some(speed);
        }
        Err(protocol("its speed reads differently each time".into()))
    }

    fn state(&mut self, deadline: &Deadline) -> Result<AxisState, DeviceError> {
        twice(DEVICE, deadline, || self.look(deadline))
    }

    fn start(&mut self, target: i32, deadline: &Deadline) -> Result<(), DeviceError> {
        self.begin(&format!("ma{:08X}", target.cast_unsigned()), false, deadline)
    }

    fn search(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        // What is older must not be taken for the end of this search.
        self.steady_info(deadline)?;
        let command = if self.link.anticlockwise { "ho1" } else { "ho0" };
        self.begin(command, true, deadline)
    }

    fn has_searched(&mut self) -> bool {
        self.searched
    }

    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.in_step = false;
        let step = deadline.at_most(self.link.reply_within);
        self.send("st", &step).map_err(failed)
    }
}
