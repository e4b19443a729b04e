//! Command and answer with a meter, over a line that may lose or spoil bytes.

use super::DEVICE;
use super::reply::{Instrument, LONGEST_LINE, Line, ReplyError};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::transport::Bytes;
use crate::twice::{Trouble, twice};
use std::time::Duration;

/// How to speak to a meter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LinkSettings {
    /// How long an answer may take. The longest lines take 0.2 s at 9600 baud; a reading comes with the next measurement.
    pub reply_within: Duration,
}

impl Default for LinkSettings {
    fn default() -> Self {
        Self { reply_within: Duration::from_millis(1_000) }
    }
}

/// A line to a meter.
///
/// An answer does not say which command it is for, so that a late one could be taken for another's. The line keeps its
/// order, though: once the meter has said who it is, which nothing else asks, everything older is out of the way. That is
/// done before the first command and after every one that got no answer or a spoilt one; the command is then repeated once.
#[derive(Debug)]
pub struct Link<T> {
    line: T,
    settings: LinkSettings,
    /// Identity that the meter reports; known once it has done so.
    identity: Option<String>,
    in_step: bool,
}

fn trouble(command: &str, error: &ReplyError) -> Trouble {
    Trouble::Again(spoilt(command, error))
}

/// The error of an answer that was not understood.
pub(super) fn spoilt(command: &str, error: &ReplyError) -> DeviceError {
    DeviceError::Protocol { device: DEVICE, reason: format!("the answer to {command}: {error}") }
}

impl<T: Bytes> Link<T> {
    /// A link over `line`; nothing is said yet.
    pub fn new(line: T, settings: LinkSettings) -> Self {
        Self { line, settings, identity: None, in_step: false }
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

    /// Brings the line into step and gives who the meter is.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn instrument(&mut self, deadline: &Deadline) -> Result<Instrument, DeviceError> {
        twice(DEVICE, deadline, || self.synchronise(deadline))
    }

    /// Sends a command (`$SP`) and gives what stands behind the `*` of its answer.
    ///
    /// # Errors
    /// No answer or a spoilt one, twice; [`DeviceError::Rejected`] with the meter's words.
    pub fn ask(&mut self, command: &str, deadline: &Deadline) -> Result<String, DeviceError> {
        self.ask_as(command, |body| Ok(body.to_owned()), deadline)
    }

    /// Asks like [`ask`](Self::ask), with a parser: an answer that it does not understand is asked for once more.
    ///
    /// # Errors
    /// The errors of [`ask`](Self::ask).
    pub fn ask_as<V>(
        &mut self,
        command: &str,
        parse: impl Fn(&str) -> Result<V, ReplyError>,
        deadline: &Deadline,
    ) -> Result<V, DeviceError> {
        twice(DEVICE, deadline, || {
            let body = self.once(command, deadline)?;
            parse(&body).map_err(|error| {
                self.in_step = false;
                trouble(command, &error)
            })
        })
    }

    fn once(&mut self, command: &str, deadline: &Deadline) -> Result<String, Trouble> {
        if !self.in_step {
            self.synchronise(deadline)?;
        }
        // Until the answer is here, whatever interrupts this leaves the line in doubt.
        self.in_step = false;
        let step = deadline.at_most(self.settings.reply_within);
        self.line.send(format!("{command}\r\n").as_bytes(), &step)?;
        loop {
            let bytes = self.line.receive_until(b'\n', LONGEST_LINE, &step)?;
            let line = Line::parse(&bytes).map_err(|error| trouble(command, &error))?;
            return match line {
                // The second answer to a question that was asked twice while bringing the line into step.
                Line::Good(body) if self.identity.as_deref() == Some(&body) && command != "$II" => {
                    continue;
                }
                Line::Good(body) => {
                    self.in_step = true;
                    Ok(body)
                }
                Line::Refused(said) => {
                    self.in_step = true;
                    let request = command.to_owned();
                    Err(Trouble::Final(DeviceError::Rejected { device: DEVICE, request, said }))
                }
            };
        }
    }

    /// The meter's name at the end of a line, once it is known.
    fn identity_behind(&self, line: &[u8]) -> Option<Instrument> {
        let known = self.identity.as_ref()?;
        let line = line.trim_ascii_end();
        let before = line.strip_suffix(known.as_bytes())?.trim_ascii_end();
        Instrument::parse(known).ok().filter(|_| before.ends_with(b"*"))
    }

    /// Drops what is old: asks who the meter is and reads on until it says so, whatever comes before it.
    fn synchronise(&mut self, deadline: &Deadline) -> Result<Instrument, Trouble> {
        /// So many lines are no leftovers but another device.
        const MOST: usize = 64;
        self.in_step = false;
        let step = deadline.at_most(self.settings.reply_within);
        self.line.discard(&step)?;
        self.line.send(b"$II\r\n", &step)?;
        let mut last = None;
        for _ in 0..MOST {
            let bytes = match self.line.receive_until(b'\n', LONGEST_LINE, &step) {
                Ok(bytes) => bytes,
                // Somebody who speaks, but not so, is not silent: what came is in the error.
                Err(error) if error.is_timeout() => {
                    return Err(match last {
                        Some(error) => trouble("$II", &error),
                        None => error.into(),
                    });
                }
                Err(error) => return Err(error.into()),
            };
            // Behind the first half of a line whose second was lost.
            if let Some(instrument) = self.identity_behind(&bytes) {
                self.in_step = true;
                return Ok(instrument);
            }
            match Line::parse(&bytes) {
                Ok(Line::Good(body)) => match Instrument::parse(&body) {
                    Ok(instrument) if self.identity.as_ref().is_none_or(|known| *known == body) => {
                        self.identity = Some(body);
                        self.in_step = true;
                        return Ok(instrument);
                    }
                    Ok(_) => last = Some(ReplyError::new(&body, "the meter that was there before")),
                    Err(error) => last = Some(error),
                },
                Ok(Line::Refused(said)) => {
                    last = Some(ReplyError::new(&said, "the meter's name"));
                }
                Err(error) => last = Some(error),
            }
        }
        let reason = format!("{MOST} lines without an answer: is this an Ophir meter?");
        Err(Trouble::Final(DeviceError::Protocol { device: DEVICE, reason }))
    }
}
