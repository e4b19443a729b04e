//! Code that serial ports and sockets share: waits in slices, so that the token is looked at and no call outlives its deadline.

use super::{MOST_DISCARDED, TransportError};
use crate::clock::Deadline;
use std::io;
use std::time::{Duration, Instant};

/// The part of a blocking file that waits need.
pub(crate) trait Blocking {
    fn name(&self) -> &str;
    /// Reads within about `time`; [`io::ErrorKind::TimedOut`] or [`io::ErrorKind::WouldBlock`] if nothing came, `Ok(0)`
    /// at the end of the stream.
    fn read_within(&mut self, buffer: &mut [u8], time: Duration) -> io::Result<usize>;
    /// Writes some of `bytes` within about `time`.
    fn write_within(&mut self, bytes: &[u8], time: Duration) -> io::Result<usize>;
}

/// The computer's own clock beside the deadline's, see the [module](super).
pub(crate) struct RealEnd(Option<Instant>);

impl RealEnd {
    pub(crate) fn of(deadline: &Deadline) -> Result<Self, TransportError> {
        Ok(Self(Instant::now().checked_add(deadline.remaining()?)))
    }

    pub(crate) fn slice(&self, deadline: &Deadline) -> Result<Duration, TransportError> {
        let slice = deadline.slice()?;
        match self.0 {
            Some(end) if Instant::now() >= end => {
                Err(TransportError::Timeout { after: deadline.elapsed(), got_so_far: Vec::new() })
            }
            _ => Ok(slice),
        }
    }
}

fn is_nothing_yet(error: &io::Error) -> bool {
    use io::ErrorKind as Kind;
    matches!(error.kind(), Kind::TimedOut | Kind::WouldBlock | Kind::Interrupted)
}

pub(crate) fn send(
    file: &mut impl Blocking,
    mut bytes: &[u8],
    deadline: &Deadline,
) -> Result<(), TransportError> {
    let end = RealEnd::of(deadline)?;
    while !bytes.is_empty() {
        match file.write_within(bytes, end.slice(deadline)?) {
            Ok(0) => return Err(TransportError::disconnected(file.name())),
            Ok(count) => bytes = bytes.get(count..).unwrap_or_default(),
            Err(error) if is_nothing_yet(&error) => {}
            Err(error) => return Err(TransportError::from_io("write to", file.name(), error)),
        }
    }
    Ok(())
}

pub(crate) fn receive(
    file: &mut impl Blocking,
    buffer: &mut [u8],
    deadline: &Deadline,
) -> Result<usize, TransportError> {
    if buffer.is_empty() {
        return Ok(0);
    }
    let end = RealEnd::of(deadline)?;
    loop {
        match file.read_within(buffer, end.slice(deadline)?) {
            Ok(0) => return Err(TransportError::disconnected(file.name())),
            Ok(count) => return Ok(count),
            Err(error) if is_nothing_yet(&error) => {}
            Err(error) => return Err(TransportError::from_io("read from", file.name(), error)),
        }
    }
}

pub(crate) fn discard(
    file: &mut impl Blocking,
    deadline: &Deadline,
) -> Result<Vec<u8>, TransportError> {
    let mut dropped = Vec::new();
    let mut buffer = [0; 4096];
    while dropped.len() < MOST_DISCARDED {
        deadline.remaining()?;
        match file.read_within(&mut buffer, Duration::from_millis(1)) {
            Ok(0) => return Err(TransportError::disconnected(file.name())),
            Ok(count) => dropped.extend_from_slice(&buffer[..count]),
            Err(error) if is_nothing_yet(&error) => break,
            Err(error) => return Err(TransportError::from_io("read from", file.name(), error)),
        }
    }
    Ok(dropped)
}
