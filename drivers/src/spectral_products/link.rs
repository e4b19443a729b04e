//! Command and answer with a CM110, over a line that may lose or spoil bytes.

use super::DEVICE;
use super::frame::{Answer, Command, ECHO, Query};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::reply::ReplyError;
use crate::transport::{Bytes, MOST_DISCARDED, TransportError};
use crate::twice::{Trouble, twice};
use std::time::Duration;

/// How to speak to the instrument.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LinkSettings {
    /// How long an answer may take while nothing moves.
    pub reply_within: Duration,
    /// After so long a pause nothing more comes of an answer.
    pub quiet: Duration,
    /// How long bringing the line into step may take, beside what a slew under way still needs.
    pub step_within: Duration,
}

impl Default for LinkSettings {
    /// 0.5 s, 0.1 s and 3 s.
    fn default() -> Self {
        Self {
            reply_within: Duration::from_millis(500),
            quiet: Duration::from_millis(100),
            step_within: Duration::from_secs(3),
        }
    }
}

/// A line to a CM110.
///
/// Bytes tell nothing of where an answer begins. Before the first command, and after each answer that did not come or was none, the line is
/// brought into step: an echo is sent until, twice in a row, nothing but its one byte comes back. (A wavelength of 691 nm to 717 nm has that byte,
/// too.) An instrument that lacks an argument takes an echo for it; the next one is then answered.
#[derive(Debug)]
pub struct Link<T> {
    line: T,
    settings: LinkSettings,
    in_step: bool,
    /// Until when it may be silent because it moves, on the clock of the calls.
    busy_until: Duration,
}

fn spoilt(command: Command, error: &ReplyError) -> DeviceError {
    let reason = format!("the answer to the request {command}: {error}");
    DeviceError::Protocol { device: DEVICE, reason }
}

impl<T: Bytes> Link<T> {
    /// A link over `line`; nothing is said yet.
    pub fn new(line: T, settings: LinkSettings) -> Self {
        Self { line, settings, in_step: false, busy_until: Duration::ZERO }
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

    /// Asks a question and gives the number and the status of the answer; once more, where the answer did not come or was none.
    ///
    /// # Errors
    /// No answer or a spoilt one, twice; [`DeviceError::Refused`].
    pub fn ask(&mut self, query: Query, deadline: &Deadline) -> Result<Answer, DeviceError> {
        twice(DEVICE, deadline, || self.once(Command::Ask(query), Duration::ZERO, deadline))
    }

    /// Has it do something that takes up to `work` beside the answer.
    ///
    /// # Errors
    /// The errors of [`ask`](Self::ask), after one attempt: whoever asked looks at what came of it.
    pub fn act(
        &mut self,
        command: Command,
        work: Duration,
        deadline: &Deadline,
    ) -> Result<Answer, DeviceError> {
        self.once(command, work, deadline).map_err(|trouble| match trouble {
            Trouble::Transport(error) => DeviceError::transport(DEVICE, error),
            Trouble::Again(error) | Trouble::Final(error) => error,
        })
    }

    fn once(
        &mut self,
        command: Command,
        work: Duration,
        deadline: &Deadline,
    ) -> Result<Answer, Trouble> {
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
        self.line.send(&command.emit(), &step)?;
        let mut answer = vec![0; command.answer_bytes()];
        self.line.receive_exact(&mut answer, &step)?;
        let answer =
            Answer::parse(&answer).map_err(|error| Trouble::Again(spoilt(command, &error)))?;
        self.in_step = true;
        self.busy_until = Duration::ZERO;
        match answer.status.refused() {
            None => Ok(answer),
            Some(reason) => Err(Trouble::Final(DeviceError::Refused {
                device: DEVICE,
                request: command.to_string(),
                code: i64::from(answer.status.0),
                reason,
            })),
        }
    }

    /// Brings the line into step: waits for the end of a slew, and drops what is old.
    pub(super) fn synchronise(&mut self, deadline: &Deadline) -> Result<(), Trouble> {
        self.in_step = false;
        let moving = self.busy_until.saturating_sub(deadline.now());
        let whole = deadline.at_most(self.settings.step_within.saturating_add(moving));
        let (mut good, mut heard, mut silent) = (0, 0, None);
        loop {
            if let Err(expired) = whole.remaining() {
                return Err(match silent {
                    None if heard > 0 => Trouble::Again(DeviceError::Protocol {
                        device: DEVICE,
                        reason: format!(
                            "{heard} bytes without a clean echo: is this a CM110, at 9600 baud?"
                        ),
                    }),
                    Some(error) => Trouble::Transport(error),
                    None => Trouble::Transport(expired.into()),
                });
            }
            self.line.discard(&whole)?;
            self.line.send(&[ECHO], &whole)?;
            match self.until_quiet(&whole) {
                Ok(bytes) if bytes == [ECHO] => {
                    good += 1;
                    if good == 2 {
                        self.in_step = true;
                        self.busy_until = Duration::ZERO;
                        return Ok(());
                    }
                }
                Ok(bytes) => {
                    (good, silent) = (0, None);
                    heard += bytes.len();
                    if heard > MOST_DISCARDED {
                        let reason = format!("{heard} bytes without an echo: is this a CM110?");
                        return Err(Trouble::Final(DeviceError::Protocol {
                            device: DEVICE,
                            reason,
                        }));
                    }
                }
                Err(error) if error.is_timeout() => (good, silent) = (0, Some(error)),
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// All that comes until it is quiet.
    fn until_quiet(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        /// More is no answer.
        const MOST: usize = 1024;
        let mut heard = Vec::new();
        let mut buffer = [0; 64];
        let mut within = self.settings.reply_within;
        while heard.len() < MOST {
            match self.line.receive(&mut buffer, &deadline.at_most(within)) {
                Ok(count) => heard.extend_from_slice(&buffer[..count]),
                Err(error) if error.is_timeout() && !heard.is_empty() => break,
                Err(error) => return Err(error),
            }
            within = self.settings.quiet;
        }
        Ok(heard)
    }
}
