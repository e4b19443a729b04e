//! All tests of this crate: one program, so that one is linked.

mod budget;
mod channels;
mod goniometer;
mod implausible;
mod material;
mod ndf;
mod plan;
mod retro;
mod retro_intervals;
mod settling;
