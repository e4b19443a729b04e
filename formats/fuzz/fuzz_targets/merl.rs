//! Files of the MERL database: no panic, bounded memory, what is written reads the same, values are numbers.
#![no_main]

#[path = "../targets/merl.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
