//! Answers of SCPI instruments and the files that describe these: no panic; what is read keeps its promises.
#![no_main]

#[path = "../targets/scpi.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
