//! Lines of Zaber devices: no panic; a simulated device hears anything.
#![no_main]

#[path = "../targets/zaber.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
