//! ZeroMQ around SCPI: whatever the other end says, opening and reading end without a panic, and a reading is one that stands in what it said.

use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Deadline, VirtualClock};
use sunglint_drivers::device::{Level, Meter as _};
use sunglint_drivers::scpi::{Definition, Link, ScpiMeter, Told};
use sunglint_drivers::transport::{Bytes, TransportError};

/// The other end, which says what it has to say and goes.
struct Canned(Vec<u8>);

impl Bytes for Canned {
    fn send(&mut self, _: &[u8], _: &Deadline) -> Result<(), TransportError> {
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], _: &Deadline) -> Result<usize, TransportError> {
        if self.0.is_empty() {
            return Err(TransportError::disconnected("the other end"));
        }
        let count = buffer.len().min(self.0.len());
        for (to, from) in buffer.iter_mut().zip(self.0.drain(..count)) {
            *to = from;
        }
        Ok(count)
    }

    fn discard(&mut self, _: &Deadline) -> Result<Vec<u8>, TransportError> {
        Ok(Vec::new())
    }
}

const FILE: &str = "kind = \"meter\"\nname = \"counter\"\nunit = \"1/s\"\n[identify]\nexpect = \"{rest}\"\n[errors]\nsend = \"\"\n[read]\nsend = \"C?\"\nfresh = \"trigger\"\n";

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let clock = Arc::new(VirtualClock::new());
    let deadline = Deadline::after(clock, Duration::from_secs(10));
    // The file of this target is a good one.
    let Ok(about) = Definition::parse("device.toml", FILE) else { panic!("{FILE}") };
    // Seeds are an exchange behind a good greeting; others begin with their own.
    let mut said = Vec::new();
    if bytes.first() != Some(&0xFF) {
        said.extend_from_slice(b"\xFF\0\0\0\0\0\0\0\0\x7F\x03\x00NULL");
        said.resize(64, 0);
    }
    said.extend_from_slice(bytes);
    let link = Link::zeromq(Canned(said), &about);
    let Ok(mut meter) = ScpiMeter::open(link, about, &Told::default(), &deadline) else { return };
    if let Ok(Level::Value(value)) = meter.read(&deadline) {
        assert!(value.is_finite());
    }
}
