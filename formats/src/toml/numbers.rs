//! Numbers that are checked where they are read, so that the error has their line. All refuse `nan` and `inf`.

use serde::de::{Deserialize, Deserializer, Error, Unexpected, Visitor};
use std::fmt;

macro_rules! checked {
    ($(#[doc = $doc:literal])* $name:ident, $expected:literal, $test:expr) => {
        $(#[doc = $doc])*
        #[derive(Debug, Clone, Copy, PartialEq, PartialOrd, serde::Serialize)]
        #[serde(transparent)]
        pub struct $name(f64);

        impl $name {
            #[doc = concat!("The number, if it is ", $expected, ".")]
            pub fn new(value: f64) -> Option<Self> {
                let test: fn(f64) -> bool = $test;
                (value.is_finite() && test(value)).then_some(Self(value))
            }

            /// The number.
            pub fn get(self) -> f64 {
                self.0
            }
        }

        impl From<$name> for f64 {
            fn from(number: $name) -> f64 {
                number.0
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                number(deserializer, Self::new, &$expected)
            }
        }
    };
}

checked!(
    /// A finite number.
    Finite,
    "a finite number",
    |_| true
);
checked!(
    /// A number above zero.
    Positive,
    "a number above 0",
    |value| value > 0.0
);
checked!(
    /// A number of zero or above.
    NonNegative,
    "a number of 0 or above",
    |value| value >= 0.0
);
checked!(
    /// A fraction, from 0 to 1.
    Fraction,
    "a fraction from 0 to 1",
    |value| (0.0..=1.0).contains(&value)
);

/// A number from `LEAST` to `MOST`, both included: `Within<-90, 90>` is a latitude in degrees.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, serde::Serialize)]
#[serde(transparent)]
pub struct Within<const LEAST: i64, const MOST: i64>(f64);

/// A latitude in degrees, north positive.
pub type LatitudeDeg = Within<-90, 90>;
/// A longitude in degrees, east positive; counted to the west or all around.
pub type LongitudeDeg = Within<-180, 360>;

impl<const LEAST: i64, const MOST: i64> Within<LEAST, MOST> {
    /// The number, if it lies in the range.
    pub fn new(value: f64) -> Option<Self> {
        (LEAST as f64..=MOST as f64).contains(&value).then_some(Self(value))
    }

    /// The number.
    pub fn get(self) -> f64 {
        self.0
    }
}

impl<const LEAST: i64, const MOST: i64> From<Within<LEAST, MOST>> for f64 {
    fn from(number: Within<LEAST, MOST>) -> f64 {
        number.0
    }
}

impl<'de, const LEAST: i64, const MOST: i64> Deserialize<'de> for Within<LEAST, MOST> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        number(deserializer, Self::new, &format!("a number from {LEAST} to {MOST}").as_str())
    }
}

/// Reads a number, whole or not, and checks it.
fn number<'de, D: Deserializer<'de>, T>(
    deserializer: D,
    check: impl Fn(f64) -> Option<T>,
    expected: &dyn serde::de::Expected,
) -> Result<T, D::Error> {
    struct Number<'e>(&'e dyn serde::de::Expected);
    impl Visitor<'_> for Number<'_> {
        type Value = f64;
        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            self.0.fmt(f)
        }
        fn visit_f64<E: Error>(self, value: f64) -> Result<f64, E> {
            Ok(value)
        }
        fn visit_i64<E: Error>(self, value: i64) -> Result<f64, E> {
            Ok(value as f64)
        }
        fn visit_u64<E: Error>(self, value: u64) -> Result<f64, E> {
            Ok(value as f64)
        }
    }
    let value = deserializer.deserialize_f64(Number(expected))?;
    check(value).ok_or_else(|| D::Error::invalid_value(Unexpected::Float(value), expected))
}
