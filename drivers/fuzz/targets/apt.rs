//! APT messages: no panic; what is read is byte for byte what was there; a simulated stage hears anything.

use std::time::Duration;
use sunglint_drivers::simulated::Speaker as _;
use sunglint_drivers::simulated::apt::{Apt, AptSettings};
use sunglint_drivers::thorlabs::apt::message::{HOST, State, parse};

/// Tries one input.
pub fn run(bytes: &[u8]) {
    for whom in [HOST, 0x50] {
        let mut rest = bytes;
        while !rest.is_empty() {
            match parse(rest, whom) {
                Ok(Some((message, taken))) => {
                    assert_eq!(message.emit(), rest[..taken]);
                    let _ = (State::of(&message), message.to_string(), message.channel());
                    rest = &rest[taken..];
                }
                Ok(None) => break,
                Err(_) => rest = &rest[1..],
            }
        }
    }
    let mut apt = Apt::new(AptSettings::default());
    for (i, piece) in bytes.chunks(7).enumerate() {
        let _ = apt.hear(piece, Duration::from_millis(i as u64 * 10));
    }
}
