//! ASTM's tables of scattered light: no panic, bounded memory, and what is written reads the same.

use sunglint_formats::astm;

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let text = &*String::from_utf8_lossy(bytes);
    if let Ok(file) = astm::read_str("x", text) {
        let again = astm::read_str("x", &astm::to_string(&file)).expect("what we write, we read");
        assert_eq!(again, file);
    }
}
