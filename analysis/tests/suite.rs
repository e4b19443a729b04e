//! All tests of this crate: one program, so that one is linked.

mod answers;
mod flashes;
mod foreign;
mod map;
mod passing;
mod periodograms;
mod sessions;
mod spins;
mod trends;
mod uneven;
mod unmix;
mod verdicts;
