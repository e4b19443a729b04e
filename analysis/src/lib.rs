//! Reading a light curve: periods, materials, maps, attitude. Stands on `sunglint-calibration`.
//!
//! Nothing is here yet. What will stand here, in the order in which data flows through it:
//!
//! - `trend`: air, range and phase removed; folding;
//! - `period`: Lomb-Scargle, phase dispersion minimisation, and a verdict;
//! - `unmix`: materials from spectra and from channels;
//! - `map`: samples on the body's frame;
//! - `attitude`: spin axis, period and phase of a known shape.
