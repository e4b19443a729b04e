//! Ophir's answers: no panic; what is read keeps its promises.

use sunglint_drivers::ophir::reply::{
    Choice, Head, Instrument, LONGEST_LINE, Line, Ranges, Reading, Wavelengths, Zeroing,
};

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let Ok(Line::Good(body)) = Line::parse(bytes) else { return };
    assert!(body.len() < LONGEST_LINE);
    if let Ok(Reading::Value(watts)) = Reading::parse(&body) {
        assert!(watts.is_finite());
    }
    if let Ok(ranges) = Ranges::parse(&body) {
        assert!(!ranges.name().is_empty() && ranges.largest_w().is_some_and(|watts| watts > 0.0));
    }
    if let Ok(wavelengths @ Wavelengths::Continuous { .. }) = Wavelengths::parse(&body) {
        assert!(wavelengths.in_use_nm().is_some());
    }
    if Instrument::parse(&body).is_ok() {
        assert!(Head::parse(&body).is_err());
    }
    if let Ok(choice) = Choice::parse(&body) {
        assert!(!choice.name().is_empty());
    }
    let _ = Zeroing::parse(&body);
}
