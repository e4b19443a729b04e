//! Raw time tags: no panic; the bins hold no more events than there are records.
#![no_main]

#[path = "../targets/tags.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
