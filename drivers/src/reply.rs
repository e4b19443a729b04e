//! Answers of instruments as text, parsed strictly: what is not understood is an error that shows it, never a guess.

/// An answer that was not understood: what came, and what should have.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("found `{found}`, expected {expected}")]
pub struct ReplyError {
    /// Text that came.
    pub found: String,
    /// Description of what should have come.
    pub expected: &'static str,
}

impl ReplyError {
    /// `found` instead of `expected`.
    pub fn new(found: &str, expected: &'static str) -> Self {
        const MOST: usize = 60;
        let mut short: String = found.chars().take(MOST).flat_map(char::escape_default).collect();
        if found.chars().nth(MOST).is_some() {
            short.push('…');
        }
        Self { found: short, expected }
    }
}

/// A decimal number as instruments write it (`1.300E-5`, `-12`, `3.`): digits before a point, perhaps some behind it, an
/// exponent perhaps. No words, no infinity.
///
/// # Errors
/// Anything else.
pub fn number(text: &str) -> Result<f64, ReplyError> {
    let digits = |part: &str| part.bytes().all(|byte| byte.is_ascii_digit());
    let (mantissa, exponent) = match text.split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, Some(unsigned(exponent))),
        None => (text, None),
    };
    let magnitude = unsigned(mantissa);
    let (whole, part) = magnitude.split_once('.').unwrap_or((magnitude, ""));
    let good = !whole.is_empty()
        && digits(whole)
        && digits(part)
        && exponent.is_none_or(|power| (1..=3).contains(&power.len()) && digits(power));
    let value = text.parse().ok().filter(|value: &f64| good && value.is_finite());
    value.ok_or_else(|| ReplyError::new(text, "a decimal number"))
}

fn unsigned(text: &str) -> &str {
    text.strip_prefix(['+', '-']).unwrap_or(text)
}

/// A whole number.
///
/// # Errors
/// Anything else, or more than 32 bits.
pub fn integer(text: &str) -> Result<i32, ReplyError> {
    let digits = unsigned(text);
    let good = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
    text.parse().ok().filter(|_| good).ok_or_else(|| ReplyError::new(text, "a whole number"))
}

/// A power with its unit (`30.0mW`, `1.3e-6W`), in W.
///
/// # Errors
/// No number, no unit of power, or not more than zero.
pub fn power_w(text: &str) -> Result<f64, ReplyError> {
    let units = [("kW", 3), ("mW", -3), ("uW", -6), ("nW", -9), ("pW", -12), ("W", 0)];
    let parts = units.iter().find_map(|(unit, power)| Some((text.strip_suffix(unit)?, *power)));
    let value = parts.and_then(|(value, power)| match value.split_once(['e', 'E']) {
        // Read as one number, so that 30.0mW is the double nearest to 0.03.
        None => number(&format!("{value}E{power}")).ok(),
        Some((mantissa, own)) => {
            number(&format!("{mantissa}E{}", integer(own).ok()?.checked_add(power)?)).ok()
        }
    });
    let value = value.filter(|value| *value > 0.0);
    value.ok_or_else(|| ReplyError::new(text, "a power such as `30.0mW`"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the numbers themselves, as the compiler reads them.
    #[test]
    fn numbers_and_powers_are_read_strictly() {
        for (text, value) in [
            ("1.300E-5", 1.3e-5),
            ("-12", -12.0),
            ("+3.", 3.0),
            ("9.9E37", 9.9e37),
            ("1E+003", 1000.0),
        ] {
            assert_eq!(number(text), Ok(value));
        }
        let refused = [
            "", "-", ".5", "1e", "1E1234", "inf", "nan", "1.2.3", "1 2", "0x10", "1E400", "1e5 ",
            "٣",
        ];
        for text in refused {
            assert!(number(text).is_err(), "{text}");
        }
        assert_eq!(integer("-2"), Ok(-2));
        assert!(
            integer("2147483648").is_err() && integer("1.0").is_err() && integer("--1").is_err()
        );
        for (text, value) in [
            ("30.0mW", 0.03),
            ("300uW", 3e-4),
            ("3.00nW", 3e-9),
            ("1.3e-6W", 1.3e-6),
            ("2e3mW", 2.0),
            ("5kW", 5000.0),
        ] {
            assert_eq!(power_w(text), Ok(value));
        }
        for text in ["30.0", "mW", "dBm", "-3mW", "0W", "3 mW", "3e99999999999mW", "1e2147483647kW"]
        {
            assert!(power_w(text).is_err(), "{text}");
        }
    }
}
