//! Bytes of Standa controllers: no panic; a simulated one hears anything, and its status is understood.

use std::time::Duration;
use sunglint_drivers::simulated::Speaker as _;
use sunglint_drivers::simulated::standa::{Standa, StandaSettings};
use sunglint_drivers::standa::message::{Engine, STATUS, Status, checked, message};

/// Tries one input.
pub fn run(bytes: &[u8]) {
    if let Ok(data) = checked(bytes)
        && !data.is_empty()
    {
        assert_eq!(&message(*b"gets", data)[4..], bytes);
    }
    if let Some((data, rest)) = bytes.split_at_checked(STATUS) {
        let status = Status::parse(data);
        let engine = Engine::parse(rest, bytes);
        if let (Ok(status), Ok(engine)) = (status, engine) {
            let _ = status.fault();
            let _ = engine.counter(status.steps, status.microsteps);
        }
    }
    let mut device = Standa::new(StandaSettings::default());
    let mut now = Duration::ZERO;
    for piece in bytes.chunks(7) {
        now += Duration::from_millis(10);
        let _ = device.hear(piece, now);
    }
    // After a pause it has forgotten all that was unfinished.
    let said = device.hear(b"gets", now + Duration::from_secs(1));
    let (_, reply) = said.last().expect("an answer");
    assert!(
        reply.starts_with(b"gets")
            && checked(&reply[4..]).is_ok_and(|data| Status::parse(data).is_ok())
    );
}
