//! Question and answer with an instrument on OBP.

use super::DEVICE;
use super::obp::{DEFERRED, Flags, Frame, HEAD, MOST_DATA, TAIL, meaning, message, parse};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::transport::{Bytes, TransportError};
use crate::twice::{Trouble, twice};
use std::time::Duration;

/// How to speak to the instrument.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LinkSettings {
    /// How long an answer may take, beside an integration.
    pub reply_within: Duration,
}

impl Default for LinkSettings {
    fn default() -> Self {
        Self { reply_within: Duration::from_millis(1_000) }
    }
}

/// A line to an instrument.
///
/// Each question has a number that its answer repeats, so that a late answer is not taken for another's. An instrument that repeats none is brought into step by
/// its serial number, which nothing else asks: everything older is out of the way then. That is done after each answer that did not come or was
/// none.
#[derive(Debug)]
pub struct Link<T> {
    line: T,
    settings: LinkSettings,
    heard: Vec<u8>,
    regarding: u32,
    /// Whether answers repeat the number; known once it has answered.
    repeats: Option<bool>,
    /// Whether its answers have a checksum: then questions have one, too, and no answer is without.
    checks: bool,
    in_step: bool,
    serial: Option<String>,
    /// Until when an answer may still come that nobody waits for, on the clock of the calls.
    busy_until: Duration,
}

fn spoilt(reason: String) -> DeviceError {
    DeviceError::Protocol { device: DEVICE, reason }
}

impl<T: Bytes> Link<T> {
    /// A link over `line`; nothing is said yet.
    pub fn new(line: T, settings: LinkSettings) -> Self {
        Self {
            line,
            settings,
            heard: Vec::new(),
            regarding: 0,
            repeats: None,
            checks: false,
            in_step: false,
            serial: None,
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

    /// Asks for the serial number, and lets all that is older go.
    ///
    /// # Errors
    /// No answer or a spoilt one, twice; another instrument than before.
    pub fn serial(&mut self, deadline: &Deadline) -> Result<String, DeviceError> {
        twice(DEVICE, deadline, || self.synchronise(deadline))
    }

    /// Asks and gives the data of the answer; once more, where it did not come or was none.
    ///
    /// # Errors
    /// No answer or a spoilt one, twice; [`DeviceError::Refused`].
    pub fn ask(
        &mut self,
        message: u32,
        data: &[u8],
        deadline: &Deadline,
    ) -> Result<Vec<u8>, DeviceError> {
        twice(DEVICE, deadline, || self.once(message, data, 0, Duration::ZERO, deadline))
    }

    /// Asks once for something that takes up to `work` beside the answer.
    ///
    /// # Errors
    /// The errors of [`ask`](Self::ask), after one attempt.
    pub fn wait(
        &mut self,
        message: u32,
        work: Duration,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, DeviceError> {
        self.once(message, &[], 0, work, deadline).map_err(|trouble| match trouble {
            Trouble::Transport(error) => DeviceError::transport(DEVICE, error),
            Trouble::Again(error) | Trouble::Final(error) => error,
        })
    }

    /// Sets something and waits until it is acknowledged; once more, where that did not come.
    ///
    /// # Errors
    /// The errors of [`ask`](Self::ask).
    pub fn set(
        &mut self,
        message: u32,
        data: &[u8],
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        twice(DEVICE, deadline, || {
            self.once(message, data, Flags::ASK_ACK, Duration::ZERO, deadline).map(|_| ())
        })
    }

    fn once(
        &mut self,
        message: u32,
        data: &[u8],
        flags: u16,
        work: Duration,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, Trouble> {
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
        self.send(message, data, flags, &step)?;
        let acknowledged = flags & Flags::ASK_ACK != 0;
        loop {
            let frame = self.next(&step)?;
            if frame.message != message || !self.is_ours(&frame) {
                continue;
            }
            if frame.flags.any(Flags::NACK | Flags::EXCEPTION) {
                if frame.error == DEFERRED {
                    continue;
                }
                self.in_step = true;
                return Err(Trouble::Final(refused(message, frame.error)));
            }
            if acknowledged && !frame.flags.any(Flags::ACK) {
                return Err(Trouble::Again(spoilt(format!(
                    "the answer to {message:08x} does not say that it was done (flags {:04x})",
                    frame.flags.0
                ))));
            }
            self.in_step = true;
            self.busy_until = Duration::ZERO;
            return Ok(frame.data);
        }
    }

    fn is_ours(&self, frame: &Frame) -> bool {
        self.repeats != Some(true) || frame.regarding == self.regarding
    }

    fn send(
        &mut self,
        message: u32,
        data: &[u8],
        flags: u16,
        deadline: &Deadline,
    ) -> Result<(), TransportError> {
        // 0 is what an instrument says that repeats nothing.
        self.regarding = self.regarding.checked_add(1).unwrap_or(1);
        let mut frame = Frame::new(message, self.regarding, data);
        frame.flags = Flags(flags);
        frame.checked = self.checks;
        self.line.send(&frame.emit(), deadline)
    }

    /// The next frame; bytes that are none are an error.
    fn next(&mut self, deadline: &Deadline) -> Result<Frame, Trouble> {
        loop {
            match parse(&self.heard) {
                Ok(Some((frame, taken))) => {
                    self.heard.drain(..taken);
                    if self.checks && !frame.checked {
                        let reason = format!("the answer {:08x} has no checksum", frame.message);
                        return Err(Trouble::Again(spoilt(reason)));
                    }
                    return Ok(frame);
                }
                Ok(None) => self.hear(deadline)?,
                Err(error) => return Err(Trouble::Again(spoilt(error.to_string()))),
            }
        }
    }

    fn hear(&mut self, deadline: &Deadline) -> Result<(), TransportError> {
        let mut buffer = [0; 4096];
        let count = self.line.receive(&mut buffer, deadline)?;
        self.heard.extend_from_slice(&buffer[..count]);
        Ok(())
    }

    /// Waits for what may still come, and drops what is old: asks for the serial number and reads on until it comes, over whatever is no frame.
    fn synchronise(&mut self, deadline: &Deadline) -> Result<String, Trouble> {
        /// Longest that is passed over, bytes: a few spectra.
        const MOST: usize = 4 * (HEAD + MOST_DATA + TAIL);
        self.in_step = false;
        let moving = self.busy_until.saturating_sub(deadline.now());
        let step = deadline.at_most(self.settings.reply_within.saturating_add(moving));
        self.line.discard(&step)?;
        self.heard.clear();
        self.send(message::SERIAL, &[], 0, &step)?;
        let (mut passed, mut last) = (0, None);
        while passed <= MOST {
            match parse(&self.heard) {
                Ok(Some((frame, taken))) => {
                    self.heard.drain(..taken);
                    passed += taken;
                    let unchecked = self.checks && !frame.checked;
                    if frame.message != message::SERIAL || !self.is_ours(&frame) || unchecked {
                        continue;
                    }
                    let repeats = frame.regarding == self.regarding;
                    let serial = serial(&frame).map_err(Trouble::Again)?;
                    if self.serial.as_ref().is_some_and(|known| *known != serial) {
                        let reason = format!("it says that it is {serial} now: open it again");
                        return Err(Trouble::Again(spoilt(reason)));
                    }
                    self.repeats.get_or_insert(repeats);
                    self.checks |= frame.checked;
                    self.serial = Some(serial.clone());
                    self.in_step = true;
                    self.busy_until = Duration::ZERO;
                    return Ok(serial);
                }
                Ok(None) => match self.hear(&step) {
                    Ok(()) => {}
                    // A piece of a frame may hide the answer behind it.
                    Err(error) if error.is_timeout() && self.heard.len() > HEAD => {
                        self.heard.drain(..1);
                        passed += 1;
                        if deadline.remaining().is_err() || !self.heard.contains(&0xc1) {
                            return Err(error.into());
                        }
                    }
                    Err(error) if error.is_timeout() => {
                        return Err(match last {
                            Some(error) => Trouble::Again(spoilt(error)),
                            None => error.into(),
                        });
                    }
                    Err(error) => return Err(error.into()),
                },
                Err(error) => {
                    last = Some(error.to_string());
                    // On to the next byte that may begin a frame.
                    let next = self.heard.iter().skip(1).position(|byte| *byte == 0xc1);
                    let skip = next.map_or(self.heard.len(), |at| at + 1);
                    self.heard.drain(..skip);
                    passed += skip;
                }
            }
        }
        let reason = format!("{passed} bytes without its serial number: does it speak OBP?");
        Err(Trouble::Final(spoilt(reason)))
    }
}

/// The serial number in a frame.
fn serial(frame: &Frame) -> Result<String, DeviceError> {
    if frame.flags.any(Flags::NACK | Flags::EXCEPTION) {
        return Err(refused(frame.message, frame.error));
    }
    let end = frame.data.iter().position(|byte| *byte == 0).unwrap_or(frame.data.len());
    let text = &frame.data[..end];
    let good = !text.is_empty() && text.iter().all(u8::is_ascii_graphic);
    let text = text.iter().map(|byte| char::from(*byte)).collect::<String>();
    if good {
        Ok(text)
    } else {
        let reason = format!("its serial number: found `{}`, expected text", text.escape_default());
        Err(spoilt(reason))
    }
}

/// The error of a refusal.
fn refused(message: u32, error: u16) -> DeviceError {
    let (request, reason) = (format!("the message {message:08x}"), meaning(error));
    DeviceError::Refused { device: DEVICE, request, code: i64::from(error), reason }
}
