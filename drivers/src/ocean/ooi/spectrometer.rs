//! A spectrometer on OOI: its memory, its integration, and its traits.

use super::frame::{self, Speed, set_integration, slot};
use super::line::{Line, spoilt};
use super::{Model, Saturation};
use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, Identity, Origin, Setting, Spectrometer, Spectrum, Value,
};
use crate::ocean::fresh::{Instrument, Integration};
use crate::ocean::spectrometer::wavelengths;
use crate::reply::ReplyError;
use crate::transport::Transfers;
use std::time::Duration;
use sunglint_numerics::measured::Interval;

/// Settings that the driver needs for the instrument.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OoiSettings {
    /// How long an answer may take, beside an integration.
    pub reply_within: Duration,
    /// How long it is left alone after the command that begins a session; seabreeze waits as long.
    pub settling: Duration,
    /// Spectra that are thrown away after a change of the time of integration.
    pub stale: u32,
}

impl Default for OoiSettings {
    fn default() -> Self {
        Self {
            reply_within: Duration::from_millis(1_000),
            settling: Duration::from_millis(100),
            stale: 1,
        }
    }
}

/// Contents of the instrument's memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Coefficients of the wavelength: nm, nm/px, nm/px², nm/px³.
    pub wavelength: Vec<f64>,
    /// Coefficients of the nonlinearity from that of order 0, where they are written.
    pub nonlinearity: Option<Vec<f64>>,
    /// Part of the light that is stray light, where it is written.
    pub stray_light: Option<f64>,
    /// Value at which the converter saturates, where it is written.
    pub saturation: Option<u16>,
}

impl Calibration {
    /// Returns the counts that a linear detector would have given, of counts without their dark: these over the polynomial of the nonlinearity at them. `None` where the
    /// coefficients are not written, or where the polynomial is not above 0.
    ///
    /// # Source
    /// seabreeze 2.11.0, `Spectrometer.intensities(correct_nonlinearity=True)`, where its counts are scaled.
    pub fn linear(&self, counts: f64) -> Option<f64> {
        let coefficients = self.nonlinearity.as_ref()?;
        let polynomial = coefficients.iter().rev().fold(0.0, |sum, c| sum * counts + c);
        (polynomial > 0.0 && polynomial.is_finite()).then(|| counts / polynomial)
    }
}

/// A spectrometer.
#[derive(Debug)]
pub struct Ooi<U> {
    line: Line<U>,
    serial: String,
    firmware: Option<String>,
    calibration: Calibration,
    wavelength_nm: Vec<f64>,
    integration: Integration,
    /// The longest integration that may be under way, where one is known, µs.
    known_us: Option<u32>,
}

/// Longest integration that is waited for where another program has set it before and the model does not tell it, µs.
const LONGEST_BEFORE_US: u32 = 10_000_000;

impl<U: Transfers> Ooi<U> {
    /// Begins a session and reads the memory.
    ///
    /// # Errors
    /// An instrument that does not answer; wavelengths that are not written or do not rise.
    pub fn open(
        usb: U,
        model: Model,
        settings: OoiSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let mut line = Line::new(usb, model, settings);
        let serial = line.begin(deadline)?;
        // Only the models that share its number are told apart by it.
        let firmware = if model.product == FLAME_S { Some(line.firmware(deadline)?) } else { None };
        let calibration = calibration(&mut line, deadline)?;
        line.end = calibration.saturation.unwrap_or(model.saturation);
        let wavelength_nm = wavelengths(&calibration.wavelength, model.first_pixel, model.pixels)?;
        Ok(Self {
            line,
            serial,
            firmware: firmware.map(|version| version.map(|n| n.to_string()).join(".")),
            calibration,
            wavelength_nm,
            integration: Integration::Unknown,
            known_us: None,
        })
    }

    /// The model.
    pub fn model(&self) -> Model {
        self.line.model
    }

    /// Contents of its memory.
    pub fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    /// Speed of its bus; of models that do not tell it, the one that is usual.
    pub fn speed(&self) -> Speed {
        self.line.speed
    }

    /// The line to the instrument.
    pub fn line(&self) -> &U {
        &self.line.usb
    }

    /// The line to the instrument; what is said on it behind the driver's back, the driver does not know.
    pub fn line_mut(&mut self) -> &mut U {
        &mut self.line.usb
    }

    /// The line to the instrument.
    pub fn into_line(self) -> U {
        self.line.usb
    }
}

/// Product number of the USB2000+ and of the Flame-S.
const FLAME_S: u16 = 0x101e;

/// Reads the memory.
fn calibration<U: Transfers>(
    line: &mut Line<U>,
    deadline: &Deadline,
) -> Result<Calibration, DeviceError> {
    let mut wavelength = Vec::new();
    for power in 0..4 {
        let number = slot::WAVELENGTH + power;
        let answer = line.slot(number, deadline)?;
        let coefficient = frame::slot_number(number, &answer).map_err(|error: ReplyError| {
            spoilt(format!(
                "slot {number} of its memory: {error}: it has no calibration of the wavelength"
            ))
        })?;
        wavelength.push(coefficient);
    }
    // The rest may never have been written.
    let answer = line.slot(slot::STRAY_LIGHT, deadline)?;
    let stray_light = frame::slot_number(slot::STRAY_LIGHT, &answer).ok();
    let answer = line.slot(slot::NONLINEARITY_ORDER, deadline)?;
    let mut nonlinearity = None;
    if let Ok(order) = frame::slot_order(slot::NONLINEARITY_ORDER, &answer) {
        let mut coefficients = Vec::new();
        for number in (slot::NONLINEARITY..).take(usize::from(order) + 1) {
            let answer = line.slot(number, deadline)?;
            coefficients.push(frame::slot_number(number, &answer).ok());
        }
        nonlinearity = coefficients.into_iter().collect();
    }
    let saturation = match line.model.slot_17 {
        Saturation::Unused => None,
        _ => {
            let answer = line.slot(slot::SATURATION, deadline)?;
            let read = frame::saturation(&line.model, &answer);
            read.map_err(|error| spoilt(format!("slot 17 of its memory: {error}")))?
        }
    };
    Ok(Calibration { wavelength, nonlinearity, stray_light, saturation })
}

/// The instrument behind its integration.
struct Telling<'a, U> {
    line: &'a mut Line<U>,
    /// The time of integration that is wanted, µs.
    us: u32,
}

impl<U: Transfers> Instrument for Telling<'_, U> {
    fn told_us(&mut self, deadline: &Deadline) -> Result<Option<u32>, DeviceError> {
        if !self.line.model.tells_status {
            return Ok(None);
        }
        let told = self.line.status(deadline)?.integration;
        // The QE65000 is set in ms; whether it tells it in µs is not known.
        let unit = self.line.model.unit_us;
        let is_it = unit > 1 && told.checked_mul(unit) == Some(self.us);
        Ok(Some(if is_it { self.us } else { told }))
    }

    fn set_us(&mut self, us: u32, deadline: &Deadline) -> Result<(), DeviceError> {
        let bytes = set_integration(&self.line.model, us);
        self.line.tell(&bytes, deadline)
    }

    fn raw(&mut self, work: Duration, deadline: &Deadline) -> Result<Vec<f64>, DeviceError> {
        let counts = self.line.spectrum(work, deadline)?;
        Ok(counts.into_iter().map(f64::from).collect())
    }
}

impl<U: Transfers> Device for Ooi<U> {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        self.serial = self.line.serial(deadline)?;
        Ok(Identity {
            vendor: "Ocean Optics".into(),
            model: self.line.model.name.into(),
            serial: Some(self.serial.clone()),
            firmware: self.firmware.clone(),
            driver: "ocean",
        })
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let read = |name, value| Setting { name, value, origin: Origin::ReadBack };
        let configured = |name, value| Setting { name, value, origin: Origin::Configured };
        let model = self.line.model;
        let ends = [self.wavelength_nm.first(), self.wavelength_nm.last()];
        let [first, last] = ends.map(|nm| Value::Number(nm.copied().unwrap_or(f64::NAN)));
        let saturation = Value::Integer(i64::from(self.line.end));
        let said = if self.calibration.saturation.is_some() { read } else { configured };
        let mut settings = vec![
            // At most 3840.
            configured("pixels", Value::Integer(model.pixels as i64)),
            said("saturation_counts", saturation),
            read("first_nm", first),
            read("last_nm", last),
        ];
        if !model.dark.is_empty() {
            let ranges: Vec<String> =
                model.dark.iter().map(|[first, end]| format!("{first}-{}", end - 1)).collect();
            settings.push(configured("dark_pixels", Value::Text(ranges.join(" "))));
        }
        let nonlinearity = match &self.calibration.nonlinearity {
            Some(all) => all.iter().map(|c| format!("{c:e}")).collect::<Vec<_>>().join(" "),
            None => "not written".to_owned(),
        };
        settings.push(read("nonlinearity", Value::Text(nonlinearity)));
        if let Some(part) = self.calibration.stray_light {
            settings.push(read("stray_light", Value::Number(part)));
        }
        if model.tells_status {
            let speed = match self.line.speed {
                Speed::Full => "full",
                Speed::High => "high",
            };
            settings.push(read("usb_speed", Value::Text(speed.to_owned())));
            let us = match self.integration {
                Integration::Set { us, .. } => us,
                Integration::Unknown => 0,
            };
            let told = Telling { line: &mut self.line, us }.told_us(deadline)?;
            // What unit a QE65000 tells it in is known only where it is the time that was set.
            if let Some(told) = told.filter(|told| model.unit_us == 1 || *told == us) {
                settings.push(read("integration_us", Value::Integer(i64::from(told))));
            }
        }
        Ok(settings)
    }
}

impl<U: Transfers> Spectrometer for Ooi<U> {
    fn wavelength_nm(&self) -> &[f64] {
        &self.wavelength_nm
    }

    fn integration_s(&self) -> Option<Interval> {
        let [least, most] = self.line.model.integration_us.map(|us| f64::from(us) / 1e6);
        Some(Interval::new(least, most))
    }

    /// Takes a spectrum; one that is older is thrown away, which takes its time. The time of integration is the nearest that the model can be set to, as the spectrum then says.
    fn expose(&mut self, integration_s: f64, deadline: &Deadline) -> Result<Spectrum, DeviceError> {
        let model = self.line.model;
        let [least, most] = model.integration_us;
        let us = (integration_s * 1e6).round();
        if !(f64::from(least)..=f64::from(most)).contains(&us) {
            let [least, most] = [least, most].map(|us| f64::from(us) / 1e6);
            let name = "integration_s";
            return Err(DeviceError::OutOfRange { name, asked: integration_s, least, most });
        }
        // The limits are whole units: within them still.
        let unit = f64::from(model.unit_us);
        let us = ((us / unit).round() * unit) as u32;
        let before = self.known_us.unwrap_or(LONGEST_BEFORE_US);
        let longest = Duration::from_micros(u64::from(before));
        // Until this call has ended well, either may be under way.
        self.known_us = Some(before.max(us));
        let saturation = self.line.end;
        let mut stale = self.line.settings.stale;
        if self.line.owes(deadline) {
            // One that nobody waited for may come before all others.
            self.integration = Integration::Unknown;
            stale = stale.saturating_add(1);
        }
        let mut instrument = Telling { line: &mut self.line, us };
        let (start, counts) =
            self.integration.expose(&mut instrument, us, stale, longest, deadline)?;
        self.known_us = Some(us);
        Ok(Spectrum {
            start,
            integration_s: f64::from(us) / 1e6,
            wavelength_nm: self.wavelength_nm.clone(),
            counts,
            saturation_counts: Some(f64::from(saturation)),
        })
    }
}
