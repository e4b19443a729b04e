//! Lines of Elliptec modules: no panic; a position reads back as it is written; a simulated mount hears anything.

use std::time::Duration;
use sunglint_drivers::simulated::Speaker as _;
use sunglint_drivers::simulated::elliptec::{Elliptec, ElliptecSettings};
use sunglint_drivers::thorlabs::elliptec::reply::{Reply, parse};

/// Tries one input.
pub fn run(bytes: &[u8]) {
    for line in bytes.split_inclusive(|byte| *byte == b'\n') {
        if let Ok((address, Reply::Position(counter))) = parse(line) {
            assert_eq!(format!("{address:X}PO{counter:08X}\r\n").as_bytes(), line);
        }
    }
    let mut mount = Elliptec::new(ElliptecSettings::default());
    for (i, piece) in bytes.chunks(7).enumerate() {
        for (_, said) in mount.hear(piece, Duration::from_millis(i as u64 * 700)) {
            assert!(parse(&said).is_ok(), "{}", said.escape_ascii());
        }
    }
}
