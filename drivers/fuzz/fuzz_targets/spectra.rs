//! Answers of monochromators and spectrometers: no panic; what is read keeps its promises.
#![no_main]

#[path = "../targets/spectra.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
