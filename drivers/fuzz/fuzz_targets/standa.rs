//! Bytes of Standa controllers: no panic; a simulated one hears anything.
#![no_main]

#[path = "../targets/standa.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
