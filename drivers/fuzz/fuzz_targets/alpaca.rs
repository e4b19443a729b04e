//! Answers of Alpaca servers: no panic, bounded memory; the same answer in one piece and in two; frames of no more pixels than bytes.
#![no_main]

#[path = "../targets/alpaca.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
