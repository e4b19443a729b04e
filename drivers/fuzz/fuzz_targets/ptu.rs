//! PicoQuant files: no panic, bounded memory; as many records as the file says.
#![no_main]

#[path = "../targets/ptu.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
