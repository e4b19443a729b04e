//! Tables of positions: CSV, ECSV, OEM in KVN and XML, CPF: no panic, and a state at each end.
#![no_main]

#[path = "../targets/positions.rs"]
mod target;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));
