//! Spectra in JCAMP-DX: no panic; as many values as places, all finite.

use sunglint_formats::jcamp;

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let text = &*String::from_utf8_lossy(bytes);
    if let Ok(read) = jcamp::read_str("x", text) {
        assert_eq!(read.x.len(), read.y.len());
        assert!(read.x.iter().all(|x| x.is_finite()));
    }
}
