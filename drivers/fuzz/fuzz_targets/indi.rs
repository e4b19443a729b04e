//! INDI streams: no panic, bounded memory; the same elements in one piece and in two; what they say can be applied.
#![no_main]

#[path = "../targets/indi.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
