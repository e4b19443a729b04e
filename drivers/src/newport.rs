//! Newport's motion controllers: [ESP301 and ESP300](esp), [SMC100 and CONEX-CC](smc100).
//!
//! Both take short lines of text (`1PA12.5`: axis or controller, two letters, a number). Setters answer nothing, so that each is followed by
//! the question for errors. Lines have no checksums: a position counts when two readings in a row agree.
//!
//! Positions are in the unit that the controller is set to, which must be degrees; the drivers count them in 0.00001°.
//!
//! # Sources
//! Newport, "ESP301 User's Manual" (EDH0235) and "SMC100CC & SMC100PP User's Manual"; pymeasure 0.16.0's `esp300.py`. The meaning of the SMC100's
//! states is as open drivers have it, that of its error bits from memory.
//!
//! # Tried with
//! Nothing real yet: [our simulated ESP301](crate::simulated::esp301), which pymeasure 0.16.0 drives too, and [our simulated
//! SMC100](crate::simulated::smc100), which only our own driver has met.

pub mod esp;
mod link;
pub mod smc100;

use crate::reply::{ReplyError, number};

/// Counts of a degree in the drivers: the last digit that is sent and read is 0.00001°.
const COUNTS_PER_DEG: f64 = 100_000.0;

/// A position in degrees as a count.
fn counts(text: &str) -> Result<i32, ReplyError> {
    let counts = (number(text)? * COUNTS_PER_DEG).round();
    match counts.abs() <= f64::from(i32::MAX) {
        // A whole number within 32 bits.
        true => Ok(counts as i32),
        false => Err(ReplyError::new(text, "a position within 21,474 degrees")),
    }
}

/// A count as a position in degrees.
fn degrees(counts: i32) -> String {
    format!("{:.5}", f64::from(counts) / COUNTS_PER_DEG)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: by hand: the nearest hundred-thousandth, back and forth.
    #[test]
    fn positions_are_counted_in_hundred_thousandths() {
        for (text, count) in
            [("12.5", 1_250_000), ("-0.00001", -1), ("0.000014", 1), ("1E-3", 100), ("0", 0)]
        {
            assert_eq!(counts(text), Ok(count));
        }
        assert_eq!((degrees(1_250_000), degrees(-1)), ("12.50000".into(), "-0.00001".into()));
        for count in [i32::MAX, i32::MIN + 1, 123_456_789, -7] {
            assert_eq!(counts(&degrees(count)), Ok(count));
        }
        assert!(counts("99999").is_err() && counts("1TP").is_err() && counts("").is_err());
    }
}
