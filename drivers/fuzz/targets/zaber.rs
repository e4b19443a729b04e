//! Lines of Zaber devices: no panic; a simulated device hears anything, and what it says is understood.

use std::time::Duration;
use sunglint_drivers::simulated::Speaker as _;
use sunglint_drivers::simulated::zaber::{Zaber, ZaberSettings};
use sunglint_drivers::zaber::message::{Line, parse, warnings};

/// Tries one input.
pub fn run(bytes: &[u8]) {
    for line in bytes.split_inclusive(|byte| *byte == b'\n') {
        if let Ok((Line::Reply(reply), _)) = parse(line) {
            let _ = warnings(&reply.data);
            assert!(reply.device < 100 && reply.axis < 10);
        }
    }
    let mut device = Zaber::new(ZaberSettings::default());
    for (i, piece) in bytes.chunks(7).enumerate() {
        for (_, said) in device.hear(piece, Duration::from_millis(i as u64 * 10)) {
            assert!(parse(&said).is_ok_and(|(_, checked)| checked), "{}", said.escape_ascii());
        }
    }
}
