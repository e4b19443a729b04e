//! Curves: no panic; what is read is a curve.

use sunglint_formats::curve;

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let text = &*String::from_utf8_lossy(bytes);
    // n, k and reflectance are those of the layouts of refractiveindex.info and of the spectral libraries.
    for column in [None, Some("qe"), Some("n"), Some("k"), Some("reflectance")] {
        if let Ok(curve) = curve::read_str("x", text, column) {
            assert!(curve.x.len() >= 2 && curve.x.len() == curve.y.len());
            assert!(curve.x.windows(2).all(|pair| pair[0] < pair[1]));
            assert!(curve.x.iter().chain(&curve.y).all(|value| value.is_finite()));
        }
    }
}
