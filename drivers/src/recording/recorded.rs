//! A transport that writes down what goes through it.

use super::{Event, Fault, Header, LONGEST_PAUSE_US};
use crate::clock::Deadline;
use crate::transport::{Bytes, Transfer, Transfers, TransportError};
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;
use sunglint_formats::FileError;
use sunglint_formats::atomic::Overwrite;

/// Bytes of a stream in one line.
const LINE: usize = 1024;

/// Records a live transport into a file. Each event is handed to the system as it happens, so that a crash of the
/// program keeps what was said; what is sent is written before it goes.
///
/// A call that fails because it cannot be written down ([`TransportError::Recording`]) has reached the device.
#[derive(Debug)]
pub struct Recorded<T> {
    inner: T,
    file: File,
    path: PathBuf,
    last: Option<Duration>,
    gone: bool,
}

impl<T> Recorded<T> {
    /// Starts a recording of `inner`.
    ///
    /// # Errors
    /// The file is there and `overwrite` refuses, it cannot be made, or the header does not fit.
    pub fn create(
        inner: T,
        path: impl AsRef<Path>,
        header: &Header,
        overwrite: Overwrite,
    ) -> Result<Self, FileError> {
        Self::create_at(inner, path.as_ref(), header, overwrite)
    }

    fn create_at(
        inner: T,
        path: &Path,
        header: &Header,
        overwrite: Overwrite,
    ) -> Result<Self, FileError> {
        let path = path.to_path_buf();
        let text = header.to_text().map_err(|error| FileError::encode(&path, error))?;
        let mut options = File::options();
        options.write(true);
        match overwrite {
            Overwrite::Refuse => options.create_new(true),
            Overwrite::Allow => options.create(true).truncate(true),
        };
        let mut file = options.open(&path).map_err(|error| match error.kind() {
            std::io::ErrorKind::AlreadyExists => FileError::Exists { path: path.clone() },
            _ => FileError::io("create", &path, error),
        })?;
        file.write_all(text.as_bytes()).map_err(|error| FileError::io("write", &path, error))?;
        Ok(Self { inner, file, path, last: None, gone: false })
    }

    /// The transport within.
    pub fn into_inner(self) -> T {
        self.inner
    }

    fn write(&mut self, event: &Event, deadline: &Deadline) -> Result<(), TransportError> {
        // The format ends with a disconnection; what a stubborn host tries after it is not part of the conversation.
        if self.gone {
            return Ok(());
        }
        let now = deadline.now();
        let mut text = String::new();
        if let Some(last) = self.last {
            let us = u64::try_from(now.saturating_sub(last).as_micros()).unwrap_or(u64::MAX);
            if us >= 1000 {
                let pause = Duration::from_micros(us.min(LONGEST_PAUSE_US));
                text = format!("{}\n", Event::Pause(pause));
            }
        }
        self.last = Some(now);
        self.gone = *event == Event::Fault(Fault::Disconnect);
        event.check().map_err(|error| FileError::encode(&self.path, error))?;
        text.push_str(&event.to_string());
        text.push('\n');
        // One call of the system: no half line is left where it succeeds.
        self.file
            .write_all(text.as_bytes())
            .map_err(|error| FileError::io("write", &self.path, error).into())
    }

    fn write_stream(
        &mut self,
        bytes: &[u8],
        event: impl Fn(Vec<u8>) -> Event,
        deadline: &Deadline,
    ) -> Result<(), TransportError> {
        bytes.chunks(LINE).try_for_each(|part| self.write(&event(part.to_vec()), deadline))
    }

    /// Writes down what went wrong, where it is something that a replay can repeat.
    fn write_error(
        &mut self,
        error: TransportError,
        deadline: &Deadline,
    ) -> Result<TransportError, TransportError> {
        let fault = match &error {
            TransportError::Timeout { .. } => Fault::Timeout,
            TransportError::Disconnected { .. } => Fault::Disconnect,
            TransportError::Stalled { .. } => Fault::Stall,
            _ => return Ok(error),
        };
        self.write(&Event::Fault(fault), deadline)?;
        Ok(error)
    }
}

impl<T: Bytes> Bytes for Recorded<T> {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        self.write_stream(bytes, Event::Sent, deadline)?;
        match self.inner.send(bytes, deadline) {
            Ok(()) => Ok(()),
            Err(error) => Err(self.write_error(error, deadline)?),
        }
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        match self.inner.receive(buffer, deadline) {
            Ok(count) => {
                self.write_stream(&buffer[..count], Event::Received, deadline)?;
                Ok(count)
            }
            Err(error) => Err(self.write_error(error, deadline)?),
        }
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        match self.inner.discard(deadline) {
            Ok(dropped) => {
                self.write_stream(&dropped, Event::Received, deadline)?;
                Ok(dropped)
            }
            Err(error) => Err(self.write_error(error, deadline)?),
        }
    }

    /// A recording holds one connection: what is said on the next is not part of it.
    fn reconnect(&mut self, deadline: &Deadline) -> Result<(), TransportError> {
        match self.inner.reconnect(deadline) {
            // The line stays as it is.
            Err(error @ TransportError::Unsupported { .. }) => Err(error),
            done => {
                self.write(&Event::Fault(Fault::Disconnect), deadline)?;
                done
            }
        }
    }
}

impl<T: Transfers> Transfers for Recorded<T> {
    fn transfer(
        &mut self,
        transfer: &Transfer,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, TransportError> {
        self.write(&Event::Asked(transfer.clone()), deadline)?;
        match self.inner.transfer(transfer, deadline) {
            Ok(answer) => {
                if transfer.room().is_some() {
                    self.write(&Event::Received(answer.clone()), deadline)?;
                }
                Ok(answer)
            }
            Err(error) => Err(self.write_error(error, deadline)?),
        }
    }
}
