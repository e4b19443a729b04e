//! UTC: no panic; an instant comes back from its text, and any epoch prints.
#![no_main]

#[path = "../targets/utc.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
