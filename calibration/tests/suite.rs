//! All tests of this crate: one program, so that one is linked.

mod alignment;
mod blind;
mod comparison;
mod counts;
mod dead_time;
mod efficiency;
mod events;
mod folder;
mod glints;
mod intervals;
mod photometry;
mod settings;
mod stars;
mod streaks;
