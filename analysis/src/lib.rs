//! Reading a light curve: periods, materials, maps, attitude. Stands on `sunglint-calibration`.
//!
//! In the order in which data flows through it:
//!
//! - [`trend`]: air, range and phase trend, removed;
//! - [`series`]: the samples of one channel that count, sorted, relative to one moment;
//! - [`mod@period`]: Lomb-Scargle, phase dispersion minimisation, and a verdict;
//! - [`synodic`]: from the period that is seen to that of the spin;
//! - [`mod@fold`]: samples by their phase in a period;
//! - [`unmix`]: materials from spectra and from channels;
//! - [`map`]: samples on the body's frame;

pub mod fold;
pub mod map;
pub mod period;
pub mod series;
pub mod synodic;
pub mod trend;
pub mod unmix;
