//! Values with their uncertainty, and intervals: types in place of pairs of numbers.

use serde::{Deserialize, Serialize};
use std::fmt;

/// A value and its standard uncertainty, in the same unit.
///
/// ```
/// use sunglint_numerics::measured::Measured;
///
/// let rate_hz = Measured::new(1200.0, 35.0);
/// assert_eq!(rate_hz.relative(), 35.0 / 1200.0);
/// assert_eq!((rate_hz * 2.0).sigma, 70.0);
/// assert_eq!(format!("{rate_hz:.1}"), "1200.0 ± 35.0");
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// The value.
    pub value: f64,
    /// Standard uncertainty.
    pub sigma: f64,
}

impl Measured {
    /// Joins a value with its standard uncertainty.
    pub fn new(value: f64, sigma: f64) -> Self {
        Self { value, sigma }
    }

    /// Returns a value that is known without uncertainty.
    pub fn exact(value: f64) -> Self {
        Self { value, sigma: 0.0 }
    }

    /// Returns the uncertainty over the value's magnitude.
    pub fn relative(&self) -> f64 {
        self.sigma / self.value.abs()
    }

    /// Returns how many standard uncertainties the value lies above another.
    pub fn pull(&self, other: f64) -> f64 {
        (self.value - other) / self.sigma
    }
}

impl std::ops::Mul<f64> for Measured {
    type Output = Self;

    fn mul(self, factor: f64) -> Self {
        Self { value: self.value * factor, sigma: self.sigma * factor.abs() }
    }
}

impl fmt::Display for Measured {
    /// The value and its uncertainty, both with the digits that are asked for.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.value, f)?;
        f.write_str(" ± ")?;
        fmt::Display::fmt(&self.sigma, f)
    }
}

/// Numbers from `low` to `high`, both included.
///
/// ```
/// use sunglint_numerics::measured::Interval;
///
/// let nm = Interval::new(300.0, 1240.0);
/// assert!(nm.contains(550.0) && nm.width() == 940.0);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// The lower end.
    pub low: f64,
    /// The upper end.
    pub high: f64,
}

impl Interval {
    /// Joins two ends, the lower one first.
    pub fn new(low: f64, high: f64) -> Self {
        Self { low, high }
    }

    /// Returns true for a number between the ends, or at one.
    pub fn contains(&self, value: f64) -> bool {
        self.low <= value && value <= self.high
    }

    /// Returns the upper end less the lower one.
    pub fn width(&self) -> f64 {
        self.high - self.low
    }

    /// Returns the middle.
    pub fn middle(&self) -> f64 {
        0.5 * (self.low + self.high)
    }
}
