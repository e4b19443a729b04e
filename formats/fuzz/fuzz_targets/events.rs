//! Lines of a session's log: no panic; what is read is written as the same event. (Of numbers the reader, serde_json, may miss the last bit.)
#![no_main]

#[path = "../targets/events.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
