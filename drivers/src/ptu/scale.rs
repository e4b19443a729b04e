//! From ticks of a clock to picoseconds.

/// The length of a tick: the decimal number that a header means, so that 10⁻¹² s is exactly 1 ps and long times keep their
/// last digit, which a product of floats would lose after hours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Resolution {
    /// ps × `denominator`.
    numerator: u128,
    /// A power of ten.
    denominator: u128,
}

impl Resolution {
    /// Shortest and longest tick that makes sense, s: below the resolution of any instrument, and an hour-long sync period.
    pub const RANGE_S: (f64, f64) = (1e-16, 3_600.0);

    /// A tick of so many seconds, taken as the shortest decimal number that is this float. `None` outside of
    /// [`Resolution::RANGE_S`].
    pub fn from_seconds(seconds: f64) -> Option<Self> {
        if !(Self::RANGE_S.0..=Self::RANGE_S.1).contains(&seconds) {
            return None;
        }
        // Rust writes the fewest digits that read back as the same float.
        let text = format!("{seconds:e}");
        let (digits, exponent) = text.split_once('e')?;
        let decimals = digits.split_once('.').map_or(0, |(_, decimals)| decimals.len());
        let mantissa: u128 = digits.replace('.', "").parse().ok()?;
        let power = exponent.parse::<i32>().ok()? - i32::try_from(decimals).ok()? + 12;
        let ten = 10_u128.checked_pow(power.unsigned_abs())?;
        Some(if power < 0 {
            Self { numerator: mantissa, denominator: ten }
        } else {
            Self { numerator: mantissa.checked_mul(ten)?, denominator: 1 }
        })
    }

    /// Whole ps of so many ticks, and the rest, in ps from 0 to below 1.
    fn parts(&self, ticks: u64) -> Option<(u128, f64)> {
        let product = self.numerator.checked_mul(ticks.into())?;
        if self.denominator == 1 {
            return Some((product, 0.0));
        }
        // A division of 64 bits takes a fraction of the time of one of 128.
        let (whole, rest) = match (u64::try_from(product), u64::try_from(self.denominator)) {
            (Ok(product), Ok(denominator)) => {
                ((product / denominator).into(), (product % denominator) as f64)
            }
            _ => (product / self.denominator, (product % self.denominator) as f64),
        };
        Some((whole, rest / self.denominator as f64))
    }

    /// Time of so many ticks, ps, rounded to the nearest; `None` beyond 2⁶³ ps (107 days).
    pub fn ps(&self, ticks: u64) -> Option<i64> {
        let (whole, rest) = self.parts(ticks)?;
        i64::try_from(whole + u128::from(rest >= 0.5)).ok()
    }

    /// Time of so many ticks and so many finer ticks of `fine`, ps, rounded once.
    pub fn ps_with(&self, ticks: u64, fine: &Self, fine_ticks: u64) -> Option<i64> {
        let (whole, rest) = self.parts(ticks)?;
        let (fine_whole, fine_rest) = fine.parts(fine_ticks)?;
        let rounded = (rest + fine_rest + 0.5).floor() as u128;
        i64::try_from(whole.checked_add(fine_whole)?.checked_add(rounded)?).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Truth: products of decimal numbers, worked out by hand.
    #[test]
    fn ticks_are_decimal_numbers() {
        let ps = |seconds, ticks| Resolution::from_seconds(seconds).unwrap().ps(ticks);
        assert_eq!(ps(1e-12, 9_007_199_254_740_993), Some(9_007_199_254_740_993));
        assert_eq!(ps(4e-12, 3), Some(12));
        assert_eq!(ps(2.5e-10, 7), Some(1_750));
        // 50,000.17 ps × 10¹² + …, beyond the 53 bits of a float.
        assert_eq!(ps(5.000017e-8, 100_000_000_001), Some(5_000_017_000_050_000));
        assert_eq!(ps(5e-13, 1), Some(1));
        assert_eq!(ps(4e-13, 1), Some(0));
        assert_eq!(ps(1e-12, i64::MAX as u64), Some(i64::MAX));
        assert_eq!(ps(1e-12, i64::MAX as u64 + 1), None);
        assert_eq!(ps(3_600.0, u64::MAX), None);
        for seconds in [0.0, -1e-12, f64::NAN, f64::INFINITY, 1e-17, 1e4] {
            assert_eq!(Resolution::from_seconds(seconds), None, "{seconds}");
        }
    }

    #[test]
    fn two_clocks_are_rounded_once() {
        let period = Resolution::from_seconds(1.00004e-8).unwrap(); // 10,000.4 ps
        let fine = Resolution::from_seconds(4e-13).unwrap(); // 0.4 ps
        // 10,000.4 + 0.4 = 10,000.8; each alone would be rounded down.
        assert_eq!(period.ps_with(1, &fine, 1), Some(10_001));
        assert_eq!(period.ps_with(10, &fine, 10), Some(100_008));
    }
}
