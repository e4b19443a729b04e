//! ZeroMQ around SCPI: no panic.
#![no_main]

#[path = "../targets/zmtp.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
