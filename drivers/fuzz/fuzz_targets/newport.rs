//! Lines of Newport controllers: no panic; simulated ones hear anything.
#![no_main]

#[path = "../targets/newport.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
