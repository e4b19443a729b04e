//! TOML into structs: no panic.
#![no_main]

#[path = "../targets/toml.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
