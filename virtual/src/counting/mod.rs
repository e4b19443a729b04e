//! A lamp behind a monochromator, a photodiode and a counting detector in its light; and two sources behind neutral-density filters for the detector alone.
//!
//! - [`options`]: the keys of its file;
//! - [`light`]: the lamp's spectrum through slit, grating (with its second order) and filters, as power on both detectors;
//! - [`detector`]: photons one by one, each counted or lost by what the detector does: no formula for a rate;
//! - [`devices`]: all of it behind the drivers' traits.

pub mod detector;
pub mod devices;
pub mod light;
mod mppc;
pub mod options;
