//! Ways to an instrument: a stream of bytes, a GPIB adapter, USBTMC.

use super::reply::Framer;
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::transport::{Bytes, Transfers, TransportError};
use crate::twice::Trouble;
use crate::usbtmc::Tmc;
use std::time::Duration;

/// A way to an instrument, without recovery.
pub(super) trait Way: Send {
    /// Sends a line.
    fn say(&mut self, line: &str, step: &Deadline) -> Result<(), Trouble>;
    /// Waits for an answer and gives its bytes.
    fn hear(&mut self, step: &Deadline) -> Result<Vec<u8>, Trouble>;
    /// Makes it as new as it can be made: what was asked before is answered no more, or is thrown away.
    fn renew(&mut self, step: &Deadline) -> Result<(), Trouble>;
}

fn answer(line: &mut impl Bytes, end: u8, step: &Deadline) -> Result<Vec<u8>, Trouble> {
    let mut framer = Framer::new(end);
    let mut byte = [0];
    loop {
        // Byte by byte, so that nothing behind its end is taken from the stream.
        if let Err(error) = line.receive(&mut byte, step) {
            return Err(error.with_got_so_far(framer.bytes()).into());
        }
        match framer.push(byte[0]) {
            Ok(false) => {}
            Ok(true) => return Ok(framer.into_bytes()),
            Err(_) => {
                let got_so_far = framer.into_bytes();
                let most = super::reply::LONGEST_REPLY;
                return Err(TransportError::TooLong { most, got_so_far }.into());
            }
        }
    }
}

/// Opens the connection anew where the line can, as raw TCP knows no other way to get rid of an answer that is under way; else drops what is there.
fn renew(line: &mut impl Bytes, used: bool, step: &Deadline) -> Result<bool, Trouble> {
    if used {
        match line.reconnect(step) {
            Ok(()) => return Ok(true),
            Err(TransportError::Unsupported { .. }) => {}
            Err(error) => return Err(error.into()),
        }
    }
    line.discard(step)?;
    Ok(false)
}

/// A stream of bytes, lines both ways.
pub(super) struct Raw<T> {
    line: T,
    end: &'static str,
    reply_end: u8,
    used: bool,
}

impl<T: Bytes> Raw<T> {
    pub fn new(line: T, end: &'static str, reply_end: u8) -> Self {
        Self { line, end, reply_end, used: false }
    }
}

impl<T: Bytes> Way for Raw<T> {
    fn say(&mut self, line: &str, step: &Deadline) -> Result<(), Trouble> {
        self.used = true;
        Ok(self.line.send(format!("{line}{}", self.end).as_bytes(), step)?)
    }

    fn hear(&mut self, step: &Deadline) -> Result<Vec<u8>, Trouble> {
        answer(&mut self.line, self.reply_end, step)
    }

    fn renew(&mut self, step: &Deadline) -> Result<(), Trouble> {
        renew(&mut self.line, self.used, step).map(|_| ())
    }
}

/// Longest time for which a Prologix adapter waits for the next byte, ms; its most is 3000.
const READ_TIMEOUT_MS: u64 = 1000;

/// An instrument on GPIB behind a Prologix adapter, which takes lines with `++` for itself (Prologix GPIB-USB and GPIB-ETHERNET manuals, chapter 8).
pub(super) struct Gpib<T> {
    device: &'static str,
    line: T,
    address: u8,
    used: bool,
    set_up: bool,
}

impl<T: Bytes> Gpib<T> {
    pub fn new(device: &'static str, line: T, address: u8) -> Self {
        Self { device, line, address, used: false, set_up: false }
    }

    fn set_up(&mut self, step: &Deadline) -> Result<(), Trouble> {
        /// More lines than an adapter can have left over.
        const MOST: usize = 64;
        // Nothing is saved, as the adapter's memory wears out; a controller that does not address the device to talk unless it is told to
        // (`++auto 1` makes some devices complain, -420); EOI with the last byte to the device, and a line feed of the adapter's own before it.
        let lines = format!(
            "++savecfg 0\n++mode 1\n++auto 0\n++eoi 1\n++eos 2\n++eot_enable 0\n++read_tmo_ms {READ_TIMEOUT_MS}\n++addr {}\n++addr\n",
            self.address
        );
        self.line.send(lines.as_bytes(), step)?;
        let expected = self.address.to_string();
        let mut last = String::new();
        for _ in 0..MOST {
            let said = match answer(&mut self.line, b'\n', step) {
                Ok(said) => said,
                Err(Trouble::Transport(error)) if error.is_timeout() && !last.is_empty() => break,
                Err(error) => return Err(error),
            };
            last = String::from_utf8_lossy(&said).trim().to_owned();
            if last == expected {
                self.set_up = true;
                return Ok(());
            }
        }
        let found = crate::reply::ReplyError::new(&last, "").found;
        let reason = format!(
            "the adapter's answer to ++addr: found `{found}`, expected {expected}; is it a Prologix adapter?"
        );
        Err(Trouble::Again(DeviceError::Protocol { device: self.device, reason }))
    }
}

/// A line as the adapter takes it: bytes that mean something to it come with an escape.
pub(super) fn escaped(line: &str) -> Vec<u8> {
    const ESCAPE: u8 = 0x1b;
    let mut bytes = Vec::with_capacity(line.len() + 1);
    for byte in line.bytes() {
        if matches!(byte, b'\r' | b'\n' | b'+' | ESCAPE) {
            bytes.push(ESCAPE);
        }
        bytes.push(byte);
    }
    bytes.push(b'\n');
    bytes
}

impl<T: Bytes> Way for Gpib<T> {
    fn say(&mut self, line: &str, step: &Deadline) -> Result<(), Trouble> {
        if !self.set_up {
            self.set_up(step)?;
        }
        self.used = true;
        Ok(self.line.send(&escaped(line), step)?)
    }

    fn hear(&mut self, step: &Deadline) -> Result<Vec<u8>, Trouble> {
        // A little later than the adapter gives up.
        const PATIENCE: Duration = Duration::from_millis(READ_TIMEOUT_MS + 200);
        loop {
            self.line.send(b"++read eoi\n", step)?;
            match answer(&mut self.line, b'\n', &step.at_most(PATIENCE)) {
                // The adapter gave up before the device had something to say. Half an answer is an error.
                Err(Trouble::Transport(TransportError::Timeout { got_so_far, .. }))
                    if got_so_far.is_empty() && step.remaining().is_ok() => {}
                other => return other,
            }
        }
    }

    fn renew(&mut self, step: &Deadline) -> Result<(), Trouble> {
        renew(&mut self.line, self.used, step)?;
        self.set_up = false;
        self.set_up(step)?;
        if self.used {
            // The device's own buffers: GPIB has a device clear.
            self.line.send(b"++clr\n", step)?;
        }
        Ok(())
    }
}

impl<T: Transfers> Way for Tmc<T> {
    fn say(&mut self, line: &str, step: &Deadline) -> Result<(), Trouble> {
        self.send(line, step)
    }

    fn hear(&mut self, step: &Deadline) -> Result<Vec<u8>, Trouble> {
        self.fetch("a question", step)
    }

    fn renew(&mut self, step: &Deadline) -> Result<(), Trouble> {
        self.clear(step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the manual's rule: CR, LF, ESC and `+` in data have an ESC before them.
    #[test]
    fn data_for_the_adapter_is_escaped() {
        assert_eq!(escaped("VOLT +1"), b"VOLT \x1b+1\n");
        assert_eq!(escaped("++addr 3"), b"\x1b+\x1b+addr 3\n");
    }
}
