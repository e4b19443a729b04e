//! Files of Bruker's OPUS: no panic, bounded memory, and what is written reads the same.
#![no_main]

#[path = "../targets/opus.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
