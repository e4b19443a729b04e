//! Zemax's tables of scattered light: no panic, bounded memory, and what is written reads the same.

use sunglint_formats::zemax;

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let text = &*String::from_utf8_lossy(bytes);
    if let Ok(file) = zemax::read_str("x", text) {
        let again = zemax::read_str("x", &zemax::to_string(&file)).expect("what we write, we read");
        assert_eq!(again, file);
    }
}
