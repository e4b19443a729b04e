//! Files of the UTIA database: no panic, what is written reads the same. As only one length is a file, shorter inputs are repeated to it now and then.

use sunglint_formats::utia::UtiaBrdf;

const BYTES: usize = 8 * 3 * 288 * 288;

/// Tries one input.
pub fn run(bytes: &[u8]) {
    assert!(UtiaBrdf::from_bytes("x", bytes).is_err() || bytes.len() == BYTES);
    if bytes.is_empty() || !bytes.len().is_multiple_of(64) {
        return;
    }
    let long: Vec<u8> = bytes.iter().copied().cycle().take(BYTES).collect();
    if let Ok(file) = UtiaBrdf::from_bytes("x", &long) {
        assert_eq!(file.to_bytes(), long);
        let value = file.value([5, 47], [5, 47], 2);
        assert!(value.is_none_or(|v| v >= 0.0), "{value:?}");
    }
}
