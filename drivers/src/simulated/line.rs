//! A simulated device at the other end of a line: in memory, or on a real one.

use crate::clock::Deadline;
use crate::transport::{Bytes, TransportError};
use std::collections::VecDeque;
use std::time::Duration;

/// A device that hears bytes and says some.
pub trait Speaker: Send {
    /// Returns what the device says at `now` to these bytes; each part with the time from which on it can be heard.
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)>;

    /// When the device next has something to say by itself, if it is not spoken to before.
    fn due(&self) -> Option<Duration> {
        None
    }

    /// Returns what the device says by itself at `now`.
    fn speak(&mut self, now: Duration) -> Vec<(Duration, Vec<u8>)> {
        let _ = now;
        Vec::new()
    }
}

/// A simulated stage: others may see where it stands, whatever its host asks.
pub trait Turns: Speaker {
    /// Where it stands at `now`, counts from where it stood when it was switched on. Nothing is changed.
    fn place_at(&self, now: Duration) -> i64;
}

/// A device at the other end of a line in memory: a transport for drivers. The line keeps its order: what is said late
/// holds back what is said after it.
#[derive(Debug, Clone)]
pub struct InMemory<D> {
    /// The device.
    pub device: D,
    said: VecDeque<(Duration, u8)>,
}

impl<D: Speaker> InMemory<D> {
    /// A line to the device.
    pub fn new(device: D) -> Self {
        Self { device, said: VecDeque::new() }
    }

    fn say(&mut self, parts: Vec<(Duration, Vec<u8>)>) {
        for (due, said) in parts {
            self.said.extend(said.into_iter().map(|byte| (due, byte)));
        }
    }

    fn speak(&mut self, now: Duration) {
        if self.device.due().is_some_and(|due| due <= now) {
            let parts = self.device.speak(now);
            self.say(parts);
        }
    }

    fn take(&mut self, most: usize, now: Duration) -> Vec<u8> {
        self.speak(now);
        let ready = self.said.iter().take(most).take_while(|(due, _)| *due <= now).count();
        self.said.drain(..ready).map(|(_, byte)| byte).collect()
    }
}

impl<D: Speaker> Bytes for InMemory<D> {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        deadline.remaining()?;
        let now = deadline.now();
        self.speak(now);
        let parts = self.device.hear(bytes, now);
        self.say(parts);
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        if buffer.is_empty() {
            return Ok(0);
        }
        loop {
            let ready = self.take(buffer.len(), deadline.now());
            if !ready.is_empty() {
                buffer[..ready.len()].copy_from_slice(&ready);
                return Ok(ready.len());
            }
            let next = self.said.front().map(|(due, _)| *due);
            let next = next.into_iter().chain(self.device.due()).min();
            let wait = next.map_or(Duration::MAX, |due| due.saturating_sub(deadline.now()));
            deadline.sleep(wait)?;
        }
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        Ok(self.take(usize::MAX, deadline.now()))
    }
}

/// Serves the device on the device's end of a real line (a pty, a socket) until the deadline passes, the token is set, or
/// the host hangs up, and gives the device back.
///
/// # Errors
/// The line failed.
pub fn serve<D: Speaker>(
    device: D,
    line: &mut impl Bytes,
    deadline: &Deadline,
) -> Result<D, TransportError> {
    let mut end = InMemory::new(device);
    bridge(&mut end, line, deadline, || {})?;
    Ok(end.device)
}

/// Carries bytes between a line to a device and the device's end of a real line, until the deadline passes, the token is set, or
/// one of both hangs up. `meanwhile` is called some hundred times a second.
///
/// # Errors
/// One of the lines failed.
pub fn bridge(
    device: &mut (impl Bytes + ?Sized),
    line: &mut (impl Bytes + ?Sized),
    deadline: &Deadline,
    mut meanwhile: impl FnMut(),
) -> Result<(), TransportError> {
    /// Time for which it listens to either side before it looks at the other.
    const LISTEN: Duration = Duration::from_millis(2);
    let mut buffer = [0; 65_536];
    loop {
        meanwhile();
        let turn =
            carry(line, device, &mut buffer, &deadline.at_most(LISTEN), deadline).and_then(|_| {
                loop {
                    // All that is due: a frame is many pieces.
                    let step = deadline.at_most(Duration::from_millis(1));
                    if !carry(device, line, &mut buffer, &step, deadline)? {
                        return deadline.remaining().map_err(TransportError::from);
                    }
                }
            });
        match turn {
            Ok(_) => {}
            Err(
                TransportError::Timeout { .. }
                | TransportError::Cancelled { .. }
                | TransportError::Disconnected { .. },
            ) => return Ok(()),
            Err(error) => return Err(error),
        }
    }
}

/// Hands on what `from` has said within the step; whether there was anything.
fn carry(
    from: &mut (impl Bytes + ?Sized),
    to: &mut (impl Bytes + ?Sized),
    buffer: &mut [u8],
    step: &Deadline,
    deadline: &Deadline,
) -> Result<bool, TransportError> {
    match from.receive(buffer, step) {
        Ok(count) => to.send(&buffer[..count], deadline).map(|()| true),
        Err(error) if error.is_timeout() => Ok(false),
        Err(error) => Err(error),
    }
}
