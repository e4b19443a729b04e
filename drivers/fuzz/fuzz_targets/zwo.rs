//! The wheel's reports: no panic; what is read keeps its promises.
#![no_main]

#[path = "../targets/zwo.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
