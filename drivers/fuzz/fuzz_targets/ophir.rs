//! Ophir's answers: no panic; what is read keeps its promises.
#![no_main]

#[path = "../targets/ophir.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
