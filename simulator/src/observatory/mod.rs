//! The virtual observatory: a night whose truth is known, from photons and pixels.
//!
//! - [`random`]: streams of random numbers by number;
//! - [`events`]: photons one by one through a detector: time tags;
//! - [`counts`]: the counts of bins by the detector's law;
//! - [`frame`]: pictures of point sources, pixel by pixel.
//!
//! It stands on `radiometry` for what light is (spectra, air, sensitivities) and on nothing of what a reduction does: no dead time is
//! inverted here, no aperture is summed, no coefficient is fitted. A test of a reduction that has its data from here has
//! an independent truth.

pub mod counts;
pub mod events;
pub mod frame;
pub mod random;
