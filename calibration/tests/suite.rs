//! All tests of this crate: one program, so that one is linked.

mod alignment;
mod comparison;
mod counts;
mod dead_time;
mod events;
mod glints;
mod intervals;
mod lab;
mod material;
mod ndf;
mod pass;
mod photometry;
mod plan;
mod stars;
