//! Spectra in JCAMP-DX: no panic; as many values as places, all finite.
#![no_main]

#[path = "../targets/jcamp.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
