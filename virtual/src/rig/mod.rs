//! The virtual rig: a sample of known reflectance on a stage that turns, in a laser's beam, under a power meter.
//!
//! - [`options`]: what a rig is like, the keys of a `rig.toml`;
//! - [`sample`]: closed forms of what samples reflect;
//! - [`mod@bench`]: the light on the meter for an angle of the stage and a time;
//! - [`stage`]: where a stage stands that was sent somewhere: steps, play;
//! - [`meter`]: what a meter shows of light: ranges, settling, noise, an offset, its end.
//!
//! It gives what a measurement is made of and knows nothing of how one is evaluated: no solid angle is divided by, no power becomes a reflectance. The
//! light in the cone that the aperture takes is summed direction by direction. Time is an argument (seconds since the laser's power was stated), chance
//! comes from a seed and the number of the reading.

pub mod bench;
pub mod devices;
pub mod meter;
pub mod options;
pub mod sample;
pub mod stage;
