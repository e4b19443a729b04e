//! FRED's tables of scattered light: no panic, bounded memory, and what is written reads the same.
#![no_main]

use libfuzzer_sys::fuzz_target;
use sunglint_formats::fred;

fuzz_target!(|text: &str| {
    if let Ok(file) = fred::read_str("x", text) {
        let again = fred::read_str("x", &fred::to_string(&file)).expect("what we write, we read");
        assert_eq!(again, file);
    }
});
