//! All tests of this crate: one program, so that one is linked.

mod budget;
mod goniometer;
mod implausible;
mod material;
mod ndf;
mod plan;
mod retro;
mod retro_intervals;
mod settling;
