//! The device's part of a recording, spoken through a real line: a pty, a socket.

use super::{Event, Fault, Recording, ReplayError, hex_excerpt};
use crate::clock::Deadline;
use crate::transport::{Bytes, TransportError};
use std::time::Duration;

/// Speaks the device's part on `line`, the device's end of it, and holds the host to its own. Returns after the last
/// event; a recorded disconnection is left to the caller, who closes the line.
///
/// # Errors
/// The host said something else ([`TransportError::Replay`]), the line failed, or the deadline passed.
pub fn play(
    recording: &Recording,
    line: &mut impl Bytes,
    deadline: &Deadline,
) -> Result<(), TransportError> {
    let mut pause = Duration::ZERO;
    for (number, event) in &recording.events {
        let error = |host: String, expected: String| {
            let path = recording.path.clone();
            ReplayError { path, line: *number, host, recording: expected }
        };
        match event {
            Event::Pause(time) => pause = pause.saturating_add(*time),
            Event::Sent(expected) => {
                let mut heard = vec![0; expected.len()];
                line.receive_exact(&mut heard, deadline)?;
                if heard != *expected {
                    let host = format!("sends `> {}`", hex_excerpt(&heard));
                    let recorded = format!("has `> {}`", hex_excerpt(expected));
                    return Err(error(host, recorded).into());
                }
                pause = Duration::ZERO;
            }
            Event::Received(bytes) => {
                deadline.sleep(pause)?;
                pause = Duration::ZERO;
                line.send(bytes, deadline)?;
            }
            // The host waits in vain by itself.
            Event::Fault(Fault::Timeout) => pause = Duration::ZERO,
            Event::Fault(Fault::Disconnect) => deadline.sleep(pause)?,
            Event::Fault(Fault::Stall) | Event::Asked(_) => {
                let host = "is on a stream of bytes".to_owned();
                return Err(error(host, format!("has `{event}`, for USB or HID")).into());
            }
        }
    }
    Ok(())
}
