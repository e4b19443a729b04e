//! Coordinates in FITS headers: no panic; a place on the sky that is found is finite.
#![no_main]

#[path = "../targets/wcs.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
