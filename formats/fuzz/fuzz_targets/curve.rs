//! Curves: no panic; what is read is a curve.
#![no_main]

#[path = "../targets/curve.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
