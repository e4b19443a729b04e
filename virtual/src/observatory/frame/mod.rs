//! Pictures of point sources on a sensor, electron by electron.
//!
//! The light of a source is its point spread, integrated over each pixel ([`PointSpread`]), along the path that it takes in the
//! exposure. What falls on a pixel passes its own response, dark current adds, and the sum is the mean of a Poisson draw;
//! cosmic rays bring charge of their own; the well holds so much; the amplifier adds its noise, and the converter rounds and ends.
//!
//! Columns and rows are those of the sensor, unbinned, and a pixel's middle is a whole number. Colours are red, green, blue; a sensor
//! without a mosaic uses the first alone.

mod sensor;
mod sources;
mod spread;

pub use sensor::{Exposure, Pattern, PixelFaults, Sensor};
pub use sources::{CosmicRays, Scene, Sky, Source, Streak, streak};
pub use spread::PointSpread;
