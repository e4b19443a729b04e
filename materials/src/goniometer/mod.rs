//! A goniometer's run: from a plan to BRDF values, beginning with the instrument itself.
//!
//! - [`mod@bench`]: BENCH.toml, the axes, the meter and the optics of a bench;
//! - [`channels`]: the bands of a spectrometer, the wavelengths of a monochromator;
//! - [`pose`]: directions as angles of the axes;
//! - [`budget`]: plans of so many directions, or so much time;
//! - [`tasks`]: all that a run measures, in its order;
//! - [`mod@measure`]: the run itself, resumable after any reading;
//! - [`spectra`]: a spectrometer's readings at a place;
//! - [`files`]: the files of an instrument that cannot be driven;
//! - [`line`](mod@line): what was read, as the run's folder holds it;
//! - [`signature`]: the beam without a sample, and what it tells of the instrument;
//! - [`overlap`]: how much of the beam lies on the sample and in the detector's field;
//! - [`mod@reduce`]: readings as values;
//! - [`folder`]: a run's folder as values.

pub mod bench;
pub mod budget;
pub mod channels;
pub mod files;
pub mod folder;
pub mod line;
pub mod measure;
pub mod overlap;
pub mod pose;
pub mod reduce;
pub mod signature;
pub mod spectra;
pub mod tasks;
