//! Elements: no panic; what is read starts SGP4 or says why not, a place that is found is finite, and what is written reads the same.
#![no_main]

#[path = "../targets/elements.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
