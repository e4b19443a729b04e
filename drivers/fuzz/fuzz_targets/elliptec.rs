//! Lines of Elliptec modules: no panic; a simulated mount hears anything.
#![no_main]

#[path = "../targets/elliptec.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
