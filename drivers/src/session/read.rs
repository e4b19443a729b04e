//! Readings of a device: power, an angle, a slot, frames, counts.

use super::{OpenDevice, Session, SessionError, utc_now};
use crate::catalogue::{Address, AnyDevice};
use crate::device::{Identity, Level, MountPlace, Power, Spectrum};
use hifitime::Epoch;
use std::time::Duration;
use sunglint_formats::{CountRecord, Frame};
use sunglint_numerics::progress::Progress;

/// How much longer than its exposure a frame may take, and than its bin a count.
const FRAME: Duration = Duration::from_secs(30);

/// Options of a run of readings.
#[derive(Debug, Clone)]
pub struct ReadOptions {
    /// Number of readings.
    pub count: u32,
    /// Time from the beginning of one reading to that of the next.
    pub every: Duration,
    /// Exposure of a camera's frames, length of a photon counter's bins, or integration of a spectrometer, seconds; at most a day.
    pub exposure_s: f64,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self { count: 1, every: Duration::ZERO, exposure_s: 0.1 }
    }
}

/// A reading, with its time: when the answer was there, or as the device says.
#[derive(Debug, Clone)]
pub enum Reading {
    /// Optical power.
    Power {
        /// When the answer was there, UTC.
        time: Epoch,
        /// The power.
        power: Power,
    },
    /// Angle of a stage.
    Angle {
        /// When the answer was there, UTC.
        time: Epoch,
        /// The angle, degrees.
        angle_deg: f64,
    },
    /// Slot of a filter wheel.
    Slot {
        /// When the answer was there, UTC.
        time: Epoch,
        /// The slot, counted from 1.
        slot: u32,
    },
    /// Position of a focuser.
    Steps {
        /// When the answer was there, UTC.
        time: Epoch,
        /// The position, steps.
        steps: i64,
        /// Temperature at the focuser, °C, where it measures one.
        temperature_c: Option<f64>,
    },
    /// Place to which a mount points.
    Place {
        /// When the mount stood there, UTC.
        time: Epoch,
        /// The place.
        place: MountPlace,
    },
    /// Reading of a meter, or level of a source.
    Level {
        /// When the answer was there, UTC.
        time: Epoch,
        /// The level, in the unit.
        level: Level,
        /// Unit of the level.
        unit: String,
    },
    /// Wavelength of a monochromator.
    Wavelength {
        /// When the answer was there, UTC.
        time: Epoch,
        /// The wavelength, nm.
        wavelength_nm: f64,
    },
    /// Spectrum.
    Spectrum(Box<Spectrum>),
    /// Frame of a camera.
    Frame(Box<Frame>),
    /// Bin of a photon counter.
    Counts {
        /// Names of the channels.
        channels: Vec<String>,
        /// The bin.
        record: CountRecord,
    },
}

impl Reading {
    /// Returns true where there was more light than the device holds.
    pub fn is_over(&self) -> bool {
        match self {
            Self::Power { power, .. } => !matches!(power, Power::Watts(_)),
            Self::Level { level, .. } => !matches!(level, Level::Value(_)),
            Self::Spectrum(spectrum) => spectrum.is_saturated(),
            Self::Frame(frame) => {
                Some(f64::from(frame.most_adu())) >= frame.saturation_adu
                    && frame.saturation_adu.is_some()
            }
            _ => false,
        }
    }
}

/// Readings of a device, all that were asked for or those before a failure.
#[derive(Debug)]
pub struct Readings {
    /// Where the device is.
    pub address: Address,
    /// Who it says it is.
    pub identity: Identity,
    /// Number of readings that were asked for.
    pub asked: u32,
    /// The readings.
    pub readings: Vec<Reading>,
    /// Error that ended the readings early.
    pub error: Option<SessionError>,
}

impl OpenDevice {
    /// Reads what the device measures. A failure after the first reading is in the result, with the readings before it.
    ///
    /// # Errors
    /// A failure before the first reading.
    pub fn read(
        &mut self,
        options: &ReadOptions,
        progress: &dyn Progress,
    ) -> Result<Readings, SessionError> {
        let Self { session, device, identity } = self;
        let (mut readings, mut error) = (Vec::new(), None);
        let start = session.now();
        progress.begin(&format!("{} readings", options.count), Some(options.count.into()));
        let counter = Counter::start(session, device, options.exposure_s)?;
        for i in 0..options.count {
            let next = session
                .wait_until(start, options.every.saturating_mul(i))
                .and_then(|()| counter.next(session, device, options.exposure_s));
            match next {
                Ok(reading) => readings.push(reading),
                Err(failed) => {
                    error = Some(failed);
                    break;
                }
            }
            progress.advance(1);
        }
        counter.stop(session, device);
        match error {
            Some(error) if readings.is_empty() => Err(error),
            error => Ok(Readings {
                address: session.address.clone(),
                identity: identity.clone(),
                asked: options.count,
                readings,
                error,
            }),
        }
    }
}

/// Takes one reading.
pub(super) fn one(
    session: &Session,
    device: &mut AnyDevice,
    exposure_s: f64,
) -> Result<Reading, SessionError> {
    let counter = Counter::start(session, device, exposure_s)?;
    let reading = counter.next(session, device, exposure_s);
    counter.stop(session, device);
    reading
}

/// A photon counter that counts meanwhile, or any other device.
struct Counter {
    channels: Vec<String>,
}

impl Counter {
    fn start(session: &Session, device: &mut AnyDevice, bin_s: f64) -> Result<Self, SessionError> {
        let AnyDevice::PhotonCounter(counter) = device else {
            return Ok(Self { channels: vec![] });
        };
        // At most a day: it fits.
        counter.start((bin_s * 1e12).round() as i64, &session.soon())?;
        Ok(Self { channels: counter.channels().to_vec() })
    }

    fn next(
        &self,
        session: &Session,
        device: &mut AnyDevice,
        exposure_s: f64,
    ) -> Result<Reading, SessionError> {
        let soon = session.soon();
        let long = session.within(FRAME + Duration::from_secs_f64(exposure_s));
        Ok(match device {
            AnyDevice::PowerMeter(meter) => {
                let power = meter.power(&soon)?;
                Reading::Power { time: utc_now()?, power }
            }
            AnyDevice::RotationStage(stage) => {
                let angle_deg = stage.angle_deg(&soon)?;
                Reading::Angle { time: utc_now()?, angle_deg }
            }
            AnyDevice::FilterWheel(wheel) => {
                let slot = wheel.slot(&soon)?;
                Reading::Slot { time: utc_now()?, slot }
            }
            AnyDevice::Focuser(focuser) => {
                let steps = focuser.position(&soon)?;
                let temperature_c = focuser.temperature_c(&soon)?;
                Reading::Steps { time: utc_now()?, steps, temperature_c }
            }
            AnyDevice::Mount(mount) => {
                let reading = mount.reading(&soon)?;
                Reading::Place { time: reading.utc, place: reading.place }
            }
            AnyDevice::Meter(meter) => {
                let level = meter.read(&soon)?;
                Reading::Level { time: utc_now()?, level, unit: meter.unit().to_owned() }
            }
            AnyDevice::Source(source) => {
                let level = Level::Value(source.level(&soon)?);
                Reading::Level { time: utc_now()?, level, unit: source.unit().to_owned() }
            }
            AnyDevice::Monochromator(monochromator) => {
                let wavelength_nm = monochromator.wavelength_nm(&soon)?;
                Reading::Wavelength { time: utc_now()?, wavelength_nm }
            }
            AnyDevice::Spectrometer(spectrometer) => {
                Reading::Spectrum(Box::new(spectrometer.expose(exposure_s, &long)?))
            }
            AnyDevice::Camera(camera) => {
                Reading::Frame(Box::new(camera.expose(exposure_s, &long)?))
            }
            AnyDevice::PhotonCounter(counter) => {
                let read = counter.read(1, &long).map_err(|failed| *failed.error)?;
                let record = read.into_iter().next().ok_or(SessionError::NoBin)?;
                Reading::Counts { channels: self.channels.clone(), record }
            }
        })
    }

    /// Stops a counter. One that cannot be stopped is left counting: what it gave is good all the same.
    fn stop(&self, session: &Session, device: &mut AnyDevice) {
        if let AnyDevice::PhotonCounter(counter) = device {
            let _ = counter.stop(&session.soon());
        }
    }
}
