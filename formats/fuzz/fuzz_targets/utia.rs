//! Files of the UTIA database: no panic, what is written reads the same. As only one length is a file, shorter inputs are repeated to it now and then.
#![no_main]

#[path = "../targets/utia.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
