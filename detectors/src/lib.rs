//! Rigs that measure a photon counter, driven from plan to table. The numbers are found by [`sunglint_calibration`]; here is what drives devices and keeps readings.
//!
//! - [`efficiency`]: counts per photon against wavelength: monochromator, calibrated photodiode, the sensor;
//! - [`linearity`]: dead time: neutral-density steps, or two sources alone and together;
//! - [`reading`]: one reading of a photodiode, a counter, a wheel, tried again where a line fails once.
//!
//! Both runs keep each reading in their folder as it comes ([`sunglint_materials::log`]), so that a run which was broken off at any moment goes on where it was.

pub mod efficiency;
pub mod linearity;
pub mod reading;
