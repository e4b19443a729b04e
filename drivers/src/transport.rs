//! Transports: how bytes reach a device, each call with a [`Deadline`].
//!
//! There are two kinds. [`Bytes`] is a stream without message boundaries: [`serial`], [`tcp`], a [`child`] process.
//! [`Transfers`] is a sequence of requests that the host makes and the device answers one by one: [`usb`], [`hid`]. A
//! request is plain data ([`Transfer`]), so that recorders, replayers and fault injectors need one method only.
//!
//! Wrappers stand around any of them and are transports themselves: [`Recorded`](crate::recording::Recorded),
//! [`Replay`](crate::recording::Replay), [`Faulty`](crate::recording::Faulty). Drivers are generic over the transport.
//!
//! Real transports wait in real time. Give them a deadline on the [`SystemClock`](crate::clock::SystemClock); on a clock
//! that nobody turns, their waits end after the same time on the computer's own clock.

pub mod child;
mod error;
pub mod hid;
pub mod serial;
mod stream;
pub mod tcp;
mod transfer;
pub mod usb;

pub use error::TransportError;
pub use transfer::{Transfer, Transfers};

use crate::clock::Deadline;
use std::time::Duration;

/// The most that one discard drops, bytes: a device that never stops talking must not hold the host for ever.
pub const MOST_DISCARDED: usize = 1 << 20;

/// A stream of bytes to a device and back.
pub trait Bytes: Send {
    /// Sends all of `bytes`.
    ///
    /// # Errors
    /// The deadline, the token, or the transport. Some of the bytes may have gone.
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError>;

    /// Waits for at least one byte and gives what is there, at most `buffer.len()` bytes. The count is never 0 unless
    /// `buffer` is empty.
    ///
    /// # Errors
    /// The deadline, the token, or the transport; nothing was taken from the stream then.
    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError>;

    /// Drops what has arrived and was not read, and gives it, so that a recording knows.
    ///
    /// # Errors
    /// The transport. At most [`MOST_DISCARDED`] bytes are dropped.
    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError>;

    /// Makes the connection anew, where the transport can: nothing of before is on it then.
    ///
    /// # Errors
    /// [`TransportError::Unsupported`] for a transport that cannot; the errors of connecting.
    fn reconnect(&mut self, deadline: &Deadline) -> Result<(), TransportError> {
        let _ = deadline;
        let (what, transfer) = ("this line".to_owned(), "a new connection".to_owned());
        Err(TransportError::Unsupported { what, transfer })
    }

    /// Fills `buffer`.
    ///
    /// # Errors
    /// The errors of [`receive`](Self::receive); what came before the deadline is in `got_so_far`.
    fn receive_exact(
        &mut self,
        buffer: &mut [u8],
        deadline: &Deadline,
    ) -> Result<(), TransportError> {
        let mut filled = 0;
        while filled < buffer.len() {
            match self.receive(&mut buffer[filled..], deadline) {
                Ok(count) => filled += count,
                Err(error) => return Err(error.with_got_so_far(&buffer[..filled])),
            }
        }
        Ok(())
    }

    /// Reads up to and including `end`, byte by byte, so that nothing behind it is taken from the stream.
    ///
    /// # Errors
    /// The errors of [`receive`](Self::receive); [`TransportError::TooLong`] after `most` bytes without `end`.
    fn receive_until(
        &mut self,
        end: u8,
        most: usize,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, TransportError> {
        let mut line = Vec::new();
        let mut byte = [0];
        while line.len() < most {
            match self.receive(&mut byte, deadline) {
                Ok(_) => line.push(byte[0]),
                Err(error) => return Err(error.with_got_so_far(&line)),
            }
            if byte[0] == end {
                return Ok(line);
            }
        }
        Err(TransportError::TooLong { most, got_so_far: line })
    }
}

impl<T: Bytes + ?Sized> Bytes for Box<T> {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        (**self).send(bytes, deadline)
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        (**self).receive(buffer, deadline)
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        (**self).discard(deadline)
    }

    fn reconnect(&mut self, deadline: &Deadline) -> Result<(), TransportError> {
        (**self).reconnect(deadline)
    }
}

impl<T: Bytes + ?Sized> Bytes for &mut T {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        (**self).send(bytes, deadline)
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        (**self).receive(buffer, deadline)
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        (**self).discard(deadline)
    }

    fn reconnect(&mut self, deadline: &Deadline) -> Result<(), TransportError> {
        (**self).reconnect(deadline)
    }
}

/// Whole milliseconds for a system call, at least 1: 0 means "for ever" to some of them.
pub(crate) fn whole_ms(time: Duration) -> u32 {
    u32::try_from(time.as_millis()).unwrap_or(u32::MAX).max(1)
}
