//! Light's units and tables, the sky and the air, stations and light curves.
//!
//! In the order in which data flows through it:
//!
//! - [`constants`];
//! - [`tables`]: the reference tables that the program carries with it;
//! - [`spectrum`]: values on a wavelength grid, typed by what they hold;
//! - [`quadrature`]: the one integral over wavelength;
//! - [`light`]: the Sun and Vega;
//! - [`passband`]: passbands and magnitudes.

pub mod constants;
pub mod light;
pub mod passband;
pub mod quadrature;
pub mod spectrum;
pub mod tables;
