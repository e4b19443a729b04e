//! The virtual goniometer: a sample of known reflectance, a lamp and a detector on arms, axes that are off, stray light.
//!
//! - [`options`]: what it is like, the keys of a `goniometer.toml`;
//! - [`light`]: the light on the detector for where the arms stand;
//! - [`devices`]: its stages and its meter behind the drivers' traits;
//! - [`wires`]: the same behind the protocols of makers, for programs at the other end of a line.
//!
//! The light is summed ray by ray and point by point of the detector's disc; the footprint is counted place by place. Nothing of how a run is evaluated is used: no solid
//! angle is divided by, no signature is fitted, no power becomes a reflectance. Samples, stages and meters are those of [`crate::rig`].

pub mod devices;
pub mod light;
pub mod options;
pub mod wires;
