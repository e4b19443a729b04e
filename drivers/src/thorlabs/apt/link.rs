//! Request and answer with a controller, among messages that it sends by itself.

use super::DEVICE;
use super::message::{HEADER, HOST, Id, Message, parse};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::transport::{Bytes, TransportError};
use crate::twice::{Trouble, twice};
use std::time::Duration;

/// A controller that is told this often that the host is there goes on speaking: after this time, or so many questions. It
/// falls silent after 50 messages without, so that some may get lost.
const ALIVE_EVERY: Duration = Duration::from_secs(1);
const ALIVE_AFTER: u32 = 10;
/// Garbage beyond this, bytes, is another device.
const MOST_GARBAGE: usize = 4096;

/// How to speak to a controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LinkSettings {
    /// The controller's address: 0x50 for a device of its own (K10CR1, KDC101), 0x21 and up for the bays of a rack.
    pub address: u8,
    /// The channel, from 1.
    pub channel: u8,
    /// How long an answer may take.
    pub reply_within: Duration,
}

impl Default for LinkSettings {
    /// A device of its own, its first channel, answers within 0.5 s.
    fn default() -> Self {
        Self { address: 0x50, channel: 1, reply_within: Duration::from_millis(500) }
    }
}

/// A line to a controller.
///
/// A question that gets no answer, or a spoilt one, is asked once more, after the line has been brought into step: asked who
/// it is, the controller's answer comes after all that is older.
#[derive(Debug)]
pub struct Link<T> {
    line: T,
    settings: LinkSettings,
    heard: Vec<u8>,
    in_step: bool,
    alive_at: Option<Duration>,
    since_alive: u32,
    /// Whether the end of a reference search was told since somebody asked.
    homed: bool,
}

/// Information that the controller gives about itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Info {
    pub serial: u32,
    pub model: String,
    pub firmware: String,
}

impl<T: Bytes> Link<T> {
    /// A link over `line`; nothing is said yet.
    pub fn new(line: T, settings: LinkSettings) -> Self {
        Self {
            line,
            settings,
            heard: Vec::new(),
            in_step: false,
            alive_at: None,
            since_alive: 0,
            homed: false,
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

    /// A message to the controller about its channel.
    pub(super) fn short(&self, id: Id, second: u8) -> Message {
        Message::short(id, self.settings.channel, second, self.settings.address, HOST)
    }

    /// A message with data that begins with the channel.
    pub(super) fn long(&self, id: Id, rest: &[u8]) -> Message {
        let mut data = vec![self.settings.channel, 0];
        data.extend_from_slice(rest);
        Message::long(id, &data, self.settings.address, HOST)
    }

    /// Sends what has no answer.
    pub(super) fn tell(
        &mut self,
        message: &Message,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        self.send(message, &deadline.at_most(self.settings.reply_within)).map_err(of_transport)
    }

    fn send(&mut self, message: &Message, deadline: &Deadline) -> Result<(), TransportError> {
        let now = deadline.now();
        self.since_alive += 1;
        if self.since_alive > ALIVE_AFTER
            || self.alive_at.is_none_or(|at| now.saturating_sub(at) >= ALIVE_EVERY)
        {
            let alive = Message::short(Id::Alive, 0, 0, self.settings.address, HOST);
            self.line.send(&alive.emit(), deadline)?;
            self.alive_at = Some(now);
            self.since_alive = 0;
        }
        self.line.send(&message.emit(), deadline)
    }

    /// Asks and gives the answer of this kind.
    pub(super) fn ask(
        &mut self,
        question: Id,
        answer: Id,
        deadline: &Deadline,
    ) -> Result<Message, DeviceError> {
        let question = self.short(question, 0);
        twice(DEVICE, deadline, || {
            self.once(&question, answer, deadline).map_err(|error| match error {
                DeviceError::Transport { source, .. } => Trouble::Transport(source),
                DeviceError::Protocol { .. } => Trouble::Again(error),
                error => Trouble::Final(error),
            })
        })
    }

    fn once(
        &mut self,
        question: &Message,
        answer: Id,
        deadline: &Deadline,
    ) -> Result<Message, DeviceError> {
        if !self.in_step {
            self.info(deadline)?;
        }
        // Until the answer is here, whatever interrupts this leaves the line in doubt.
        self.in_step = false;
        let step = deadline.at_most(self.settings.reply_within);
        self.send(question, &step).map_err(of_transport)?;
        loop {
            let message = self.next(&step)?;
            self.note(&message);
            if message.id == answer && message.channel() == u16::from(self.settings.channel) {
                self.in_step = true;
                return Ok(message);
            }
            if let Some(refused) = refusal(&message) {
                return Err(refused);
            }
        }
    }

    /// The next message; bytes that are none are an error.
    fn next(&mut self, deadline: &Deadline) -> Result<Message, DeviceError> {
        loop {
            match parse(&self.heard, HOST) {
                Ok(Some((message, taken))) => {
                    self.heard.drain(..taken);
                    return Ok(message);
                }
                Ok(None) => self.hear(deadline)?,
                Err(error) => return Err(protocol(error.to_string())),
            }
        }
    }

    fn hear(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        let mut buffer = [0; 256];
        let received = self.line.receive(&mut buffer, deadline);
        let count = received.map_err(|error| of_transport(error.with_got_so_far(&self.heard)))?;
        self.heard.extend_from_slice(&buffer[..count]);
        Ok(())
    }

    fn note(&mut self, message: &Message) {
        if message.id == Id::Homed {
            self.homed = true;
        }
    }

    /// Whether a reference search was told to have ended since the last call.
    pub(super) fn take_homed(&mut self) -> bool {
        std::mem::take(&mut self.homed)
    }

    /// Brings the line into step and gives what the controller says about itself: what is older is passed over, garbage too.
    pub(super) fn info(&mut self, deadline: &Deadline) -> Result<Info, DeviceError> {
        self.in_step = false;
        let step = deadline.at_most(self.settings.reply_within);
        self.line.discard(&step).map_err(of_transport)?;
        self.heard.clear();
        let question = Message::short(Id::RequestInfo, 0, 0, self.settings.address, HOST);
        self.send(&question, &step).map_err(of_transport)?;
        let mut garbage = 0;
        loop {
            match parse(&self.heard, HOST) {
                Ok(Some((message, taken))) => {
                    self.heard.drain(..taken);
                    self.note(&message);
                    if message.id == Id::Info && self.heard.is_empty() {
                        self.in_step = true;
                        return info(&message);
                    }
                }
                Ok(None) => self.hear(&step)?,
                Err(_) if garbage < MOST_GARBAGE => {
                    garbage += 1;
                    self.heard.drain(..1);
                }
                Err(error) => {
                    let what = format!(
                        "{MOST_GARBAGE} bytes without an answer ({error}): is this an APT device?"
                    );
                    return Err(protocol(what));
                }
            }
        }
    }
}

fn info(message: &Message) -> Result<Info, DeviceError> {
    let data = message.data();
    let (Some(serial), Some(model), Some(version)) =
        (message.long_at(0), data.get(4..12), data.get(14..17))
    else {
        return Err(protocol(format!("an answer of {} bytes about itself", HEADER + data.len())));
    };
    let model: String = model
        .iter()
        .take_while(|byte| **byte != 0)
        .map(|byte| if byte.is_ascii_graphic() { char::from(*byte) } else { ' ' })
        .collect();
    Ok(Info {
        serial: serial.cast_unsigned(),
        model: model.trim().to_owned(),
        firmware: format!("{}.{}.{}", version[2], version[1], version[0]),
    })
}

/// Returns the error that a controller's complaint means; none for other messages.
fn refusal(message: &Message) -> Option<DeviceError> {
    let words = match message.id {
        Id::Response => "an error without details".to_owned(),
        Id::RichResponse => {
            let text = message.data().get(4..).unwrap_or_default();
            let text = text.iter().take_while(|byte| **byte != 0);
            text.map(|byte| if byte.is_ascii() { char::from(*byte) } else { '?' }).collect()
        }
        _ => return None,
    };
    let request = "what it was asked".to_owned();
    Some(DeviceError::Declined { device: DEVICE, request, message: words })
}

fn of_transport(error: TransportError) -> DeviceError {
    DeviceError::transport(DEVICE, error)
}

pub(super) fn protocol(reason: String) -> DeviceError {
    DeviceError::Protocol { device: DEVICE, reason }
}
