//! One reading of a device, tried again where its line fails once.

use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock};
use sunglint_drivers::device::{
    DeviceError, FilterWheel, Level, Meter, Monochromator, PhotonCounter, Power, PowerMeter,
};
use sunglint_formats::CountFlags;
use sunglint_materials::log::RecordError;
use sunglint_materials::retro::measure::HandsError;

/// Reads that may fail one after the other, and the wait between them.
const TRIES: u32 = 3;
const TRY_AGAIN: Duration = Duration::from_secs(1);
/// Exposures with lost counts, one after the other, beyond which a run ends.
const LOST: u32 = 5;
/// How long stopping a counter may take.
const STOP: Duration = Duration::from_secs(5);

/// Why a run cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// Somebody stopped it.
    #[error("stopped at {at}")]
    Stopped {
        /// Where the run was.
        at: String,
    },
    /// A device.
    #[error("at {at}, the {device}: {error}")]
    Device {
        /// Where the run was.
        at: String,
        /// Which device.
        device: &'static str,
        /// Error that it reported, the last time.
        error: Box<DeviceError>,
    },
    /// A device that does not do what it is told.
    #[error(
        "at {at}, the {device} stands at {stands}, not at {asked}: look at the device and its cable"
    )]
    NotThere {
        /// Where the run was.
        at: String,
        /// Which device.
        device: &'static str,
        /// Where it stands.
        stands: f64,
        /// Where it was sent.
        asked: f64,
    },
    /// Counts that were lost again and again.
    #[error(
        "at {at}, the counter lost counts in {LOST} exposures one after the other ({flags}): less light, or a counter that keeps up"
    )]
    Lost {
        /// Where the run was.
        at: String,
        /// Flags of the last exposure.
        flags: String,
    },
    /// A channel that the counter does not have.
    #[error("sensor.channel = {channel}: the counter has channels from 0 to {last}")]
    Channel {
        /// Number in the plan.
        channel: usize,
        /// Last channel of the counter.
        last: usize,
    },
    /// Readings that cannot be kept.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// Nobody opens or closes the shutter.
    #[error(transparent)]
    Hands(#[from] HandsError),
}

/// Whoever is told what a reading met on its way.
pub type Notes<'a> = dyn FnMut(&str) -> Result<(), RecordError> + 'a;

/// Clock of the devices, and what stops them.
#[derive(Debug, Clone)]
pub struct Pace {
    /// The clock of all.
    pub clock: DeviceClock,
    /// Stops them.
    pub cancel: Cancel,
}

impl Pace {
    /// A deadline in so many seconds.
    #[must_use]
    pub fn within(&self, s: f64) -> Deadline {
        let time = Duration::from_secs_f64(s.clamp(0.0, 1e9));
        Deadline::after(self.clock.clock.clone(), time).with_cancel(&self.cancel)
    }

    /// Seconds on the clock.
    #[must_use]
    pub fn now_s(&self) -> f64 {
        self.clock.clock.now().as_secs_f64()
    }

    /// Waits.
    ///
    /// # Errors
    /// Somebody stopped the run.
    pub fn wait(&self, s: f64, at: &str) -> Result<(), RunError> {
        let waited = self.within(s + 1.0).sleep(Duration::from_secs_f64(s.clamp(0.0, 1e9)));
        waited.map_err(|_| RunError::Stopped { at: at.to_owned() })
    }

    /// Asks a device; one that fails is asked again a little later.
    ///
    /// # Errors
    /// It failed each time, or somebody stopped the run.
    pub fn ask<T>(
        &self,
        (device, timeout_s): (&'static str, f64),
        at: &str,
        notes: &mut Notes,
        mut what: impl FnMut(&Deadline) -> Result<T, DeviceError>,
    ) -> Result<T, RunError> {
        let mut attempt = 1;
        loop {
            match what(&self.within(timeout_s)) {
                Ok(found) => return Ok(found),
                Err(DeviceError::Cancelled { .. }) => {
                    return Err(RunError::Stopped { at: at.to_owned() });
                }
                // What it cannot do it will not do a second later.
                Err(error) if attempt >= TRIES || is_final(&error) => {
                    let (at, error) = (at.to_owned(), Box::new(error));
                    return Err(RunError::Device { at, device, error });
                }
                Err(error) => {
                    notes(&format!("at {at}, the {device}, try {attempt} of {TRIES}: {error}"))?;
                    self.wait(TRY_AGAIN.as_secs_f64(), at)?;
                }
            }
            attempt += 1;
        }
    }

    /// Sends the monochromator to a wavelength and gives where it then stands, nm.
    ///
    /// # Errors
    /// It does not get there within the tolerance.
    pub fn go_to(
        &self,
        monochromator: &mut dyn Monochromator,
        nm: f64,
        (tolerance_nm, timeout_s): (f64, f64),
        at: &str,
        notes: &mut Notes,
    ) -> Result<f64, RunError> {
        let device = "monochromator";
        let stands = self.ask((device, timeout_s), at, notes, |deadline| {
            monochromator.move_to(nm, deadline).map_err(|interrupted| *interrupted.error)
        })?;
        let is_there = (stands - nm).abs() <= tolerance_nm;
        if !is_there {
            return Err(RunError::NotThere { at: at.to_owned(), device, stands, asked: nm });
        }
        Ok(stands)
    }

    /// Turns a slot of the wheel into the beam.
    ///
    /// # Errors
    /// It does not get there.
    pub fn select(
        &self,
        wheel: &mut dyn FilterWheel,
        slot: u32,
        timeout_s: f64,
        at: &str,
        notes: &mut Notes,
    ) -> Result<(), RunError> {
        let device = "filter wheel";
        let stands = self.ask((device, timeout_s), at, notes, |deadline| {
            wheel.select(slot, deadline).map_err(|interrupted| *interrupted.error)
        })?;
        if stands != slot {
            let (stands, asked) = (f64::from(stands), f64::from(slot));
            return Err(RunError::NotThere { at: at.to_owned(), device, stands, asked });
        }
        Ok(())
    }

    /// Counts of a channel in one exposure, which began after this call. An exposure in which the counter lost counts is taken anew.
    ///
    /// # Errors
    /// The counter fails, or loses counts again and again.
    pub fn count(
        &self,
        counter: &mut dyn PhotonCounter,
        channel: usize,
        exposure_s: f64,
        timeout_s: f64,
        at: &str,
        notes: &mut Notes,
    ) -> Result<u64, RunError> {
        let channels = counter.channels().len();
        if channel >= channels {
            return Err(RunError::Channel { channel, last: channels.saturating_sub(1) });
        }
        let bin_ps = (exposure_s * 1e12).round() as i64;
        let mut flags = CountFlags::empty();
        for lost in 0..LOST {
            let limits = ("counter", exposure_s + timeout_s);
            let record = self.ask(limits, at, notes, |deadline| {
                counter.start(bin_ps, deadline)?;
                let read = counter.read(1, deadline);
                // Whatever came of it, the next exposure starts anew.
                let grace = Deadline::after(self.clock.clock.clone(), STOP);
                let stopped = counter.stop(&grace);
                let mut records = read.map_err(|interrupted| *interrupted.error)?;
                stopped?;
                records.pop().ok_or(DeviceError::NotReady {
                    device: "photon counter",
                    reason: "it gave no bin: its driver has a fault",
                })
            })?;
            flags = record.flags - CountFlags::CLOCK_FREE;
            let missed = record.missed.get(channel).copied().unwrap_or(0);
            let counted = record.counts.get(channel).copied();
            let whole = flags - CountFlags::SATURATED == CountFlags::empty()
                && record.length_ps == bin_ps
                && missed == 0;
            if let (true, Some(counts)) = (whole, counted) {
                return Ok(counts);
            }
            let names: Vec<&str> = flags.iter_names().map(|(name, _)| name).collect();
            notes(&format!(
                "at {at}, exposure {} of {LOST} is taken anew: the counter lost counts ({}, {missed} missed, {} of {bin_ps} ps)",
                lost + 1,
                names.join(", "),
                record.length_ps
            ))?;
        }
        let names: Vec<&str> = flags.iter_names().map(|(name, _)| name).collect();
        Err(RunError::Lost { at: at.to_owned(), flags: names.join(", ") })
    }
}

/// Errors that asking again cannot mend.
fn is_final(error: &DeviceError) -> bool {
    matches!(error, DeviceError::OutOfRange { .. } | DeviceError::Unknown { .. })
}

/// A photodiode's meter.
pub enum Photodiode<'a> {
    /// A meter of current or voltage.
    Meter(&'a mut dyn Meter),
    /// A power meter, whose reading is corrected for a wavelength that it is told.
    Power(&'a mut dyn PowerMeter),
}

impl Photodiode<'_> {
    /// Takes a reading in the meter's unit; none where it is over the range.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn read(&mut self, deadline: &Deadline) -> Result<Option<f64>, DeviceError> {
        let found = match self {
            Self::Meter(meter) => match meter.read(deadline)? {
                Level::Value(value) => Some(value),
                _ => None,
            },
            Self::Power(meter) => match meter.power(deadline)? {
                Power::Watts(value) => Some(value),
                _ => None,
            },
        };
        Ok(found.filter(|value| value.is_finite()))
    }
}
