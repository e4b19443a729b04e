//! Magnitudes of other programs: no panic; columns of one length, finite magnitudes.
#![no_main]

#[path = "../targets/photometry.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
