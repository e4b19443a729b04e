//! Nights that are rehearsed: a night's plan with a virtual observatory in place of its devices.
//!
//! [`sunglint_observatory`] runs a plan and knows no virtual device; [`sunglint_virtual`] makes those and shares no formula with what is tested on them. Here the two meet:
//!
//! - [`VirtualNight`]: the opener of a plan that names a virtual night;
//! - [`planned`]: a plan as a night that can run, with its virtual observatory where it has one;
//! - [`demo`]: the files of the demonstration's night;
//! - [`track`]: a virtual telescope that follows a satellite.

pub mod demo;
mod night;
pub mod track;

pub use night::{VirtualNight, planned};
