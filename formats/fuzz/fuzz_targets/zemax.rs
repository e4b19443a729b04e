//! Zemax's tables of scattered light: no panic, bounded memory, and what is written reads the same.
#![no_main]

use libfuzzer_sys::fuzz_target;
use sunglint_formats::zemax;

fuzz_target!(|text: &str| {
    if let Ok(file) = zemax::read_str("x", text) {
        let again = zemax::read_str("x", &zemax::to_string(&file)).expect("what we write, we read");
        assert_eq!(again, file);
    }
});
