//! Lines of Newport's controllers: no panic; simulated controllers hear anything.

use std::time::Duration;
use sunglint_drivers::newport::{esp, smc100};
use sunglint_drivers::simulated::Speaker as _;
use sunglint_drivers::simulated::esp301::{Esp301, Esp301Settings};
use sunglint_drivers::simulated::smc100::{Smc100, Smc100Settings};

/// Tries one input.
pub fn run(bytes: &[u8]) {
    for line in String::from_utf8_lossy(bytes).lines() {
        if let Ok(error) = esp::kept_error(line) {
            assert!(error.code >= 0 && !error.message.is_empty());
        }
        let _ = smc100::status(line.get(3..).unwrap_or(line));
    }
    let mut controller = Esp301::new(Esp301Settings::default());
    let mut other = Smc100::new(Smc100Settings::default());
    for (i, piece) in bytes.chunks(7).enumerate() {
        let now = Duration::from_millis(i as u64 * 10);
        for (_, said) in controller.hear(piece, now).into_iter().chain(other.hear(piece, now)) {
            assert!(said.ends_with(b"\r\n"), "{}", said.escape_ascii());
        }
    }
}
