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

    /// Returns the value, then its uncertainty.
    pub const fn to_array(self) -> [f64; 2] {
        [self.value, self.sigma]
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
    pub const fn new(low: f64, high: f64) -> Self {
        Self { low, high }
    }

    /// Returns both ends, the lower one first.
    pub const fn to_array(self) -> [f64; 2] {
        [self.low, self.high]
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

impl From<[f64; 2]> for Interval {
    /// Takes the lower end first.
    fn from([low, high]: [f64; 2]) -> Self {
        Self { low, high }
    }
}

impl From<[f64; 2]> for Measured {
    /// Takes the value first, then its uncertainty.
    fn from([value, sigma]: [f64; 2]) -> Self {
        Self { value, sigma }
    }
}

/// Writes and reads intervals, values with their uncertainty, and vectors in a plane as pairs of numbers: `#[serde(with = "sunglint_numerics::measured::pair")]`.
///
/// It serves one, one that may be missing (`Option`) and a list (`Vec`).
///
/// ```
/// use sunglint_numerics::measured::{Interval, pair};
///
/// let nm = vec![Interval::new(300.0, 1240.0)];
/// let json = pair::serialize(&nm, serde_json::value::Serializer)?;
/// assert_eq!(json.to_string(), "[[300.0,1240.0]]");
/// assert_eq!(pair::deserialize::<Vec<Interval>, _>(json)?, nm);
/// # Ok::<(), serde_json::Error>(())
/// ```
pub mod pair {
    use super::{Interval, Measured};
    use glam::DVec2;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    /// A type that is written as a pair, or as several.
    pub trait Paired: Sized {
        /// The pairs.
        type Pairs: Serialize + for<'de> Deserialize<'de>;
        /// Returns the pairs.
        fn pairs(&self) -> Self::Pairs;
        /// Makes it of the pairs.
        fn of(pairs: Self::Pairs) -> Self;
    }

    impl Paired for Interval {
        type Pairs = [f64; 2];

        fn pairs(&self) -> [f64; 2] {
            [self.low, self.high]
        }

        fn of(pairs: [f64; 2]) -> Self {
            pairs.into()
        }
    }

    impl Paired for Measured {
        type Pairs = [f64; 2];

        fn pairs(&self) -> [f64; 2] {
            [self.value, self.sigma]
        }

        fn of(pairs: [f64; 2]) -> Self {
            pairs.into()
        }
    }

    impl Paired for DVec2 {
        type Pairs = [f64; 2];

        fn pairs(&self) -> [f64; 2] {
            self.to_array()
        }

        fn of(pairs: [f64; 2]) -> Self {
            pairs.into()
        }
    }

    impl<T: Paired> Paired for Option<T> {
        type Pairs = Option<T::Pairs>;

        fn pairs(&self) -> Self::Pairs {
            self.as_ref().map(T::pairs)
        }

        fn of(pairs: Self::Pairs) -> Self {
            pairs.map(T::of)
        }
    }

    impl<T: Paired> Paired for Vec<T> {
        type Pairs = Vec<T::Pairs>;

        fn pairs(&self) -> Self::Pairs {
            self.iter().map(T::pairs).collect()
        }

        fn of(pairs: Self::Pairs) -> Self {
            pairs.into_iter().map(T::of).collect()
        }
    }

    /// Writes the pairs.
    pub fn serialize<T: Paired, S: Serializer>(it: &T, serializer: S) -> Result<S::Ok, S::Error> {
        it.pairs().serialize(serializer)
    }

    /// Reads the pairs.
    pub fn deserialize<'de, T: Paired, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<T, D::Error> {
        T::Pairs::deserialize(deserializer).map(T::of)
    }
}
