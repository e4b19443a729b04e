//! APT messages: no panic; what is read is byte for byte what was there; a simulated stage hears anything.
#![no_main]

#[path = "../targets/apt.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
