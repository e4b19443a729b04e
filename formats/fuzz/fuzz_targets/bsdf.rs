//! Tensor files: no panic, bounded memory, and what is written reads the same.
#![no_main]

use libfuzzer_sys::fuzz_target;
use sunglint_formats::bsdf::TensorFile;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(file) = TensorFile::from_bytes("x", bytes) {
        let _ = file.check_material("x");
        if let Ok(written) = file.to_bytes() {
            let again = TensorFile::from_bytes("x", &written).expect("what we write, we read");
            assert_eq!(format!("{again:?}"), format!("{file:?}"));
        }
    }
});
