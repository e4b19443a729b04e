//! The Time Tagger bridge's frames: no panic, bounded memory; the same frames in one piece and in two; a frame that was read
//! is made again byte for byte, but for the spelling of JSON.
#![no_main]

#[path = "../targets/swabian.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
