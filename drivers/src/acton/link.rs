//! Command and answer with an Acton monochromator, over a line that may lose or spoil bytes.

use super::DEVICE;
use super::reply::{Answer, End, LONGEST_LINE, MOST_LINES, end_of, model, text};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::reply::ReplyError;
use crate::transport::{Bytes, TransportError};
use crate::twice::{Trouble, twice};
use std::time::Duration;

/// Question by whose answer the line is brought into step.
const WHO: &str = "MODEL";

/// How to speak to the instrument.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LinkSettings {
    /// How long an answer may take while nothing moves. The list of gratings takes 0.4 s at 9600 baud.
    pub reply_within: Duration,
}

impl Default for LinkSettings {
    fn default() -> Self {
        Self { reply_within: Duration::from_millis(1_000) }
    }
}

/// A line to an Acton monochromator.
///
/// Where the instrument echoes, each answer says which command it is for. Where it does not, the order of the line has to do: once the instrument
/// has told its model, which nothing else asks, everything older is out of the way. That is done before the first command and after
/// every answer that did not come or was none.
#[derive(Debug)]
pub struct Link<T> {
    line: T,
    settings: LinkSettings,
    /// Model that it says it is; known once it has done so.
    model: Option<String>,
    echoes: bool,
    in_step: bool,
    /// Bytes that have come and were not looked at.
    heard: Vec<u8>,
    /// Until when it may be silent because it moves, on the clock of the calls.
    busy_until: Duration,
}

fn spoilt(command: &str, error: &ReplyError) -> DeviceError {
    DeviceError::Protocol { device: DEVICE, reason: format!("the answer to {command}: {error}") }
}

impl<T: Bytes> Link<T> {
    /// A link over `line`; nothing is said yet.
    pub fn new(line: T, settings: LinkSettings) -> Self {
        Self {
            line,
            settings,
            model: None,
            echoes: false,
            in_step: false,
            heard: Vec::new(),
            busy_until: Duration::ZERO,
        }
    }

    /// The line.
    pub fn line(&self) -> &T {
        &self.line
    }

    /// The line; what is said on it directly, the link does not know.
    pub fn line_mut(&mut self) -> &mut T {
        &mut self.line
    }

    /// The line.
    pub fn into_line(self) -> T {
        self.line
    }

    /// Whether the instrument echoes what it hears.
    pub fn echoes(&self) -> bool {
        self.echoes
    }

    /// Asks the instrument for its model, and lets all that is older go.
    ///
    /// # Errors
    /// No answer or a spoilt one, twice; another model than before.
    pub fn model(&mut self, deadline: &Deadline) -> Result<String, DeviceError> {
        twice(DEVICE, deadline, || self.synchronise(deadline))
    }

    /// Asks with a parser: an answer that did not come, or that the parser does not take, is asked for once more.
    ///
    /// # Errors
    /// No answer or a spoilt one, twice; [`DeviceError::Rejected`] with the instrument's words.
    pub fn ask<V>(
        &mut self,
        command: &str,
        parse: impl Fn(&str) -> Result<V, ReplyError>,
        deadline: &Deadline,
    ) -> Result<V, DeviceError> {
        twice(DEVICE, deadline, || {
            let body = self.once(command, Duration::ZERO, deadline)?;
            parse(&body).map_err(|error| {
                self.in_step = false;
                Trouble::Again(spoilt(command, &error))
            })
        })
    }

    /// Has it do something that takes up to `work` beside the answer.
    ///
    /// # Errors
    /// The errors of [`ask`](Self::ask), after one attempt: whoever asked looks at what came of it.
    pub fn act(
        &mut self,
        command: &str,
        work: Duration,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        self.once(command, work, deadline).map(|_| ()).map_err(|trouble| match trouble {
            Trouble::Transport(error) => DeviceError::transport(DEVICE, error),
            Trouble::Again(error) | Trouble::Final(error) => error,
        })
    }

    fn once(
        &mut self,
        command: &str,
        work: Duration,
        deadline: &Deadline,
    ) -> Result<String, Trouble> {
        if !self.in_step {
            self.synchronise(deadline)?;
        }
        // Until the answer is here, whatever interrupts this leaves the line in doubt.
        self.in_step = false;
        let within = self.settings.reply_within.saturating_add(work);
        let step = deadline.at_most(within);
        if !work.is_zero() {
            self.busy_until = deadline.now().saturating_add(within);
        }
        self.line.send(format!("{command}\r").as_bytes(), &step)?;
        let bytes = self.lines(&step)?;
        let answer = Answer::parse(command, self.echoes, &bytes)
            .map_err(|error| Trouble::Again(spoilt(command, &error)))?;
        self.in_step = true;
        self.busy_until = Duration::ZERO;
        match answer {
            Answer::Good(body) => Ok(body),
            Answer::NotUnderstood(said) => {
                let request = command.to_owned();
                Err(Trouble::Final(DeviceError::Rejected { device: DEVICE, request, said }))
            }
        }
    }

    /// A line with its end.
    fn line_heard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        loop {
            if let Some(at) = self.heard.iter().position(|byte| *byte == b'\n') {
                return Ok(self.heard.drain(..=at).collect());
            }
            if self.heard.len() >= LONGEST_LINE {
                let got_so_far = std::mem::take(&mut self.heard);
                return Err(TransportError::TooLong { most: LONGEST_LINE, got_so_far });
            }
            let mut buffer = [0; LONGEST_LINE];
            match self.line.receive(&mut buffer, deadline) {
                Ok(count) => self.heard.extend_from_slice(&buffer[..count]),
                Err(error) => return Err(error.with_got_so_far(&self.heard)),
            }
        }
    }

    /// All lines of an answer.
    fn lines(&mut self, deadline: &Deadline) -> Result<Vec<u8>, Trouble> {
        let mut lines = Vec::new();
        for _ in 0..MOST_LINES {
            let line = self.line_heard(deadline);
            let line = line.map_err(|error| error.with_got_so_far(&lines))?;
            let end = end_of(&String::from_utf8_lossy(&line));
            lines.extend_from_slice(&line);
            if end != End::NotYet {
                return Ok(lines);
            }
        }
        let reason = format!("{MOST_LINES} lines without ` ok`: is this an Acton monochromator?");
        Err(Trouble::Again(DeviceError::Protocol { device: DEVICE, reason }))
    }

    /// Waits for the end of a slew, ends a command that was cut off, and drops what is old: asks for the model and reads on until it comes.
    fn synchronise(&mut self, deadline: &Deadline) -> Result<String, Trouble> {
        /// So many lines are no leftovers but another device.
        const MOST: usize = 64;
        self.in_step = false;
        let moving = self.busy_until.saturating_sub(deadline.now());
        let step = deadline.at_most(self.settings.reply_within.saturating_add(moving));
        self.line.discard(&step)?;
        self.heard.clear();
        // A command that lost its end would swallow the question. Nobody has said anything yet before the first one.
        let question = if self.model.is_some() { format!("\r{WHO}\r") } else { format!("{WHO}\r") };
        self.line.send(question.as_bytes(), &step)?;
        let mut last = None;
        for _ in 0..MOST {
            let bytes = match self.line_heard(&step) {
                Ok(bytes) => bytes,
                // Somebody who speaks, but not so, is not silent: what came is in the error.
                Err(error) if error.is_timeout() => {
                    return Err(match last {
                        Some(error) => Trouble::Again(spoilt(WHO, &error)),
                        None => error.into(),
                    });
                }
                Err(error) => return Err(error.into()),
            };
            match self.introduction(&bytes) {
                Ok((model, echoes)) => {
                    self.model = Some(model.clone());
                    self.echoes = echoes;
                    self.in_step = true;
                    self.busy_until = Duration::ZERO;
                    return Ok(model);
                }
                Err(error) => last = Some(error),
            }
        }
        let reason = format!("{MOST} lines without its model: is this an Acton monochromator?");
        Err(Trouble::Final(DeviceError::Protocol { device: DEVICE, reason }))
    }

    /// The model in a line, and whether its question stands before it.
    fn introduction(&self, line: &[u8]) -> Result<(String, bool), ReplyError> {
        let line = text(line)?;
        let line = line.trim();
        let body = match end_of(line) {
            End::Ok => line.strip_suffix("ok").unwrap_or(line).trim(),
            _ => return Err(ReplyError::new(line, "the model's name and ` ok`")),
        };
        // Before the echo there may be the rest of something older.
        let (body, echoes) = match body.rsplit_once(WHO) {
            Some((_, body)) => (body.trim(), true),
            None => (body, false),
        };
        let model = model(body)?;
        match &self.model {
            Some(known) if *known != model || self.echoes != echoes => {
                Err(ReplyError::new(line, "the instrument that was there before"))
            }
            _ => Ok((model, echoes)),
        }
    }
}
