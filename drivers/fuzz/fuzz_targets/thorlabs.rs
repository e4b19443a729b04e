//! USBTMC messages and SCPI answers: no panic; what is read keeps its promises.
#![no_main]

#[path = "../targets/thorlabs.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
