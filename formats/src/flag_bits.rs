//! Flags in a table: one bit each of a whole number, with the names of the bits in the metadata.
//!
//! A file says `{"saturated": 0, "gap": 1}`: the number of each flag's bit. The names decide, not the numbers, so a file
//! stays readable when a later version of the program numbers its flags otherwise. A name is the flag's constant in
//! lower case.
//!
//! ```
//! use sunglint_formats::CountFlags;
//! use sunglint_formats::flag_bits::{self, Numbering};
//!
//! assert_eq!(flag_bits::bit_names::<CountFlags>()["gap"], 2);
//! let file = serde_json::json!({"saturated": 0, "gap": 1});
//! let numbering = Numbering::<CountFlags>::read("night.ecsv", Some(&file))?;
//! assert_eq!(numbering.flags(0b11), Some(CountFlags::SATURATED | CountFlags::GAP));
//! assert_eq!(numbering.flags(0b100), None);
//! # Ok::<(), sunglint_formats::ParseError>(())
//! ```

use crate::error::{ParseError, nearest_names};
use bitflags::Flags;
use serde_json::Value;
use std::marker::PhantomData;
use std::path::Path;

/// Name as files spell it and bit of each flag, in the order of the constants. A constant of several bits is only a
/// short way to write them, so files do not know it.
fn named_bits<F: Flags<Bits = u32>>() -> impl Iterator<Item = (String, u32)> {
    F::FLAGS
        .iter()
        .map(|flag| (flag.name().to_lowercase(), flag.value().bits()))
        .filter(|(name, bits)| !name.is_empty() && bits.is_power_of_two())
        .map(|(name, bits)| (name, bits.trailing_zeros()))
}

/// The names of the bits as files spell them, with their numbers: `{"saturated": 0, …}`.
pub fn bit_names<F: Flags<Bits = u32>>() -> Value {
    named_bits::<F>()
        .map(|(name, bit)| (name, bit.into()))
        .collect::<serde_json::Map<_, _>>()
        .into()
}

/// A file's numbering of the flags `F`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Numbering<F> {
    /// For each bit of the file the bits of its flag here; 0 where it has no name.
    ours: [u32; 32],
    flags: PhantomData<F>,
}

impl<F: Flags<Bits = u32>> Numbering<F> {
    /// The numbering that a file's metadata give (see [`bit_names`]). Without any, no flag has a bit and each number
    /// but 0 is unknown. `path` names the file in errors; their field is `flag_bits`.
    ///
    /// # Errors
    /// A value that is no map, a name that is no flag, a bit that is not from 0 to 31, two names for one bit.
    pub fn read(path: impl AsRef<Path>, bits: Option<&Value>) -> Result<Self, ParseError> {
        Self::read_at(path.as_ref(), bits)
    }

    fn read_at(path: &Path, bits: Option<&Value>) -> Result<Self, ParseError> {
        let wrong = |found: String, expected: String| {
            ParseError::new(path, found, expected).in_field("flag_bits")
        };
        let mut ours = [0; 32];
        let mut names: [Option<&str>; 32] = [None; 32];
        let map = match bits {
            None => None,
            Some(Value::Object(map)) => Some(map),
            Some(other) => {
                let expected = "a map from flag to bit, such as {\"gap\": 1}";
                return Err(wrong(crate::error::excerpt(&other.to_string()), expected.into()));
            }
        };
        for (name, bit) in map.into_iter().flatten() {
            let Some((_, our_bit)) = named_bits::<F>().find(|(ours, _)| ours == name) else {
                let known: Vec<String> = named_bits::<F>().map(|(name, _)| name).collect();
                let error = wrong(
                    format!("the flag {}", crate::error::excerpt(name)),
                    "a flag that this version knows".into(),
                );
                let nearest = nearest_names(name, known.iter().map(String::as_str), 1);
                return Err(match nearest.first() {
                    Some(nearest) => error.with_hint(format!("did you mean `{nearest}`?")),
                    None => error.with_hint(format!("the flags are {}", known.join(", "))),
                });
            };
            let Some(bit @ 0..32) = bit.as_u64().map(|bit| bit as usize) else {
                return Err(wrong(format!("bit {bit} of `{name}`"), "a bit from 0 to 31".into()));
            };
            if let Some(other) = names[bit].replace(name) {
                return Err(wrong(
                    format!("bit {bit} for both `{other}` and `{name}`"),
                    "a bit of its own for each flag".into(),
                ));
            }
            ours[bit] = 1 << our_bit;
        }
        Ok(Self { ours, flags: PhantomData })
    }

    /// The flags of a number in the file's numbering; `None` where a bit has no name.
    pub fn flags(&self, value: i64) -> Option<F> {
        let value = u32::try_from(value).ok()?;
        let mut bits = 0;
        for (_, &ours) in self.ours.iter().enumerate().filter(|(bit, _)| value & (1 << bit) != 0) {
            if ours == 0 {
                return None;
            }
            bits |= ours;
        }
        Some(F::from_bits_retain(bits))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    bitflags::bitflags! {
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        struct Weather: u32 {
            const CLOUDS = 1 << 3;
            const HIGH_WIND = 1 << 31;
            const BAD = Self::CLOUDS.bits() | Self::HIGH_WIND.bits();
            const RAIN = 1;
            const NONE = 0;
        }
    }

    #[test]
    fn single_bits_have_names() {
        let names = bit_names::<Weather>();
        assert_eq!(names.to_string(), r#"{"clouds":3,"high_wind":31,"rain":0}"#);
        let own = Numbering::<Weather>::read("w", Some(&names)).unwrap();
        for flags in [Weather::empty(), Weather::RAIN, Weather::BAD, Weather::all()] {
            assert_eq!(own.flags(flags.bits().into()), Some(flags));
        }
    }

    #[test]
    fn names_decide_and_what_has_none_is_unknown() {
        let bits = json!({"rain": 31, "clouds": 0});
        let numbering = Numbering::<Weather>::read("w", Some(&bits)).unwrap();
        assert_eq!(numbering.flags(1 << 31), Some(Weather::RAIN));
        assert_eq!(numbering.flags((1 << 31) + 1), Some(Weather::RAIN | Weather::CLOUDS));
        for unknown in [2, 3, 1 << 32, (1 << 32) + 1, -1, i64::MIN, i64::MAX] {
            assert_eq!(numbering.flags(unknown), None, "{unknown}");
        }
        for nothing in [None, Some(json!({}))] {
            let numbering = Numbering::<Weather>::read("w", nothing.as_ref()).unwrap();
            assert_eq!((numbering.flags(0), numbering.flags(1)), (Some(Weather::empty()), None));
        }
    }

    #[track_caller]
    fn refused(bits: Value, message: &str) {
        let error = Numbering::<Weather>::read("w.ecsv", Some(&bits)).unwrap_err();
        assert_eq!(error.to_string(), format!("w.ecsv: flag_bits: found {message}"));
    }

    #[test]
    fn what_is_no_numbering_is_refused() {
        let unknown = "expected a flag that this version knows";
        refused(
            json!({"cluods": 0}),
            &format!("the flag `cluods`, {unknown} (did you mean `clouds`?)"),
        );
        refused(json!({"RAIN": 0}), &format!("the flag `RAIN`, {unknown} (did you mean `rain`?)"));
        let list = "(the flags are clouds, high_wind, rain)";
        refused(json!({"": 0}), &format!("the flag ``, {unknown} {list}"));
        // Several bits, and none: neither is a flag of a file.
        refused(json!({"bad": 0}), &format!("the flag `bad`, {unknown} {list}"));
        refused(json!({"none": 0}), &format!("the flag `none`, {unknown} {list}"));
        for bit in ["32", "-1", "4294967296", "18446744073709551615", "1.0", "\"1\"", "null"] {
            let value: Value = serde_json::from_str(bit).unwrap();
            refused(
                json!({ "rain": value }),
                &format!("bit {bit} of `rain`, expected a bit from 0 to 31"),
            );
        }
        refused(
            json!({"rain": 4, "clouds": 5, "high_wind": 4}),
            "bit 4 for both `rain` and `high_wind`, expected a bit of its own for each flag",
        );
        refused(
            json!(["rain"]),
            "`[\"rain\"]`, expected a map from flag to bit, such as {\"gap\": 1}",
        );
    }
}
