//! Light's units and tables, the sky and the air, stations and light curves.
//!
//! In the order in which data flows through it:
//!
//! - [`tables`]: the reference tables that the program carries with it;
//! - [`sky`]: where things are: time, Earth orientation, sites, frames, the Sun, the Moon and stars.

pub mod sky;
pub mod tables;
