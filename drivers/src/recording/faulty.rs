//! A transport that fails on purpose, the same way for the same seed.

use crate::clock::Deadline;
use crate::transport::{Bytes, Transfer, Transfers, TransportError};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::time::Duration;

/// How often what fails; probabilities from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Faults {
    /// A read or a request waits first, for up to [`longest_delay`](Self::longest_delay).
    pub delay: f64,
    /// The longest such wait.
    pub longest_delay: Duration,
    /// A byte is lost, for each byte in either direction.
    pub drop: f64,
    /// A bit of a byte is flipped, for each byte in either direction.
    pub flip: f64,
    /// A read gives fewer bytes than there are.
    pub short_read: f64,
    /// All that a read or a request would give is lost.
    pub silence: f64,
    /// The device goes away for good, for each call.
    pub disconnect: f64,
}

impl Faults {
    /// Nothing fails.
    pub const NONE: Self = Self {
        delay: 0.0,
        longest_delay: Duration::ZERO,
        drop: 0.0,
        flip: 0.0,
        short_read: 0.0,
        silence: 0.0,
        disconnect: 0.0,
    };
}

/// Faults injected into a transport so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Injected {
    /// Waits.
    pub delays: u64,
    /// Bytes lost one by one.
    pub drops: u64,
    /// Bits flipped.
    pub flips: u64,
    /// Reads cut short.
    pub short_reads: u64,
    /// Reads or answers lost whole.
    pub silences: u64,
    /// Whether the device has gone.
    pub disconnected: bool,
}

/// A transport with faults.
#[derive(Debug)]
pub struct Faulty<T> {
    inner: T,
    faults: Faults,
    random: Xoshiro256PlusPlus,
    injected: Injected,
}

impl<T> Faulty<T> {
    /// Spoils `inner`; the same seed and the same calls give the same faults.
    pub fn new(inner: T, faults: Faults, seed: u64) -> Self {
        let random = Xoshiro256PlusPlus::seed_from_u64(seed);
        Self { inner, faults, random, injected: Injected::default() }
    }

    /// Returns the faults injected so far.
    pub fn injected(&self) -> Injected {
        self.injected
    }

    /// The transport within.
    pub fn inner(&self) -> &T {
        &self.inner
    }

    /// The transport within.
    pub fn into_inner(self) -> T {
        self.inner
    }

    fn happens(&mut self, probability: f64) -> bool {
        // Always one number, so that one fault switched off does not move the others.
        self.random.random::<f64>() < probability
    }

    fn start_call(&mut self) -> Result<(), TransportError> {
        if self.happens(self.faults.disconnect) {
            self.injected.disconnected = true;
        }
        if self.injected.disconnected {
            return Err(TransportError::disconnected("the faulty device"));
        }
        Ok(())
    }

    fn delay(&mut self, deadline: &Deadline) -> Result<(), TransportError> {
        let part = self.random.random::<f64>();
        if self.happens(self.faults.delay) {
            self.injected.delays += 1;
            deadline.sleep(self.faults.longest_delay.mul_f64(part))?;
        }
        Ok(())
    }

    fn spoil(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut spoilt = Vec::with_capacity(bytes.len());
        for byte in bytes {
            if self.happens(self.faults.drop) {
                self.injected.drops += 1;
                continue;
            }
            let mut byte = *byte;
            if self.happens(self.faults.flip) {
                self.injected.flips += 1;
                byte ^= 1 << self.random.random_range(0..8_u32);
            }
            spoilt.push(byte);
        }
        spoilt
    }
}

impl<T: Bytes> Bytes for Faulty<T> {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        self.start_call()?;
        let spoilt = self.spoil(bytes);
        if spoilt.is_empty() { Ok(()) } else { self.inner.send(&spoilt, deadline) }
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        if buffer.is_empty() {
            return Ok(0);
        }
        loop {
            self.start_call()?;
            self.delay(deadline)?;
            let mut room = buffer.len();
            if room > 1 && self.happens(self.faults.short_read) {
                self.injected.short_reads += 1;
                room = self.random.random_range(1..room);
            }
            let count = self.inner.receive(&mut buffer[..room], deadline)?;
            if self.happens(self.faults.silence) {
                self.injected.silences += 1;
                continue;
            }
            let spoilt = self.spoil(&buffer[..count]);
            if !spoilt.is_empty() {
                buffer[..spoilt.len()].copy_from_slice(&spoilt);
                return Ok(spoilt.len());
            }
        }
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        self.start_call()?;
        self.inner.discard(deadline)
    }

    /// A line that is cut stays cut.
    fn reconnect(&mut self, deadline: &Deadline) -> Result<(), TransportError> {
        self.start_call()?;
        self.inner.reconnect(deadline)
    }
}

impl<T: Transfers> Transfers for Faulty<T> {
    fn transfer(
        &mut self,
        transfer: &Transfer,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, TransportError> {
        self.start_call()?;
        self.delay(deadline)?;
        // Requests of USB and HID carry a checksum of their own: they are lost or repeated by the hardware, but not
        // altered. Answers may be (a firmware's mistake), and may be short.
        let mut answer = self.inner.transfer(transfer, deadline)?;
        if self.happens(self.faults.silence) {
            self.injected.silences += 1;
            loop {
                deadline.sleep(Duration::from_secs(1))?;
            }
        }
        if transfer.room().is_some() {
            answer = self.spoil(&answer);
            if answer.len() > 1 && self.happens(self.faults.short_read) {
                self.injected.short_reads += 1;
                let short = self.random.random_range(1..answer.len());
                answer.truncate(short);
            }
        }
        Ok(answer)
    }
}
