//! Curves: no panic; what is read is a curve.
#![no_main]

use libfuzzer_sys::fuzz_target;
use sunglint_formats::curve;

fuzz_target!(|text: &str| {
    for column in [None, Some("qe")] {
        if let Ok(curve) = curve::read_str("x", text, column) {
            assert!(curve.x.len() >= 2 && curve.x.len() == curve.y.len());
            assert!(curve.x.windows(2).all(|pair| pair[0] < pair[1]));
            assert!(curve.x.iter().chain(&curve.y).all(|value| value.is_finite()));
        }
    }
});
