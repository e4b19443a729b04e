//! The virtual observatory: a night whose truth is known, from photons and pixels.
//!
//! - [`random`]: streams of random numbers by number;
//! - [`events`]: photons one by one through a detector: time tags;
//! - [`counts`]: the counts of bins by the detector's law;
//! - [`frame`]: pictures of point sources, pixel by pixel;
//! - [`wander`]: what wanders in time: twinkling, pointing, seeing, clouds;
//! - [`options`]: what a night is like, the keys of a `virtual.toml`;
//! - [`plan`]: where the telescope points when;
//! - [`night`]: what every channel would get of it before any chance;
//! - [`watch`]: what the instruments get: counts, tags, frames;
//! - [`truth`]: the truth for whoever compares;
//! - [`devices`]: the instruments behind the traits of the drivers.
//!
//! It stands on `radiometry` for what light is (spectra, air, sensitivities) and on nothing of what a reduction does: no dead time is
//! inverted here, no aperture is summed, no coefficient is fitted. A test of a reduction that has its data from here has
//! an independent truth.

pub mod counts;
pub mod devices;
pub mod events;
pub mod frame;
pub mod night;
pub mod options;
pub mod plan;
pub mod random;
pub mod truth;
pub mod wander;
pub mod watch;
