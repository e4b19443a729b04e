//! Recordings: no panic; what is read is written as the same; umockdev's files are made or refused.
#![no_main]

#[path = "../targets/recording.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
