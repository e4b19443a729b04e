//! Question and answer in USBTMC messages.

use super::message::{
    CHECK_CLEAR_STATUS, HEADER, INITIATE_CLEAR, MessageIn, STATUS_PENDING, STATUS_SUCCESS,
    message_out, next_tag, request_in,
};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::reply::ReplyError;
use crate::transport::{Transfer, Transfers, TransportError};
use crate::twice::{Trouble, twice};
use std::time::Duration;

/// The bulk read's room, bytes: a multiple of every packet size, so that no packet overflows it.
const ROOM: usize = 512;
/// Most bytes asked for at a time: with header and padding less than the room, so that a short packet ends each read.
const PART: u32 = 496;
/// The longest answer, bytes.
const LONGEST_ANSWER: usize = 4096;

/// Where the meter is spoken to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Endpoints {
    /// The number of its USBTMC interface.
    pub interface: u8,
    /// Address of the endpoint from the device, bit 7 set.
    pub bulk_in: u8,
    /// Address of the endpoint to the device.
    pub bulk_out: u8,
}

/// How to speak to a meter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TmcSettings {
    /// Where.
    pub endpoints: Endpoints,
    /// How long an answer may take; a reading that is averaged takes its time.
    pub reply_within: Duration,
    /// Whether the meter's buffers are cleared before the first question, as an answer that another program did not fetch
    /// would be taken for ours. Leave it on, but for a meter that cannot.
    pub clear_first: bool,
}

impl Default for TmcSettings {
    /// Endpoints 82 and 02 of interface 0, 3 s, cleared first.
    fn default() -> Self {
        let endpoints = Endpoints { interface: 0, bulk_in: 0x82, bulk_out: 0x02 };
        Self { endpoints, reply_within: Duration::from_secs(3), clear_first: true }
    }
}

/// A session with an instrument.
///
/// A message from the instrument carries the tag of its request, not of the question: an answer that was not fetched would be
/// taken for the next question's. So the instrument's buffers are cleared (INITIATE_CLEAR) after everything that went wrong, and
/// the question is then asked once more.
#[derive(Debug)]
pub struct Tmc<T> {
    /// Name of the instrument in messages.
    device: &'static str,
    usb: T,
    settings: TmcSettings,
    tag: u8,
    in_step: bool,
    /// Whether the meter refused a transfer, so that its endpoint has to be set going again.
    stalled: bool,
}

impl<T: Transfers> Tmc<T> {
    /// A session over `usb` with an instrument that messages call `device`; nothing is said yet.
    pub fn new(device: &'static str, usb: T, settings: TmcSettings) -> Self {
        Self { device, usb, settings, tag: 0, in_step: !settings.clear_first, stalled: false }
    }

    /// The USB device.
    pub fn usb(&self) -> &T {
        &self.usb
    }

    /// The USB device; what is said on it directly, the session does not know.
    pub fn usb_mut(&mut self) -> &mut T {
        &mut self.usb
    }

    /// The USB device.
    pub fn into_usb(self) -> T {
        self.usb
    }

    /// Sends a command that has no answer.
    ///
    /// # Errors
    /// It could not be sent, twice.
    pub fn tell(&mut self, command: &str, deadline: &Deadline) -> Result<(), DeviceError> {
        twice(self.device, deadline, || {
            self.prepare(deadline)?;
            let step = deadline.at_most(self.settings.reply_within);
            self.send(command, &step)?;
            self.in_step = true;
            Ok(())
        })
    }

    /// Asks, and gives what the parser makes of the answer, without its line's end. An answer that it does not understand
    /// is asked for once more.
    ///
    /// # Errors
    /// No answer or a spoilt one, twice.
    pub fn ask_as<V>(
        &mut self,
        question: &str,
        parse: impl Fn(&str) -> Result<V, ReplyError>,
        deadline: &Deadline,
    ) -> Result<V, DeviceError> {
        twice(self.device, deadline, || {
            self.prepare(deadline)?;
            let step = deadline.at_most(self.settings.reply_within);
            self.send(question, &step)?;
            let answer = self.fetch(question, &step)?;
            let text = String::from_utf8_lossy(&answer);
            let value = parse(text.trim_end_matches(['\r', '\n'])).map_err(|error| {
                Trouble::Again(self.protocol(format!("the answer to {question}: {error}")))
            })?;
            self.in_step = true;
            Ok(value)
        })
    }

    /// Brings the meter into step, and takes it out of step until the answer is here.
    fn prepare(&mut self, deadline: &Deadline) -> Result<(), Trouble> {
        if !self.in_step {
            self.clear(&deadline.at_most(self.settings.reply_within))?;
        }
        self.in_step = false;
        Ok(())
    }

    fn protocol(&self, reason: String) -> DeviceError {
        DeviceError::Protocol { device: self.device, reason }
    }

    fn refused_to_clear(&self, answer: &[u8]) -> DeviceError {
        let answer = crate::recording::hex_excerpt(answer);
        self.protocol(format!(
            "it does not clear its buffers (status {answer}): switch it off and on"
        ))
    }

    fn transfer(&mut self, transfer: &Transfer, step: &Deadline) -> Result<Vec<u8>, Trouble> {
        let answer = self.usb.transfer(transfer, step);
        if let Err(TransportError::Stalled { .. }) = answer {
            self.stalled = true;
        }
        Ok(answer?)
    }

    /// Sends a line, without recovery.
    pub(crate) fn send(&mut self, command: &str, step: &Deadline) -> Result<(), Trouble> {
        self.tag = next_tag(self.tag);
        let data = message_out(self.tag, format!("{command}\n").as_bytes());
        let endpoint = self.settings.endpoints.bulk_out;
        self.transfer(&Transfer::BulkOut { endpoint, data }, step).map(|_| ())
    }

    /// Fetches the answer to a question, without recovery.
    pub(crate) fn fetch(&mut self, question: &str, step: &Deadline) -> Result<Vec<u8>, Trouble> {
        let Endpoints { bulk_in, bulk_out, .. } = self.settings.endpoints;
        let mut answer = Vec::new();
        // Each part brings at least a byte.
        while answer.len() < LONGEST_ANSWER {
            self.tag = next_tag(self.tag);
            let data = request_in(self.tag, PART);
            self.transfer(&Transfer::BulkOut { endpoint: bulk_out, data }, step)?;
            let read = Transfer::BulkIn { endpoint: bulk_in, length: ROOM };
            let bytes = self.transfer(&read, step)?;
            let part = MessageIn::parse(&bytes, self.tag).map_err(|error| {
                let start = crate::recording::hex_excerpt(bytes.get(..HEADER).unwrap_or(&bytes));
                Trouble::Again(
                    self.protocol(format!("the answer to {question}: {error} ({start})")),
                )
            })?;
            answer.extend_from_slice(part.payload);
            if part.end {
                return Ok(answer);
            }
            if part.payload.is_empty() {
                let reason = format!("the answer to {question}: an empty part of a message");
                return Err(Trouble::Again(self.protocol(reason)));
            }
        }
        let reason = format!("the answer to {question} has more than {LONGEST_ANSWER} bytes");
        Err(Trouble::Again(self.protocol(reason)))
    }

    /// Empties the instrument's buffers (USBTMC 4.2.1.6 and 4.2.1.7) and sets its endpoints going.
    pub(crate) fn clear(&mut self, step: &Deadline) -> Result<(), Trouble> {
        let Endpoints { interface, bulk_in, bulk_out } = self.settings.endpoints;
        let control = |request, length| Transfer::ControlIn {
            request_type: 0xa1,
            request,
            value: 0,
            index: u16::from(interface),
            length,
        };
        let answer = self.transfer(&control(INITIATE_CLEAR, 1), step)?;
        if answer.first() != Some(&STATUS_SUCCESS) {
            return Err(Trouble::Again(self.refused_to_clear(&answer)));
        }
        loop {
            let answer = self.transfer(&control(CHECK_CLEAR_STATUS, 2), step)?;
            match (answer.first(), answer.get(1)) {
                (Some(&STATUS_SUCCESS), _) => break,
                (Some(&STATUS_PENDING), Some(more)) => {
                    if more & 1 == 1 {
                        // The meter still has something to be fetched before it can go on.
                        self.transfer(&Transfer::BulkIn { endpoint: bulk_in, length: ROOM }, step)?;
                    }
                }
                _ => return Err(Trouble::Again(self.refused_to_clear(&answer))),
            }
            step.sleep(Duration::from_millis(10)).map_err(TransportError::from)?;
        }
        self.transfer(&Transfer::ClearHalt { endpoint: bulk_out }, step)?;
        if self.stalled {
            self.transfer(&Transfer::ClearHalt { endpoint: bulk_in }, step)?;
            self.stalled = false;
        }
        self.in_step = true;
        Ok(())
    }
}
