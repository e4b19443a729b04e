//! Light's units and tables, the sky and the air, stations and light curves.
//!
//! In the order in which data flows through it:
//!
//! - [`tables`]: the reference tables that the program carries with it;
//! - [`air`]: what the atmosphere leaves of a direct beam.

pub mod air;
pub mod tables;
