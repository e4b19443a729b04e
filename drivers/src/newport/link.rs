//! Question and answer in lines of text.

use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::reply::ReplyError;
use crate::transport::Bytes;
use crate::twice::{Trouble, twice};
use std::time::Duration;

/// The longest line, bytes, with its end.
const LONGEST_LINE: usize = 256;
/// So many lines are no leftovers but another device.
const MOST_LINES: usize = 64;

/// A line to a controller.
///
/// An answer does not say which question it is for (or not which of several same ones). The line keeps its order, though: once the
/// controller has said its version, which nothing else asks, everything older is out of the way. That is done before the first question
/// and after every one that got no answer or a spoilt one; the question is then repeated once.
#[derive(Debug)]
pub(super) struct Link<T> {
    pub line: T,
    device: &'static str,
    /// End of what is sent.
    end: &'static str,
    /// Question for the version, and whether a line is its answer.
    version_question: String,
    is_version: fn(&str) -> bool,
    /// Version, once it is known.
    version: Option<String>,
    in_step: bool,
    reply_within: Duration,
    /// Time from one line of ours to the next.
    gap: Duration,
    sent: Option<Duration>,
}

impl<T: Bytes> Link<T> {
    pub fn new(
        line: T,
        device: &'static str,
        end: &'static str,
        version: (String, fn(&str) -> bool),
        times: [Duration; 2],
    ) -> Self {
        Self {
            line,
            device,
            end,
            version_question: version.0,
            is_version: version.1,
            version: None,
            in_step: false,
            reply_within: times[0],
            gap: times[1],
            sent: None,
        }
    }

    pub fn protocol(&self, reason: String) -> DeviceError {
        DeviceError::Protocol { device: self.device, reason }
    }

    fn spoilt(&self, question: &str, error: &ReplyError) -> Trouble {
        Trouble::Again(self.protocol(format!("the answer to {question}: {error}")))
    }

    fn send(&mut self, text: &str, deadline: &Deadline) -> Result<(), Trouble> {
        let since = self.sent.map(|sent| deadline.now().saturating_sub(sent));
        if let Some(since) = since.filter(|since| *since < self.gap) {
            let slept = deadline.sleep(self.gap.saturating_sub(since));
            slept.map_err(|expired| Trouble::Transport(expired.into()))?;
        }
        let step = deadline.at_most(self.reply_within);
        let sent = self.line.send(format!("{text}{}", self.end).as_bytes(), &step);
        self.sent = Some(deadline.now());
        Ok(sent?)
    }

    /// Sends what has no answer.
    pub fn tell(&mut self, text: &str, deadline: &Deadline) -> Result<(), DeviceError> {
        self.send(text, deadline).map_err(|trouble| match trouble {
            Trouble::Transport(error) => DeviceError::transport(self.device, error),
            Trouble::Again(error) | Trouble::Final(error) => error,
        })
    }

    fn next(&mut self, step: &Deadline) -> Result<Result<String, ReplyError>, Trouble> {
        let bytes = self.line.receive_until(b'\n', LONGEST_LINE, step)?;
        let text = bytes.strip_suffix(b"\r\n").and_then(|text| std::str::from_utf8(text).ok());
        let text = text.filter(|text| text.bytes().all(|byte| (b' '..=b'~').contains(&byte)));
        let wrong =
            || ReplyError::new(&String::from_utf8_lossy(&bytes), "a line of ASCII with CR LF");
        Ok(text.map(|text| text.trim().to_owned()).ok_or_else(wrong))
    }

    /// Drops what is old and gives the controller's version.
    fn synchronise(&mut self, deadline: &Deadline) -> Result<String, Trouble> {
        self.in_step = false;
        self.line.discard(&deadline.at_most(self.reply_within))?;
        let question = self.version_question.clone();
        self.send(&question, deadline)?;
        let step = deadline.at_most(self.reply_within);
        let mut last = None;
        for _ in 0..MOST_LINES {
            let line = match self.next(&step) {
                // Somebody who speaks, but not so, is not silent.
                Err(Trouble::Transport(error)) if error.is_timeout() => {
                    return Err(match last {
                        Some(error) => self.spoilt(&question, &error),
                        None => Trouble::Transport(error),
                    });
                }
                line => line?,
            };
            match line {
                Ok(line) if (self.is_version)(&line) => {
                    if self.version.as_ref().is_none_or(|known| *known == line) {
                        self.in_step = true;
                        return Ok(line);
                    }
                    last = Some(ReplyError::new(&line, "the version that it had before"));
                }
                Ok(line) => last = Some(ReplyError::new(&line, "the controller's version")),
                Err(error) => last = Some(error),
            }
        }
        Err(Trouble::Final(self.protocol(format!(
            "{MOST_LINES} lines without the version: is this a {}?",
            self.device
        ))))
    }

    /// The controller's version, twice the same.
    pub fn version(&mut self, deadline: &Deadline) -> Result<String, DeviceError> {
        let device = self.device;
        let mut last = None;
        for _ in 0..4 {
            let found = twice(device, deadline, || self.synchronise(deadline))?;
            if last.as_ref() == Some(&found) {
                self.version = Some(found.clone());
                return Ok(found);
            }
            last = Some(found);
        }
        Err(self.protocol("its version reads differently each time".into()))
    }

    /// Asks, and gives what `parse` makes of the answer; one that it does not understand is asked for once more.
    pub fn ask<V>(
        &mut self,
        question: &str,
        parse: impl Fn(&str) -> Result<V, ReplyError>,
        deadline: &Deadline,
    ) -> Result<V, DeviceError> {
        twice(self.device, deadline, || {
            if !self.in_step {
                self.synchronise(deadline)?;
            }
            // Until the answer is here, whatever interrupts this leaves the line in doubt.
            self.in_step = false;
            self.send(question, deadline)?;
            let step = deadline.at_most(self.reply_within);
            for _ in 0..MOST_LINES {
                let line = self.next(&step)?.map_err(|error| self.spoilt(question, &error))?;
                // The second answer to a question that was asked twice while bringing the line into step.
                if self.version.as_ref() == Some(&line) {
                    continue;
                }
                let value = parse(&line).map_err(|error| self.spoilt(question, &error))?;
                self.in_step = true;
                return Ok(value);
            }
            Err(Trouble::Again(
                self.protocol(format!("{MOST_LINES} versions instead of the answer to {question}")),
            ))
        })
    }

    /// Asks until two answers in a row are the same.
    pub fn steady<V: PartialEq>(
        &mut self,
        question: &str,
        parse: impl Fn(&str) -> Result<V, ReplyError>,
        deadline: &Deadline,
    ) -> Result<V, DeviceError> {
        let mut last = None;
        for _ in 0..4 {
            let found = self.ask(question, &parse, deadline)?;
            if last.as_ref() == Some(&found) {
                return Ok(found);
            }
            last = Some(found);
        }
        Err(self.protocol(format!("the answer to {question} reads differently each time")))
    }
}
