//! Nights and lab rigs whose truth is known, behind the devices' traits. They share no formula with what is tested on them.
//!
//! - [`counting`]: a lamp, a monochromator, a photodiode and a detector that counts;
//! - [`focus`]: a focuser with play, and a camera behind it;
//! - [`goniometer`]: a sample, a lamp and a detector on arms, with axes that are off;
//! - [`observatory`]: a night: photon events, frames, stars, weather;
//! - [`rig`]: a sample with known reflectance on a stage, in a laser's beam, under a power meter;
//! - [`telescope`]: a mount with motors and gears, and a finder;
//! - [`options`]: what the tables of options of both have in common.

pub mod counting;
pub mod focus;
pub mod goniometer;
pub mod observatory;
pub mod options;
pub mod rig;
pub mod telescope;
pub mod together;
