//! Files of Bruker's OPUS: no panic, bounded memory, and what is written reads the same.

use sunglint_formats::opus::{self, OpusFile};

/// Tries one input.
pub fn run(bytes: &[u8]) {
    if let Ok(file) = opus::from_bytes("x", bytes) {
        let written = opus::to_bytes(&OpusFile { others: 0, ..file.clone() });
        let again = opus::from_bytes("x", &written).expect("what we write, we read");
        assert_eq!(again.spectra.len(), file.spectra.len());
        for spectrum in &file.spectra {
            assert_eq!(spectrum.x().len(), spectrum.y().len());
        }
    }
}
