//! ECSV: no panic, and what is read and written again reads the same.
#![no_main]

#[path = "../targets/ecsv.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
