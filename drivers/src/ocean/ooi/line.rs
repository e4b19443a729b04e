//! Questions, answers and spectra on the endpoints of an instrument.

use super::frame::{self, Speed, Status, command, slot};
use super::{Model, OoiSettings};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::ocean::DEVICE;
use crate::reply::ReplyError;
use crate::transport::{MOST_DISCARDED, Transfer, Transfers, TransportError};
use crate::twice::{Trouble, twice};
use std::time::Duration;

/// So long nothing comes from an endpoint: there is nothing.
const QUIET: Duration = Duration::from_millis(2);
/// Room for an answer: a packet of any speed.
const ROOM: usize = 512;
/// Answers that are passed over while one is waited for.
const MOST_PASSED: u32 = 64;

pub(super) fn spoilt(reason: String) -> DeviceError {
    DeviceError::Protocol { device: DEVICE, reason }
}

fn unread(what: &str, error: &ReplyError) -> Trouble {
    Trouble::Again(spoilt(format!("{what}: {error}")))
}

/// A line to an instrument.
#[derive(Debug)]
pub(super) struct Line<U> {
    pub usb: U,
    pub model: Model,
    pub settings: OoiSettings,
    /// Speed of the bus: told by models that tell their status, and what is usual of the others.
    pub speed: Speed,
    /// Whether all that was asked for has come, and nothing else.
    in_step: bool,
    /// Whether an endpoint has stalled since.
    stalled: bool,
    /// Until when a spectrum may still come that nobody waits for, on the clock of the calls.
    owed_until: Duration,
    serial: Option<String>,
    /// Value at which the converter ends: spectra that are nothing else may be equal.
    pub end: u16,
    last: Vec<u16>,
}

impl<U: Transfers> Line<U> {
    pub fn new(usb: U, model: Model, settings: OoiSettings) -> Self {
        let speed = match model.layout {
            frame::Layout::Halves => Speed::Full,
            frame::Layout::Words => Speed::High,
        };
        Self {
            usb,
            model,
            settings,
            speed,
            in_step: false,
            stalled: false,
            owed_until: Duration::ZERO,
            serial: None,
            end: model.saturation,
            last: Vec::new(),
        }
    }

    /// Begins a session: the command for it, no trigger, the speed of the bus. Gives the serial number.
    pub fn begin(&mut self, deadline: &Deadline) -> Result<String, DeviceError> {
        let trigger = [command::TRIGGER, 0, 0];
        twice(DEVICE, deadline, || {
            self.set_going(deadline)?;
            self.drain_answers(deadline)?;
            self.send(&[command::INITIALISE], deadline)?;
            deadline.sleep(self.settings.settling).map_err(TransportError::from)?;
            self.send(&trigger, deadline)?;
            if self.model.tells_status {
                self.drain_answers(deadline)?;
                let step = deadline.at_most(self.settings.reply_within);
                let status =
                    self.exchange(&[command::STATUS], "its status", &step, frame::status)?;
                self.speed = status.speed;
            }
            self.synchronise(deadline)
        })
    }

    /// Asks for the serial number, and lets all that is older go.
    pub fn serial(&mut self, deadline: &Deadline) -> Result<String, DeviceError> {
        twice(DEVICE, deadline, || self.synchronise(deadline))
    }

    /// Whether a spectrum may still come that nobody waits for.
    pub fn owes(&self, deadline: &Deadline) -> bool {
        self.owed_until > deadline.now()
    }

    /// Asks for the status.
    pub fn status(&mut self, deadline: &Deadline) -> Result<Status, DeviceError> {
        self.ask(&[command::STATUS], "its status", deadline, frame::status)
    }

    /// Asks for the version of the gate array.
    pub fn firmware(&mut self, deadline: &Deadline) -> Result<[u8; 3], DeviceError> {
        let what = "the version of its gate array";
        self.ask(&[command::REGISTER, 0x04], what, deadline, frame::firmware)
    }

    /// Reads a slot of the memory until two readings agree: its answer.
    pub fn slot(&mut self, number: u8, deadline: &Deadline) -> Result<Vec<u8>, DeviceError> {
        /// Readings of which no two in a row agreed.
        const MOST: u32 = 5;
        let what = format!("slot {number} of its memory");
        let mut last: Option<Vec<u8>> = None;
        for _ in 0..MOST {
            let answer = self.ask(&[command::SLOT, number], &what, deadline, |answer| {
                frame::slot_bytes(number, answer).map(|_| answer.to_vec())
            })?;
            if last.as_ref() == Some(&answer) {
                return Ok(answer);
            }
            last = Some(answer);
        }
        Err(spoilt(format!("{what}: {MOST} readings, and no two in a row agree")))
    }

    /// Sends a command that has no answer.
    pub fn tell(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), DeviceError> {
        twice(DEVICE, deadline, || {
            if !self.in_step {
                self.synchronise(deadline)?;
            }
            self.in_step = false;
            self.send(bytes, &deadline.at_most(self.settings.reply_within))?;
            self.in_step = true;
            Ok(())
        })
    }

    /// Asks and reads the answer; once more, where it did not come or was none.
    fn ask<V>(
        &mut self,
        question: &[u8],
        what: &str,
        deadline: &Deadline,
        read: impl Fn(&[u8]) -> Result<V, ReplyError>,
    ) -> Result<V, DeviceError> {
        twice(DEVICE, deadline, || {
            let answers = [self.model.endpoints.answers];
            // What is there before the question is no answer to it.
            if !self.in_step || self.drain(&answers, deadline)? > 0 {
                self.synchronise(deadline)?;
            }
            // Until the answer is here, whatever interrupts this leaves the line in doubt.
            self.in_step = false;
            let step = deadline.at_most(self.settings.reply_within);
            let value = self.exchange(question, what, &step, &read)?;
            self.in_step = true;
            Ok(value)
        })
    }

    fn exchange<V>(
        &mut self,
        question: &[u8],
        what: &str,
        deadline: &Deadline,
        read: impl Fn(&[u8]) -> Result<V, ReplyError>,
    ) -> Result<V, Trouble> {
        self.send(question, deadline)?;
        let answer = self.answer(deadline)?;
        read(&answer).map_err(|error| unread(what, &error))
    }

    /// The next answer. A packet without data is none yet.
    fn answer(&mut self, deadline: &Deadline) -> Result<Vec<u8>, Trouble> {
        for _ in 0..MOST_PASSED {
            let answer = self.receive(self.model.endpoints.answers, ROOM, deadline)?;
            if !answer.is_empty() {
                return Ok(answer);
            }
        }
        let reason = format!("{MOST_PASSED} packets without data in place of an answer");
        Err(Trouble::Again(spoilt(reason)))
    }

    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        let endpoint = self.model.endpoints.commands;
        let transfer = Transfer::BulkOut { endpoint, data: bytes.to_vec() };
        let sent = self.usb.transfer(&transfer, deadline);
        self.note(&sent);
        sent.map(|_| ())
    }

    fn receive(
        &mut self,
        endpoint: u8,
        length: usize,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, TransportError> {
        let got = self.usb.transfer(&Transfer::BulkIn { endpoint, length }, deadline);
        self.note(&got);
        got
    }

    fn note<V>(&mut self, done: &Result<V, TransportError>) {
        self.stalled |= matches!(done, Err(TransportError::Stalled { .. }));
    }

    /// Endpoints from the instrument that are used at this speed.
    fn incoming(&self) -> Vec<u8> {
        let ends = self.model.endpoints;
        let mut all = vec![ends.answers];
        all.extend(self.parts().iter().map(|part| part.endpoint));
        all.dedup();
        all
    }

    /// Pieces of a spectrum.
    fn parts(&self) -> Vec<Part> {
        /// Bytes that the endpoint for the beginning carries.
        const BEGINNING: usize = 2048;
        let (ends, length) = (self.model.endpoints, self.model.frame_length());
        if self.speed == Speed::Full && self.model.tells_status {
            return vec![Part { endpoint: ends.answers, length }];
        }
        match ends.beginnings {
            None => vec![Part { endpoint: ends.spectra, length }],
            Some(endpoint) => vec![
                Part { endpoint, length: BEGINNING },
                Part { endpoint: ends.spectra, length: length - BEGINNING },
            ],
        }
    }

    /// Sets stalled endpoints going again.
    fn set_going(&mut self, deadline: &Deadline) -> Result<(), TransportError> {
        if self.stalled {
            let mut all = self.incoming();
            all.push(self.model.endpoints.commands);
            for endpoint in all {
                self.usb.transfer(&Transfer::ClearHalt { endpoint }, deadline)?;
            }
            self.stalled = false;
        }
        Ok(())
    }

    fn drain_answers(&mut self, deadline: &Deadline) -> Result<(), TransportError> {
        let answers = [self.model.endpoints.answers];
        self.drain(&answers, deadline).map(|_| ())
    }

    /// Drops what is in these endpoints until nothing comes any more, and gives how many bytes that was.
    fn drain(&mut self, endpoints: &[u8], deadline: &Deadline) -> Result<usize, TransportError> {
        /// Times that an endpoint stalls again after it was set going.
        const MOST_STALLS: u32 = 8;
        let (mut dropped, mut stalls) = (0, 0);
        let mut empty = 0;
        // A whole round without anything.
        while empty < endpoints.len() && dropped < MOST_DISCARDED {
            for endpoint in endpoints {
                deadline.remaining()?;
                match self.receive(*endpoint, 8 * ROOM, &deadline.at_most(QUIET)) {
                    Ok(bytes) if bytes.is_empty() => {
                        // Empty packets count, so that they end.
                        dropped += 1;
                        empty = 0;
                    }
                    Ok(bytes) => {
                        dropped += bytes.len();
                        empty = 0;
                    }
                    Err(error) if error.is_timeout() => empty += 1,
                    Err(TransportError::Stalled { .. }) if stalls < MOST_STALLS => {
                        self.set_going(deadline)?;
                        stalls += 1;
                        dropped += 1;
                        empty = 0;
                    }
                    Err(error) => return Err(error),
                }
            }
        }
        Ok(dropped)
    }

    /// Waits for what may still come and drops what is old: asks for the serial number and passes over whatever comes before it.
    fn synchronise(&mut self, deadline: &Deadline) -> Result<String, Trouble> {
        self.in_step = false;
        let incoming = self.incoming();
        self.set_going(deadline)?;
        self.wait_for_owed(deadline)?;
        self.drain(&incoming, deadline)?;
        let step = deadline.at_most(self.settings.reply_within);
        self.send(&[command::SLOT, slot::SERIAL], &step)?;
        let mut passed = 0;
        let serial = loop {
            let answer = self.answer(&step)?;
            match frame::slot_text(slot::SERIAL, &answer) {
                Ok(serial) => break serial,
                Err(error) if passed == MOST_PASSED => {
                    return Err(unread("its serial number", &error));
                }
                // Its own answer cannot be read: another one will not come.
                Err(error) if frame::slot_bytes(slot::SERIAL, &answer).is_ok() => {
                    return Err(unread("its serial number", &error));
                }
                Err(_) => passed += 1,
            }
        };
        self.drain(&incoming, deadline)?;
        if self.serial.as_ref().is_some_and(|known| *known != serial) {
            let reason = format!("it says that it is {serial} now: open it again");
            return Err(Trouble::Again(spoilt(reason)));
        }
        self.serial = Some(serial.clone());
        self.in_step = true;
        self.owed_until = Duration::ZERO;
        Ok(serial)
    }

    /// Waits for a spectrum that was asked for and not fetched, and drops it: an instrument may answer other questions before it is there.
    fn wait_for_owed(&mut self, deadline: &Deadline) -> Result<(), TransportError> {
        let parts = self.parts();
        let Some(last) = parts.last() else { return Ok(()) };
        let mut length = 0;
        while self.owed_until > deadline.now() && length < last.length {
            deadline.remaining()?;
            let step = deadline.at_most(self.owed_until.saturating_sub(deadline.now()));
            match self.receive(last.endpoint, 8 * ROOM, &step) {
                Ok(bytes) => {
                    length += bytes.len();
                    if !bytes.len().is_multiple_of(Speed::Full.packet()) {
                        // A short packet: its end.
                        break;
                    }
                }
                Err(error) if error.is_timeout() => {
                    deadline.remaining()?;
                    break;
                }
                Err(error) => return Err(error),
            }
        }
        self.owed_until = Duration::ZERO;
        Ok(())
    }

    /// Asks once for a spectrum, which may take up to `work` beside the answer.
    pub fn spectrum(
        &mut self,
        work: Duration,
        deadline: &Deadline,
    ) -> Result<Vec<u16>, DeviceError> {
        self.spectrum_once(work, deadline).map_err(|trouble| match trouble {
            // A stalled endpoint is set going before the next question.
            Trouble::Transport(error @ TransportError::Stalled { .. }) => spoilt(error.to_string()),
            Trouble::Transport(error) => DeviceError::transport(DEVICE, error),
            Trouble::Again(error) | Trouble::Final(error) => error,
        })
    }

    fn spectrum_once(&mut self, work: Duration, deadline: &Deadline) -> Result<Vec<u16>, Trouble> {
        let incoming = self.incoming();
        // What is there before the question is no answer to it.
        if !self.in_step || self.drain(&incoming, deadline)? > 0 {
            self.synchronise(deadline)?;
        }
        self.in_step = false;
        let within = self.settings.reply_within.saturating_add(work);
        let step = deadline.at_most(within);
        self.owed_until = deadline.now().saturating_add(within);
        self.send(&[command::SPECTRUM], &step)?;
        let mut bytes = Vec::with_capacity(self.model.frame_length());
        // No short packet ends these.
        let mut exact = Vec::new();
        for part in self.parts() {
            self.read_part(part, &mut bytes, &step)?;
            if part.length.is_multiple_of(self.speed.packet()) {
                exact.push(part.endpoint);
            }
        }
        let counts = frame::spectrum(&self.model, &bytes);
        // It has ended, whatever it was.
        self.owed_until = Duration::ZERO;
        if !exact.is_empty() && self.drain(&exact, deadline)? > 0 {
            let reason = "more bytes came than a spectrum has: a packet of it came twice, or an older spectrum was late";
            return Err(Trouble::Again(spoilt(reason.to_owned())));
        }
        let counts = counts.map_err(|error| unread("its spectrum", &error))?;
        let saturated = counts.iter().all(|value| *value >= self.end);
        if !saturated && counts == self.last {
            let reason =
                "the same spectrum came twice, value by value: it is a copy of the one before";
            return Err(Trouble::Again(spoilt(reason.to_owned())));
        }
        self.last.clone_from(&counts);
        self.in_step = true;
        Ok(counts)
    }

    /// Reads a piece of a spectrum to its end.
    fn read_part(
        &mut self,
        part: Part,
        bytes: &mut Vec<u8>,
        deadline: &Deadline,
    ) -> Result<(), Trouble> {
        let packet = self.speed.packet();
        // Where the speed is not told, a whole packet may be one of either.
        let whole = if self.model.tells_status { packet } else { Speed::Full.packet() };
        let begin = bytes.len();
        let mut empty = 0;
        loop {
            let left = part.length - (bytes.len() - begin);
            // A piece that ends with a short packet has room for a whole one, so that a longer one is seen.
            let room = left.next_multiple_of(packet);
            // Once a spectrum has begun to come, the rest follows at once.
            let step = match bytes.is_empty() {
                true => deadline.clone(),
                false => deadline.at_most(self.settings.reply_within),
            };
            let got = match self.receive(part.endpoint, room, &step) {
                Ok(got) => got,
                Err(error) => return Err(error.with_got_so_far(&bytes[begin..]).into()),
            };
            empty = if got.is_empty() { empty + 1 } else { 0 };
            bytes.extend_from_slice(&got);
            let length = bytes.len() - begin;
            if length == part.length {
                return Ok(());
            }
            // A short packet ends a transfer; one that was cut by the time ends with a whole one.
            let ended = !got.len().is_multiple_of(whole) || empty > MOST_PASSED;
            if ended || length > part.length {
                self.owed_until = Duration::ZERO;
                let reason = format!(
                    "a spectrum of {length} bytes from endpoint {:02x}, {} sends {} there",
                    part.endpoint, self.model.name, part.length
                );
                return Err(Trouble::Again(spoilt(reason)));
            }
        }
    }
}

/// A piece of a spectrum: where it comes from, and its bytes.
#[derive(Debug, Clone, Copy)]
struct Part {
    endpoint: u8,
    length: usize,
}
