//! USBTMC messages and SCPI answers: no panic; what is read keeps its promises.

use sunglint_drivers::thorlabs::scpi::{Complaint, Instrument, Reading, Sensor, flag};
use sunglint_drivers::usbtmc::{HEADER, MessageIn};

/// Tries one input.
pub fn run(bytes: &[u8]) {
    if let Ok(message) = MessageIn::parse(bytes, bytes.get(1).copied().unwrap_or(1)) {
        let carried = HEADER + message.payload.len();
        assert!((carried..=carried + 3).contains(&bytes.len()));
    }
    let text = String::from_utf8_lossy(bytes);
    if let Ok(Reading::Value(value)) = Reading::parse(&text) {
        assert!(value.abs() <= 1e30);
    }
    let _ = (Complaint::parse(&text), Instrument::parse(&text), Sensor::parse(&text), flag(&text));
}
