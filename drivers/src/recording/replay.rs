//! A recording that answers as the device did, and holds the host to what it said.

use super::{Event, Fault, Recording, hex_excerpt};
use crate::clock::Deadline;
use crate::transport::{Bytes, Transfer, Transfers, TransportError};
use std::path::PathBuf;
use std::time::Duration;

/// Difference between what the host did and what the recording holds instead.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}:{line}: the host {host}, the recording {recording}", path.display())]
#[non_exhaustive]
pub struct ReplayError {
    /// The recording.
    pub path: PathBuf,
    /// Line of the recording, counted from 1; 0 for a recording that is no file.
    pub line: u64,
    /// Action of the host.
    pub host: String,
    /// Content of the recording at that line.
    pub recording: String,
}

/// A recording as a transport, in memory and strict: the host must say byte for byte what was recorded, in that order.
///
/// The device's pauses pass on the deadline's clock; a recorded `! timeout` lets the host wait until its own deadline.
/// At the end, [`finish`](Self::finish) tells whether anything was left over.
#[derive(Debug)]
pub struct Replay {
    recording: Recording,
    /// The next event, and how many of its bytes are done.
    next: usize,
    done: usize,
    /// When the last event ended, on the deadline's clock.
    last: Option<Duration>,
    gone: bool,
}

/// Longest wait that counts as a look whether something came.
const LOOK: Duration = Duration::from_millis(5);

impl Replay {
    /// Starts at the first event.
    pub fn new(recording: Recording) -> Self {
        Self { recording, next: 0, done: 0, last: None, gone: false }
    }

    /// Whether the host has said and read everything.
    ///
    /// # Errors
    /// The first line that is left over.
    pub fn finish(mut self) -> Result<(), ReplayError> {
        self.skip_pauses();
        match self.recording.events.get(self.next) {
            None => Ok(()),
            // A host that hangs up has no need to hear that the device did.
            Some((_, Event::Fault(Fault::Disconnect))) => Ok(()),
            Some((_, event)) => {
                let left = self.describe(event);
                Err(self.error("has finished", format!("goes on with {left}")))
            }
        }
    }

    /// An event, its bytes as far as they are left.
    fn describe(&self, event: &Event) -> String {
        match event {
            Event::Sent(data) => {
                format!("`> {}`", hex_excerpt(data.get(self.done..).unwrap_or(&[])))
            }
            Event::Received(data) => {
                format!("`< {}`", hex_excerpt(data.get(self.done..).unwrap_or(&[])))
            }
            Event::Asked(transfer) => request(transfer),
            other => format!("`{other}`"),
        }
    }

    fn error(&self, host: impl Into<String>, recording: impl Into<String>) -> ReplayError {
        let events = &self.recording.events;
        let line = events.get(self.next).or(events.last()).map_or(0, |(line, _)| *line);
        let path = self.recording.path.clone();
        ReplayError { path, line, host: host.into(), recording: recording.into() }
    }

    /// The error of a host that did `host` where something else is due.
    fn unexpected(&self, host: String) -> TransportError {
        let recording = match self.recording.events.get(self.next) {
            Some((_, event)) => format!("has {}", self.describe(event)),
            None => "has ended".to_owned(),
        };
        self.error(host, recording).into()
    }

    fn advance(&mut self) {
        self.next += 1;
        self.done = 0;
    }

    /// Passes pauses and gives their sum.
    fn skip_pauses(&mut self) -> Duration {
        let mut sum = Duration::ZERO;
        while let Some((_, Event::Pause(time))) = self.recording.events.get(self.next) {
            sum = sum.saturating_add(*time);
            self.advance();
        }
        sum
    }

    /// Returns the event after the pauses that are due next, the sum of these pauses, and the event's index.
    fn after_pauses(&self) -> (Option<&Event>, Duration, usize) {
        let mut sum = Duration::ZERO;
        let mut index = self.next;
        while let Some((_, event)) = self.recording.events.get(index) {
            let Event::Pause(time) = event else { return (Some(event), sum, index) };
            sum = sum.saturating_add(*time);
            index += 1;
        }
        (None, sum, index)
    }

    fn disconnected(&self) -> TransportError {
        TransportError::disconnected(format!("the device of {}", self.recording.path.display()))
    }

    /// Waits for the device's next move and gives its bytes or its fault: `None` if it is the host's turn.
    fn device_moves(&mut self, deadline: &Deadline) -> Result<Option<Fault>, TransportError> {
        if self.gone {
            return Err(self.disconnected());
        }
        let (event, pause, index) = self.after_pauses();
        let fault = match event {
            Some(Event::Received(_)) => None,
            Some(Event::Fault(fault)) => Some(*fault),
            _ => return Err(self.unexpected("waits for the device".to_owned())),
        };
        // The host's own deadline ends a wait that was recorded as in vain.
        if fault != Some(Fault::Timeout) {
            let due = self.last.unwrap_or(deadline.now()).saturating_add(pause);
            deadline.sleep(due.saturating_sub(deadline.now()))?;
            self.last = Some(due.max(self.last.unwrap_or_default()));
        }
        self.next = index;
        if fault.is_some() {
            self.advance();
        } else if pause > Duration::ZERO {
            self.done = 0;
        }
        Ok(fault)
    }

    /// Carries out a recorded fault.
    fn fail(&mut self, fault: Fault, what: &str, deadline: &Deadline) -> TransportError {
        match fault {
            Fault::Disconnect => {
                self.gone = true;
                self.disconnected()
            }
            Fault::Stall => TransportError::Stalled { transfer: what.to_owned() },
            Fault::Timeout => loop {
                let slept = deadline.sleep(Duration::from_secs(1));
                self.last = Some(deadline.now());
                if let Err(expired) = slept {
                    break expired.into();
                }
            },
        }
    }

    /// Copies what the device has said, if it is its turn.
    fn copy(&mut self, buffer: &mut [u8]) -> usize {
        let Some((_, Event::Received(data))) = self.recording.events.get(self.next) else {
            return 0;
        };
        let left = data.get(self.done..).unwrap_or(&[]);
        let count = left.len().min(buffer.len());
        buffer[..count].copy_from_slice(&left[..count]);
        self.done += count;
        if self.done >= data.len() {
            self.advance();
        }
        count
    }
}

impl Bytes for Replay {
    fn send(&mut self, mut bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        deadline.remaining()?;
        if self.gone {
            return Err(self.disconnected());
        }
        while !bytes.is_empty() {
            self.skip_pauses();
            let Some((_, Event::Sent(data))) = self.recording.events.get(self.next) else {
                return Err(self.unexpected(format!("sends `> {}`", hex_excerpt(bytes))));
            };
            let left = data.get(self.done..).unwrap_or(&[]);
            let count = left.len().min(bytes.len());
            if left[..count] != bytes[..count] {
                return Err(self.unexpected(format!("sends `> {}`", hex_excerpt(bytes))));
            }
            self.done += count;
            if self.done >= data.len() {
                self.advance();
            }
            bytes = &bytes[count..];
        }
        self.last = Some(deadline.now());
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        let left = deadline.remaining()?;
        if buffer.is_empty() {
            return Ok(0);
        }
        // A host that only looks whether something came hears nothing where the recording has it speak next.
        if left <= LOOK && matches!(self.after_pauses().0, Some(Event::Sent(_))) {
            deadline.sleep(left)?;
            deadline.remaining()?;
        }
        loop {
            if let Some(fault) = self.device_moves(deadline)? {
                return Err(self.fail(fault, "", deadline));
            }
            // An empty line of the device is nothing yet.
            match self.copy(buffer) {
                0 => {}
                count => return Ok(count),
            }
        }
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        let mut dropped = Vec::new();
        let mut buffer = [0; 4096];
        loop {
            let (event, pause, index) = self.after_pauses();
            let due = self.last.unwrap_or(deadline.now()).saturating_add(pause);
            if !matches!(event, Some(Event::Received(_))) || due > deadline.now() {
                return Ok(dropped);
            }
            if index != self.next {
                self.next = index;
                self.done = 0;
                self.last = Some(due);
            }
            let count = self.copy(&mut buffer);
            dropped.extend_from_slice(&buffer[..count]);
        }
    }
}

/// A request as the recording writes it.
fn request(transfer: &Transfer) -> String {
    let data = transfer.data().unwrap_or(&[]);
    format!("`> [{transfer}] {}", hex_excerpt(data)).trim_end().to_owned() + "`"
}

impl Transfers for Replay {
    fn transfer(
        &mut self,
        transfer: &Transfer,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, TransportError> {
        deadline.remaining()?;
        if self.gone {
            return Err(self.disconnected());
        }
        self.skip_pauses();
        match self.recording.events.get(self.next) {
            Some((_, Event::Asked(expected))) if expected == transfer => self.advance(),
            _ => return Err(self.unexpected(format!("asks {}", request(transfer)))),
        }
        self.last = Some(deadline.now());
        let Some(room) = transfer.room() else {
            // Nothing comes back but a refusal.
            if matches!(self.after_pauses().0, Some(Event::Fault(_)))
                && let Some(fault) = self.device_moves(deadline)?
            {
                return Err(self.fail(fault, &transfer.to_string(), deadline));
            }
            return Ok(Vec::new());
        };
        if let Some(fault) = self.device_moves(deadline)? {
            return Err(self.fail(fault, &transfer.to_string(), deadline));
        }
        let Some((_, Event::Received(answer))) = self.recording.events.get(self.next) else {
            return Err(self.unexpected("waits for the device".to_owned()));
        };
        if answer.len() > room {
            let host = format!("has room for {room} bytes");
            return Err(self.error(host, format!("answers with {} bytes", answer.len())).into());
        }
        let answer = answer.clone();
        self.advance();
        Ok(answer)
    }
}
