//! Light's units and tables, the sky and the air, stations and light curves.
//!
//! In the order in which data flows through it:
//!
//! - [`constants`];
//! - [`tables`]: the reference tables that the program carries with it;
//! - [`spectrum`]: values on a wavelength grid, typed by what they hold;
//! - [`quadrature`]: the one integral over wavelength;
//! - [`light`]: the Sun, Vega, black bodies;
//! - [`refractive_index`]: n + ik of spacecraft metals, semiconductors and Kapton;
//! - [`passband`]: passbands and magnitudes;
//! - [`spectral_type`], [`star_light`]: a star's absolute spectrum from its magnitude, type and colour;
//! - [`star_track`]: a star through time: its places, its air, its rates;
//! - [`sky`]: where things are: time, Earth orientation, sites, frames, the Sun, the Moon and stars;
//! - [`air`]: what the atmosphere leaves of a direct beam;
//! - [`station`]: site, telescope, channels, camera and lasers of an observatory;
//! - [`light_curve`]: the schema in which measured and simulated light meet.

pub mod air;
pub mod constants;
pub mod light;
pub mod light_curve;
pub mod passband;
pub mod quadrature;
pub mod refractive_index;
pub mod sky;
pub mod spectral_type;
pub mod spectrum;
pub mod star_light;
pub mod star_track;
pub mod station;
pub mod tables;
