//! Request and answer with a module, over a line that may lose or spoil bytes.

use super::DEVICE;
use super::tmcl::{Command, Frame, LENGTH, Reply, Request, Status};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::transport::Bytes;
use crate::twice::{Trouble, twice};
use std::time::Duration;

/// How to speak to a module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LinkSettings {
    /// The module's address.
    pub module: u8,
    /// How long an answer may take. Two frames take 19 ms at 9600 baud.
    pub reply_within: Duration,
}

impl Default for LinkSettings {
    fn default() -> Self {
        Self { module: 1, reply_within: Duration::from_millis(300) }
    }
}

/// A line to a module.
///
/// A request that gets no answer, or a spoilt one, is repeated once, after the line has been brought into step again. An
/// answer does not say which parameter it is about, so that a late one could be taken for another's. The line keeps its
/// order, though: once a module has answered a question that nothing else asks (its version), everything older is out of
/// the way. That is done before the first request and after every failed one.
#[derive(Debug)]
pub struct Link<T> {
    line: T,
    settings: LinkSettings,
    in_step: bool,
}

fn garbled(reason: String) -> Trouble {
    Trouble::Again(DeviceError::Protocol { device: DEVICE, reason })
}

impl<T: Bytes> Link<T> {
    /// A link over `line`; nothing is said yet.
    pub fn new(line: T, settings: LinkSettings) -> Self {
        Self { line, settings, in_step: false }
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

    /// How it is spoken to.
    pub fn settings(&self) -> &LinkSettings {
        &self.settings
    }

    /// Brings the line into step and gives the module's number and version, as command 136 says them: the number in the
    /// upper 16 bits (0 from old modules), the version in the lower (`0x0109` is 1.09).
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn version(&mut self, deadline: &Deadline) -> Result<u32, DeviceError> {
        self.in_step = false;
        twice(DEVICE, deadline, || self.synchronise(deadline))
    }

    /// Asks and gives the value of the answer.
    ///
    /// # Errors
    /// No answer or a spoilt one, twice; [`DeviceError::Refused`] with the module's status.
    pub fn ask(
        &mut self,
        command: Command,
        kind: u8,
        motor: u8,
        value: i32,
        deadline: &Deadline,
    ) -> Result<i32, DeviceError> {
        let request = Request { module: self.settings.module, command, kind, motor, value };
        twice(DEVICE, deadline, || self.once(&request, deadline))
    }

    fn once(&mut self, request: &Request, deadline: &Deadline) -> Result<i32, Trouble> {
        if !self.in_step {
            self.synchronise(deadline)?;
        }
        // Until the answer is here, whatever interrupts this leaves the line in doubt.
        self.in_step = false;
        let step = deadline.at_most(self.settings.reply_within);
        self.line.send(request.emit().bytes(), &step)?;
        let mut bytes = [0; LENGTH];
        self.line.receive_exact(&mut bytes, &step)?;
        let frame = Frame::new(&bytes).map_err(|error| {
            let bytes = crate::recording::hex_excerpt(&bytes);
            garbled(format!("the answer to the {request} is spoilt ({error}): {bytes}"))
        })?;
        let reply = Reply::parse(&frame);
        if reply.module != request.module || reply.command != request.command {
            let (module, command) = (reply.module, reply.command.number());
            return Err(garbled(format!(
                "the {request} was answered by module {module} to command {command}, expected module {} and command {}",
                request.module,
                request.command.number()
            )));
        }
        match reply.status {
            Status::Success => {
                self.in_step = true;
                Ok(reply.value)
            }
            // The line spoilt the request; the module is in step, but nothing was done.
            Status::WrongChecksum => Err(Trouble::Again(refused(request, reply.status))),
            status => {
                self.in_step = true;
                Err(Trouble::Final(refused(request, status)))
            }
        }
    }

    /// Drops what is old: asks for the version and reads on until its answer is there, whatever comes before it.
    fn synchronise(&mut self, deadline: &Deadline) -> Result<u32, Trouble> {
        /// Older bytes than this are no leftovers but another device.
        const MOST: usize = 4096;
        let step = deadline.at_most(self.settings.reply_within);
        let module = self.settings.module;
        let request = Request { module, command: Command::Version, kind: 1, motor: 0, value: 0 };
        self.line.discard(&step)?;
        self.line.send(request.emit().bytes(), &step)?;
        let mut heard = Vec::new();
        let mut all = Vec::new();
        let mut buffer = [0; LENGTH];
        while all.len() < MOST {
            // Somebody who speaks, but not so, is not silent: what came is in the error.
            let received = self.line.receive(&mut buffer, &step);
            let count = received.map_err(|error| error.with_got_so_far(&all))?;
            all.extend_from_slice(&buffer[..count]);
            heard.extend_from_slice(&buffer[..count]);
            while let Some(candidate) = heard.get(..LENGTH) {
                let Ok(frame) = Frame::new(candidate) else {
                    heard.remove(0);
                    continue;
                };
                heard.drain(..LENGTH);
                let reply = Reply::parse(&frame);
                if (reply.module, reply.command) != (module, Command::Version) {
                    continue;
                }
                return match reply.status {
                    Status::Success if heard.is_empty() => {
                        self.in_step = true;
                        Ok(reply.value.cast_unsigned())
                    }
                    // More than was asked for: an older question's answer is still under way.
                    Status::Success => Err(garbled("two answers to one question".into())),
                    Status::WrongChecksum => Err(Trouble::Again(refused(&request, reply.status))),
                    status => Err(Trouble::Final(refused(&request, status))),
                };
            }
        }
        let reason =
            format!("{MOST} bytes without an answer: is this a TMCL module, and the speed right?");
        Err(Trouble::Final(DeviceError::Protocol { device: DEVICE, reason }))
    }
}

fn refused(request: &Request, status: Status) -> DeviceError {
    DeviceError::Refused {
        device: DEVICE,
        request: format!("the {request}"),
        code: status.number().into(),
        reason: status.meaning(),
    }
}
