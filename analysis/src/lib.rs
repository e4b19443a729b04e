//! Reading a light curve without a model of the body: periods, folded curves, materials, maps.
//!
//! In the order in which data flows through it:
//!
//! - [`curves`]: curves of several files on one clock;
//! - [`trend`]: air, range and phase trend, removed;
//! - [`series`]: the samples of one channel that count, sorted, relative to one moment;
//! - [`mod@period`]: Lomb-Scargle, phase dispersion minimisation, and a verdict;
//! - [`synodic`]: from the period that is seen to that of the spin;
//! - [`mod@fold`]: samples by their phase in a period;
//! - [`samples`]: values of a curve, which of them count, and the light under which they were taken;
//! - [`unmix`]: materials from spectra and from channels;
//! - [`map`]: samples on the body's frame.

pub mod curves;
pub mod fold;
pub mod map;
pub mod period;
pub mod samples;
pub mod series;
pub mod synodic;
pub mod trend;
pub mod unmix;
