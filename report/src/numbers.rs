//! Numbers as summaries hold them.

/// A number with nine significant digits, as summaries hold it: without the noise of the last bits (329.99999999999994).
///
/// ```
/// use sunglint_report::rounded;
///
/// assert_eq!(rounded(329.99999999999994), 330.0);
/// assert_eq!(rounded(0.1 + 0.2), 0.3);
/// ```
pub fn rounded(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    // Powers of ten up to 22 are exact, so that the quotient is the float nearest to the decimal.
    match 8 - value.abs().log10().floor() as i32 {
        places @ 0..=22 => (value * 10_f64.powi(places)).round() / 10_f64.powi(places),
        places @ -22..0 => (value / 10_f64.powi(-places)).round() * 10_f64.powi(-places),
        // A text of this form is always a number.
        _ => format!("{value:.8e}").parse().unwrap_or(value),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the decimal text rounded to nine digits, read back.
    #[test]
    fn numbers_are_rounded_to_what_a_decimal_text_says() {
        for (value, expected) in [
            (329.999_999_999_999_94, 330.0),
            (0.999_999_999_999_997_8, 1.0),
            (0.1 + 0.2, 0.3),
            (-12.345_678_901_23, -12.345_678_9),
            (6.02e23, 6.02e23),
            (1.234_567_891_4e-30, 1.234_567_89e-30),
            (123_456_789_012.3, 123_456_789_000.0),
            (0.0, 0.0),
        ] {
            assert_eq!(rounded(value), expected);
        }
        for i in 1..2000 {
            let value = (f64::from(i) * 0.37).exp2() * 1e-9;
            assert_eq!(rounded(value), format!("{value:.8e}").parse::<f64>().unwrap(), "{value}");
        }
        assert!(rounded(f64::NAN).is_nan());
    }
}
