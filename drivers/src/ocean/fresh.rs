//! Spectra that are of the time of integration that was asked for, and began after they were asked for.

use super::DEVICE;
use crate::clock::{Deadline, utc_now};
use crate::device::{DeviceError, not_taken};
use hifitime::Epoch;
use std::time::Duration;

/// Commands and questions that an instrument takes, whatever its protocol.
pub(super) trait Instrument {
    /// The time of integration as the instrument tells it, µs; `None` where it does not.
    fn told_us(&mut self, deadline: &Deadline) -> Result<Option<u32>, DeviceError>;

    /// Sets it.
    fn set_us(&mut self, us: u32, deadline: &Deadline) -> Result<(), DeviceError>;

    /// One spectrum as it comes, which may take `work` beside the answer.
    fn raw(&mut self, work: Duration, deadline: &Deadline) -> Result<Vec<f64>, DeviceError>;
}

/// Knowledge of the time of integration within the instrument.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Integration {
    /// Nothing: it may be anything, and so may that of a spectrum under way.
    Unknown,
    /// It is set, µs; so many spectra may still be older, and one of them may last so long.
    Set { us: u32, stale: u32, longest: Duration },
}

impl Integration {
    /// Sets the time of integration where it is not so already. After it, `stale` spectra may be of another, which lasts `longest` where the instrument does not tell
    /// it.
    fn set(
        &mut self,
        instrument: &mut impl Instrument,
        us: u32,
        stale: u32,
        longest: Duration,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        let told = instrument.told_us(deadline)?;
        if let Self::Set { us: set, .. } = *self
            && set == us
            && told.is_none_or(|told| told == us)
        {
            return Ok(());
        }
        // Whatever interrupts this leaves it unknown.
        *self = Self::Unknown;
        instrument.set_us(us, deadline)?;
        match instrument.told_us(deadline)? {
            Some(got) if got != us => {
                Err(not_taken(DEVICE, "integration_us", &us.to_string(), &got.to_string()))
            }
            _ => {
                let told = told.map(|us| Duration::from_micros(u64::from(us)));
                *self = Self::Set { us, stale, longest: told.unwrap_or(longest) };
                Ok(())
            }
        }
    }

    /// Takes a spectrum of `us` that began after this call, and gives when that was, as far as the question tells. The first that comes is thrown away, and with it what is
    /// older. One that was under way may last `longest`.
    pub fn expose(
        &mut self,
        instrument: &mut impl Instrument,
        us: u32,
        stale: u32,
        longest: Duration,
        deadline: &Deadline,
    ) -> Result<(Epoch, Vec<f64>), DeviceError> {
        /// So many come sooner than they can: they are copies of an older one.
        const MOST: u32 = 4;
        let lasts = Duration::from_micros(u64::from(us));
        self.set(instrument, us, stale, longest, deadline)?;
        let begun = deadline.now();
        // An instrument that integrates all the time answers with the integration that is under way. The next one began after that, so after the call.
        let (mut came, mut fast, mut lost) = (false, 0, 0);
        loop {
            let asked = utc_now();
            // The rest of one that was under way, and this one.
            let old = match *self {
                Self::Set { stale: 1.., longest, .. } => longest,
                _ => lasts,
            };
            let work = lasts.saturating_mul(2).saturating_add(old);
            let counts = match instrument.raw(work, deadline) {
                // A spectrum that got lost is taken anew; twice it is no accident.
                Err(error) if lost == 0 && may_pass(&error) && deadline.remaining().is_ok() => {
                    lost += 1;
                    continue;
                }
                other => other?,
            };
            let is_first = !std::mem::replace(&mut came, true);
            if let Self::Set { stale: stale @ 1.., .. } = self {
                *stale -= 1;
                continue;
            }
            if is_first {
                continue;
            }
            let passed = deadline.now().saturating_sub(begun);
            if passed >= lasts {
                return Ok((asked, counts));
            }
            fast += 1;
            if fast == MOST {
                let reason = format!(
                    "{MOST} spectra came within {:.6} s, one lasts {:.6} s: they are copies, or another program sets the integration",
                    passed.as_secs_f64(),
                    lasts.as_secs_f64()
                );
                return Err(DeviceError::Protocol { device: DEVICE, reason });
            }
        }
    }
}

/// Whether asking once more may help: the answer was late, lost or spoilt.
fn may_pass(error: &DeviceError) -> bool {
    match error {
        DeviceError::Protocol { .. } => true,
        DeviceError::Transport { source, .. } => source.is_timeout(),
        _ => false,
    }
}
