//! Laser ranges in the CRD format: no panic; no more lines than the text has; what is written reads the same.
#![no_main]

#[path = "../targets/crd.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
