//! Watchdog: stops a mount over a connection of its own when the tracker's heartbeat is missing.
//!
//! It is meant to run in a process of its own, so that it outlives the tracker. What it cannot do: reach a mount whose cable is cut. Then the last rates go on.

use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{DeviceError, Mount};

/// Age of a heartbeat at which the mount is stopped.
pub const HEARTBEAT_WITHIN: Duration = Duration::from_millis(500);

/// Message of a tracker to its watchdog.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Beat {
    /// It lives, and follows.
    Alive,
    /// It has stopped the mount: nothing is to be watched any more.
    Done,
    /// A person says stop: the mount is stopped, whatever the tracker does.
    Stop,
}

/// How a watch ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Watched {
    /// The tracker said that it is done.
    Done,
    /// The heartbeat was missing; the mount was told to stop.
    Silent,
    /// A person said stop; the mount was told to stop, and again until the tracker had ended.
    Stopped,
}

/// Watches until the tracker is done, or stops the mount.
///
/// # Errors
/// The mount could not be told to stop, three times.
pub fn watch(mount: &mut dyn Mount, beats: &Receiver<Beat>) -> Result<Watched, DeviceError> {
    let mut stopped_by_person = false;
    loop {
        match beats.recv_timeout(HEARTBEAT_WITHIN) {
            Ok(Beat::Done) => {
                return Ok(if stopped_by_person { Watched::Stopped } else { Watched::Done });
            }
            Ok(Beat::Alive) if stopped_by_person => stop(mount)?,
            Ok(Beat::Alive) => {}
            Ok(Beat::Stop) => {
                // A latch: what the tracker commands afterwards is stopped again.
                stopped_by_person = true;
                stop(mount)?;
            }
            Err(RecvTimeoutError::Timeout) | Err(RecvTimeoutError::Disconnected) => {
                stop(mount)?;
                return Ok(if stopped_by_person { Watched::Stopped } else { Watched::Silent });
            }
        }
    }
}

/// Stops it; a call that fails is tried again at once.
fn stop(mount: &mut dyn Mount) -> Result<(), DeviceError> {
    let begun = Instant::now();
    let mut tries = 0;
    loop {
        match mount.stop(&Deadline::within(Duration::from_millis(800))) {
            Ok(()) => return Ok(()),
            Err(error) if tries == 2 || begun.elapsed() > Duration::from_secs(3) => {
                return Err(error);
            }
            Err(_) => tries += 1,
        }
    }
}
