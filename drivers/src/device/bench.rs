//! Devices of an optics bench beside stages and power meters: meters of any quantity, sources, spectrometers, monochromators.

use super::{Device, DeviceError, Interrupted};
use crate::clock::Deadline;
use hifitime::Epoch;
use sunglint_numerics::measured::Interval;

/// Reading that a meter shows, in the meter's unit.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Level {
    /// A number.
    Value(f64),
    /// More than the range holds.
    Over,
}

/// A meter of one quantity: a current, a voltage, a resistance, a temperature.
pub trait Meter: Device {
    /// Unit of its readings, as the International System writes it (`A`, `V`, `degC`).
    fn unit(&self) -> &str;

    /// Takes a reading that was measured after this call began: never a copy of an older one.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn read(&mut self, deadline: &Deadline) -> Result<Level, DeviceError>;
}

/// A source with one output: a lamp's or a laser's supply, a voltage, a current.
pub trait Source: Device {
    /// Unit of its level.
    fn unit(&self) -> &str;

    /// Levels that it takes, where they are known.
    fn range(&self) -> Option<Interval>;

    /// The level that is set, whether the output is on or not.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn level(&mut self, deadline: &Deadline) -> Result<f64, DeviceError>;

    /// Sets the level and gives the level that the device then has.
    ///
    /// # Errors
    /// A level that it does not take, or see [`DeviceError`].
    fn set_level(&mut self, level: f64, deadline: &Deadline) -> Result<f64, DeviceError>;

    /// Whether the output is on.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn is_on(&mut self, deadline: &Deadline) -> Result<bool, DeviceError>;

    /// Switches the output and gives whether it then is on.
    ///
    /// # Errors
    /// See [`DeviceError`]; the output may still be on.
    fn switch(&mut self, on: bool, deadline: &Deadline) -> Result<bool, DeviceError>;
}

/// A spectrum as a spectrometer gave it: nothing is subtracted.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    /// When the integration began, UTC, as far as the request tells.
    pub start: Epoch,
    /// Time of integration, s.
    pub integration_s: f64,
    /// Wavelength of each value, nm, rising.
    pub wavelength_nm: Vec<f64>,
    /// Values, counts of the converter.
    pub counts: Vec<f64>,
    /// Value at which the converter ends, where it is known.
    pub saturation_counts: Option<f64>,
}

impl Spectrum {
    /// Whether a value is at the converter's end.
    pub fn is_saturated(&self) -> bool {
        self.saturation_counts.is_some_and(|end| self.counts.iter().any(|value| *value >= end))
    }
}

/// A spectrometer with a line of pixels.
pub trait Spectrometer: Device {
    /// Wavelength of each pixel, nm, rising.
    fn wavelength_nm(&self) -> &[f64];

    /// Shortest and longest integration, s, where they are known.
    fn integration_s(&self) -> Option<Interval>;

    /// Integrates for `integration_s`, s: a spectrum that began after this call.
    ///
    /// # Errors
    /// An integration that it does not take, or see [`DeviceError`].
    fn expose(&mut self, integration_s: f64, deadline: &Deadline) -> Result<Spectrum, DeviceError>;
}

/// A monochromator.
pub trait Monochromator: Device {
    /// Wavelengths that it reaches, nm, where they are known.
    fn range_nm(&self) -> Option<Interval>;

    /// Wavelength at which it stands, nm.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn wavelength_nm(&mut self, deadline: &Deadline) -> Result<f64, DeviceError>;

    /// Goes to a wavelength, nm, and gives the wavelength at which it then stands.
    ///
    /// # Errors
    /// Where it stands (nm, if it can still be asked), with the error.
    fn move_to(
        &mut self,
        wavelength_nm: f64,
        deadline: &Deadline,
    ) -> Result<f64, Interrupted<Option<f64>>>;
}
