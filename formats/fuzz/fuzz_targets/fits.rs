//! FITS: no panic, bounded memory, and a table that is read and written again reads the same.
#![no_main]

#[path = "../targets/fits.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
