//! Parking: the mount's own motion to a place that only it knows.

use super::safety::Guard;
use hifitime::Unit;
use std::ops::ControlFlow;
use std::time::Duration;
use sunglint_drivers::clock::{Deadline, DeviceClock};
use sunglint_drivers::device::{DeviceError, Mount, MountMotion};

/// Longest time that parking may take.
const PARKS: Duration = Duration::from_secs(180);
/// Time for an answer.
const SOON: Duration = Duration::from_secs(5);

/// How parking went.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parked {
    /// It is parked.
    Parked,
    /// It stands where it is: the Sun is up, and the way to its park is not known.
    SunIsUp,
    /// It was not parked in time, and was stopped.
    TooSlow,
    /// Somebody wanted it to stand meanwhile: it was stopped.
    Stopped,
}

impl Parked {
    /// Says it in words.
    pub fn text(self) -> &'static str {
        match self {
            Self::Parked => "the mount is parked",
            Self::SunIsUp => {
                "the mount stands and is not parked: the Sun is up, and the way to its park is not known; park it by hand"
            }
            Self::TooSlow => "the mount was not parked within 180 s: it was stopped",
            Self::Stopped => "the mount was stopped on its way to its park",
        }
    }
}

/// Longest time that the command to park may take: some drivers answer late, and are asked again.
pub const PARK_WITHIN: Duration = Duration::from_secs(15);

/// Parks a mount that stands. While the Sun is up, or will be in three minutes, it stays where it is. `tick` is called while it waits; where it breaks, the
/// mount is stopped. Before the first call, the command takes up to [`PARK_WITHIN`].
///
/// # Errors
/// See [`DeviceError`]: it is then not known whether it is parked.
pub fn park(
    mount: &mut dyn Mount,
    guard: &Guard,
    clock: &DeviceClock,
    tick: &mut dyn FnMut() -> ControlFlow<()>,
) -> Result<Parked, DeviceError> {
    let now = clock.utc();
    let later = now + 3.0 * Unit::Minute;
    if guard.cone_holds(&guard.sun(now)) || guard.cone_holds(&guard.sun(later)) {
        return Ok(Parked::SunIsUp);
    }
    // Not cancelled by Ctrl-C: parking is what happens after it.
    let within = |time| Deadline::after(clock.clock.clone(), time);
    mount.set_parked(true, &within(SOON))?;
    let whole = within(PARKS);
    loop {
        if tick().is_break() {
            mount.stop(&within(SOON))?;
            return Ok(Parked::Stopped);
        }
        if mount.reading(&within(SOON))?.motion == MountMotion::Parked {
            return Ok(Parked::Parked);
        }
        if whole.sleep(Duration::from_millis(200)).is_err() {
            mount.stop(&within(SOON))?;
            return Ok(Parked::TooSlow);
        }
    }
}
