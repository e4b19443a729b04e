//! Files of the MERL database: no panic, bounded memory, what is written reads the same, values are numbers.

use sunglint_formats::merl::MerlBrdf;

/// Tries one input.
pub fn run(bytes: &[u8]) {
    if let Ok(file) = MerlBrdf::from_bytes("x", bytes) {
        let again = MerlBrdf::from_bytes("x", &file.to_bytes()).expect("what we write, we read");
        assert_eq!(again, file);
        for place in [0.0, 0.3, 1.57, 4.0, -2.0] {
            let value = file.at(place, 1.57 - place, 3.0 * place, 1);
            assert!(value.is_none_or(|v| v >= 0.0), "{value:?}");
        }
    }
}
