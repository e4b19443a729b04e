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

/// Why the mean of a group has no number.
pub(crate) const NO_WEIGHT: &str = "not known (none of the samples has a weight)";

/// A mean in percent with its sign, and its uncertainty; `None` where either is no number.
pub(crate) fn percent_with_sigma(share: f64, sigma: f64) -> Option<[String; 2]> {
    let is_known = share.is_finite() && sigma.is_finite();
    is_known.then(|| [format!("{:+.3}", 100.0 * share), format!("{:.3} %", 100.0 * sigma)])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the definition of per cent; a group without weight has a mean of 0/0 and an uncertainty of 1/0.
    #[test]
    fn what_is_no_number_is_not_known() {
        let known = percent_with_sigma(-0.0123, 0.004).unwrap();
        assert_eq!(known, ["-1.230", "0.400 %"]);
        for (share, sigma) in [(f64::NAN, f64::INFINITY), (0.1, f64::INFINITY), (f64::NAN, 0.1)] {
            assert_eq!(percent_with_sigma(share, sigma), None);
        }
    }

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
