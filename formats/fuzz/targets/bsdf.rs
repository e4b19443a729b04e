//! Tensor files: no panic, bounded memory, and what is written reads the same.

use sunglint_formats::bsdf::TensorFile;

/// Tries one input.
pub fn run(bytes: &[u8]) {
    if let Ok(file) = TensorFile::from_bytes("x", bytes) {
        let _ = file.check_material("x");
        if let Ok(written) = file.to_bytes() {
            let again = TensorFile::from_bytes("x", &written).expect("what we write, we read");
            assert_eq!(format!("{again:?}"), format!("{file:?}"));
        }
    }
}
